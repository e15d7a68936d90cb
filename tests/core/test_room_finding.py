"""Rooms from surfaces and portals alone, in buildings whose rooms are known."""

from pathlib import Path

import numpy as np
import pytest
from enfilade.core.room_finding import HOLLOW, find_rooms, rooms_of_objects
from enfilade.core.scene import OUTSIDE
from enfilade.core.scene_files import load_scene
from scenery import box, rectangle, rotation

DATA = Path(__file__).resolve().parents[1] / "data"


def fans(polygons):
    """Triangles of convex polygons and the polygon of each."""
    triangles = [(p[[0, k, k + 1]], i) for i, p in enumerate(map(np.asarray, polygons)) for k in range(1, len(p) - 1)]
    return np.array([t for t, _ in triangles]).reshape(-1, 3, 3), np.array([i for _, i in triangles], int)


def find(polygons, portals=(), turn=None, **more):
    turn = np.eye(3) if turn is None else turn
    return find_rooms(*fans([p @ turn.T for p in polygons]), *fans([p @ turn.T for p in portals]), **more)


def holed(x, hole, towards, wide=4.0, high=3.0):
    """A wall x = const of 4 x 3 m around a hole (y0, y1, z0, z1), its front looking to ``towards`` along x."""
    y0, y1, z0, z1 = hole
    around = (((0, y0), (0, high)), ((y1, wide), (0, high)), ((y0, y1), (0, z0)), ((y0, y1), (z1, high)))
    walls = [rectangle((x, a, c), (0, b - a, 0), (0, 0, d - c)) for (a, b), (c, d) in around if b > a and d > c]
    return [w[::-1] if towards < 0 else w for w in walls]


DOOR = (1.5, 2.5, 0.0, 2.0)
PORTAL = rectangle((4.1, 1.5, 0), (0, 1, 0), (0, 0, 2))


def two_rooms(door=DOOR):
    """Rooms of 4 x 4 x 3 and 3 x 4 x 3 m, a wall of 0.2 m between, a door through it; with the room of every polygon."""
    reveal = box((4.0, door[0], door[2]), (4.2, door[1], door[3]), leave_out="x- x+")
    west = box((0, 0, 0), (4, 4, 3), leave_out="x+") + holed(4.0, door, -1)
    east = box((4.2, 0, 0), (7.2, 4, 3), leave_out="x-") + holed(4.2, door, 1)
    return west + east + reveal, [0] * len(west) + [1] * len(east)


@pytest.mark.parametrize("turn", [np.eye(3), rotation(2)], ids=["straight", "turned"])
def test_a_portal_parts_two_rooms(turn):
    polygons, room = two_rooms()
    found = find(polygons, [PORTAL], turn)
    assert len(found) == 2
    # Turned, the rooms may come in another order.
    order = [int(found.front[0]), int(found.front[len(polygons) // 2])]
    assert sorted(order) == [0, 1]
    assert found.front[: len(room)].tolist() == [order[r] for r in room]
    assert found.portal_rooms.tolist() == [order]
    assert found.gaps == ()
    assert not found.lid
    # The outside and the inside of the wall are behind all of them.
    assert set(found.back[: len(room)].tolist()) <= {OUTSIDE, HOLLOW}
    # Cells at the walls are closed: at least half a cell on all sides is missing.
    assert 0.8 * 48 < found.volume[order[0]] < 48
    assert 0.8 * 36 < found.volume[order[1]] < 36
    local = found.inside[order] @ turn
    assert np.abs(local - [[2, 2, 1.5], [5.7, 2, 1.5]]).max() < 0.8


def test_without_a_portal_a_door_joins_them():
    polygons, room = two_rooms()
    found = find(polygons)
    assert len(found) == 1
    assert (found.front[: len(room)] == 0).all()


def test_a_room_inside_out_is_a_room():
    found = find(box((0, 0, 0), (4, 4, 3), inward=False))
    assert len(found) == 1
    assert (found.back == 0).all()
    assert (found.front == OUTSIDE).all()


def test_a_slit_beside_a_portal_closes_itself():
    polygons, _ = two_rooms()
    slim = rectangle((4.1, 1.53, 0), (0, 0.94, 0), (0, 0, 1.97))
    assert len(find(polygons, [slim])) == 2


def test_furniture_and_walls_are_no_rooms():
    polygons, _ = two_rooms()
    wardrobe = box((0.5, 0.5, 0), (2.5, 1.5, 2.4), inward=False)
    found = find(polygons + wardrobe, [PORTAL])
    assert len(found) == 2
    # Only its underside, which lies on the floor, does not look into the room.
    assert np.flatnonzero(found.front[-6:]).tolist() == [4]
    assert (found.back[-6:] == HOLLOW).all()


def test_walls_that_look_outward_are_found_by_their_backs():
    polygons, _room = two_rooms()
    turned = [p[::-1] for p in polygons[:5]] + polygons[5:]
    found = find(turned, [PORTAL])
    assert len(found) == 2
    assert found.back[:5].tolist() == [0] * 5
    assert (found.front[:5] != 0).all()


def test_a_hole_to_the_outside_is_a_gap_in_a_room():
    hole = (1.0, 1.6, 1.0, 1.6)
    polygons = box((0, 0, 0), (4, 4, 3), leave_out="x+") + holed(4.0, hole, -1)
    found = find(polygons)
    assert len(found) == 1
    assert (found.front == 0).all()
    (gap,) = found.gaps
    assert gap.room == 0
    assert np.abs(gap.place - [4.0, 1.3, 1.3]).max() < 0.25
    assert 0.3 < gap.width < 0.9
    assert (gap.inside > 0).all()
    assert gap.inside[0] < 4.2
    assert find(polygons, [rectangle((4.0, 1.0, 1.0), (0, 0.6, 0), (0, 0, 0.6))]).gaps == ()


def test_two_holes_are_two_gaps():
    polygons = box((0, 0, 0), (4, 4, 3), leave_out="x+ x-") + holed(4.0, (1.0, 1.6, 1.0, 1.6), -1) + holed(0.0, (2.0, 2.5, 0.5, 1.5), 1)
    found = find(polygons)
    assert sorted(round(float(gap.place[0])) for gap in found.gaps) == [0, 4]


def test_a_doll_house_gets_a_lid():
    polygons, _room = two_rooms()
    open_ = [p for p in polygons if not (p[:, 2] == 3).all()]
    found = find(open_, [PORTAL])
    assert len(found) == 2
    assert found.lid


def test_nothing_is_closed_where_a_wall_is_missing():
    found = find(box((0, 0, 0), (4, 4, 3), leave_out="x+ y+"))
    assert len(found) == 0
    assert (found.front < 0).all()
    assert found.spread.shape == (4, 0)


def test_one_floor_under_two_rooms_is_shared():
    polygons, _ = two_rooms()
    floors = [k for k, p in enumerate(polygons) if (p[:, 2] == 0).all() and len(p) == 4 and abs(np.ptp(p[:, 1]) - 4) < 1e-9]
    assert len(floors) == 2
    rest = [p for k, p in enumerate(polygons) if k not in floors]
    found = find([*rest, rectangle((0, 0, 0), (7.2, 0, 0), (0, 4, 0))], [PORTAL])
    assert found.spread[-1] == pytest.approx([16, 12], rel=0.2)
    assert found.front[-1] == 0


def test_rooms_of_objects():
    spread = np.array([[3.0, 0.2, 0], [100, 1, 0.1], [0.02, 0.02, 0], [0, 0, 0], [0.1, 0.01, 0.04]])
    assert rooms_of_objects(spread).astype(int).tolist() == [[1, 0, 0], [1, 1, 0], [1, 1, 0], [0, 0, 0], [1, 0, 1]]
    assert rooms_of_objects(np.zeros((2, 0))).shape == (2, 0)


def test_the_room_near_a_place():
    found = find(two_rooms()[0], [PORTAL])
    places = np.array([[2, 2, 1.5], [3.9, 0.02, 0.02], [7.3, 2, 1], [-3, 0, 0]])
    assert found.near(places).tolist() == [0, 0, 1, OUTSIDE]


def test_a_model_of_a_house_is_as_good_as_a_house():
    polygons, room = two_rooms()
    found = find([0.02 * p for p in polygons], [0.02 * PORTAL])
    assert len(found) == 2
    assert found.front[: len(room)].tolist() == room


def test_a_huge_building_takes_coarser_cells():
    polygons, room = two_rooms()
    found = find(polygons, [PORTAL], most_cells=20_000)
    assert found.cell > 0.15
    assert found.front[: len(room)].tolist() == room


def test_rooms_of_a_real_building():
    """Nothing but polygons and portals is given; the rooms are those of the author of the scene."""
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    outline = [scene.vertices[scene.corner_vertex[a:b]] for a, b in zip(scene.loop_start[:-1], scene.loop_start[1:], strict=True)]
    found = find(outline, [scene.portals.polygon(k) for k in range(len(scene.portals))])
    assert len(found) == scene.room_count
    votes = np.zeros((scene.room_count, len(found)))
    np.add.at(votes, scene.room, found.spread)
    match = votes.argmax(axis=1)
    assert sorted(match) == list(range(len(found)))
    # All that looks into a room looks into that room, but for half a cell along the 60 m of edges of its openings: 0.4 % of 670 m2.
    assert votes[np.arange(len(match)), match].sum() > 0.996 * votes.sum()
    assert found.portal_rooms.tolist() == [[-1 if r < 0 else match[r] for r in pair] for pair in scene.portals.rooms]
