"""The result of one stage on disk: a dataclass of arrays as an ``.npz`` of the same names."""

from __future__ import annotations

import dataclasses
import os
import zipfile
import zlib
from pathlib import Path
from typing import TypeVar

import numpy as np

Stage = TypeVar("Stage")


class StageError(ValueError):
    """The saved result of a stage cannot be used; the message names the file and the remedy."""


def save_stage(result: object, path: str | os.PathLike[str]) -> None:
    """Write a dataclass whose fields are all arrays (or numbers) to ``path``; the file appears whole or not at all.

    Raises OSError when it cannot be written.
    """
    path = Path(path)
    arrays = {field.name: np.asarray(getattr(result, field.name)) for field in dataclasses.fields(result)}
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as stream:
            np.savez(stream, **arrays)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def load_stage(cls: type[Stage], path: str | os.PathLike[str]) -> Stage:
    """Read back what :func:`save_stage` wrote. Raises :class:`StageError` when the file is missing, damaged or of another stage."""
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except (OSError, ValueError, TypeError, AttributeError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise StageError(f"{path}: the saved result cannot be read ({type(error).__name__}); delete it and run again") from error
    names = {field.name for field in dataclasses.fields(cls)}
    if set(arrays) != names:
        raise StageError(f"{path}: this is not a saved {cls.__name__}; delete it and run again")
    return cls(**arrays)
