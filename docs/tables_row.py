"""One solve for the tables of :mod:`.tables`, in a process of its own: its figures as JSON on the last line.

``python -m enfilade.docs.tables_row SCENE SCALE SEED OPTIONS``, options as JSON.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core import pipeline, stages
from ..core.console import ProgressLine
from ..core.memory import peak_bytes, resident_bytes
from ..core.options import OptionError, Options
from ..core.saved_forest import arrays_of
from ..core.scene_checks import check
from ..core.shooting import Shooter
from ..core.store import Residency, Space, Store, least_reads
from ..core.workspace import fingerprint

SHARES = (0.05, 0.1, 0.2, 0.5)
"""Memory for the light and the elements of emitters, as parts of those of the whole building, for which reading is counted."""


class Log:
    """What the shots of a run need: the emitters of each shot, and the links of each emitter."""

    def __init__(self) -> None:
        self.order: list[int] = []
        self.reached: dict[int, np.ndarray] = {}
        self.links: dict[int, int] = {}
        self.element_bytes = 0.0
        self.elements = np.zeros(0, np.int64)


def logged(log: Log) -> type[Shooter]:
    """A shooter that keeps a log."""

    class Logged(Shooter):
        def __init__(self, forest, routes, emitters, *more):
            super().__init__(forest, routes, emitters, *more)
            log.elements = np.diff(emitters.start)
            fixed = sum(array.nbytes for array in arrays_of(forest).values())
            log.element_bytes = fixed / max(len(forest), 1) + self._light.itemsize

        def _shoot(self, emitter):
            log.order.append(emitter)
            self._known, self._met = emitter in log.reached, [np.array([emitter])]
            log.links.setdefault(emitter, 0)
            super()._shoot(emitter)
            if not self._known:
                log.reached[emitter] = np.unique(np.concatenate(self._met))

        def _receive(self, beam, light):
            if not self._known:
                self._met.append(self._emitters.of(beam.receivers))
                log.links[log.order[-1]] += beam.nbytes
            return super()._receive(beam, light)

    return Logged


def replayed(log: Log) -> dict[str, Any]:
    """Bytes of the largest set of a shot and of all, and what is read and written of emitters if some share of all fits in memory."""
    size = np.rint(log.elements * log.element_bytes).astype(np.int64)
    needs = [log.reached[emitter] for emitter in log.order]
    sets = [int(size[reached].sum()) + log.links[emitter] for emitter, reached in log.reached.items()]
    traffic = []
    for share in SHARES:
        memory = Residency(size, share * size.sum())
        for needed in needs:
            memory.next_shot()
            memory.need(needed)
        least = least_reads(needs, size, share * size.sum())
        traffic.append({"limit": share * float(size.sum()), "read": memory.read, "written": memory.written, "least": least})
    return {
        "shots": len(log.order),
        "set_bytes": max(sets, default=0),
        "all_bytes": int(size.sum()) + sum(log.links.values()),
        "links_bytes": sum(log.links.values()),
        "links_read": sum(log.links[emitter] for emitter in log.order),
        "traffic": traffic,
    }


def main(argv: Sequence[str]) -> int:
    """Solve, and print the figures; 2 after one sentence of what is wrong."""
    name, scale, seed, options = argv
    line = ProgressLine(sys.stderr)
    base = resident_bytes()
    scene, _ = check(importlib.import_module(f"..sample_scenes.{name}", __package__).scene(float(scale), int(seed)))
    log, chosen = Log(), Options(**json.loads(options))
    pipeline.Shooter, stages.CHECKPOINT_SECONDS = logged(log), float("inf")
    try:
        if chosen.store:  # all shots are to be seen, so that none may have been done before
            store = Store(chosen.store, fingerprint(scene, chosen), Space())
            store.drop("shooting")
            store.close()
        solution = pipeline.solve(scene, chosen, lambda step: line.show(step.stage, step.fraction, step.message))
    except (OptionError, MemoryError) as error:
        line.close()
        sys.stderr.write(f"{error}\n")
        return 2
    line.close()
    figures = {"report": solution.report, "base_bytes": base, "peak_bytes": peak_bytes(), "replay": replayed(log)}
    print(json.dumps(figures, default=lambda x: x.tolist() if hasattr(x, "tolist") else str(x)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
