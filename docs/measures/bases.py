"""The bases M1, M2 and M3 side by side: error at equal time and at equal memory."""

from __future__ import annotations

import numpy as np

from ...core.options import Options, describe
from ..processes import run_module
from .errors import percent
from .tables import Table, met
from .witness import WAYS

STEPS = (0.0, 0.5, 1.0, 1.5, 2.0)
"""Qualities to sweep: 0 draft, 1 good, 2 fine; tolerances between two of them are their geometric mean."""
ORDERS = (1, 2, 3)
GRID = 5
"""Times, and sizes, at which the bases are compared: evenly over the logarithms that all three reach."""

TEXT = """\
Relative RMSE at equal CPU seconds and at equal memory, read off curves through five qualities from draft to fine, tolerances in
geometric steps: with the reflected light gathered by rays from the elements, and with that of the elements themselves, where
the basis speaks alone. Over all rows, the error over that of the best basis of the row is"""


def measure(quick: bool) -> Table:
    """Sweeps of every basis on the bench scenes, and errors read off their curves at equal time and at equal memory."""
    scenes, steps = (("cornell",), STEPS[:3]) if quick else (("cornell", "two_rooms", "office"), STEPS)
    default = next(info.default for info in describe(Options) if info.name == "order")
    rows, ranks = [], {order: [] for order in ORDERS}
    for name in scenes:
        runs = {order: [run_module("enfilade.docs.measures.bases_run", name, order, step) for step in steps] for order in ORDERS}
        for way in WAYS:
            for unit in ("s", "MB"):
                curves = {order: [_point(r, way, unit) for r in runs[order]] for order in ORDERS}
                low = max(min(c[0] for c in curve) for curve in curves.values())
                high = min(max(c[0] for c in curve) for curve in curves.values())
                for at in np.geomspace(low, high, GRID) if high > low else [low]:
                    errors = [error_at(curves[order], at) for order in ORDERS]
                    for order, found in zip(ORDERS, errors, strict=True):
                        ranks[order].append(found / min(errors))
                    lit = curves[1][0][2] is None
                    dark = [None if lit else error_at([(c[0], c[2]) for c in curves[order]], at) for order in ORDERS]
                    rows.append([name, way, f"{at:.3g} {unit}", *map(percent, errors), *map(percent, dark)])
    mean = {order: float(np.exp(np.mean(np.log(r)))) for order, r in ranks.items()}
    best = min(mean, key=mean.get)
    head = [
        "scene",
        "reflected light",
        "CPU seconds, or memory of elements and links",
        *(f"M{o}" for o in ORDERS),
        *(f"M{o}, no lamp" for o in ORDERS),
    ]
    ratios = ", ".join(f"{mean[order]:.2f} for M{order}" for order in ORDERS)
    verdict = "and is the default" if best == default else f"the default is M{default}"
    text = f"{TEXT} {ratios} (geometric means): M{best} is best, {verdict}."
    lines = [["default basis is the best of M1, M2, M3 at equal time and memory", f"M{best}", f"M{default}", met(best == default)]]
    return Table("Bases", text, head, rows, lines)


def _point(run: dict, way: str, unit: str) -> tuple[float, float, float | None]:
    """CPU seconds or MB, and errors over all points and in rooms with no lamp."""
    found = run["ways"][way]
    return found["cpu_seconds"] if unit == "s" else run["light_bytes"] / 1e6, found["score"]["rmse"], found["score"]["dark_rmse"]


def error_at(curve: list[tuple], cost: float) -> float:
    """The least error that a curve of (cost, error, ..) reaches by ``cost``, on straight lines of logarithms."""
    points = sorted(curve)
    x, y = np.log([p[0] for p in points]), np.minimum.accumulate(np.log([p[1] for p in points]))
    return float(np.exp(np.interp(np.log(cost), x, y)))
