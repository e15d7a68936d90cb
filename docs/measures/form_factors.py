"""Form factors against their closed forms: by the solver's formulas for a point, and by whole solves at fine."""

from __future__ import annotations

import numpy as np

from ...core.options import Options
from ...core.pipeline import solve
from ...core.transport import lambert
from .quadrature import area_of, form_factor, normal_of
from .scenes import scene_of, square, table
from .tables import Table, error, met

SIDES = 1 << 14
"""Corners of a polygon that stands for a disk: its area is 2e-8 less than that of the disk around it, and is made good."""


def measure(quick: bool) -> Table:
    """Worst relative error of every case, over what its own tolerance admits."""
    data = table("exact_answers")
    rows = []
    for case in data["form_factors"]:
        exact = [pair["factor"] for pair in case["pairs"]]
        by_formula = [by_points(pair) for pair in case["pairs"]]
        solved = [by_solve(pair) for pair in case["pairs"][: 2 if quick else None]]
        rows.append(_row(case, worst(by_formula, exact), worst(solved, exact[: len(solved)])))
    for case in data["points"]:
        if "disks" in case:
            exact = [d["factor"] for d in case["disks"]]
            rows.append(_row(case, worst(list(map(_coaxial, case["disks"])), exact), None))
            continue
        exact = [p["factor"] for p in case["points"]]
        found = worst([at_point(p) for p in case["points"]], exact)
        rows.append(_row(case, found, worst([at_point_solved(p) for p in case["points"]], exact)))
    good = sum(row[-1] == "yes" for row in rows)
    return Table(
        "Form factors",
        "Worst relative error over the pairs of a case: by the formulas that the solver uses for a point, summed over the receiver, and "
        "as the mean irradiance that a solve at quality fine finds there. The tolerance is that of the formulas.",
        ["case", "tolerance", "formulas", "a solve at fine", "met"],
        rows,
        [["form factors in closed form, each case within its tolerance", f"{len(rows)} of {len(rows)}", f"{good}", met(good == len(rows))]],
    )


def _row(case: dict, by_formula: float, solved: float | None) -> list[str]:
    solved_text = "" if solved is None else error(solved)
    return [case["name"], f"{case['tolerance']:.0e}", error(by_formula), solved_text, met(by_formula <= case["tolerance"])]


def worst(found: list[float], exact: list[float]) -> float:
    """Largest relative error."""
    return float(np.max(np.abs(np.array(found) / np.array(exact) - 1)))


def by_points(pair: dict) -> float:
    """The factor of a pair by formulas."""
    a, b = ([np.array(p, float) for p in pair[side]] for side in "ab")
    # The larger side is the source: what the smaller one sees of it is the smoother function.
    factor = form_factor(a, b, pair.get("blockers", ()), pair.get("planes", ()))
    if len(a) == len(b) == 1:
        turned = form_factor(b, a, pair.get("blockers", ()), pair.get("planes", ())) * area_of(b[0]) / area_of(a[0])
        factor = turned if area_of(b[0]) < area_of(a[0]) else factor
    return factor


def by_solve(pair: dict) -> float:
    """The factor of a pair from the mean irradiance on b when a shines and nothing reflects but b, once."""
    a, b, between = ([np.array(p, float) for p in pair.get(side, ())] for side in ("a", "b", "blockers"))
    lit = [0.5 if k < len(b) else 0.0 for k in range(len(b) + len(a) + len(between))]
    shine = [1.0 if len(b) <= k < len(b) + len(a) else 0.0 for k in range(len(lit))]
    # A wall that is itself a or b is not in its own way.
    between = [p for p in between if not any(np.array_equal(p, q) for q in (*a, *b))]
    polygons = [*b, *a, *between]
    solution = solve(scene_of(polygons, lit[: len(polygons)], shine[: len(polygons)]), Options(quality="fine", threads=1))
    light = solution.polygon_exitance()[: len(b), 0] / 0.5
    return float(light @ list(map(area_of, b)) / sum(map(area_of, a)))


def at_point(case: dict) -> float:
    """What a point sees of a polygon or a disk, by formula."""
    polygon = _outline(case)
    return float(lambert(np.array([case["point"]]), np.array([case["normal"]], float), polygon[None])[0])


def at_point_solved(case: dict) -> float:
    """The same as the irradiance on a tiny square there."""
    polygon, size = _outline(case, 256), 1e-3
    if (np.array(case["point"]) - polygon[0]) @ normal_of(polygon) < 0:
        polygon = polygon[::-1]
    scene = scene_of([square(case["point"], case["normal"], size), polygon], [0.5, 0.0], [0.0, 1.0])
    solution = solve(scene, Options(quality="fine", threads=1))
    return float(solution.irradiance(np.array([case["point"]]), np.array([0]))[0, 0])


def disk(radius: float, height: float, sides: int) -> np.ndarray:
    """(sides, 3) a polygon of the disk's area about the z axis, that looks down."""
    angle = -2 * np.pi * np.arange(sides) / sides
    radius = radius * np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(sides, height)], axis=1)


def _outline(case: dict, sides: int = SIDES) -> np.ndarray:
    return disk(case["disk"]["radius"], case["disk"]["height"], sides) if "disk" in case else np.array(case["polygon"], float)


def _coaxial(case: dict) -> float:
    """The factor from the first disk to the second: Gauss over its radius."""
    x, w = np.polynomial.legendre.leggauss(40)
    radius, weight = (x + 1) / 2 * case["radius"][0], w / 2
    points = np.stack([radius, 0 * radius, 0 * radius], axis=1)
    source = np.broadcast_to(disk(case["radius"][1], case["height"], SIDES), (len(radius), SIDES, 3))
    factor = lambert(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape), source)
    return float((weight * 2 * radius / case["radius"][0]) @ factor)
