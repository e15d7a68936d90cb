"""Light of lamps, suns and skies at points, against closed forms and against very many rays."""

import numpy as np
import pytest
from enfilade.core.direct import direct_light
from enfilade.core.lamps import Lamps, Sky
from enfilade.core.luminaires import illuminance
from enfilade.core.occlusion import first_hits, hemisphere
from enfilade.core.parallel import Crew
from enfilade.core.transport import lambert
from lamp_samples import DOWNLIGHT, area_lamp, even_sky, point_lamp, sun
from scenery import box, building_of, light_kinds, portals_of, rectangle, rotation, scene_of

FLOOR = rectangle((-5, -5, 0), (10, 0, 0), (0, 10, 0))


def light_on(scene, lamps, points, polygon):
    """(n, 3) irradiance at points of a polygon."""
    building = building_of(scene)
    region = np.broadcast_to(building.regions.polygon_region[polygon], len(points)).astype(int)
    out = np.full((len(points), 3), np.nan)
    local = (points - building.regions.centre).astype(np.float32)
    for part in direct_light(building, light_kinds(building, lamps, scene.portals), local, region, Crew(1)):
        out[part.index] = part.irradiance
    return out


def spots(n=40, reach=4.0, seed=0):
    """(n, 3) places on the floor."""
    return np.column_stack([np.random.default_rng(seed).uniform(-reach, reach, (n, 2)), np.zeros(n)])


UP = np.array([0, 0, 1.0])


def test_an_area_lamp_is_a_polygon_that_blocks_nothing():
    outline = rectangle((-1, -1, 2), (0, 2, 0), (2, 0, 0))[[0, 1, 2]]
    above = rectangle((-1, -1, 2.5), (0, 2, 0), (2, 0, 0))  # light from there passes the lamp
    scene = scene_of([FLOOR, above], emission=[(0, 0, 0), (5, 5, 5)], object=[0, 1])
    at = spots()
    form = [lambert(at, np.tile(UP, (len(at), 1)), np.repeat(p[None], len(at), 0)) for p in (outline, above)]
    found = light_on(scene, Lamps(area_lamp(outline, (1, 2, 3))), at, 0)
    np.testing.assert_allclose(found, form[0][:, None] * [1, 2, 3] + 5 * form[1][:, None], rtol=1e-5)


def test_an_area_lamp_of_narrow_spread_by_its_parts():
    half = 0.5
    at = spots(30, 1.5)
    found = light_on(scene_of([FLOOR]), Lamps(area_lamp(rectangle((-0.3, -0.3, 2), (0, 0.6, 0), (0.6, 0, 0)), 1.0, spread=2 * half)), at, 0)
    x = (np.arange(40) + 0.5) / 40 * 0.6 - 0.3
    parts = np.array([(a, b, 2.0) for a in x for b in x])
    d = parts[None] - at[:, None]
    square = (d**2).sum(2)
    tangent = np.linalg.norm(d[..., :2], axis=2) / d[..., 2]
    factor = np.maximum(np.tan(half) - tangent, 0) / (np.tan(half) - half)
    expected = (factor * d[..., 2] ** 2 / (np.pi * square**2)).sum(1) * 0.36 / 1600
    np.testing.assert_allclose(found[:, 0], expected, rtol=0.01, atol=1.5e-3 * expected.max())


@pytest.mark.parametrize(("radius", "ball"), [(0.0, False), (0.3, False), (0.3, True)])
def test_a_bulb_over_a_floor(radius, ball):
    at = spots()
    found = light_on(scene_of([FLOOR]), Lamps(points=point_lamp((0.3, -0.2, 2), (10, 20, 30), radius, ball)), at, 0)
    d = np.array([0.3, -0.2, 2]) - at
    square = (d**2).sum(1)
    # A disc that faces the point: I / (d2 + r2); a ball: I / d2, both with the cosine of its middle.
    expected = d[:, 2] / np.sqrt(square) / (square + (0 if ball else radius**2))
    np.testing.assert_allclose(found, expected[:, None] * [10, 20, 30], rtol=2e-4)


def test_a_spot_keeps_to_its_cone():
    at = spots(200)
    turn = rotation(5)
    axis = np.array([0.3, 0.1, -1]) / np.linalg.norm([0.3, 0.1, -1])
    # Rows are the axes of the lamp, which shines along its -z.
    frame = np.stack([np.cross(axis, turn[0]), np.cross(axis, np.cross(axis, turn[0])), -axis])
    frame /= np.linalg.norm(frame, axis=1, keepdims=True)
    lamp = point_lamp((0, 0, 3), 7.0, cone=0.6, blend=0.4, frame=frame)
    found = light_on(scene_of([FLOOR]), Lamps(points=lamp), at, 0)[:, 0]
    d = at - [0, 0, 3]
    cosine = d @ axis / np.linalg.norm(d, axis=1)
    x = np.clip((cosine - np.cos(0.6)) / ((1 - np.cos(0.6)) * 0.4), 0, 1)
    expected = 7 * x * x * (3 - 2 * x) * 3 / np.linalg.norm(d, axis=1) ** 3
    assert 0.1 < (expected > 0).mean() < 0.9
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=2e-3 * expected.max())


def test_a_luminaire_shines_as_its_distribution_says():
    at = spots(200)
    turn = rotation(3)
    efficacy = 179.0
    lamp = point_lamp((0.5, 0.5, 2.5), 1 / efficacy, frame=turn.T, distribution=DOWNLIGHT)
    found = light_on(scene_of([FLOOR]), Lamps(points=lamp), at, 0)[:, 0]
    expected = illuminance(DOWNLIGHT, np.array([0.5, 0.5, 2.5]), turn, at, np.tile(UP, (200, 1)))
    assert (expected > 0).sum() > 20
    np.testing.assert_allclose(efficacy * found, expected, rtol=2e-3, atol=1e-3 * expected.max())


def test_the_penumbra_of_a_disc_behind_an_edge():
    # Half the plane above is closed: what is left of the disc is a segment of a circle.
    edge = rectangle((-20, -20, 1), (20, 0, 0), (0, 40, 0))
    lamp = Lamps(points=point_lamp((0, 0, 2), 1.0, 0.2))
    x = np.linspace(-0.18, 0.18, 9)
    at = np.column_stack([x, 0 * x, 0 * x])
    found = light_on(scene_of([FLOOR, edge], object=[0, 1]), lamp, at, 0)[:, 0]
    free = light_on(scene_of([FLOOR]), lamp, at, 0)[:, 0]
    # The edge at x = 0, z = 1 is seen on the plane of the disc, at z = 2 nearly, at -x.
    c = np.clip(-x / 0.2, -1, 1)
    seen = (np.arccos(c) - c * np.sqrt(1 - c * c)) / np.pi
    np.testing.assert_allclose(found / free, seen, atol=0.02)


def test_a_bulb_behind_a_wall_and_through_a_door():
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x-")]
    door = rectangle((4, 1, 0), (0, 1, 0), (0, 0, 2))
    wall = [
        rectangle((4, 0, 0), (0, 0, 3), (0, 1, 0)),
        rectangle((4, 2, 0), (0, 0, 3), (0, 1, 0)),
        rectangle((4, 1, 2), (0, 0, 1), (0, 1, 0)),
    ]
    polygons = [*rooms, *wall, *[w[::-1] for w in wall]]
    scene = scene_of(polygons, room=[0] * 5 + [1] * 5 + [0] * 3 + [1] * 3, portals=portals_of([door], [[0, 1]]))
    floor = next(k for k in range(5, 10) if polygons[k][:, 2].max() == 0)
    at = np.column_stack([np.random.default_rng(0).uniform((4.05, 0.05), (7.95, 2.95), (500, 2)), np.zeros(500)])
    found = light_on(scene, Lamps(points=point_lamp((1, 1.3, 1.9), 1.0)), at, floor)[:, 0]
    d = np.array([1, 1.3, 1.9]) - at
    t = (4 - at[:, 0]) / d[:, 0]
    y, z = at[:, 1] + t * d[:, 1], t * d[:, 2]
    clear = np.minimum(np.minimum(y - 1, 2 - y), 2 - z)
    expected = (clear > 0) * d[:, 2] / np.linalg.norm(d, axis=1) ** 3
    assert 0.1 < (expected > 0).mean() < 0.9
    sure = np.abs(clear) > 2e-3
    np.testing.assert_allclose(found[sure], expected[sure], rtol=1e-4, atol=1e-7)


# ------------------------------------------------------------------------------------------------------- daylight


def windowed(portal=True, wide=True):
    """A room of 4 x 3 x 3 m with a window of 2 x 1 m in the wall y = 0, and a wall 2 m before it outside."""
    faces = box(high=(4, 3, 3), leave_out="y-")
    around = [(0, 0, 1, 3), (3, 0, 1, 3), (1, 0, 2, 1), (1, 2, 2, 1)]
    wall = [rectangle((x, 0, z), (0, 0, h), (w, 0, 0)) for x, z, w, h in around]
    outside = rectangle((-3, -2, 0), (10, 0, 0), (0, 0, 1.6))
    window = rectangle((1, 0, 1), (2, 0, 0), (0, 0, 1))  # normal -y: out
    portals = portals_of([window], [[0, -1]]) if portal else None
    return scene_of([*faces, *wall, outside], portals=portals, object=[0] * 9 + [1]), window


def floor_points(n=300, seed=1):
    return np.column_stack([np.random.default_rng(seed).uniform((0.05, 0.05), (3.95, 2.95), (n, 2)), np.zeros(n)])


def test_sun_through_a_window():
    scene, _ = windowed()
    toward = np.array([0.2, -1, 1.3]) / np.linalg.norm([0.2, -1, 1.3])
    at = floor_points(1000)
    found = light_on(scene, Lamps(suns=sun(toward, 500.0)), at, 3)
    t = at[:, 1] / -toward[1]
    x, z = at[:, 0] + t * toward[0], t * toward[2]
    far = (at[:, 1] + 2) / -toward[1] * toward[2]
    clear = np.min([x - 1, 3 - x, z - 1, 2 - z, far - 1.6], axis=0)
    sure = np.abs(clear) > 2e-3
    assert (clear[sure] > 0).sum() > 50
    np.testing.assert_allclose(found[sure, 0], 500 * toward[2] * (clear[sure] > 0), rtol=1e-4, atol=1e-3)


def test_a_wide_sun_has_penumbrae_and_the_same_irradiance():
    toward = np.array([0, -1, 1.5]) / np.linalg.norm([0, -1, 1.5])
    at = spots()
    for angle in (0.0, 0.2, 1.0):
        found = light_on(scene_of([FLOOR]), Lamps(suns=sun(toward, 3.0, angle)), at, 0)
        np.testing.assert_allclose(found, 3 * toward[2], rtol=1e-3)
    scene, _ = windowed()
    sharp, soft = (light_on(scene, Lamps(suns=sun(toward, 1.0, a)), floor_points(), 3)[:, 0] for a in (0.0, 0.1))
    part = lambda light: ((light > 0.02) & (light < 0.98 * toward[2])).sum()  # noqa: E731
    assert part(sharp) <= 2
    assert part(soft) > 20


def by_rays(scene, points, polygon, radiance, rays=20000):
    """(n,) irradiance from a sky, function of directions, by rays over the hemisphere of each point."""
    building = building_of(scene)
    regions = building.regions
    region = int(regions.polygon_region[polygon])
    frame = np.stack([regions.u[region], regions.v[region], regions.normal[region]])
    direction = hemisphere(rays) @ frame
    light = np.pi * radiance(direction)
    out = []
    for point in points - regions.centre:
        hits = first_hits(building.blockers, np.repeat(point[None], rays, 0).astype(np.float32), direction.astype(np.float32))
        out.append((light * (hits.blocker < 0)).mean())
    return np.array(out)


# Without a portal the sky is gathered by 2048 rays, of which a hundred meet the window.
THROUGH = pytest.mark.parametrize(("portal", "tolerance"), [(True, 0.02), (False, 0.05)], ids=["through a portal", "through a hole"])


@THROUGH
def test_an_even_sky_through_a_window(portal, tolerance):
    scene, _ = windowed(portal)
    at = floor_points(12)
    found = light_on(scene, Lamps(sky=even_sky(2.0)), at, 3)
    expected = by_rays(scene, at, 3, lambda d: np.full(len(d), 2.0))
    np.testing.assert_allclose(found[:, 0], expected, rtol=tolerance, atol=0.02 * expected.max())


def test_an_even_sky_is_the_form_factor_of_its_window():
    faces = box(high=(4, 3, 3), leave_out="z+")
    hole = rectangle((1, 1, 3), (2, 0, 0), (0, 1, 0))
    roof = [rectangle((x, y, 3), (0, h, 0), (w, 0, 0)) for x, y, w, h in ((0, 0, 4, 1), (0, 2, 4, 1), (0, 1, 1, 1), (3, 1, 1, 1))]
    scene = scene_of([*faces, *roof], portals=portals_of([hole], [[0, -1]]))
    at = floor_points()
    found = light_on(scene, Lamps(sky=even_sky(2.0)), at, 4)
    expected = 2 * np.pi * lambert(at, np.tile(UP, (len(at), 1)), np.repeat(hole[None], len(at), 0))
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, 1), rtol=1e-5)


def overcast(d):
    sine = d[:, 2] / np.linalg.norm(d, axis=1)
    return np.where(sine > 0, (1 + 2 * sine) / 3, 0.1)


@THROUGH
def test_an_overcast_sky_through_a_window(portal, tolerance):
    scene, _ = windowed(portal)
    height, width = 90, 8
    sine = np.sin((np.arange(height) + 0.5) / height * np.pi - 0.5 * np.pi)
    rows = overcast(np.column_stack([np.sqrt(1 - sine**2), 0 * sine, sine]))
    sky = Sky("overcast", np.broadcast_to(rows[:, None, None], (height, width, 3)).astype(np.float32))
    at = floor_points(12)
    found = light_on(scene, Lamps(sky=sky), at, 3)
    expected = by_rays(scene, at, 3, overcast)
    np.testing.assert_allclose(found[:, 0], expected, rtol=tolerance, atol=0.02 * expected.max())


def test_the_sky_turns_as_its_image():
    # Bright towards +x alone, columns clockwise from -x: its middle column.
    image = np.zeros((16, 32, 3), np.float32)
    image[:, 12:20] = 1
    walls = {
        "+x": rectangle((0, 0, 0), (0, 1, 0), (0, 0, 1)),
        "+y": rectangle((0, 0, 0), (0, 0, 1), (1, 0, 0)),
        "-x": rectangle((0, 0, 0), (0, 0, 1), (0, 1, 0)),
    }
    light = {name: light_on(scene_of([p]), Lamps(sky=Sky("s", image)), p.mean(0, keepdims=True), 0)[0, 0] for name, p in walls.items()}
    assert light["+x"] > 3 * light["+y"] > 0
    assert light["-x"] < 0.01 * light["+x"]


def test_an_open_plane_under_the_sky_and_ground_below():
    for polygon, expected in ((FLOOR, 3.0), (FLOOR[::-1], 1.0)):
        image = np.array([1.0, 3.0], np.float32)[:, None, None] * np.ones((2, 1, 3), np.float32)
        image = np.repeat(image, 64, 0)  # sharp at the horizon
        found = light_on(scene_of([polygon]), Lamps(sky=Sky("s", image)), spots(5), 0)
        np.testing.assert_allclose(found, np.pi * expected, rtol=0.01)


def test_a_closed_room_is_dark_by_day():
    scene = scene_of(box(high=(4, 3, 3)))
    found = light_on(scene, Lamps(suns=sun((0.1, 0.2, 1), 1000.0), sky=even_sky(10.0)), floor_points(), 4)
    assert not np.nan_to_num(found).any()
