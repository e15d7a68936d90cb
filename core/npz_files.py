"""Arrays into ``.npz`` files, and out of those of unknown origin: every size is checked before memory is taken for it."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

MEMBERS = 1000
"""Most arrays in one file."""
EXPANSION = 200
"""Most bytes of arrays for a byte of the file, beyond ``FREE`` bytes: what exceeds that is made to fill memory, or damaged."""
FREE = 1 << 26
KINDS = "fiubU"
"""Kinds of numbers and texts that arrays may hold."""

_ERRORS = (
    OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, EOFError, MemoryError, OverflowError, RecursionError, SyntaxError,
    RuntimeError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


class DamagedFile(ValueError):
    """A file that is no readable ``.npz`` archive; the message says why, in a few words."""


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an ``.npz`` file by name. Raises :class:`DamagedFile`; memory stays within ``FREE`` and ``EXPANSION``."""
    try:
        with path.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            members = archive.infolist()
            if len(members) > MEMBERS:
                raise DamagedFile(f"it has {len(members)} parts")
            budget = FREE + EXPANSION * path.stat().st_size
            if sum(member.file_size for member in members) > budget:
                raise DamagedFile("its arrays are far larger than the file")
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
    except DamagedFile:
        raise
    except _ERRORS as error:
        text = (str(error).strip().splitlines() or [""])[0].rstrip(".")
        raise DamagedFile(text if text and len(text) < 200 else type(error).__name__) from error


def write_arrays(stream: BinaryIO, arrays: Mapping[str, np.ndarray], compressed: bool = True) -> None:
    """Write arrays as an ``.npz`` that NumPy reads. Raises OSError when there is no room, and tells nobody else of it.

    ``numpy.savez`` leaves its archive to the garbage collector then, which prints a traceback of its own.
    """
    method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    name = member.filename.removesuffix(".npy")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise DamagedFile(f"the part {name!r} is packed in an unknown way")
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise DamagedFile(f"the array {name!r} has an unknown form")
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(stream)
        if dtype.kind not in KINDS or dtype.subdtype is not None:
            raise DamagedFile(f"the array {name!r} holds {dtype} where numbers or texts are due")
        count = 1
        for length in shape:
            if length < 0:
                raise DamagedFile(f"the array {name!r} has the shape {shape}")
            count *= length
        # The header cannot promise more than the part holds; texts of no length would promise any number of them.
        if count * max(dtype.itemsize, 1) > member.file_size:
            raise DamagedFile(f"the array {name!r} is cut short")
        content = stream.read(count * dtype.itemsize)
        if len(content) < count * dtype.itemsize or stream.read(1):
            raise DamagedFile(f"the array {name!r} has another length than it says")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C")
