"""Where large arrays live: in memory while the budget allows, in mapped files beyond that.

A mapped array is used like any other. Its pages come from the file when they are touched and count as resident until they
are released, which happens between two blocks of work whenever the process holds more than its share. What was
written stays in the file.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import time
import weakref
from pathlib import Path

import numpy as np

from ..memory import give_back_free, resident_bytes
from .errors import StoreError, refused

SHARE = 0.5
"""Part of the budget that arrays may fill: the rest is for the work on one block."""
SMALL = 1 << 16
"""Arrays of fewer bytes stay in memory."""
_TRIM_SECONDS = 0.3
_FILL = bytes(1 << 20)


class Space:
    """Room for arrays within a memory budget.

    budget : bytes above ``base`` that the process may hold, 0 for no limit;  base : bytes that it holds without any of the solve
    folder : of the scratch files, "" for none. They have no name on POSIX systems, so that nothing is left whatever happens.
    """

    def __init__(self, budget: int = 0, base: int = 0, folder: str | Path = "") -> None:
        self.budget, self._base, self._folder = budget, base, folder
        self._maps: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()
        self._held: list[weakref.ref[np.ndarray]] = []
        self._trimmed = 0.0

    @property
    def limited(self) -> bool:
        """Whether there is a budget."""
        return self.budget > 0

    @property
    def limit(self) -> float:
        """Bytes that arrays may fill; infinite without a budget."""
        return SHARE * self.budget if self.budget else float("inf")

    def fits(self, size: int) -> bool:
        """Whether an array of ``size`` bytes can be in memory."""
        if not self.budget or size < SMALL:
            return True
        # Zeros that nobody has touched are not resident yet.
        return (
            max(resident_bytes() - self._base, sum(array.nbytes for held in self._held if (array := held()) is not None)) + size
            <= self.limit
        )

    def zeros(self, shape: int | tuple[int, ...], dtype: np.dtype | type | str = np.float64) -> np.ndarray:
        """An array of zeros, in memory or in a file. Raises :class:`StoreError` when there is no folder or no room for one."""
        array, mapped = self.paged(shape, dtype)
        if mapped is not None:
            self._maps.add(mapped)
        return array

    def paged(self, shape: int | tuple[int, ...], dtype: np.dtype | type | str) -> tuple[np.ndarray, mmap.mmap | None]:
        """As :meth:`zeros`, with the map that the array is in, if it is: its pages are the caller's to give back."""
        dtype = np.dtype(dtype)
        shape = (shape,) if isinstance(shape, int | np.integer) else tuple(shape)
        size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
        if not self.fits(size):
            self.release()  # what is mapped already need not stay
        if self.fits(size):
            return self._in_memory(shape, dtype), None
        if not self._folder:
            raise StoreError(
                f"option memory: {size / 1e6:.1f} MB more do not fit in the {self.budget / 1e6:.1f} MB allowed; "
                "name a folder for the rest with the option store"
            )
        mapped = scratch(Path(self._folder), size)
        return np.frombuffer(mapped, dtype).reshape(shape), mapped

    def _in_memory(self, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
        array = np.zeros(shape, dtype)
        if self.budget and array.nbytes >= SMALL:
            self._held = [held for held in self._held if held() is not None]
            self._held.append(weakref.ref(array))
        return array

    def watch(self, mapped: mmap.mmap) -> None:
        """Release the pages of this map too when there is need."""
        self._maps.add(mapped)

    def breathe(self) -> None:
        """To be called between blocks of work: gives pages back if the process holds more than its arrays may fill."""
        if self.budget and resident_bytes() - self._base > self.limit:
            self.release()
            # Asking the allocator costs as much as some blocks of work, so it is asked from time to time.
            now = time.perf_counter()
            if now - self._trimmed > _TRIM_SECONDS and resident_bytes() - self._base > self.limit:
                give_back_free()
                self._trimmed = time.perf_counter()

    def release(self) -> None:
        """Give back the pages of all mapped arrays."""
        for mapped in list(self._maps):
            give_back(mapped)


def give_back(mapped: mmap.mmap, low: int = 0, high: int | None = None) -> None:
    """Give back the pages that hold bytes ``low`` to ``high`` of a map; what was written to them stays in its file.

    Where the system has no such call (Windows), it decides by itself which pages stay.
    """
    if hasattr(mmap, "MADV_DONTNEED"):
        low -= low % mmap.PAGESIZE
        high = len(mapped) if high is None else min(high, len(mapped))
        if high > low:
            mapped.madvise(mmap.MADV_DONTNEED, low, high - low)


def scratch(folder: Path, size: int) -> mmap.mmap:
    """A map of a new file of ``size`` zero bytes that vanishes with it. Raises :class:`StoreError` when there is no room.

    The room is taken at once: a disk that turned out to be full while a page is written back would end the process.
    """
    try:
        with tempfile.TemporaryFile(dir=folder, prefix="scratch-") as stream:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(stream.fileno(), 0, size)
            else:
                for low in range(0, size, len(_FILL)):
                    stream.write(_FILL[: size - low])
                stream.flush()
            return mmap.mmap(stream.fileno(), size)
    except OSError as error:
        raise refused(folder, error) from error
