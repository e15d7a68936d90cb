"""Lloyd's iteration among near clusters: items cross the borders between clusters at a cost linear in their number."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .distances import Distance, Groups
from .isodata import BLOCK_PAIRS, MAX_STEPS, iterate
from .items import ClusterItems

NEAR = 8
"""Clusters that an item chooses among: the one it is in and the nearest to that one."""
WINDOW = 1024
"""Clusters among which the nearest are sought."""
_PART = 128


def settle(
    items: ClusterItems,
    rows: np.ndarray,
    start: np.ndarray,
    label: np.ndarray,
    cluster_start: np.ndarray,
    distance: Distance,
    steps: int = MAX_STEPS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Move items from their clusters to nearer ones close by until all rest.

    rows : (m,) items sorted by room, room r owns ``rows[start[r]:start[r + 1]]``
    label : (m,) int64 their clusters; room r owns the numbers ``cluster_start[r]:cluster_start[r + 1]``, each of which is in use
    Returns (label, steps taken (R,) int32, oscillated (R,) bool) as :func:`~.isodata.lloyd`.
    """
    seeds = np.zeros(int(cluster_start[-1]), np.int64)
    seeds[label] = rows
    groups = Groups(items, seeds)
    groups.move(rows, label)
    near = nearest_clusters(groups.of("barycenter"), cluster_start)
    room = np.repeat(np.arange(len(start) - 1), np.diff(start))

    def blocks(active: np.ndarray, label: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, bool]]:
        moving = np.flatnonzero(active[room])
        size = BLOCK_PAIRS // NEAR
        for block in (moving[i : i + size] for i in range(0, len(moving), size)):
            yield block, near.take(label[block], axis=0), False

    return iterate(items, rows, start, groups, label, np.diff(cluster_start) > 1, blocks, distance, steps)


def numbered_by_room(label: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels (m,) of rows as :func:`settle` takes them, numbers without gaps and room after room, and ``cluster_start`` (R + 1,)."""
    room = np.repeat(np.arange(len(start) - 1), np.diff(start))
    span = int(label.max(initial=0)) + 1
    found, index = np.unique(room * span + label, return_inverse=True)
    return index.reshape(-1), np.searchsorted(found, span * np.arange(len(start)))


def nearest_clusters(barycenter: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(g, NEAR) int64: every cluster itself, then the nearest others of its room, for barycenters (g, 3) in metres.

    Room r owns the clusters ``start[r]:start[r + 1]``. Where it has fewer than NEAR, a cluster is named again. In rooms of more than
    WINDOW clusters the nearest are sought among the WINDOW around each along the room's longest axis.
    """
    number = len(barycenter)
    room = np.repeat(np.arange(len(start) - 1), np.diff(start))
    order = np.lexsort((_along_the_longest_axis(barycenter, start), room))
    result = np.empty((number, NEAR), np.int64)
    for low in range(0, number, _PART):
        some = order[low : low + _PART]
        begin = max(int(start[room[some[0]]]), low - (WINDOW - _PART) // 2)
        end = min(int(start[room[some[-1]] + 1]), low + _PART + (WINDOW - _PART) // 2)
        others = order[begin:end]
        middle = barycenter[some].mean(axis=0)  # a matrix product about it loses few digits far from the origin
        a, b = barycenter[some] - middle, barycenter[others] - middle
        squared = np.einsum("ij,ij->i", b, b) - 2.0 * (a @ b.T)
        squared[room[some][:, None] != room[others]] = np.inf
        squared[np.arange(len(some)), np.arange(len(some)) + low - begin] = -np.inf
        count = min(NEAR, len(others))
        close = np.argpartition(squared, count - 1, axis=1)[:, :count]
        value = np.take_along_axis(squared, close, axis=1)
        rank = np.argsort(value, axis=1, kind="stable")
        found = others[np.take_along_axis(close, rank, axis=1)]
        found = np.where(np.isposinf(np.take_along_axis(value, rank, axis=1)), some[:, None], found)
        result[some, :count], result[some, count:] = found, some[:, None]
    return result


def _along_the_longest_axis(position: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(g,) float64: of every position (g, 3) the coordinate in which the positions of its room spread most."""
    used = np.flatnonzero(np.diff(start) > 0)
    if not len(used):
        return np.zeros(0)
    size = np.maximum.reduceat(position, start[used], axis=0) - np.minimum.reduceat(position, start[used], axis=0)
    axis = np.repeat(np.argmax(size, axis=1), np.diff(start)[used])
    return position[np.arange(len(position)), axis]
