"""Splitting and merging of clusters: what makes ISODATA more than k-means (Ball and Hall 1965), here to make boxes small.

Lloyd's iteration keeps a cluster near where it began: two may share a heap while a third serves two heaps far apart. To split
the third and merge the first two leaves their number as it is and makes the boxes smaller. Ball and Hall split by standard
deviation and merge by distance, with a threshold for each; here both are judged by the surface of the boxes, which says how much
a cluster sees and needs no threshold: a split is made where it gains more than a merge in the same room costs.
"""

from __future__ import annotations

import numpy as np

from ..grouping import ragged, starts_of
from .distances import Distance, Groups
from .isodata import lloyd
from .items import ClusterItems
from .neighbours import nearest_clusters, numbered_by_room, settle
from .seeds import Seeding

MARGIN = 1.1
"""Gain of a split over the cost of the merge that pays for it; what is nearly even would only go back and forth."""


def split_and_merge(
    items: ClusterItems,
    rows: np.ndarray,
    start: np.ndarray,
    label: np.ndarray,
    rounds: int,
    *,
    distance: Distance,
    seeding: Seeding,
    rng: np.random.Generator,
) -> np.ndarray:
    """Rounds of splits, merges and Lloyd steps among neighbours, in all rooms at once; a room never gets more clusters by it.

    rows : (m,) items sorted by room, room r owns ``rows[start[r]:start[r + 1]]``;  label : (m,) int64 cluster of each, of its room
    Returns label (m,) int64. A room in which no exchange pays is left alone from then on.
    """
    label = label.copy()
    rooms = np.arange(len(start) - 1)
    for _ in range(rounds):
        size = np.diff(start)[rooms]
        position = ragged(start[rooms], size)[0]
        own_start = np.concatenate([np.zeros(1, np.int64), np.cumsum(size)])
        index, cluster_start = numbered_by_room(label[position], own_start)
        index, changed = _exchange(items, rows[position], index, cluster_start, distance, seeding, rng)
        if not changed.any():
            break
        index, cluster_start = numbered_by_room(index, own_start)
        label[position] = settle(items, rows[position], own_start, index, cluster_start, distance)[0]
        rooms = rooms[changed]
    return label


def _exchange(
    items: ClusterItems,
    rows: np.ndarray,
    label: np.ndarray,
    cluster_start: np.ndarray,
    distance: Distance,
    seeding: Seeding,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """One round: (label (m,) with the splits and merges that pay, which rooms had any (R,) bool); splits get numbers of their own."""
    count = int(cluster_start[-1])
    room = np.repeat(np.arange(len(cluster_start) - 1), np.diff(cluster_start))
    second = _second_halves(items, rows, label, count, distance, seeding, rng)
    low, high = _boxes(items, rows, 2 * label + second, 2 * count)
    halves = _half_area(low, high).reshape(count, 2)
    low, high = low.reshape(count, 2, 3).min(axis=1), high.reshape(count, 2, 3).max(axis=1)
    whole = _half_area(low, high)
    parted = np.bincount(label[second], minlength=count) > 0
    gain = np.where(parted, whole - halves.sum(axis=1), -np.inf)

    seeds = np.zeros(count, np.int64)
    seeds[label] = rows
    groups = Groups(items, seeds)
    groups.move(rows, label)
    a, b = _neighbouring_pairs(nearest_clusters(groups.of("barycenter"), cluster_start))
    cost = _half_area(np.minimum(low[a], low[b]), np.maximum(high[a], high[b])) - whole[a] - whole[b]
    rooms = len(cluster_start) - 1
    couple = _cheapest_for_both(a, b, cost, count)
    split, merge = _paired(np.flatnonzero(gain > 0), gain, couple, cost, room, room[a], rooms)
    # The last pair of a room that pays sets the price of a cluster there. A cluster that could be split as well as merged does what it is
    # the better for at this price, and the others are coupled anew without those that will be split.
    price = np.full(rooms, np.nan)
    price[room[split]] = 0.5 * (gain[split] + cost[merge])
    surplus = gain - price[room]
    saved = np.full(count, -np.inf)
    saved[a[couple]] = saved[b[couple]] = price[room[a[couple]]] - cost[couple]
    splitting = (surplus > 0) & (surplus >= saved)
    rest = np.flatnonzero(~splitting[a] & ~splitting[b])
    couple = rest[_cheapest_for_both(a[rest], b[rest], cost[rest], count)]
    split, merge = _paired(np.flatnonzero(splitting), gain, couple, cost, room, room[a], rooms)
    target = np.arange(count)
    target[b[merge]] = a[merge]
    is_split = np.zeros(count, bool)
    is_split[split] = True
    return np.where(second & is_split[label], count + label, target[label]), np.bincount(room[split], minlength=rooms) > 0


def _second_halves(
    items: ClusterItems, rows: np.ndarray, label: np.ndarray, count: int, distance: Distance, seeding: Seeding, rng: np.random.Generator
) -> np.ndarray:
    """(m,) bool: the rows that would leave their cluster if Lloyd's iteration parted it in two."""
    order = np.argsort(label, kind="stable")
    inside = rows[order]
    start = starts_of(label[order], count)
    number = np.minimum(np.diff(start), 2)
    seeds = inside[seeding(items.barycenter[inside], start, number, rng)]
    half = lloyd(items, inside, start, number, seeds, distance)[0]
    result = np.zeros(len(rows), bool)
    result[order] = half != half[start[:-1]][label[order]]
    return result


def _neighbouring_pairs(near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs a < b of clusters one of which is near the other, each once, from ``near`` (g, k), a cluster itself first."""
    count = len(near)
    a, b = np.repeat(np.arange(count), near.shape[1] - 1), near[:, 1:].reshape(-1)
    pair = np.unique((np.minimum(a, b) * count + np.maximum(a, b))[a != b])
    return pair // max(count, 1), pair % max(count, 1)


def _paired(
    splits: np.ndarray, gain: np.ndarray, merges: np.ndarray, cost: np.ndarray, split_room: np.ndarray, merge_room: np.ndarray, rooms: int
) -> tuple[np.ndarray, np.ndarray]:
    """(p,), (p,): the best of the ``splits`` of a room with the cheapest of its ``merges``, the next with the next, as long as it pays."""
    splits = splits[np.lexsort((-gain[splits], split_room[splits]))]
    merges = merges[np.lexsort((cost[merges], merge_room[merges]))]
    split_start, merge_start = starts_of(split_room[splits], rooms), starts_of(merge_room[merges], rooms)
    both = np.minimum(np.diff(split_start), np.diff(merge_start))
    splits, merges = splits[ragged(split_start[:-1], both)[0]], merges[ragged(merge_start[:-1], both)[0]]
    pays = gain[splits] > MARGIN * cost[merges]
    return splits[pays], merges[pays]


def _cheapest_for_both(a: np.ndarray, b: np.ndarray, cost: np.ndarray, count: int) -> np.ndarray:
    """(p,) int64: the pairs that are the cheapest of both their clusters, so that no cluster is in two."""
    pair = np.concatenate([np.arange(len(a)), np.arange(len(a))])
    end = np.concatenate([a, b])
    order = np.lexsort((pair, cost[pair], end))
    best = np.full(count, -1)
    best[end[order][::-1]] = pair[order][::-1]  # the last one written is the cheapest
    return np.flatnonzero((best[a] == np.arange(len(a))) & (best[b] == np.arange(len(a))))


def _boxes(items: ClusterItems, rows: np.ndarray, key: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounding boxes (count, 3), (count, 3) of the rows of each key; of a key without rows, a box that nothing is in."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    order = np.argsort(key, kind="stable")
    used, start = np.unique(key[order], return_index=True)
    if len(used):
        low[used] = np.minimum.reduceat(items.box_min[rows[order]], start, axis=0)
        high[used] = np.maximum.reduceat(items.box_max[rows[order]], start, axis=0)
    return low, high


def _half_area(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Half the surface of boxes (.., 3), m2; 0 for one that nothing is in."""
    edge = np.where(high >= low, high, 0.0) - np.where(high >= low, low, 0.0)
    return (edge * np.roll(edge, 1, axis=-1)).sum(axis=-1)
