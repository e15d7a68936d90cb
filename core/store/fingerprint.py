"""A digest of what a run depends on: its scene, its options, and the program itself."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import numpy as np


def digest(*things: Any) -> str:
    """Hexadecimal SHA-256 of arrays, numbers, texts and None, also within tuples, lists, dicts and dataclasses.

    Raises TypeError for anything else.
    """
    found = hashlib.sha256()
    _feed(found, things)
    return found.hexdigest()


def program() -> str:
    """Digest of the sources of the core: what one version has left half done is not for another to go on with."""
    root = Path(__file__).resolve().parents[1]
    return digest(*((path.relative_to(root).as_posix(), path.read_bytes()) for path in sorted(root.rglob("*.py"))))


def _feed(found: Any, thing: Any) -> None:
    """Every part announces its kind and length, so that no two different things read alike."""
    if isinstance(thing, np.ndarray):
        found.update(f"array {thing.dtype.str} {thing.shape};".encode())
        found.update(np.ascontiguousarray(thing).data)
    elif isinstance(thing, tuple | list):
        found.update(f"list {len(thing)};".encode())
        for part in thing:
            _feed(found, part)
    elif isinstance(thing, dict):
        _feed(found, sorted(thing.items()))
    elif dataclasses.is_dataclass(thing):
        found.update(type(thing).__name__.encode())
        _feed(found, [(f.name, getattr(thing, f.name)) for f in dataclasses.fields(thing)])
    elif isinstance(thing, bytes):
        found.update(f"bytes {len(thing)};".encode())
        found.update(thing)
    elif thing is None or isinstance(thing, str | bool | int | float | np.generic):
        text = repr(thing).encode()
        found.update(f"{type(thing).__name__} {len(text)};".encode() + text)
    else:
        raise TypeError(f"{type(thing).__name__} has no digest")
