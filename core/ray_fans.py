"""What fans of rays meet first: many rays from many points against a few faces, without divisions and without a tree.

Points that look the same way share the directions of their rays, points that look at the same places share the places: what
depends on the ray and what depends on the point part, and a test of a ray and a face is a handful of products.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .exitance_map import ExitanceMap
from .grouping import morton
from .occlusion import Blockers

SAME = np.float32(1 + 1e-3)
"""Surfaces this little nearer than a portal are behind it: walls that a portal lies in."""
SEAM = np.float32(1 - 1e-5)
"""Faces reach this little farther than they do, so that no ray slips through the seam of two."""
NEIGHBOURS = 512
"""Single rays from near one another that share the choice of the faces near by."""
_CELLS = 1 << 17
"""Tests made at once: the handful of arrays of this size stay in the cache."""


class Workspace:
    """Working arrays, used again and again: fresh memory from the system costs more than the arithmetic."""

    def __init__(self) -> None:
        self._floats = [np.empty(_CELLS, np.float32) for _ in range(3)]
        self._bools = np.empty(_CELLS, bool)

    def take(self, *shape: int) -> tuple[np.ndarray, ...]:
        """Three float32 arrays and a bool one of a shape, with anything in them."""
        size = int(np.prod(shape))
        if size > _CELLS:
            return (*(np.empty(shape, np.float32) for _ in range(3)), np.empty(shape, bool))
        return (*(x[:size].reshape(shape) for x in self._floats), self._bools[:size].reshape(shape))


def shelves(points: np.ndarray, rows: np.ndarray, size: int) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """``rows`` (n,) of points (N, 3), some neighbours at a time, with the middle and the radius of the ball around them."""
    rows = rows[np.argsort(morton(points.take(rows, 0)), kind="stable")]
    for part in np.array_split(rows, -(-len(rows) // size)) if len(rows) else ():
        here = points.take(part, 0)
        low, high = here.min(0), here.max(0)
        yield part, 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


@dataclass(frozen=True)
class Faces:
    """K faces: triangles first, then parallelograms, the last ``stops`` of them portals, where rays end and find nothing.

    normal, dual_x, dual_y, offset : (K, 3) float32 as of :class:`Blockers`;  triangles : number of triangles
    corners : (K, 4, 3);  middle : (K, 3), reach : (K,) a ball around each;  id : (K,) of the blockers, -1 for portals
    """

    normal: np.ndarray
    dual_x: np.ndarray
    dual_y: np.ndarray
    offset: np.ndarray
    corners: np.ndarray
    middle: np.ndarray
    reach: np.ndarray
    id: np.ndarray
    triangles: int
    stops: int
    clearance: float

    def __len__(self) -> int:
        return len(self.id)

    def take(self, index: np.ndarray) -> Faces:
        """Some of the faces, ``index`` rising."""
        arrays = (self.normal, self.dual_x, self.dual_y, self.offset, self.corners, self.middle, self.reach, self.id)
        triangles, before = np.searchsorted(index, (self.triangles, len(self) - self.stops))
        return Faces(*(x.take(index, 0) for x in arrays), int(triangles), int(len(index) - before), self.clearance)

    def toward(self, centre: np.ndarray, radius: float, axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """(K, t) bool: the face may lie in a cone around ``axis`` (t, 3) of half-angle ``angle`` (t,) from some point of a ball."""
        offset = self.middle - centre
        distance = np.maximum(np.sqrt((offset * offset).sum(1)), 1e-9)
        sine = (self.reach + radius) / distance
        own = np.where(sine < 1, np.arcsin(np.minimum(sine, 1)), np.pi)
        return np.arccos(np.clip(offset @ axis.T / distance[:, None], -1, 1)) <= own[:, None] + angle + 1e-3


def faces_of(blockers: Blockers, portals: Blockers) -> Faces:
    """Blockers, and portals as stops."""
    order = np.argsort(~blockers.triangle, kind="stable")
    parts = [
        np.concatenate([getattr(blockers, n)[order], getattr(portals, n)]) for n in ("normal", "dual_x", "dual_y", "offset", "corners")
    ]
    normal, dual_x, dual_y, offset, corners = parts
    offset = offset * np.array([1, SEAM, SEAM], np.float32)
    middle = 0.5 * (corners.min(1) + corners.max(1))
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(1, initial=0)
    ids = np.concatenate([blockers.id[order], np.full(len(portals), -1)])
    triangles = int(blockers.triangle.sum())
    return Faces(normal, dual_x * SEAM, dual_y * SEAM, offset, corners, middle, reach, ids, triangles, len(portals), blockers.clearance)


@dataclass(frozen=True)
class Fan:
    """r rays of one shape from every point, as faces k see them; distances are measured in units of each ray.

    Hemisphere: unit directions, the same for all points. Portal: from each point to the same places, at distance 1.
    along, across_x, across_y : (r, K) float32, directions or places in the coordinates of the faces
    begin : 1 over the distance of what ``along`` zero stands for, 0 for directions and 1 for places
    """

    along: np.ndarray
    across_x: np.ndarray
    across_y: np.ndarray
    begin: float


def directed(faces: Faces, directions: np.ndarray) -> Fan:
    """Rays along unit directions (r, 3)."""
    return Fan(*(directions @ m.T for m in (faces.normal, faces.dual_x, faces.dual_y)), 0.0)


def aimed(faces: Faces, places: np.ndarray) -> Fan:
    """Rays to places (r, 3)."""
    return Fan(*(places @ m.T - faces.offset[:, k] for k, m in enumerate((faces.normal, faces.dual_x, faces.dual_y))), 1.0)


@dataclass(frozen=True)
class Sights:
    """What the rays of a fan meet first on its front: s of the rays, by point and ray.

    point, ray : (s,);  piece : (s,) id of the blocker;  texel : (s,) of the exitance map;  near : (s,) float32, 1 over the distance
    """

    point: np.ndarray
    ray: np.ndarray
    piece: np.ndarray
    texel: np.ndarray
    near: np.ndarray

    def take(self, rows: np.ndarray) -> Sights:
        """Some of them."""
        return Sights(*(x.take(rows) for x in (self.point, self.ray, self.piece, self.texel, self.near)))


def look(faces: Faces, fan: Fan, exitance: ExitanceMap, points: np.ndarray, work: Workspace) -> Iterator[Sights]:
    """What the rays of a fan from points (n, 3) meet first, some points at a time; rays to backs and portals are left out.

    To places only what lies behind them counts: a ray is blocked by what is nearer. With w = 1 / distance along the ray a face is met
    where |x w| <= w and |y w| <= w, and all three are linear in the direction: no divisions, and the nearest face has the greatest w.
    """
    if len(faces):
        step = max(1, _CELLS // max(1, len(fan.along) * len(faces)))
        for start in range(0, len(points), step):
            yield _look(faces, fan, exitance, points[start : start + step], start, work)


def _look(faces: Faces, fan: Fan, exitance: ExitanceMap, points: np.ndarray, first: int, work: Workspace) -> Sights:
    height = points @ faces.normal.T
    height -= faces.offset[:, 0]
    x0, y0 = (points @ d.T - faces.offset[:, k] for k, d in ((1, faces.dual_x), (2, faces.dual_y)))
    clear = np.abs(height) > faces.clearance
    scale = np.where(clear, -1 / np.where(clear, height, 1), 0).astype(np.float32)
    w, x, y, hit = work.take(len(points), len(fan.along), len(faces))
    np.multiply(scale[:, None], fan.along, out=w)
    np.multiply(x0[:, None], w, out=x)
    x += fan.across_x
    np.multiply(y0[:, None], w, out=y)
    y += fan.across_y
    if fan.begin:
        w += np.float32(fan.begin)
        w *= clear[:, None]
    _meet(w, x, y, hit, faces)
    if faces.stops:
        w[..., -faces.stops :] *= SAME
    best = w.argmax(2)
    row = np.arange(len(points))[:, None]
    found = np.take_along_axis(w, best[..., None], 2)[..., 0]
    lit = (found > 0) & (height[row, best] > 0) & (faces.id[best] >= 0)
    if fan.begin:
        lit &= found <= fan.begin * SAME
    p, r = np.nonzero(lit)
    k, w = best[p, r], found[p, r]
    sx, sy = ((z[p, k] * (w - np.float32(fan.begin)) + across[r, k]) / w for z, across in ((x0, fan.across_x), (y0, fan.across_y)))
    return Sights(p + first, r, faces.id[k], _texel(faces, exitance, k, sx, sy), w)


def nearest(
    faces: Faces, exitance: ExitanceMap, origins: np.ndarray, directions: np.ndarray, reach: float, work: Workspace
) -> Iterator[tuple]:
    """What single rays from ``origins`` (n, 3) along unit ``directions`` (n, 3) meet, some at a time.

    Yields (:class:`Sights` of the rays that meet a front, (s,) rays that end in a portal, (s,) which of the portals).
    Most rays are expected to end within ``reach`` metres: neighbours are tested with the faces near by first, and those that meet
    nothing there with all of them.
    """
    if not len(faces) or not len(origins):
        return
    low, high = faces.corners.min(1), faces.corners.max(1)
    rest = []
    for rays, centre, radius in shelves(origins, np.arange(len(origins)), NEIGHBOURS):
        gap = np.maximum(np.maximum(low - centre, centre - high), 0)
        # A portal stops what ends this little before it.
        some = np.flatnonzero((gap * gap).sum(1) <= (radius + reach * SAME) ** 2)
        best, found, height = _first(faces.take(some), origins.take(rays, 0), directions.take(rays, 0), work)
        done = found * np.float32(reach) > 1
        rest.append(rays[~done])
        yield _seen(faces, exitance, origins, directions, rays[done], some[best[done]], found[done], height[done])
    rays = np.concatenate(rest)
    step = max(1, _CELLS // len(faces))
    for start in range(0, len(rays), step):
        here = rays[start : start + step]
        best, found, height = _first(faces, origins.take(here, 0), directions.take(here, 0), work)
        yield _seen(faces, exitance, origins, directions, here, best, found, height)


def _first(faces: Faces, o: np.ndarray, d: np.ndarray, work: Workspace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The first face of rays from ``o`` along ``d`` (n, 3), 1 over its distance (0: none), and the height of ``o`` over it, (n,) each."""
    if not len(faces):
        return np.zeros(len(o), np.int64), np.zeros(len(o), np.float32), np.zeros(len(o), np.float32)
    o, d = np.ascontiguousarray(o, np.float32), np.ascontiguousarray(d, np.float32)
    w, x, y, hit = work.take(len(o), len(faces))
    height = o @ faces.normal.T
    height -= faces.offset[:, 0]
    # A ray from within the plane of a face does not meet it.
    np.greater(np.abs(height, out=x), faces.clearance, out=hit)
    w[:] = 0
    np.divide(-1, height, out=w, where=hit)
    w *= np.matmul(d, faces.normal.T, out=x)
    for out, dual, offset in ((x, faces.dual_x, faces.offset[:, 1]), (y, faces.dual_y, faces.offset[:, 2])):
        np.matmul(o, dual.T, out=out)
        out -= offset
        out *= w
        out += d @ dual.T
    _meet(w, x, y, hit, faces)
    if faces.stops:
        w[:, -faces.stops :] *= SAME
    best, row = w.argmax(1), np.arange(len(o))
    return best, w[row, best], height[row, best]


def _seen(faces: Faces, exitance: ExitanceMap, origins, directions, rays, best, found, height) -> tuple[Sights, np.ndarray, np.ndarray]:
    """What :func:`nearest` yields of rays (n,) whose first faces are known."""
    stopped = np.flatnonzero((found > 0) & (faces.id[best] < 0))
    row = np.flatnonzero((found > 0) & (height > 0) & (faces.id[best] >= 0))
    k, w, ray = best.take(row), found.take(row), rays.take(row)
    place = origins.take(ray, 0) + directions.take(ray, 0) / w[:, None]
    sx, sy = (np.einsum("ij,ij->i", place, dual.take(k, 0)) - faces.offset[k, j] for j, dual in ((1, faces.dual_x), (2, faces.dual_y)))
    sights = Sights(ray, ray, faces.id[k], _texel(faces, exitance, k, sx, sy), w)
    return sights, rays[stopped], best[stopped] - (len(faces) - faces.stops)


def _texel(faces: Faces, exitance: ExitanceMap, k: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n,) texel at places of faces ``k`` (n,) in their own coordinates."""
    quad = k >= faces.triangles
    return exitance.texel(faces.id[k], *(np.clip(np.where(quad, 0.5 * s + 0.5, s), 0, 1) for s in (x, y)))


def _meet(w: np.ndarray, x: np.ndarray, y: np.ndarray, hit: np.ndarray, faces: Faces) -> None:
    """Set ``w`` (n, r, K) to zero where the ray misses the face; the others are used up.

    ``copyto`` takes a third of the time of a product with truth values, which are made numbers first.
    """
    some = faces.triangles
    if some:
        a, b, c = w[..., :some], x[..., :some], y[..., :some]
        a *= (b >= 0) & (c >= 0) & (b + c <= a)
        w, x, y, hit = w[..., some:], x[..., some:], y[..., some:], hit[..., some:]
    np.abs(x, out=x)
    np.abs(y, out=y)
    np.maximum(x, y, out=x)
    np.greater(x, w, out=hit)
    np.copyto(w, 0, where=hit)
