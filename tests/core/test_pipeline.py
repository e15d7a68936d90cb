"""Whole solves against exact answers and path-traced references, and what may not change them."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import parallel, pipeline
from enfilade.core.links import Gains
from enfilade.core.options import OptionError, Options
from enfilade.core.pipeline import Progress, run, solve
from enfilade.core.regions import Regions
from enfilade.core.scene import EvaluationPoints, Scene
from enfilade.core.scene_files import load_scene
from enfilade.core.solution import Light
from enfilade.core.stage_files import load_stage
from scenery import box, portals_of, rectangle, rotation, scene_of

DATA = Path(__file__).resolve().parents[1] / "data"
RADIOSITIES = json.loads((DATA / "radiosities.json").read_text(encoding="utf-8"))["cases"]


class Bench:
    """A scene with reference light at points, of which every ``step``-th is taken."""

    def __init__(self, name, step=1):
        scene = load_scene(DATA / "bench" / f"{name}.npz")
        with np.load(DATA / "bench" / f"{name}.npz") as data, np.load(DATA / "bench" / f"{name}.ref.npz") as reference:
            self.area, self.light = data["pts_area"][::step].astype(float), reference["E"][::step].astype(float)
            self.dark_rooms, self.direct = data["indirect_rooms"], reference["Edir"][::step]
        points = EvaluationPoints(*(getattr(scene.points, f)[::step] for f in ("position", "normal", "polygon")))
        self.scene = dataclasses.replace(scene, points=points)

    def at_points(self, solution):
        return solution.irradiance(self.scene.points.position, self.scene.points.polygon)

    def score(self, found, chosen=slice(None)):
        """Root mean square error over the mean, all channels together, each point weighted by its area."""
        weight, light = self.area[chosen, None], self.light[chosen]
        return np.sqrt((weight * (found[chosen] - light) ** 2).mean() / weight.mean()) / ((weight * light).mean() / weight.mean())

    def unlit(self):
        """(N,) bool: points of rooms without lamps that no lamp shines on."""
        room = self.scene.room[self.scene.points.polygon]
        return np.isin(room, self.dark_rooms) & (self.direct.sum(1) <= 1e-3 * self.light.sum(1))


CORNELL, TWO_ROOMS, FURNACE = Bench("cornell"), Bench("two_rooms"), Bench("furnace", 8)


def balance(solution):
    energy = solution.report["energy"]
    return (energy["absorbed"] + energy["escaped"]) / energy["emitted"]


def difference(a, b):
    """Root mean square difference over the mean."""
    return np.sqrt(((a - b) ** 2).mean()) / np.mean(a)


@pytest.fixture(scope="module")
def cornell():
    solution = solve(CORNELL.scene, Options())
    return solution, CORNELL.at_points(solution)


@pytest.fixture(scope="module")
def two_rooms():
    solution = solve(TWO_ROOMS.scene, Options())
    return solution, TWO_ROOMS.at_points(solution)


# ------------------------------------------------------------------------------------------- right answers


def test_a_furnace_is_even():
    # Every wall emits M and reflects one half: irradiance and radiosity are M / (1 - 1/2) everywhere, exactly.
    solution = solve(FURNACE.scene, Options())
    exact = np.array([2.0, 1, 4])
    assert np.abs(FURNACE.at_points(solution) / exact - 1).max() < 0.005
    assert np.abs(solution.polygon_exitance() / exact - 1).max() < 0.005
    assert balance(solution) == pytest.approx(1, abs=0.005)


@pytest.mark.parametrize(("order", "reflectance"), [(1, 0.1), (1, 0.9), (2, 0.1), (2, 0.9), (2, 0.97), (3, 0.9)])
def test_a_furnace_of_any_reflectance(order, reflectance):
    table = box((1, 1, 0), (2, 2.2, 0.7), inward=False)
    polygons = [f @ rotation(2).T for f in (*box(high=(4, 3, 2.5)), *table)]
    scene = scene_of(polygons, reflectance=reflectance, emission=1 - reflectance, object=[0] * 6 + [1] * 6)
    solution = solve(scene, Options(quality="draft", order=order))
    corners = np.array(polygons)
    points = (0.3 * corners[:, 0] + 0.6 * corners[:, 1] + 0.1 * corners[:, 3])[[0, 1, 2, 3, 4, 5, 6, 7, 11]]
    found = solution.irradiance(points, np.array([0, 1, 2, 3, 4, 5, 6, 7, 11]))
    # Unshot light is at most 0.3 % of what was emitted, and at a high reflectance each part of it still grows.
    assert np.abs(found - 1).max() < 0.005 + 0.003 / (1 - reflectance) * reflectance
    assert balance(solution) == pytest.approx(1, abs=0.005)


@pytest.mark.parametrize("case", RADIOSITIES, ids=lambda case: case["name"])
@pytest.mark.parametrize("kind", ["linear", "quadratic"])
def test_true_solutions_of_the_integral_equation(case, kind):
    column = lambda key: np.array([[s[key]] * 3 for s in case["surfaces"]], float)  # noqa: E731
    corners = [np.array(s["corners"], float) for s in case["surfaces"]]
    scene = scene_of(corners, column("reflectance"), column("emission"), object=np.arange(len(corners)))
    solution = solve(scene, Options(order=2 if kind == "linear" else 3))
    middle = np.array([c.mean(0) for c in corners])
    # Errors are those of the reflected part: what a surface emits itself is no merit of the solver.
    for found, key in ((solution.polygon_exitance(), "mean"), (solution.exitance(middle, np.arange(len(corners))), "centre")):
        expected = column(key) - column("emission")
        np.testing.assert_allclose(found - column("emission"), expected, rtol=0.015)


def test_cornell_box(cornell):
    solution, light = cornell
    assert CORNELL.score(light) < 0.03
    assert balance(solution) == pytest.approx(1, abs=0.005)


def test_two_rooms_and_a_door(two_rooms):
    solution, light = two_rooms
    assert TWO_ROOMS.score(light) < 0.05
    unlit = TWO_ROOMS.unlit()
    assert unlit.sum() > 2000
    assert TWO_ROOMS.score(light, unlit) < 0.12
    assert balance(solution) == pytest.approx(1, abs=0.005)
    assert (solution.report["rooms"], solution.report["portals"], solution.report["polygons"]) == (2, 1, 70)


def test_qualities_are_in_their_order(cornell):
    draft, fine = (CORNELL.score(CORNELL.at_points(solve(CORNELL.scene, Options(quality=q)))) for q in ("draft", "fine"))
    assert draft < 0.1
    assert fine < CORNELL.score(cornell[1]) < draft


@pytest.mark.parametrize("order", [1, 3])
def test_other_bases(order, cornell):
    solution = solve(CORNELL.scene, Options(order=order))
    light = CORNELL.at_points(solution)
    assert CORNELL.score(light) < 0.05
    assert balance(solution) == pytest.approx(1, abs=0.005)
    assert difference(cornell[1], light) < 0.05


@pytest.mark.parametrize(("quality", "limit"), [("good", 0.2), ("fine", 0.07)])
def test_a_gap_behind_a_shelf_is_dark(quality, limit):
    # A board 2 cm from the wall, lit from the room. The gap is a fiftieth of the room's surface: errors there count for
    # as little in the mean square that the quality bounds, but it must not shine as if the board were not there.
    room = box(high=(4, 3, 2.5))
    lamp = rectangle((2.5, 1, 2.4), (0, 1, 0), (1, 0, 0))
    board = box((0.02, 1, 0.7), (0.04, 2, 1.7), inward=False)
    emission = np.zeros((13, 3))
    emission[6] = 30
    solution = solve(scene_of([*room, lamp, *board], emission=emission, object=[0] * 6 + [1] + [2] * 6), Options(quality=quality))
    y, z = (x.ravel() for x in np.meshgrid(np.linspace(1.1, 1.9, 17), np.linspace(0.8, 1.6, 17)))
    behind, back, front = (
        solution.irradiance(np.column_stack([0 * y + x, y, z]), np.full(len(y), p)).mean() for x, p in ((0, 0), (0.02, 7), (0.04, 8))
    )
    assert front > 0.5
    assert behind < limit * front
    assert back < limit * front


def test_a_room_behind_a_closed_wall_stays_black():
    rooms = [*box(high=(4, 3, 3)), *box(low=(4, 0, 0), high=(8, 3, 3))]
    emission = np.zeros((12, 3))
    emission[5] = 10
    room = np.repeat([0, 1], 6)
    # Also where a portal is drawn across the wall, and where all is one room with a wall without thickness.
    door = portals_of([rectangle((4, 1, 0), (0, 1, 0), (0, 0, 2))], [[0, 1]])
    for more in ({"room": room}, {"room": room, "portals": door}, {"object": room}):
        solution = solve(scene_of(rooms, emission=emission, **more), Options(quality="draft"))
        mean = solution.polygon_exitance() - emission
        assert mean[:6].min() > 0.1
        assert np.abs(mean[6:]).max() < 1e-6
        assert balance(solution) == pytest.approx(1, abs=0.005)


def test_storeys_without_a_slab_between_them():
    # The ceiling below and the floor above lie in one plane, back to back, in one room; every surface shines alike.
    scene = scene_of([*box(high=(4, 4, 3)), *box(low=(0, 0, 3), high=(8, 4, 6))], emission=1.0, object=np.repeat([0, 1], 6))
    solution = solve(scene, Options())
    points = np.array([(1, 1, 3), (6, 2, 3), (3.5, 3, 3), (2, 2, 3), (1, 1, 0)], float)
    np.testing.assert_allclose(solution.irradiance(points, np.array([10, 10, 10, 5, 4])), 2, rtol=0.005)
    assert balance(solution) == pytest.approx(1, abs=0.005)


# ------------------------------------------------------------------------------------ what changes nothing


def test_light_doubles_with_the_lamps(cornell):
    bright = dataclasses.replace(CORNELL.scene, emission=2 * CORNELL.scene.emission)
    solution = solve(bright, Options())
    # Tolerances are relative to the light, so that the same work is done: equal but for rounding.
    np.testing.assert_allclose(CORNELL.at_points(solution), 2 * cornell[1], rtol=1e-4, atol=1e-4 * cornell[1].mean())
    assert solution.report["elements"] == cornell[0].report["elements"]


def test_channels_do_not_mix(cornell):
    scene = CORNELL.scene
    swapped = dataclasses.replace(scene, emission=scene.emission[:, ::-1], reflectance=scene.reflectance[:, ::-1])
    found = CORNELL.at_points(solve(swapped, Options()))[:, ::-1]
    np.testing.assert_allclose(found, cornell[1], rtol=1e-4, atol=1e-4 * cornell[1].mean())


def shuffled(scene: Scene, seed: int) -> Scene:
    """The same polygons in another order, each beginning at another corner."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(scene.polygon_count)
    place = np.argsort(order)
    loops = [np.roll(scene.corner_vertex[scene.loop_start[p] : scene.loop_start[p + 1]], rng.integers(4)) for p in order]
    return dataclasses.replace(
        scene,
        corner_vertex=np.concatenate(loops),
        loop_start=np.concatenate([[0], np.cumsum([len(x) for x in loops])]),
        **{name: getattr(scene, name)[order] for name in ("reflectance", "emission", "room", "object")},
        points=dataclasses.replace(scene.points, polygon=place[scene.points.polygon].astype(np.int32)),
        room_names=tuple(f"other {k}" for k in range(scene.room_count)),
        object_names=tuple(f"thing {k}" for k in range(len(scene.object_names))),
    )


def moved(scene: Scene, matrix, offset) -> Scene:
    """The scene turned or scaled, and shifted."""
    put = lambda x: x @ np.asarray(matrix, float).T + offset  # noqa: E731
    return dataclasses.replace(
        scene,
        vertices=put(scene.vertices),
        portals=dataclasses.replace(scene.portals, vertices=put(scene.portals.vertices)),
        points=dataclasses.replace(scene.points, position=put(scene.points.position)),
    )


@pytest.mark.parametrize("bench", [CORNELL, TWO_ROOMS], ids=["cornell", "two rooms"])
def test_order_and_names_do_not_matter(bench, request):
    _, light = request.getfixturevalue("cornell" if bench is CORNELL else "two_rooms")
    scene = shuffled(bench.scene, 3)
    found = solve(scene, Options()).irradiance(scene.points.position, scene.points.polygon)
    # Of two elements alike the first is split, and sums run in another order: far less than the tolerance of 3 %.
    assert difference(light, found) < 2e-3


@pytest.mark.parametrize(
    ("matrix", "offset"),
    [(rotation(3), 0.0), (np.eye(3), np.array([1e6, -2e5, 3e5])), (100 * np.eye(3), 0.0), (0.01 * np.eye(3), 0.0)],
    ids=["turned", "far away", "in centimetres", "in hectometres"],
)
def test_place_and_size_do_not_matter(matrix, offset):
    # Interpolated from the elements: the rays of a square surface may start along either of its sides.
    scene, options = moved(CORNELL.scene, matrix, offset), Options(reflected="elements")
    expected = CORNELL.at_points(solve(CORNELL.scene, options))
    found = solve(scene, options).irradiance(scene.points.position, scene.points.polygon)
    # Single precision places points within a millionth of the scene, which moves the edges of shadows as little.
    assert difference(expected, found) < 5e-3


@pytest.mark.parametrize(
    "more",
    [{"emitters": "cells", "ordering": "backtrack_s"}, {"ordering": "random", "seed": 7, "average": 1, "large_polygon": 0.0}],
    ids=str,
)
def test_emitters_orderings_and_clusters_do_not_matter(more, two_rooms):
    # They end with other light unshot, up to a thousandth of what was emitted.
    solution = solve(TWO_ROOMS.scene, Options(**more))
    assert difference(two_rooms[1], TWO_ROOMS.at_points(solution)) < 3e-3
    assert solution.report["unshot_fraction"] <= 1e-3


def test_a_mesh_in_triangles_is_the_same_surface(cornell):
    scene = CORNELL.scene
    first, count = scene.loop_start[:-1], np.diff(scene.loop_start)
    corners = [scene.corner_vertex[f : f + n] for f, n in zip(first, count, strict=True)]
    owner = np.repeat(np.arange(len(corners)), count - 2)
    fans = [c[[0, k + 1, k + 2]] for c in corners for k in range(len(c) - 2)]
    triangles = dataclasses.replace(
        scene,
        corner_vertex=np.concatenate(fans),
        loop_start=3 * np.arange(len(fans) + 1),
        polygon_start=np.arange(len(fans) + 1),
        **{name: getattr(scene, name)[owner] for name in ("reflectance", "emission", "room", "object")},
    )
    # A point may lie in either triangle of its polygon: both belong to one region.
    polygon = np.searchsorted(owner, scene.points.polygon)
    found = solve(triangles, Options()).irradiance(scene.points.position, polygon)
    assert difference(cornell[1], found) < 2e-3


def test_the_same_bits_on_any_number_of_threads(monkeypatch):
    monkeypatch.setattr(parallel, "PATIENCE", -1.0)
    one, four = (solve(TWO_ROOMS.scene, Options(quality="draft", threads=t)) for t in (1, 4))
    for name in ("region", "children", "box", "direct", "reflected"):
        np.testing.assert_array_equal(getattr(one.light, name), getattr(four.light, name))
    np.testing.assert_array_equal(TWO_ROOMS.at_points(one), TWO_ROOMS.at_points(four))
    skipped = ("seconds", "solve_seconds", "peak_bytes")
    reports = [{k: v for k, v in s.report.items() if k not in skipped} for s in (one, four)]
    assert reports[0] == reports[1]


def test_what_does_not_fit_goes_to_disk_and_gives_the_same_bits(tmp_path):
    options = Options(quality="draft", reflected="elements")
    free = solve(TWO_ROOMS.scene, options)
    tight = solve(TWO_ROOMS.scene, dataclasses.replace(options, memory=10_000, store=str(tmp_path / "store")))
    np.testing.assert_array_equal(free.light.reflected, tight.light.reflected)
    assert all(free.report["disk"][what] == 0 for what in ("light_read", "light_written", "links_read"))
    assert all(tight.report["disk"][what] > 0 for what in ("light_read", "light_written", "links_read"))
    with pytest.raises(OptionError, match="store"):
        solve(TWO_ROOMS.scene, Options(quality="draft", memory=10_000))


def test_every_stage_is_saved(tmp_path):
    solution = solve(CORNELL.scene, Options(quality="draft", store=str(tmp_path)))
    assert {"regions.npz", "clusters.npz", "graph.npz", "light.npz"} <= {p.name for p in tmp_path.iterdir()}
    np.testing.assert_array_equal(load_stage(Light, tmp_path / "light.npz").reflected, solution.light.reflected)
    assert load_stage(Regions, tmp_path / "regions.npz").area.sum() > 0


# ------------------------------------------------------------------------------------------------ scenes


def test_no_light_and_no_reflection():
    faces = box(high=(4, 3, 2.5))
    middle = np.array([f.mean(0) for f in faces]) * 0.9 + 0.05
    emission = np.zeros((6, 3))
    emission[5] = 1
    dark = solve(scene_of(faces), Options())
    assert not dark.irradiance(middle, np.arange(6)).any()
    assert dark.report["energy"] == {"emitted": 0, "absorbed": 0, "escaped": 0}
    assert dark.report["iterations"] == 0
    black = solve(scene_of(faces, reflectance=0.0, emission=emission), Options())
    np.testing.assert_array_equal(black.exitance(middle, np.arange(6)), emission.astype(np.float32))
    assert black.report["unshot_fraction"] == 0
    assert balance(black) == pytest.approx(1, abs=0.005)


def test_light_that_grows_ends_in_a_warning_that_names_the_room(monkeypatch):
    def too_much(forest, found, kept, *rest):
        factor = np.ones((len(forest), forest.node_count), np.float32)
        factor[forest.regions.room[forest.region] == 1] = 3
        return Gains(factor, factor)

    scene = dataclasses.replace(TWO_ROOMS.scene, room_names=("hall", "study"))
    quiet = solve(scene, Options(quality="draft"))
    monkeypatch.setattr(pipeline.links, "closing_gains", too_much)
    loud = solve(scene, Options(quality="draft"))
    assert not any("grew" in text for text in quiet.report["warnings"])
    (text,) = (text for text in loud.report["warnings"] if "grew" in text)
    assert "room 'study'" in text
    assert "finer quality" in text
    assert loud.report["iterations"] < 100


def test_one_polygon_alone():
    for polygon in (rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), np.array([(0, 0, 0), (1, 0, 0), (0, 1, 1.0)])):
        solution = solve(scene_of([polygon], emission=5.0), Options())
        assert not solution.irradiance(polygon.mean(0)[None], np.array([0])).any()
        assert solution.report["energy"]["escaped"] == pytest.approx(solution.report["energy"]["emitted"])
        np.testing.assert_allclose(solution.polygon_exitance(), 5)


def test_polygons_without_area_are_no_matter():
    faces = box(high=(4, 3, 2.5))
    nothing = [np.zeros((3, 3)), np.array([(0, 0, 0), (1, 1, 1), (2, 2, 2.0)])]
    emission = np.zeros((8, 3))
    emission[5] = emission[6] = 1
    with_them, without = (
        solve(scene_of([*faces, *nothing], emission=emission), Options()),
        solve(scene_of(faces, emission=emission[:6]), Options()),
    )
    np.testing.assert_array_equal(with_them.polygon_exitance()[:6], without.polygon_exitance())


def test_a_lamp_of_one_square_millimetre():
    lamp = rectangle((2, 1.5, 2.4), (0, 1e-3, 0), (1e-3, 0, 0))
    emission = np.zeros((7, 3))
    emission[6] = 1e8
    solution = solve(scene_of([*box(high=(4, 3, 2.5)), lamp], emission=emission, object=[0] * 6 + [1]), Options())
    at = np.array([[2.0005, 1.5005, 0]])
    direct = 1e8 * 1e-6 / (np.pi * 2.4**2)
    assert solution.irradiance(at, np.array([4]))[0, 0] > direct
    assert balance(solution) == pytest.approx(1, abs=0.005)


# --------------------------------------------------------------------------------------------- progress


def test_progress_rises_from_stage_to_stage():
    steps = []
    solution = solve(TWO_ROOMS.scene, Options(quality="draft"), steps.append)
    assert all(isinstance(s, Progress) and s.message for s in steps)
    share = np.array([s.fraction for s in steps])
    assert share[0] == 0
    assert share[-1] > 0.95
    assert share.max() <= 1
    assert (np.diff(share) >= -1e-9).all()
    stages = list(dict.fromkeys(s.stage for s in steps))
    assert stages == ["merge", "cluster", "graph", "solve"]
    assert len(steps) > 20
    assert set(stages) <= set(solution.report["seconds"])


@pytest.mark.parametrize("after", [1, 3, 8, 15])
@pytest.mark.parametrize("threads", [1, 2])
def test_closing_the_generator_ends_the_run(after, threads):
    steps = run(CORNELL.scene, Options(quality="draft", threads=threads))
    for _ in range(after):
        next(steps)
    steps.close()
    with pytest.raises(StopIteration):
        next(steps)


def test_an_error_in_the_callers_progress_comes_through():
    class Stop(Exception):
        pass

    def stop(step):
        if step.stage == "solve":
            raise Stop

    with pytest.raises(Stop):
        solve(CORNELL.scene, Options(quality="draft"), stop)


@pytest.mark.filterwarnings("error")
def test_portals_without_area_are_passed_over():
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x-")]
    sides = [((4, 0, 0), (0, 0, 3), (0, 1, 0)), ((4, 2, 0), (0, 0, 3), (0, 1, 0)), ((4, 1, 2), (0, 0, 1), (0, 1, 0))]
    wall = [rectangle(*side) for side in sides]
    polygons = [*rooms, *wall, *[w[::-1] for w in wall]]
    room, emission = [0] * 5 + [1] * 5 + [0] * 3 + [1] * 3, np.eye(len(polygons), 3)
    door, slit = rectangle((4, 1, 0), (0, 1, 0), (0, 0, 2)), rectangle((4, 0.5, 1), (0, 1, 0), (0, 0, 0))
    dot = np.full((4, 3), (4.0, 1, 1))
    found = []
    for doors in ([door], [door, slit, dot]):
        scene = scene_of(polygons, emission=emission, room=room, portals=portals_of(doors, [[0, 1]] * len(doors)))
        found.append(solve(scene, Options(quality="draft", threads=1)).light)
    np.testing.assert_array_equal(found[0].direct, found[1].direct)
    np.testing.assert_array_equal(found[0].reflected, found[1].reflected)
    assert found[0].reflected[8].any()  # the far wall of the other room
