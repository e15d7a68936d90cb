"""The cluster visibility graph: which clusters may see each other through chains of portals (paper, section 5).

From the box of a cluster, the light that passes a portal stays behind one supporting plane per edge of the portal:
the plane through that edge with the portal on one side and the box, touched, on the other. Clusters of the next room
outside any of the planes, or behind the portal, cannot be seen. Every further portal of that room is clipped by the planes
to a smaller window, supporting planes are laid from the box, and from the window before, to the smaller window, and so on.
A room is not entered twice on one path: cutting the loop out of a line's path leaves portals that the line still
crosses in their order, so the shorter path finds the pair as well. Results are united over paths. Seeing is mutual
and either direction alone misses nothing, so a pair stays only when both directions found it.

The test is conservative: it keeps pairs that cannot see each other, and loses none that can. Boxes are grown, and
planes moved out, by 1e-7 of the building's size, against rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .clustering import Clusters
from .grouping import components, ragged, starts_of
from .scene import Portals

MAX_PORTALS = 64
"""Longest chain of portals that is followed; where one goes on, all that is connected counts as visible."""
MAX_CORNERS = 16
"""Most corners of a window; a cut that would make more is left out, and portals with more are framed by tangents."""
TOLERANCE = 1e-7
"""Slack of all comparisons, of the diagonal of the building."""
_BLOCK = 1 << 13
"""Windows that are worked on at once."""
_BLOCK_BYTES = 1 << 23
"""Rows of the graph that are built at once, bytes."""
_FLAT = 1e12
"""Cotangent of a plane that lies in the portal: it lets everything pass."""

_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BOX_EDGES = np.array([(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1])


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


def build(clusters: Clusters, portals: Portals, room_names: Sequence[str]) -> tuple[VisibilityGraph, tuple[str, ...]]:
    """The graph of all clusters, and sentences about what was cut short.

    Boxes and portals must be in one frame. Portals are planar and convex (``scene_checks.check`` sees to that), their
    normals run from the first to the second room; those to the outside lead nowhere and those without area let
    nothing pass.
    """
    world = _World(clusters, portals, len(room_names))
    count = len(clusters)
    bits = np.zeros((count, (count + 7) // 8), np.uint8)
    findings: list[str] = []
    rows = max(1, _BLOCK_BYTES // max(1, count))
    for low in range(0, count, rows):
        seen = np.zeros((min(rows, count - low), count), bool)
        _look(world, low, seen, room_names, findings)
        bits[low : low + len(seen)] = np.packbits(seen, axis=1)
    _keep_mutual(bits, count)
    return VisibilityGraph(bits, _weigh(bits, clusters.polygons)), tuple(findings)


class _World:
    """Boxes and directed portals about the middle of the building, sorted by room."""

    def __init__(self, clusters: Clusters, portals: Portals, rooms: int) -> None:
        corners = [clusters.box_min, clusters.box_max, portals.vertices]
        low = np.min([c.min(axis=0) for c in corners if len(c)], axis=0, initial=np.inf)
        high = np.max([c.max(axis=0) for c in corners if len(c)], axis=0, initial=-np.inf)
        middle = 0.5 * (low + high) if len(clusters) else np.zeros(3)
        self.slack = TOLERANCE * float(np.linalg.norm(high - low)) if len(clusters) else 0.0
        self.centre = 0.5 * (clusters.box_min + clusters.box_max) - middle
        self.half = 0.5 * (clusters.box_max - clusters.box_min)
        self.room = clusters.room
        self.by_room = np.argsort(clusters.room, kind="stable")
        self.room_start = starts_of(clusters.room[self.by_room], rooms)

        window = _padded(portals, middle)
        vector = 0.5 * np.cross(window - window[:, :1], np.roll(window, -1, axis=1) - window[:, :1]).sum(axis=1)
        area = np.linalg.norm(vector, axis=1)
        useful = np.flatnonzero((area > self.slack**2) & (portals.rooms >= 0).all(axis=1))
        normal = vector[useful] / area[useful, None]
        # Every portal is looked through both ways: in the other direction its corners run the other way round.
        source = np.concatenate([portals.rooms[useful, 0], portals.rooms[useful, 1]])
        order = np.argsort(source, kind="stable")
        self.window = np.concatenate([window[useful], window[useful, ::-1]])[order]
        self.normal = np.concatenate([normal, -normal])[order]
        self.target = np.concatenate([portals.rooms[useful, 1], portals.rooms[useful, 0]])[order]
        self.portal_start = starts_of(source[order], rooms)
        self.component = components(rooms, portals.rooms[useful, 0], portals.rooms[useful, 1])


def _padded(portals: Portals, middle: np.ndarray) -> np.ndarray:
    """(K, n, 3) corners of all portals, the last one repeated; portals of too many corners become the frame of their tangents."""
    counts = np.diff(portals.start)
    many = counts > MAX_CORNERS - 4
    size = min(int(counts.max(initial=3)), MAX_CORNERS - 4)
    slot = portals.start[:-1, None] + np.minimum(np.arange(size), counts[:, None] - 1)
    window = portals.vertices[slot] - middle
    for k in np.flatnonzero(many):  # round windows: rare
        window[k] = _tangent_frame(portals.polygon(k) - middle, size)
    return window


def _tangent_frame(polygon: np.ndarray, sides: int) -> np.ndarray:
    """(sides, 3) corners of the equiangular polygon around a planar convex one, same orientation."""
    origin = polygon.mean(axis=0)
    local = polygon - origin
    normal = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
    u = local[np.argmax(np.einsum("ij,ij->i", local, local))]
    u = u / np.linalg.norm(u)
    v = np.cross(normal / max(np.linalg.norm(normal), 1e-300), u)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    support = (np.stack([local @ u, local @ v], axis=1) @ direction.T).max(axis=0)
    # Corner between the tangents i and i + 1: along tangent i from its foot.
    turn = 2.0 * np.pi / sides
    along = (np.roll(support, -1) - support * np.cos(turn)) / np.sin(turn)
    flat = support[:, None] * direction + along[:, None] * np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    return origin + flat[:, :1] * u + flat[:, 1:] * v


@dataclass
class _Windows:
    """Ways to look into a room: N windows of clusters (``source``) in directed portals.

    source, portal : (N,);  corner : (N, n, 3), last one repeated;  before : (N, m, 3) the window before or None;
    path : (N, depth) rooms from the cluster's own to that in front of the portal
    """

    source: np.ndarray
    portal: np.ndarray
    corner: np.ndarray
    before: np.ndarray | None
    path: np.ndarray

    def __len__(self) -> int:
        return len(self.source)

    def take(self, index: np.ndarray | slice) -> _Windows:
        return _Windows(
            self.source[index],
            self.portal[index],
            self.corner[index],
            None if self.before is None else self.before[index],
            self.path[index],
        )


def _look(world: _World, low: int, seen: np.ndarray, room_names: Sequence[str], findings: list[str]) -> None:
    """Set ``seen[i, c]`` for all clusters c that cluster ``low + i`` may see in its own room and through portals."""
    source = np.arange(low, low + len(seen))
    room = world.room[source]
    member, owner = ragged(world.room_start[room], np.diff(world.room_start)[room])
    seen[owner, world.by_room[member]] = True
    portal, owner = ragged(world.portal_start[room], np.diff(world.portal_start)[room])
    stack = [_Windows(source[owner], portal, world.window[portal], None, room[owner, None])]
    while stack:
        front = stack.pop()
        if len(front) > _BLOCK:
            stack.extend(front.take(slice(i, i + _BLOCK)) for i in reversed(range(0, len(front), _BLOCK)))
            continue
        front, planes = _supporting_planes(world, front)
        if not len(front):
            continue
        _mark_boxes(world, front, planes, low, seen)
        following = _through(world, front, planes)
        if following.path.shape[1] > MAX_PORTALS and len(following):
            _give_up(world, following, low, seen, room_names, findings)
        elif len(following):
            stack.append(following)


def _supporting_planes(world: _World, front: _Windows) -> tuple[_Windows, np.ndarray]:
    """The windows that their clusters can look through at all, and (N, n + 1, 4) planes (a, b): visible is a.x <= b.

    The last plane is that of the portal. An edge whose plane cannot be laid, because box or window before touch it or cross
    the portal's plane on the wrong side of it, has the portal's plane too.
    """
    half = world.half[front.source] + world.slack
    box = world.centre[front.source][:, None] + _CORNERS * half[:, None]
    normal = world.normal[front.portal]
    height = np.einsum("nc,nc->n", normal, front.corner[:, 0])
    depth = height[:, None] - np.einsum("nvc,nc->nv", box, normal)
    open_ = depth.max(axis=1) > 0
    if front.before is not None:
        before_depth = height[:, None] - np.einsum("nvc,nc->nv", front.before, normal)
        open_ &= before_depth.max(axis=1) > -world.slack
    if not open_.all():
        front, box, normal, height, depth = front.take(open_), box[open_], normal[open_], height[open_], depth[open_]
    edge = np.roll(front.corner, -1, axis=1) - front.corner
    length = np.linalg.norm(edge, axis=2, keepdims=True)
    real = length[..., 0] > world.slack
    outward = np.cross(edge, normal[:, None]) / np.where(length > 0, length, 1)
    edge_height = np.einsum("nkc,nkc->nk", outward, front.corner)

    cotangent = _cotangent(np.einsum("nkc,nvc->nkv", outward, box) - edge_height[..., None], depth, _BOX_EDGES, world.slack)
    if front.before is not None:
        size = front.before.shape[1]
        ring = np.stack([np.arange(size), np.roll(np.arange(size), -1)], axis=1)
        side = np.einsum("nkc,nvc->nkv", outward, front.before) - edge_height[..., None]
        cotangent = np.maximum(cotangent, _cotangent(side, before_depth[open_], ring, world.slack))
    cotangent = np.where(real, cotangent, -_FLAT)
    length = np.sqrt(cotangent * cotangent + 1.0)
    planes = np.empty((len(front), edge.shape[1] + 1, 4))
    planes[:, :-1, :3] = (cotangent[..., None] * normal[:, None] + outward) / length[..., None]
    planes[:, :-1, 3] = (cotangent * height[:, None] + edge_height) / length
    planes[:, -1, :3] = -normal
    planes[:, -1, 3] = -height
    planes[..., 3] += world.slack
    return front, planes


def _cotangent(side: np.ndarray, depth: np.ndarray, edges: np.ndarray, slack: float) -> np.ndarray:
    """(N, K): side over depth of the point of a convex body that opens the view past an edge widest.

    side : (N, K, V) distance of the body's corners outward from each of K edges, in the portal's plane
    depth : (N, V) distance in front of the portal's plane;  edges : (E, 2) corners joined by the body's edges
    Only the part of the body in front of the plane counts. A body that reaches the edge, or meets the plane inward of
    it, opens the whole half-space: -_FLAT. No part in front says nothing either: -_FLAT.
    """
    ahead = depth > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = np.where(ahead[:, None], side / depth[:, None], np.inf)
    result = np.clip(ratio.min(axis=2), -_FLAT, _FLAT)
    result[((np.abs(side) <= slack) & (np.abs(depth) <= slack)[:, None]).any(axis=2) | ~ahead.any(axis=1)[:, None]] = -_FLAT
    crossing = np.flatnonzero(~ahead.all(axis=1) & ahead.any(axis=1))
    if len(crossing):
        a, b = edges.T
        da, db = depth[crossing][:, a], depth[crossing][:, b]
        cuts = (da > 0) != (db > 0)
        t = np.where(cuts, da / np.where(cuts, da - db, 1.0), 0.0)
        sa, sb = side[crossing][:, :, a], side[crossing][:, :, b]
        at = np.where(cuts[:, None], sa + t[:, None] * (sb - sa), np.inf).min(axis=2)
        result[crossing] = np.where(at <= slack, -_FLAT, result[crossing])
    return result


def _mark_boxes(world: _World, front: _Windows, planes: np.ndarray, low: int, seen: np.ndarray) -> None:
    """Set ``seen`` for the clusters of the room behind each window whose boxes are not wholly outside one of its planes."""
    room = world.target[front.portal]
    member, owner = ragged(world.room_start[room], np.diff(world.room_start)[room])
    member = world.by_room[member]
    source = front.source[owner] - low
    new = np.flatnonzero(~seen[source, member])  # where several ways lead to a room, most is known from the first
    member, owner = member[new], owner[new]
    for k in range(planes.shape[1] - 1, -1, -1):
        plane = planes[owner, k]
        nearest = np.einsum("ij,ij->i", plane[:, :3], world.centre[member]) - np.einsum(
            "ij,ij->i", np.abs(plane[:, :3]), world.half[member]
        )
        keep = np.flatnonzero(nearest <= plane[:, 3])
        member, owner = member[keep], owner[keep]
    seen[front.source[owner] - low, member] = True


def _through(world: _World, front: _Windows, planes: np.ndarray) -> _Windows:
    """The windows that remain of the portals of the next rooms."""
    room = world.target[front.portal]
    portal, owner = ragged(world.portal_start[room], np.diff(world.portal_start)[room])
    target = world.target[portal]
    fresh = (target != room[owner]) & (target[:, None] != front.path[owner]).all(axis=1)
    portal, owner = portal[fresh], owner[fresh]
    corner = world.window[portal]
    for k in range(planes.shape[1] - 1, -1, -1):
        plane = planes[owner, k]
        inward = plane[:, 3, None] - np.einsum("nvc,nc->nv", corner, plane[:, :3])
        keep = inward.max(axis=1) >= 0
        if not keep.all():
            portal, owner, corner, inward = portal[keep], owner[keep], corner[keep], inward[keep]
        corner = _clipped(corner, inward)
    path = np.concatenate([front.path[owner], world.target[front.portal[owner], None]], axis=1)
    return _Windows(front.source[owner], portal, corner, front.corner[owner], path)


def _clipped(corner: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Cut from (N, n, 3) convex polygons what has ``inward`` (N, n) below zero; every polygon has a corner that stays.

    Returns (N, n', 3), last corner repeated; polygons that would get more than MAX_CORNERS corners are left whole.
    """
    cut = np.flatnonzero((inward < 0).any(axis=1))
    if not len(cut):
        return corner
    polygon, height = corner[cut], inward[cut]
    following, next_height = np.roll(polygon, -1, axis=1), np.roll(height, -1, axis=1)
    inside = height >= 0
    crosses = inside != (next_height >= 0)
    t = height / np.where(crosses, height - next_height, 1.0)
    # Every corner gives itself where it is inside and the crossing after it, packed to the left.
    slots = np.stack([polygon, polygon + t[..., None] * (following - polygon)], axis=2).reshape(len(cut), -1, 3)
    used = np.stack([inside, crosses], axis=2).reshape(len(cut), -1)
    count = used.sum(axis=1)
    width = int(min(count.max(), MAX_CORNERS))
    packed = np.argsort(~used, axis=1, kind="stable")[:, :width]
    packed = np.take_along_axis(packed, np.minimum(np.arange(width), count[:, None] - 1), axis=1)
    result = np.take_along_axis(slots, packed[..., None], axis=1)
    whole = count > MAX_CORNERS
    size = max(corner.shape[1], width)
    out = corner[:, np.minimum(np.arange(size), corner.shape[1] - 1)]
    result = result[:, np.minimum(np.arange(size), width - 1)]
    out[cut[~whole]] = result[~whole]
    return out


def _give_up(world: _World, front: _Windows, low: int, seen: np.ndarray, room_names: Sequence[str], findings: list[str]) -> None:
    """Chains beyond the longest one: their clusters see all that is connected, and one sentence says so."""
    if not findings:
        path = " > ".join(room_names[r] or f"room {r}" for r in front.path[0])
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


def _weigh(bits: np.ndarray, polygons: np.ndarray) -> np.ndarray:
    """(C,) int64: summed polygons of every set."""
    result = np.zeros(len(bits), np.int64)
    rows = max(1, _BLOCK_BYTES // max(1, 8 * len(bits)))
    for i in range(0, len(bits), rows):
        result[i : i + rows] = np.rint(np.unpackbits(bits[i : i + rows], axis=1, count=len(bits)) @ polygons.astype(np.float64))
    return result
