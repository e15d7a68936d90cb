"""What touches or pierces a surface covers it: the parts of regions where nothing is to be seen are no surface at all.

The floor under a cupboard is dark, and a wavelet that spans its edge would smear that dark over the floor beside it; the
end of a shelf that reaches into a wall lies in the dark as well. So regions are cut along the edges of what stands on them
and along the lines in which others run through them, and the parts that no light gets to are taken out of their cover,
as are those in whose place a face of another object lies, such as a rug without thickness.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from .box_tree import BoxTree
from .burial import buried
from .grouping import runs, starts_of
from .occlusion import Blockers
from .plane_cuts import alike, cut_along
from .polygons import areas_and_centroids
from .ray_tree import lies_in
from .regions import Regions

CONTACT = 1e-4
"""Edges closer than this (m) to a plane stand on it; in scenes of less than a metre it is this part of their size."""

BLOCK = 1 << 12
"""Regions that are treated at once, and those that the last of their rooms has beyond."""

_Segments = tuple[np.ndarray, np.ndarray, np.ndarray]


def uncover(regions: Regions, blockers: Blockers) -> Regions:
    """The same regions without the parts that are buried under others; ``area`` and ``full`` follow."""
    *_, result = uncovering(regions, blockers)
    return result


def uncovering(regions: Regions, blockers: Blockers) -> Iterator[float | Regions]:
    """As :func:`uncover`; yields the share of the work that is done, at last the regions.

    Only what is in a room covers its surfaces: some rooms are treated at a time, so that what is known of pieces fits into memory.
    """
    contact = CONTACT * min(1.0, float(np.abs(regions.box_max).max(initial=0.0)))
    parts = []
    for first, last in _some_rooms(regions.room):
        pieces = slice(regions.piece_start[first], regions.piece_start[last])
        own = blockers.take(np.arange(pieces.start, pieces.stop))
        parts.append(_uncovered(regions.part(first, last), dataclasses.replace(own, region=own.region - np.int32(first)), contact))
        yield last / len(regions)
    if not parts:
        yield regions
        return
    count = np.concatenate([np.diff(part.cover_start) for part in parts])
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ("buried", "area", "full")}
    cover = np.concatenate(alike(*(part.cover for part in parts)))
    yield dataclasses.replace(regions, cover=cover, cover_start=np.r_[0, np.cumsum(count)], **joined)


def _some_rooms(room: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last region of some rooms together, as few as have ``BLOCK`` regions; ``room`` (G,) is sorted."""
    ends = np.r_[runs(room)[1:], len(room)]
    first = 0
    for last in ends:
        if last - first >= BLOCK or last == len(room):
            yield first, int(last)
            first = int(last)


def _uncovered(regions: Regions, blockers: Blockers, contact: float) -> Regions:
    """As :func:`uncover` does, all at once."""
    original = np.repeat(np.arange(len(regions)), np.diff(regions.cover_start))
    owner, pieces = cut_along(original, regions.cover, *_segments(regions, contact), contact)
    gone = buried(regions, blockers, owner, pieces, contact)
    upon = _upon_others(regions, blockers, owner, pieces, contact) & ~gone
    left = np.bincount(owner[~gone & ~upon], minlength=len(regions))
    gone |= upon & (left[owner] > 0)  # what others cover whole stays: something must receive what they leave between them
    # What is buried whole keeps its cover: a region needs an area, and it receives nothing there anyway.
    rest = np.bincount(owner[~gone], minlength=len(regions))
    whole = np.zeros(len(regions), bool)
    whole[owner[gone & (rest[owner] == 0)]] = True
    gone &= rest[owner] > 0
    changed = np.unique(owner[gone])
    stays = np.isin(owner, changed) & ~gone
    same = ~np.isin(original, changed)
    cover = np.concatenate(alike(regions.cover[same], pieces[stays]))
    whose = np.concatenate([original[same], owner[stays]])
    order = np.argsort(whose, kind="stable")
    area, full = regions.area.copy(), regions.full.copy()
    area[changed] = np.bincount(owner[stays], areas_and_centroids(pieces[stays])[0], minlength=len(regions))[changed]
    full[changed] = False
    return dataclasses.replace(
        regions, buried=whole, cover=cover[order], cover_start=starts_of(whose[order], len(regions)), area=area, full=full
    )


def _segments(regions: Regions, contact: float) -> _Segments:
    """Where others of the room touch or pierce regions: (region, start (n, 2), end (n, 2)) in their frames, sorted by region."""
    owner = regions.piece_region
    p, a, b = regions.piece_origin, regions.piece_a, regions.piece_b
    third = np.where(regions.piece_triangle[:, None], p + b, p + a + b)
    loop = np.stack([regions.world(owner, x) for x in (p, p + a, third, p + b)], axis=1)
    found = [*_contacts(regions, loop, contact), *_crossings(regions, loop, contact)]
    if not found:
        return np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2))
    region, start, end = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(region, kind="stable")
    return region[order], start[order], end[order]


def _contacts(regions: Regions, loop: np.ndarray, contact: float) -> Iterator[_Segments]:
    """Edges of the pieces ``loop`` (K, 4, 3) of other regions of the room that lie in the planes of regions."""
    first = loop.reshape(-1, 3)
    second = np.roll(loop, -1, 1).reshape(-1, 3)
    edge_region = np.repeat(regions.piece_region, 4)
    real = np.linalg.norm(second - first, axis=1) > contact
    first, second, edge_region = first[real], second[real], edge_region[real]
    tree = BoxTree(np.minimum(first, second), np.maximum(first, second), regions.room[edge_region])
    for e, g in tree.overlaps(regions.box_min - contact, regions.box_max + contact, regions.room):
        other = edge_region[e]
        near = (other != g) & (np.abs(_height(regions, g, first[e])) < contact) & (np.abs(_height(regions, g, second[e])) < contact)
        e, g, other = e[near], g[near], other[near]
        # What lies in the plane itself covers when it faces the other way, or goes first; what stands on it must stand in front.
        facing = np.einsum("ij,ij->i", regions.normal[other], regions.normal[g])
        stands = (_height(regions, g, regions.centroid[other]) > contact) | (facing < -1 + 1e-6)
        stands |= (facing > 1 - 1e-6) & _goes_first(regions, other, g)
        yield _within(regions, g[stands], first[e[stands]], second[e[stands]], contact)


def _goes_first(regions: Regions, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) bool: of two faces of one place and side, a is the one that is seen: a lamp, else the smaller one, else the first."""
    rank = np.empty(len(regions), np.int64)
    rank[np.lexsort((np.round(np.log(np.maximum(regions.area, 1e-300)), 6), ~(regions.emission > 0).any(1)))] = np.arange(len(regions))
    return rank[a] < rank[b]


def _upon_others(regions: Regions, blockers: Blockers, owner: np.ndarray, pieces: np.ndarray, contact: float) -> np.ndarray:
    """(n,) bool: in the place of the piece lies a face of another object, to the same side, that goes first."""
    area, moment = areas_and_centroids(pieces)
    middle = regions.world(owner, moment / np.maximum(area, 1e-300)[:, None])
    corners = blockers.corners.astype(np.float64)
    tree = BoxTree(corners.min(1), corners.max(1), regions.room[blockers.region])
    out = np.zeros(len(owner), bool)
    for k, piece in tree.overlaps(middle - contact, middle + contact, regions.room[owner]):
        other, g = blockers.region[k], owner[piece]
        same = (other != g) & (np.einsum("ij,ij->i", regions.normal[other], regions.normal[g]) > 1 - 1e-6)
        k, piece, other, g = k[same], piece[same], other[same], g[same]
        lies = _goes_first(regions, other, g) & lies_in(blockers, k, middle[piece], contact)
        out[piece[lies]] = True
    return out


def _crossings(regions: Regions, loop: np.ndarray, contact: float) -> Iterator[_Segments]:
    """Where the pieces ``loop`` (K, 4, 3) of other regions of the room run through the planes of regions."""
    owner = regions.piece_region
    tree = BoxTree(loop.min(1), loop.max(1), regions.room[owner])
    for k, g in tree.overlaps(regions.box_min, regions.box_max, regions.room):
        other = owner[k] != g
        k, g = k[other], g[other]
        corners = loop[k]
        height = np.stack([_height(regions, g, corners[:, i]) for i in range(4)], axis=1)
        through = np.flatnonzero((height.min(1) < -contact) & (height.max(1) > contact))
        g, corners, height = g[through], corners[through], height[through]
        # A convex outline passes the plane twice, once down and once up.
        above, row = height > 0, np.arange(len(g))
        ends = []
        for leaves in (above & ~np.roll(above, -1, 1), ~above & np.roll(above, -1, 1)):
            i = leaves.argmax(1)
            j = (i + 1) % 4
            part = height[row, i] / (height[row, i] - height[row, j])
            ends.append(corners[row, i] + part[:, None] * (corners[row, j] - corners[row, i]))
        yield _within(regions, g, *ends, contact)


def _height(regions: Regions, region: np.ndarray, position: np.ndarray) -> np.ndarray:
    """(n,) metres of positions (n, 3), relative to the centre of the scene, above the planes of regions (n,)."""
    return _along(regions.normal[region], position, regions.origin[region])


def _along(direction: np.ndarray, position: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """(n,) coordinate of positions along directions (n, 3) from origins."""
    return np.einsum("ij,ij->i", position - origin, direction)


def _within(regions: Regions, region: np.ndarray, first: np.ndarray, second: np.ndarray, contact: float) -> _Segments:
    """The segments from ``first`` to ``second`` (n, 3) that enter the rectangles of regions and do not merely run along their borders."""
    s, t = (
        np.stack([_along(regions.u[region], x, regions.origin[region]), _along(regions.v[region], x, regions.origin[region])], 1)
        for x in (first, second)
    )
    low, high = np.minimum(s, t), np.maximum(s, t)
    inside = ((high > contact) & (low < regions.size[region] - contact)).all(1)
    return region[inside], s[inside], t[inside]
