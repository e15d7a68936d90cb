"""What stands on a surface takes its footprint out of it, no more and no less."""

import time

import numpy as np
import pytest
from enfilade.core import footprints, occlusion
from enfilade.core.polygons import areas_and_centroids
from enfilade.core.regions import merge
from scenery import box, rectangle, rotation, scene_of

ROOM = box(high=(4, 5, 3))
FLOOR, CEILING, WALL = 4, 5, 0  # faces z-, z+ and x- of the room


def turned_box(low, high, angle):
    """A box turned about its upright middle axis."""
    c, s = np.cos(angle), np.sin(angle)
    middle = 0.5 * (np.asarray(low, float) + high) * [1, 1, 0]
    return [(f - middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + middle for f in box(low, high, inward=False)]


def uncovered(objects, turn=None, offset=(0, 0, 0), keep=None):
    """Regions before and after, and the region of each polygon, of a room with objects in it."""
    turn = np.eye(3) if turn is None else turn
    polygons = [f @ turn.T + offset for part in (ROOM, *objects) for f in part]
    number = np.repeat(np.arange(1 + len(objects)), [len(part) for part in (ROOM, *objects)])
    before = merge(scene_of(polygons, object=number))
    return before, footprints.uncover(before, occlusion.blockers_of(before))


def held(regions, region, places):
    """(n,) how many cover polygons of a region hold each place (n, 3) of the world."""
    uv = regions.local(np.full(len(places), region), places)
    count = np.zeros(len(places), int)
    for polygon in regions.cover[regions.cover_start[region] : regions.cover_start[region + 1]]:
        edge = np.roll(polygon, -1, 0) - polygon
        offset = uv[:, None] - polygon
        count += (edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0] >= -1e-12).all(1)
    return count


def assert_consistent(regions):
    """Areas are those of the covers, and every cover is counter-clockwise."""
    area, _ = areas_and_centroids(regions.cover)
    assert area.min() > 0
    owner = np.repeat(np.arange(len(regions)), np.diff(regions.cover_start))
    np.testing.assert_allclose(np.bincount(owner, area, minlength=len(regions)), regions.area, rtol=1e-6)
    np.testing.assert_array_equal(regions.full, regions.area >= (1 - 1e-6) * regions.size.prod(1))


TURNS = pytest.mark.parametrize("turn", [np.eye(3), rotation(5)], ids=["upright", "turned"])


@TURNS
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
@pytest.mark.parametrize("bottom", [True, False])
def test_a_box_on_the_floor(angle, bottom, turn):
    table = turned_box((1, 2, 0), (2.2, 3, 0.8), angle)
    offset = np.array([3.0, 1, -2])
    before, after = uncovered([table if bottom else [f for f in table if f[:, 2].max() > 0]], turn, offset)
    of = after.polygon_region
    assert after.area[of[FLOOR]] == pytest.approx(20 - 1.2, rel=1e-6)
    assert_consistent(after)
    others = np.setdiff1d(np.arange(len(after)), [of[FLOOR]])
    np.testing.assert_array_equal(after.area[others], before.area[others])
    if bottom:
        down = 6 + next(k for k, f in enumerate(table) if f[:, 2].max() == 0)
        assert np.flatnonzero(after.buried).tolist() == [of[down]]
    else:
        assert not after.buried.any()
    # Exactly the places under the box are gone.
    flat = np.random.default_rng(0).uniform((0, 0), (4, 5), (4000, 2))
    c, s = np.cos(angle), np.sin(angle)
    local = (flat - [1.6, 2.5]) @ np.array([[c, -s], [s, c]])
    under = (np.abs(local) < [0.6, 0.5]).all(1)
    places = np.column_stack([flat, np.zeros(4000)]) @ turn.T + offset
    np.testing.assert_array_equal(held(after, of[FLOOR], places), ~under)


@TURNS
def test_a_box_in_a_corner_of_the_room(turn):
    before, after = uncovered([box((0, 0, 0), (0.6, 2, 1.9), inward=False)], turn)
    of = after.polygon_region
    assert after.area[of[FLOOR]] == pytest.approx(20 - 1.2, rel=1e-6)
    assert after.area[of[WALL]] == pytest.approx(15 - 3.8, rel=1e-6)
    assert after.area[of[2]] == pytest.approx(12 - 0.6 * 1.9, rel=1e-6)
    # Its back, its side in the corner and its bottom are buried whole; they keep their area.
    assert sorted(np.flatnonzero(after.buried)) == sorted(of[[6, 8, 10]])
    np.testing.assert_array_equal(after.area[of[6:]], before.area[of[6:]])
    assert_consistent(after)


@TURNS
def test_boxes_upon_each_other(turn):
    below, above = box((1, 1, 0), (2, 3, 1), inward=False), box((1.2, 1.5, 1), (1.7, 2.5, 1.6), inward=False)
    _, after = uncovered([below, above], turn)
    of = after.polygon_region
    assert after.area[of[FLOOR]] == pytest.approx(20 - 2, rel=1e-6)
    assert after.area[of[6 + 5]] == pytest.approx(2 - 0.5, rel=1e-6)
    assert sorted(np.flatnonzero(after.buried)) == sorted(of[[6 + 4, 12 + 4]])
    assert after.area[of[12 + 5]] == pytest.approx(0.5)


def test_boxes_side_by_side_and_one_that_reaches_over():
    # The second touches the first with a whole side, the third stands over the edge of the first's top.
    objects = [
        box((1, 1, 0), (2, 2, 1), inward=False),
        box((2, 1, 0), (3, 2, 1), inward=False),
        box((1.5, 1.2, 1), (3.5, 1.4, 1.2), inward=False),
    ]
    _, after = uncovered(objects)
    of = after.polygon_region
    assert after.area[of[FLOOR]] == pytest.approx(20 - 2, rel=1e-6)
    assert after.area[of[[6 + 5, 12 + 5]]] == pytest.approx([1 - 0.1, 1 - 0.2], rel=1e-6)
    assert after.area[of[18 + 4]] == pytest.approx(0.4 - 0.3, rel=1e-6)  # 0.5 m of it hang in the air
    assert sorted(np.flatnonzero(after.buried)) == sorted(of[[6 + 4, 6 + 1, 12 + 4, 12 + 0]])
    assert_consistent(after)


def test_the_legs_of_a_table():
    legs = [box((x, y, 0), (x + 0.05, y + 0.05, 0.7), inward=False) for x in (1, 2) for y in (1, 3)]
    top = box((0.95, 0.95, 0.7), (2.1, 3.1, 0.75), inward=False)
    _, after = uncovered([*legs, top])
    of = after.polygon_region
    assert after.area[of[FLOOR]] == pytest.approx(20 - 4 * 0.0025, rel=1e-6)
    assert after.area[of[6 + 24 + 4]] == pytest.approx(1.15 * 2.15 - 4 * 0.0025, rel=1e-6)
    assert sorted(np.flatnonzero(after.buried)) == sorted(of[[6 + 6 * k + e for k in range(4) for e in (4, 5)]])


def test_a_cupboard_as_high_as_the_room():
    _, after = uncovered([box((0, 2, 0), (0.5, 3, 3), inward=False)])
    of = after.polygon_region
    assert after.area[of[[FLOOR, CEILING, WALL]]] == pytest.approx([19.5, 19.5, 12], rel=1e-6)
    assert sorted(np.flatnonzero(after.buried)) == sorted(of[[6, 10, 11]])


@pytest.mark.parametrize("objects", [[], [box((1, 1, 0.5), (2, 2, 1), inward=False)], [box((1, 1, 1e-2), (2, 2, 1), inward=False)]])
def test_where_nothing_touches_nothing_changes(objects):
    before, after = uncovered(objects)
    assert not after.buried.any()
    np.testing.assert_array_equal(after.area, before.area)
    np.testing.assert_array_equal(after.full, before.full)
    np.testing.assert_array_equal(after.cover_start, before.cover_start)
    assert areas_and_centroids(after.cover)[0] == pytest.approx(areas_and_centroids(before.cover)[0])


def test_a_picture_on_the_wall():
    # A single sheet covers nothing: what is behind it is its own back.
    picture = [rectangle((0.02, 1, 1), (0, 1, 0), (0, 0, 1))]
    before, after = uncovered([picture])
    np.testing.assert_allclose(after.area, before.area)
    assert not after.buried.any()


def test_a_partition_without_thickness():
    partition = [rectangle((2, 0, 0), (0, 2, 0), (0, 0, 2)), rectangle((2, 2, 0), (0, -2, 0), (0, 0, 2))]
    before, after = uncovered([partition])
    np.testing.assert_allclose(after.area, before.area)
    assert not after.buried.any()


def test_a_ceiling_that_is_the_floor_above():
    polygons = [*ROOM, *box(low=(0, 0, 3), high=(8, 5, 6))]
    before = merge(scene_of(polygons, object=np.repeat([0, 1], 6)))
    after = footprints.uncover(before, occlusion.blockers_of(before))
    np.testing.assert_allclose(after.area, before.area)
    assert not after.buried.any()


def test_other_rooms_are_no_matter():
    # Two rooms back to back share a wall plane: the other room's floor and wall take nothing.
    polygons = [*ROOM, *box(low=(4, 0, 0), high=(8, 5, 3)), *box((3, 1, 0), (4, 2, 1), inward=False)]
    room, number = np.repeat([0, 1, 0], 6), np.repeat([0, 1, 2], 6)
    before = merge(scene_of(polygons, room=room, object=number))
    after = footprints.uncover(before, occlusion.blockers_of(before))
    of = after.polygon_region
    np.testing.assert_array_equal(after.area[of[6:12]], before.area[of[6:12]])
    assert after.area[of[[FLOOR, 1]]] == pytest.approx([19, 14], rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_boxes_anywhere_on_the_floor(seed):
    # Turned boxes in a grid, apart from each other.
    rng = np.random.default_rng(seed)
    objects, area = [], 0.0
    for i in range(4):
        for j in range(5):
            if rng.random() < 0.6:
                w, d = rng.uniform(0.1, 0.6, 2)
                middle = np.array([i + 0.5, j + 0.5])
                size = np.array([w, d]) / 2
                objects.append(turned_box((*(middle - size), 0), (*(middle + size), rng.uniform(0.1, 2)), rng.uniform(0, np.pi)))
                area += w * d
    _, after = uncovered(objects, rotation(seed))
    assert after.area[after.polygon_region[FLOOR]] == pytest.approx(20 - area, rel=1e-5)
    assert_consistent(after)


@TURNS
@pytest.mark.parametrize("depth", [0.3, 0.05, 0.002])
def test_a_shelf_that_reaches_into_a_cupboard(depth, turn):
    # The end of the board lies in the dark of the cupboard, and the cupboard's side has a hole where the board goes in.
    cupboard, board = box((1, 1, 0), (2, 2, 2), inward=False), box((2 - depth, 1.2, 1), (3, 1.6, 1.05), inward=False)
    _, after = uncovered([cupboard, board], turn, (1.0, 2, 3))
    of = after.polygon_region
    assert after.area[of[6 + 1]] == pytest.approx(2 - 0.4 * 0.05, rel=1e-6)
    assert after.area[of[12 + 4 : 12 + 6]] == pytest.approx([0.4, 0.4], rel=1e-6)
    assert after.area[of[12 + 2 : 12 + 4]] == pytest.approx([0.05, 0.05], rel=1e-6)
    assert sorted(np.flatnonzero(after.buried)) == sorted(of[[6 + 4, 12]])
    assert_consistent(after)


def test_a_beam_through_a_wall_of_a_box_with_no_bottom():
    # The upper box has no bottom: within it the lower box's top is no surface, nor is the beam that runs through both walls.
    lower, upper = box((1, 1, 0), (3, 3, 0.5), inward=False), box((1.2, 1.2, 0.5), (2.8, 2.8, 1.5), inward=False, leave_out="z-")
    beam = box((0.5, 1.9, 0.9), (3.5, 2.1, 1.1), inward=False)
    _, after = uncovered([lower, upper, beam])
    of = after.polygon_region
    assert after.area[of[6 + 5]] == pytest.approx(4 - 1.6**2, rel=1e-6)
    assert after.area[of[[12, 13]]] == pytest.approx(1.6 - 0.04, rel=1e-6)
    assert after.area[of[17 + 2 : 17 + 6]] == pytest.approx(0.2 * (3 - 1.6), rel=1e-6)


def test_the_hollow_under_a_tub_is_no_surface():
    # Inner and outer walls stand on the floor, the inner bottom hangs between: the inner walls go on below it.
    outer = box((1, 1, 0), (3, 2, 0.6), inward=False, leave_out="z- z+")
    inner = box((1.1, 1.1, 0), (2.9, 1.9, 0.6), inward=True, leave_out="z- z+")
    bottom, rims = (
        [rectangle((1.1, 1.1, 0.15), (1.8, 0, 0), (0, 0.8, 0))],
        [
            rectangle((1, 1, 0.6), (2, 0, 0), (0, 0.1, 0)),
            rectangle((1, 1.9, 0.6), (2, 0, 0), (0, 0.1, 0)),
            rectangle((1, 1.1, 0.6), (0.1, 0, 0), (0, 0.8, 0)),
            rectangle((2.9, 1.1, 0.6), (0.1, 0, 0), (0, 0.8, 0)),
        ],
    )
    _, after = uncovered([outer, inner, bottom, rims])
    of = after.polygon_region
    assert after.area[of[FLOOR]] == pytest.approx(20 - 2, rel=1e-6)
    assert after.area[of[[10, 11]]] == pytest.approx(0.8 * 0.45, rel=1e-6)
    assert after.area[of[14]] == pytest.approx(1.8 * 0.8, rel=1e-6)


def test_a_dark_room_next_door_stays():
    # One room by name, two by walls: the second has a lamp in neither part and no door that a ray would find.
    polygons = [*ROOM, *box(low=(4.2, 0, 0), high=(8, 5, 3)), *box((5, 1, 0), (6, 2, 1), inward=False)]
    before = merge(scene_of(polygons, object=np.repeat([0, 1, 2], 6)))
    after = footprints.uncover(before, occlusion.blockers_of(before))
    of = after.polygon_region
    np.testing.assert_allclose(after.area[of[6:10]], before.area[of[6:10]])
    assert after.area[of[10]] == pytest.approx(3.8 * 5 - 1, rel=1e-6)
    assert np.flatnonzero(after.buried).tolist() == [of[12 + 4]]


def test_the_work_grows_with_the_contacts_only():
    # 40 x 40 stools: every region against every edge of the room would be 80 million tests.
    objects = [box((x, y, 0), (x + 0.5, y + 0.5, 0.5), inward=False) for x in np.arange(0.25, 40) for y in np.arange(0.25, 40)]
    polygons = [*box(high=(40, 40, 3)), *(f for part in objects for f in part)]
    number = np.repeat(np.arange(1 + len(objects)), 6)
    before = merge(scene_of(polygons, object=number))
    start = time.process_time()
    after = footprints.uncover(before, occlusion.blockers_of(before))
    assert time.process_time() - start < 8
    assert after.area[after.polygon_region[FLOOR]] == pytest.approx(1600 - 400, rel=1e-6)
    assert after.buried.sum() == 1600


@TURNS
def test_what_lies_in_the_plane_of_a_surface_takes_its_place(turn):
    # A rug of no thickness, a lamp flush with the ceiling that is larger than a hatch in it, and a rug beyond the wall.
    rug, lamp = [rectangle((1, 1, 0), (2, 0, 0), (0, 1, 0))], [rectangle((1, 1, 3), (0, 1, 0), (1, 0, 0))]
    hatch, across = [rectangle((1.5, 1.5, 3), (0, 1, 0), (0.8, 0, 0))], [rectangle((3.5, 3, 0), (1, 0, 0), (0, 1, 0))]
    polygons = [f @ turn.T + 2 for part in (ROOM, rug, lamp, hatch, across) for f in part]
    emission = np.zeros((10, 3))
    emission[7] = 1
    before = merge(scene_of(polygons, emission=emission, object=np.repeat(range(5), [6, 1, 1, 1, 1])))
    after = footprints.uncover(before, occlusion.blockers_of(before))
    of = after.polygon_region
    assert after.area[of[[FLOOR, CEILING]]] == pytest.approx([20 - 2 - 0.5, 12 + 8 - 1 - 0.8 + 0.25], rel=1e-6)
    assert after.area[of[6:]] == pytest.approx([2, 1, 0.8 - 0.25, 1], rel=1e-6)
    assert not after.buried.any()
    assert_consistent(after)


def test_what_is_covered_whole_by_what_lies_in_its_plane_stays():
    tiles = [rectangle((x, y, 0), (1, 0, 0), (0, 1, 0)) for x in range(4) for y in range(5)]
    before, after = uncovered([[t] for t in tiles])
    np.testing.assert_allclose(after.area, before.area)
    assert not after.buried.any()


@pytest.mark.parametrize("block", [1, 40, 10_000])
def test_some_rooms_at_a_time_give_what_each_gives_alone(block, monkeypatch):
    # A cupboard in every room, larger from room to room; the third room is empty.
    monkeypatch.setattr(footprints, "BLOCK", block)
    polygons, rooms, objects, expected = [], [], [], []
    for k in range(5):
        x, side = 5.0 * k, 0.0 if k == 2 else 0.5 + 0.25 * k
        content = [] if k == 2 else box((x + 1, 1, 0), (x + 1 + side, 1 + side, 1), inward=False)
        polygons += [*box((x, 0, 0), (x + 4, 5, 3)), *content]
        rooms += [k] * (6 + len(content))
        objects += [2 * k] * 6 + [2 * k + 1] * len(content)
        expected.append(20 - side**2)
    before = merge(scene_of(polygons, room=np.array(rooms), object=np.array(objects)))
    shares = [*footprints.uncovering(before, occlusion.blockers_of(before))]
    after = shares.pop()
    assert shares == sorted(shares)
    assert shares[-1] == 1
    floors = [after.polygon_region[rooms.index(k) + FLOOR] for k in range(5)]
    assert after.area[floors] == pytest.approx(expected, rel=1e-6)
    assert after.buried.sum() == 4
    assert_consistent(after)
