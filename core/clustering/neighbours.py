"""Lloyd's iteration among near clusters: it lets items cross the borders that a hierarchy drew, at a cost linear in their number."""

from __future__ import annotations

import numpy as np

from .distances import Candidates, Distance, Groups
from .isodata import BLOCK_PAIRS, MAX_STEPS
from .items import ClusterItems

NEAR = 8
"""Clusters that an item chooses among: the one it is in and the nearest to that one."""
WINDOW = 2048
"""Clusters among which the nearest are sought."""


def settle(
    items: ClusterItems, rows: np.ndarray, label: np.ndarray, distance: Distance, steps: int = MAX_STEPS
) -> tuple[np.ndarray, int, bool]:
    """Move the items of one room, ``rows`` (m,), from their clusters ``label`` (m,), numbered 0.., to nearer ones close by.

    Returns (label (m,) int64, steps taken, whether an earlier state came back).
    """
    number = int(label.max(initial=-1)) + 1
    seeds = np.zeros(number, np.int64)
    seeds[label] = rows
    groups = Groups(items, seeds)
    groups.move(rows, label)
    near = nearest_clusters(groups.of("barycenter"))
    seen: set[bytes] = set()
    for step in range(1, steps + 1):
        assigned = label.copy()
        size = max(1, BLOCK_PAIRS // NEAR)
        for block in (slice(i, i + size) for i in range(0, len(rows), size)):
            index = near[label[block]]
            best = np.argmin(distance(items, rows[block], Candidates(groups, index)), axis=1)
            assigned[block] = index[np.arange(len(index)), best]
        if np.array_equal(assigned, label):
            return label, step, False
        state = assigned.tobytes()
        label = assigned
        if state in seen:
            return label, step, True
        seen.add(state)
        groups.move(rows, label)
    return label, steps, False


def nearest_clusters(barycenter: np.ndarray) -> np.ndarray:
    """(g, min(NEAR, g)) int64: every cluster itself and the nearest others, for barycenters (g, 3) in metres.

    They are sought among the WINDOW clusters around it along the longest axis, so among all where there are fewer.
    """
    number = len(barycenter)
    count = min(NEAR, number)
    result = np.empty((number, count), np.int64)
    if not number:
        return result
    order = np.argsort(barycenter[:, np.argmax(np.ptp(barycenter, axis=0))], kind="stable")
    width = min(WINDOW, number)
    for low in range(0, number, WINDOW // 4):
        some = order[low : low + WINDOW // 4]
        begin = min(max(low - 3 * WINDOW // 8, 0), number - width)
        others = order[begin : begin + width]
        middle = barycenter[some].mean(axis=0)  # a matrix product about it loses no digits far from the origin
        a, b = barycenter[some] - middle, barycenter[others] - middle
        squared = np.einsum("ij,ij->i", b, b) - 2.0 * (a @ b.T)
        squared[np.arange(len(some)), np.arange(len(some)) + low - begin] = -np.inf
        close = np.argpartition(squared, count - 1, axis=1)[:, :count]
        value = np.take_along_axis(squared, close, axis=1)
        result[some] = others[np.take_along_axis(close, np.argsort(value, axis=1, kind="stable"), axis=1)]
    return result
