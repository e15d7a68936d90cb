"""Form factors between polygons from the solver's own formulas for a point, summed over the receiver to ten digits."""

from __future__ import annotations

import numpy as np

from ...core.basis import gauss
from ...core.occlusion import flat_blockers
from ...core.shadows import in_front, visible_light
from ...core.transport import edge_sum, lambert

COUNT = 40
"""Gauss nodes along each side of a triangle of the receiver."""


def area_of(polygon: np.ndarray) -> float:
    """m2 of a plane polygon (n, 3)."""
    return 0.5 * float(np.linalg.norm(_vector(polygon)))


def normal_of(polygon: np.ndarray) -> np.ndarray:
    """(3,) unit normal of a plane polygon (n, 3)."""
    vector = _vector(polygon)
    return vector / np.linalg.norm(vector)


def _vector(polygon: np.ndarray) -> np.ndarray:
    return np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(0)


def graded(polygon: np.ndarray, count: int = COUNT) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and weights (n,), of sum one, on a convex polygon, denser towards its edges, where factors are not smooth."""
    x, w = gauss(count)
    w = w * 30 * x**2 * (1 - x) ** 2
    x = x**3 * (10 - 15 * x + 6 * x * x)
    s, t = (z.ravel() for z in np.meshgrid(x, x, indexing="ij"))
    weight = np.outer(w, w).ravel()
    if len(polygon) == 4 and np.allclose(polygon[0] + polygon[2], polygon[1] + polygon[3]):
        # Narrow strips would fall into slivers.
        return polygon[0] + s[:, None] * (polygon[1] - polygon[0]) + t[:, None] * (polygon[3] - polygon[0]), weight
    points, weights = [], []
    middle = polygon.mean(0)
    for a, b in zip(polygon, np.roll(polygon, -1, 0), strict=True):
        points.append(middle + s[:, None] * ((a - middle) + t[:, None] * (b - a)))
        weights.append(weight * s * np.linalg.norm(np.cross(a - middle, b - middle)))
    points, weights = np.concatenate(points), np.concatenate(weights)
    return points, weights / weights.sum()


def cut(polygon: np.ndarray, planes: list) -> list[np.ndarray]:
    """The parts of a convex polygon (n, 3) on either side of every plane (normal and offset, 4 numbers)."""
    parts = [polygon]
    for plane in np.array(planes, float):
        if np.abs(polygon @ plane[:3] - plane[3]).max() > 1e-12:
            parts = [half for part in parts for sign in (1, -1) if len(half := _half(part, sign * plane)) > 2]
    return parts


def _half(polygon: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """What of a convex polygon lies above a plane; fewer than 3 corners for nothing."""
    height = polygon @ plane[:3] - plane[3]
    height[np.abs(height) < 1e-12] = 0
    if not (height > 0).any():
        return polygon[:0]
    out = []
    for p, q, h, k in zip(polygon, np.roll(polygon, -1, 0), height, np.roll(height, -1), strict=True):
        if h >= 0:
            out.append(p)
        if h * k < 0:
            out.append(p + h / (h - k) * (q - p))
    return np.array(out)


def form_factor(a: list[np.ndarray], b: list[np.ndarray], blockers: list = (), planes: list = (), count: int = COUNT) -> float:
    """Part of the light of polygons ``a`` that reaches ``b``: the mean over a of what a point sees of b (reciprocity).

    a, b : convex polygons (n, 3);  blockers : rectangles (4, 3) that may stand between;  planes : where what a point of a sees of
    b is not smooth, so that a is cut there
    """
    total = 0.0
    for part in a:
        normal = normal_of(part)
        for piece in cut(part, planes):
            points, weights = graded(piece, count)
            for source in b:
                facing = (points - source[0]) @ normal_of(source) > 1e-15
                total += area_of(piece) * float(weights[facing] @ _seen(points[facing], normal, source, blockers))
    return total / sum(map(area_of, a))


def _seen(points: np.ndarray, normal: np.ndarray, source: np.ndarray, blockers: list) -> np.ndarray:
    """Form factor (n,) from points to what is seen of a convex polygon."""
    count = len(points)
    normals, outlines = np.broadcast_to(normal, (count, 3)), np.broadcast_to(source, (count, *source.shape))
    if not len(blockers):
        return lambert(points, normals, outlines)
    plates = plates_of([np.asarray(p, float) for p in blockers])
    pair, blocker = (x.ravel() for x in np.meshgrid(np.arange(count), np.arange(len(blockers)), indexing="ij"))
    corners = in_front(np.arange(count), outlines - points[:, None], normals)
    light = visible_light(points, np.arange(count), corners, plates, pair, blocker, lambda k, part: edge_sum(part, normals[k])[:, None])
    return light[:, 0]


def plates_of(rectangles: list[np.ndarray]):
    """Rectangles (4, 3) as blockers."""
    origin = np.array([r[0] for r in rectangles])
    a, b = np.array([r[1] - r[0] for r in rectangles]), np.array([r[3] - r[0] for r in rectangles])
    normal = np.array([normal_of(r) for r in rectangles])
    return flat_blockers(origin, a, b, np.zeros(len(rectangles), bool), normal, np.arange(len(rectangles)))
