"""The exitance of every surface as a map of small texels, for rays that look a colour up by the million.

Each flat piece (a blocker) has a grid of texels over its parallelogram; a texel holds the exitance of the element there, and
the part of it that came straight from the luminaires. There are many, and rays see some hundreds of them at once: eleven bits
of the one and sixteen of the other are enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import basis
from .elements import Forest
from .grouping import ragged
from .regions import Regions

MOST = 64
"""Most texels along a side of a piece."""
_BLOCK = 1 << 17


@dataclass(frozen=True)
class ExitanceMap:
    """Texels of K pieces.

    start : (K,) int64 first texel of each piece;  width, height : (K,) int32 texels along its sides
    exitance : (T, c) float16, all that is reflected, in units of ``unit`` (c,) float32 W/m2
    first : (T, c) uint16, how much of this is light of the luminaires, in 65,535ths
    reflectance : (K, c) float32;  size : of a texel, about, m
    """

    start: np.ndarray
    width: np.ndarray
    height: np.ndarray
    exitance: np.ndarray
    first: np.ndarray
    unit: np.ndarray
    reflectance: np.ndarray
    size: float

    @classmethod
    def of(cls, start, width, height, exitance: np.ndarray, direct: np.ndarray, reflectance: np.ndarray, size: float) -> ExitanceMap:
        """From ``exitance`` and ``direct`` (T, c), W/m2."""
        unit = _unit(float(np.max(exitance, initial=0)))
        return cls(start, width, height, *_packed(exitance, direct, unit), np.full(exitance.shape[1], unit), reflectance, size)

    @property
    def channels(self) -> int:
        """Colours per texel: three, or three for each of the maps that are :func:`beside` one another."""
        return self.exitance.shape[1]

    def all_of(self, texel: np.ndarray) -> np.ndarray:
        """(n, c) float32 W/m2, exitance of texels (n,)."""
        return self.exitance.take(texel, 0) * self.unit

    def direct_of(self, texel: np.ndarray) -> np.ndarray:
        """(n, c) float32 W/m2, the part of it that came straight from the luminaires."""
        return self.all_of(texel) * (self.first.take(texel, 0) * np.float32(1 / 65_535))

    def texel(self, piece: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(n,) the texel at places 0 <= x, y <= 1 of pieces (n,), as parts of their sides."""
        width, height = self.width.take(piece), self.height.take(piece)
        column = np.minimum((x * width).astype(np.int32), width - 1)
        row = np.minimum((y * height).astype(np.int32), height - 1)
        return self.start.take(piece) + row * width + column


def exitance_map(regions: Regions, forest: Forest, direct: np.ndarray, reflected: np.ndarray, texel: float) -> ExitanceMap:
    """The map of what surfaces make of irradiance ``direct`` and ``reflected`` (E, m, 3), coefficients of all elements, ancestors
    included, in texels of about ``texel`` metres.
    """
    width, height = (
        np.clip(np.ceil(np.linalg.norm(side, axis=1) / texel), 1, MOST).astype(np.int32) for side in (regions.piece_a, regions.piece_b)
    )
    count = width.astype(np.int64) * height
    start = np.cumsum(count) - count
    reflectance = regions.reflectance[regions.piece_region].astype(np.float32)
    # No polynomial is larger on its element than eight times the sum of its coefficients.
    largest = sum(float(np.abs(light).max((0, 2), initial=0).sum()) for light in (direct, reflected))
    unit = _unit(8 * largest)
    exitance, from_lamps = np.empty((int(count.sum()), 3), np.float16), np.empty((int(count.sum()), 3), np.uint16)
    step = max(1, _BLOCK // max(1, int(np.ceil(count.mean())))) if len(count) else 1
    for first in range(0, len(count), step):
        pieces = np.arange(first, min(first + step, len(count)))
        k, row = ragged(np.zeros(len(pieces), np.int64), count[pieces])
        piece = pieces[row]
        x, y = (k % width[piece] + 0.5) / width[piece], (k // width[piece] + 0.5) / height[piece]
        # Beyond the long side of a triangle nobody looks but by rounding: the nearest place within.
        over = np.where(regions.piece_triangle[piece], np.maximum(x + y, 1.0), 1.0)
        uv = regions.piece_origin[piece] + (x / over)[:, None] * regions.piece_a[piece] + (y / over)[:, None] * regions.piece_b[piece]
        element, local = forest.locate(regions.piece_region[piece], uv)
        values_there = basis.evaluate(forest.order, local).astype(np.float32)
        first_light, more = (np.einsum("nm,nmc->nc", values_there, light[element]) for light in (direct, reflected))
        here = slice(start[first], start[first] + len(k))
        total, part = (np.maximum(light, 0) * reflectance[piece] for light in (first_light + more, first_light))
        exitance[here], from_lamps[here] = _packed(total, part, unit)
    return ExitanceMap(start, width, height, exitance, from_lamps, np.full(3, unit), reflectance, texel)


def beside(maps: Sequence[ExitanceMap]) -> ExitanceMap:
    """Maps of the same texels in different light as one map with the channels of all, so that rays are traced once."""
    names = ("exitance", "first", "unit", "reflectance")
    return replace(maps[0], **{name: np.concatenate([getattr(one, name) for one in maps], axis=-1) for name in names})


def _unit(largest: float) -> np.float32:
    """W/m2 of which half precision can count up to ``largest``."""
    return np.float32(max(largest / float(np.finfo(np.float16).max), float(np.finfo(np.float32).tiny)))


def _packed(exitance: np.ndarray, direct: np.ndarray, unit: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Exitance in units, and 65,535ths of it that are ``direct``."""
    share = np.clip(direct / np.maximum(exitance, np.finfo(np.float32).tiny), 0, 1)
    return (exitance / unit).astype(np.float16), np.rint(65_535 * share).astype(np.uint16)
