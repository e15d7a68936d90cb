"""Made-up lamps for tests."""

import numpy as np
from enfilade.core.lamps import AreaLamps, Lamps, PointLamps, Sky, Suns
from enfilade.core.luminous_intensity import POLE_DOWN, Distribution

DOWNLIGHT = Distribution(
    np.array([0.0, 180, 360]),
    np.array([0.0, 30, 60, 90]),
    np.array([[900.0, 700, 200, 0], [800, 600, 300, 10], [900, 700, 200, 0]]),
    POLE_DOWN,
)


def area_lamp(outline, exitance=1.0, room=0, spread=np.pi) -> AreaLamps:
    """One area lamp with corners (n, 3)."""
    outline = np.asarray(outline, float)
    light = np.full((1, 3), exitance) if np.ndim(exitance) == 0 else np.asarray(exitance, float)[None]
    return AreaLamps(("panel",), np.array([room], np.int32), outline, np.array([0, len(outline)]), light, np.array([float(spread)]))


def point_lamp(at, intensity=1.0, radius=0.0, ball=False, room=0, cone=np.pi, blend=0.0, frame=None, distribution=None) -> PointLamps:
    """One lamp that is a point or a ball."""
    light = np.full((1, 3), intensity) if np.ndim(intensity) == 0 else np.asarray(intensity, float)[None]
    frame = np.eye(3) if frame is None else frame
    index, known = (-1, ()) if distribution is None else (0, (distribution,))
    return PointLamps(
        ("bulb",),
        np.array([room], np.int32),
        np.asarray(at, float)[None],
        np.array([float(radius)]),
        np.array([ball]),
        light,
        np.asarray(frame, float)[None],
        np.array([float(cone)]),
        np.array([float(blend)]),
        np.array([index], np.int32),
        known,
    )


def sun(toward, irradiance=1.0, angle=0.0) -> Suns:
    """One sun."""
    toward = np.asarray(toward, float)
    return Suns(("sun",), (toward / np.linalg.norm(toward))[None], np.full((1, 3), irradiance), np.array([float(angle)]))


def even_sky(radiance=1.0) -> Sky:
    """A sky of one radiance all around."""
    return Sky("sky", np.full((1, 1, 3), radiance, np.float32))


def some_of_each() -> Lamps:
    """Lamps of every kind."""
    area = area_lamp([(0, 0, 2), (0, 1, 2), (1, 1, 2), (1.5, 0, 2)], (1, 2, 3), spread=2.0)
    rng = np.random.default_rng(0)
    points = point_lamp((0.5, 0.25, 1.1), (3, 2, 1), 0.1, True, cone=1.0, blend=0.5, frame=rng.normal(size=(3, 3)), distribution=DOWNLIGHT)
    return Lamps(area, points, sun((1, 2, 3), 5.0, 0.01), Sky("sky", rng.random((4, 8, 3)).astype(np.float32)))
