"""Means of a picture over parts of it, from sums over rectangles (Crow, "Summed-area tables for texture mapping", 1984).

Picture coordinates are Blender's: 0..1 from the left and from the bottom. Beyond that a picture goes on by its ``extension``:
``"REPEAT"``, ``"MIRROR"``, ``"EXTEND"`` (its border) or ``"CLIP"`` (nothing).
"""

from __future__ import annotations

import numpy as np

FINEST = 512
"""Most columns and rows of a table: of larger pictures neighbouring pixels are added up."""

SMOOTHEST = 512
"""Pictures of fewer columns or rows are drawn larger before they are summed, as what is seen of them lies between their pixels."""

THINNEST = 1e-4
"""Width of the strip that is looked at where a part has no area."""

_BANDS = (1, 2, 4, 8, 16)

_BLOCK = 1 << 13


class PictureSums:
    """The table of a picture.

    pixels : (H, W, c) linear values, row 0 at the bottom;  extension : see above
    smooth : what is seen between the pixels is interpolated, else every pixel is a square
    """

    def __init__(self, pixels: np.ndarray, extension: str, smooth: bool):
        values = np.asarray(pixels)
        if extension == "MIRROR":
            values = np.concatenate([values, values[:, ::-1]], axis=1)
            values = np.concatenate([values, values[::-1]], axis=0)
        self._period = 2.0 if extension == "MIRROR" else 1.0
        self._extension = "REPEAT" if extension == "MIRROR" else extension
        steps = []
        for axis in (0, 1):
            values, step = self._resampled(values, axis, smooth)
            steps.append(step)
        self._rows, self._columns = steps
        area = np.diff(self._rows)[:, None] * np.diff(self._columns)
        table = np.zeros((values.shape[0] + 1, values.shape[1] + 1, values.shape[2]))
        table[1:, 1:] = (values * area[:, :, None]).cumsum(0).cumsum(1)
        self._table = table

    @property
    def mean(self) -> np.ndarray:
        """(c,) float64 of the whole picture."""
        return self._table[-1, -1] / self._period**2

    @property
    def finest(self) -> float:
        """Height of a row of the table, about, in picture coordinates."""
        return self._period / (len(self._rows) - 1)

    def _resampled(self, values: np.ndarray, axis: int, smooth: bool) -> tuple[np.ndarray, np.ndarray]:
        """The picture in finer or coarser columns or rows, and where (n + 1,) these begin and end."""
        count = values.shape[axis]
        if count > FINEST:
            # The border stays as it is, as it may go on for ever.
            first = np.concatenate([[0], np.arange(1, count - 1, -(-count // FINEST)), [count - 1]])
            sizes = np.diff(first, append=count)
            shape = [1, 1, 1]
            shape[axis] = -1
            values = np.add.reduceat(values, first, axis=axis, dtype=np.float64) / sizes.reshape(shape)
            return values, np.append(first, count) * (self._period / count)
        if not smooth or count >= SMOOTHEST:
            return values.astype(np.float64), np.arange(count + 1) * (self._period / count)
        # An even number of parts of a pixel: the straight lines between pixel centres then bend at borders of parts alone.
        parts = 2 * -(-SMOOTHEST // (2 * count))
        at = (np.arange(parts * count) + 0.5) / parts - 0.5
        left = np.floor(at).astype(np.int64)
        shape = [1, 1, 1]
        shape[axis] = -1
        share = (at - left).reshape(shape)
        if self._extension == "REPEAT":
            before, after = left % count, (left + 1) % count
        else:
            before, after = np.clip(left, 0, count - 1), np.clip(left + 1, 0, count - 1)
        values = values.astype(np.float64)
        values = (1.0 - share) * values.take(before, axis) + share * values.take(after, axis)
        return values, np.arange(parts * count + 1) * (self._period / (parts * count))

    def _along(self, x: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cells (n,) that hold coordinates (n,), how far into them they lie as a part of one, and whole pictures before them."""
        turns = np.zeros(len(x))
        if self._extension == "REPEAT":
            turns = np.floor(x / self._period)
            x = x - turns * self._period
        elif self._extension == "CLIP":
            x = np.clip(x, 0.0, self._period)
        cell = np.clip(np.searchsorted(step, x, side="right") - 1, 0, len(step) - 2)
        # Outside of the picture the first and the last cell go on for ever.
        return cell, (x - step[cell]) / (step[cell + 1] - step[cell]), turns

    def up_to(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(n, c) sums over the rectangles between the origin and (x, y) (n,), negative where one of them is."""
        table = self._table
        column, fx, over = self._along(x, self._columns)
        row, fy, above = self._along(y, self._rows)
        fx, over, fy, above = (a[:, None] for a in (fx, over, fy, above))
        last = table.shape[0] - 1
        out = (1 - fy) * self._in_row(row, column, fx, over) + fy * self._in_row(row + 1, column, fx, over)
        return out + above * self._in_row(np.full_like(row, last), column, fx, over) if above.any() else out

    def _in_row(self, row, column, fx, over) -> np.ndarray:
        table = self._table
        out = (1 - fx) * table[row, column] + fx * table[row, column + 1]
        return out + over * table[row, -1] if over.any() else out

    def over(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """(n, c) sums over rectangles from ``low`` to ``high`` (n, 2), values times area in picture coordinates."""
        return (
            self.up_to(high[:, 0], high[:, 1])
            - self.up_to(low[:, 0], high[:, 1])
            - self.up_to(high[:, 0], low[:, 1])
            + self.up_to(low[:, 0], low[:, 1])
        )

    def means(self, triangles: np.ndarray) -> np.ndarray:
        """(T, c) float64 means over triangles (T, 3, 2) of picture coordinates.

        A triangle is taken as bands along its rows, each as wide as the triangle is in its middle: the two halves of an upright
        rectangle together are exact. One of no area is the strip of ``THINNEST`` around it.
        """
        at = np.asarray(triangles, np.float64)
        if self._extension == "REPEAT":  # near the origin: the differences of large sums would be lost in rounding
            at = at - self._period * np.floor(at.min(axis=1, keepdims=True) / self._period)
        at = np.take_along_axis(at, at[:, :, 1].argsort(axis=1, kind="stable")[:, :, None], axis=1)
        extent = at.max(1) - at.min(1)
        wanted = np.ceil(np.minimum(extent[:, 1] / (2 * self.finest), _BANDS[-1]))
        level = np.searchsorted(_BANDS, wanted)
        out = np.empty((len(at), self._table.shape[2]))
        for k, bands in enumerate(_BANDS):
            members = np.flatnonzero(level == k)
            for begin in range(0, len(members), _BLOCK // bands):
                block = members[begin : begin + _BLOCK // bands]
                out[block] = self._banded(at[block], bands)
        return out

    def _banded(self, at: np.ndarray, bands: int) -> np.ndarray:
        """(n, c) means over triangles (n, 3, 2) whose corners go upward, in ``bands`` below and above the middle one."""
        flat = at[:, 2, 1] - at[:, 0, 1] < THINNEST
        total, area = 0.0, 0.0
        share = np.arange(bands + 1) / bands
        for k in (0, 1):  # below and above the middle corner
            y = at[:, k, 1, None] + (at[:, k + 1, 1] - at[:, k, 1])[:, None] * share
            middle = 0.5 * (y[:, 1:] + y[:, :-1])
            ends = []
            for a, b in ((0, 2), (k, k + 1)):
                height = at[:, b, 1] - at[:, a, 1]
                part = (middle - at[:, a, 1, None]) / np.where(height > 0, height, 1.0)[:, None]
                ends.append(at[:, a, 0, None] + part * (at[:, b, 0] - at[:, a, 0])[:, None])
            low, high = np.minimum(*ends), np.maximum(*ends)
            thin = np.maximum(THINNEST - (high - low), 0.0) / 2
            low, high = low - thin, high + thin
            if k == 0:  # what has no height is one strip
                y[flat, 0], y[flat, 1:] = at[flat, 0, 1] - THINNEST / 2, at[flat, 2, 1, None] + THINNEST / 2
                low[flat], high[flat] = at[flat, :, 0].min(1)[:, None], at[flat, :, 0].max(1)[:, None] + THINNEST
            else:
                y[flat] = 0.0
            low = np.stack([low, y[:, :-1]], axis=2).reshape(-1, 2)
            high = np.stack([high, y[:, 1:]], axis=2).reshape(-1, 2)
            total = total + self.over(low, high).reshape(len(at), bands, -1).sum(1)
            area = area + (high - low).prod(1).reshape(len(at), bands).sum(1)
        return total / area[:, None]
