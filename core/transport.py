"""The diffuse kernel between points, and the exact irradiance from a polygon of constant exitance."""

from __future__ import annotations

import numpy as np

from .polygons import clip_half
from .vectors import cross, following


def kernel(a: np.ndarray, normal_a: np.ndarray, b: np.ndarray, normal_b: np.ndarray) -> np.ndarray:
    """cos cos / (pi r**2) between all nodes of two flat elements, 1/m2; visibility apart.

    a : (n, i, 3), b : (n, j, 3) float32 nodes;  normal_a, normal_b : (n, 3). Returns (n, i, j) float32, zero behind a plane.
    The height of a node of b over the plane of a is the same from every node of a, so that both cosines cost nothing.
    """
    height_b = np.einsum("njk,nk->nj", b - a[:, :1], normal_a)
    height_a = np.einsum("nik,nk->ni", a - b[:, :1], normal_b)
    r2 = np.zeros((len(a), a.shape[1], b.shape[1]), np.float32)
    for k in range(3):
        d = a[:, :, None, k] - b[:, None, :, k]
        d *= d
        r2 += d
    r2 *= r2
    r2 *= np.float32(np.pi)
    return np.maximum(height_a, 0)[:, :, None] * np.maximum(height_b, 0)[:, None] / np.maximum(r2, np.float32(1e-30))


def lambert(points: np.ndarray, normals: np.ndarray, polygons: np.ndarray) -> np.ndarray:
    """Form factor (n,) from points to convex polygons: irradiance over exitance, exact (Lambert 1760).

    points, normals : (n, 3);  polygons : (n, k, 3), cut to the half-space in front of the point; repeated corners are harmless.
    float64, because near a polygon's plane the sum over its edges cancels. The side of the polygon is the caller's affair.
    """
    corners = polygons.astype(np.float64) - points[:, None]
    normals = normals.astype(np.float64)
    height = np.einsum("nkd,nd->nk", corners, normals)
    below = np.flatnonzero((height < 0).any(1) & (height > 0).any(1))
    out = np.zeros(len(points))
    above = np.flatnonzero((height >= 0).all(1))
    out[above] = edge_sum(corners[above], normals[above])
    out[below] = edge_sum(clip_half(corners.take(below, 0), height.take(below, 0)), normals.take(below, 0))
    return out


def edge_sum(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Lambert's sum (n,) over the edges of polygons (n, k, 3) given relative to the points, all in front of them."""
    ahead = following(corners)
    normal = cross(corners, ahead)
    sine = np.sqrt(np.einsum("nkd,nkd->nk", normal, normal))
    angle = np.arctan2(sine, np.einsum("nkd,nkd->nk", corners, ahead))
    # A corner at the point itself, or an edge seen end on, spans no angle.
    share = np.where(sine > 1e-30, angle / np.maximum(sine, 1e-30), 0.0)
    return np.abs(np.einsum("nkd,nd,nk->n", normal, normals, share)) / (2 * np.pi)
