"""Arrays as ``.npy`` files: written in blocks with a checksum, read as memory maps."""

from __future__ import annotations

import io
import mmap
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

_BLOCK_BYTES = 1 << 22


def write_array(path: Path, parts: Sequence[np.ndarray], breathe: Callable[[], None]) -> tuple[int, int]:
    """Write arrays of like rows one after another as one, through to the disk; returns the bytes and the CRC-32 of the file.

    breathe : called between blocks, of which one is in memory at a time. Raises OSError.
    """
    shape = (sum(len(part) for part in parts), *parts[0].shape[1:])
    descr = np.lib.format.dtype_to_descr(parts[0].dtype)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": descr, "fortran_order": False, "shape": shape})
    size, check = 0, 0
    with path.open("wb") as stream:
        for block in chain([memoryview(header.getvalue())], *map(_blocks, parts)):
            stream.write(block)
            size, check = size + len(block), zlib.crc32(block, check)
            breathe()
        stream.flush()
        os.fsync(stream.fileno())
    return size, check


def _blocks(array: np.ndarray) -> Iterator[memoryview]:
    """The bytes of an array in C order."""
    step = max(1, _BLOCK_BYTES // max(1, array.nbytes // max(1, len(array))))
    for low in range(0, len(array), step):
        yield memoryview(np.ascontiguousarray(array[low : low + step]).reshape(-1).view(np.uint8))


def checksum(path: Path) -> tuple[int, int]:
    """Bytes and CRC-32 of a file. Raises OSError."""
    size, check = 0, 0
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            size, check = size + len(block), zlib.crc32(block, check)
    return size, check


def map_array(path: Path) -> tuple[np.ndarray, mmap.mmap | None]:
    """The array of a file, read-only, and the map that it is a view of (None for one without items). Raises OSError, ValueError."""
    with path.open("rb") as stream:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError("this is not an array file of format 1.0")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        if fortran or dtype.hasobject:
            raise ValueError("this is not an array of numbers in C order")
        count = int(np.prod(shape, dtype=np.int64))
        if not count:
            return np.zeros(shape, dtype), None
        mapped = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        return np.frombuffer(mapped, dtype, count, stream.tell()).reshape(shape), mapped
