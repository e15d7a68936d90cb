"""Two idioms of vector algebra in their fast forms: NumPy's own move axes about and cost more than the work on small blocks."""

from __future__ import annotations

import numpy as np


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(..., 3) cross products of vectors (..., 3) along the last axis."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(a[..., i], b[..., j], out=out[..., k])
        out[..., k] -= a[..., j] * b[..., i]
    return out


def following(corners: np.ndarray) -> np.ndarray:
    """(n, k, ...) the next corner of each corner of polygons (n, k, ...)."""
    return np.concatenate([corners[:, 1:], corners[:, :1]], axis=1)
