"""The light of a solved scene at points: what is asked in any way is answered alike."""

import json

import numpy as np
import pytest
from enfilade.core.elements import Forest
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from enfilade.core.solution import Light, Solution
from enfilade.core.stage_files import load_stage, save_stage
from scenery import box, building_of, light_kinds, rectangle, rotation, scene_of

LAMP = rectangle((1.2, 1.1, 2.4), (0, 0.5, 0), (0.8, 0, 0))


@pytest.fixture(scope="module")
def solved():
    """A room with a lamp, a shelf, a wall with a window and a polygon without area, and its solution."""
    walls = box(high=(4, 3, 2.5))
    walls[2] = [walls[2], rectangle((1, 0, 1), (1, 0, 0), (0, 0, 1))]
    table = box((2, 1, 0), (3, 2, 0.7), inward=False)
    line = np.array([(1, 1, 1), (2, 1, 1), (3, 1, 1.0)])
    polygons = [*walls, LAMP, *table, line]
    rng = np.random.default_rng(0)
    emission = np.zeros((14, 3))
    emission[6] = (50, 100, 20)
    scene = scene_of(polygons, reflectance=rng.uniform(0.2, 0.8, (14, 3)), emission=emission, object=[0] * 6 + [1] + [2] * 6 + [3])
    return scene, solve(scene, Options(quality="draft", threads=1))


def places(scene, count=200, seed=0):
    """Random points and their polygons, away from the window of polygon 2."""
    rng = np.random.default_rng(seed)
    polygon = rng.choice([0, 1, 3, 4, 5, 6, 8, 9, 11, 12], count)
    corners = np.stack([scene.vertices[scene.corner_vertex[scene.loop_start[scene.polygon_start[p]] + np.arange(4)]] for p in polygon])
    s, t = rng.random((2, count, 1))
    return corners[:, 0] + s * (corners[:, 1] - corners[:, 0]) + t * (corners[:, 3] - corners[:, 0]), polygon


def test_shapes_and_kinds(solved):
    scene, solution = solved
    points, polygon = places(scene)
    light = solution.irradiance(points, polygon)
    assert light.shape == (200, 3)
    assert light.dtype == np.float32
    assert np.isfinite(light).all()
    assert light.min() >= 0
    assert light.mean() > 0
    assert solution.irradiance(np.zeros((0, 3)), np.zeros(0, int)).shape == (0, 3)


def test_points_are_answered_one_by_one_as_all_together(solved):
    scene, solution = solved
    points, polygon = places(scene)
    light = solution.irradiance(points, polygon)
    order = np.random.default_rng(1).permutation(200)
    np.testing.assert_allclose(solution.irradiance(points[order], polygon[order]), light[order], rtol=1e-6)
    for k in range(0, 200, 20):
        np.testing.assert_allclose(solution.irradiance(points[k : k + 1], polygon[k : k + 1])[0], light[k], rtol=1e-6)


def test_steps_tell_their_share_and_end_at_one(solved):
    scene, solution = solved
    points, polygon = places(scene, 5000)
    out = np.full((5000, 3), np.nan, np.float32)
    shares = list(solution.irradiance_steps(points, polygon, out))
    assert (np.diff(shares) >= 0).all()
    assert shares[-1] == 1
    np.testing.assert_array_equal(out, solution.irradiance(points, polygon))


def test_exitance_is_emission_and_what_is_reflected(solved):
    scene, solution = solved
    points, polygon = places(scene)
    expected = scene.emission[polygon] + scene.reflectance[polygon] * solution.irradiance(points, polygon)
    found = solution.exitance(points, polygon)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_polygon_without_area_has_its_emission_alone(solved):
    scene, solution = solved
    assert not solution.irradiance(np.array([[1.5, 1, 1]]), np.array([13])).any()
    np.testing.assert_array_equal(solution.polygon_exitance()[13], scene.emission[13])


def test_corners_and_edges_have_the_light_beside_them(solved):
    _, solution = solved
    # On the edge itself light is undefined; what is given there is what a point 1 cm inside has.
    for polygon, corner, inward in ((5, (0, 0, 2.5), (1, 1, 0)), (5, (4, 1.5, 2.5), (-1, 0, 0)), (0, (0, 3, 0), (0, -1, 1))):
        at = np.array([corner, np.add(corner, 0.01 * np.array(inward))], float)
        light = solution.irradiance(at, np.array([polygon, polygon]))
        assert light[0] == pytest.approx(light[1], rel=0.1)


def test_points_a_little_off_the_plane_are_taken_to_it(solved):
    _, solution = solved
    at = np.array([(1.0, 1, 0), (1, 1, 1e-4), (1, 1, -1e-4)])
    light = solution.irradiance(at, np.full(3, 4))
    np.testing.assert_allclose(light[1:], light[[0, 0]], rtol=1e-5)


def test_the_mean_of_a_polygon_is_that_of_its_points(solved):
    scene = solved[0]
    solution = solve(scene, Options(quality="draft", threads=1, reflected="elements"))
    mean = solution.polygon_exitance()
    x = (np.arange(60) + 0.5) / 60
    for p in (0, 1, 3, 5, 12):
        corners = scene.vertices[scene.corner_vertex[scene.loop_start[scene.polygon_start[p]] + np.arange(4)]]
        s, t = (z.ravel()[:, None] for z in np.meshgrid(x, x))
        points = corners[0] + s * (corners[1] - corners[0]) + t * (corners[3] - corners[0])
        light = solution.exitance(points, np.full(3600, p)).mean(0)
        np.testing.assert_allclose(mean[p], light, rtol=0.02)


def test_light_can_be_saved_and_read_back(solved, tmp_path):
    _, solution = solved
    save_stage(solution.light, tmp_path / "light.npz")
    back = load_stage(Light, tmp_path / "light.npz")
    for name in vars(back):
        np.testing.assert_array_equal(getattr(back, name), getattr(solution.light, name))


def test_the_report_is_plain_json(solved):
    _, solution = solved
    report = json.loads(json.dumps(solution.report))
    wanted = "rooms polygons clusters portals pvs_polygons_max pvs_polygons_mean elements iterations unshot_fraction residual_bound"
    assert set(wanted.split()) | {"dropped_bound", "energy", "segment_tests", "seconds"} <= set(report)
    assert set(report["energy"]) == {"emitted", "absorbed", "escaped"}
    assert (report["rooms"], report["polygons"], report["portals"]) == (1, 14, 0)
    assert report["energy"]["emitted"] == pytest.approx(170 * 0.4)
    # The window is an opening to nothing.
    assert report["energy"]["escaped"] > 0.01 * report["energy"]["emitted"]


class Painted:
    """A solution whose reflected light is written by hand on a mesh of unequal elements."""

    def __init__(self, polygons, function, order=2, seed=0, share=0.5):
        self.scene = scene_of(polygons)
        building = building_of(self.scene)
        forest = Forest(building.regions, order)
        rng = np.random.default_rng(seed)
        for _ in range(5):
            leaf = np.flatnonzero(forest.leaf)
            forest.split(leaf[rng.random(len(leaf)) < share])
        box, region = forest.box, forest.region
        at = lambda x, y: function(building.regions.world(region, box[:, :2] + box[:, 2:] * [x, y]) + building.regions.centre)  # noqa: E731
        light = np.zeros((len(forest), forest.functions, 3), np.float32)
        light[:, 0] = at(0.5, 0.5)
        if order > 1:
            light[:, order] = (at(1, 0.5) - at(0, 0.5)) / (2 * np.sqrt(3))
            light[:, 1] = (at(0.5, 1) - at(0.5, 0)) / (2 * np.sqrt(3))
        direct = np.zeros_like(light)
        self.forest, self.light = forest, light
        self.solution = Solution(self.scene, building, forest, light_kinds(building), direct, light, 0, 0.1, 1, {})


def ramp(x):
    return x @ np.array([[0.3, 0.1, 0], [0.2, -0.1, 0.05], [-0.1, 0.2, 0.1]]) + 5


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("turned", [False, True])
def test_linear_light_is_given_back_exactly(order, turned):
    turn = rotation(4) if turned else np.eye(3)
    painted = Painted([f @ turn.T + [3, 2, 1] for f in box(high=(4, 3, 2.5))], ramp, order)
    assert len(painted.forest) > 100
    rng = np.random.default_rng(0)
    polygon = rng.integers(0, 6, 2000)
    corners = painted.scene.vertices.reshape(6, 4, 3)[polygon]
    s, t = rng.uniform(0.001, 0.999, (2, 2000, 1))
    points = corners[:, 0] + s * (corners[:, 1] - corners[:, 0]) + t * (corners[:, 3] - corners[:, 0])
    np.testing.assert_allclose(painted.solution.irradiance(points, polygon), ramp(points), atol=2e-5)


def test_steps_between_elements_are_softened():
    # Constant elements of one size and of any value: at most half of a step is left in one place.
    painted = Painted([rectangle((0, 0, 0), (4, 0, 0), (0, 4, 0))], ramp, order=1, share=1.0)
    leaf = np.flatnonzero(painted.forest.leaf)
    painted.light[leaf] = np.random.default_rng(0).integers(0, 2, (len(leaf), 1, 3))
    x = np.linspace(0.3, 3.7, 5001)
    light = painted.solution.irradiance(np.column_stack([x, 0.37 * x + 1, 0 * x]), np.zeros(5001, int))
    assert light.min() >= 0
    assert light.max() <= 1
    assert np.ptp(light) > 0.7
    assert 0.2 < np.abs(np.diff(light, axis=0)).max() <= 0.5


def test_negative_light_is_none():
    painted = Painted([rectangle((0, 0, 0), (4, 0, 0), (0, 4, 0))], lambda x: ramp(x) - 100)
    assert painted.solution.report["clamped_values"] == 0
    assert not painted.solution.irradiance(np.array([[1.0, 1, 0]]), np.array([0])).any()
    assert painted.solution.report["clamped_values"] == 3
    assert not painted.solution.polygon_exitance().any()


def test_merged_polygons_share_the_surface():
    cells = [rectangle((i, j, 0), (1, 0, 0), (0, 1, 0)) for i in range(4) for j in range(4)]
    whole, parts = Painted([rectangle((0, 0, 0), (4, 0, 0), (0, 4, 0))], ramp), Painted(cells, ramp)
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 4, (500, 2))
    points = np.column_stack([xy, np.zeros(500)])
    polygon = 4 * np.floor(xy[:, 0]).astype(int) + np.floor(xy[:, 1]).astype(int)
    np.testing.assert_allclose(parts.solution.irradiance(points, polygon), whole.solution.irradiance(points, 0 * polygon), atol=3e-3)


def test_a_floor_shows_beside_a_rug_and_not_under_it():
    rug = box((1, 1, 0), (3, 2, 0.02), inward=False)
    room = box((0, 0, 0), (4, 3, 2.5))
    scene = scene_of(room + rug, emission=[5.0 if k == 5 else 0.0 for k in range(12)], object=[0] * 6 + [1] * 6)
    solution = solve(scene, Options(quality="draft"))
    places = np.array([[2, 1.5, 0], [1.01, 1.99, 0], [0.5, 0.5, 0], [0, 0, 0], [4, 3, 0], [0.98, 1.5, 0], [1, 1.5, 0]], float)
    assert solution.shows(places, np.full(len(places), 4)).tolist() == [False, False, True, True, True, True, False]
