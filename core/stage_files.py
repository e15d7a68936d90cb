"""The result of one stage on disk: a dataclass of arrays as an ``.npz`` of the same names."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TypeVar

import numpy as np

from .npz_files import DamagedFile, read_arrays, write_arrays

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
            write_arrays(stream, arrays, compressed=False)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def load_stage(cls: type[Stage], path: str | os.PathLike[str]) -> Stage:
    """Read back what :func:`save_stage` wrote. Raises :class:`StageError` when the file is missing, damaged or of another stage."""
    try:
        arrays = read_arrays(Path(path))
    except DamagedFile as error:
        raise StageError(f"{path}: the saved result cannot be read ({error}); delete it and run again") from error
    names = {field.name for field in dataclasses.fields(cls)}
    if set(arrays) != names:
        raise StageError(f"{path}: this is not a saved {cls.__name__}; delete it and run again")
    return cls(**arrays)
