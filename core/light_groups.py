"""Light groups: lamps whose light is kept apart through a solve, so that it can be dimmed and coloured afterwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST = 32
"""Groups that a scene may have: each keeps light of its own on every element, corner and texel."""


@dataclass(frozen=True)
class LightGroups:
    """G groups. An index is -1 where nothing shines that could be in a group.

    names : G;  object : (O,) int32, group of the emitting polygons of every object
    area, points, suns : (L,) int32, group of every lamp of these kinds, as in :class:`~.lamps.Lamps`;  sky : that of the sky
    """

    names: tuple[str, ...]
    object: np.ndarray
    area: np.ndarray
    points: np.ndarray
    suns: np.ndarray
    sky: int = -1

    def __len__(self) -> int:
        return len(self.names)
