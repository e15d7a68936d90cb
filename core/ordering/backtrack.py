"""Backtrack S and Backtrack C (paper, section 6): the first step of the path of five emitters for which least is read.

The paper's tree holds all solutions. All paths of five among thousands of emitters are more than can be counted, and
paths that begin far from what is in memory lose at the first step; so the tree is that of all paths among the few
emitters that are nearest to it.
"""

from __future__ import annotations

import functools

import numpy as np

from .candidates import Candidates, Strategy, strongest
from .reads import Reads

DEPTH = 5
"""Emitters of a path, as in the paper."""
BREADTH = 10
"""Emitters that paths are made of: 30,240 paths."""


def backtrack(reads: Reads, depth: int = DEPTH, breadth: int = BREADTH) -> Strategy:
    """The first emitter of the path of ``depth`` for which least is read; of equals, that with the most unshot power.

    Paths lead through the ``breadth`` emitters for which least would be read at once.
    """

    def choose(candidates: Candidates) -> int:
        at_once = reads.after(candidates.last)
        near = _nearest(candidates, at_once[candidates.waiting], breadth)
        cost, step = at_once[near], reads.between(near).ravel()
        for edges in _tree(len(near), min(depth, len(near))):
            cost = np.repeat(cost, len(edges) // len(cost)) + step[edges]
        best = cost.reshape(len(near), -1).min(1)
        return strongest(candidates, near[best == best.min()])

    return choose


def _nearest(candidates: Candidates, cost: np.ndarray, count: int) -> np.ndarray:
    """The ``count`` emitters (or all) of least ``cost``; of equals, those with the most unshot power, then the first."""
    waiting = candidates.waiting
    if len(waiting) > count:
        enough = cost <= np.partition(cost, count - 1)[count - 1]
        waiting, cost = waiting[enough], cost[enough]
    return np.sort(waiting[np.lexsort((waiting, -candidates.unshot[waiting], cost))[:count]])


@functools.lru_cache(maxsize=BREADTH)
def _tree(count: int, depth: int) -> tuple[np.ndarray, ...]:
    """Of all sequences of ``depth`` different things of ``count``, the steps after the first level by level.

    Step a to b is a * count + b; the branches of one node follow one another, and nodes stand in the order of their parents.
    """
    paths = np.arange(count)[:, None]
    levels = []
    for _ in range(depth - 1):
        parent, child = np.nonzero((paths[:, :, None] != np.arange(count)).all(1))
        levels.append(paths[parent, -1] * count + child)
        paths = np.column_stack([paths[parent], child])
    return tuple(levels)
