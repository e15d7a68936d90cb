"""Traveling Salesman (paper, section 6): a closed tour through all emitters, found before the first shot.

On a closed tour, what is read in all is the sum of all sets less what each has in common with the one before; so the
tour that reads least is also the shortest by a symmetric distance, the weight of what is in one of two sets but not in
both. This is a metric, and the usual ways to a short tour apply: nearest neighbour, then 2-opt.
"""

from __future__ import annotations

import numpy as np

from .candidates import Candidates, Strategy, strongest
from .reads import Reads, VisibleSets

NEIGHBOURS = 8
"""Emitters near each to which a better tour may lead it."""
ROUNDS = 30
"""Most rounds of improvement."""
_BLOCK_BYTES = 1 << 22
"""Pairs of sets that are compared at once, one byte for each emitter."""


def traveling_salesman(sets: VisibleSets) -> Strategy:
    """The next on the tour that waits; at the start, the one with the most unshot power.

    The tour is the shortest that is found by polygons to be read.
    """
    tour = shortest_tour(sets)
    place = np.empty(len(tour), np.int64)
    place[tour] = np.arange(len(tour))

    def choose(candidates: Candidates) -> int:
        waiting = candidates.waiting
        if candidates.last < 0:
            return strongest(candidates, waiting)
        return int(waiting[np.argmin((place[waiting] - place[candidates.last] - 1) % len(place))])

    return choose


def shortest_tour(sets: VisibleSets) -> np.ndarray:
    """(n,) int64 emitters in the order of a closed tour on which few polygons are read."""
    distance = _Distances(sets)
    tour, near, near_distance = _nearest_neighbour_tour(sets)
    for _ in range(ROUNDS):
        if not _improve(tour, near, near_distance, distance):
            break
    return tour


class _Distances:
    """Polygons that are in one of two sets and not in both, for pairs of emitters."""

    def __init__(self, sets: VisibleSets) -> None:
        self._bits, self._weight = sets.bits, sets.polygons.astype(np.float32)

    def __call__(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(m,) float32 of emitters a (m,) and b (m,)."""
        result = np.empty(len(a), np.float32)
        count = len(self._weight)
        rows = max(1, _BLOCK_BYTES // (4 * count))
        for low in range(0, len(a), rows):
            part = slice(low, low + rows)
            result[part] = np.unpackbits(self._bits[a[part]] ^ self._bits[b[part]], axis=1, count=count) @ self._weight
        return result


def _nearest_neighbour_tour(sets: VisibleSets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tour (n,) that always goes on to the nearest emitter not met yet, and of every emitter the nearest k and their distances."""
    count = len(sets)
    k = min(NEIGHBOURS, count - 1)
    reads = Reads(sets, sets.polygons)
    tour, ahead = np.zeros(count, np.int64), np.ones(count, bool)
    near, near_distance = np.zeros((count, k), np.int64), np.zeros((count, k), np.float32)
    here = 0
    for step in range(count):
        tour[step], ahead[here] = here, False
        distance = reads.whole + reads.whole[here] - 2 * reads.common(here)
        distance[here] = np.inf
        near[here] = _least(distance, k)
        near_distance[here] = distance[near[here]]
        here = int(np.argmin(np.where(ahead, distance, np.inf)))
    return tour, near, near_distance


def _least(values: np.ndarray, count: int) -> np.ndarray:
    """(count,) int64: where the least values (n,) are, rising; of equals, the first."""
    enough = np.flatnonzero(values <= np.partition(values, count - 1)[count - 1]) if count else np.zeros(0, np.int64)
    return enough[np.argsort(values[enough], kind="stable")[:count]]


def _improve(tour: np.ndarray, near: np.ndarray, near_distance: np.ndarray, distance: _Distances) -> bool:
    """Turn stretches of the tour round where that makes it shorter (2-opt), in place; tells whether there were any."""
    count = len(tour)
    moves = _shortening(tour, near, near_distance, distance)
    taken = np.zeros(count, bool)
    for start, length in moves:
        # Both of the edges that change, and all in between, may serve one move only.
        edges = np.arange(start, start + length + 1) % count
        if not taken[edges].any():
            taken[edges] = True
            tour[edges[1:]] = tour[edges[:0:-1]]
    return len(moves) > 0


def _shortening(tour: np.ndarray, near: np.ndarray, near_distance: np.ndarray, distance: _Distances) -> np.ndarray:
    """(m, 2) int64 edges, and lengths of the stretches that begin after them, to be turned round; the greatest gain first.

    Edge e of the tour joins its places e and e + 1. A move takes two edges out and joins an emitter to one that is near.
    """
    count = len(tour)
    place = np.empty(count, np.int64)
    place[tour] = np.arange(count)
    edge = distance(tour, np.roll(tour, -1))
    found, gains = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.float32)]
    for side in (0, -1):  # the edge after an emitter, or the one before
        own = (place + side) % count
        emitter, rank = np.nonzero(near_distance < edge[own][:, None])
        a, b = own[emitter], own[near[emitter, rank]]
        far = 1 + side  # the other ends of these edges are joined as well
        gain = edge[a] + edge[b] - near_distance[emitter, rank] - distance(tour[(a + far) % count], tour[(b + far) % count])
        better = gain > 0
        found.append(np.sort(np.column_stack([a, b])[better], axis=1))
        gains.append(gain[better])
    first, second = np.concatenate(found).T
    length = second - first
    # Turning the rest round instead gives the same tour.
    longer = 2 * length > count
    moves = np.column_stack([np.where(longer, second, first), np.where(longer, count - length, length)])
    return moves[np.argsort(-np.concatenate(gains), kind="stable")]
