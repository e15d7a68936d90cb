"""Which pairs of surfaces may see each other at all, and what can stand between them: the work of the oracle, cut into scopes.

The pairs of a few small rooms, or of a part of a large one, make one scope; those of a group of clusters and all that
it sees in other rooms make another, since much more lies between them. A scope is treated tile by tile: some surfaces
with some others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .building import Building

WITHIN, BETWEEN = 384, 128
"""Regions whose pairs within their rooms, and with other rooms, make one scope."""
CELLS = 1 << 17
"""Pairs of regions that are looked at at once."""
MOST = 8
"""A scope of more than ``CELLS`` pairs makes at most so many tiles of more: in large rooms few pairs matter."""


@dataclass(frozen=True)
class Scope:
    """Pairs of some clusters and all that they see: within their rooms, or in other rooms.

    clusters : (c,) int64;  within : bool
    """

    clusters: np.ndarray
    within: bool


@dataclass(frozen=True)
class Tile:
    """Pairs of the ``scope`` with some of what it sees, each pair of the building in one tile.

    others : (d,) int64 clusters;  nearby : (n,) clusters that hold all that a segment between such a pair can meet
    """

    scope: Scope
    others: np.ndarray
    nearby: np.ndarray


def scopes(building: Building) -> list[Scope]:
    """All scopes in a fixed order."""
    return [Scope(group, within) for size, within in ((WITHIN, True), (BETWEEN, False)) for group in _groups(building, size)]


def tiles(building: Building, scope: Scope) -> Iterator[Tile]:
    """The tiles of a scope; there may be none."""
    nearby = building.surroundings(scope.clusters)
    others = nearby[_meets(building, scope, nearby).any(0)]
    cells = _regions(building, scope.clusters) * _regions(building, others)
    for part in _parts(building, scope, others, max(CELLS, cells // MOST)):
        yield Tile(scope, part, nearby)


def pairs_of(building: Building, tile: Tile) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Regions a and b (n,) int32 of the pairs of a tile, some at a time: their clusters see each other.

    A pair is left out where all of the cluster of one lies behind the other.
    """
    own, clusters, centre = tile.scope.clusters, building.clusters, building.regions.centre
    mine, i = building.regions_of(own)
    for others in _parts(building, tile.scope, tile.others, CELLS):
        theirs, j = building.regions_of(others)
        found = _meets(building, tile.scope, others)[i][:, j]
        for regions, there, column, cells in ((mine, others, j, found), (theirs, own, i, found.T)):
            cells &= _before(building, regions, clusters.box_min[there] - centre, clusters.box_max[there] - centre)[:, column]
        found &= (own[i][:, None] != others[j]) | (mine[:, None] < theirs)
        # All of the scope with one of the others, and then with the next: pairs that follow each other are of few surfaces.
        column, row = np.nonzero(found.T)
        yield mine[row].astype(np.int32), theirs[column].astype(np.int32)


def _parts(building: Building, scope: Scope, others: np.ndarray, cells: int) -> list[np.ndarray]:
    """Clusters ``others`` cut into parts whose regions make about so many pairs with those of the scope."""
    size = np.cumsum(np.diff(building.clusters.start)[others]) * _regions(building, scope.clusters) // cells
    return np.split(others, np.flatnonzero(np.diff(size)) + 1) if len(others) else []


def _regions(building: Building, clusters: np.ndarray) -> int:
    """How many regions clusters have."""
    return int(np.diff(building.clusters.start)[clusters].sum())


def _meets(building: Building, scope: Scope, others: np.ndarray) -> np.ndarray:
    """(c, d) bool: pairs of a cluster of the scope and one of ``others`` (d,) that belong to it, as the one of the lesser cluster."""
    own, room = scope.clusters[:, None], building.clusters.room
    return building.graph.sees(own, others) & (own <= others) & ((room[own] == room[others]) == scope.within)


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


def _before(building: Building, regions: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n, c) bool: some of the box ``low``..``high`` (c, 3), from the middle of the scene, lies in front of the plane of a region (n,)."""
    normal = building.regions.normal[regions]
    plane = np.einsum("ij,ij->i", normal, building.regions.origin[regions]) + building.blockers.clearance
    return np.maximum(normal, 0) @ high.T + np.minimum(normal, 0) @ low.T > plane[:, None]
