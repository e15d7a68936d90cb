"""What has to be read before an emitter can shoot: its potentially visible set, less what is in memory already.

Memory holds one set at a time, that of the emitter that shot last (paper, section 6: an emitter is loaded together with
its PVS, and the largest PVS is the most that memory ever holds).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..visibility_graph import VisibilityGraph, weights

_BLOCK_BYTES = 1 << 23
"""Rows of sets that are unpacked at once, as float64."""


@dataclass(frozen=True)
class VisibleSets:
    """The potentially visible sets of n emitters, clusters or cells; seeing is mutual.

    bits : (n, ceil(n / 8)) uint8, packed as in :class:`~..visibility_graph.VisibilityGraph`;  polygons : (n,) int64 of each
    """

    bits: np.ndarray
    polygons: np.ndarray

    def __len__(self) -> int:
        return len(self.bits)


def visible_sets(graph: VisibilityGraph, polygons: np.ndarray, unit: np.ndarray, units: int) -> VisibleSets:
    """Sets of emitters from the graph of their clusters; emitters see each other if any of their clusters do.

    polygons : (C,) of every cluster;  unit : (C,) its emitter, 0..units-1;  an emitter without clusters sees nothing
    """
    if np.array_equal(unit, np.arange(units)):
        return VisibleSets(graph.bits, polygons)
    by_unit, clusters = np.argsort(unit, kind="stable"), np.bincount(unit, minlength=units)
    used = np.flatnonzero(clusters)
    first = (np.cumsum(clusters) - clusters)[used]
    bits = np.zeros((units, (units + 7) // 8), np.uint8)
    for k, own in zip(used, np.split(by_unit, first[1:]), strict=True):
        seen = np.unpackbits(np.bitwise_or.reduce(graph.bits[own], axis=0), count=len(unit))
        row = np.zeros(units, bool)
        row[used] = np.logical_or.reduceat(seen[by_unit], first)
        bits[k] = np.packbits(row)
    return VisibleSets(bits, np.rint(np.bincount(unit, polygons, units)).astype(np.int64))


class Reads:
    """Amounts to be read, for emitters of given weights (n,) int, such as their polygons.

    What sets have in common with the one in memory is kept, and brought up to date by what came and went: neighbours in
    space see nearly the same, so a step costs little. All sums are of whole numbers, hence exact and the same whatever
    came before.
    """

    def __init__(self, sets: VisibleSets, weight: np.ndarray) -> None:
        self._bits, self._weight = sets.bits, weight.astype(np.float64)
        self.whole = weights(sets.bits, weight).astype(np.float64)
        self._held = np.zeros(sets.bits.shape[1], np.uint8)
        self._common = np.zeros(len(sets))

    def common(self, last: int) -> np.ndarray:
        """(n,) float64: what each set has in common with that of ``last``; all 0 if ``last`` is -1."""
        held = self._bits[last] if last >= 0 else np.zeros_like(self._held)
        count = len(self._weight)
        changed = np.flatnonzero(np.unpackbits(held ^ self._held, count=count))
        sign = np.where(np.unpackbits(held, count=count)[changed], 1.0, -1.0)
        rows = max(1, _BLOCK_BYTES // (8 * count))
        for low in range(0, len(changed), rows):
            part = slice(low, low + rows)
            # Seeing is mutual: the sets that hold an emitter are those of the emitters in its own set.
            self._common += (self._weight[changed[part]] * sign[part]) @ np.unpackbits(self._bits[changed[part]], axis=1, count=count)
        self._held = held
        return self._common

    def after(self, last: int) -> np.ndarray:
        """(n,) float64: what is left to be read for each emitter to shoot while the set of ``last`` is in memory."""
        return self.whole - self.common(last)

    def between(self, emitters: np.ndarray) -> np.ndarray:
        """(k, k) float64: what is left to be read for each of ``emitters`` (k,), column, straight after each, row."""
        sets = np.unpackbits(self._bits[emitters], axis=1, count=len(self._weight)).astype(np.float64)
        return self.whole[emitters] - (sets * self._weight) @ sets.T
