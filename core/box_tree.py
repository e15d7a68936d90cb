"""Which of many boxes meet others, or a ray: a tree over boxes, walked level by level for all questions at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from .grouping import morton, ragged

_FAN = 8
_QUESTIONS = 1 << 13
"""Questions that walk down together: their pairs with the boxes of one level fit into memory."""

_Bounds = tuple[tuple[np.ndarray, np.ndarray], ...]
"""Lowest and highest coordinate (n,) of nodes along every axis; the group is the last of them."""


class BoxTree:
    """A tree over n axis-aligned boxes of d dimensions; a box is met by questions of its own group only.

    low, high : (n, d) float64, d = 2 or 3;  group : (n,) int. Every question costs about what it meets times the logarithm of n.
    """

    def __init__(self, low: np.ndarray, high: np.ndarray, group: np.ndarray) -> None:
        place = np.zeros((len(low), 3))
        place[:, : low.shape[1]] = 0.5 * (low + high)
        self._order = np.lexsort((morton(place), group))
        # The group is one more dimension: nodes of other groups are left out as those elsewhere are.
        columns = [*zip(low.T, high.T, strict=True), (group, group)]
        self._levels: list[_Bounds] = [tuple((a[self._order], b[self._order]) for a, b in columns)]
        while len(self._levels[-1][0][0]) > _FAN:
            below = self._levels[-1]
            first = np.arange(0, len(below[0][0]), _FAN)
            self._levels.append(tuple((np.minimum.reduceat(a, first), np.maximum.reduceat(b, first)) for a, b in below))

    def overlaps(self, low: np.ndarray, high: np.ndarray, group: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Pairs (box (k,), question (k,)) whose boxes of one group touch, in blocks; questions are boxes (m, d) of ``group`` (m,)."""
        asked = [*zip(*map(_columns, (low, high)), strict=True), (group, group)]

        def meets(nodes: _Bounds, node: np.ndarray, question: np.ndarray) -> np.ndarray:
            out = np.ones(len(node), bool)
            for (a, b), (from_, to) in zip(nodes, asked, strict=True):
                out &= (a.take(node) <= to.take(question)) & (b.take(node) >= from_.take(question))
            return out

        return self._walk(len(low), meets)

    def along(self, origin: np.ndarray, direction: np.ndarray, group: np.ndarray, reach: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Pairs (box (k,), ray (k,)), in blocks: rays from ``origin`` along ``direction`` (m, d), and boxes of their group in reach."""
        inverse = 1 / np.where(np.abs(direction) < 1e-30, 1e-30, direction)
        rays = [*zip(*map(_columns, (origin, inverse)), strict=True)]

        def meets(nodes: _Bounds, node: np.ndarray, question: np.ndarray) -> np.ndarray:
            enter, leave = np.zeros(len(node)), np.full(len(node), reach)
            for (low, high), (from_, slope) in zip(nodes[:-1], rays, strict=True):
                start, part = from_.take(question), slope.take(question)
                a, b = low.take(node), high.take(node)
                for x in (a, b):
                    x -= start
                    x *= part
                np.maximum(enter, np.minimum(a, b), out=enter)
                np.minimum(leave, np.maximum(a, b, out=a), out=leave)
            low, high = nodes[-1]
            own = group.take(question)
            return (enter <= leave) & (low.take(node) <= own) & (high.take(node) >= own)

        return self._walk(len(origin), meets)

    def _walk(self, count: int, meets: Callable) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        top = len(self._levels[-1][0][0])
        for start in range(0, count if len(self._order) else 0, _QUESTIONS):
            question = np.repeat(np.arange(start, min(start + _QUESTIONS, count)), top)
            node = np.tile(np.arange(top), len(question) // top)
            for depth in range(len(self._levels) - 1, -1, -1):
                kept = np.flatnonzero(meets(self._levels[depth], node, question))
                node, question = node.take(kept), question.take(kept)
                if depth:
                    below = len(self._levels[depth - 1][0][0])
                    node, row = ragged(_FAN * node, np.minimum(_FAN, below - _FAN * node))
                    question = question.take(row)
            yield self._order[node], question


def _columns(table: np.ndarray) -> np.ndarray:
    """(d, n), each column of a table (n, d) in one piece of memory."""
    return np.ascontiguousarray(table.T)
