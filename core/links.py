"""Links: exchanges of light between pairs of surface elements, at the nodes of both.

Between node x of element a and node y of element b a link holds K(x, y) V(x, y), kernel times visibility (1/m2). It is
symmetric, so that one number carries light both ways and the exchange is reciprocal to rounding. Where the elements
touch, the kernel is fitted to the exact polygon formula from either side: then each way has a link of its own.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .elements import Forest

CLOSURE = (0.1, 10.0)
"""A node whose links add up to less or more than this sees next to nothing, or what cannot be."""


@dataclass(frozen=True)
class LinkSet:
    """n links with i nodes on side a and j on side b; 1 node is the centre of gravity, else all nodes of the element.

    a, b : (n,) int32 elements;  exchange : (n, i, j) float32, 1/m2
    two_way : light goes from b to a, and also from a to b when True
    """

    a: np.ndarray
    b: np.ndarray
    exchange: np.ndarray
    two_way: bool

    def __len__(self) -> int:
        return len(self.a)

    @property
    def shape(self) -> tuple[int, int, bool]:
        """Links of one shape can stand in one set."""
        return (*self.exchange.shape[1:], self.two_way)


def joined(sets: list[LinkSet]) -> list[LinkSet]:
    """The same links with one set for each shape, in a fixed order."""
    shapes = sorted({s.shape for s in sets})
    groups = [[s for s in sets if s.shape == shape and len(s)] for shape in shapes]
    return [
        LinkSet(*(np.concatenate([getattr(s, name) for s in group]) for name in ("a", "b", "exchange")), group[0].two_way)
        for group in groups
        if group
    ]


def spill(links: list[LinkSet], budget: int, folder: Path) -> list[LinkSet]:
    """The same links with at most ``budget`` bytes of exchanges in memory; the largest sets go to ``folder`` and are read from there.

    Each becomes ``links-I-J-N.npy``: nodes of either side, and ways that light takes. Raises OSError when the disk refuses.
    """
    held = sum(group.exchange.nbytes for group in links)
    out = list(links)
    for k in sorted(range(len(links)), key=lambda k: -links[k].exchange.nbytes):
        if held <= budget:
            break
        group = links[k]
        i, j, both = group.shape
        path = folder / f"links-{i}-{j}-{2 if both else 1}.npy"
        np.save(path, group.exchange, allow_pickle=False)
        out[k] = dataclasses.replace(group, exchange=np.load(path, mmap_mode="r", allow_pickle=False))
        held -= group.exchange.nbytes
    return out


def received(forest: Forest, links: list[LinkSet], exitance: np.ndarray) -> np.ndarray:
    """(E, m, 1) float32 coefficients of the irradiance at every element, ancestors included, from exitance (E, m, 1) of all."""
    everything = np.arange(len(forest))
    sent = forest.at_nodes(everything, exitance)[..., 0] * forest.node_weights
    gathered = np.zeros((len(forest), forest.node_count, 1), np.float32)
    constant = np.zeros((len(forest), 1), np.float32)
    for group in links:
        for source, receiver, exchange in directions(group):
            power = sent[source] if exchange.shape[2] > 1 else sent[source].sum(1, keepdims=True)
            light = np.einsum("nij,nj->ni", exchange, power)
            order = np.argsort(receiver, kind="stable")
            first = np.flatnonzero(np.r_[True, np.diff(receiver[order]) > 0])
            total = np.add.reduceat(light[order], first, axis=0)
            if total.shape[1] == 1:
                constant[receiver[order[first]]] += total
            else:
                gathered[receiver[order[first]], :, 0] += total
    own = forest.from_nodes(everything, gathered)
    own[:, 0] += constant
    return forest.push(own)


def closing_gain(forest: Forest, links: list[LinkSet], closed: np.ndarray) -> np.ndarray:
    """(E, q*q) float32 factor for what the nodes of leaves receive that makes the links of every closed node add up to one.

    From exitance 1 all around, a point of a closed room receives exactly 1; what the links give instead is their error. A
    node that sees next to nothing is left at 1, as is every node that is not ``closed`` (E,) bool.
    """
    everything, leaf = np.arange(len(forest)), forest.leaf
    one = np.zeros((len(forest), forest.functions, 1), np.float32)
    one[:, 0] = 1
    total = forest.at_nodes(everything, received(forest, links, one))[..., 0]
    known = (closed & leaf)[:, None] & (total > CLOSURE[0]) & (total < CLOSURE[1])
    return np.where(known, 1 / np.where(known, total, 1), 1).astype(np.float32)


def directions(group: LinkSet):
    """The ways light takes through a set of links: (source (n,), receiver (n,), exchange (n, receiver nodes, source nodes))."""
    yield group.b, group.a, group.exchange
    if group.two_way:
        yield group.a, group.b, group.exchange.transpose(0, 2, 1)
