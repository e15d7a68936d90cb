"""Hierarchies of clusters (section 4.5 of the paper), and the clusters of a huge room by way of one.

Items are parted among N clusters, those of each cluster among N more, and so on: every level costs N distances per item
and there are log(N_g) / log(N) levels, where the flat algorithm costs N_g distances per item. All nodes of a level are
parted in one go, each as if it were a room.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..grouping import ragged
from .distances import Distance, barycenter_distance
from .isodata import lloyd
from .items import ClusterItems, Clusters, clusters_as_items
from .neighbours import numbered_by_room, settle
from .seeds import Seeding, spread_seeds

SCATTER_POWER = 0.6
"""Clusters of a node grow with this power of its scatter: equal scatter per cluster would be least in sum, in space, at 3/5."""


@dataclass(frozen=True)
class Hierarchy:
    """Trees of clusters, one per room that has any; M nodes, level after level, so that parents come before their children.

    parent : (M,) int32, -1 at the root of a room;  level : (M,) int32, 0 at the roots
    first_child, child_count : (M,) int32, the children of a node follow one another; none at a leaf
    cluster : (M,) int32, the cluster that a leaf holds, -1 at inner nodes: what belongs to a node is stored at its leaves alone
    room : (M,) int32;  box_min, box_max : (M, 3) float64, metres, of all below
    """

    parent: np.ndarray
    level: np.ndarray
    first_child: np.ndarray
    child_count: np.ndarray
    cluster: np.ndarray
    room: np.ndarray
    box_min: np.ndarray
    box_max: np.ndarray

    def __len__(self) -> int:
        return len(self.parent)

    def children(self, node: int) -> np.ndarray:
        """(k,) int64 children of a node."""
        return self.first_child[node] + np.arange(self.child_count[node])

    def clusters_below(self, node: int) -> np.ndarray:
        """(k,) int64 clusters at the leaves of a node, rising; of a leaf: its own."""
        nodes, leaves = np.array([node]), []
        while len(nodes):
            leaves.append(self.cluster[nodes][self.child_count[nodes] == 0])
            nodes = ragged(self.first_child[nodes], self.child_count[nodes])[0]
        return np.sort(np.concatenate(leaves)).astype(np.int64)


def hierarchy_of(
    items: ClusterItems,
    clusters: Clusters,
    *,
    children: Sequence[int] = (2,),
    distance: Distance = barycenter_distance,
    seeding: Seeding = spread_seeds,
    rng: np.random.Generator,
) -> Hierarchy:
    """Gather the clusters of every room in a tree by the k-means of section 4.5, clusters being what is parted.

    children : most children of a node at level 0, 1, ..; the last number holds for all further levels
    Raises ValueError when one of them is under 2.
    """
    elements = clusters_as_items(items, clusters)
    rows = np.argsort(elements.room, kind="stable")
    room = np.unique(elements.room)
    start = np.searchsorted(elements.room[rows], np.append(room, np.iinfo(np.int32).max))

    def part(rows: np.ndarray, start: np.ndarray, number: np.ndarray) -> np.ndarray:
        seeds = rows[seeding(elements.barycenter[rows], start, number, rng)]
        label = lloyd(elements, rows, start, number, seeds, distance)[0]
        return _dealt_where_undivided(label, start, number)

    tree = _grow(rows, start, np.diff(start), children, lambda rows, start, *_: np.diff(start), part)
    cluster = np.full(len(tree.parent), -1, np.int32)
    cluster[tree.node_of] = np.arange(len(clusters))
    low, high = np.full((len(cluster), 3), np.inf), np.full((len(cluster), 3), -np.inf)
    low[tree.node_of], high[tree.node_of] = clusters.box_min, clusters.box_max
    for level in range(int(tree.level.max(initial=0)), 0, -1):
        nodes = np.flatnonzero(tree.level == level)
        np.minimum.at(low, tree.parent[nodes], low[nodes])
        np.maximum.at(high, tree.parent[nodes], high[nodes])
    inner = tree.parent >= 0
    count = np.bincount(tree.parent[inner], minlength=len(cluster))
    return Hierarchy(
        parent=tree.parent.astype(np.int32),
        level=tree.level.astype(np.int32),
        first_child=np.where(count > 0, np.searchsorted(tree.parent, np.arange(len(cluster))), 0).astype(np.int32),
        child_count=count.astype(np.int32),
        cluster=cluster,
        room=room[tree.root].astype(np.int32),
        box_min=low,
        box_max=high,
    )


def divide(
    items: ClusterItems,
    rows: np.ndarray,
    start: np.ndarray,
    average: int,
    *,
    children: Sequence[int],
    distance: Distance,
    seeding: Seeding,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The clusters of huge rooms, from the whole room down to groups of about ``average`` polygons.

    Rooms, rows and results are as in :func:`~.isodata.lloyd`: (label (m,) int64, most steps of any node (R,) int32, oscillated (R,) bool).
    Clusters are shared out among the children of a node by their scatter, which gives crowded corners and wide halls the boxes that the
    flat algorithm gives them. A group that the distance cannot part, such as polygons that coincide, stays whole. In the end
    items move between neighbouring clusters until they rest.
    """
    iterations = np.zeros(len(start) - 1, np.int32)
    oscillated = np.zeros(len(start) - 1, bool)
    room = np.zeros(len(items), np.int64)
    room[rows] = np.repeat(np.arange(len(start) - 1), np.diff(start))

    def part(rows: np.ndarray, start: np.ndarray, number: np.ndarray) -> np.ndarray:
        seeds = rows[seeding(items.barycenter[rows], start, number, rng)]
        label, steps, again = lloyd(items, rows, start, number, seeds, distance)
        np.maximum.at(iterations, room[rows[start[:-1]]], steps)
        np.logical_or.at(oscillated, room[rows[start[:-1]]], again)
        return label

    def wanted(rows: np.ndarray, start: np.ndarray, owner: np.ndarray, of_parents: np.ndarray) -> np.ndarray:
        return _allotted(of_parents, owner, _scatter(items.barycenter[rows], start) ** SCATTER_POWER, np.diff(start))

    polygons = np.add.reduceat(items.weight[rows], start[:-1])
    leaf = _grow(rows, start, cluster_numbers(polygons, average), children, wanted, part).node_of[rows]
    label, cluster_start = numbered_by_room(leaf, start)
    label, steps, again = settle(items, rows, start, label, cluster_start, distance)
    return label, np.maximum(iterations, steps), oscillated | again


def cluster_numbers(polygons: np.ndarray, average: int) -> np.ndarray:
    """N_g = N_t / N_ave of section 4.3, rounded, 1 at least: (R,) int64 for rooms of ``polygons`` (R,)."""
    return np.maximum(np.floor(polygons / average + 0.5), 1).astype(np.int64)


@dataclass(frozen=True)
class _Tree:
    """parent, level, root : (M,) int64 of every node; node_of : (n,) int64 the leaf of every item that was parted."""

    parent: np.ndarray
    level: np.ndarray
    root: np.ndarray
    node_of: np.ndarray


def _grow(
    rows: np.ndarray,
    start: np.ndarray,
    groups: np.ndarray,
    children: Sequence[int],
    wanted: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    part: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> _Tree:
    """Part the rows of every root, level by level, until no node should end in more than one group or can be parted.

    groups : (roots,) int64, groups that each root should end in
    wanted(rows, start, owner, groups) : (q,) the same of new nodes, children of ``owner`` (q,), of which ``groups`` were wanted
    part(rows, start, number) : label of every row, as ``lloyd`` has it
    """
    if not len(children) or min(children) < 2:
        raise ValueError("a node of a hierarchy has two children at least")
    roots = len(start) - 1
    parent, levels, root = [np.full(roots, -1)], [np.zeros(roots, np.int64)], [np.arange(roots)]
    node = top = np.arange(roots)
    node_of = np.zeros(int(rows.max(initial=-1)) + 1, np.int64)
    node_of[rows] = np.repeat(node, np.diff(start))
    count, level = roots, 0
    while len(rows):
        size = np.diff(start)
        number = np.minimum(np.minimum(groups, children[min(level, len(children) - 1)]), size)
        go_on = number > 1
        rows, node, top, number, groups = rows[np.repeat(go_on, size)], node[go_on], top[go_on], number[go_on], groups[go_on]
        start = np.concatenate([np.zeros(1, np.int64), np.cumsum(size[go_on])])
        if not len(rows):
            break
        label = part(rows, start, number)
        order = np.argsort(label, kind="stable")
        found, position = np.unique(label[order], return_index=True)
        owner = np.searchsorted(np.cumsum(number), found, side="right")
        parted = np.bincount(owner, minlength=len(node))[owner] > 1
        length = np.diff(np.append(position, len(rows)))
        rows = rows[order][np.repeat(parted, length)]
        start = np.concatenate([np.zeros(1, np.int64), np.cumsum(length[parted])])
        owner = owner[parted]
        groups = wanted(rows, start, owner, groups)
        level += 1
        parent.append(node[owner])
        top = top[owner]
        node = count + np.arange(len(top))
        root.append(top)
        levels.append(np.full(len(top), level))
        count += len(top)
        node_of[rows] = np.repeat(node, np.diff(start))
    return _Tree(np.concatenate(parent), np.concatenate(levels), np.concatenate(root), node_of)


def _dealt_where_undivided(label: np.ndarray, start: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Labels of :func:`lloyd`, but where all rows of a node have one label they are dealt out evenly in their order."""
    size = np.diff(start)
    owner = np.repeat(np.arange(len(size)), size)
    different = np.bincount(owner, label != label[start[:-1]][owner], minlength=len(size)) > 0
    rank = np.arange(len(label)) - start[:-1][owner]
    dealt = (np.cumsum(number) - number)[owner] + rank * number[owner] // size[owner]
    return np.where(different[owner], label, dealt)


def _scatter(position: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(Q,) float64: summed squared distance of the positions (m, 3) of every group to their mean."""
    size = np.diff(start)
    owner = np.repeat(np.arange(len(size)), size)
    offset = position - position[start[:-1]][owner]
    mean = np.add.reduceat(offset, start[:-1], axis=0) / size[:, None]
    return np.add.reduceat(((offset - mean[owner]) ** 2).sum(axis=1), start[:-1])


def _allotted(groups: np.ndarray, owner: np.ndarray, share: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Groups that the children (q,) of nodes should end in: one each, the rest of their parent's by ``share``, ``size`` at most.

    Whole numbers come from rounding the running sums, so that they add up.
    """
    family = np.bincount(owner, minlength=len(groups))
    total = np.bincount(owner, share, minlength=len(groups))[owner]
    part = np.where(total > 0, share, 1.0) / np.where(total > 0, total, family[owner])
    whole = 1.0 + np.diff(np.floor(np.cumsum(part * (groups - family)[owner]) + 0.5), prepend=0.0)
    return np.minimum(whole, size).astype(np.int64)
