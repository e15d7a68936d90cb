"""The units of shooting, clusters or cells, and the order in which the light of their elements stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .elements import Forest, Subtrees

_BLOCK = 1 << 14
"""Elements of some emitters that are worked on at once."""


@dataclass(frozen=True)
class Emitters:
    """U emitters and their elements, whole trees, in places: those of one emitter follow one another, parents before children.

    order : (E,) int32 element at each place;  place : (E,) int32 of each element;  inner : (E,) int32, the same within its emitter
    start : (U + 1,) int64, emitter k has the places ``start[k]:start[k + 1]``
    """

    order: np.ndarray
    place: np.ndarray
    inner: np.ndarray
    start: np.ndarray

    def __len__(self) -> int:
        return len(self.start) - 1

    def of(self, places: np.ndarray) -> np.ndarray:
        """(n,) int64 emitter at each of ``places`` (n,)."""
        return np.searchsorted(self.start, places, side="right") - 1

    def blocks(self) -> list[slice]:
        """Places of some emitters in turn, a handy number of elements together."""
        cuts = np.unique(np.searchsorted(self.start, np.arange(0, self.start[-1] + _BLOCK, _BLOCK)))
        ends = self.start[np.unique(np.r_[0, np.minimum(cuts, len(self))])]
        return [slice(int(a), int(b)) for a, b in pairwise(ends) if b > a]

    def trees(self, forest: Forest, emitter: int) -> Subtrees:
        """Push and pull on the elements of an emitter."""
        return Subtrees(forest, self.order[self.start[emitter] : self.start[emitter + 1]], self.inner)

    def trees_of_block(self, forest: Forest, places: slice) -> Subtrees:
        """Push and pull on the elements at ``places``, those of some emitters in turn."""
        own = self.order[places]
        local = np.zeros(len(self.place), np.int32)
        local[own] = np.arange(len(own))
        return Subtrees(forest, own, local)


def emitters_of(forest: Forest, unit: np.ndarray, units: int, allocate: Callable[..., np.ndarray] = np.zeros) -> Emitters:
    """Emitters from the emitter ``unit`` (E,), 0..units-1, of every element; ``allocate`` makes room like ``np.zeros``."""
    count = len(forest)
    order, place, inner = (allocate(count, np.int32) for _ in range(3))
    order[:] = np.lexsort((forest.level, unit))
    start = np.r_[0, np.cumsum(np.bincount(unit, minlength=units))]
    for low in range(0, count, _BLOCK):
        own = order[low : low + _BLOCK]
        place[own] = np.arange(low, low + len(own), dtype=np.int32)
        inner[own] = place[own] - start[unit[own]]
    return Emitters(order, place, inner, start)
