"""The links over which each emitter shoots, receivers together, so that sums run over neighbours in memory.

In memory a route is a list of rows of the links as they are. On disk its links follow one another in the order of
shooting, both ways of a link apart, so that a shot reads one stretch for each shape of links, from front to back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from .emitters import Emitters
from .grouping import runs
from .links import BLOCK, Allocate, LinkSet, blocks, by_shape, exchanged, joined


class Beam(NamedTuple):
    """Links of one shape from one emitter.

    source : (n,) number of the sending element within its emitter;  exchange : (n, i, j) of nodes of receiver and source
    first : (k,) where each receiver begins among the links;  receivers : (k,) places, rising
    """

    source: np.ndarray
    exchange: np.ndarray
    first: np.ndarray
    receivers: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of the links."""
        return 2 * self.exchange.size + 12 * len(self.source)


class Routes(Protocol):
    """What the shooting needs of the links; ``on_disk`` tells whether they have to be read for every shot."""

    on_disk: bool

    def beams(self, emitter: int) -> Iterator[Beam]:
        """The links over which an emitter shoots, at most about ``BLOCK`` at a time, always in the same order."""


@dataclass(frozen=True)
class _Rows:
    """Rows of a set, sorted by receiver, over which one emitter shoots."""

    links: LinkSet
    rows: np.ndarray
    reverse: bool


class RoutesInMemory:
    """Routes over links that stay as they are."""

    on_disk = False

    def __init__(self, links: list[LinkSet], emitters: Emitters) -> None:
        self._emitters = emitters
        self._rows: list[list[_Rows]] = [[] for _ in range(len(emitters))]
        for group in joined(links):
            for reverse in (False, True):
                source, receiver = (group.a, group.b) if reverse else (group.b, group.a)
                emitter = emitters.of(emitters.place[source])
                order = np.lexsort((emitters.place[receiver], emitter)).astype(np.int32)
                cuts = np.searchsorted(emitter[order], np.arange(len(emitters) + 1))
                for k in np.flatnonzero(np.diff(cuts)):
                    self._rows[k].append(_Rows(group, order[cuts[k] : cuts[k + 1]], reverse))

    def beams(self, emitter: int) -> Iterator[Beam]:
        place, start = self._emitters.place, self._emitters.start[emitter]
        for route in self._rows[emitter]:
            links = route.links
            for low in range(0, len(route.rows), BLOCK):
                rows = route.rows[low : low + BLOCK]
                steps = links.steps.take(rows, 0)
                exchange = exchanged(np.ascontiguousarray(steps.transpose(0, 2, 1)) if route.reverse else steps, links.scale.take(rows))
                source, receiver = (links.a, links.b) if route.reverse else (links.b, links.a)
                yield _beam(place.take(source.take(rows)) - start, place.take(receiver.take(rows)), exchange)


class RoutesOnDisk:
    """Routes in arrays that ``allocate`` makes room for, in stretches by emitter; links of one shape and way together.

    breathe : called between blocks of links
    """

    on_disk = True

    def __init__(self, links: list[LinkSet], emitters: Emitters, allocate: Allocate, breathe: Callable[[], None] = lambda: None) -> None:
        self._stretches: list[tuple[np.ndarray, np.ndarray]] = []
        for group in by_shape(links):
            for way in range(2):
                self._stretches.append(_sorted(group, way, emitters, allocate, breathe))

    def beams(self, emitter: int) -> Iterator[Beam]:
        for table, start in self._stretches:
            for low in range(start[emitter], start[emitter + 1], BLOCK):
                links = table[low : min(low + BLOCK, start[emitter + 1])]
                yield _beam(links["source"].copy(), links["receiver"].copy(), exchanged(links["steps"], links["scale"]))


def _beam(source: np.ndarray, receiver: np.ndarray, exchange: np.ndarray) -> Beam:
    first = runs(receiver)
    return Beam(source, exchange, first, receiver.take(first))


def _sorted(
    group: list[LinkSet], way: int, emitters: Emitters, allocate: Allocate, breathe: Callable[[], None]
) -> tuple[np.ndarray, np.ndarray]:
    """A table (n,) of links with source, receiver, scale and steps, sorted by emitter and receiver, and (U + 1,) where emitters begin.

    The links are dealt out to their emitters first and sorted by receiver then: no more than a block of them is in memory.
    """
    i, j = group[0].shape
    nodes = (j, i) if way else (i, j)
    count = np.zeros(len(emitters), np.int64)
    for part in blocks(group):
        source = part.a if way else part.b
        count += np.bincount(emitters.of(emitters.place[source]), minlength=len(emitters))
    start = np.r_[0, np.cumsum(count)]
    table = allocate(int(start[-1]), np.dtype([("source", "<i4"), ("receiver", "<i4"), ("scale", "<f4"), ("steps", "<u2", nodes)]))
    used = start[:-1].copy()
    for part in blocks(group):
        source, receiver, steps = (part.a, part.b, part.steps.transpose(0, 2, 1)) if way else (part.b, part.a, part.steps)
        place = emitters.place[source]
        emitter = emitters.of(place)
        order = np.argsort(emitter, kind="stable")
        emitter = emitter[order]
        mine = np.bincount(emitter, minlength=len(emitters))
        to = used[emitter] + np.arange(len(order)) - (np.cumsum(mine) - mine)[emitter]
        used += mine
        rows = np.empty(len(order), table.dtype)
        rows["source"] = place[order] - emitters.start[emitter]
        rows["receiver"] = emitters.place[receiver[order]]
        rows["scale"] = part.scale[order]
        rows["steps"] = steps[order]
        table[to] = rows
        breathe()
    # Emitters of few links are sorted together.
    low = 0
    while low < len(emitters):
        high = max(low + 1, int(np.searchsorted(start, start[low] + BLOCK, side="right")) - 1)
        rows = table[start[low] : start[high]]
        emitter = np.repeat(np.arange(low, high), count[low:high])
        table[start[low] : start[high]] = rows[np.lexsort((rows["receiver"], emitter))]
        low = high
        breathe()
    return table, start
