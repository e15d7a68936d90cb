"""Portals as what light between two rooms must pass: a first, cheap test of pairs of bodies in different rooms."""

from __future__ import annotations

import numpy as np

from .building import Doors
from .occlusion import Bodies, ShaftIndex, Shafts


class Passages:
    """The portals of some rooms, each room with a mask of those that lead into it.

    rooms : (k,) rooms that bodies may lie in
    """

    def __init__(self, doors: Doors, rooms: np.ndarray):
        self._rooms = np.unique(rooms)
        rows = np.flatnonzero(np.isin(doors.rooms, self._rooms).any(1))
        self._index = ShaftIndex(doors.frames.take(rows))
        self._mask = self._index.pack((doors.rooms[rows] == self._rooms[:, None, None]).any(2))

    def open(self, bodies: Bodies, room: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(n,) bool: bodies a and b (n,) are in one room, or their shaft meets a portal of the room of either.

        room : (m,) of every body, each one of ``rooms``
        """
        passes = room[a] == room[b]
        other = np.flatnonzero(~passes)
        if not len(other):
            return passes
        used, index = np.unique(np.concatenate([a[other], b[other]]), return_inverse=True)
        mask = self._mask[np.searchsorted(self._rooms, room[used])]
        i, j = index[: len(other)], index[len(other) :]
        for start, left in Shafts(bodies.take(used), self._index).left(i, j):
            here = slice(start, start + len(left))
            passes[other[here]] = (left & mask[i[here]]).any(1) & (left & mask[j[here]]).any(1)
        return passes
