"""Lloyd's iteration in many rooms at once: the ISODATA algorithm as section 4.1 of the paper runs it.

Every item joins the nearest cluster, every cluster moves to the mean of its items, and so on until nothing changes, a
state returns (oscillation) or ten steps are done. All rooms advance together in blocks of (item, cluster) pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..grouping import ragged
from .distances import Candidates, Distance, Groups
from .items import ClusterItems

MAX_STEPS = 10
"""Most Lloyd steps (section 4.1 of the paper: ten interrupt what has not settled)."""
BLOCK_PAIRS = 1 << 16
"""Item-cluster pairs that are compared at once."""


Blocks = Callable[[np.ndarray, np.ndarray], Iterator[tuple[np.ndarray, np.ndarray, bool]]]
"""``blocks(active (R,) bool, label (m,))``: parts of the active rooms' rows, each with the clusters that it chooses among.

Yields (positions (b,) in the rows, index (b, k) of clusters, or (1, k) where all share them, whether they do).
"""


def lloyd(
    items: ClusterItems,
    rows: np.ndarray,
    start: np.ndarray,
    number: np.ndarray,
    seeds: np.ndarray,
    distance: Distance,
    steps: int = MAX_STEPS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lloyd's iteration in all rooms at once, every item choosing among all clusters of its room.

    rows : (m,) items sorted by room, room r owns ``rows[start[r]:start[r + 1]]``
    number : (R,) clusters of each room;  seeds : (sum,) the items that the clusters begin with, room after room
    Returns (label (m,) int64 index into ``seeds``, steps taken (R,) int32, oscillated (R,) bool). A cluster that no label
    names has lost all its items.
    """
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(number)])
    room = np.repeat(np.arange(len(number)), np.diff(start))
    only = np.where(number[room] == 1, first[room], -1)  # one cluster takes all in one step
    label, iterations, oscillated = iterate(
        items, rows, start, Groups(items, seeds), only, number > 1, lambda active, _: _blocks(start, number, first, active), distance, steps
    )
    return label, np.where(number == 1, 1, iterations).astype(np.int32), oscillated


def iterate(
    items: ClusterItems,
    rows: np.ndarray,
    start: np.ndarray,
    groups: Groups,
    label: np.ndarray,
    active: np.ndarray,
    blocks: Blocks,
    distance: Distance,
    steps: int = MAX_STEPS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Assign the rows of the active rooms to the nearest of the clusters that ``blocks`` offers, move ``groups``, and so on.

    label : (m,) int64 clusters of the rows before the first step, -1 for none
    Returns label, steps and oscillation as :func:`lloyd`; a step that changes nothing is the last of its room.
    """
    rooms = len(active)
    row_room = np.repeat(np.arange(rooms), np.diff(start))
    active = active & (np.diff(start) > 0)
    iterations = np.zeros(rooms, np.int32)
    oscillated = np.zeros(rooms, bool)
    # A sum of the labels under fixed random 64-bit weights stands for the state of a room: an earlier state is recognised.
    signature_weight = np.random.default_rng(0).integers(0, 1 << 64, len(rows), np.uint64)
    seen = np.zeros((steps, rooms), np.uint64)
    for step in range(steps):
        if not active.any():
            break
        iterations[active] = step + 1
        assigned = label.copy()
        for block, index, shared in blocks(active, label):
            nearest = np.argmin(distance(items, rows[block], Candidates(groups, index)), axis=1)
            assigned[block] = index[0, nearest] if shared else index[np.arange(len(block)), nearest]
        changed = np.bincount(row_room[assigned != label], minlength=rooms) > 0
        label = assigned
        active &= changed
        seen[step] = np.add.reduceat(np.append(label.astype(np.uint64) * signature_weight, np.uint64(0)), np.minimum(start[:-1], len(rows)))
        returned = active & (seen[:step] == seen[step]).any(axis=0)
        oscillated |= returned
        active &= ~returned
        moving = active[row_room]
        groups.move(rows[moving], label[moving])
    return label, iterations, oscillated


def _blocks(start: np.ndarray, number: np.ndarray, first: np.ndarray, active: np.ndarray):
    """Blocks of about BLOCK_PAIRS pairs that cover the active rooms: (positions (m,), candidates (m or 1, k), shared).

    A big room makes blocks of its own whose rows share the candidates. Small rooms with about equally many barycenters
    come together, the shorter lists filled up with their last entry, which as the later of two equals never wins.
    """
    size = np.diff(start)
    big = active & (size * number > BLOCK_PAIRS // 4)
    for r in np.flatnonzero(big):
        candidate = np.arange(first[r], first[r + 1])[None]
        step = max(1, BLOCK_PAIRS // int(number[r]))
        for i in range(start[r], start[r + 1], step):
            yield np.arange(i, min(i + step, start[r + 1])), candidate, True
    rooms = np.flatnonzero(active & ~big)
    if not len(rooms):
        return
    bucket = np.ceil(2.0 * np.log2(number[rooms])).astype(np.int64)
    rooms = rooms[np.argsort(bucket, kind="stable")]
    bucket = np.sort(bucket)
    width = np.ceil(2.0 ** (0.5 * bucket)).astype(np.int64) + 1
    batch = np.cumsum(size[rooms] * width) // BLOCK_PAIRS
    cut = np.flatnonzero((np.diff(bucket) != 0) | (np.diff(batch) != 0)) + 1
    for group in np.split(rooms, cut):
        position, owner = ragged(start[group], size[group])
        slot = np.minimum(np.arange(number[group].max()), number[group][:, None] - 1)
        yield position, (first[group][:, None] + slot)[owner], False
