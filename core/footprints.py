"""What stands on a surface covers it: the parts of regions that furniture touches see no light and are no surface at all.

The floor under a cupboard is dark, and a wavelet that spans its edge would smear that dark over the floor beside it.
So regions are cut along the edges of what stands on them, and the parts that see nothing but backs of surfaces are taken
out of their cover.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from .grouping import ragged, starts_of
from .occlusion import Blockers, first_hits, hemisphere
from .polygons import areas_and_centroids, clip_half
from .regions import Regions

CONTACT = 1e-4
"""Edges closer than this (m) to a plane stand on it."""
_RAYS = 8
_CORNERS = 12


def uncover(regions: Regions, blockers: Blockers) -> Regions:
    """The same regions without the parts that are buried under others; ``area`` and ``full`` follow."""
    owner, pieces = _cut_along(np.repeat(np.arange(len(regions)), np.diff(regions.cover_start)), regions.cover, *_contacts(regions))
    gone = _buried(regions, blockers, owner, pieces)
    # What is buried whole keeps its cover: a region needs an area, and it receives nothing there anyway.
    rest = np.bincount(owner[~gone], minlength=len(regions))
    buried = np.zeros(len(regions), bool)
    buried[owner[gone & (rest[owner] == 0)]] = True
    gone &= rest[owner] > 0
    changed = np.unique(owner[gone])
    stays = np.isin(owner, changed) & ~gone
    original = np.repeat(np.arange(len(regions)), np.diff(regions.cover_start))
    same = ~np.isin(original, changed)
    cover = np.concatenate([_padded(regions.cover[same]), pieces[stays]])
    whose = np.concatenate([original[same], owner[stays]])
    order = np.argsort(whose, kind="stable")
    area, full = regions.area.copy(), regions.full.copy()
    area[changed] = np.bincount(owner[stays], areas_and_centroids(pieces[stays])[0], minlength=len(regions))[changed]
    full[changed] = False
    return dataclasses.replace(
        regions, buried=buried, cover=cover[order], cover_start=starts_of(whose[order], len(regions)), area=area, full=full
    )


def _contacts(regions: Regions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segments (region, start (n, 2), end (n, 2)) in the frames of regions: edges of other regions of the room that lie in their planes."""
    owner = regions.piece_region
    p, a, b = regions.piece_origin, regions.piece_a, regions.piece_b
    third = np.where(regions.piece_triangle[:, None], p + b, p + a + b)
    loop = np.stack([regions.world(owner, x) for x in (p, p + a, third, p + b)], axis=1)
    first = loop.reshape(-1, 3)
    second = np.roll(loop, -1, 1).reshape(-1, 3)
    edge_region = np.repeat(owner, 4)
    real = np.linalg.norm(second - first, axis=1) > CONTACT
    first, second, edge_region = first[real], second[real], edge_region[real]
    order = np.argsort(regions.room[edge_region], kind="stable")
    first, second, edge_region = first[order], second[order], edge_region[order]
    edges = starts_of(regions.room[edge_region], int(regions.room.max()) + 1)
    found = []
    # Every region against every edge of its room, a block of regions at a time.
    counts = np.diff(edges)[regions.room]
    block = np.cumsum(counts) // (1 << 21)
    for members in np.split(np.arange(len(regions)), np.flatnonzero(np.diff(block)) + 1):
        e, k = ragged(edges[regions.room[members]], counts[members])
        g = members[k]
        normal, origin = regions.normal[g], regions.origin[g]
        near = np.flatnonzero(np.abs(np.einsum("ij,ij->i", first[e] - origin, normal)) < CONTACT)
        e, g = e[near], g[near]
        near = np.abs(np.einsum("ij,ij->i", second[e] - regions.origin[g], regions.normal[g])) < CONTACT
        e, g = e[near], g[near]
        other = edge_region[e]
        # What lies in the plane itself covers only when it faces the other way; what stands on it must stand in front.
        facing = np.einsum("ij,ij->i", regions.normal[other], regions.normal[g])
        middle = np.einsum("ij,ij->i", regions.centroid[other] - regions.origin[g], regions.normal[g])
        stands = (other != g) & ((middle > CONTACT) | (facing < -1 + 1e-6))
        e, g = e[stands], g[stands]
        s, t = (_flat(regions, g, x[e]) for x in (first, second))
        crosses = _inside_frame(s, t, regions.size[g])
        found.append((g[crosses], s[crosses], t[crosses]))
    region, start, end = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(region, kind="stable")
    return region[order], start[order], end[order]


def _flat(regions: Regions, region: np.ndarray, position: np.ndarray) -> np.ndarray:
    offset = position - regions.origin[region]
    return np.stack([np.einsum("ij,ij->i", offset, regions.u[region]), np.einsum("ij,ij->i", offset, regions.v[region])], axis=1)


def _inside_frame(s: np.ndarray, t: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(n,) bool: the segment enters the open rectangle 0..size and does not merely run along its border."""
    low, high = np.minimum(s, t), np.maximum(s, t)
    return ((high > CONTACT) & (low < size - CONTACT)).all(1)


def _cut_along(owner, pieces, region, start, end):
    """Convex pieces (n, k, 2) cut by the lines of the segments that cross them: one segment of every region at a time."""
    rank = np.arange(len(region)) - np.searchsorted(region, region)
    pieces = _padded(pieces)
    for turn in range(int(rank.max(initial=-1)) + 1):
        now = np.flatnonzero(rank == turn)
        line = np.full(int(owner.max()) + 1, -1)
        line[region[now]] = now
        mine = line[owner]
        rows = np.flatnonzero(mine >= 0)
        s, t = start[mine[rows]], end[mine[rows]]
        along = t - s
        length = np.linalg.norm(along, axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], 1) / length[:, None]
        height = np.einsum("nkd,nd->nk", pieces[rows] - s[:, None], across)
        both = (height.min(1) < -CONTACT) & (height.max(1) > CONTACT)
        # The line splits a piece only if the segment itself runs through it.
        inner = np.stack([s + f * along for f in (0.02, 0.25, 0.5, 0.75, 0.98)], axis=1)
        both &= _holds(pieces[rows], inner).any(1) | _crosses_border(pieces[rows], s, t)
        cut = rows[both]
        if len(cut):
            upper, lower = clip_half(pieces[cut], height[both]), clip_half(pieces[cut], -height[both])
            stay = np.ones(len(owner), bool)
            stay[cut] = False
            owner = np.concatenate([owner[stay], owner[cut], owner[cut]])
            pieces = np.concatenate([pieces[stay], _padded(upper), _padded(lower)])
    order = np.argsort(owner, kind="stable")
    return owner[order], pieces[order]


def _padded(pieces: np.ndarray) -> np.ndarray:
    """Pieces with exactly ``_CORNERS`` corner slots: repeated corners go first, then none is left to drop."""
    k = pieces.shape[1]
    if k < _CORNERS:
        return np.concatenate([pieces, np.repeat(pieces[:, -1:], _CORNERS - k, 1)], axis=1)
    distinct = np.ones(pieces.shape[:2], bool)
    distinct[:, 1:] = (np.abs(np.diff(pieces, axis=1)) > 1e-9).any(2)
    order = np.argsort(~distinct, axis=1, kind="stable")[:, :_CORNERS]
    last = np.minimum(np.arange(_CORNERS), np.maximum(distinct.sum(1) - 1, 0)[:, None])
    return np.take_along_axis(pieces, np.take_along_axis(order, last, 1)[..., None], 1)


def _holds(pieces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, j) bool: points (n, j, 2) strictly inside counter-clockwise convex pieces (n, k, 2)."""
    edge = np.roll(pieces, -1, 1) - pieces
    offset = points[:, None] - pieces[:, :, None]
    side = edge[:, :, None, 0] * offset[..., 1] - edge[:, :, None, 1] * offset[..., 0]
    length = np.linalg.norm(edge, axis=2)
    return ((side > CONTACT * length[..., None]) | (length[..., None] < 1e-9)).all(1)


def _crosses_border(pieces: np.ndarray, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(n,) bool: the segment properly crosses an edge of the convex piece."""
    q = np.roll(pieces, -1, 1)
    cross = lambda a, b, c: (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])  # noqa: E731
    s, t = s[:, None], t[:, None]
    eps = CONTACT * CONTACT
    one = (cross(pieces, q, s) * cross(pieces, q, t)) < -eps * eps
    two = (cross(s, t, pieces) * cross(s, t, q)) < -eps * eps
    return (one & two).any(1)


def _buried(regions: Regions, blockers: Blockers, owner: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """(n,) bool: rays from the middle of the piece meet no front of a surface, but backs, or nothing behind a face that lies on it."""
    area, moment = areas_and_centroids(pieces)
    middle = moment / np.maximum(area, 1e-300)[:, None]
    origin = regions.world(owner, middle)
    u, v, normal = regions.u[owner], regions.v[owner], regions.normal[owner]
    gone = np.zeros(len(owner), bool)
    blocker_room = regions.room[blockers.region]
    order = np.argsort(regions.room[owner], kind="stable")
    room = regions.room[owner[order]]
    local = hemisphere(_RAYS)
    for rows in np.split(order, np.flatnonzero(np.diff(room)) + 1):
        near = blockers.take(np.flatnonzero(blocker_room == regions.room[owner[rows[0]]]))
        twin = _has_twin(near, origin[rows], normal[rows])
        frame = np.stack([u[rows], v[rows], normal[rows]], axis=1)
        # One ray clears nearly all; only what sees a back by it is looked at all around.
        left = np.arange(len(rows))
        for count in (1, _RAYS):
            rays = np.einsum("rk,nkd->nrd", local[:count], frame[left]).reshape(-1, 3).astype(np.float32)
            hits = first_hits(near, np.repeat(origin[rows[left]], count, 0).astype(np.float32), rays)
            # Rays pass through a twin. One side of a wall without thickness sees the room all the same; the underside of a
            # cupboard looks into the floor, where there is nothing. What two faces share is no sign of either.
            hidden = hits.behind | ((hits.blocker < 0) & np.repeat(twin[left], count))
            hidden, neither = hidden.reshape(-1, count), hits.both.reshape(-1, count)
            left = left[(hidden | neither).all(1) & (hidden.any(1) | (count == 1))]
        gone[rows[left]] = True
    return gone


def _has_twin(blockers: Blockers, origin: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(n,) bool: a blocker that faces the other way holds the point in its plane and inside it."""
    height = np.abs(origin @ blockers.normal.T - blockers.offset[:, 0])
    x, y = origin @ blockers.dual_x.T - blockers.offset[:, 1], origin @ blockers.dual_y.T - blockers.offset[:, 2]
    inside = np.where(blockers.triangle[None], (x >= 0) & (y >= 0) & (x + y <= 1), (np.abs(x) <= 1) & (np.abs(y) <= 1))
    return ((height < CONTACT) & (normal @ blockers.normal.T < -1 + 1e-6) & inside).any(1)
