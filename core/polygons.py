"""Planar polygons: area vectors, decomposition into triangles and parallelograms, clipping to boxes of the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import Scene

PARALLELOGRAM_TOLERANCE = 1e-5
"""Largest relative difference of opposite edges for a quad to count as a parallelogram."""


@dataclass(frozen=True)
class Pieces:
    """Triangles and parallelograms ``origin + s*a + t*b`` that cover polygons without overlap (K pieces).

    origin, a, b : (K, 3) float64, metres;  triangle : (K,) bool, False for a parallelogram;  polygon : (K,) int32
    """

    origin: np.ndarray
    a: np.ndarray
    b: np.ndarray
    triangle: np.ndarray
    polygon: np.ndarray

    @property
    def area(self) -> np.ndarray:
        """(K,) float64, m2."""
        return np.linalg.norm(np.cross(self.a, self.b), axis=1) * np.where(self.triangle, 0.5, 1.0)


def loop_polygon(scene: Scene) -> np.ndarray:
    """(L,) polygon of every loop."""
    return np.repeat(np.arange(scene.polygon_count), np.diff(scene.polygon_start))


def area_vectors(scene: Scene) -> np.ndarray:
    """(P, 3) float64: normal times area of every polygon (Newell), holes subtracted, m2."""
    position = scene.vertices[scene.corner_vertex]
    loop = np.repeat(np.arange(len(scene.loop_start) - 1), np.diff(scene.loop_start))
    following = np.arange(len(position)) + 1
    ends = scene.loop_start[1:]
    following[ends - 1] = scene.loop_start[:-1]
    # Measured from the first corner of each loop: products of world coordinates would cancel far from the origin.
    local = position - position[scene.loop_start[:-1]][loop]
    cross = 0.5 * np.cross(local, local[following])
    out = np.zeros((scene.polygon_count, 3))
    np.add.at(out, loop_polygon(scene)[loop], cross)
    return out


def decompose(scene: Scene) -> Pieces:
    """Cut every polygon into triangles and parallelograms; polygons of no area give none."""
    vectors = area_vectors(scene)
    area = np.linalg.norm(vectors, axis=1)
    normal = vectors / np.maximum(area, 1e-300)[:, None]
    loops = np.diff(scene.polygon_start)
    first = scene.loop_start[scene.polygon_start[:-1]]
    count = scene.loop_start[scene.polygon_start[:-1] + 1] - first
    alive = area > 1e-14
    convex = alive & (loops == 1) & _convex(scene, normal)
    corner = lambda p, k: scene.vertices[scene.corner_vertex[first[p] + k]]  # noqa: E731

    quad = np.flatnonzero(convex & (count == 4))
    gap = np.linalg.norm(corner(quad, 0) + corner(quad, 2) - corner(quad, 1) - corner(quad, 3), axis=1)
    size = np.linalg.norm(corner(quad, 2) - corner(quad, 0), axis=1)
    regular = quad[gap <= PARALLELOGRAM_TOLERANCE * size]
    parts = [(corner(regular, 0), corner(regular, 1), corner(regular, 3), np.zeros(len(regular), bool), regular)]

    fan = np.setdiff1d(np.flatnonzero(convex), regular)
    triangles = count[fan] - 2
    owner = np.repeat(fan, triangles)
    k = np.arange(len(owner)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    parts.append((corner(owner, 0), corner(owner, k + 1), corner(owner, k + 2), np.ones(len(owner), bool), owner))

    # Only concave and holed polygons come here one by one: ear clipping is sequential by nature, and they are few.
    for p in np.flatnonzero(alive & ~convex):
        t = _clip_ears(scene, p, normal[p])
        parts.append((t[:, 0], t[:, 1], t[:, 2], np.ones(len(t), bool), np.full(len(t), p)))
    o, a, b, triangle, polygon = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(polygon, kind="stable")
    pieces = Pieces(o[order], (a - o)[order], (b - o)[order], triangle[order], polygon[order].astype(np.int32))
    keep = pieces.area > 1e-14
    return Pieces(*(x[keep] for x in (pieces.origin, pieces.a, pieces.b, pieces.triangle, pieces.polygon)))


def _convex(scene: Scene, normal: np.ndarray) -> np.ndarray:
    """(P,) bool: no corner of the outer loop turns right by more than rounding."""
    position = scene.vertices[scene.corner_vertex]
    index = np.arange(len(position))
    following, previous = index + 1, index - 1
    following[scene.loop_start[1:] - 1] = scene.loop_start[:-1]
    previous[scene.loop_start[:-1]] = scene.loop_start[1:] - 1
    loop = np.repeat(np.arange(len(scene.loop_start) - 1), np.diff(scene.loop_start))
    polygon = loop_polygon(scene)[loop]
    e, f = position - position[previous], position[following] - position
    turn = np.einsum("ij,ij->i", np.cross(e, f), normal[polygon])
    slack = -1e-7 * np.linalg.norm(e, axis=1) * np.linalg.norm(f, axis=1) - 1e-14
    concave = np.zeros(scene.polygon_count, bool)
    concave[polygon[turn < slack]] = True
    return ~concave


def _clip_ears(scene: Scene, p: int, normal: np.ndarray) -> np.ndarray:
    """(n, 3, 3) triangles of one polygon, its holes joined to the outer loop by bridges."""
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    rings = []
    for loop in range(scene.polygon_start[p], scene.polygon_start[p + 1]):
        ring = scene.vertices[scene.corner_vertex[scene.loop_start[loop] : scene.loop_start[loop + 1]]]
        rings.append(list(ring))
    flat = lambda x: np.array([x @ u, x @ v])  # noqa: E731
    outer = rings[0]
    for hole in sorted(rings[1:], key=lambda ring: -max(flat(x)[0] for x in ring)):
        outer = _bridge(outer, hole, flat)
    points = np.array([flat(x) for x in outer])
    ring, out = list(range(len(outer))), []
    while len(ring) > 3:
        for i in range(len(ring)):
            a, b, c = ring[i - 1], ring[i], ring[(i + 1) % len(ring)]
            if _cross(points[a], points[b], points[c]) <= 1e-15:
                continue
            rest = points[[k for k in ring if k not in (a, b, c)]]
            inside = (
                (_cross(points[a], points[b], rest) > 1e-15)
                & (_cross(points[b], points[c], rest) > 1e-15)
                & (_cross(points[c], points[a], rest) > 1e-15)
            )
            if not inside.any():
                break
        else:  # only slivers of rounding are left
            i = min(range(len(ring)), key=lambda k: abs(_cross(points[ring[k - 1]], points[ring[k]], points[ring[(k + 1) % len(ring)]])))
        out.append((ring[i - 1], ring[i], ring[(i + 1) % len(ring)]))
        ring.pop(i)
    out.append(tuple(ring))
    return np.array(outer)[np.array(out)]


def _bridge(outer: list, hole: list, flat) -> list:
    """Join a hole to the ring around it along the shortest segment that crosses neither."""
    ring, inner = np.array([flat(x) for x in outer]), np.array([flat(x) for x in hole])
    starts, ends = np.concatenate([ring, inner]), np.concatenate([np.roll(ring, -1, 0), np.roll(inner, -1, 0)])
    distance = np.linalg.norm(ring[:, None] - inner[None], axis=2)
    for i, j in zip(*np.unravel_index(np.argsort(distance, axis=None), distance.shape), strict=True):
        p, q = ring[i], inner[j]
        straddles = (_cross(p, q, starts) * _cross(p, q, ends) < -1e-18) & (_side(starts, ends, p) * _side(starts, ends, q) < -1e-18)
        if not straddles.any():
            break
    return outer[: i + 1] + hole[j:] + hole[: j + 1] + outer[i:]


def _cross(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of the triangles a, b, c of the plane."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    return (b[:, 0] - a[:, 0]) * (point[1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (point[0] - a[:, 0])


def clip_to_boxes(polygons: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Clip convex polygons of the plane to boxes with sides along the axes (Sutherland and Hodgman), all at once.

    polygons : (n, k, 2) float64, corners in order, repeated corners allowed
    low, high : (n, 2) float64, the box of each polygon
    Returns (n, k + 4, 2) float64; where corners are fewer the last is repeated, and nothing left is all one point.
    """
    for axis in (0, 1):
        for bound, sign in ((low, 1.0), (high, -1.0)):
            polygons = clip_half(polygons, sign * (polygons[:, :, axis] - bound[:, axis, None]))
    return polygons


def clip_half(polygons: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Keep the part of (n, k, d) convex polygons with ``height`` (n, k) >= 0; one corner slot more than before."""
    n, k, d = polygons.shape
    following, next_height = np.roll(polygons, -1, 1), np.roll(height, -1, 1)
    inside, crosses = height >= 0, (height >= 0) != (next_height >= 0)
    t = height / np.where(crosses, height - next_height, 1.0)
    # Every corner gives at most itself and the crossing after it: 2k slots, packed to k + 1 (convexity allows no more).
    slots = np.stack([polygons, polygons + t[..., None] * (following - polygons)], axis=2).reshape(n, 2 * k, d)
    used = np.stack([inside, crosses], axis=2).reshape(n, 2 * k)
    order = np.argsort(~used, axis=1, kind="stable")[:, : k + 1]
    rank = np.minimum(np.arange(k + 1)[None], np.maximum(used.sum(1) - 1, 0)[:, None])
    return np.take_along_axis(slots, np.take_along_axis(order, rank, 1)[..., None], 1)


def areas_and_centroids(polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) signed area and (n, 2) area-weighted centroid sum (area times centroid) of (n, k, 2) polygons."""
    local = polygons - polygons[:, :1]
    following = np.roll(local, -1, 1)
    cross = local[..., 0] * following[..., 1] - local[..., 1] * following[..., 0]
    area = 0.5 * cross.sum(1)
    moment = ((local + following) * cross[..., None]).sum(1) / 6.0
    return area, moment + area[:, None] * polygons[:, 0]
