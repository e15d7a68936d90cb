"""The daylight factor: illuminance inside over that on open level ground, under the CIE overcast sky, in per cent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .lamps import Lamps
from .light_report import RoomLight
from .photometry import LUMINOUS_EFFICACY
from .scene import Scene
from .sky_maps import cie_overcast, overcast_irradiance

GROUND = 0.2
"""Reflectance of the ground that lies around the building."""


def under_overcast_sky(scene: Scene, ground: float = GROUND) -> Scene:
    """The scene without its lamps, under a CIE overcast sky that gives open level ground 1 W/m2."""
    sky = cie_overcast(1 / overcast_irradiance(1.0), ground)
    return replace(scene, emission=np.zeros_like(scene.emission), lamps=Lamps(sky=sky))


def in_per_cent(rows: list[RoomLight]) -> list[RoomLight]:
    """Rows of light under the sky of :func:`under_overcast_sky`, in per cent of that outside."""
    scale = 100 / LUMINOUS_EFFICACY
    return [replace(r, average=scale * r.average, minimum=scale * r.minimum, maximum=scale * r.maximum) for r in rows]
