"""Reader of EULUMDAT photometric files (A. Stockmar, 1990): one value on every line, in a fixed order."""

from __future__ import annotations

import numpy as np

from .luminaires import Luminaire
from .luminous_intensity import POLE_DOWN, Distribution, closed, mirrored
from .photometric_values import NEW_FILE, check_candela, number, rising
from .scene import SceneError

ROUND, PLANE_0, PLANE_90, BOTH = 1, 2, 3, 4
"""Symmetry indicators: about the vertical axis, to plane C0-C180, to plane C90-C270, to both; 0 is none."""

LAMP_LINES = 6
"""Lines of a set of lamps: number, type, flux, colour, colour rendering, watts."""

DIRECT_RATIOS = 10


def parse_eulumdat(name: str, content: list[str]) -> Luminaire:
    """The luminaire of the lines of an EULUMDAT file, with its first set of lamps; ``name`` is the file in messages.

    Intensities are those of the file (cd per 1000 lm) times its conversion factor and the flux of the lamps; where the
    number of lamps is negative (absolute photometry) the file gives the flux of the luminaire in its place. C0 is along x,
    across the luminaire; C90 is along y, along it.

    Raises SceneError with one sentence that names the file, the line and the remedy.
    """
    lines = _Lines(name, content)
    symmetry = lines.whole(3, "symmetry indicator", 0, 4)
    plane_count = lines.whole(4, "number of C-planes", 1)
    angle_count = lines.whole(6, "number of intensities in a C-plane", 2)
    planes = _planes(lines, symmetry, plane_count)
    size = np.abs([lines.number(n, "size of the luminous area") for n in (17, 16, 18)]) / 1000
    if size[0] == 0:
        size[0] = size[1]
    conversion = lines.number(24, "conversion factor")
    sets = lines.whole(26, "number of sets of lamps", 1)
    flux = lines.number(29, "luminous flux of the lamps")
    watts = lines.number(32, "watts")

    at = 27 + LAMP_LINES * sets + DIRECT_RATIOS
    # Before anything is set aside for the table: it has one line for every value.
    needed = at - 1 + plane_count + angle_count + len(planes) * angle_count
    if needed > len(lines):
        raise SceneError(f"{name}, line {len(lines)}: the file ends here although its header announces {needed} lines, {NEW_FILE}")
    plane = lines.numbers(at, plane_count, "angles of the C-planes")
    angle = lines.numbers(at + plane_count, angle_count, "angles gamma")
    table = at + plane_count + angle_count
    candela = lines.numbers(table, len(planes) * angle_count, "intensities").reshape(len(planes), angle_count)
    if not (0 < conversion <= 1e6 and 0 < flux <= 1e12):
        raise SceneError(f"{name}, line 24 or 29: conversion factor {conversion:g} or flux {flux:g} lm is out of range, set it right")
    with np.errstate(over="ignore"):
        candela = candela * (conversion * flux / 1000)
    check_candela(f"{name}, lines {table} to {needed}", candela)
    where = f"{name}, line {at + plane_count}"
    angle = rising(where, "angles gamma", angle, 0.0, 180.0)
    if angle[0] not in (0, 90):
        raise SceneError(f"{where}: the angles gamma begin at {angle[0]:g} where 0 or 90 degrees are due, {NEW_FILE}")
    azimuth, candela = _expanded(f"{name}, line {at}", symmetry, plane[planes], candela)
    distribution = Distribution(azimuth, angle, candela, POLE_DOWN)
    return Luminaire(lines.text(9), distribution, size, watts, np.zeros(0), np.zeros(0))


class _Lines:
    """The lines of a file by their number, from 1."""

    def __init__(self, name: str, content: list[str]) -> None:
        self._name, self._lines = name, content

    def __len__(self) -> int:
        return len(self._lines)

    def where(self, line: int) -> str:
        return f"{self._name}, line {line}"

    def text(self, line: int) -> str:
        return self._lines[line - 1].strip()

    def number(self, line: int, what: str) -> float:
        return float(self.numbers(line, 1, what)[0])

    def numbers(self, first: int, count: int, what: str) -> np.ndarray:
        """(count,) float64, the numbers of as many lines."""
        if first - 1 + count > len(self):
            raise SceneError(f"{self.where(len(self))}: the file ends before the {what}, {NEW_FILE}")
        out = np.empty(count)
        for k, line in enumerate(self._lines[first - 1 : first - 1 + count]):
            try:
                out[k] = number(line.replace(",", "."))
            except ValueError:
                raise SceneError(
                    f"{self.where(first + k)}: {line.strip()[:20]!r} is no number but stands for the {what}, {NEW_FILE}"
                ) from None
        return out

    def whole(self, line: int, what: str, least: int, most: int | None = None) -> int:
        value = self.number(line, what)
        if value != int(value) or value < least or (most is not None and value > most):
            due = f"at least {least}" if most is None else f"{least} to {most}"
            raise SceneError(f"{self.where(line)}: the {what} is {value:g} where a whole number of {due} is due, {NEW_FILE}")
        if value > len(self):
            raise SceneError(f"{self.where(line)}: the {what} is {value:.15g}, more than the file has lines, {NEW_FILE}")
        return int(value)


def _planes(lines: _Lines, symmetry: int, count: int) -> np.ndarray:
    """Which of ``count`` C-planes the table of intensities holds."""
    if symmetry == ROUND:
        return np.arange(1)
    parts = {PLANE_0: 2, PLANE_90: 4, BOTH: 4}.get(symmetry, 1)
    if count % parts:
        raise SceneError(f"{lines.where(4)}: {count} C-planes cannot have the symmetry {symmetry} of line 3, {NEW_FILE}")
    if symmetry == PLANE_90:
        return np.arange(3 * count // 4, 3 * count // 4 + count // 2 + 1) % count
    return np.arange({PLANE_0: count // 2 + 1, BOTH: count // 4 + 1}.get(symmetry, count))


def _expanded(where: str, symmetry: int, azimuth: np.ndarray, candela: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths over a whole turn and their intensities, from the half-planes in the file."""
    if len(azimuth) == 1:
        return np.array([0.0, 360.0]), np.concatenate((candela, candela))
    if symmetry == PLANE_90:
        azimuth = np.where(azimuth >= 180, azimuth - 360, azimuth)
    azimuth = rising(where, "angles of the C-planes", azimuth, -90.0, 360.0)
    ends = {PLANE_0: (0, 180), PLANE_90: (-90, 90), BOTH: (0, 90)}.get(symmetry, (0, azimuth[-1]))
    if (azimuth[0], azimuth[-1]) != ends:
        raise SceneError(f"{where}: the angles of the C-planes do not fit the symmetry {symmetry} of line 3, {NEW_FILE}")
    if symmetry == BOTH:
        return mirrored(*mirrored(azimuth, candela))
    return mirrored(azimuth, candela) if symmetry else closed(azimuth, candela)
