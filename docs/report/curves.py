"""Time against error: medians of runs as points of curves, and the time at which a curve reaches an error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from .plan import WAYS, Setting
from .results import Results

FALL = 0.35
"""Exponent of time with which an error falls that is mostly noise; pure noise falls with 0.5."""


@dataclass(frozen=True)
class Point:
    """Medians of the runs of one setting; ``label`` says which, ``score`` is that of :meth:`enfilade.docs.bench.Bench.score`."""

    label: str
    runs: int
    seconds: float
    cpu_seconds: float
    peak_bytes: float
    score: dict
    last: dict


@dataclass(frozen=True)
class Reached:
    """Seconds to an error, and how they are known: ``between`` two points, ``within`` the fastest one, ``beyond`` the best one."""

    seconds: float
    how: str


def curves(results: Results, plan: list[Setting], scene: str) -> dict[str, list[Point]]:
    """Of one scene the points of Enfilade and of each way of Cycles, for settings that have run."""
    out: dict[str, list[Point]] = {}
    for setting in plan:
        runs = results.of(setting) if setting.scene == scene else []
        if not runs:
            continue
        if setting.tool == "enfilade":
            out.setdefault("Enfilade", []).append(_point(setting.quality, runs))
            continue
        label = f"{setting.samples} samples"
        out.setdefault(f"Cycles, {WAYS[setting.way]}", []).append(_point(label, runs))
        if "denoised" in runs[0]:
            smoothed = [r | r["denoised"] for r in runs]
            out.setdefault(f"Cycles, {WAYS['denoised']}", []).append(_point(label, smoothed))
    return out


def _point(label: str, runs: list[dict]) -> Point:
    middle = {name: median(r[name] for r in runs) for name in ("seconds", "cpu_seconds", "peak_bytes")}
    score = {k: None if v is None else median(r["score"][k] for r in runs) for k, v in runs[0]["score"].items()}
    return Point(label, len(runs), **middle, score=score, last=runs[-1])


def time_to(points: list[Point], level: float, error: str, noisy: bool) -> Reached | None:
    """When a curve first has an error of at most ``level``; None when it does not get there.

    error : ``rmse`` or ``dark_rmse``;  noisy : beyond the best point the error goes on to fall with the root of the time, if it still did
    between the last two points: what is not noise stays
    """
    found = sorted((p.seconds, p.score[error]) for p in points)
    if found[0][1] <= level:
        return Reached(found[0][0], "within")
    for (t0, e0), (t1, e1) in pairwise(found):
        if e1 <= level < e0:
            share = np.log(e0 / level) / np.log(e0 / e1)
            return Reached(float(t0 * (t1 / t0) ** share), "between")
    if not noisy:
        return None
    seconds, best = found[-1]
    if len(found) > 1 and np.log(found[-2][1] / best) < FALL * np.log(seconds / found[-2][0]):
        return None
    return Reached(seconds * (best / level) ** 2, "beyond")


def best_of(curves_: dict[str, list[Point]], level: float, error: str) -> tuple[str, Reached] | None:
    """The way of Cycles that reaches an error first."""
    reached = {}
    for name, points in curves_.items():
        if name != "Enfilade" and (time := time_to(points, level, error, noisy=name.endswith(WAYS["points"]))):
            reached[name] = time
    return min(reached.items(), key=lambda item: item[1].seconds) if reached else None
