"""What a run works with: its workers, its store, its share of the memory, and its clock."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from .memory import resident_bytes
from .options import Options
from .parallel import Crew, worker_count
from .scene import Scene
from .store import Nowhere, Space, Store, digest, program

WORKER_BYTES = 200_000_000
"""Memory budget for which one more worker process is called: a worker has an interpreter, and a block of work, of its own."""
HARMLESS = ("ordering", "max_iterations", "reflected", "memory", "store", "threads")
"""Options that change nothing of what comes before the shooting."""


@dataclasses.dataclass
class Workspace:
    """crew : workers;  store : finished stages;  space : room for large arrays;  clock : seconds by stage"""

    crew: Crew
    store: Nowhere
    space: Space
    clock: Clock


class Clock:
    """Wall seconds by stage, those of interrupted runs included."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str, before: float = 0.0) -> float:
        """Seconds since the last lap, and those ``before``, are those of this stage."""
        now = time.perf_counter()
        self.seconds[stage] = now - self._last + before
        self._last = now
        return self.seconds[stage]

    def running(self) -> float:
        """Seconds since the last lap."""
        return time.perf_counter() - self._last


@contextmanager
def workspace(scene: Scene, options: Options) -> Iterator[Workspace]:
    """All that a run needs, closed at its end. Raises :class:`StoreError` when the store cannot be used."""
    # What the process holds for other reasons than this solve is not counted, its scene is.
    base = resident_bytes() - sum(array.nbytes for array in _arrays(scene))
    space = Space(options.memory, base, options.store)
    workers = worker_count(options.threads)
    if options.memory:
        workers = max(1, min(workers, options.memory // WORKER_BYTES))
    store = Store(options.store, fingerprint(scene, options), space) if options.store else Nowhere()
    crew = Crew(workers)
    try:
        yield Workspace(crew, store, space, Clock())
    finally:
        store.close()


def fingerprint(scene: Scene, options: Options) -> str:
    """Of everything that the links depend on: the scene but for its evaluation points, options, and this program."""
    chosen = {info.name: getattr(options, info.name) for info in dataclasses.fields(options) if info.name not in HARMLESS}
    return digest(program(), dataclasses.replace(scene, points=None), chosen)


def _arrays(thing: Any) -> Iterator[np.ndarray]:
    if isinstance(thing, np.ndarray):
        yield thing
    elif dataclasses.is_dataclass(thing):
        for field in dataclasses.fields(thing):
            yield from _arrays(getattr(thing, field.name))
