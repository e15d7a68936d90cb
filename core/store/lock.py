"""One run at a time in a folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import BinaryIO

from .errors import StoreError


def locked(folder: Path) -> BinaryIO:
    """An open file that holds the folder until it is closed, or until the process ends in whatever way.

    Raises :class:`StoreError` when another run holds it.
    """
    stream = (folder / "lock").open("a+b")
    try:
        if sys.platform == "win32":
            import msvcrt

            stream.seek(0)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        stream.close()
        raise StoreError(f"{folder}: another run uses this store, wait for its end or name another folder") from error
    return stream
