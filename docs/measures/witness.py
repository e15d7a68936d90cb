"""What lies inside a solve, for measures that ask for more than its report: links, tolerances, the time of an inner loop.

The solver has no doors for this, and needs none: what it calls is watched, or handed other numbers, while one solve runs here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np

from ...core import pair_visibility, pipeline
from ...core.building import Building
from ...core.elements import Forest
from ...core.links import Gains, LinkSet
from ...core.options import Options
from ...core.quality import Tolerances
from ...core.regions import Regions
from ...core.scene import EvaluationPoints, Scene
from ...core.solution import Solution


@dataclass(frozen=True)
class Solved:
    """A solution with the links of its elements and the gains that close them."""

    solution: Solution
    building: Building
    forest: Forest
    links: list[LinkSet]
    gains: Gains


def solve_and_keep(scene: Scene, options: Options) -> Solved:
    """Solve a scene and keep what the light went over."""
    kept = {}
    gains_of, sources_of = pipeline.links.closing_gains, pipeline.light_sources

    def closing_gains(forest, links, *rest):
        kept.update(forest=forest, links=links, gains=gains_of(forest, links, *rest))
        return kept["gains"]

    def light_sources(building, *rest):
        kept["building"] = building
        return sources_of(building, *rest)

    with patch.object(pipeline.links, "closing_gains", closing_gains), patch.object(pipeline, "light_sources", light_sources):
        return Solved(pipeline.solve(scene, options), **kept)


WAYS = ("gathered", "elements")
"""Ways from a solution to the reflected light at a point, as the option ``reflected`` names them."""


def light_of(solution: Solution, points: EvaluationPoints, way: str) -> np.ndarray:
    """(N, 3) irradiance at points by either way, from a solution that was made for the first."""
    rays = solution._rays
    solution._rays = 0 if way == "elements" else rays
    try:
        return solution.irradiance(points.position, points.polygon)
    finally:
        solution._rays = rays


@contextmanager
def tolerances(change: Callable[[Tolerances, Regions], Tolerances]) -> Iterator[None]:
    """Solves in this block take the tolerances of their quality as ``change`` leaves them."""
    usual = pipeline.quality.tolerances
    with patch.object(pipeline.quality, "tolerances", lambda options, regions: change(usual(options, regions), regions)):
        yield


@dataclass
class Timed:
    """Calls of the segment test: shapes (pairs, nodes on either side) of each, tests asked for, seconds of all."""

    shapes: list[tuple[int, int, int]] = field(default_factory=list)
    tests: int = 0
    seconds: float = 0.0


@contextmanager
def segment_tests() -> Iterator[Timed]:
    """Counts and times the segment tests of solves in this block; they must run in this process (threads=1)."""
    timed, usual = Timed(), pair_visibility.cut_segments

    def cut_segments(blockers, pair, blocker, a, b):
        started = time.process_time()
        cuts = usual(blockers, pair, blocker, a, b)
        timed.seconds += time.process_time() - started
        timed.shapes.append((len(pair), a.shape[1], b.shape[1]))
        timed.tests += len(pair) * a.shape[1] * b.shape[1]
        return cuts

    with patch.object(pair_visibility, "cut_segments", cut_segments):
        yield timed
