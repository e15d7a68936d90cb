"""Greedy S and Greedy C (paper, section 6): whatever needs least to be read from disk is next."""

from __future__ import annotations

from .candidates import Candidates, Strategy, strongest
from .reads import Reads


def greedy(reads: Reads) -> Strategy:
    """The emitter for which least is read; of equals, the one with the most unshot power."""

    def choose(candidates: Candidates) -> int:
        cost = reads.after(candidates.last)[candidates.waiting]
        return strongest(candidates, candidates.waiting[cost == cost.min()])

    return choose
