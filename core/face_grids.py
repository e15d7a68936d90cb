"""Polygons cut into grids, where one emission would not do them justice: a screen, a panel that is bright in its middle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .grouping import ragged

SQUARE = 1e-3
"""A polygon is a parallelogram when its fourth corner lies this near to where it should, relative to its diagonal."""


@dataclass(frozen=True)
class FaceGrids:
    """K parallelograms of a scene in n x n cells: cell (0, 0), at the first corner, has the number that the polygon had.

    polygon : (K,) int64, ascending;  first : (K,) int64, number of cell (0, 1) and then (0, 2) .. (n - 1, n - 1);  cells : (K,) n
    origin : (K, 3) the first corner, metres;  across : (K, 2, 3) what gives the part of the way along either side
    """

    polygon: np.ndarray
    first: np.ndarray
    cells: np.ndarray
    origin: np.ndarray
    across: np.ndarray

    def at(self, polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(N,) the polygons that points (N, 3) lie in, whose polygons before they were cut are ``polygon`` (N,)."""
        out = np.array(polygon, np.int64)
        place = np.minimum(np.searchsorted(self.polygon, out), len(self.polygon) - 1)
        cut = np.flatnonzero(self.polygon[place] == out)
        grid = place[cut]
        way = np.einsum("nij,nj->ni", self.across[grid], np.asarray(points, np.float64)[cut] - self.origin[grid])
        n = self.cells[grid]
        cell = np.clip(np.floor(way * n[:, None]).astype(np.int64), 0, n[:, None] - 1)
        number = cell[:, 0] * n + cell[:, 1]
        out[cut] = np.where(number > 0, self.first[grid] + number - 1, out[cut])
        return out


def parallelograms(corners: np.ndarray) -> np.ndarray:
    """(n,) bool: which of the quads (n, 4, 3) are such."""
    off = corners[:, 0] + corners[:, 2] - corners[:, 1] - corners[:, 3]
    diagonal = np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1)
    return np.linalg.norm(off, axis=1) <= SQUARE * diagonal


def cut(corners: np.ndarray, polygon: np.ndarray, cells: np.ndarray, count: int) -> tuple[FaceGrids, np.ndarray, np.ndarray]:
    """Cut quads ``polygon`` (K,) ascending, of ``count`` polygons, with corners (K, 4, 3) into ``cells`` (K,) x ``cells`` cells.

    Returns the grids, (m, 4, 3) the corners of all cells, grid after grid, row after row along the side to the second corner, and
    (m,) their numbers.
    """
    side = np.stack([corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]], axis=1)
    across = np.linalg.pinv(side.transpose(0, 2, 1))
    more = cells**2 - 1
    first = count + np.cumsum(more) - more
    cell, grid = ragged(np.zeros(len(cells), np.int64), cells**2)
    n = cells[grid]
    low = np.stack([cell // n, cell % n], axis=1)
    out = np.empty((len(cell), 4, 3))
    for k, step in enumerate(([0, 0], [1, 0], [1, 1], [0, 1])):
        s, t = ((low + step) / n[:, None]).T[:, :, None]
        a, b, c, d = (corners[grid, j] for j in range(4))
        out[:, k] = (1 - s) * ((1 - t) * a + t * d) + s * ((1 - t) * b + t * c)
    number = np.where(cell > 0, first[grid] + cell - 1, polygon[grid])
    return FaceGrids(polygon, first, cells, corners[:, 0], across), out, number
