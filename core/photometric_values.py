"""Checks of the numbers of luminaire files, which all formats share."""

from __future__ import annotations

import math

import numpy as np

from .scene import SceneError

MOST_CANDELA = 1e12
"""Far above any searchlight: what is beyond is a mistake, and its square must not overflow."""

NEAR = 1e-3
"""Degrees within which the first and the last angle of a file are the multiple of 90 that they stand for."""

NEW_FILE = "get the file anew from the manufacturer"
"""The remedy where a file is damaged."""


def number(text: str) -> float:
    """The finite number that a text is. Raises ValueError when it is none."""
    value = float(text)
    if not math.isfinite(value) or "_" in text:
        raise ValueError(text)
    return value


def rising(where: str, what: str, angle: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n,) angles of a file, degrees, the first and the last of them rounded to a multiple of 90 that is near.

    Raises SceneError unless they rise and stay in their range; ``where`` is the file and the line.
    """
    angle = np.array(angle, np.float64)
    if np.min(angle) < low - NEAR or np.max(angle) > high + NEAR:
        run = f"run from {np.min(angle):g} to {np.max(angle):g} degrees"
        raise SceneError(f"{where}: the {what} {run} where {low:g} to {high:g} are possible, {NEW_FILE}")
    for end in (0, -1):
        round_angle = 90.0 * np.round(angle[end] / 90.0)
        if abs(angle[end] - round_angle) <= NEAR:
            angle[end] = round_angle
    if not np.all(np.diff(angle) > 0):
        raise SceneError(f"{where}: the {what} do not rise, put them in order or {NEW_FILE}")
    return angle


def check_candela(where: str, candela: np.ndarray) -> None:
    """Raise SceneError unless all intensities, cd with all factors, are possible ones; ``where`` is the file and the line."""
    if not np.all(candela >= 0):
        raise SceneError(f"{where}: an intensity is negative, set it to 0 or {NEW_FILE}")
    if not np.all(candela <= MOST_CANDELA):
        raise SceneError(f"{where}: an intensity is above {MOST_CANDELA:g} cd, set the factors of the file right")
