"""How long a bake takes and how much memory, guessed before it begins from sizes that are known at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .options import Options
from .polygons import area_vectors
from .scene import Scene

ELEMENTS = {"draft": 450.0, "good": 2100.0, "fine": 9000.0}
"""Surface elements of a room: 290 to 840 at draft and 1,400 to 3,400 at good, in buildings of 1 to 678 rooms."""
ELEMENT_SECONDS = {"draft": 6e-4, "good": 3.1e-4, "fine": 6e-4}
"""Seconds of one core for an element, from luminaires to shooting: 0.4 to 1.4 ms at draft, 0.15 to 0.6 ms at good."""
VALUE_SECONDS = {"draft": 2e-4, "good": 3e-4, "fine": 1e-3}
"""Seconds of one core for the light at a corner or texel: measured in a furnished apartment of 21,000 polygons."""
BYTES = 60e6, 900.0, 60.0
"""Memory in all, for an element, and for a value."""
SPREAD = 3.0
"""Buildings and machines differ by this factor to both sides."""


@dataclass(frozen=True)
class Estimate:
    """seconds : the least and the most to be expected;  megabytes : about;  basis : a sentence that says what they rest on"""

    seconds: tuple[float, float]
    megabytes: float
    basis: str


def estimate(scene: Scene, options: Options, values: int, workers: int) -> Estimate:
    """What a bake should take that evaluates the light at so many ``values``, corners or texels, on so many cores.

    Elements follow the rooms: their smallest size is a part of the surface of a room of middling size (:mod:`quality`).
    """
    area = np.linalg.norm(area_vectors(scene), axis=1)
    surface = np.bincount(scene.room, area, scene.room_count)
    rooms = float(surface.sum() / max(np.median(surface[surface > 0]) if (surface > 0).any() else 1.0, 1e-300))
    elements = rooms * ELEMENTS[options.quality]
    if options.min_element_size:
        elements = min(elements, surface.sum() / options.min_element_size**2)
    alone = elements * ELEMENT_SECONDS[options.quality] + values * VALUE_SECONDS[options.quality]
    whole, each, value = BYTES
    basis = (
        f"For {scene.polygon_count:,} polygons in {scene.room_count} room{'s' * (scene.room_count != 1)} and {values:,} values, "
        f"by what six buildings took on one core of a server, shared by {workers} core{'s' * (workers != 1)}"
    )
    return Estimate((alone / workers / SPREAD, alone * SPREAD), (whole + each * elements + value * values) / 1e6, basis)


def in_words(seconds: float) -> str:
    """A time as one says it: ``8 s``, ``40 s``, ``3 min``, ``22 h``."""
    if seconds < 10:
        return f"{max(seconds, 1):.0f} s"
    if seconds < 90:
        return f"{round(seconds, -1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.0f} h"
