"""Planar polygons: area vectors, decomposition into triangles and parallelograms, clipping to boxes of the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import Scene

PARALLELOGRAM_TOLERANCE = 1e-5
"""Largest relative difference of opposite edges for a quad to count as a parallelogram."""
_BLOCK = 1 << 14
"""Polygons that are measured at once."""


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

    # Only concave and holed polygons come here one by one: they are few, and each has slabs of its own.
    for p in np.flatnonzero(alive & ~convex):
        piece, triangle = _slabs(scene, p, normal[p])
        parts.append((piece[:, 0], piece[:, 1], piece[:, 2], triangle, np.full(len(piece), p)))
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


def _slabs(scene: Scene, p: int, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pieces of one polygon with holes or reflex corners: (n, 3, 3) their corners origin, a, b, and (n,) bool triangle.

    Cut across its longest edge at every corner, the polygon falls into trapezoids (even-odd in every slab); those of
    walls with doors and windows are rectangles.
    """
    loops = range(scene.polygon_start[p], scene.polygon_start[p + 1])
    rings = [scene.vertices[scene.corner_vertex[scene.loop_start[k] : scene.loop_start[k + 1]]] for k in loops]
    start, end = np.concatenate(rings), np.concatenate([np.roll(ring, -1, 0) for ring in rings])
    edge = end - start
    u = edge[np.argmax((edge**2).sum(1))]
    u = u - (u @ normal) * normal
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    origin = start[0]
    a, b = ((x - origin) @ np.stack([u, v], 1) for x in (start, end))
    turned = a[:, 0] > b[:, 0]
    a[turned], b[turned] = b[turned], a[turned].copy()
    bounds = np.sort(np.concatenate([a[:, 0], b[:, 0]]))
    eps = 1e-9 * max(bounds[-1] - bounds[0], 1e-9)
    bounds = bounds[np.r_[True, np.diff(bounds) > eps]]
    x0, x1 = bounds[:-1, None], bounds[1:, None]
    slab, k = np.nonzero((a[None, :, 0] <= x0 + eps) & (b[None, :, 0] >= x1 - eps))
    slope = (b[k, 1] - a[k, 1]) / (b[k, 0] - a[k, 0])
    left, right = (a[k, 1] + (x[slab, 0] - a[k, 0]) * slope for x in (x0, x1))
    order = np.lexsort((left + right, slab))
    slab, left, right = slab[order][::2], left[order], right[order]
    low, high = np.stack([left[::2], right[::2]], 1), np.stack([left[1::2], right[1::2]], 1)
    place = lambda x, y: origin + x[:, None] * u + y[:, None] * v  # noqa: E731
    x0, x1 = x0[slab, 0], x1[slab, 0]
    corner = [place(x0, low[:, 0]), place(x1, low[:, 1]), place(x1, high[:, 1]), place(x0, high[:, 0])]
    regular = np.abs((high - low)[:, 0] - (high - low)[:, 1]) <= PARALLELOGRAM_TOLERANCE * (high - low).max(1)
    parts = [(corner[0], corner[1], corner[3], regular)]
    parts += [(corner[0], corner[1], corner[2], ~regular), (corner[0], corner[2], corner[3], ~regular)]
    pieces = np.concatenate([np.stack(part[:3], 1)[part[3]] for part in parts])
    return pieces, np.arange(len(pieces)) >= regular.sum()


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
    """Keep the part of (n, k, d) convex polygons with ``height`` (n, k) >= 0; one corner slot more than before.

    The corners that stay follow each other, because the polygon is convex: the result runs from the point where the border
    enters the half-space, over these corners, to the point where it leaves; the last point fills the slots that remain.
    """
    k = polygons.shape[1]
    inside = height >= 0
    count = inside.sum(1)
    out = np.concatenate([polygons, polygons[:, -1:]], axis=1)
    none = np.flatnonzero(count == 0)
    out[none] = polygons[none, :1]
    cut = np.flatnonzero((count > 0) & (count < k))
    if not len(cut):
        return out
    inside, count = inside.take(cut, 0), count.take(cut)
    before = np.concatenate([inside[:, -1:], inside[:, :-1]], axis=1)
    first = (inside & ~before).argmax(1)
    last = (first + count - 1) % k
    place = (first[:, None] + np.clip(np.arange(-1, k), 0, count[:, None] - 1)) % k
    flat, level = polygons.take(cut, 0).reshape(-1, polygons.shape[2]), height.take(cut, 0).reshape(-1)
    row = k * np.arange(len(cut))
    kept = flat.take(row[:, None] + place, 0)
    ends = []
    for at, to in ((first, (first - 1) % k), (last, (last + 1) % k)):
        at, to = row + at, row + to
        p, q, hp, hq = flat.take(at, 0), flat.take(to, 0), level.take(at), level.take(to)
        # Rounding may leave corners on the plane out of their row; what is no crossing then has nothing between.
        crosses = (hp >= 0) & (hq < 0)
        t = np.where(crosses, hp / np.where(crosses, hp - hq, 1.0), 0.0)
        ends.append(p + np.clip(t, 0, 1)[:, None] * (q - p))
    kept[:, 0] = ends[0]
    kept = np.where((np.arange(k + 1) > count[:, None])[..., None], ends[1][:, None], kept)
    out[cut] = kept
    return out


def areas_and_centroids(polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) signed area and (n, 2) area-weighted centroid sum (area times centroid) of (n, k, 2) polygons."""
    areas, moments = np.empty(len(polygons)), np.empty((len(polygons), 2))
    for low in range(0, len(polygons), _BLOCK):
        here = slice(low, low + _BLOCK)
        local = polygons[here] - polygons[here, :1]
        following = np.roll(local, -1, 1)
        cross = local[..., 0] * following[..., 1] - local[..., 1] * following[..., 0]
        areas[here] = area = 0.5 * cross.sum(1)
        moments[here] = ((local + following) * cross[..., None]).sum(1) / 6.0 + area[:, None] * polygons[here, 0]
    return areas, moments
