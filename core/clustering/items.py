"""What is sorted into clusters, and what comes out: items with their geometry and photometry, and a partition of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..grouping import ragged, starts_of
from ..scene import Scene


@dataclass(frozen=True)
class ClusterItems:
    """What is sorted into clusters: polygons, regions merged of several, or clusters that a hierarchy gathers (n items).

    barycenter : (n, 3) float64, metres, mean of the corners
    normal : (n, 3) float64, unit, zero for an item without area
    box_min, box_max : (n, 3) float64
    smaller_edge : (n,) float64, metres, width of the thinnest strip that holds the item (of a rectangle: its shorter side)
    room : (n,) int32
    weight : (n,) int64, polygons that the item stands for
    reflectance : (n, 3) float64, 0..1;  emission : (n, 3) float64, W/m2
    vertices : (V, 3) float64;  vertex_start : (n + 1,) int64, item i owns ``vertices[vertex_start[i]:vertex_start[i + 1]]``, one at least
    """

    barycenter: np.ndarray
    normal: np.ndarray
    box_min: np.ndarray
    box_max: np.ndarray
    smaller_edge: np.ndarray
    room: np.ndarray
    weight: np.ndarray
    reflectance: np.ndarray
    emission: np.ndarray
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
    iterations : (R,) int32, Lloyd steps that each room took (where a hierarchy divided it: the most that a node of it took), 0 without
        items to sort
    oscillated : (R,) bool, the room (or a node of it) came back to an earlier state instead of settling
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


def partition(items: ClusterItems, key: np.ndarray, iterations: np.ndarray, oscillated: np.ndarray) -> Clusters:
    """The groups of equal ``key`` (n,) int64, none of which spans rooms, numbered by room and smallest item, and bounded."""
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
        reflectance=scene.reflectance.astype(np.float64),
        emission=scene.emission.astype(np.float64),
        vertices=vertices,
        vertex_start=start,
    )


def clusters_as_items(items: ClusterItems, clusters: Clusters) -> ClusterItems:
    """The clusters of ``items`` as things to be gathered in turn: one item per cluster, of weight 1, with all its corners.

    Barycenter, normal, reflectance and emission are the means of the members.
    """
    size = np.diff(clusters.start)
    middle = 0.5 * (clusters.box_min + clusters.box_max)
    owner = np.repeat(np.arange(len(clusters)), size)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(owner, column, minlength=len(clusters)) / size for column in values.T], axis=1)

    normal = mean(items.normal[clusters.members])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    corners = np.diff(items.vertex_start)[clusters.members]
    vertex = ragged(items.vertex_start[:-1][clusters.members], corners)[0]
    return ClusterItems(
        barycenter=middle + mean(items.barycenter[clusters.members] - middle[owner]),
        normal=np.where(length > 0, normal / np.where(length > 0, length, 1), 0.0),
        box_min=clusters.box_min,
        box_max=clusters.box_max,
        smaller_edge=np.zeros(len(clusters)),
        room=clusters.room,
        weight=np.ones(len(clusters), np.int64),
        reflectance=mean(items.reflectance[clusters.members]),
        emission=mean(items.emission[clusters.members]),
        vertices=items.vertices[vertex],
        vertex_start=np.concatenate([np.zeros(1, np.int64), np.cumsum(corners)])[clusters.start],
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
