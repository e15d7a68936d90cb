"""Which emitters' light is in memory: the least recently used goes first. And the least that any choice would read.

When an emitter shoots, its own light and that of all whom it reaches must be in memory (paper, section 6).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np


class Residency:
    """Counts what is read and written for emitters of ``size`` (n,) bytes each while at most ``limit`` bytes stay.

    Those who are needed for one shot stay for that shot, even if they alone are more. ``leave`` is told who goes.
    read, written : bytes so far
    """

    def __init__(self, size: np.ndarray, limit: float, leave: Callable[[np.ndarray], None] = lambda gone: None) -> None:
        self._size, self._limit, self._leave = np.asarray(size, np.int64), limit, leave
        self._used = np.zeros(len(size), np.int64)
        self._here, self._changed = np.zeros(len(size), bool), np.zeros(len(size), bool)
        self._held, self._time = 0, 0
        self.read, self.written = 0, 0

    def next_shot(self) -> None:
        """Whoever was needed before may go from now on."""
        self._time += 1

    def need(self, emitters: np.ndarray) -> None:
        """Have ``emitters`` (k,), each once, in memory; their light is about to change."""
        self._used[emitters] = self._time
        new = emitters[~self._here[emitters]]
        self._here[new] = self._changed[emitters] = True
        size = int(self._size[new].sum())
        self.read, self._held = self.read + size, self._held + size
        if self._held > self._limit:
            self._make_room()

    def _make_room(self) -> None:
        here = np.flatnonzero(self._here & (self._used < self._time))
        here = here[np.argsort(self._used[here], kind="stable")]
        freed = np.cumsum(self._size[here])
        gone = here[: np.searchsorted(freed, self._held - self._limit) + 1]
        self._held -= int(self._size[gone].sum())
        self.written += int(self._size[gone[self._changed[gone]]].sum())
        self._here[gone] = self._changed[gone] = False
        self._leave(gone)


def least_reads(needs: Sequence[np.ndarray], size: np.ndarray, limit: float) -> float:
    """Bytes that must be read at least for shots that need the emitters ``needs[k]``, each once, in this order.

    What will be needed last leaves first (Belady 1966). An emitter may leave in part, so that for emitters of unequal
    ``size`` (n,) bytes no choice of whole ones reads less.
    """
    size = np.asarray(size, np.float64)
    never = len(needs)
    following, ahead = np.full(len(size), never), []
    for time in range(never - 1, -1, -1):
        ahead.append(following[needs[time]])
        following[needs[time]] = time
    here, due, read = np.zeros(len(size)), np.full(len(size), never), 0.0
    for needed, next_time in zip(needs, reversed(ahead), strict=True):
        read += float((size[needed] - here[needed]).sum())
        here[needed], due[needed] = size[needed], next_time
        excess = here.sum() - limit
        if excess > 0:
            free = here > 0
            free[needed] = False
            leaving = np.flatnonzero(free)
            leaving = leaving[np.argsort(-due[leaving], kind="stable")]
            before = np.cumsum(here[leaving]) - here[leaving]
            here[leaving] -= np.clip(excess - before, 0, here[leaving])
    return read
