"""What a strategy goes by when it chooses who shoots next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Candidates:
    """What a strategy may look at. Its choice depends on this alone, so that an interrupted run goes on as it would have.

    waiting : (n,) int64 emitters with light to shoot that have not shot in this iteration, rising, one at least
    unshot : (units,) float64 power that each emitter has not shot yet, W
    last : the emitter that shot last, whose potentially visible set is in memory; -1 at the start, when nothing is
    rng : random generator of the run
    """

    waiting: np.ndarray
    unshot: np.ndarray
    last: int
    rng: np.random.Generator


Strategy = Callable[[Candidates], int]


def random(candidates: Candidates) -> int:
    """Any of them (RND in the paper)."""
    return int(candidates.rng.choice(candidates.waiting))


def max_energy(candidates: Candidates) -> int:
    """The one with the most unshot power (ME, Southwell); the first of equals."""
    return strongest(candidates, candidates.waiting)


def strongest(candidates: Candidates, among: np.ndarray) -> int:
    """The one with the most unshot power of the emitters ``among`` (k,); the first of equals."""
    return int(among[np.argmax(candidates.unshot[among])])
