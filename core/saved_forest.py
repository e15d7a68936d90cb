"""A forest as named arrays, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from .elements import Forest
from .grouping import GrowingArray
from .links import BLOCK, Allocate
from .regions import Regions


def arrays_of(forest: Forest) -> dict[str, np.ndarray]:
    """Everything that a forest knows beyond its regions and its order, by name."""
    return {name: array.view() for name, array in _growing(forest).items()}


def forest_of(regions: Regions, order: int, arrays: Mapping[str, np.ndarray], allocate: Allocate, breathe: Callable[[], None]) -> Forest:
    """The forest of :func:`arrays_of`, which can grow again; ``breathe`` is called between blocks of what is copied."""
    forest = Forest(regions, order)
    for name, old in _growing(forest).items():
        rows = arrays[name]
        array = GrowingArray(rows.shape[1:], old.view().dtype)
        array.allocate = allocate
        array.reserve(max(len(rows), 1))
        for low in range(0, len(rows), BLOCK):
            array.extend(rows[low : low + BLOCK])
            breathe()
        setattr(forest, f"_{name}", array)
    return forest


def kept_by(forest: Forest, allocate: Allocate) -> Forest:
    """The same forest, which grows where ``allocate`` makes room for it."""
    for array in _growing(forest).values():
        array.allocate = allocate
    return forest


def _growing(forest: Forest) -> dict[str, GrowingArray]:
    return {name.removeprefix("_"): array for name, array in vars(forest).items() if isinstance(array, GrowingArray)}
