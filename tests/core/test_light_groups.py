"""Light groups: what each gives alone adds up to the whole, and dimming one is what a new solve with dimmed lamps says."""

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import stages
from enfilade.core.lamps import Lamps
from enfilade.core.light_groups import MOST, LightGroups
from enfilade.core.lightings import lit_by
from enfilade.core.options import Options
from enfilade.core.pipeline import run, solve
from enfilade.core.scene import OUTSIDE, SceneError
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene, save_scene
from lamp_samples import DOWNLIGHT, area_lamp, even_sky, point_lamp, sun
from scenery import box, portals_of, rectangle, scene_of

BENCH = Path(__file__).resolve().parents[1] / "data" / "bench"
DRAFT = Options(quality="draft", threads=1)
DRAFT_ERROR = 0.10
"""What the quality promises, root mean square over the mean."""
NOTHING = np.zeros(0, np.int32)


def difference(found, expected):
    """Root mean square difference over the mean."""
    return float(np.sqrt(((found - expected) ** 2).mean()) / expected.mean())


@pytest.fixture(scope="module")
def room():
    """A room with a window and lamps of every kind: panels 1 and 2, and all others, each in a group of its own."""
    window = rectangle((1, 0, 1), (1, 0, 0), (0, 0, 1))
    walls = box(high=(4, 3, 2.5))
    walls[2] = [walls[2], window]
    table = box((2.2, 1, 0), (3, 2, 0.7), inward=False)
    panels = [rectangle((x, 1.1, 2.4), (0, 0.5, 0), (0.5, 0, 0)) for x in (0.8, 1.3)]
    emission = np.zeros((14, 3))
    emission[12], emission[13] = (30, 20, 10), (10, 20, 30)
    lamps = Lamps(
        area_lamp([(3, 2, 2.3), (3, 2.5, 2.3), (3.5, 2.5, 2.3), (3.5, 2, 2.3)], (5, 10, 20)),
        point_lamp((1.5, 2.2, 2), 0.002, 0.02, distribution=DOWNLIGHT),
        sun((0.2, -1, 0.6), 8.0, 0.01),
        even_sky(2.0),
    )
    groups = LightGroups(
        ("first", "second", "area", "point", "outside"),
        np.array([-1, -1, 0, 1], np.int32),
        np.array([2], np.int32),
        np.array([3], np.int32),
        np.array([4], np.int32),
        4,
    )
    scene = scene_of(
        [*walls, *table, *panels],
        np.random.default_rng(0).uniform(0.2, 0.8, (14, 3)),
        emission,
        object=[0] * 6 + [1] * 6 + [2, 3],
        portals=portals_of([window], [(0, OUTSIDE)]),
    )
    return check(replace(scene, lamps=lamps, groups=groups))[0]


@pytest.fixture(scope="module")
def solved(room):
    return solve(room, DRAFT)


def places(scene, count=300):
    """Random points on floor and walls."""
    rng = np.random.default_rng(1)
    polygon = rng.choice([0, 1, 3, 4], count)
    first = scene.loop_start[scene.polygon_start[polygon]]
    corner = scene.vertices[scene.corner_vertex[first[:, None] + np.arange(4)]]
    s, t = rng.random((2, count, 1))
    return corner[:, 0] + s * (corner[:, 1] - corner[:, 0]) + t * (corner[:, 3] - corner[:, 0]), polygon


def test_a_group_alone_is_all_that_shines(room):
    kinds = []
    for k in range(5):
        one = lit_by(room, k)
        assert one.groups is None
        shines = [*np.flatnonzero(one.emission.any(1)), *one.lamps.area.names, *one.lamps.points.names, *one.lamps.suns.names]
        kinds.append(shines + ([one.lamps.sky.name] if one.lamps.sky is not None else []))
    assert kinds == [[12], [13], ["panel"], ["bulb"], ["sun", "sky"]]
    np.testing.assert_array_equal(lit_by(room, 1).emission[13], room.emission[13])
    np.testing.assert_array_equal(lit_by(room, 2).lamps.area.vertices, room.lamps.area.vertices)


def test_groups_add_up_to_the_whole(room, solved):
    points, polygon = places(room)
    parts = solved.irradiance_of_groups(points, polygon)
    assert parts.shape == (300, 5, 3)
    assert parts.dtype == np.float32
    assert (parts.mean((0, 2)) > 0.01 * parts.mean()).all()
    # Values that polynomials take below zero at the edges of shadows are cut off for each group apart.
    assert difference(parts.sum(1), solved.irradiance(points, polygon)) < 0.05 * DRAFT_ERROR
    energy = solved.report["energy"]
    assert energy["absorbed"] + energy["escaped"] == pytest.approx(energy["emitted"], rel=0.02)


def test_the_whole_is_that_of_a_solve_without_groups(room, solved):
    plain = solve(replace(room, groups=None), DRAFT)
    points, polygon = places(room)
    assert difference(solved.irradiance(points, polygon), plain.irradiance(points, polygon)) < 5e-3
    np.testing.assert_array_equal(solved.light.direct, plain.light.direct)
    assert solved.report["energy"]["emitted"] == pytest.approx(plain.report["energy"]["emitted"], rel=5e-3)  # of daylight 2,048 points


@pytest.mark.parametrize("k", range(5))
def test_a_group_is_a_solve_with_its_lamps_alone(room, solved, k):
    points, polygon = places(room)
    alone = solve(lit_by(room, k), DRAFT)
    assert difference(solved.irradiance_of_groups(points, polygon)[:, k], alone.irradiance(points, polygon)) < DRAFT_ERROR


def test_light_of_elements_is_parted_as_well(room):
    solution = solve(room, replace(DRAFT, reflected="elements"))
    points, polygon = places(room)
    assert difference(solution.irradiance_of_groups(points, polygon).sum(1), solution.irradiance(points, polygon)) < 1e-3


def test_a_dimmed_office_is_that_of_a_new_solve():
    scene = load_scene(BENCH / "office.npz")
    lamps = np.flatnonzero((scene.emission > 0).any(1))
    thing = scene.object.copy()
    thing[lamps] = 1 + np.arange(len(lamps))
    group = np.concatenate([[-1], np.arange(len(lamps)) % 3]).astype(np.int32)
    groups = LightGroups(("one", "two", "three"), group, NOTHING, NOTHING, NOTHING)
    names = ("office", *(f"lamp {k}" for k in lamps))
    scene, _ = check(replace(scene, object=thing, object_names=names, groups=groups))
    factor = np.array([[1.0, 1, 1], [0.3, 0.25, 0.2], [1, 1, 1]])
    dimmed = replace(scene, emission=scene.emission * factor[np.maximum(group[thing], 0)], groups=None)
    options = replace(DRAFT, reflected="elements", threads=0)  # rays look up the same light, and take most of the time
    points, polygon = scene.points.position[::4], scene.points.polygon[::4]
    parts = solve(scene, options).irradiance_of_groups(points, polygon)
    expected = solve(dimmed, options).irradiance(points, polygon)
    assert difference(parts.sum(1), expected) > 0.5
    assert difference((parts * factor).sum(1), expected) < 0.1 * DRAFT_ERROR


def test_a_run_goes_on_from_its_store(room, solved, tmp_path, monkeypatch):
    options = replace(DRAFT, store=str(tmp_path))
    steps = run(room, options)
    for step in steps:
        if step.message.startswith("area: Iteration"):
            break
    steps.close()
    shots = []
    shoot = stages.Shooter._shoot
    monkeypatch.setattr(stages.Shooter, "_shoot", lambda self, emitter: shots.append(emitter) or shoot(self, emitter))
    again = solve(room, options)
    after = len(shots)
    np.testing.assert_array_equal(again.light.reflected, solved.light.reflected)
    points, polygon = places(room, 20)
    np.testing.assert_array_equal(again.irradiance_of_groups(points, polygon), solved.irradiance_of_groups(points, polygon))
    solve(room, options)
    assert len(shots) == after > 0


def test_groups_load_back_equal(room, tmp_path):
    save_scene(room, tmp_path / "t.npz")
    found = load_scene(tmp_path / "t.npz").groups
    for field in dataclasses.fields(LightGroups):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(room.groups, field.name))
    save_scene(replace(room, groups=None), tmp_path / "t.npz")
    assert load_scene(tmp_path / "t.npz").groups is None
    with np.load(tmp_path / "t.npz") as file:
        assert not [key for key in file.files if key.startswith("group")]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"names": ()}, "0 light groups"),
        ({"names": tuple(map(str, range(MOST + 1)))}, f"{MOST + 1} light groups.*fewer"),
        ({"object": np.zeros(3, np.int32)}, "3 entries of kind object"),
        ({"area": np.array([5], np.int32)}, "no group"),
        ({"object": np.array([-1, -1, 0, -1], np.int32)}, "'object 3' shines but is in no light group"),
        ({"points": np.array([-1], np.int32)}, "'bulb' shines"),
        ({"sky": -1}, "'sky' shines"),
    ],
)
def test_wrong_groups_are_refused(room, change, said):
    with pytest.raises(SceneError, match=said):
        check(replace(room, groups=replace(room.groups, **change)))
