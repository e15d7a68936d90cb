"""Visibility between points: which flat blockers can stand in a shaft, and which segments they cut.

A shaft is the convex hull of two convex bodies. A blocker can be left out when some direction separates it from both
bodies, when both bodies lie on one side of its plane, or when it lies behind the plane of either body. Each of these
conditions is an AND or OR of facts about one body and one blocker, so the facts are kept as bits and a pair of bodies
costs a few word operations for 64 blockers (in place of the planes of Haines and Wallace, "Shaft culling", 1991).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .grouping import runs
from .regions import Regions

_DIAGONALS = np.array([[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]]) / np.sqrt(2)
AXES = np.concatenate([np.eye(3), _DIAGONALS]).astype(np.float32)
_FACTS = 1 << 16
"""Pairs of a body and a blocker that are looked at at once."""
_BLOCK = 1 << 16
"""Elements of one working array of the segment test: a handful of them stay in the cache of a core."""


@dataclass(frozen=True)
class Blockers:
    """K flat blockers, parallelograms and triangles, opaque from both sides. float32, relative to the scene's centre.

    normal, dual_x, dual_y : (K, 3); offset : (K, 3). Coordinates of a point p are (normal, dual_x, dual_y) . p - offset:
    height above the plane (m) and x, y with |x|, |y| <= 1 inside a parallelogram, x, y >= 0 and x + y <= 1 inside a triangle
    triangle : (K,) bool;  corners : (K, 4, 3), the last of a triangle repeated;  region : (K,) int32
    id : (K,) int32, number among all blockers of the building
    clearance : points closer than this (m) to a blocker's plane are on it, and what starts on it is not cut by it
    """

    normal: np.ndarray
    dual_x: np.ndarray
    dual_y: np.ndarray
    offset: np.ndarray
    triangle: np.ndarray
    corners: np.ndarray
    region: np.ndarray
    id: np.ndarray
    clearance: float

    def __len__(self) -> int:
        return len(self.region)

    def within(self, low: np.ndarray, high: np.ndarray) -> Blockers:
        """The blockers that meet the box low..high (3,)."""
        meets = (self.corners.min(1) <= high).all(1) & (self.corners.max(1) >= low).all(1)
        return self.take(np.flatnonzero(meets))

    @property
    def middle(self) -> np.ndarray:
        """(K, 3) middle of the corners."""
        return 0.5 * (self.corners.min(1) + self.corners.max(1))

    @cached_property
    def size(self) -> np.ndarray:
        """(K,) root of the area, m."""
        return np.sqrt(np.linalg.norm(np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 3] - self.corners[:, 0]), axis=1))

    @cached_property
    def large(self) -> np.ndarray:
        """(K,) bool: among the larger ones, that hide most."""
        size = self.size
        return size > 3 * np.median(size) if len(size) else np.zeros(0, bool)

    def take(self, index: np.ndarray) -> Blockers:
        """The blockers with the given indices."""
        arrays = (self.normal, self.dual_x, self.dual_y, self.offset, self.triangle, self.corners, self.region, self.id)
        return Blockers(*(x.take(index, 0) for x in arrays), self.clearance)

    def joined(self, other: Blockers) -> Blockers:
        """These blockers and then the others."""
        names = ("normal", "dual_x", "dual_y", "offset", "triangle", "corners", "region", "id")
        return Blockers(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names), self.clearance)


def blockers_of(regions: Regions) -> Blockers:
    """Every piece of every region as a blocker."""
    region = regions.piece_region
    a = regions.piece_a[:, :1] * regions.u[region] + regions.piece_a[:, 1:] * regions.v[region]
    b = regions.piece_b[:, :1] * regions.u[region] + regions.piece_b[:, 1:] * regions.v[region]
    return flat_blockers(regions.world(region, regions.piece_origin), a, b, regions.piece_triangle, regions.normal[region], region)


def flat_blockers(
    origin: np.ndarray, a: np.ndarray, b: np.ndarray, triangle: np.ndarray, normal: np.ndarray, region: np.ndarray
) -> Blockers:
    """Blockers ``origin + s*a + t*b`` (K, 3) with unit normals (K, 3), relative to the scene's centre, metres.

    One without area, as a portal may be, has no plane: nothing meets it and no shaft holds it.
    """
    corners = np.stack([origin, origin + a, np.where(triangle[:, None], origin + b, origin + a + b), origin + b], axis=1)
    half = np.where(triangle, 1.0, 0.5)[:, None]
    middle = np.where(triangle[:, None], origin, origin + 0.5 * (a + b))
    x, y = half * a, half * b
    across_y, across_x = np.cross(y, normal), np.cross(normal, x)
    span_x, span_y = np.einsum("ij,ij->i", x, across_y)[:, None], np.einsum("ij,ij->i", y, across_x)[:, None]
    flat = (span_x == 0) | (span_y == 0)
    normal, across_y, across_x = (np.where(flat, 0.0, z) for z in (normal, across_y, across_x))
    dual_x, dual_y = across_y / np.where(flat, 1.0, span_x), across_x / np.where(flat, 1.0, span_y)
    offset = np.stack([np.einsum("ij,ij->i", d, middle) for d in (normal, dual_x, dual_y)], axis=1)
    extent = float(np.abs(corners).max(initial=1.0))
    # float32 places a point to extent * 6e-8, and three products of it are summed.
    clearance = max(1e-6, 1e-6 * extent)
    single = (z.astype(np.float32) for z in (normal, dual_x, dual_y, offset))
    return Blockers(
        *single, triangle, corners.astype(np.float32), region.astype(np.int32), np.arange(len(region), dtype=np.int32), clearance
    )


@dataclass(frozen=True)
class Bodies:
    """n convex bodies, each a centre with two half sides and a facing normal, float32: patches, points, and what is as thick as a ball.

    centre, half_u, half_v, normal : (n, 3), the normal zero where a body faces all ways
    radius : (n,) of a ball by which the flat body is widened all round, or None for flat ones
    """

    centre: np.ndarray
    half_u: np.ndarray
    half_v: np.ndarray
    normal: np.ndarray
    radius: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.centre)

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners low and high (3,) of the box around all bodies."""
        half = np.abs(self.half_u) + np.abs(self.half_v)
        if self.radius is not None:
            half += self.radius[:, None]
        return (self.centre - half).min(0), (self.centre + half).max(0)

    def reach(self, axes: np.ndarray) -> np.ndarray:
        """(n, k) how far the bodies extend along unit axes (k, 3) from their centres."""
        out = np.abs(self.half_u @ axes.T)
        out += np.abs(self.half_v @ axes.T)
        if self.radius is not None:
            out += self.radius[:, None]
        return out

    def balls(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres (3, n) and radii (n,) of balls around the bodies."""
        flat = np.sqrt((self.half_u**2).sum(1) + (self.half_v**2).sum(1))
        return np.ascontiguousarray(self.centre.T), flat if self.radius is None else flat + self.radius

    def joined(self, other: Bodies) -> Bodies:
        """These bodies and then the others."""
        parts = [(b.centre, b.half_u, b.half_v, b.normal) for b in (self, other)]
        flat = self.radius is None and other.radius is None
        radius = None if flat else np.concatenate([np.zeros(len(b), np.float32) if b.radius is None else b.radius for b in (self, other)])
        return Bodies(*(np.concatenate(pair) for pair in zip(*parts, strict=True)), radius)

    def take(self, index: np.ndarray | slice) -> Bodies:
        """The bodies with the given indices."""
        radius = None if self.radius is None else self.radius[index]
        sides = (self.centre, self.half_u, self.half_v, self.normal)
        return Bodies(*(x[index] if isinstance(index, slice) else x.take(index, 0) for x in sides), radius)


class ShaftIndex:
    """Blockers prepared for the culling of many sets of bodies.

    Along each axis a body has a prefix of the blockers, sorted by where they end, on one side, and a suffix, sorted by where
    they begin, on the other: both are rows of a table, found by bisection. Above ``ROWS`` blockers the table has a row for
    every few of them, and a prefix is cut to what a row holds: fewer blockers are ruled out, none wrongly.
    """

    ROWS = 512

    def __init__(self, blockers: Blockers):
        self.blockers = blockers
        count = len(blockers)
        self.words = max(1, -(-count // 64))
        self.valid = self.pack(np.ones((1, count), bool))[0]
        self._step = max(1, -(-count // self.ROWS))
        self._axes = []
        for axis in AXES:
            reach = blockers.corners @ axis
            tables = []
            for ends in (reach.max(1), -reach.min(1)):
                order = np.argsort(ends, kind="stable")
                # Row r holds the blockers of the first r steps: each row is the one before with some bits more.
                table = np.zeros((-(-count // self._step) + 1, 8 * self.words), np.uint8)
                np.bitwise_or.at(table, (np.arange(count) // self._step + 1, order >> 3), (128 >> (order & 7)).astype(np.uint8))
                tables.append((ends[order], np.bitwise_or.accumulate(table.view(np.uint64), axis=0)))
            self._axes.append((axis, tables))
        middle = blockers.middle
        self.middle = np.ascontiguousarray(middle.T)
        self.reach = np.linalg.norm(blockers.corners - middle[:, None], axis=2).max(1, initial=0)

    def pack(self, bits: np.ndarray) -> np.ndarray:
        """(n, words) uint64 of (n, K) bool."""
        out = np.zeros((len(bits), 8 * self.words), np.uint8)
        packed = np.packbits(bits, axis=1)
        out[:, : packed.shape[1]] = packed
        return out.view(np.uint64)

    def beyond(self, bodies: Bodies) -> list[np.ndarray]:
        """For each sense of each axis (n, words) bits: the blocker ends before the body begins."""
        eps, out = np.float32(self.blockers.clearance), []
        for axis, tables in self._axes:
            centre, half = bodies.centre @ axis, bodies.reach(axis[None])[:, 0]
            for (ends, table), begin in zip(tables, (centre - half, -(centre + half)), strict=True):
                out.append(table.take(np.searchsorted(ends, begin - eps) // self._step, 0))
        return out


class Shafts:
    """Facts about every body and every blocker, as bits, for the culling of blockers from the shafts between bodies."""

    def __init__(self, bodies: Bodies, index: ShaftIndex):
        self._index, count = index, len(bodies)
        above, below, behind = (np.empty((count, index.words), np.uint64) for _ in range(3))
        # The numbers behind the bits take thirty times their memory: a block of them at a time.
        step = max(1, _FACTS // max(1, len(index.blockers)))
        for low in range(0, count, step):
            here = slice(low, low + step)
            above[here], below[here], behind[here] = _sides(bodies.take(here), index)
        # A blocker is out when one of these bits is set for both bodies, or this one for either.
        self._both, self._either = [*index.beyond(bodies), above, below], behind
        self._balls = bodies.balls()

    def left(self, a: np.ndarray, b: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Blocks of pairs of bodies a and b (n,): the first index, and the bits (m, words) of the blockers that nothing rules out."""
        step = max(1, (1 << 20) // (64 * self._index.words))
        for start in range(0, len(a), step):
            i, j = a[start : start + step], b[start : start + step]
            out = self._either.take(i, 0) | self._either.take(j, 0)
            for bits in self._both:
                out |= bits.take(i, 0) & bits.take(j, 0)
            yield start, ~out & self._index.valid

    def candidates(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Blockers that may stand between bodies a and b (n,). Returns rows (pair, blocker), sorted by pair, int64."""
        pairs, found = [], []
        for start, left in self.left(a, b):
            i, j = a[start : start + len(left)], b[start : start + len(left)]
            # Most words are empty: only the others are taken apart into their bits.
            pair, word = np.nonzero(left)
            row, bit = np.nonzero(np.unpackbits(left[pair, word][:, None].view(np.uint8), axis=1))
            pair, blocker = pair[row], 64 * word[row] + bit
            near = near_axis(self._index, self._balls, self._balls, (i, j), pair, blocker)
            pairs.append(pair[near] + start)
            found.append(blocker[near])
        return (np.concatenate(pairs), np.concatenate(found)) if pairs else (np.zeros(0, np.int64), np.zeros(0, np.int64))


def _sides(bodies: Bodies, index: ShaftIndex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, words) bits each: the body is in front of the blocker's plane; behind it; the blocker is behind the plane of the body."""
    blockers = index.blockers
    eps = np.float32(blockers.clearance)
    height = bodies.centre @ blockers.normal.T
    height -= blockers.offset[:, 0]
    half = bodies.reach(blockers.normal) if bodies.half_u.any() or bodies.radius is not None else np.float32(0)
    top = bodies.normal @ blockers.corners[:, 0].T
    for k in range(1, 4):
        np.maximum(top, bodies.normal @ blockers.corners[:, k].T, out=top)
    plane = np.einsum("ij,ij->i", bodies.centre, bodies.normal) + eps
    plane[~bodies.normal.any(1)] = -np.inf
    return index.pack(height - half >= -eps), index.pack(height + half <= eps), index.pack(top <= plane[:, None])


def near_axis(
    index: ShaftIndex,
    a: tuple[np.ndarray, np.ndarray],
    b: tuple[np.ndarray, np.ndarray],
    ends: tuple[np.ndarray, np.ndarray],
    pair: np.ndarray,
    blocker: np.ndarray,
) -> np.ndarray:
    """Rows (r,) of (pair, blocker) whose blocker's ball meets the hull of the balls of both bodies, a cone about the line of their centres.

    a, b : centres (3, n) and radii (n,) float32 of the balls on either side;  ends : (m,) the balls of each pair.
    With slope k = (rb - ra) / L the nearest ball of the cone lies h sqrt(1 - k**2) - r(foot) away from a point at
    height h over the line; where one ball holds the other (k >= 1) every row stays.
    """
    (centre_a, radius_a), (centre_b, radius_b), (i, j) = a, b, ends
    base = centre_a[:, i]
    axis = centre_b[:, j] - base
    length = np.sqrt((axis * axis).sum(0))
    ra = radius_a[i]
    slope = (radius_b[j] - ra) / np.maximum(length, 1e-12)
    axis /= np.maximum(length, 1e-12)
    shrink = np.sqrt(np.maximum(1 - slope * slope, 0))
    shrink *= 1 - np.float32(1e-4)  # room for the rounding of what follows
    along = height2 = np.float32(0)
    for k in range(3):
        offset = index.middle[k].take(blocker)
        offset -= base[k].take(pair)
        along = along + offset * axis[k].take(pair)
        offset *= offset
        height2 = height2 + offset
    height2 -= along * along
    along *= slope[pair]
    along += ra[pair]
    along += index.reach[blocker]
    shrink = shrink[pair]
    return np.flatnonzero((np.sqrt(np.maximum(height2, 0)) * shrink <= along) | (shrink == 0))


@dataclass(frozen=True)
class Cuts:
    """Which segments between two sets of points of n pairs are cut.

    hidden : (n, i, j) bool, some blocker cuts the segment
    alone : (n,) int64, a blocker that cuts all segments of the pair, -1 without: being convex it hides everything between the points too
    """

    hidden: np.ndarray
    alone: np.ndarray


def cut_segments(blockers: Blockers, pair: np.ndarray, blocker: np.ndarray, a: np.ndarray, b: np.ndarray) -> Cuts:
    """Test the segments between the points of two sets against blockers.

    pair, blocker : (r,) rows, ``pair`` sorted;  a : (n, i, 3), b : (n, j, 3) float32 points of each pair
    A segment that ends on the plane of a blocker is not cut by it.
    """
    n, i, j = len(a), a.shape[1], b.shape[1]
    cuts = Cuts(np.zeros((n, i, j), bool), np.full(n, -1))
    flat = cuts.hidden.reshape(n, i * j)
    large = blockers.large[blocker]
    # Large blockers go first: what one of them hides alone needs no more tests. The blockers of both kinds are tested
    # apart: their insides are different inequalities.
    for size, kind in ((True, False), (True, True), (False, False), (False, True)):
        rows = np.flatnonzero((large == size) & (blockers.triangle[blocker] == kind))
        rows = rows[cuts.alone[pair[rows]] < 0]
        step = max(1, _BLOCK // (i * j))
        for start in range(0, len(rows), step):
            here = rows[start : start + step]
            p, k = pair[here], blocker[here]
            cut = _cut(blockers, k, a.take(p, 0), b.take(p, 0), kind).reshape(i * j, len(here))
            first = runs(p)
            flat[p[first]] |= np.logical_or.reduceat(cut, first, axis=1).T
            every = cut.all(0)
            cuts.alone[p[every]] = k[every]
    return cuts


def _cut(blockers: Blockers, k: np.ndarray, a: np.ndarray, b: np.ndarray, triangle: bool) -> np.ndarray:
    """(i, j, r) bool: segment from point i to point j of a row meets the row's blocker. Division-free.

    Rows run fastest in every array: NumPy's inner loops are as long as the block, not as short as a set of points.
    """
    a, b = (np.ascontiguousarray(x.transpose(2, 1, 0)) for x in (a, b))
    ha, hb = (_along(blockers.normal, blockers.offset[:, 0], k, x) for x in (a, b))
    eps = np.float32(blockers.clearance)
    ha[np.abs(ha) <= eps] = 0
    hb[np.abs(hb) <= eps] = 0
    ha, hb = ha[:, None], hb[None]
    span = ha - hb
    hit = (ha * hb) < 0
    inside = []
    for axis, dual in ((1, blockers.dual_x), (2, blockers.dual_y)):
        xa, xb = (_along(dual, blockers.offset[:, axis], k, x) for x in (a, b))
        x = ha * xb[None]
        x -= hb * xa[:, None]
        inside.append(x)
    if triangle:
        sign = np.sign(span)
        x, y = (z * sign for z in inside)
        return hit & (x >= 0) & (y >= 0) & (x + y <= np.abs(span))
    np.abs(span, out=span)
    for x in inside:
        np.abs(x, out=x)
        hit &= x <= span
    return hit


def _along(direction: np.ndarray, offset: np.ndarray, k: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(i, r) coordinate of points (3, i, r) along a direction of blockers k (r,)."""
    d = np.ascontiguousarray(direction.take(k, 0).T)
    out = points[0] * d[0]
    out += points[1] * d[1]
    out += points[2] * d[2]
    out -= offset[k]
    return out


@dataclass(frozen=True)
class Hits:
    """What n rays meet first.

    blocker : (n,) int64, -1 for none;  behind : (n,) bool, it is met from behind its normal
    both : (n,) bool, two faces of opposite sides lie in that place (``blocker`` is the one that faces the ray)
    """

    blocker: np.ndarray
    behind: np.ndarray
    both: np.ndarray


def first_hits(blockers: Blockers, origins: np.ndarray, directions: np.ndarray) -> Hits:
    """What rays from ``origins`` (n, 3) along unit ``directions`` (n, 3), float32, meet.

    A blocker whose plane holds the origin is not met.
    """
    count = len(origins)
    hits = Hits(np.full(count, -1), np.zeros(count, bool), np.zeros(count, bool))
    if not len(blockers):
        return hits
    step = max(1, _BLOCK // len(blockers))
    triangle = np.flatnonzero(blockers.triangle)
    for start in range(0, count, step):
        here = slice(start, start + step)
        o, d = origins[here], directions[here]
        height = o @ blockers.normal.T
        height -= blockers.offset[:, 0]
        clear = np.abs(height) > blockers.clearance
        # With w = 1 / distance the places x w and y w in the blocker's frame are linear in the direction: all tests without division.
        w = np.where(clear, -1 / np.where(clear, height, 1), 0)
        w *= d @ blockers.normal.T
        x, y = (_over_distance(o, d, w, dual, blockers.offset[:, k]) for k, dual in ((1, blockers.dual_x), (2, blockers.dual_y)))
        hit = np.maximum(np.abs(x), np.abs(y)) <= w
        if len(triangle):
            a, b, c = x[:, triangle], y[:, triangle], w[:, triangle]
            hit[:, triangle] = (a >= 0) & (b >= 0) & (a + b <= c)
        w *= hit
        front = height > 0
        to_front, to_back = w * front, w * ~front
        nearest, rear = to_front.argmax(1), to_back.argmax(1)
        row = np.arange(len(nearest))
        with np.errstate(divide="ignore"):
            to_front, to_back = 1 / np.maximum(to_front[row, nearest], 0), 1 / np.maximum(to_back[row, rear], 0)
        met, same = np.isfinite(np.minimum(to_front, to_back)), 4 * blockers.clearance
        hits.behind[here] = met & (to_back < to_front - same)
        hits.both[here] = met & (to_back <= to_front + same) & ~hits.behind[here]
        hits.blocker[here] = np.where(met, np.where(hits.behind[here], rear, nearest), -1)
    return hits


def _over_distance(o: np.ndarray, d: np.ndarray, w: np.ndarray, dual: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """(n, K) coordinate along ``dual`` of where rays meet the planes of blockers, over the distance: ``w`` (n, K) times it."""
    out = o @ dual.T
    out -= offset
    out *= w
    out += d @ dual.T
    return out


def hemisphere(count: int) -> np.ndarray:
    """(count, 3) unit directions about +z, cosine-distributed, evenly spread (Fibonacci spiral)."""
    k = np.arange(count) + 0.5
    radius, angle = np.sqrt(k / count), k * (np.pi * (3 - np.sqrt(5)))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(np.maximum(1 - radius**2, 0))], axis=1)


def kronecker(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates x and y (n,) in [0, 1) of the members k (n,) of a two-dimensional Kronecker sequence: any run of it is evenly spread."""
    return (0.5 + k * 0.7548776662466927) % 1, (0.5 + k * 0.5698402909980532) % 1
