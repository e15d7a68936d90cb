"""What a target error means for each stage: the one knob of a user, resolved into tolerances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .options import Options
from .regions import Regions


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of one solve; errors are relative to the mean irradiance of a room, in the mean square over its surfaces.

    exchange : admissible error of one exchange between two elements
    direct : admissible error of the direct light on one element, as a source of reflected light
    min_size, link_size : metres, shortest long edges of elements that the light of luminaires asks for, and that exchanges ask for
    unshot : unshot over emitted power at which the shooting stops
    rays : over the hemisphere of a point, for the final gathering
    """

    exchange: float
    direct: float
    min_size: float
    link_size: float
    unshot: float
    rays: int


# Fractions of the root of a typical room's surface for min_size; the rest by measurement on the bench scenes.
_TABLE = {
    "draft": (4e-3, 1.2e-2, 1 / 32, 1e-3, 96),
    "good": (1e-3, 2e-3, 1 / 100, 1e-4, 384),
    "fine": (2e-4, 5e-4, 1 / 200, 3e-5, 1024),
}


def tolerances(options: Options, regions: Regions) -> Tolerances:
    """Tolerances for the quality that the options ask for, in a building of these regions."""
    exchange, direct, fraction, unshot, rays = _TABLE[options.quality]
    surface = np.bincount(regions.room, regions.area)
    typical = float(np.sqrt(np.median(surface[surface > 0])))
    smallest = options.min_element_size or fraction * typical
    # Gathering finds the reflected light of corners and contacts anew at every point, from elements of twice the size as well.
    linked = smallest if options.reflected == "elements" else 2 * smallest
    return Tolerances(exchange, direct, smallest, linked, unshot, rays)
