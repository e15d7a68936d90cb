"""Polygons cut into grids."""

import numpy as np
import pytest
from enfilade.core.corners import face_area_vectors
from enfilade.core.face_grids import cut, parallelograms

QUADS = np.array(
    [
        [[0, 0, 2], [0, 3, 2], [2, 3, 2], [2, 0, 2]],
        [[1, 1, 0], [2, 1, 1], [2, 2, 1], [1, 2, 0]],
        [[0, 0, 0], [1, 0, 0], [2, 1, 0], [0, 1, 0]],
    ],
    float,
)


def test_what_is_a_parallelogram():
    assert parallelograms(QUADS).tolist() == [True, True, False]


def test_cells_cover_their_polygon_and_are_found_by_place():
    polygon, n = np.array([4, 7]), np.array([2, 8])
    grids, corners, number = cut(QUADS[:2], polygon, n, 10)
    assert sorted(number.tolist()) == [4, 7, *range(10, 10 + 3 + 63)]
    vertices = corners.reshape(-1, 3)
    vectors = face_area_vectors(vertices, np.arange(len(vertices)), 4 * np.arange(len(corners) + 1))
    whole = face_area_vectors(QUADS[:2].reshape(-1, 3), np.arange(8), np.array([0, 4, 8]))
    for k, cells in enumerate((slice(0, 4), slice(4, None))):
        assert vectors[cells] == pytest.approx(np.tile(whole[k] / n[k] ** 2, (n[k] ** 2, 1)))
        middle = corners[cells].mean(axis=1)
        assert grids.at(np.full(len(middle), polygon[k]), middle).tolist() == number[cells].tolist()
        # Every corner of a cell belongs to it or to one that it touches; those of the polygon to the cells in its corners.
        assert grids.at(np.full(4, polygon[k]), QUADS[k]).tolist() == number[cells][[0, n[k] * (n[k] - 1), -1, n[k] - 1]].tolist()


def test_other_polygons_stay():
    grids, _, _ = cut(QUADS[:1], np.array([4]), np.array([2]), 10)
    assert grids.at(np.array([-1, 0, 5, 9]), np.zeros((4, 3))).tolist() == [-1, 0, 5, 9]
