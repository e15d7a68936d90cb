"""The exitance of every surface as a map of small texels, for rays that look a colour up by the million.

Each flat piece (a blocker) has a grid of texels over its parallelogram; a texel holds the exitance of the element there, and
the part of it that came straight from the luminaires.
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
    exitance, direct : (T, c) float32, W/m2, all that is reflected, and of this the light of the luminaires
    reflectance : (K, c) float32;  size : of a texel, about, m
    """

    start: np.ndarray
    width: np.ndarray
    height: np.ndarray
    exitance: np.ndarray
    direct: np.ndarray
    reflectance: np.ndarray
    size: float

    @property
    def channels(self) -> int:
        """Colours per texel: three, or three for each of the maps that are :func:`beside` one another."""
        return self.exitance.shape[1]

    def texel(self, piece: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(n,) the texel at places 0 <= x, y <= 1 of pieces (n,), as parts of their sides."""
        column = np.minimum((x * self.width[piece]).astype(np.int32), self.width[piece] - 1)
        row = np.minimum((y * self.height[piece]).astype(np.int32), self.height[piece] - 1)
        return self.start[piece] + row * self.width[piece] + column


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
    values = np.empty((2, int(count.sum()), 3), np.float32)
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
        values[0, here] = np.maximum(first_light + more, 0) * reflectance[piece]
        values[1, here] = np.maximum(first_light, 0) * reflectance[piece]
    return ExitanceMap(start, width, height, values[0], values[1], reflectance, texel)


def beside(maps: Sequence[ExitanceMap]) -> ExitanceMap:
    """Maps of the same texels in different light as one map with the channels of all, so that rays are traced once."""
    exitance, direct, reflectance = (
        np.concatenate([getattr(one, name) for one in maps], axis=1) for name in ("exitance", "direct", "reflectance")
    )
    return replace(maps[0], exitance=exitance, direct=direct, reflectance=reflectance)
