"""Corner values against what can be said of simple meshes by hand."""

import math

import numpy as np
import pytest
from enfilade.core.corners import average_groups, corner_angles, face_area_vectors, linked_corners

CUBE = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE_POSITION = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)


def faces(*corners):
    """Corner vertices and face starts of faces given as lists of vertices."""
    return np.concatenate([np.asarray(c) for c in corners]), np.cumsum([0] + [len(c) for c in corners])


def grid(n, bend=0.0):
    """n by n quads; with a bend the right half is folded up by that angle about the middle line."""
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    right = np.maximum(x, 0)
    position = np.stack([np.minimum(x, 0) + right * math.cos(bend), y, right * math.sin(bend)], -1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    v = lambda a, b: a * (n + 1) + b  # noqa: E731
    quads = np.stack([v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)], 1)
    return position, quads.ravel(), np.arange(0, 4 * n * n + 1, 4)


def test_a_flat_grid_has_one_group_for_each_vertex():
    position, vertex, start = grid(6)
    group = linked_corners(position, vertex, start)
    assert group.max() + 1 == len(position)
    for corners in (np.flatnonzero(group == g) for g in range(group.max() + 1)):
        assert len(np.unique(vertex[corners])) == 1


def test_a_cube_splits_at_every_edge():
    vertex, start = faces(*CUBE)
    assert len(np.unique(linked_corners(CUBE_POSITION, vertex, start))) == 24


@pytest.mark.parametrize(("degrees", "split"), [(30, False), (39, False), (41, True), (90, True)])
def test_a_fold_splits_only_its_own_line(degrees, split):
    position, vertex, start = grid(4, math.radians(degrees))
    groups = linked_corners(position, vertex, start).max() + 1
    assert groups == len(position) + (5 if split else 0)


def test_a_marked_edge_that_ends_inside_a_surface_splits_nothing_at_its_end():
    position, vertex, start = grid(2)
    middle = 4  # the mark runs from the rim to the middle vertex, around which one can still walk
    marked = np.zeros(len(vertex), bool)
    following = np.arange(len(vertex)).reshape(-1, 4)[:, [1, 2, 3, 0]].ravel()
    edge = ((vertex == middle) & (vertex[following] == 1)) | ((vertex == 1) & (vertex[following] == middle))
    marked[edge] = True
    group = linked_corners(position, vertex, start, marked)
    assert len(np.unique(group[vertex == middle])) == 1
    assert len(np.unique(group[vertex == 1])) == 2


def test_faces_that_turn_opposite_ways_and_fins_are_not_joined():
    position = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, -1, 0], [0.5, -1, 0.1]], float)
    vertex, start = faces([0, 1, 2, 3], [0, 1, 4])  # the edge 0-1 runs the same way in both
    assert len(np.unique(linked_corners(position, vertex, start))) == 7
    vertex, start = faces([0, 1, 2, 3], [1, 0, 4], [1, 0, 5])  # three faces at one edge
    assert len(np.unique(linked_corners(position, vertex, start))) == 10


def test_averages_are_weighted_by_angle():
    position, vertex, start = grid(2)
    group = linked_corners(position, vertex, start)
    weight = corner_angles(position, vertex, start)
    assert weight == pytest.approx(math.pi / 2)
    rng = np.random.default_rng(0)
    value = rng.random((16, 3))
    mean = average_groups(value, group, weight)
    assert mean[vertex == 4] == pytest.approx(np.repeat(value[vertex == 4].mean(0)[None], 4, 0))
    lone = vertex == 0
    assert np.array_equal(mean[lone], value[lone])
    heavy = average_groups(value, np.zeros(16, int), np.eye(16)[3])
    assert heavy == pytest.approx(np.repeat(value[3][None], 16, 0))
    assert average_groups(value, np.zeros(16, int), np.zeros(16))[0] == pytest.approx(value.mean(0))


def test_angles_of_polygons_sum_up():
    rng = np.random.default_rng(1)
    for n in (3, 4, 5, 9):
        turn = np.sort(rng.random(n)) * 2 * math.pi
        position = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
        vertex, start = faces(range(n))
        assert corner_angles(position, vertex, start).sum() == pytest.approx((n - 2) * math.pi)


def test_area_vectors_far_from_the_origin():
    vertex, start = faces(*CUBE)
    area = face_area_vectors(CUBE_POSITION * 1e-3 + 1e5, vertex, start)
    assert np.abs(area.sum(0)) == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(area, axis=1) == pytest.approx(1e-6, rel=1e-6)


def test_nothing():
    empty = np.zeros(0, int)
    assert linked_corners(np.zeros((0, 3)), empty, np.zeros(1, int)).shape == (0,)
    assert average_groups(np.zeros((0, 3)), empty, empty).shape == (0, 3)
