"""Scene checks: the offender is named, what was done is said, and a sound scene passes untouched."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.scene import EvaluationPoints, Portals, Scene, SceneError
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene

DATA = Path(__file__).resolve().parents[1] / "data" / "scenes"
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def lifted(height):
    """The unit square at another height."""
    return SQUARE + np.array([0, 0, height])


def scene_of(polygons=None, **changes):
    """Three unit squares above each other, the top one emits; the last two belong to the table in the second room."""
    polygons = [SQUARE, lifted(1), lifted(2)] if polygons is None else polygons
    count = len(polygons)
    emission = np.zeros((count, 3))
    emission[-1:] = 1
    scene = Scene(
        name="test",
        vertices=np.concatenate(polygons),
        corner_vertex=np.arange(sum(map(len, polygons)), dtype=np.int32),
        loop_start=np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64),
        polygon_start=np.arange(count + 1, dtype=np.int64),
        reflectance=np.full((count, 3), 0.5),
        emission=emission,
        room=np.minimum(np.arange(count), 1).astype(np.int32),
        object=np.minimum(np.arange(count), 1).astype(np.int32),
        room_names=("hall", "attic"),
        object_names=("floor", "table"),
        portals=portals_of([SQUARE], [(0, 1)], ("hatch",)),
        points=EvaluationPoints(np.array([[0.5, 0.5, 0]]), np.array([[0, 0, 1.0]]), np.array([0], np.int32)),
    )
    return replace(scene, **changes)


def portals_of(polygons, rooms, names=()):
    start = np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64)
    return Portals(np.concatenate(polygons).astype(float), start, np.array(rooms, np.int32).reshape(-1, 2), tuple(names))


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


def only(scene, kind):
    """The mended scene and its single finding, which must be of that kind."""
    mended, findings = check(scene)
    assert [f.kind for f in findings] == [kind]
    return mended, findings[0]


@pytest.mark.parametrize("name", ["fzk-haus.json", "cie171-5.3.json"])
def test_sound_scenes_pass_untouched(name):
    scene = load_scene(DATA / name)
    mended, findings = check(scene)
    assert findings == ()
    for key, value in vars(scene).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(mended, key))
    np.testing.assert_array_equal(scene.portals.vertices, mended.portals.vertices)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (lambda s: {"vertices": changed(s.vertices, (5, 1), np.nan)}, "polygon 1 of 'table' has a corner whose position is not a finite"),
        (lambda s: {"vertices": changed(s.vertices, (2, 0), np.inf)}, "polygon 0 of 'floor' has a corner whose position is not a finite"),
        (lambda s: {"vertices": changed(s.vertices, (2, 0), -1e200)}, "polygon 0 of 'floor' has a corner more than 1e+12 m away from"),
        (lambda s: {"portals": portals_of([SQUARE * 1e13], [(0, 1)])}, "portal 0 has a corner more than 1e+12 m away from the origin"),
        (lambda s: {"corner_vertex": changed(s.corner_vertex, 9, 12)}, "polygon 2 of 'table' has a corner at a vertex that does not exist"),
        (lambda s: {"corner_vertex": changed(s.corner_vertex, 0, -1)}, "polygon 0 of 'floor' has a corner at a vertex"),
        (lambda s: {"loop_start": np.array([0, 4, 12, 12])}, "polygon 2 of 'table' has an outline without corners"),
        (lambda s: {"polygon_start": np.array([0, 2, 2, 3])}, "polygon 1 of 'table' has no outline"),
        (lambda s: {"room": np.array([0, 2, 1])}, "polygon 1 of 'table' lies in a room that does not exist"),
        (lambda s: {"room": np.array([-1, 1, 1])}, "polygon 0 of 'floor' lies in a room that does not exist"),
        (lambda s: {"object": np.array([0, 1, 2])}, "polygon 2 belongs to an object that does not exist"),
        (lambda s: {"reflectance": changed(s.reflectance, (1, 2), np.nan)}, "polygon 1 of 'table' has a reflectance that is not a finite"),
        (lambda s: {"emission": changed(s.emission, (0, 0), np.inf)}, "polygon 0 of 'floor' has an emission that is not a finite"),
        (lambda s: {"emission": s.emission[:2]}, "the array emission has 2 entries where the other arrays ask for 3"),
        (lambda s: {"vertices": s.vertices * 0}, "no polygon of the scene has an area"),
        (lambda s: {"points": replace(s.points, polygon=np.array([3]))}, "evaluation point 0 lies on polygon 3, which does not exist"),
        (lambda s: {"points": replace(s.points, position=np.full((1, 3), np.nan))}, "evaluation point 0 has a position or normal"),
        (lambda s: {"portals": portals_of([SQUARE], [(0, 7)], ("hatch",))}, "portal 0 ('hatch') leads to a room that does not exist"),
        (lambda s: {"portals": portals_of([SQUARE], [(-2, 0)])}, "portal 0 leads to a room that does not exist"),
        (lambda s: {"portals": portals_of([SQUARE, SQUARE], [(0, 1), (-1, -1)], ("a", "b"))}, "portal 1 ('b') joins no rooms; move it"),
        (lambda s: {"portals": portals_of([SQUARE], [(1, 1)], ("hatch",))}, "portal 0 ('hatch') has the room 'attic' on both sides"),
        (lambda s: {"portals": portals_of([SQUARE[:2]], [(0, 1)])}, "portal 0 has fewer than three corners"),
        (lambda s: {"portals": portals_of([SQUARE * np.nan], [(0, 1)], ("x",))}, "portal 0 ('x') has a corner whose position is not"),
    ],
)
def test_what_cannot_be_solved_is_refused_by_name(changes, says):
    scene = scene_of()
    with pytest.raises(SceneError) as error:
        check(replace(scene, **changes(scene)))
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_scene_without_polygons_is_refused():
    scene = scene_of()
    none = {key: getattr(scene, key)[:0] for key in ("vertices", "corner_vertex", "reflectance", "emission", "room", "object")}
    empty = replace(scene, **none, loop_start=np.zeros(1, np.int64), polygon_start=np.zeros(1, np.int64), points=None)
    with pytest.raises(SceneError, match="the scene has no polygons; choose collections that contain meshes"):
        check(empty)


def test_unused_vertices_may_be_anything():
    scene = scene_of()
    _, findings = check(replace(scene, vertices=np.concatenate([scene.vertices, np.full((1, 3), np.nan)])))
    assert findings == ()


def test_polygons_without_area_stay_and_are_named():
    line = np.array([[0, 0, 0], [1, 1, 1], [3, 3, 3]], float)
    scene = scene_of([SQUARE, line, SQUARE * 0, lifted(2)])
    mended, finding = only(scene, "no_area")
    assert mended.polygon_count == 4
    assert finding.polygons == (1, 2)
    assert finding.message == "2 polygons have no area and are passed over: polygon 1 of 'table', polygon 2 of 'table'"


def test_points_and_edges_are_polygons_of_no_area():
    scene = scene_of([SQUARE[:1], SQUARE, SQUARE[:2], lifted(2)])
    mended, finding = only(scene, "no_area")
    assert finding.polygons == (0, 2)
    assert np.diff(mended.loop_start).tolist() == [3, 4, 3, 4]
    np.testing.assert_array_equal(mended.vertices[mended.corner_vertex][3:7], SQUARE)
    np.testing.assert_array_equal(mended.vertices[mended.corner_vertex][-4:], lifted(2))


def test_long_lists_of_offenders_are_cut_short_in_words_only():
    scene = scene_of([SQUARE, *[SQUARE * 0] * 50, lifted(2)])
    finding = only(scene, "no_area")[1]
    assert finding.polygons == tuple(range(1, 51))
    assert finding.message.endswith("polygon 1 of 'table', polygon 2 of 'table', polygon 3 of 'table' and 47 more")


@pytest.mark.parametrize(("lift", "found"), [(1e-5, False), (1.9e-4, False), (4.1e-4, True), (0.5, True)])
def test_bent_polygons_are_told(lift, found):
    # A corner lifted by h bends a square by a quarter of that to either side of its mean plane.
    bent = SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, lift], [0, 0, 0]])
    kinds = [f.kind for f in check(scene_of([SQUARE, bent, lifted(2)]))[1]]
    assert kinds == (["not_planar"] if found else [])


def test_reflectance_and_emission_are_brought_into_range():
    scene = scene_of()
    mended, finding = only(replace(scene, reflectance=changed(scene.reflectance, (1, 0), 1.0)), "reflectance_high")
    assert mended.reflectance.tolist() == [[0.5] * 3, [0.999, 0.5, 0.5], [0.5] * 3]
    assert finding.message == "polygon 1 of 'table' has a reflectance of 1 or more, which is lowered to 0.999"
    mended, _ = only(replace(scene, reflectance=changed(scene.reflectance, 2, -0.25)), "reflectance_negative")
    assert mended.reflectance[2].tolist() == [0, 0, 0]
    mended, finding = only(replace(scene, emission=changed(scene.emission, (0, 1), -3.0)), "emission_negative")
    assert mended.emission[0].tolist() == [0, 0, 0]
    assert finding.polygons == (0,)
    assert scene.reflectance[1, 0] == 0.5  # the scene that came in is as it was


def test_reflectance_just_below_one_is_left_alone():
    scene = scene_of(reflectance=np.full((3, 3), 0.9995))
    mended, findings = check(scene)
    assert findings == ()
    assert (mended.reflectance == 0.9995).all()


def test_no_light_and_empty_rooms_are_told():
    scene = scene_of()
    assert "black" in only(replace(scene, emission=scene.emission * 0), "no_light")[1].message
    finding = only(replace(scene, room_names=("hall", "attic", "shed")), "empty_room")[1]
    assert (finding.rooms, finding.message) == ((2,), "1 room has no polygons: 'shed'")
    # Light on a polygon without area is no light.
    flat = scene_of([SQUARE, lifted(1), SQUARE * 0])
    assert [f.kind for f in check(flat)[1]] == ["no_area", "no_light"]


L_SHAPE = np.array([[0, 0, 0], [3, 0, 0], [3, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]], float)
HULL = {(0, 0), (3, 0), (3, 1), (1, 2), (0, 2)}


@pytest.mark.parametrize("seed", range(4))
def test_concave_portals_become_their_hulls(seed):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    scene = scene_of(portals=portals_of([SQUARE, L_SHAPE @ turn.T + 5], [(0, 1), (1, 0)], ("a", "b")))
    mended, finding = only(scene, "portal_hull")
    assert finding.portals == (1,)
    assert "portal 1 ('b')" in finding.message
    hull = (mended.portals.polygon(1) - 5) @ turn
    assert {tuple(np.round(corner[:2], 9) + 0.0) for corner in hull} == HULL
    assert np.abs(hull[:, 2]).max() < 1e-12
    normal = np.cross(hull - hull[0], np.roll(hull, -1, axis=0) - hull[0]).sum(axis=0)
    assert normal[2] == pytest.approx(2 * 5)  # same orientation; the hull has 5 m2
    np.testing.assert_array_equal(mended.portals.polygon(0), SQUARE)


def test_a_doubled_corner_hides_no_concavity():
    doubled = L_SHAPE[[0, 1, 2, 3, 3, 4, 5]]
    assert len(only(scene_of(portals=portals_of([doubled], [(0, 1)])), "portal_hull")[0].portals.polygon(0)) == 5


def test_bent_portals_become_flat():
    bent = SQUARE + np.array([[0, 0, 0.1], [0, 0, -0.1], [0, 0, 0.1], [0, 0, -0.1]])
    mended, _ = only(scene_of(portals=portals_of([bent], [(0, 1)])), "portal_hull")
    corners = mended.portals.polygon(0)
    assert np.abs(corners[:, 2]).max() < 1e-12
    assert {tuple(np.round(corner[:2], 9) + 0.0) for corner in corners} == {(0, 0), (1, 0), (1, 1), (0, 1)}
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    assert normal[2] > 0


def test_crossed_portals_become_their_hulls():
    bow_tie = SQUARE[[0, 1, 3, 2]]
    angle = 4 * np.pi / 5 * np.arange(5)  # a five-pointed star turns left everywhere, but twice around
    star = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    mended, finding = only(scene_of(portals=portals_of([bow_tie, star], [(0, 1), (0, 1)])), "portal_hull")
    assert finding.portals == (0, 1)
    assert [len(mended.portals.polygon(k)) for k in (0, 1)] == [4, 5]


def test_portals_without_area_are_told_and_left():
    line = SQUARE[[0, 1, 1, 0]]
    scene = scene_of(portals=portals_of([line, SQUARE * 0], [(0, 1), (0, -1)], ("slit", "dot")))
    mended, finding = only(scene, "portal_no_area")
    assert finding.message == "2 portals have no area and let no light pass: portal 0 ('slit'), portal 1 ('dot')"
    np.testing.assert_array_equal(mended.portals.vertices, scene.portals.vertices)


def test_convex_portals_with_corners_on_straight_edges_are_left_alone():
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    disc = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    halves = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0], [0, 1, 0]], float)
    portals = portals_of([disc, halves], [(0, 1), (0, -1)])
    mended, findings = check(scene_of(portals=portals))
    assert findings == ()
    np.testing.assert_array_equal(mended.portals.vertices, portals.vertices)
