"""Goldsmith and Salmon's automatic bounding volume hierarchy (1987): what the paper compares its clustering with.

Objects are inserted one at a time. Each goes down from the root to the child whose box grows least in surface. On the way two places
are weighed at every node: as one more child of it, or paired with it under a new node. A place costs what it adds to the expected number
of box tests of a ray, the sum of (surface * children) over all nodes; the cheapest on the way is taken. What an insertion does depends on
all before it, so that this baseline, alone in this package, runs a loop of plain Python over the objects.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..grouping import starts_of
from .hierarchy import cluster_numbers
from .items import ClusterItems, Clusters, partition


def bounding_volume_clusters(
    items: ClusterItems, room_count: int, *, average: int, large_polygon: float = 1.0, rng: np.random.Generator
) -> Clusters:
    """The subtrees of a bounding volume hierarchy of each room as clusters, about as many as ``cluster_items`` aims at.

    Of a room's tree, the largest subtrees of no more polygons than some limit are taken; the limit is the one that brings their number
    closest to N_t / N_ave. Large items stand alone. Items are inserted in an order drawn from ``rng``, as the authors advise: in a
    file neighbours follow each other, which makes poor trees.
    """
    small = np.flatnonzero(items.smaller_edge <= large_polygon)
    rows = rng.permutation(small)
    rows = rows[np.argsort(items.room[rows], kind="stable")]
    start = starts_of(items.room[rows], room_count)
    number = cluster_numbers(np.bincount(items.room[rows], items.weight[rows], minlength=room_count), average)
    key = np.empty(len(items), np.int64)
    count = 0
    for r in np.flatnonzero(np.diff(start)):
        own = rows[start[r] : start[r + 1]]
        parent = bounding_volume_tree(items.box_min[own], items.box_max[own])
        label = _cut(parent, items.weight[own], int(number[r]))
        key[own] = count + label
        count += len(parent)
    large = np.setdiff1d(np.arange(len(items)), small)
    key[large] = count + np.arange(len(large))
    return partition(items, key, np.zeros(room_count, np.int32), np.zeros(room_count, bool))


def bounding_volume_tree(box_min: np.ndarray, box_max: np.ndarray) -> np.ndarray:
    """(M,) int64 parent of every node, -1 at the root: the tree of n boxes (n, 3), inserted in their order; node i < n is box i itself."""
    boxes = [(*low, *high) for low, high in zip(box_min.tolist(), box_max.tolist(), strict=True)]
    areas = [_area(b) for b in boxes]
    children: list[list[int]] = [[] for _ in boxes]
    root = 0
    for new in range(1, len(box_min)):
        box = boxes[new]
        node, inherited, best, depth, paired = root, 0.0, math.inf, 0, True
        path: list[tuple[int, tuple[float, ...], float]] = []  # nodes on the way, with the boxes that they would have
        while True:
            grown = _union(boxes[node], box)
            area = _area(grown)
            path.append((node, grown, area))
            cost = inherited + 2.0 * area
            if cost < best:
                best, depth, paired = cost, len(path), True
            below = children[node]
            if not below:
                break
            cost = inherited + area * (len(below) + 1) - areas[node] * len(below)
            if cost <= best:
                best, depth, paired = cost, len(path), False
            inherited += (area - areas[node]) * len(below)
            node = _least_grown(below, boxes, areas, box)
        at = path[depth - 1][0]
        for passed, grown, area in path[: depth - 1 if paired else depth]:
            boxes[passed], areas[passed] = grown, area
        if not paired:
            children[at].append(new)
            continue
        pair = len(boxes)
        boxes.append(path[depth - 1][1])
        areas.append(path[depth - 1][2])
        children.append([at, new])
        if depth == 1:
            root = pair
        else:
            above = children[path[depth - 2][0]]
            above[above.index(at)] = pair
    parent = np.full(len(boxes), -1)
    for node, below in enumerate(children):
        parent[below] = node
    return parent


def _least_grown(nodes: Sequence[int], boxes: list, areas: list[float], box: tuple[float, ...]) -> int:
    """The node whose box takes in ``box`` with the least growth of surface; the first that need not grow at all."""
    best, least = nodes[0], math.inf
    x0, y0, z0, x1, y1, z1 = box
    for node in nodes:
        a0, b0, c0, a1, b1, c1 = boxes[node]
        a = (a1 if a1 > x1 else x1) - (a0 if a0 < x0 else x0)
        b = (b1 if b1 > y1 else y1) - (b0 if b0 < y0 else y0)
        c = (c1 if c1 > z1 else z1) - (c0 if c0 < z0 else z0)
        growth = a * b + b * c + c * a - areas[node]
        if growth < least:
            best, least = node, growth
            if growth <= 0.0:
                break
    return best


def _union(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return (*map(min, a[:3], b[:3]), *map(max, a[3:], b[3:]))


def _area(box: tuple[float, ...]) -> float:
    """Half the surface of a box (x0, y0, z0, x1, y1, z1)."""
    a, b, c = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return a * b + b * c + c * a


def _cut(parent: np.ndarray, weight: np.ndarray, number: int) -> np.ndarray:
    """(n,) int64: of each leaf the largest subtree around it that is within the limit, for about ``number`` subtrees."""
    leaves = len(weight)
    polygons = np.zeros(len(parent), np.int64)
    polygons[:leaves] = weight
    levels = [np.flatnonzero(parent < 0)]
    order = np.argsort(parent, kind="stable")
    start = starts_of(parent[order], len(parent))
    while len(levels[-1]):
        levels.append(np.concatenate([order[start[n] : start[n + 1]] for n in levels[-1]]))
    for level in reversed(levels[1:]):
        np.add.at(polygons, parent[level], polygons[level])
    of_parent = np.where(parent >= 0, polygons[parent], np.iinfo(np.int64).max)
    limits = np.unique(polygons)
    # A subtree is taken at every limit from its own polygons up to those of its parent.
    taken = np.searchsorted(np.sort(polygons), limits, side="right") - np.searchsorted(np.sort(of_parent), limits, side="right")
    limit = max(limits[np.argmin(np.abs(taken - number))], polygons[:leaves].max())
    top = np.where(of_parent > limit, np.arange(len(parent)), -1)
    for level in levels[1:]:
        top[level] = np.where(top[level] < 0, top[parent[level]], top[level])
    return top[:leaves]
