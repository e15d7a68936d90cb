"""Clusters of polygons that lie close together, per room: section 4 of the paper."""

from .by_room import CHILDREN, HUGE_ROOM, SPLIT_MERGE, cells, cluster_as_chosen, cluster_items
from .distances import DISTANCE_FUNCTIONS, Candidates, Distance, weighted_sum
from .hierarchy import Hierarchy, hierarchy_of
from .items import ClusterItems, Clusters, cluster_items_of
from .seeds import SEEDINGS, Seeding, random_seeds, spread_seeds

__all__ = [
    "CHILDREN",
    "DISTANCE_FUNCTIONS",
    "HUGE_ROOM",
    "SEEDINGS",
    "SPLIT_MERGE",
    "Candidates",
    "ClusterItems",
    "Clusters",
    "Distance",
    "Hierarchy",
    "Seeding",
    "cells",
    "cluster_as_chosen",
    "cluster_items",
    "cluster_items_of",
    "hierarchy_of",
    "random_seeds",
    "spread_seeds",
    "weighted_sum",
]
