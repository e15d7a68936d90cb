"""Whole solutions against exact ones: by solves at fine, and by the solver's formulas where one constant stands for each surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.options import Options
from ...core.pipeline import solve
from ...core.solution import Solution
from .form_factors import disk
from .quadrature import area_of, form_factor, normal_of
from .scenes import scene_of, table
from .tables import Table, error, met

FINE = Options(quality="fine", reflected="elements")
"""Without furniture the light of the elements is smoother than that of rays."""
GOOD = Options(quality="good", reflected="elements")
LONG = 100.0
"""Length of what is endless, over its width."""


def measure(quick: bool) -> Table:
    """Worst error of every case over what its tolerance admits."""
    data = table("exact_answers")
    rows = []
    for case in data["solutions"]:
        if case["kind"] == "constants":
            rows.append(_row(case, "formulas, one constant each", *_worst(case, _constants(case, data), case["expected"])))
        else:
            rows.append(_row(case, "a solve at fine", *_worst(case, *_continuous(case))))
    for case in data["shapes"]:
        if not quick or case["kind"] in ("plates", "polynomials"):
            how = {"polynomials": "formulas", "sphere": "a solve at good"}.get(case["kind"], "a solve at fine")
            rows.append(_row(case, how, *_worst(case, *_SHAPES[case["kind"]](case))))
    good = sum(row[-1] == "yes" for row in rows)
    return Table(
        "Whole solutions",
        "Worst relative error over the values of a case. Where one constant stands for each surface the answer is that of a small"
        " system of equations, "
        "made here from the form factors above; elsewhere it is the light of the elements of a solve at quality fine.",
        ["case", "by", "tolerance", "worst relative error", "met"],
        rows,
        [["radiosities in closed form, each case within its tolerance", f"{len(rows)} of {len(rows)}", f"{good}", met(good == len(rows))]],
    )


def _row(case: dict, how: str, worst: float, within: bool) -> list[str]:
    return [case["name"], how, f"{case['tolerance']:.0e}", error(worst), met(within)]


def _worst(case: dict, found, exact) -> tuple[float, bool]:
    """Largest relative error, and whether all are within the tolerance."""
    found, exact = np.asarray(found, float), np.asarray(exact, float)
    difference = np.abs(found - exact)
    within = (difference <= case["tolerance"] * np.abs(exact) + case.get("absolute", 0)).all()
    return float((difference / np.abs(exact)).max()), bool(within)


def _constants(case: dict, data: dict) -> np.ndarray:
    """(n,) radiosities with one constant on every surface."""
    surfaces = case["surfaces"]
    reflectance, emission = (np.array([s[name] for s in surfaces], float) for name in ("reflectance", "emission"))
    if "factors" in case:
        factors = _factors_of_room(next(c for c in data["form_factors"] if c["name"] == case["factors"]), len(surfaces))
    else:
        polygons = [np.array(s["corners"], float) for s in surfaces]
        factors = factor_matrix(polygons, [polygons[k] for k in case.get("blockers", ())])
    return np.linalg.solve(np.eye(len(surfaces)) - reflectance[:, None] * factors, emission)


def factor_matrix(polygons: list[np.ndarray], blockers: list[np.ndarray]) -> np.ndarray:
    """(n, n) form factors from every polygon to every other."""
    count, nodes = len(polygons), 16 if len(blockers) else 40
    area = [area_of(p) for p in polygons]
    factors = np.zeros((count, count))
    for i in range(count):
        for j in range(i):
            if _apart(polygons[i], polygons[j]):
                power = area[i] * form_factor([polygons[i]], [polygons[j]], blockers, count=nodes)
                factors[i, j], factors[j, i] = power / area[i], power / area[j]
    return factors


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    """Some part of each polygon lies in front of the other's plane."""
    return bool(((b - a[0]) @ normal_of(a)).max() > 1e-9 and ((a - b[0]) @ normal_of(b)).max() > 1e-9)


def _factors_of_room(case: dict, count: int) -> np.ndarray:
    """The matrix of a room whose pairs are those of a case of form factors, in which every part is first named by its own row."""
    from .form_factors import by_points

    parts: list = []
    for pair in case["pairs"]:
        if pair["a"] not in parts:
            parts.append(pair["a"])
    factors = np.zeros((count, count))
    for pair in case["pairs"]:
        factors[parts.index(pair["a"]), parts.index(pair["b"])] = by_points(pair)
    return factors


def _solved(polygons: list, reflectance, emission) -> tuple[Solution, Callable]:
    """A solve at fine, and radiosity (n,) at points (n, 3) of a surface."""
    solution = solve(scene_of(polygons, reflectance, emission), FINE)
    return solution, lambda surface, points: solution.exitance(np.array(points, float), np.full(len(points), surface))[:, 0]


def _continuous(case: dict) -> tuple[list, list]:
    """Means and values at points of a case whose surfaces are those of the scene."""
    surfaces = case["surfaces"]
    polygons = [np.array(s["corners"], float) for s in surfaces]
    solution, at = _solved(polygons, [s["reflectance"] for s in surfaces], [s["emission"] for s in surfaces])
    mean = solution.polygon_exitance()[:, 0]
    found, exact = [], []
    for value in case["expected"]:
        k = value["surface"]
        if "mean" in value:
            found.append(mean[k])
            exact.append(value["mean"])
        else:
            found.append(at(k, [value.get("at", polygons[k].mean(0))])[0])
            exact.append(value.get("value", value.get("centre")))
    return found, exact


def _rectangle(origin, a, b) -> np.ndarray:
    o, a, b = (np.asarray(x, float) for x in (origin, a, b))
    return np.stack([o, o + a, o + a + b, o + b])


def _facing(a: float, b: float, gap: float) -> list[np.ndarray]:
    """Two rectangles a x b about the z axis, one over the other."""
    return [_rectangle((-a / 2, -b / 2, 0), (a, 0, 0), (0, b, 0)), _rectangle((-a / 2, -b / 2, gap), (0, b, 0), (a, 0, 0))]


def _sphere(case: dict) -> tuple[list, list]:
    triangles = _icosphere(2)
    # Half of the sphere, by a plane that no triangle is halved by.
    bright = triangles.mean(1) @ [0.3, 0.5, 0.8] > 0
    solution = solve(scene_of(list(triangles), case["reflectance"], bright.astype(float)), GOOD)
    mean = solution.polygon_exitance()[:, 0]
    exact = np.where(bright, case["expected"]["bright"], case["expected"]["dark"])
    return mean, exact


def _icosphere(rounds: int) -> np.ndarray:
    """(20 * 4**rounds, 3, 3) triangles on the unit sphere that look inwards."""
    g = (1 + 5**0.5) / 2
    corner = np.array([[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g], [0, -1, -g], [0, 1, -g],
                       [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]])  # fmt: skip
    face = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
            [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]  # fmt: skip
    triangles = corner[np.array(face)] / np.linalg.norm(corner[0])
    for _ in range(rounds):
        a, b, c = triangles.transpose(1, 0, 2)
        ab, bc, ca = ((p + q) / np.linalg.norm(p + q, axis=1, keepdims=True) for p, q in ((a, b), (b, c), (c, a)))
        triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return triangles[:, ::-1]


def _plates(case: dict) -> tuple[list, list]:
    _, at = _solved(_facing(LONG, LONG, 1.0), case["reflectance"], case["emission"])
    return [at(0, [[0, 0, 0]])[0], at(1, [[0, 0, 1.0]])[0]], case["expected"]


def _strips(case: dict) -> tuple[list, list]:
    width, gap = case["width"], case["gap"]
    _, at = _solved(_facing(width, LONG * width, gap), case["reflectance"], case["emission"])
    values = [(k, v) for k in (0, 1) for v in case["expected"][k]]
    return [at(k, [[v["x"] - width / 2, 0, k * gap]])[0] for k, v in values], [v["value"] for _, v in values]


def _disks(case: dict) -> tuple[list, list]:
    top = disk(case["radius"], case["gap"], 64)
    bottom = top[::-1] * [1, 1, 0]
    _, at = _solved([bottom, top], case["reflectance"], case["emission"])
    inside = np.cos(np.pi / 64)  # the rim of the disk lies between the corners of the polygon
    values = [(k, v) for k in (0, 1) for v in case["expected"][k]]
    return [at(k, [[v["r"] * inside, 0, k * case["gap"]]])[0] for k, v in values], [v["value"] for _, v in values]


def _groove(case: dict) -> tuple[list, list]:
    plates = [_rectangle((0, -LONG / 2, 0), (1, 0, 0), (0, LONG, 0)), _rectangle((0, -LONG / 2, 0), (0, LONG, 0), (0, 0, 1))]
    _, at = _solved(plates, case["reflectance"], case["emission"])
    values = case["expected"]
    return [at(k, [[v["x"], 0, 0] if k == 0 else [0, 0, v["x"]]])[0] for k in (0, 1) for v in values], [v["value"] for v in values] * 2


def _patches(case: dict) -> tuple[list, list]:
    polygons, emission, reflectance, exact = [], [], [], []
    for face, (s0, s1, t0, t1), shine in case["patches"]:
        axis, side = "xyz".index(face[0]), face[1]
        i, j = (k for k in range(3) if k != axis)
        corner = np.zeros((4, 3))
        corner[:, axis] = case["dims"][axis] if side == "+" else 0.0
        corner[:, i], corner[:, j] = [s0, s1, s1, s0], [t0, t0, t1, t1]
        inward = np.array(case["dims"]) / 2 - corner.mean(0)
        polygons.append(corner if normal_of(corner) @ inward > 0 else corner[::-1])
        emission.append(shine)
        reflectance.append(case["reflectance"][face])
        exact.append(case["expected"][face])
    return solve(scene_of(polygons, reflectance, emission), FINE).polygon_exitance()[:, 0], exact


def _cells(case: dict) -> tuple[list, list]:
    n, polygons = case["count"], []
    for k in (0, 1):
        for i in range(n):
            for j in range(n):
                cell = _rectangle((i / n, j / n, k), (1 / n, 0, 0), (0, 1 / n, 0))
                polygons.append(cell[::-1] if k else cell)
    solution = solve(scene_of(polygons, case["reflectance"], np.concatenate(case["emission"])), FINE)
    return solution.polygon_exitance()[:, 0], np.concatenate(case["expected"])


def _polynomials(case: dict) -> tuple[list, list]:
    """Radiosity M + rho E at points of two plates with a common edge, E from the exact polynomial on the other plate."""
    found = []
    for point in case["points"]:
        place, other = (point["s"], point["y"]), 3 - point["plate"]
        p = np.array([place[0], place[1], 0]) if point["plate"] == 1 else np.array([0, place[1], place[0]])
        # Cells of the other plate, the finer the nearer to the point, each as bright as its polynomial is in the middle.
        cells = _graded_cells(place[1], place[0])
        s, y = cells[:, 0].mean(1), cells[:, 1].mean(1)
        bright = sum(c * s ** int(k[0]) * y ** int(k[2]) for k, c in case[f"c{other}"].items())
        corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        along = np.stack([cells[:, 0][:, corner[:, 0]], cells[:, 1][:, corner[:, 1]], np.zeros((len(cells), 4))], axis=2)
        outline = along if other == 1 else along[..., [2, 1, 0]]
        normal = np.array([0, 0, 1.0]) if point["plate"] == 1 else np.array([1.0, 0, 0])
        seen = _lambert(p, normal, outline)
        found.append(point["M"] + case["reflectance"] * float(bright @ seen))
    return found, case["expected"]


def _graded_cells(y: float, distance: float) -> np.ndarray:
    """(n, 2, 2) rectangles (s from, to; y from, to) of the unit square, smaller towards the place (0, y)."""
    steps = np.concatenate([[0], np.geomspace(min(distance, 0.1) / 50, 1, 80)])
    left, right = y - steps * y, y + steps * (1 - y)
    ys = np.unique(np.concatenate([left, right]))
    s = np.stack([steps[:-1], steps[1:]], 1)
    t = np.stack([ys[:-1], ys[1:]], 1)
    return np.stack([np.repeat(s, len(t), 0), np.tile(t, (len(s), 1))], axis=1)


def _lambert(p: np.ndarray, normal: np.ndarray, outlines: np.ndarray) -> np.ndarray:
    from ...core.transport import lambert

    count = len(outlines)
    return lambert(np.broadcast_to(p, (count, 3)), np.broadcast_to(normal, (count, 3)), outlines)


_SHAPES = {
    "sphere": _sphere,
    "plates": _plates,
    "strips": _strips,
    "disks": _disks,
    "groove": _groove,
    "patches": _patches,
    "cells": _cells,
    "polynomials": _polynomials,
}
