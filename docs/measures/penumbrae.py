"""Partial shadows against exact irradiance behind blockers, as a bake at fine finds it."""

from __future__ import annotations

import numpy as np

from ...core.options import Options
from ...core.pipeline import solve
from ...core.transport import lambert
from .quadrature import normal_of
from .scenes import scene_of, square, table
from .tables import Table, met

SIZE = 1e-3
"""Metres, side of the surface around each point: one scene for each, so that no point's surface stands before another point."""


def measure(quick: bool) -> Table:
    """Mean and worst error of every case, in parts of the unshadowed irradiance of each point."""
    cases = table("penumbrae")["cases"][: 2 if quick else None]
    rows, every = [], []
    for case in cases:
        errors = [_error(case, point) for point in case["points"]]
        every += errors
        rows.append([case["name"], str(len(errors)), f"{np.mean(errors):.1e}", f"{np.max(errors):.1e}"])
    mean = float(np.mean(every))
    return Table(
        "Partial shadows",
        "Points in penumbrae, contact shadows, behind doors and slanted openings: difference to the exact irradiance over what the point "
        "would receive if nothing stood between.",
        ["case", "points", "mean error", "worst"],
        rows,
        [["penumbrae at fine, mean error over the unshadowed value", "2e-2", f"{mean:.1e}", met(mean < 0.02)]],
    )


def _error(case: dict, point: dict) -> float:
    lamp = np.array(case["lamp"], float)
    at, normal = np.array(point["at"], float), np.array(point["normal"], float)
    # The tables list the corners of a lamp either way round: it shines towards its points.
    if (at - lamp[0]) @ normal_of(lamp) < 0:
        lamp = lamp[::-1]
    blockers = [np.array(b, float) for b in case["blockers"]]
    scene = scene_of([square(at, normal, SIZE), lamp, *blockers], 0.0, [0.0, case["exitance"]] + [0.0] * len(blockers))
    light = float(solve(scene, Options(quality="fine", threads=1)).irradiance(at[None], np.array([0]))[0, 0])
    unshadowed = case["exitance"] * float(lambert(at[None], normal[None], lamp[None])[0])
    return abs(light - point["irradiance"]) / unshadowed
