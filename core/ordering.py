"""Which emitter shoots next (paper, section 6): one small function for each strategy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass
class Candidates:
    """What a strategy may look at.

    waiting : (n,) int64 emitters that have not shot in this iteration, rising, one at least
    unshot : (units,) float64 power that each emitter has not shot yet, W
    rng : random generator of the run
    """

    waiting: np.ndarray
    unshot: np.ndarray
    rng: np.random.Generator


Strategy = Callable[[Candidates], int]


def random(candidates: Candidates) -> int:
    """Any of them (RND)."""
    return int(candidates.rng.choice(candidates.waiting))


def max_energy(candidates: Candidates) -> int:
    """The one with the most unshot power (ME, Southwell); the first of equals."""
    return int(candidates.waiting[np.argmax(candidates.unshot[candidates.waiting])])


STRATEGIES: dict[str, Strategy] = {"random": random, "max_energy": max_energy}
