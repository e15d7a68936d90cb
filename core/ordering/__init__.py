"""Which emitter shoots next (section 6 of the paper): its seven strategies by name.

Greedy and Backtrack count what is to be read in polygons (S) or in emitters (C), that is in clusters or cells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .backtrack import backtrack
from .candidates import Candidates, Strategy, max_energy, random
from .greedy import greedy
from .reads import Reads, VisibleSets, visible_sets
from .salesman import traveling_salesman

__all__ = ["STRATEGIES", "Candidates", "Strategy", "VisibleSets", "visible_sets"]


def _by_polygons(sets: VisibleSets) -> Reads:
    return Reads(sets, sets.polygons)


def _by_emitters(sets: VisibleSets) -> Reads:
    return Reads(sets, np.ones(len(sets), np.int64))


STRATEGIES: dict[str, Callable[[VisibleSets], Strategy]] = {
    "random": lambda sets: random,
    "max_energy": lambda sets: max_energy,
    "greedy_s": lambda sets: greedy(_by_polygons(sets)),
    "greedy_c": lambda sets: greedy(_by_emitters(sets)),
    "backtrack_s": lambda sets: backtrack(_by_polygons(sets)),
    "backtrack_c": lambda sets: backtrack(_by_emitters(sets)),
    "traveling_salesman": traveling_salesman,
}
"""Each prepares a strategy for the potentially visible sets of the emitters, once, before the first shot."""
