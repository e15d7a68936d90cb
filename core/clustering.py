"""Clusters of polygons that lie close together, per room: the ISODATA algorithm of the paper, section 4.

N_g = N_t / N_ave barycenters are chosen among the items of a room, every item joins the nearest, every barycenter
moves to the mean of its items, and so on until nothing changes (Lloyd's iteration), a state returns (oscillation) or
ten steps are done. Barycenters without items are dropped. Items whose smaller edge is above a threshold stand alone
(section 4.4). All rooms advance together in blocks of (item, barycenter) pairs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .grouping import ragged, starts_of
from .scene import Scene

MAX_STEPS = 10
"""Most Lloyd steps (section 4.1 of the paper: ten interrupt what has not settled)."""
BLOCK_PAIRS = 1 << 18
"""Item-barycenter pairs that are compared at once."""


@dataclass(frozen=True)
class ClusterItems:
    """What is sorted into clusters: polygons, or regions merged of several (n items).

    barycenter : (n, 3) float64, metres, mean of the corners
    normal : (n, 3) float64, unit, zero for an item without area
    box_min, box_max : (n, 3) float64
    smaller_edge : (n,) float64, metres, width of the thinnest strip that holds the item (of a rectangle: its shorter side)
    room : (n,) int32
    weight : (n,) int64, polygons that the item stands for
    vertices : (V, 3) float64;  vertex_start : (n + 1,) int64, item i owns ``vertices[vertex_start[i]:vertex_start[i + 1]]``, one at least
    """

    barycenter: np.ndarray
    normal: np.ndarray
    box_min: np.ndarray
    box_max: np.ndarray
    smaller_edge: np.ndarray
    room: np.ndarray
    weight: np.ndarray
    vertices: np.ndarray
    vertex_start: np.ndarray

    def __len__(self) -> int:
        return len(self.room)


@dataclass(frozen=True)
class Clusters:
    """A partition of n items into C clusters, ordered by room and then by smallest item; every item is in exactly one.

    cluster_of : (n,) int32
    start : (C + 1,) int64;  members : (n,) int32, cluster c owns items ``members[start[c]:start[c + 1]]``, rising
    room : (C,) int32;  polygons : (C,) int64, sum of the weights of the items
    box_min, box_max : (C, 3) float64, bounding boxes, metres
    iterations : (R,) int32, Lloyd steps that each room took, 0 without items to sort
    oscillated : (R,) bool, the room came back to an earlier state instead of settling
    """

    cluster_of: np.ndarray
    start: np.ndarray
    members: np.ndarray
    room: np.ndarray
    polygons: np.ndarray
    box_min: np.ndarray
    box_max: np.ndarray
    iterations: np.ndarray
    oscillated: np.ndarray

    def __len__(self) -> int:
        return len(self.room)


Distance = Callable[[ClusterItems, np.ndarray, np.ndarray], np.ndarray]
"""A distance between items and barycenters: ``distance(items, rows, barycenters) -> (m, k) float64``.

``rows`` (m,) are the items of the block, ``barycenters`` (m, k, 3) the candidates of each, or (1, k, 3) when all share
them. Only the order of the values in a row matters; the first of equal ones wins.
"""


def barycenter_distance(items: ClusterItems, rows: np.ndarray, barycenters: np.ndarray) -> np.ndarray:
    """Distance between the item's barycenter and the cluster's, metres (section 4.3)."""
    return _point_distance(items.barycenter[rows], barycenters)


def closest_vertex_distance(items: ClusterItems, rows: np.ndarray, barycenters: np.ndarray) -> np.ndarray:
    """Distance between the cluster's barycenter and the item's closest vertex, metres (section 4.3)."""
    counts = np.diff(items.vertex_start)[rows]
    vertex, owner = ragged(items.vertex_start[:-1][rows], counts)
    candidates = barycenters if len(barycenters) == 1 else barycenters[owner]
    return np.minimum.reduceat(_point_distance(items.vertices[vertex], candidates), np.cumsum(counts) - counts, axis=0)


def orthogonal_distance(items: ClusterItems, rows: np.ndarray, barycenters: np.ndarray) -> np.ndarray:
    """Distance between the cluster's barycenter and the plane of the item, metres (section 4.3).

    An item without area has no plane: the distance to its barycenter then.
    """
    normal = items.normal[rows]
    height = np.abs(np.einsum("ic,ikc->ik", normal, barycenters - items.barycenter[rows][:, None]))
    flat = ~normal.any(axis=1)
    if flat.any():
        candidates = barycenters if len(barycenters) == 1 else barycenters[flat]
        height[flat] = _point_distance(items.barycenter[rows[flat]], candidates)
    return height


DISTANCE_FUNCTIONS: dict[str, Distance] = {
    "barycenter": barycenter_distance,
    "closest_vertex": closest_vertex_distance,
    "orthogonal": orthogonal_distance,
}


def _point_distance(points: np.ndarray, barycenters: np.ndarray) -> np.ndarray:
    if len(barycenters) > 1 or len(points) == 1:
        return np.sqrt(sum((points[:, None, axis] - barycenters[..., axis]) ** 2 for axis in range(3)))
    # One matrix product where all share the candidates; taken about their middle so that no digits cancel far from the origin.
    middle = barycenters[0].mean(axis=0)
    p, b = points - middle, barycenters[0] - middle
    squared = np.einsum("ij,ij->i", p, p)[:, None] - 2.0 * (p @ b.T) + np.einsum("ij,ij->i", b, b)
    return np.sqrt(np.maximum(squared, 0.0))


# -------------------------------------------------------------------------------------------------------- items


def cluster_items_of(scene: Scene) -> ClusterItems:
    """One item per polygon of the scene, of its outer loop; polygons without area are items like any other."""
    first = scene.polygon_start[:-1]
    vertex, owner = ragged(scene.loop_start[first], scene.loop_start[first + 1] - scene.loop_start[first])
    count = np.bincount(owner, minlength=scene.polygon_count)
    start = np.concatenate([np.zeros(1, np.int64), np.cumsum(count)])
    vertices = scene.vertices[scene.corner_vertex[vertex]]
    origin = vertices[start[:-1]]
    local = vertices - origin[owner]  # sums of world coordinates would lose digits far from the origin
    barycenter = origin + np.add.reduceat(local, start[:-1], axis=0) / count[:, None]
    following = np.arange(1, len(vertices) + 1)
    following[start[1:] - 1] = start[:-1]
    normal = np.add.reduceat(np.cross(local, local[following]), start[:-1], axis=0)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 0, normal / np.where(length > 0, length, 1), 0.0)
    return ClusterItems(
        barycenter=barycenter,
        normal=normal,
        box_min=np.minimum.reduceat(vertices, start[:-1], axis=0),
        box_max=np.maximum.reduceat(vertices, start[:-1], axis=0),
        smaller_edge=_widths(local, start, normal),
        room=scene.room,
        weight=np.ones(scene.polygon_count, np.int64),
        vertices=vertices,
        vertex_start=start,
    )


def _widths(vertices: np.ndarray, start: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(n,) float64: width of the thinnest strip along one of a polygon's edges that holds the polygon.

    For a rectangle this is the shorter side. The shortest edge itself would not do: a corner that a neighbour puts
    into the middle of a long edge makes short edges of a large wall.
    """
    counts = np.diff(start)
    result = np.zeros(len(counts))
    for corners in np.unique(counts):  # polygons of one number of corners form dense blocks
        same = np.flatnonzero(counts == corners)
        step = max(1, (1 << 20) // int(corners) ** 2)
        for block in (same[i : i + step] for i in range(0, len(same), step)):
            polygon = vertices[start[block][:, None] + np.arange(corners)]
            across = np.cross(normal[block][:, None], np.roll(polygon, -1, axis=1) - polygon)
            length = np.linalg.norm(across, axis=2)
            extent = np.ptp(np.einsum("iec,ivc->iev", across, polygon), axis=2)
            width = np.where(length > 0, extent / np.where(length > 0, length, 1), np.inf).min(axis=1)
            result[block] = np.where(np.isinf(width), 0.0, width)
    return result


# -------------------------------------------------------------------------------------------------------- seeds


Seeding = Callable[[np.ndarray, np.ndarray, np.ndarray, np.random.Generator], np.ndarray]
"""``seeding(position (m, 3), start (R + 1,), number (R,), rng)``: rows that the barycenters of every room begin at, room after room.

Room r owns the rows ``start[r]:start[r + 1]`` and gets ``number[r]`` seeds. Returns (sum of number,) int64.
"""


def random_seeds(position: np.ndarray, start: np.ndarray, number: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The paper's random choice: ``number[r]`` different rows of every room, all equally likely."""
    room = np.repeat(np.arange(len(number)), np.diff(start))
    shuffled = np.lexsort((rng.random(len(room)), room))
    return shuffled[ragged(start[:-1], number)[0]]


def spread_seeds(position: np.ndarray, start: np.ndarray, number: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """k-means++ (Arthur and Vassilvitskii 2007): the chance of a row to be the next seed is its squared distance to the nearest one.

    With these seeds the summed box volume of office and building scenes is 0.6 of that with random ones at five
    polygons a cluster, 0.7 at ten and alike at fifty, for the same time.
    """
    first = np.cumsum(number) - number
    seeds = np.zeros(number.sum(), np.int64)
    # The rooms with most seeds come first, so that the rooms that still lack one are always the first rows.
    used = np.flatnonzero(number > 0)
    room = used[np.argsort(-number[used], kind="stable")]
    if not len(room):
        return seeds
    size = np.diff(start)[room]
    row, owner = ragged(start[room], size)
    point = position[row]
    end = np.cumsum(size)
    begin = end - size
    chosen = begin + np.minimum((rng.random(len(room)) * size).astype(np.int64), size - 1)
    seeds[first[room]] = row[chosen]
    squared = np.full(len(row), np.inf)
    for k in range(1, int(number.max())):
        count = np.searchsorted(-number[room], -k)
        rows = end[count - 1]
        offset = point[:rows] - point[chosen[:count]][owner[:rows]]
        np.minimum(squared[:rows], np.einsum("ij,ij->i", offset, offset), out=squared[:rows])
        total = np.concatenate([np.zeros(1), np.cumsum(squared[:rows])])
        low, high = total[begin[:count]], total[end[:count]]
        drawn = np.searchsorted(total, low + rng.random(count) * (high - low), side="right") - 1
        chosen = np.clip(drawn, begin[:count], end[:count] - 1)  # coincident items: any will do
        seeds[first[room[:count]] + k] = row[chosen]
    return seeds


# ----------------------------------------------------------------------------------------------------- clusters


def cluster(scene: Scene, *, average: int, distance: str = "barycenter", large_polygon: float = 1.0, rng: np.random.Generator) -> Clusters:
    """Cluster the polygons of a scene; see :func:`cluster_items`."""
    return cluster_items(
        cluster_items_of(scene),
        scene.room_count,
        average=average,
        distance=DISTANCE_FUNCTIONS[distance],
        large_polygon=large_polygon,
        rng=rng,
    )


def cells(items: ClusterItems, room_count: int) -> Clusters:
    """One cluster per room that has items: the cells of the paper, for comparison."""
    return _clusters(items, items.room.astype(np.int64), np.zeros(room_count, np.int32), np.zeros(room_count, bool))


def cluster_items(
    items: ClusterItems,
    room_count: int,
    *,
    average: int,
    distance: Distance = barycenter_distance,
    large_polygon: float = 1.0,
    seeding: Seeding = spread_seeds,
    rng: np.random.Generator,
) -> Clusters:
    """Sort items into clusters, each within one room (ISODATA, paper section 4).

    average : polygons per cluster that are aimed at; the number of barycenters of a room is its polygons (the large
        ones left out) over ``average``, rounded, 1 at least
    large_polygon : metres, items whose smaller edge is longer stand alone
    seeding : where the barycenters begin, :func:`spread_seeds` or :func:`random_seeds`
    """
    small = np.flatnonzero(items.smaller_edge <= large_polygon)
    rows = small[np.argsort(items.room[small], kind="stable")]
    row_room = items.room[rows].astype(np.int64)
    start = starts_of(row_room, room_count)
    polygons = np.bincount(row_room, items.weight[rows], minlength=room_count)
    number = np.minimum(np.maximum(np.floor(polygons / average + 0.5), 1), np.diff(start)).astype(np.int64)
    seeds = seeding(items.barycenter[rows], start, number, rng)
    label, iterations, oscillated = lloyd(items, rows, start, number, items.barycenter[rows[seeds]], distance)
    key = np.empty(len(items), np.int64)
    key[rows] = label
    large = np.setdiff1d(np.arange(len(items)), small)
    key[large] = number.sum() + np.arange(len(large))
    return _clusters(items, key, iterations, oscillated)


def lloyd(
    items: ClusterItems,
    rows: np.ndarray,
    start: np.ndarray,
    number: np.ndarray,
    barycenters: np.ndarray,
    distance: Distance,
    steps: int = MAX_STEPS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lloyd's iteration in all rooms at once.

    rows : (m,) items sorted by room, room r owns ``rows[start[r]:start[r + 1]]``
    number : (R,) barycenters of each room;  barycenters : (sum, 3) float64 where they begin, room after room
    Returns (label (m,) int64 index into ``barycenters``, steps taken (R,) int32, oscillated (R,) bool).
    """
    rooms = len(number)
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(number)])
    row_room = np.repeat(np.arange(rooms), np.diff(start))
    barycenters = barycenters.copy()
    label = np.where(number[row_room] > 0, first[row_room], -1)
    iterations = (number > 0).astype(np.int32)
    oscillated = np.zeros(rooms, bool)
    active = number > 1  # one barycenter takes all in one step
    # A sum of the labels under fixed random 64-bit weights stands for the state of a room: an earlier state is recognised.
    signature_weight = np.random.default_rng(0).integers(0, 1 << 64, len(rows), np.uint64)
    seen = np.zeros((steps, rooms), np.uint64)
    label[active[row_room]] = -1
    for step in range(steps):
        if not active.any():
            break
        iterations[active] = step + 1
        assigned = label.copy()
        for block, candidate, shared in _blocks(start, number, first, active):
            choice = distance(items, rows[block], barycenters[candidate])
            nearest = np.argmin(choice, axis=1)
            assigned[block] = candidate[0, nearest] if shared else candidate[np.arange(len(block)), nearest]
        changed = np.bincount(row_room[assigned != label], minlength=rooms) > 0
        label = assigned
        active &= changed
        seen[step] = np.add.reduceat(np.append(label.astype(np.uint64) * signature_weight, np.uint64(0)), np.minimum(start[:-1], len(rows)))
        returned = active & (seen[:step] == seen[step]).any(axis=0)
        oscillated |= returned
        active &= ~returned
        moving = active[row_room]
        owner = label[moving]
        offset = items.barycenter[rows[moving]] - barycenters[owner]
        count = np.maximum(np.bincount(owner, minlength=len(barycenters)), 1)
        for axis in range(3):
            barycenters[:, axis] += np.bincount(owner, offset[:, axis], minlength=len(barycenters)) / count
    return label, iterations, oscillated


def _blocks(start: np.ndarray, number: np.ndarray, first: np.ndarray, active: np.ndarray):
    """Blocks of about BLOCK_PAIRS pairs that cover the active rooms: (positions (m,), candidates (m or 1, k), shared).

    A big room makes blocks of its own whose rows share the candidates. Small rooms with about equally many barycenters
    come together, the shorter lists filled up with their last entry, which as the later of two equals never wins.
    """
    size = np.diff(start)
    big = active & (size * number > BLOCK_PAIRS // 4)
    for r in np.flatnonzero(big):
        candidate = np.arange(first[r], first[r + 1])[None]
        step = max(1, BLOCK_PAIRS // int(number[r]))
        for i in range(start[r], start[r + 1], step):
            yield np.arange(i, min(i + step, start[r + 1])), candidate, True
    rooms = np.flatnonzero(active & ~big)
    if not len(rooms):
        return
    bucket = np.ceil(2.0 * np.log2(number[rooms])).astype(np.int64)
    rooms = rooms[np.argsort(bucket, kind="stable")]
    bucket = np.sort(bucket)
    width = np.ceil(2.0 ** (0.5 * bucket)).astype(np.int64) + 1
    batch = np.cumsum(size[rooms] * width) // BLOCK_PAIRS
    cut = np.flatnonzero((np.diff(bucket) != 0) | (np.diff(batch) != 0)) + 1
    for group in np.split(rooms, cut):
        position, owner = ragged(start[group], size[group])
        slot = np.minimum(np.arange(number[group].max()), number[group][:, None] - 1)
        yield position, (first[group][:, None] + slot)[owner], False


def _clusters(items: ClusterItems, key: np.ndarray, iterations: np.ndarray, oscillated: np.ndarray) -> Clusters:
    """Number the groups of equal ``key`` by room and smallest item, and bound them."""
    _, lowest, group = np.unique(key, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    order = np.lexsort((lowest, items.room[lowest]))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    cluster_of = rank[group]
    members = np.argsort(cluster_of, kind="stable")
    start = starts_of(cluster_of[members], len(order))
    bounds = (items.box_min[members], items.box_max[members])
    if len(order):
        bounds = (np.minimum.reduceat(bounds[0], start[:-1], axis=0), np.maximum.reduceat(bounds[1], start[:-1], axis=0))
    return Clusters(
        cluster_of=cluster_of.astype(np.int32),
        start=start,
        members=members.astype(np.int32),
        room=items.room[lowest[order]].astype(np.int32),
        polygons=np.bincount(cluster_of, items.weight, minlength=len(order)).astype(np.int64),
        box_min=bounds[0],
        box_max=bounds[1],
        iterations=iterations,
        oscillated=oscillated,
    )
