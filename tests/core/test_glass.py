"""Glass in portals: light that passes is dimmed once, direct, linked and gathered."""

from dataclasses import replace

import numpy as np
import pytest
from enfilade.core.lamps import Lamps
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from enfilade.core.scene import SceneError
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene, save_scene
from lamp_samples import area_lamp, even_sky, point_lamp, sun
from scenery import box, portals_of, rectangle, scene_of


def two_rooms(glass, reflectance=0.0, cut=False):
    """Two rooms with a door of 1 x 2 m, with glass of a transmittance; ``cut``: the door in two triangles."""
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x-")]
    door = rectangle((4, 1, 0), (0, 1, 0), (0, 0, 2))
    wall = [rectangle((4, y, z), (0, 0, 3 - z), (0, 1, 0)) for y, z in ((0, 0), (2, 0), (1, 2))]
    doors = [door[[0, 1, 2]], door[[0, 2, 3]]] if cut else [door]
    portals = replace(portals_of(doors, [[0, 1]] * len(doors)), transmittance=np.full(len(doors), glass))
    polygons = [*rooms, *wall, *[w[::-1] for w in wall]]
    return scene_of(polygons, reflectance=reflectance, room=[0] * 5 + [1] * 5 + [0] * 3 + [1] * 3, portals=portals)


def beyond(scene, lamps, quality="draft", reflected="gathered"):
    """(n, 3) light on the floor of the second room."""
    at = np.column_stack([np.random.default_rng(0).uniform((4.2, 0.2), (7.8, 2.8), (200, 2)), np.zeros(200)])
    floor = 8 if scene.vertices[scene.corner_vertex[32:36], 2].max() == 0 else 9
    scene = replace(scene, lamps=lamps)
    return solve(scene, Options(quality=quality, reflected=reflected, threads=1)).irradiance(at, np.full(200, floor))


@pytest.mark.parametrize("cut", [False, True], ids=["whole", "in triangles"])
@pytest.mark.parametrize(
    "lamps",
    [
        Lamps(area_lamp(rectangle((1, 1, 2.9), (0, 1, 0), (1, 0, 0)), 50.0)),
        Lamps(points=point_lamp((1, 1.4, 1.7), 5.0, 0.1)),
    ],
    ids=["area", "point"],
)
def test_direct_light_through_glass(lamps, cut):
    free, dim = beyond(two_rooms(1.0), lamps), beyond(two_rooms(0.6, cut=cut), lamps)
    assert free.max() > 0
    np.testing.assert_allclose(dim, 0.6 * free, rtol=1e-4, atol=1e-5 * free.max())


@pytest.mark.parametrize("reflected", ["gathered", "elements"])
def test_reflected_light_through_glass(reflected):
    # Of what the second room receives next to nothing has passed the glass more than once.
    lamps = Lamps(area_lamp(rectangle((1, 1, 2.9), (0, 1, 0), (1, 0, 0)), 100.0))
    free, dim, dark = (beyond(two_rooms(t, 0.3), lamps, "good", reflected).mean() for t in (1.0, 0.5, 0.0))
    direct = beyond(two_rooms(1.0), lamps).mean()
    assert free > 1.15 * direct
    assert (dim - 0.5 * direct) / (free - direct) == pytest.approx(0.5, abs=0.015)
    assert dark == pytest.approx(0, abs=1e-3 * free)  # what is in the plane of a door is on neither side of it


@pytest.mark.parametrize("panes", [(0.5, 0.5), (0.98, 0.5), (0.5, 0.98)], ids=str)
def test_every_pane_on_the_way_dims(panes):
    """Three rooms in a row; only the first reflects. In the last one arrives what passes both doors, gathered as well as direct."""
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(6, 3, 3), leave_out="x- x+")]
    rooms += box(low=(6, 0, 0), high=(10, 3, 3), leave_out="x-")
    sizes = [5, len(rooms) - 10, 5]
    wall = [rectangle((4, y, z), (0, 0, 3 - z), (0, 1, 0)) for y, z in ((0, 0), (2, 0), (1, 2))]
    walls = [w + [x, 0, 0] for x in (0, 2) for w in wall]
    walls = [*walls[:3], *[w[::-1] for w in walls[:3]], *walls[3:], *[w[::-1] for w in walls[3:]]]
    room = np.repeat([0, 1, 2, 0, 1, 1, 2], [*sizes, 3, 3, 3, 3])
    doors = [rectangle((x, 1, 0), (0, 1, 0), (0, 0, 2)) for x in (4, 6)]
    at = np.column_stack([np.random.default_rng(0).uniform((7.5, 0.8), (9.5, 2.2), (300, 2)), np.zeros(300)])
    floor = next(k for k, p in enumerate(rooms) if (p[:, 2] == 0).all() and p[:, 0].max() == 10)
    lamps = Lamps(area_lamp(rectangle((1, 1, 2.9), (0, 1, 0), (1, 0, 0)), 100.0))
    light = []
    for glass in ((0.98, 0.98), panes):
        for reflectance in (0.7, 0.0):
            portals = replace(portals_of(doors, [[0, 1], [1, 2]]), transmittance=np.array(glass))
            scene = scene_of([*rooms, *walls], reflectance=np.where(room == 0, reflectance, 0.0), room=room.tolist(), portals=portals)
            solution = solve(replace(scene, lamps=lamps), Options(quality="draft", threads=1))
            light.append(solution.irradiance(at, np.full(300, floor)).mean())
    reflected, dimmed = light[0] - light[1], light[2] - light[3]
    assert reflected > 0.2 * light[1]
    assert dimmed / reflected == pytest.approx(panes[0] * panes[1] / 0.98**2, rel=2e-3)


def test_glass_in_a_window_dims_sun_and_sky():
    faces = box(high=(4, 3, 3), leave_out="z+")
    hole = rectangle((1, 1, 3), (2, 0, 0), (0, 1, 0))
    roof = [rectangle((x, y, 3), (0, h, 0), (w, 0, 0)) for x, y, w, h in ((0, 0, 4, 1), (0, 2, 4, 1), (0, 1, 1, 1), (3, 1, 1, 1))]
    scene = scene_of([*faces, *roof], reflectance=0.3, portals=portals_of([hole], [[0, -1]]))
    at = np.column_stack([np.random.default_rng(0).uniform((0.2, 0.2), (3.8, 2.8), (100, 2)), np.zeros(100)])
    found = []
    for glass in (None, np.array([0.7])):
        lit = replace(
            scene, lamps=Lamps(suns=sun((0.1, 0.2, 1), 5.0), sky=even_sky(1.0)), portals=replace(scene.portals, transmittance=glass)
        )
        found.append(solve(lit, Options(quality="draft", threads=1)).irradiance(at, np.full(100, 4)))
    np.testing.assert_allclose(found[1], 0.7 * found[0], rtol=0.01)


def test_glass_in_files_and_checks(tmp_path):
    scene = two_rooms(0.25)
    save_scene(scene, tmp_path / "t.npz")
    assert load_scene(tmp_path / "t.npz").portals.transmittance.tolist() == [0.25]
    assert load_scene(tmp_path / "t.npz").points is None
    with pytest.raises(SceneError, match=r"portal 0 has a transmittance of 1\.5"):
        check(two_rooms(1.5))
    assert check(scene)[0].portals.transmittance.tolist() == [0.25]
