"""Which pairs of surfaces may see each other at all, and what can stand between them: the work of the oracle, cut into scopes.

The pairs of a few small rooms, or of a part of a large one, make one scope; those of a group of clusters and all that
it sees in other rooms make another, since much more lies between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .building import Building
from .grouping import ragged

WITHIN, BETWEEN = 384, 128
"""Regions whose pairs within their rooms, and with other rooms, make one scope."""


@dataclass(frozen=True)
class Scope:
    """Pairs of regions whose clusters see each other, each pair of the building in one scope.

    a, b : (n,) int32 regions
    nearby : (c,) clusters that hold all that a segment between such a pair can meet
    """

    a: np.ndarray
    b: np.ndarray
    nearby: np.ndarray


def scope_groups(building: Building) -> list[tuple[np.ndarray, bool]]:
    """Groups of clusters and whether their pairs within rooms are meant, in a fixed order: each makes one scope."""
    return [(group, within) for size, within in ((WITHIN, True), (BETWEEN, False)) for group in _groups(building, size)]


def scope_of(building: Building, group: np.ndarray, within: bool) -> Scope:
    """The scope of a group of clusters; it may have no pairs."""
    a, b = _pairs(building, group, within)
    return Scope(a, b, building.surroundings(group))


def _groups(building: Building, size: int) -> list[np.ndarray]:
    """Clusters in groups of about ``size`` regions, neighbours in the order of their rooms; a group ends with its room where it can."""
    clusters = building.clusters
    order = np.argsort(clusters.room, kind="stable")
    room, count = clusters.room[order], np.diff(clusters.start)[order]
    begin = np.flatnonzero(np.r_[True, room[1:] != room[:-1]])
    groups, waiting, total = [], [], 0
    for rows in np.split(np.arange(len(order)), begin[1:]):
        number = int(count[rows].sum())
        if waiting and total + number > size:
            groups.append(np.concatenate(waiting))
            waiting, total = [], 0
        if number > size:  # a large room is cut by itself
            part = np.cumsum(count[rows]) * (-(-number // size)) // (number + 1)
            groups += [order[rows[part == k]] for k in np.unique(part)]
        else:
            waiting.append(order[rows])
            total += number
    return groups + ([np.concatenate(waiting)] if waiting else [])


def _pairs(building: Building, group: np.ndarray, within: bool) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of regions, the first in ``group``, whose clusters see each other, in one room or in different ones.

    Every pair comes once in all groups: where its lesser cluster is in the group. A pair is left out where all of one cluster lies
    behind the region of the other.
    """
    regions, clusters = building.regions, building.clusters
    room, start = clusters.room, clusters.start
    low, high = clusters.box_min - regions.centre, clusters.box_max - regions.centre
    own, other = [], []
    for cluster in group:
        near = building.graph.neighbours(int(cluster))
        near = near[(near > cluster) & ((room[near] == room[cluster]) == within)]
        mine = clusters.members[start[cluster] : start[cluster + 1]]
        members, owner = ragged(start[near], np.diff(start)[near])
        theirs = clusters.members[members]
        facing = np.flatnonzero(_before(building, theirs, low[[cluster]], high[[cluster]])[:, 0])
        # All of the cluster with some of the others, and then with some more: pairs that follow each other are of few surfaces.
        k, i = np.nonzero(_before(building, mine, low[near], high[near]).T[owner[facing]])
        own.append(mine[i])
        other.append(theirs[facing[k]])
        if within:
            i, j = np.triu_indices(len(mine), 1)
            own.append(mine[i])
            other.append(mine[j])
    return np.concatenate(own).astype(np.int32), np.concatenate(other).astype(np.int32)


def _before(building: Building, regions: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n, c) bool: some of the box ``low``..``high`` (c, 3), from the middle of the scene, lies in front of the plane of a region (n,)."""
    normal = building.regions.normal[regions]
    plane = np.einsum("ij,ij->i", normal, building.regions.origin[regions]) + building.blockers.clearance
    return np.maximum(normal, 0) @ high.T + np.minimum(normal, 0) @ low.T > plane[:, None]
