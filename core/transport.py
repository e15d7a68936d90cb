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


def contour_form_factors(
    points: np.ndarray, normals: np.ndarray, facing: np.ndarray, row: np.ndarray, start: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Form factor (n,) from points to flat shapes of any contour, exact, as :func:`lambert`; a point is before the front of its shape.

    points, normals : (n, 3);  facing : (n, 3) normals of the shapes
    row : (e,) the point of every edge, sorted;  start, end : (e, 3) float64, closed chains of edges whose corners are equal to the bit

    An edge counts as far as it is before the plane of the point. Where the contour passes this plane it goes on along the line that
    both planes share: of that way every passage knows its own end, by the angle from the foot of the line to the passage.
    """
    points, normals, facing = (x.astype(np.float64) for x in (points, normals, facing))
    origin, up = points.take(row, 0), normals.take(row, 0)
    p, q = start - origin, end - origin
    # Not by einsum: the height of a corner must be the same on both of its edges, or a passage would be found on one alone.
    height_p, height_q = (x[:, 0] * up[:, 0] + x[:, 1] * up[:, 1] + x[:, 2] * up[:, 2] for x in (p, q))
    passes = np.flatnonzero((height_p > 0) != (height_q > 0))
    share = (height_p[passes] / (height_p[passes] - height_q[passes]))[:, None]
    passage = p.take(passes, 0) + share * (q.take(passes, 0) - p.take(passes, 0))
    leaves = height_p[passes] > 0
    p[passes[~leaves]], q[passes[leaves]] = passage[~leaves], passage[leaves]
    counts = np.flatnonzero((height_p > 0) | (height_q > 0))
    p, q = p.take(counts, 0), q.take(counts, 0)
    normal = cross(p, q)
    sine = np.sqrt(np.einsum("ed,ed->e", normal, normal))
    angle = np.arctan2(sine, np.einsum("ed,ed->e", p, q))
    part = np.einsum("ed,ed->e", normal, up.take(counts, 0)) * np.where(sine > 1e-30, angle / np.maximum(sine, 1e-30), 0.0)
    total = np.bincount(row.take(counts), part, minlength=len(points))
    # The shape lies at a negative height along its facing normal, so the foot of the line lies against it.
    own = row.take(passes)
    toward = (np.einsum("nd,nd->n", facing, normals)[:, None] * normals - facing).take(own, 0)
    aside = cross(up.take(passes, 0), toward)
    turn = np.arctan2(np.einsum("ed,ed->e", passage, aside), np.einsum("ed,ed->e", passage, toward))
    total += np.bincount(own, np.where(leaves, -turn, turn), minlength=len(points))
    return np.abs(total) / (2 * np.pi)


def edge_sum(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Lambert's sum (n,) over the edges of polygons (n, k, 3) given relative to the points, all in front of them."""
    ahead = following(corners)
    normal = cross(corners, ahead)
    sine = np.sqrt(np.einsum("nkd,nkd->nk", normal, normal))
    angle = np.arctan2(sine, np.einsum("nkd,nkd->nk", corners, ahead))
    # A corner at the point itself, or an edge seen end on, spans no angle.
    share = np.where(sine > 1e-30, angle / np.maximum(sine, 1e-30), 0.0)
    return np.abs(np.einsum("nkd,nd,nk->n", normal, normals, share)) / (2 * np.pi)
