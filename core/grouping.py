"""Small array idioms shared by every stage: ragged ranges, connected components, growing arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def ragged(starts: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All ranges ``start, start + 1, ..`` of ``count`` members one after another.

    Returns (members, owner): two int64 arrays of ``counts.sum()``; ``owner`` is the index of the range.
    """
    counts = np.asarray(counts, np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    return np.arange(len(owner)) - first[owner] + np.asarray(starts, np.int64)[owner], owner


def starts_of(sorted_keys: np.ndarray, count: int) -> np.ndarray:
    """(count + 1,) int64: where each key 0..count-1 begins in a sorted array of keys."""
    return np.searchsorted(sorted_keys, np.arange(count + 1)).astype(np.int64)


def runs(keys: np.ndarray) -> np.ndarray:
    """(r,) int64: where each run of equal ``keys`` (n,) begins."""
    begins = np.ones(len(keys), bool)
    np.not_equal(keys[1:], keys[:-1], out=begins[1:])
    return begins.nonzero()[0]


def components(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(count,) int64 label of every node of an undirected graph with edges a-b; labels 0.. by smallest member."""
    label = np.arange(count)
    while True:
        low = np.minimum(label[a], label[b])
        before = label.copy()
        np.minimum.at(label, label[a], low)
        np.minimum.at(label, label[b], low)
        label = label[label]
        label = label[label]
        if np.array_equal(label, before):
            return np.unique(label, return_inverse=True)[1]


def morton(place: np.ndarray) -> np.ndarray:
    """(n,) int64 position of places (n, 3) along a Morton curve through the cube around them, 1024 cells a side."""
    if not len(place):
        return np.zeros(0, np.int64)
    offset = (place - place.min(0)).astype(np.float64)
    cell = np.minimum(offset * (1024 / max(float(offset.max()), 1e-300)), 1023).astype(np.int64)
    code = np.zeros(len(place), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return code


def gathered(parts: list[np.ndarray], place: np.ndarray, weight: np.ndarray, size: float) -> list[np.ndarray]:
    """Index arrays joined to blocks of summed ``weight`` (n,) up to ``size`` (a heavier one stays by itself), near ones together.

    place : (n, 3) where each part lies; the parts follow each other along a Morton curve through these places
    """
    blocks, waiting, total = [], [], 0
    for k in np.argsort(morton(place), kind="stable"):
        if waiting and total + weight[k] > size:
            blocks.append(np.concatenate(waiting))
            waiting, total = [], 0
        waiting.append(parts[k])
        total += weight[k]
    return [*blocks, np.concatenate(waiting)] if waiting else blocks


class GrowingArray:
    """An array that grows at its end in amortised constant time; ``view()`` is the filled part.

    ``allocate``, a function of shape and dtype like ``np.zeros``, makes room when it grows.
    """

    def __init__(self, shape: tuple[int, ...] = (), dtype: np.dtype | type = np.float64):
        self._data = np.zeros((16, *shape), dtype)
        self._size = 0
        self.allocate: Callable[..., np.ndarray] = np.zeros

    def __getstate__(self) -> dict:
        """What another process needs of it: the filled part."""
        return {"_data": self.view(), "_size": self._size, "allocate": np.zeros}

    def __len__(self) -> int:
        return self._size

    def extend(self, rows: np.ndarray) -> None:
        """Append rows (n, *shape)."""
        need = self._size + len(rows)
        if need > len(self._data):
            self.reserve(max(need, 2 * len(self._data)))
        self._data[self._size : need] = rows
        self._size = need

    def reserve(self, rows: int) -> None:
        """Make room for ``rows`` in all."""
        grown = self.allocate((rows, *self._data.shape[1:]), self._data.dtype)
        grown[: self._size] = self._data[: self._size]
        self._data = grown

    def view(self) -> np.ndarray:
        """The filled part; not to be kept over a call of :meth:`extend`."""
        return self._data[: self._size]
