"""A grid of cubic cells around a building: which of them surfaces pass through, and how the free ones hang together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .grouping import components, ragged

SPACING = 0.44
"""Distance of the samples of a surface, in cells: no path from cell to neighbouring cell slips between them, see :func:`sample`."""


@dataclass(frozen=True)
class Grid:
    """Cell (i, j, k) reaches from ``low + size (i, j, k)`` to ``low + size (i + 1, j + 1, k + 1)``.

    low : (3,) float64, metres;  size : metres;  shape : number of cells along x, y and z
    """

    low: np.ndarray
    size: float
    shape: tuple[int, int, int]

    def cell(self, point: np.ndarray) -> np.ndarray:
        """(n,) int64 flat index of the cell around each point (n, 3); points beyond the grid get the cell nearest to them."""
        place = np.clip(np.floor((point - self.low) / self.size).astype(np.int64), 0, np.array(self.shape) - 1)
        return (place[:, 0] * self.shape[1] + place[:, 1]) * self.shape[2] + place[:, 2]

    def middle(self, cell: np.ndarray) -> np.ndarray:
        """(n, 3) metres: the middles of cells (n,)."""
        return self.low + self.size * (np.stack(np.unravel_index(cell, self.shape), axis=-1) + 0.5)

    def neighbours(self, cell: np.ndarray) -> np.ndarray:
        """(6, n) flat indices of the six cells around each of ``cell`` (n,), none of which may lie at the rim of the grid."""
        steps = np.array([self.shape[1] * self.shape[2], self.shape[2], 1])
        return cell + np.concatenate([steps, -steps])[:, None]


def grid_around(low: np.ndarray, high: np.ndarray, size: float, most: int, margin: float) -> Grid:
    """A grid with ``margin`` metres and two cells of air on all sides of a box.

    Cells are of ``size`` metres, or larger where the box would take more than ``most`` of them.
    """
    size = max(size, float(np.prod(np.maximum(high - low, size)) / most) ** (1 / 3))
    air = np.ceil(margin / size) + 2.5
    shape = np.ceil((high - low) / size + 2 * air).astype(int)
    return Grid(low - air * size, size, tuple(int(n) for n in shape))


def sample(corners: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) on triangles (T, 3, 3) and the triangle (n,) of each: none of a triangle is farther than 1.12 ``spacing`` from one.

    Rows run parallel to the longest edge, at whose ends the angles are acute, so that from any place of the triangle the way
    straight down to the next row stays inside. With ``SPACING`` of a cell that is less than half a cell: where a surface crosses
    the line between the middles of two neighbouring cells, one of them holds a sample.
    """
    edge = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = edge.argmax(axis=1)
    rows = np.arange(len(corners))
    a, b, c = (corners[rows, (longest + k) % 3] for k in range(3))
    length = edge[rows, longest]
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(length, 1e-300)
    levels = np.ceil(height / spacing).astype(np.int64) + 1
    level, triangle = ragged(np.zeros(len(corners), np.int64), levels)
    up = level / np.maximum(levels[triangle] - 1, 1)
    pieces = np.ceil(length[triangle] * (1 - up) / spacing).astype(np.int64) + 1
    place, row = ragged(np.zeros(len(level), np.int64), pieces)
    along = (place / np.maximum(pieces[row] - 1, 1))[:, None]
    up, triangle = up[row][:, None], triangle[row]
    start, end = a[triangle] + up * (c - a)[triangle], b[triangle] + up * (c - b)[triangle]
    return start + along * (end - start), triangle


def occupied(grid: Grid, corners: np.ndarray, block: int = 1 << 16) -> np.ndarray:
    """(X, Y, Z) bool: cells that triangles (T, 3, 3) pass through, and so that no path from cell to neighbouring cell crosses one."""
    out = np.zeros(int(np.prod(grid.shape)), bool)
    for start in range(0, len(corners), block):
        points, _ = sample(corners[start : start + block], SPACING * grid.size)
        out[grid.cell(points)] = True
    return out.reshape(grid.shape)


def parts(free: np.ndarray) -> tuple[np.ndarray, int]:
    """The connected parts of the cells ``free`` (X, Y, Z): (X, Y, Z) int32 number of each cell, -1 where not free, and their count.

    Cells are neighbours by their faces. The graph is one of runs along z, which are far fewer than cells.
    """
    begins = free.copy()
    begins[:, :, 1:] &= ~free[:, :, :-1]
    run = np.cumsum(begins.reshape(-1), dtype=np.int32).reshape(free.shape) - np.int32(1)
    count = int(run[-1, -1, -1]) + 1 if free.size else 0
    pairs = []
    for axis in (0, 1):
        ahead, behind = (np.moveaxis(x, axis, 0) for x in (free, run))
        both = ahead[1:] & ahead[:-1]
        first = both.copy()
        # Two runs that lie side by side over several cells meet for the first time in one of them.
        first[:, :, 1:] &= ~both[:, :, :-1]
        pairs.append((behind[1:][first], behind[:-1][first]))
    a, b = (np.concatenate(side).astype(np.int64) for side in zip(*pairs, strict=True))
    label = components(count, a, b).astype(np.int32)
    return np.where(free, label[run] if count else np.int32(-1), np.int32(-1)), int(label.max(initial=-1)) + 1


def eroded(free: np.ndarray) -> np.ndarray:
    """(X, Y, Z) bool: cells that are free together with the 26 around them."""
    out = free
    for axis in range(3):
        along = np.moveaxis(out, axis, 0)
        kept = along.copy()
        kept[1:] &= along[:-1]
        kept[:-1] &= along[1:]
        out = np.moveaxis(kept, 0, axis)
    return out


def grown(grid: Grid, label: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Labels (N,) of some free cells of the flat grid, spread at equal pace over the free cells (N,) bool that hang together with them.

    -1 stands for no label. Where two labels arrive at once the higher one stays. No cell at the rim of the grid may be free.
    """
    out = label.copy()
    front = np.flatnonzero(out >= 0)
    while len(front):
        cell = grid.neighbours(front)
        value = np.broadcast_to(out[front], cell.shape)
        fresh = free[cell] & (out[cell] < 0)
        cell, value = cell[fresh], value[fresh]
        np.maximum.at(out, cell, value)
        front = np.unique(cell)
    return out
