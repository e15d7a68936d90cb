"""Links: exchanges of light between pairs of surface elements, at the nodes of both.

Between node x of element a and node y of element b a link holds K(x, y) V(x, y), kernel times visibility (1/m2). It is
symmetric, so that one number carries light both ways and the exchange is reciprocal to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .elements import Forest
from .emitters import Emitters, emitters_of
from .grouping import runs

CLOSURE = (0.1, 10.0)
"""A node whose links add up to less or more than this sees next to nothing, or what cannot be."""
LIMIT = np.float32(3)
"""Largest factor, and one over the smallest, that closes a node: with ten at one node of an element, light that runs past zero at
the others grew from shot to shot in one of the 648 rooms of the Test scene.
"""
BLOCK = 1 << 15
"""Links that are worked on at once."""
_CHUNKS = (1 << 10, 1 << 18)
"""Links of the first chunk of a collection, and of its largest."""

ARRAYS = ("a", "b", "steps", "scale")
"""What a set of links consists of."""
_STEPS = 65_535

Allocate = Callable[..., np.ndarray]
"""Makes an array of zeros from a shape and a dtype, like ``np.zeros``."""


@dataclass(frozen=True)
class LinkSet:
    """n links with i nodes on side a and j on side b; 1 node is the centre of gravity, else all nodes of the element.

    a, b : (n,) int32 elements;  steps : (n, i, j) uint16, what is exchanged between nodes in steps of ``scale`` (n,) float32, 1/m2

    Links are most of what a solve holds. A step is 1/65,535 of the largest exchange of its link: a number of 16 bits is wrong by
    less than a hundredth of a thousandth of that, where visibility by samples leaves some hundredths.
    """

    a: np.ndarray
    b: np.ndarray
    steps: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, a: np.ndarray, b: np.ndarray, exchange: np.ndarray) -> LinkSet:
        """Links from exchanges (n, i, j) >= 0, 1/m2."""
        scale = (exchange.max((1, 2), initial=0) / _STEPS).astype(np.float32)
        steps = exchange / np.maximum(scale, np.finfo(np.float32).tiny)[:, None, None]
        return cls(a, b, np.rint(np.minimum(steps, _STEPS)).astype(np.uint16), scale)

    @property
    def exchange(self) -> np.ndarray:
        """(n, i, j) float32, 1/m2."""
        return exchanged(self.steps, self.scale)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return sum(getattr(self, name).nbytes for name in ARRAYS)

    def __len__(self) -> int:
        return len(self.a)

    @property
    def shape(self) -> tuple[int, int]:
        """Links of one shape can stand in one set."""
        return self.steps.shape[1:]

    def part(self, rows: slice) -> LinkSet:
        """Some of them in turn."""
        return LinkSet(*(getattr(self, name)[rows] for name in ARRAYS))


def exchanged(steps: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(n, i, j) float32 from steps (n, i, j) uint16 of size (n,)."""
    exchange = steps.astype(np.float32)
    exchange *= scale[:, None, None]
    return exchange


def joined(sets: list[LinkSet]) -> list[LinkSet]:
    """The same links with one set for each shape, in a fixed order."""
    return [_one(group) for group in by_shape(sets)]


def by_shape(sets: list[LinkSet]) -> list[list[LinkSet]]:
    """Sets of one shape together, shapes in a fixed order, without empty ones."""
    shapes = sorted({s.shape for s in sets if len(s)})
    return [[s for s in sets if s.shape == shape and len(s)] for shape in shapes]


def _one(group: list[LinkSet]) -> LinkSet:
    if len(group) == 1:
        return group[0]
    return LinkSet(*(np.concatenate([getattr(s, name) for s in group]) for name in ARRAYS))


def _moved(group: list[LinkSet]) -> LinkSet:
    """The links of a group in one set. Each of its sets leaves the group when it is copied, so that few links are there twice."""
    if len(group) == 1:
        return group.pop()
    number = sum(len(links) for links in group)
    like = [getattr(group[0], name) for name in ARRAYS]
    out = LinkSet(*(np.empty((number, *x.shape[1:]), x.dtype) for x in like))
    del like
    low = 0
    while group:
        links = group.pop(0)
        for name in ARRAYS:
            getattr(out, name)[low : low + len(links)] = getattr(links, name)
        low += len(links)
        del links
    return out


def blocks(sets: list[LinkSet]) -> Iterator[LinkSet]:
    """The links in blocks of one shape; where one ends does not depend on how the links stand in sets."""
    for group in by_shape(sets):
        waiting, count = [], 0
        for links in group:
            low = 0
            while low < len(links):
                part = links.part(slice(low, low + BLOCK - count))
                waiting, count, low = [*waiting, part], count + len(part), low + len(part)
                if count == BLOCK:
                    yield _one(waiting)
                    waiting, count = [], 0
        if waiting:
            yield _one(waiting)


class LinkCollector:
    """Takes links as they are made, in chunks that ``allocate`` makes room for; without it in memory, where they are joined at last."""

    def __init__(self, allocate: Allocate | None = None) -> None:
        self._allocate = allocate
        self._full: list[LinkSet] = []
        self._open: dict[tuple[int, int], tuple[LinkSet, int]] = {}

    def add(self, sets: list[LinkSet]) -> None:
        """Take a copy of all links of ``sets``."""
        for links in sets:
            low = 0
            while low < len(links):
                chunk, used = self._room(links.shape)
                count = min(len(links) - low, len(chunk) - used)
                for name in ARRAYS:
                    getattr(chunk, name)[used : used + count] = getattr(links, name)[low : low + count]
                self._open[links.shape] = chunk, used + count
                low += count

    def links(self) -> list[LinkSet]:
        """All links in the order in which they came; the collector is empty then."""
        sets = [*self._full, *(chunk.part(slice(used)) for chunk, used in self._open.values())]
        self._full, self._open = [], {}
        groups = by_shape(sets)
        del sets
        if self._allocate:
            return [links for group in groups for links in group]
        return [_moved(group) for group in groups]

    def _room(self, shape: tuple[int, int]) -> tuple[LinkSet, int]:
        chunk, used = self._open.get(shape, (None, 0))
        if chunk is not None and used < len(chunk):
            return chunk, used
        rows = _CHUNKS[0] if chunk is None else min(2 * len(chunk), _CHUNKS[1])
        if chunk is not None:
            self._full.append(chunk)
        i, j = shape
        data = (self._allocate or np.zeros)(rows * (6 + i * j), np.uint16)
        a, b, scale = (data[2 * k * rows : 2 * (k + 1) * rows] for k in range(3))
        return LinkSet(a.view(np.int32), b.view(np.int32), data[6 * rows :].reshape(rows, i, j), scale.view(np.float32)), 0


@dataclass(frozen=True)
class Gains:
    """(E, q*q) float32 factors for what the nodes of leaves receive over their links, and for what they send; 1 elsewhere."""

    received: np.ndarray
    sent: np.ndarray


def closing_gains(
    forest: Forest,
    links: list[LinkSet],
    kept: np.ndarray,
    emitters: Emitters | None = None,
    allocate: Allocate = np.zeros,
    breathe: Callable[[], None] = lambda: None,
) -> Gains:
    """The gains that close the links of leaves in closed rooms.

    kept : (E,) the part of the light in the room of each element that surfaces receive, 1 but for seams; 0 where a room is not closed
    breathe : called between blocks of work, as ``Space.breathe``
    From exitance 1 all around, a point of a closed room receives this part, and this part of what a point sends arrives; what the
    links give instead is their error. One gain makes up for what the other leaves, in turn (Sinkhorn and Knopp 1967): that of what
    is received, of what is sent, and of what is received once more. A node that sees next to nothing is left at 1.
    """
    emitters = emitters or emitters_of(forest, forest.region, len(forest.regions))
    one = np.zeros((1, forest.functions, 1), np.float32)
    one[:, 0] = 1

    def gain(exitance: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        own = _arriving(forest, links, exitance, allocate, breathe)
        out = allocate((len(forest), forest.node_count), np.float32)
        for places in emitters.blocks():
            elements, trees = emitters.order[places], emitters.trees_of_block(forest, places)
            total = forest.at_nodes(elements, trees.push(own[elements]))[..., 0]
            whole = kept[elements][:, None]
            leaf = forest.leaf_of(elements)[:, None]
            known = (whole > 0) & leaf & (total > CLOSURE[0]) & (total < CLOSURE[1])
            out[elements] = np.where(known, np.clip(whole / np.where(known, total, 1), 1 / LIMIT, LIMIT), 1)
            breathe()
        return out

    def pulled(node_values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        out = allocate((len(forest), forest.functions, 1), np.float32)
        for places in emitters.blocks():
            elements = emitters.order[places]
            leaf = forest.leaf_of(elements)[:, None, None]
            values = forest.from_nodes(elements, node_values.take(elements, 0)[..., None])
            out[elements] = emitters.trees_of_block(forest, places).pull(np.where(leaf, values, 0))
            breathe()
        return lambda elements: out.take(elements, 0)

    received = gain(lambda elements: np.broadcast_to(one, (len(elements), *one.shape[1:])))
    sent = gain(pulled(received))
    return Gains(gain(pulled(sent)), sent)


def received(forest: Forest, links: list[LinkSet], exitance: np.ndarray, allocate: Allocate = np.zeros) -> np.ndarray:
    """(E, m, 1) float32 coefficients of the irradiance at every element, ancestors included, from exitance (E, m, 1) of all."""
    return forest.push(_arriving(forest, links, lambda elements: exitance[elements], allocate))


def _arriving(
    forest: Forest,
    links: list[LinkSet],
    exitance: Callable[[np.ndarray], np.ndarray],
    allocate: Allocate,
    breathe: Callable[[], None] = lambda: None,
) -> np.ndarray:
    """(E, m, 1) float32 coefficients of what every element receives over its own links from ``exitance`` (n, m, 1) of elements (n,)."""
    gathered = allocate((len(forest), forest.node_count, 1), np.float32)
    constant = allocate((len(forest), 1), np.float32)
    for group in blocks(links):
        for source, receiver, exchange in directions(group):
            power = forest.at_nodes(source, exitance(source))[..., 0] * forest.node_weights_of(source)
            if exchange.shape[2] == 1:
                power = power.sum(1, keepdims=True)
            light = np.einsum("nij,nj->ni", exchange, power)
            order = np.argsort(receiver, kind="stable")
            to = receiver[order]
            first = runs(to)
            total = np.add.reduceat(light.take(order, 0), first, axis=0)
            if total.shape[1] == 1:
                constant[to[first]] += total
            else:
                gathered[to[first], :, 0] += total
        breathe()
    own = allocate((len(forest), forest.functions, 1), np.float32)
    for low in range(0, len(forest), BLOCK):
        here = np.arange(low, min(low + BLOCK, len(forest)))
        own[here] = forest.from_nodes(here, gathered[here])
        own[here, 0] += constant[here]
    return own


def directions(group: LinkSet) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The ways light takes through a set of links: (source (n,), receiver (n,), exchange (n, receiver nodes, source nodes))."""
    exchange = group.exchange
    yield group.b, group.a, exchange
    yield group.a, group.b, exchange.transpose(0, 2, 1)
