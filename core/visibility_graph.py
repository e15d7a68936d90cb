"""The cluster visibility graph: which clusters may see each other through chains of portals (paper, section 5).

From the box of a cluster, the light that passes a portal stays behind one supporting plane per edge of the portal:
the plane through that edge with the portal on one side and the box, touched, on the other. Clusters of the next room
outside any of the planes, or behind the portal, cannot be seen. Every further portal of that room is clipped by the planes
to a smaller window, supporting planes are laid from the box, and from the window before, to the smaller window, and so on.
A room is not entered twice on one path: cutting the loop out of a line's path leaves portals that the line still
crosses in their order, so the shorter path finds the pair as well. Results are united over paths. Seeing is mutual
and either direction alone misses nothing, so a pair stays only when both directions found it.

The test is conservative: it keeps pairs that cannot see each other, and loses none that can.

``volumes`` names how the space behind a portal is bounded. ``"windows"``: as above. ``"boxes"``: as in the paper, where a
portal that is no upright rectangle, and what is left of a portal once it is clipped, is taken as its bounding box, and
the planes run from the cluster's box alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .clustering import ClusterItems, Clusters, cells
from .grouping import ragged, starts_of
from .options import Options
from .portal_world import MAX_CORNERS, PortalWorld, frames
from .scene import Portals
from .sight_planes import Windows, clipped, joined, least, supporting_planes

MAX_PORTALS = 64
"""Longest chain of portals that is followed; where one goes on, all that is connected counts as visible."""
_BLOCK = 1 << 13
"""Windows that are worked on at once."""
_BLOCK_BOXES = 1 << 20
"""Boxes, or corners, times planes that are compared at once."""
_BLOCK_BYTES = 1 << 23
"""Rows of the graph that are built at once, bytes."""
_ONES = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.int64)


@dataclass(frozen=True)
class VisibilityGraph:
    """Potentially visible sets of C clusters; symmetric, and every cluster sees all of its own room and itself.

    bits : (C, ceil(C / 8)) uint8, row c holds the set of c, first cluster in the highest bit (``np.packbits``)
    pvs_polygons : (C,) int64, polygons of all clusters in the set
    """

    bits: np.ndarray
    pvs_polygons: np.ndarray

    def __len__(self) -> int:
        return len(self.bits)

    @property
    def degrees(self) -> np.ndarray:
        """(C,) int64: other clusters in the set of each."""
        return _ONES[self.bits].sum(axis=1) - 1

    def neighbours(self, c: int) -> np.ndarray:
        """(n,) int64 clusters in the set of ``c``, rising, ``c`` among them."""
        return np.flatnonzero(np.unpackbits(self.bits[c], count=len(self)))

    def sees(self, a: np.ndarray | int, b: np.ndarray | int) -> np.ndarray:
        """bool of the common shape of ``a`` and ``b``: may the clusters see each other?"""
        b = np.asarray(b)
        return (self.bits[a, b >> 3] >> (7 - (b & 7)) & 1).astype(bool)

    def lists(self) -> tuple[np.ndarray, np.ndarray]:
        """All sets one after another: (start (C + 1,) int64, clusters (sum,) int32), the form for walking sparse graphs."""
        rows = max(1, _BLOCK_BYTES // max(1, len(self)))
        owners, members = [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
        for low in range(0, len(self), rows):
            owner, member = np.nonzero(np.unpackbits(self.bits[low : low + rows], axis=1, count=len(self)))
            owners.append(owner + low)
            members.append(member.astype(np.int32))
        return starts_of(np.concatenate(owners), len(self)), np.concatenate(members)


def build(
    clusters: Clusters, portals: Portals, room_names: Sequence[str], volumes: str = "windows", items: ClusterItems | None = None
) -> tuple[VisibilityGraph, tuple[str, ...]]:
    """The graph of all clusters, and sentences about what was cut short.

    Boxes and portals must be in one frame. Portals are convex polygons with a depth (``scene_checks.check`` sees to that),
    their normals run from the first to the second room; those to the outside lead nowhere and those without area let
    nothing pass. ``volumes`` is ``"windows"`` or ``"boxes"``. The graph of cells is that of ``clustering.cells``. With the
    ``items`` that the clusters are of, walls that lie around a door in its plane are known to be beside it.
    """
    world = PortalWorld(clusters, portals, len(room_names), volumes == "boxes", items)
    count = len(clusters)
    bits = np.zeros((count, (count + 7) // 8), np.uint8)
    findings: list[str] = []
    rows = max(1, _BLOCK_BYTES // max(1, count))
    for low in range(0, count, rows):
        seen = np.zeros((min(rows, count - low), count), bool)
        _look(world, low, seen, room_names, findings)
        bits[low : low + len(seen)] = np.packbits(seen, axis=1)
    _keep_mutual(bits, count)
    return VisibilityGraph(bits, weights(bits, clusters.polygons)), tuple(findings)


def build_as_chosen(
    clusters: Clusters, items: ClusterItems, portals: Portals, room_names: Sequence[str], options: Options
) -> tuple[VisibilityGraph, tuple[str, ...]]:
    """:func:`build` with the choices of a user: where cells (whole rooms) emit, they are what sees and is seen."""
    if options.emitters != "cells":
        return build(clusters, portals, room_names, options.volumes, items)
    rooms = cells(items, len(room_names))
    graph, findings = build(rooms, portals, room_names, options.volumes, items)
    return _spread(graph, rooms, clusters), findings


def _spread(graph: VisibilityGraph, rooms: Clusters, clusters: Clusters) -> VisibilityGraph:
    """The graph of cells as one of clusters of the same items: each sees all of every room that its own room sees."""
    cell = np.zeros(1 + clusters.room.max(initial=0), np.int64)
    cell[rooms.room] = np.arange(len(rooms))
    column = cell[clusters.room]
    by_cell = np.empty((len(rooms), (len(clusters) + 7) // 8), np.uint8)
    for k in range(len(rooms)):
        by_cell[k] = np.packbits(np.unpackbits(graph.bits[k], count=len(rooms))[column])
    return VisibilityGraph(by_cell[column], graph.pvs_polygons[column])


def first_windows(world: PortalWorld, source: np.ndarray) -> Windows:
    """The whole portals of their own rooms that clusters (n,) look through."""
    room = world.room[source]
    portal, owner = ragged(world.portal_start[room], np.diff(world.portal_start)[room])
    return Windows(source[owner], portal, world.window[portal], None, portal[:, None], np.full(len(portal), -1))


def seen_behind(world: PortalWorld, front: Windows, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All (window, cluster): clusters of the room behind whose box is not wholly outside one of the window's ``planes`` (N, k, 4).

    Sorted by window within a room.
    """
    room = world.target[front.portal]
    order = np.argsort(room, kind="stable")
    owners, members = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for group in np.split(order, np.flatnonzero(np.diff(room[order])) + 1) if len(order) else []:
        behind = world.by_room[slice(*world.room_start[room[group[0]] + np.arange(2)])]
        extent = np.concatenate([world.centre[behind], world.half[behind]], axis=1).T
        step = max(1, _BLOCK_BOXES // max(1, planes.shape[1] * len(behind)))
        for rows in (group[i : i + step] for i in range(0, len(group), step)):
            plane = planes[rows]
            nearest = np.concatenate([plane[..., :3], -np.abs(plane[..., :3])], axis=2).reshape(-1, 6) @ extent
            outside = nearest.reshape(*plane.shape[:2], -1) > plane[..., 3:]
            owner, member = np.nonzero(~outside.any(axis=1))
            owners.append(rows[owner])
            members.append(behind[member])
    return np.concatenate(owners), np.concatenate(members)


def next_windows(world: PortalWorld, front: Windows, planes: np.ndarray) -> Windows:
    """What is left of the portals of the rooms behind ``front`` inside its ``planes``."""
    room = world.target[front.portal]
    portal, owner = ragged(world.portal_start[room], np.diff(world.portal_start)[room])
    fresh = (world.target[portal][:, None] != world.source[front.path[owner]]).all(axis=1)
    portal, owner = portal[fresh], owner[fresh]
    step = max(1, _BLOCK_BOXES // (planes.shape[1] * MAX_CORNERS))
    parts = [_left(world, portal[i : i + step], planes[owner[i : i + step]]) for i in range(0, len(portal), step)]
    kept = np.concatenate([np.zeros(0, np.int64), *(row + i * step for i, (row, _) in enumerate(parts))])
    corner = joined([corner for _, corner in parts], 3)
    portal, owner = portal[kept], owner[kept]
    path = np.concatenate([front.path[owner], portal[:, None]], axis=1)
    if world.framed:
        return Windows(front.source[owner], portal, frames(corner, world.normal[portal]), None, path, owner)
    return Windows(front.source[owner], portal, corner, front.corner[owner], path, owner)


def _left(world: PortalWorld, portal: np.ndarray, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What ``planes`` (R, k, 4) leave of windows (R,): rows where that is something, and their corners (r, n, 3)."""
    whole = world.window[portal]
    thick = world.depth[portal, None] * np.abs(np.einsum("nkc,nc->nk", planes[..., :3], world.normal[portal]))
    offset = planes[..., 3] + thick
    inward = offset[..., None] - planes[..., :3] @ whole.transpose(0, 2, 1)
    rows = np.flatnonzero((least(-inward) <= 0).all(axis=1))
    cuts = least(inward[rows]) < 0
    size = min(MAX_CORNERS, whole.shape[1] + int(cuts.sum(axis=1).max(initial=0)))
    corner = whole[rows][:, np.minimum(np.arange(size), whole.shape[1] - 1)]
    something = np.ones(len(rows), bool)
    for k in range(planes.shape[1] - 1, -1, -1):
        at = np.flatnonzero(cuts[:, k] & something)
        inward = offset[rows[at], k, None] - np.einsum("nvc,nc->nv", corner[at], planes[rows[at], k, :3])
        left = inward.max(axis=1) >= 0
        something[at[~left]] = False
        corner[at[left]] = clipped(corner[at[left]], inward[left])
    return rows[something], corner[something]


def _look(world: PortalWorld, low: int, seen: np.ndarray, room_names: Sequence[str], findings: list[str]) -> None:
    """Set ``seen[i, c]`` for all clusters c that cluster ``low + i`` may see in its own room and through portals."""
    source = np.arange(low, low + len(seen))
    room = world.room[source]
    member, owner = ragged(world.room_start[room], np.diff(world.room_start)[room])
    seen[owner, world.by_room[member]] = True
    stack = [first_windows(world, source)]
    while stack:
        front = stack.pop()
        if len(front) > _BLOCK:
            stack.extend(front.take(slice(i, i + _BLOCK)) for i in reversed(range(0, len(front), _BLOCK)))
            continue
        front, planes = supporting_planes(world, front)
        if not len(front):
            continue
        owner, member = seen_behind(world, front, planes)
        seen[front.source[owner] - low, member] = True
        following = next_windows(world, front, planes)
        if following.path.shape[1] > MAX_PORTALS and len(following):
            _give_up(world, following, low, seen, room_names, findings)
        elif len(following):
            stack.append(following)


def _give_up(world: PortalWorld, front: Windows, low: int, seen: np.ndarray, room_names: Sequence[str], findings: list[str]) -> None:
    """Chains beyond the longest one: their clusters see all that is connected, and one sentence says so."""
    if not findings:
        path = " > ".join(room_names[r] or f"room {r}" for r in world.source[front.path[0]])
        findings.append(
            f"a line of sight through more than {MAX_PORTALS} portals is not followed further, "
            f"all that is connected counts as visible: {path}"
        )
    cluster_component = world.component[world.room]
    sources = np.unique(front.source)
    seen[sources - low] |= cluster_component[sources, None] == cluster_component


def _keep_mutual(bits: np.ndarray, count: int) -> None:
    """Intersect a bit matrix with its transpose, in place, block by block."""
    size = 1024
    for i in range(0, count, size):
        for j in range(0, i + 1, size):
            rows, columns = slice(i, min(i + size, count)), slice(j, min(j + size, count))
            row_bytes, column_bytes = slice(i // 8, i // 8 + size // 8), slice(j // 8, j // 8 + size // 8)
            both = np.unpackbits(bits[rows, column_bytes], axis=1, count=columns.stop - j)
            both &= np.unpackbits(bits[columns, row_bytes], axis=1, count=rows.stop - i).T
            bits[rows, column_bytes] = np.packbits(both, axis=1)
            bits[columns, row_bytes] = np.packbits(both.T, axis=1)


def weights(bits: np.ndarray, polygons: np.ndarray) -> np.ndarray:
    """(C,) int64: summed polygons (C,) of every set of a bit matrix."""
    result = np.zeros(len(bits), np.int64)
    rows = max(1, _BLOCK_BYTES // max(1, 8 * len(bits)))
    for i in range(0, len(bits), rows):
        result[i : i + rows] = np.rint(np.unpackbits(bits[i : i + rows], axis=1, count=len(bits)) @ polygons.astype(np.float64))
    return result
