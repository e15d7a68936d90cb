"""Orthonormal multi-wavelet bases M1, M2, M3 on the unit square, their two-scale filters and quadrature.

The scaling functions of order k are tensor products of Legendre polynomials of degree below k, orthonormal on the
unit square and with the constant 1 first, so that coefficient 0 is the mean (Alpert 1993; Gortler et al. 1993).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

SLOTS = np.array(
    [
        [0.0, 0.0, 0.5, 0.5],
        [0.5, 0.0, 0.5, 0.5],
        [0.0, 0.5, 0.5, 0.5],
        [0.5, 0.5, 0.5, 0.5],
        [0.0, 0.0, 0.5, 1.0],
        [0.5, 0.0, 0.5, 1.0],
        [0.0, 0.0, 1.0, 0.5],
        [0.0, 0.5, 1.0, 0.5],
    ]
)
"""(8, 4) places (x, y, width, height) that a child can have in its parent: quarters, halves along u, halves along v."""
FAMILIES = ((0, 4), (4, 2), (6, 2))
"""Ways to split a parent: the row of ``SLOTS`` of its first child, and how many follow one another there."""


def nodes_per_axis(order: int) -> int:
    """Gauss nodes along each side of an element: exact for products of two basis functions, 2 at the least."""
    return max(2, order)


@lru_cache(maxsize=16)
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (count,) and weights (count,), float64, of the Gauss rule on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, w / 2


def gauss_square(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (count**2, 2) and weights (count**2,) of the tensor rule on the unit square, u running slowest."""
    x, w = gauss(count)
    return np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2), np.outer(w, w).reshape(-1)


def evaluate(order: int, uv: np.ndarray) -> np.ndarray:
    """Basis functions (..., order**2) at points (..., 2) of the unit square."""
    t = 2 * np.asarray(uv, float) - 1
    columns = [np.ones_like(t), np.sqrt(3) * t, np.sqrt(5) * (1.5 * t * t - 0.5)][:order]
    legendre = np.stack(columns, -1)  # (..., 2, order)
    return (legendre[..., 0, :, None] * legendre[..., 1, None, :]).reshape(*t.shape[:-1], order * order)


@lru_cache(maxsize=4)
def two_scale(order: int) -> np.ndarray:
    """(8, m, m) filters: ``H[s, i, j]`` is the coefficient of child function j in parent function i, child in slot s.

    Push: ``c_child = c_parent @ H[s]``. Pull: ``c_parent = sum_s area_s / area * H[s] @ c_child``. Exact quadrature.
    """
    x, w = gauss_square(order)
    child = evaluate(order, x)
    return np.stack([evaluate(order, s[:2] + x * s[2:]).T @ (w[:, None] * child) for s in SLOTS])


def fit(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Matrices (n, m, q) that take node values to coefficients and keep the weighted mean.

    values : (n, q, m) basis at the nodes;  weights : (n, q) >= 0, some positive in every row. The remainder after the mean is a
    weighted least-squares fit from which ill-determined directions are left out: a sliver of a cell gives a constant.
    """
    share = weights / weights.sum(1, keepdims=True)
    mean = np.einsum("nq,nqm->nm", share, values)
    centred = (values - mean[:, None])[:, :, 1:]
    root = np.sqrt(share)[:, :, None]
    slope = (
        np.linalg.pinv(root * centred, rcond=0.05) * root.transpose(0, 2, 1)
        if centred.shape[2]
        else np.zeros((len(values), 0, weights.shape[1]))
    )
    # Directions whose nodes nearly coincide are not slopes but noise, however well conditioned among themselves.
    spread = np.sqrt(np.einsum("nq,nqm->n", share, centred**2)) if centred.shape[2] else np.ones(len(values))
    slope = np.where((spread > 0.2)[:, None, None], slope, 0.0)
    slope = slope - slope @ np.repeat(share[:, None, :], share.shape[1], 1)
    constant = share - np.einsum("nm,nmq->nq", mean[:, 1:], slope)
    return np.concatenate([constant[:, None], slope], axis=1)
