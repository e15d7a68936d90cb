"""Values that differ from face to face, as few as do them justice: every value is a surface of its own to the solver."""

from __future__ import annotations

import numpy as np


def patch_means(
    value: np.ndarray, area: np.ndarray, patch: np.ndarray, centre: np.ndarray, cells: int, tolerance: np.ndarray
) -> np.ndarray:
    """(P, c) float64 values in place of ``value`` with the same sum of value times area on every patch.

    value : (P, c) of polygons;  area : (P,);  patch : (P,) int, from 0, the flat patch that each is a part of;  centre : (P, 3)
    cells : a patch is resolved into about as many parts along its longer side: smaller polygons share their mean with those around
    tolerance : (patches,), parts that differ no more from the mean of the patch share one value, as do others that are near each other
    """
    count = len(tolerance)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, patch, centre)
    np.maximum.at(high, patch, centre)
    size = np.maximum((high - low).max(axis=1), 1e-9)
    cell = np.floor((centre - low[patch]) * ((1 - 1e-9) * cells / size[patch])[:, None]).astype(np.int64)
    number = 1 + (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    large = area * cells**2 >= np.bincount(patch, area, count)[patch]
    number[large] = -np.arange(1, large.sum() + 1)
    _, first, part = np.unique(np.stack([patch, number], axis=1), axis=0, return_index=True, return_inverse=True)
    part, owner = part.reshape(-1), patch[first]

    mean, weight = _means(value, area, part, len(first))
    whole, _ = _means(mean, weight, owner, count)
    own = np.abs(mean - whole[owner]).max(axis=1) > tolerance[owner]
    level = np.where(own[:, None], 1 + np.round(mean / (2 * tolerance[owner])[:, None]), 0)
    alike = np.unique(np.column_stack([owner, level]), axis=0, return_inverse=True)[1].reshape(-1)
    return _means(mean, weight, alike, int(alike.max()) + 1)[0][alike][part]


def _means(value: np.ndarray, weight: np.ndarray, owner: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, c) weighted means by owner, 0 where nothing weighs, and (count,) the weights."""
    total = np.bincount(owner, weight, count)
    sums = np.stack([np.bincount(owner, weight * channel, count) for channel in value.T], axis=1)
    return sums / np.where(total > 0, total, 1.0)[:, None], total
