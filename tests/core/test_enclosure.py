"""The room around a point, in buildings simple enough to know it."""

import numpy as np
import pytest
from enfilade.core.enclosure import UNDECIDED, Walls, _first_hits, directions, enclosing_room
from enfilade.core.scene import OUTSIDE

QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def box(low, high, inward=True, leave_out=()):
    """Triangles of a box; face order: x-, x+, y-, y+, z-, z+."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    position = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    quads = np.delete(QUADS, list(leave_out), axis=0)
    quads = quads[:, ::-1] if inward else quads
    return position[np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])]


def ask(points, normals, parts, room_boxes, **more):
    walls = Walls(np.concatenate([p for p, _ in parts]), np.concatenate([np.full(len(p), r) for p, r in parts]))
    low, high = (np.array(x, float) for x in zip(*room_boxes, strict=True))
    return enclosing_room(np.array(points, float), np.array(normals, float), low, high, walls, **more).tolist()


def test_directions_are_unit_and_even():
    d = directions(48)
    assert np.linalg.norm(d, axis=1) == pytest.approx(1)
    assert d[:, 2].min() > 0
    assert d.mean(0) == pytest.approx([0, 0, 0.5], abs=0.02)


def test_first_hits_are_those_of_a_box():
    rng = np.random.default_rng(0)
    low, high = np.array([100.0, -3, 2]), np.array([104.0, -1, 3])
    corners = box(low, high)
    origin = rng.uniform(low, high, (2000, 3))
    ray = rng.normal(size=(2000, 3))
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    wall = np.where(ray > 0, high, low)
    axis = ((wall - origin) / ray).argmin(1)
    expected = axis * 2 + (ray[np.arange(2000), axis] > 0)
    hit, front = _first_hits(origin, ray, corners)
    assert front.all()
    assert np.array_equal(hit % 6, expected)
    assert not _first_hits(origin, ray, box(low, high, inward=False))[1].any()
    assert (_first_hits(origin + np.array([0, 0, 50]), ray * [1, 1, 0] + [0, 0, 1], corners)[0] == -1).all()


TWO = [((0, 0, 0), (4, 3, 2.5)), ((4.2, 0, 0), (8, 3, 2.5))]


def two_rooms(**kind):
    """Two boxes side by side without the walls between them, and the portal that stands there."""
    portal = np.array([[[4.1, 0, 0], [4.1, 3, 0], [4.1, 3, 2.5]], [[4.1, 0, 0], [4.1, 3, 2.5], [4.1, 0, 2.5]]], float)
    return [(box(*TWO[0], leave_out=[1], **kind), 0), (box(*TWO[1], leave_out=[0], **kind), 1), (portal, UNDECIDED)]


@pytest.mark.parametrize("inward", [True, False])
def test_a_portal_between_two_rooms(inward):
    points, normals = [(4.099, 1.5, 1.2), (4.101, 1.5, 1.2)], [(-1, 0, 0), (1, 0, 0)]
    # Boxes grown by the wall, as the bounds of rooms with door reveals are.
    boxes = [((0, 0, 0), (4.1, 3, 2.5)), ((4.1, 0, 0), (8, 3, 2.5))]
    assert ask(points, normals, two_rooms(inward=inward), boxes) == [0, 1]


def test_a_window_leads_outside():
    parts = [(box(*TWO[0], leave_out=[0]), 0)]
    assert ask([(-0.001, 1, 1), (0.001, 1, 1)], [(-1, 0, 0), (1, 0, 0)], parts, [TWO[0]]) == [OUTSIDE, 0]


def test_a_room_without_a_ceiling_is_still_a_room():
    parts = [(box(*TWO[0], leave_out=[0, 5]), 0)]
    assert ask([(0.001, 1, 1)], [(1, 0, 0)], parts, [TWO[0]]) == [0]


def test_the_bay_of_an_l_shaped_room_is_not_in_it():
    # Room 0 is an L around room 1, whose box lies wholly in the box of room 0.
    l_shape = [box((0, 0, 0), (6, 2, 3), leave_out=[3]), box((0, 2, 0), (2, 6, 3), leave_out=[2])]
    inner_wall = box((2, 2, 0), (6, 6, 3), leave_out=[1, 3, 4, 5], inward=False)
    parts = [(np.concatenate([*l_shape, inner_wall]), 0), (box((2.2, 2.2, 0), (6, 6, 3)), 1)]
    boxes = [((0, 0, 0), (6, 6, 3)), ((2.2, 2.2, 0), (6, 6, 3))]
    points = [(1, 1, 1), (4, 4, 1), (1, 5, 1), (5, 1, 1)]
    for normal in np.vstack([np.eye(3), -np.eye(3)]):
        assert ask(points, [normal] * 4, parts, boxes) == [0, 1, 0, 0]


def test_solid_walls_that_both_rooms_share():
    # One solid wall stands between the rooms and belongs to none: its faces are to be told apart.
    wall = box((4, 0, 0), (4.2, 3, 2.5), inward=False)
    parts = [*two_rooms()[:2], (wall, UNDECIDED)]
    boxes = [((0, 0, 0), (4.2, 3, 2.5)), ((4, 0, 0), (8, 3, 2.5))]
    points, normals = [(3.999, 1, 1), (4.201, 1, 1), (4.1, 1, 2.501)], [(-1, 0, 0), (1, 0, 0), (0, 0, 1)]
    assert ask(points, normals, parts, boxes) == [0, 1, OUTSIDE]


def test_only_allowed_rooms_are_asked():
    boxes = [((0, 0, 0), (4.1, 3, 2.5)), ((0, 0, 0), (8, 3, 2.5))]
    point, normal = [(2, 1, 1)], [(0, 0, 1)]
    assert ask(point, normal, two_rooms(), boxes) == [0]
    assert ask(point, normal, two_rooms(), boxes, allowed=np.array([[False, True]])) == [OUTSIDE]


def test_no_points_and_no_walls():
    nothing = Walls(np.zeros((0, 3, 3)), np.zeros(0, int))
    low = np.zeros((1, 3))
    assert enclosing_room(np.zeros((0, 3)), np.zeros((0, 3)), low, low + 1, nothing).shape == (0,)
    assert enclosing_room(np.full((1, 3), 0.5), np.array([[0, 0, 1.0]]), low, low + 1, nothing).tolist() == [OUTSIDE]
