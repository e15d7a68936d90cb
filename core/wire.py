"""Messages between a process and its workers: any objects, their arrays as raw bytes beside the pickle (PEP 574).

Only ever spoken with processes that this one has started itself, over their own pipes; nothing of it is read from files.
"""

from __future__ import annotations

import mmap
import os
import pickle
import struct
import tempfile
from pathlib import Path
from typing import Any, BinaryIO

_ALIGN = 64


def send(stream: BinaryIO, message: Any) -> None:
    """Write a message. Raises OSError when the other end is gone."""
    head, buffers = _packed(message)
    sizes = [len(head), *(b.nbytes for b in buffers)]
    stream.write(struct.pack(f"<Q{len(sizes)}Q", len(sizes), *sizes))
    for part in (head, *buffers):
        stream.write(part)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """The next message; its arrays can be written to. Raises EOFError when the other end is gone."""
    (count,) = struct.unpack("<Q", _read(stream, 8))
    sizes = struct.unpack(f"<{count}Q", _read(stream, 8 * count))
    head, *buffers = (_read(stream, size) for size in sizes)
    return pickle.loads(head, buffers=buffers)


class Shared:
    """One object in memory that other processes can map: written once, read only.

    ``ticket`` tells them where. The memory goes when this object goes and nobody maps it any more; on systems without nameless
    memory files it is a file in the folder for temporary files until then.
    """

    def __init__(self, thing: Any):
        head, buffers = _packed(thing)
        sizes = [len(head), *(b.nbytes for b in buffers)]
        starts, end = [], 0
        for size in sizes:
            starts.append(end)
            end += -(-size // _ALIGN) * _ALIGN
        self._file = None
        if hasattr(os, "memfd_create"):
            self._descriptor = os.memfd_create("enfilade")
            path = f"/proc/{os.getpid()}/fd/{self._descriptor}"
        else:
            self._descriptor, path = tempfile.mkstemp(prefix="enfilade-")
            self._file = Path(path)
        self.ticket = path, end, tuple(zip(starts, sizes, strict=True))
        os.ftruncate(self._descriptor, max(end, 1))
        with mmap.mmap(self._descriptor, max(end, 1)) as memory:
            for start, size, part in zip(starts, sizes, (head, *buffers), strict=True):
                memory[start : start + size] = part

    def close(self) -> None:
        """Give the memory back, as soon as nobody maps it."""
        if self._descriptor is None:
            return
        os.close(self._descriptor)
        self._descriptor = None
        if self._file:
            self._file.unlink(missing_ok=True)


def attached(ticket: tuple) -> Any:
    """The object behind the ticket of a :class:`Shared` of another process; its arrays are read only."""
    path, size, parts = ticket
    with open(path, "rb") as stream:
        memory = memoryview(mmap.mmap(stream.fileno(), max(size, 1), access=mmap.ACCESS_READ))
    head, *buffers = (memory[start : start + length] for start, length in parts)
    return pickle.loads(head, buffers=buffers)


def can_travel(thing: Any) -> bool:
    """Whether a thing arrives at the other end; some errors can be taken apart and not put together again."""
    try:
        pickle.loads(pickle.dumps(thing))
    except Exception:
        return False
    return True


def _packed(thing: Any) -> tuple[bytes, list[memoryview]]:
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    return head, [b.raw() for b in buffers]


def _read(stream: BinaryIO, size: int) -> bytearray:
    data = bytearray(size)
    view, done = memoryview(data), 0
    while done < size:
        got = stream.readinto(view[done:])
        if not got:
            raise EOFError("the other end is gone")
        done += got
    return data
