"""Links: exchanges of light between pairs of surface elements, at the nodes of both.

Between node x of element a and node y of element b a link holds K(x, y) V(x, y), kernel times visibility (1/m2). It is
symmetric, so that one number carries light both ways and the exchange is reciprocal to rounding. Where the elements
touch, the kernel is fitted to the exact polygon formula from either side: then each way has a link of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
