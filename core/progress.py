"""What a run tells of itself on its way."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .solution import Solution

PATIENCE = 3.0
"""Seconds of a run before it is told how long it will take."""
_MEMORY = 0.3
"""The pace is that of this last part of the time so far: stages differ in how fast they go."""


@dataclass(frozen=True)
class Progress:
    """Where a solve is: the stage, the share of the whole run that is done (0..1), and a line for people.

    so_far : makes a solution of the light as it is, of the elements alone; to be called before the next step, None where there is none
    remaining : seconds that the run will still take, as far as can be told, else None
    """

    stage: str
    fraction: float
    message: str
    so_far: Callable[[], Solution] | None = field(default=None, compare=False, repr=False)
    remaining: float | None = field(default=None, compare=False)


class TimeLeft:
    """Seconds that a run will still take, from the pace at which its done share has grown lately."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._start = now()
        self._steps: deque[tuple[float, float]] = deque([(self._start, 0.0)])

    def after(self, fraction: float) -> float | None:
        """The estimate when ``fraction`` (0..1) is done; None as long as there is nothing to go by."""
        now = self._now()
        self._steps.append((now, fraction))
        while len(self._steps) > 2 and self._steps[1][0] <= now - _MEMORY * (now - self._start):
            self._steps.popleft()
        begin, before = self._steps[0]
        if now - self._start < PATIENCE or fraction <= before or now <= begin:
            return None
        return max(0.0, 1 - fraction) * (now - begin) / (fraction - before)


def words(seconds: float) -> str:
    """A time left as people say it: ``40 s left``, ``12 min left``, ``3 h 10 min left``."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s left"
    minutes = round(seconds / 60)
    return f"{minutes} min left" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min left"
