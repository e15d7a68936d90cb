"""The grid of cells: what surfaces close, what hangs together."""

import numpy as np
import pytest
from enfilade.core.voxels import SPACING, Grid, eroded, grid_around, grown, occupied, parts, sample
from scenery import rotation


def flood(free):
    """Labels by the textbook's queue, cell after cell."""
    label, count = np.full(free.shape, -1), 0
    for start in zip(*np.nonzero(free), strict=True):
        if label[start] >= 0:
            continue
        queue, label[start] = [start], count
        while queue:
            at = queue.pop()
            for axis in range(3):
                for step in (-1, 1):
                    to = list(at)
                    to[axis] += step
                    to = tuple(to)
                    if 0 <= to[axis] < free.shape[axis] and free[to] and label[to] < 0:
                        label[to] = count
                        queue.append(to)
        count += 1
    return label, count


@pytest.mark.parametrize("density", [0.2, 0.35, 0.6])
def test_parts_are_those_of_a_flood_fill(density):
    free = np.random.default_rng(3).random((11, 9, 13)) < density
    label, count = parts(free)
    expected, number = flood(free)
    assert count == number
    assert (label == expected).all()  # both number them by their first cell


def test_parts_of_nothing():
    label, count = parts(np.zeros((2, 3, 4), bool))
    assert count == 0
    assert (label == -1).all()


def test_every_place_of_a_triangle_has_a_sample_near():
    rng = np.random.default_rng(5)
    corners = rng.normal(size=(40, 3, 3)) * rng.choice([0.01, 0.3, 3.0], (40, 1, 1))
    corners[:10, 2] = corners[:10, 0] + 0.3 * (corners[:10, 1] - corners[:10, 0]) + 0.01 * rng.normal(size=(10, 3))  # slivers
    points, triangle = sample(corners, 0.1)
    weight = rng.dirichlet([0.5, 0.5, 0.5], (40, 200))
    places = np.einsum("tnk,tkc->tnc", weight, corners)
    for k in range(40):
        own = points[triangle == k]
        far = np.linalg.norm(places[k][:, None] - own, axis=2).min(axis=1)
        assert far.max() <= 0.112
        # and none of them is off the triangle
        normal = np.cross(corners[k, 1] - corners[k, 0], corners[k, 2] - corners[k, 0])
        assert np.abs((own - corners[k, 0]) @ normal / np.linalg.norm(normal)).max() < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_nothing_slips_through_a_sheet(seed):
    """A square across the whole grid, at any angle, parts the cells in two: none on one side hangs together with one on the other."""
    turn = rotation(seed)
    grid = Grid(np.array([-1.0, -1.0, -1.0]), 0.1, (20, 20, 20))
    square = np.array([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0.0]]) @ turn.T + 0.013
    triangles = square[[[0, 1, 2], [0, 2, 3]]]
    inside = np.abs(sample(triangles, SPACING * grid.size)[0]).max(axis=1) < 1.2
    assert inside.any()
    # What lies beyond the grid is put into its outermost cells, so look at the inner ones only.
    closed = occupied(grid, triangles)
    free = np.zeros(grid.shape, bool)
    free[2:-2, 2:-2, 2:-2] = ~closed[2:-2, 2:-2, 2:-2]
    label, _ = parts(free)
    cell = np.flatnonzero(free.reshape(-1))
    side = (grid.middle(cell) - 0.013) @ turn[:, 2] > 0
    above, below = np.unique(label.reshape(-1)[cell[side]]), np.unique(label.reshape(-1)[cell[~side]])
    assert len(np.intersect1d(above, below)) == 0


def test_cells_and_their_middles():
    grid = grid_around(np.array([1.0, 2, 3]), np.array([2.0, 4, 3.5]), 0.1, 10**6, 0.3)
    cell = np.arange(int(np.prod(grid.shape)))
    assert (grid.cell(grid.middle(cell)) == cell).all()
    assert (grid.low <= [0.5, 1.5, 2.5]).all()
    assert (grid.low + grid.size * np.array(grid.shape) >= [2.5, 4.5, 4.0]).all()
    coarse = grid_around(np.zeros(3), np.full(3, 100.0), 0.1, 10**4, 0.3)
    assert coarse.size == pytest.approx(100 / 10 ** (4 / 3))


def test_erosion_and_growth_bring_back_a_block():
    free = np.zeros((9, 9, 9), bool)
    free[2:7, 2:7, 2:7] = True
    core = eroded(eroded(free))
    assert core.sum() == 1
    assert core[4, 4, 4]
    grid = Grid(np.zeros(3), 1.0, free.shape)
    label = np.where(core.reshape(-1), 5, -1)
    assert (grown(grid, label, free.reshape(-1)) == np.where(free.reshape(-1), 5, -1)).all()


def test_growth_meets_half_way():
    free = np.zeros((12, 3, 3), bool)
    free[1:11, 1, 1] = True
    label = np.full(free.size, -1)
    grid = Grid(np.zeros(3), 1.0, free.shape)
    start, end = (int(np.ravel_multi_index((k, 1, 1), free.shape)) for k in (1, 10))
    label[start], label[end] = 0, 1
    out = grown(grid, label, free.reshape(-1)).reshape(free.shape)[:, 1, 1]
    assert out.tolist() == [-1, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, -1]
