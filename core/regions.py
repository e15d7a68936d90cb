"""Planar regions: coplanar, adjacent polygons of one material, room and object, merged and framed by a rectangle.

Real buildings arrive as triangles. A wall with a door is one region here: its frame is a rectangle of small area
around it, and its pieces say which part of the rectangle is wall (Holzschuch, Cuny and Alonso, "Wavelet radiosity
on arbitrary planar surfaces", 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import polygons
from .box_tree import BoxTree
from .grouping import components, ragged, starts_of
from .plane_cuts import alike, cut_along, holds
from .polygons import areas_and_centroids
from .scene import Scene

WELD = 1e-5
"""Corners closer than this (m) are the same corner when adjacency is sought."""
PLANE_TOLERANCE = 1e-4
"""Largest distance (m) of a polygon from the plane of the region that it joins."""
_DIRECTIONS = 8
_BLOCK = 1 << 14
"""Rectangles around regions that are compared at once."""


@dataclass(frozen=True)
class Regions:
    """G planar regions, ordered by room. Positions are relative to ``centre`` (float64, metres).

    centre : (3,) of the scene's bounding box;  polygon_region : (P,) int32, -1 for polygons of no area
    origin, u, v, normal : (G, 3), a corner of the rectangle and its right-handed frame (normal = u x v, the front)
    size : (G, 2) of the rectangle along u and v;  area : (G,) covered, m2;  full : (G,) bool, all of it covered
    reflectance, emission : (G, 3);  room : (G,) int32
    piece_start : (G + 1,), pieces of a region: ``piece_origin + s*piece_a + t*piece_b`` in (u, v) coordinates (K, 2),
        triangles (s, t >= 0, s + t <= 1) where ``piece_triangle``, else parallelograms (0 <= s, t <= 1)
    cover_start : (G + 1,), cover : (C, k, 2) convex counter-clockwise polygons of the frame that the region covers: the
        pieces, less what :mod:`footprints` takes out of them; missing corners repeat the last one
    buried : (G,) bool, no light gets to it: nothing but other surfaces' backs, or an unlit hollow, can be seen from it
    box_min, box_max : (G, 3) of the pieces;  centroid : (G, 3) of the pieces
    """

    centre: np.ndarray
    polygon_region: np.ndarray
    origin: np.ndarray
    u: np.ndarray
    v: np.ndarray
    normal: np.ndarray
    size: np.ndarray
    area: np.ndarray
    full: np.ndarray
    reflectance: np.ndarray
    emission: np.ndarray
    room: np.ndarray
    piece_start: np.ndarray
    piece_origin: np.ndarray
    piece_a: np.ndarray
    piece_b: np.ndarray
    piece_triangle: np.ndarray
    cover_start: np.ndarray
    cover: np.ndarray
    buried: np.ndarray
    box_min: np.ndarray
    box_max: np.ndarray
    centroid: np.ndarray

    def __len__(self) -> int:
        return len(self.room)

    @property
    def piece_region(self) -> np.ndarray:
        """(K,) region of every piece."""
        return np.repeat(np.arange(len(self)), np.diff(self.piece_start))

    def world(self, region: np.ndarray, uv: np.ndarray) -> np.ndarray:
        """(n, 3) positions, relative to ``centre``, of coordinates (n, 2) in the frames of ``region`` (n,)."""
        return self.origin.take(region, 0) + uv[:, :1] * self.u.take(region, 0) + uv[:, 1:] * self.v.take(region, 0)

    def part(self, first: int, last: int) -> Regions:
        """The regions from ``first`` to before ``last`` alone, numbered from 0."""
        own = ("origin", "u", "v", "normal", "size", "area", "full", "reflectance", "emission", "room", "buried")
        own += ("box_min", "box_max", "centroid")
        pieces, covers = (slice(start[first], start[last]) for start in (self.piece_start, self.cover_start))
        rows = dict.fromkeys(own, slice(first, last)) | {"cover": covers}
        rows |= dict.fromkeys(("piece_origin", "piece_a", "piece_b", "piece_triangle"), pieces)
        arrays = {name: getattr(self, name)[here] for name, here in rows.items()}
        for name in ("piece_start", "cover_start"):
            start = getattr(self, name)[first : last + 1]
            arrays[name] = start - start[0]
        inside = (self.polygon_region >= first) & (self.polygon_region < last)
        polygon_region = np.where(inside, self.polygon_region - first, -1).astype(np.int32)
        return Regions(self.centre, polygon_region, **arrays)

    def local(self, region: np.ndarray, position: np.ndarray) -> np.ndarray:
        """(n, 2) frame coordinates of world positions (n, 3), projected to the region's plane."""
        offset = position - self.centre - self.origin[region]
        return np.stack([np.einsum("ij,ij->i", offset, self.u[region]), np.einsum("ij,ij->i", offset, self.v[region])], axis=1)


def merge(scene: Scene) -> Regions:
    """Merge the polygons of a scene into planar regions."""
    centre = 0.5 * (scene.vertices.min(0) + scene.vertices.max(0))
    pieces = polygons.decompose(scene)
    vectors = polygons.area_vectors(scene)
    original = _originals(scene, vectors)
    polygon_region = _coplanar_components(scene, pieces, vectors, original)
    region = polygon_region[pieces.polygon]
    count = int(polygon_region.max(initial=-1)) + 1
    order = np.argsort(region, kind="stable")
    region = region[order]
    corners, corner_piece = _corners(pieces.origin[order] - centre, pieces.a[order], pieces.b[order], pieces.triangle[order])
    normal = np.zeros((count, 3))
    used = np.flatnonzero((polygon_region >= 0) & (original == np.arange(len(original))))
    np.add.at(normal, polygon_region[used], vectors[used])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    u = _frame_direction(region, pieces.a[order], pieces.b[order], pieces.triangle[order], normal, corners, corner_piece)
    v = np.cross(normal, u)
    owner = region[corner_piece]
    flat = np.stack([np.einsum("ij,ij->i", corners, u[owner]), np.einsum("ij,ij->i", corners, v[owner])], axis=1)
    low, high = _extents(flat, owner, count)
    height = np.zeros(count)  # mean, so that a region bent within the tolerance is split evenly by its plane
    np.add.at(height, owner, np.einsum("ij,ij->i", corners, normal[owner]))
    height /= np.bincount(owner, minlength=count)
    origin = low[:, :1] * u + low[:, 1:] * v + height[:, None] * normal
    to_uv = lambda x: np.stack([np.einsum("ij,ij->i", x, u[region]), np.einsum("ij,ij->i", x, v[region])], axis=1)  # noqa: E731
    piece = (to_uv(pieces.origin[order] - centre) - low[region], to_uv(pieces.a[order]), to_uv(pieces.b[order]), pieces.triangle[order])
    region, piece = _once(region, piece)
    size = np.maximum(high - low, 1e-9)
    cover_region, cover, split = _apart(region, _outlines(*piece))
    flat_area, moment = areas_and_centroids(cover)
    area = np.minimum(np.bincount(cover_region, flat_area, minlength=count), size.prod(1))
    full = area >= (1 - 1e-6) * size.prod(1)
    centroid = np.stack([np.bincount(cover_region, moment[:, k], minlength=count) for k in (0, 1)], 1) / np.maximum(area, 1e-300)[:, None]
    region, piece = _simplify(region, piece, full, size)
    # Simpler pieces are the simpler cover, but for those that lie upon each other.
    kept, simple = np.isin(cover_region, split) & ~full[cover_region], ~np.isin(region, split) | full[region]
    cover = np.concatenate(alike(_outlines(*piece)[simple], cover[kept]))
    cover_region = np.concatenate([region[simple], cover_region[kept]])
    cover = cover[np.argsort(cover_region, kind="stable")]
    first = np.full(count, scene.polygon_count)
    np.minimum.at(first, polygon_region[used], used)
    box_low, box_high = _extents(corners, owner, count)
    return Regions(
        centre, polygon_region.astype(np.int32), origin, u, v, normal, size, area, full,
        scene.reflectance[first], scene.emission[first], scene.room[first].astype(np.int32),
        starts_of(region, count), *piece, starts_of(np.sort(cover_region), count), cover,
        np.zeros(count, bool), box_low, box_high, origin + centroid[:, :1] * u + centroid[:, 1:] * v,
    )  # fmt: skip


def _welded(scene: Scene) -> np.ndarray:
    """(C,) number of the place of every corner: corners closer than about ``WELD`` share one."""
    cell = np.round((scene.vertices - scene.vertices.min(0)) / WELD).astype(np.int64)
    return np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1)[scene.corner_vertex]


def _originals(scene: Scene, vectors: np.ndarray) -> np.ndarray:
    """(P,) of polygons of a room with the same corners and front the one that counts: the first that shines, else the first.

    Which of them is seen is chance, but they must not receive or send light once more.
    """
    polygon = polygons.loop_polygon(scene)[np.repeat(np.arange(len(scene.loop_start) - 1), np.diff(scene.loop_start))]
    # Each place has a number of 64 bits as good as random: sums of them are the same for the same corners only.
    mixed = (_welded(scene).astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(32)
    key = np.zeros(scene.polygon_count, np.uint64)
    np.add.at(key, polygon, mixed)
    facing = vectors @ np.array([0.5377, 0.3183, 0.7808]) > 0  # faces in one place lie either way of any direction
    dark = (scene.emission <= 0).all(1)
    order = np.lexsort((dark, facing, scene.room, key))
    columns = [x[order] for x in (key, scene.room, facing)]
    new = np.r_[True, np.any([x[1:] != x[:-1] for x in columns], axis=0)][: len(order)]
    out = np.empty(len(order), np.int64)
    out[order] = order[np.flatnonzero(new)[np.cumsum(new) - 1]]
    return out


def _coplanar_components(scene: Scene, pieces: polygons.Pieces, vectors: np.ndarray, original: np.ndarray) -> np.ndarray:
    """(P,) region of every polygon, -1 without area; regions are ordered by room, then by their first polygon."""
    count = scene.polygon_count
    area = np.linalg.norm(vectors, axis=1)
    alive = np.zeros(count, bool)
    alive[pieces.polygon] = True
    alive &= original == np.arange(count)
    unit = vectors / np.maximum(area, 1e-300)[:, None]
    corner_polygon = polygons.loop_polygon(scene)[np.repeat(np.arange(len(scene.loop_start) - 1), np.diff(scene.loop_start))]
    a = _welded(scene)
    following = np.arange(len(a)) + 1
    following[scene.loop_start[1:] - 1] = scene.loop_start[:-1]
    b = a[following]
    key = np.minimum(a, b) * (a.max(initial=0) + 1) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    pairs = [
        (order[:-step][same], order[step:][same])
        for step in (1, 2, 3)  # an edge of two crossing walls has four faces: compare each with the next three
        for same in [key[order[:-step]] == key[order[step:]]]
    ]
    left, right = (np.concatenate(side) for side in zip(*pairs, strict=True))
    p, q = corner_polygon[left], corner_polygon[right]
    start = scene.vertices[scene.corner_vertex[scene.loop_start[scene.polygon_start[:-1]]]]
    offset = start[q] - start[p]
    joined = (
        alive[p] & alive[q] & (scene.room[p] == scene.room[q]) & (scene.object[p] == scene.object[q])
        & (np.einsum("ij,ij->i", unit[p], unit[q]) > 1 - 1e-8)
        & (np.abs(np.einsum("ij,ij->i", offset, unit[p])) < PLANE_TOLERANCE)
        & (scene.reflectance[p] == scene.reflectance[q]).all(1) & (scene.emission[p] == scene.emission[q]).all(1)
    )  # fmt: skip
    label = components(count, p[joined], q[joined])
    used = np.flatnonzero(alive)
    first = np.full(count, count)
    np.minimum.at(first, label[used], used)
    ids = np.flatnonzero(first < count)
    rank = np.full(count, -1)
    rank[ids[np.lexsort((first[ids], scene.room[first[ids]]))]] = np.arange(len(ids))
    return np.where(alive[original], rank[label[original]], -1)


def _corners(origin, a, b, triangle):
    """All corners (n, 3) of pieces and the piece of each (three of a triangle, four of a parallelogram)."""
    corners = np.stack([origin, origin + a, origin + b, origin + a + b], axis=1)
    keep = np.ones(corners.shape[:2], bool)
    keep[:, 3] = ~triangle
    return corners[keep], np.repeat(np.arange(len(origin)), keep.sum(1))


def _extents(values: np.ndarray, owner: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest row of values (n, d) per owner; owners are sorted and each has one row at least."""
    if not len(values):
        return np.zeros((count, values.shape[1])), np.zeros((count, values.shape[1]))
    starts = starts_of(owner, count)[:-1]
    return np.minimum.reduceat(values, starts, axis=0), np.maximum.reduceat(values, starts, axis=0)


def _frame_direction(region, a, b, triangle, normal, corners, corner_piece):
    """(G, 3) unit direction u of the smallest rectangle along one of the longest edge directions of each region."""
    count = len(normal)
    helper = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    helper /= np.linalg.norm(helper, axis=1, keepdims=True)
    other = np.cross(normal, helper)
    edge = np.concatenate([a, b, np.where(triangle[:, None], b - a, 0)])
    owner = np.tile(region, 3)
    x, y = np.einsum("ij,ij->i", edge, helper[owner]), np.einsum("ij,ij->i", edge, other[owner])
    length = np.hypot(x, y)
    angle = np.mod(np.arctan2(y, x), np.pi / 2)
    bins = 2048
    slot = np.round(angle * (bins / (np.pi / 2))).astype(np.int64) % bins
    # The edges of one bin speak with one voice, that of the longest; the bins with most edge length are tried.
    order = np.lexsort((-length, slot, owner))
    key = (owner * bins + slot)[order]
    lead = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    total = np.add.reduceat(length[order], lead)
    group, direction = owner[order][lead], angle[order][lead]
    best = np.lexsort((-total, group))
    group, direction = group[best], direction[best]
    rank = np.arange(len(group)) - starts_of(group, count)[group]
    group, direction = group[rank < _DIRECTIONS], direction[rank < _DIRECTIONS]
    candidate = np.cos(direction)[:, None] * helper[group] + np.sin(direction)[:, None] * other[group]
    corner_start = starts_of(region[corner_piece], count)
    rectangle = np.empty(len(group))
    for begin in range(0, len(group), _BLOCK):  # many regions have many corners: all at once would take more memory than all regions do
        g, u = group[begin : begin + _BLOCK], candidate[begin : begin + _BLOCK]
        v = np.cross(normal[g], u)
        members, row = ragged(corner_start[g], np.diff(corner_start)[g])
        place = corners[members]
        low, high = _extents(np.stack([np.einsum("ij,ij->i", place, axis[row]) for axis in (u, v)], axis=1), row, len(g))
        rectangle[begin : begin + _BLOCK] = (high - low).prod(1)
    # A later direction must be better by more than rounding, or equal rectangles would be framed by chance.
    rounded = np.round(np.log(np.maximum(rectangle, 1e-30)), 6)
    chosen = np.lexsort((np.arange(len(group)), rounded, group))
    return candidate[chosen[starts_of(group[chosen], count)[:-1]]]


def _once(region, piece):
    """The pieces without those that are there already: a face that a scene holds twice is one surface."""
    corners = _outlines(*piece).mean(1)
    spans = np.sort(np.abs(np.concatenate([piece[1] + piece[2], piece[1] - piece[2]], axis=1)), axis=1)
    key = np.column_stack([region, np.round(corners / WELD), np.round(spans / WELD), piece[3]])
    first = np.sort(np.unique(key, axis=0, return_index=True)[1])
    return region[first], tuple(x[first] for x in piece)


def _apart(region, cover):
    """The outlines (n, 4, 2) with what lies on an earlier one of their region taken out: region (m,), outlines, and the regions changed."""
    tree = BoxTree(cover.min(1), cover.max(1), region)
    found = [np.stack(pair) for pair in tree.overlaps(cover.min(1), cover.max(1), region)]
    first, later = np.concatenate([np.zeros((2, 0), np.int64), *(pair[:, pair[0] < pair[1]] for pair in found)], axis=1)
    upon = np.flatnonzero(~_beside(cover[first], cover[later]) & ~_beside(cover[later], cover[first]))
    if not len(upon):
        return region, cover, np.zeros(0, np.int64)
    first, later = first[upon], later[upon]
    start = cover[first]
    owner, parts = cut_along(
        np.arange(len(cover)), cover, np.repeat(later, 4), start.reshape(-1, 2), np.roll(start, -1, 1).reshape(-1, 2), WELD
    )
    area, moment = areas_and_centroids(parts)
    middle = moment / np.maximum(area, 1e-300)[:, None]
    order = np.argsort(later, kind="stable")
    pair, part = ragged(starts_of(later[order], len(cover))[owner], np.bincount(later, minlength=len(cover))[owner])
    inside = holds(cover[first[order[pair]]], middle[part][:, None], 0.0)[:, 0]
    stays = np.bincount(part, inside, minlength=len(parts)) == 0
    return region[owner[stays]], parts[stays], np.unique(region[later])


def _beside(a, b):
    """(n,) bool: an edge of the first outline (n, 4, 2) has all of the second on its outside, but for less than ``WELD``."""
    edge = np.roll(a, -1, 1) - a
    length = np.linalg.norm(edge, axis=2)
    offset = b[:, None] - a[:, :, None]
    height = edge[..., None, 0] * offset[..., 1] - edge[..., None, 1] * offset[..., 0]
    return ((height.max(2) <= WELD * length) & (length > 0)).any(1)


def _simplify(region, piece, full, size):
    """Fewer pieces for the same cover: one rectangle where it is full, else boxes along the frame joined in runs."""
    origin, a, b, triangle = piece
    keep = ~full[region]
    whole = np.flatnonzero(full)
    zero = np.zeros(len(whole))
    parts = [(whole, np.zeros((len(whole), 2)), np.stack([size[whole, 0], zero], 1), np.stack([zero, size[whole, 1]], 1), zero > 0)]
    scale = 1e-6 * (np.abs(a).sum(1) + np.abs(b).sum(1))
    along = (np.abs(a[:, 1]) < scale) & (np.abs(b[:, 0]) < scale) | (np.abs(a[:, 0]) < scale) & (np.abs(b[:, 1]) < scale)
    boxed = keep & ~triangle & along
    other = keep & ~boxed
    parts.append((region[other], origin[other], a[other], b[other], triangle[other]))
    low = origin[boxed] + np.minimum(a[boxed], 0) + np.minimum(b[boxed], 0)
    high = origin[boxed] + np.maximum(a[boxed], 0) + np.maximum(b[boxed], 0)
    owner = region[boxed]
    for axis in (0, 1):
        owner, low, high = _join_runs(owner, low, high, axis)
    zero = np.zeros(len(owner))
    extent = high - low
    parts.append((owner, low, np.stack([extent[:, 0], zero], 1), np.stack([zero, extent[:, 1]], 1), zero > 0))
    region, *piece = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(region, kind="stable")
    return region[order], tuple(x[order] for x in piece)


def _outlines(origin, a, b, triangle):
    """(K, 4, 2) corners of pieces, counter-clockwise; the last of a triangle repeated."""
    corners = np.stack([origin, origin + a, np.where(triangle[:, None], origin + b, origin + a + b), origin + b], axis=1)
    flip = _cross(a, b) < 0
    corners[flip] = corners[flip, ::-1]
    return corners


def _join_runs(owner, low, high, axis):
    """Join boxes of one owner that touch along ``axis`` and agree across it."""
    if not len(owner):
        return owner, low, high
    across = 1 - axis
    grid = 1e-6
    key = np.round(np.stack([low[:, across], high[:, across]], 1) / grid)
    order = np.lexsort((low[:, axis], key[:, 1], key[:, 0], owner))
    owner, low, high, key = owner[order], low[order], high[order], key[order]
    joined = (owner[1:] == owner[:-1]) & (key[1:] == key[:-1]).all(1) & (np.abs(low[1:, axis] - high[:-1, axis]) < 2 * grid)
    first = np.flatnonzero(np.r_[True, ~joined])
    last = np.r_[first[1:] - 1, len(owner) - 1]
    low, top = low[first], high[last].copy()
    top[:, across] = high[first][:, across]
    return owner[first], low, top


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
