"""Are the lamps of a scene fit to shine? What is wrong is refused by name, what does nothing is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .lamps import Lamps
from .scene import OUTSIDE, SceneError

MIN_AREA = 1e-14
"""Area lamps of no more than this, m2, are refused: their power has nowhere to come from."""


def checked_lamps(lamps: Lamps, rooms: int) -> tuple[Lamps, tuple[str, ...]]:
    """The lamps with negative light taken as none, and sentences about that.

    Raises :class:`SceneError` with one sentence for lamps whose place, size or light is no number, or in a room that does not exist.
    """
    said: list[str] = []
    area, points, suns, sky = lamps.area, lamps.points, lamps.suns, lamps.sky
    owner = np.repeat(np.arange(len(area)), np.diff(area.start))
    broken = np.zeros(len(area), bool)
    broken[owner[~np.isfinite(area.vertices).all(1)]] = True
    _refuse(area.names, broken | ~np.isfinite(area.spread), "has a place or size that is not a finite number; repair its transform")
    _refuse(area.names, _areas(area.vertices, area.start) <= MIN_AREA, "has no area; give it a size and a scale above 0")
    _refuse(area.names, (area.spread <= 0) | (area.spread > np.pi + 1e-6), "has a spread that is not between 0 and 180 degrees")
    place = np.concatenate([points.position, points.frame.reshape(-1, 9), points.radius[:, None], points.cone[:, None]], axis=1)
    _refuse(points.names, ~np.isfinite(place).all(1), "has a place or size that is not a finite number; repair its transform")
    _refuse(points.names, points.radius < 0, "has a radius below 0; set it to 0 or more")
    _refuse(suns.names, ~np.isfinite(suns.toward).all(1) | ~suns.toward.any(1), "shines in no direction; repair its transform")
    for kind in (area, points):
        _refuse(kind.names, (kind.room < OUTSIDE) | (kind.room >= rooms), "hangs in a room that does not exist")
    arrays = {"area": (area, "exitance"), "points": (points, "intensity"), "suns": (suns, "irradiance")}
    for name, (kind, field) in arrays.items():
        light = getattr(kind, field)
        _refuse(kind.names, ~np.isfinite(light).all(1), "shines with a power that is not a finite number; set it anew")
        below = (light < 0).any(1)
        if below.any():
            said.append(f"{_named(kind.names, below)} a power or colour below 0, taken as 0")
            lamps = replace(lamps, **{name: replace(kind, **{field: np.maximum(light, 0)})})
    if sky is not None:
        if not np.isfinite(sky.radiance).all():
            raise SceneError(f"the sky '{sky.name}' has a brightness that is not a finite number; choose another image or strength")
        if (sky.radiance < 0).any():
            said.append(f"the sky '{sky.name}' has a brightness below 0, taken as 0")
            lamps = replace(lamps, sky=replace(sky, radiance=np.maximum(sky.radiance, 0)))
    return lamps, tuple(said)


def shines(lamps: Lamps) -> bool:
    """Does any lamp, sun or sky give light?"""
    sky = lamps.sky is not None and bool((lamps.sky.radiance > 0).any())
    return sky or any(bool((x > 0).any()) for x in (lamps.area.exitance, lamps.points.intensity, lamps.suns.irradiance))


def _areas(vertices: np.ndarray, start: np.ndarray) -> np.ndarray:
    count = len(start) - 1
    owner = np.repeat(np.arange(count), np.diff(start))
    following = np.arange(len(vertices)) + 1
    following[start[1:] - 1] = start[:-1]
    local = vertices - vertices[start[:-1]][owner]
    vector = np.zeros((count, 3))
    np.add.at(vector, owner, 0.5 * np.cross(local, local[following]))
    return np.linalg.norm(vector, axis=1)


def _refuse(names: Sequence[str], wrong: np.ndarray, text: str) -> None:
    if wrong.any():
        raise SceneError(f"lamp '{names[int(np.argmax(wrong))]}' {text}")


def _named(names: Sequence[str], which: np.ndarray) -> str:
    chosen = [f"'{names[k]}'" for k in np.flatnonzero(which)]
    more = f" and {len(chosen) - 3} more" if len(chosen) > 3 else ""
    return f"lamp {chosen[0]} has" if len(chosen) == 1 else f"lamps {', '.join(chosen[:3])}{more} have"
