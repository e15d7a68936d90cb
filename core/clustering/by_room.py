"""The clusters of a scene, room by room: large polygons alone, the others by ISODATA, in huge rooms by way of a hierarchy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..grouping import starts_of
from ..options import Options
from .distances import (
    DISTANCE_FUNCTIONS,
    Distance,
    barycenter_distance,
    emission_distance,
    orientation_distance,
    reflectance_distance,
    weighted_sum,
)
from .hierarchy import cluster_numbers, divide
from .isodata import lloyd
from .items import ClusterItems, Clusters, partition
from .neighbours import numbered_by_room
from .seeds import SEEDINGS, Seeding, spread_seeds
from .split_merge import split_and_merge

HUGE_ROOM = 4000
"""Polygons of a room above which a hierarchy forms its clusters: there it takes half the time of the flat algorithm, for boxes as tight."""
CHILDREN = (16,)
"""Most children of a node of this hierarchy; from 8 to 32 neither time nor boxes differ much."""
SPLIT_MERGE = 2
"""Most rounds of splitting and merging: two bring most of what can be had."""


def cluster_as_chosen(items: ClusterItems, room_count: int, options: Options, rng: np.random.Generator) -> Clusters:
    """:func:`cluster_items` with the choices of a user."""
    weights = (options.reflectance_weight, options.emission_weight, options.orientation_weight)
    added = zip(weights, (reflectance_distance, emission_distance, orientation_distance), strict=True)
    terms = [(1.0, DISTANCE_FUNCTIONS[options.distance]), *((weight, term) for weight, term in added if weight > 0)]
    return cluster_items(
        items,
        room_count,
        average=options.average,
        distance=weighted_sum(*terms) if len(terms) > 1 else terms[0][1],
        large_polygon=options.large_polygon,
        seeding=SEEDINGS[options.seeding],
        huge_room=options.huge_room,
        children=(options.hierarchy_children,),
        split_merge=options.split_merge,
        rng=rng,
    )


def cells(items: ClusterItems, room_count: int) -> Clusters:
    """One cluster per room that has items: the cells of the paper, for comparison."""
    return partition(items, items.room.astype(np.int64), np.zeros(room_count, np.int32), np.zeros(room_count, bool))


def cluster_items(
    items: ClusterItems,
    room_count: int,
    *,
    average: int,
    distance: Distance = barycenter_distance,
    large_polygon: float = 1.0,
    seeding: Seeding = spread_seeds,
    huge_room: int = HUGE_ROOM,
    children: Sequence[int] = CHILDREN,
    split_merge: int = SPLIT_MERGE,
    rng: np.random.Generator,
) -> Clusters:
    """Sort items into clusters, each within one room (ISODATA, paper section 4).

    average : polygons per cluster that are aimed at; the number of clusters of a room is its polygons (the large
        ones left out) over ``average``, rounded, 1 at least; clusters that lose all their items are dropped
    distance : one of ``DISTANCE_FUNCTIONS``, a ``weighted_sum`` of them, or any function of the form ``Distance``
    large_polygon : metres, items whose smaller edge is longer stand alone (section 4.4)
    seeding : where the clusters begin, :func:`spread_seeds` or, as in the paper, :func:`random_seeds`
    huge_room : rooms with more polygons than this (the large ones left out) are divided by a hierarchy (section 4.5), in O(N log N)
    children : most children of a node at level 0, 1, .. of this hierarchy; the last number holds for all further levels
    split_merge : most rounds of :func:`split_and_merge` that make the boxes smaller in the end; 0: none, as in the paper
    """
    small = np.flatnonzero(items.smaller_edge <= large_polygon)
    rows = small[np.argsort(items.room[small], kind="stable")]
    row_room = items.room[rows].astype(np.int64)
    start = starts_of(row_room, room_count)
    size = np.diff(start)
    polygons = np.bincount(row_room, items.weight[rows], minlength=room_count)
    huge = (polygons > huge_room) & (size > 1)
    number = np.where(huge, 0, np.minimum(cluster_numbers(polygons, average), size))
    seeds = rows[seeding(items.barycenter[rows], start, number, rng)]
    label, iterations, oscillated = lloyd(items, rows, start, number, seeds, distance)
    if huge.any():
        inside = huge[row_room]
        huge_start = np.concatenate([np.zeros(1, np.int64), np.cumsum(size[huge])])
        label[inside], iterations[huge], oscillated[huge] = divide(
            items, rows[inside], huge_start, average, children=children, distance=distance, seeding=seeding, rng=rng
        )
    label = split_and_merge(items, rows, start, label, split_merge, distance=distance, seeding=seeding, rng=rng)
    key = np.empty(len(items), np.int64)
    key[rows], cluster_start = numbered_by_room(label, start)
    large = np.setdiff1d(np.arange(len(items)), small)
    key[large] = cluster_start[-1] + np.arange(len(large))
    return partition(items, key, iterations, oscillated)
