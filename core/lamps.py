"""Lamps, sun and sky: what shines on a building without being a surface of it. None of it blocks light.

All light is linear RGB in radiometric units. A scene without a kind of lamp has zero of it, and pays nothing for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .luminous_intensity import Distribution


@dataclass(frozen=True)
class AreaLamps:
    """L flat lamps that shine from their front alone.

    names : L;  room : (L,) int32, where each hangs, -1 outside
    vertices : (M, 3) float64, metres, corners of all outlines one after another, each convex and counter-clockwise from its front
    start : (L + 1,) int64, lamp l owns corners ``start[l]:start[l + 1]``
    exitance : (L, 3) float64, W/m2, power of a lamp over its area
    spread : (L,) float64, radians, full angle of the cone beyond which nothing shines; pi: diffuse
    """

    names: tuple[str, ...]
    room: np.ndarray
    vertices: np.ndarray
    start: np.ndarray
    exitance: np.ndarray
    spread: np.ndarray

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class PointLamps:
    """L lamps as large as a ball, with a cone or with the distribution of a luminaire where they have one.

    names : L;  room : (L,) int32, where each hangs, -1 outside;  position : (L, 3) float64, metres
    radius : (L,) float64, metres, 0 for a point;  ball : (L,) bool, False for a disc that faces whoever looks at it
    intensity : (L, 3) float64, radiant intensity, W/sr; of a lamp with a distribution the factor from its cd to W/sr
    frame : (L, 3, 3) float64, from directions of the world to those of the lamp, of which a cone is around -z
    cone : (L,) float64, radians, half-angle of a spot's cone, pi without;  blend : (L,) 0..1, part of it with a soft edge
    distribution : (L,) int32, index into ``distributions``, -1 for none
    """

    names: tuple[str, ...]
    room: np.ndarray
    position: np.ndarray
    radius: np.ndarray
    ball: np.ndarray
    intensity: np.ndarray
    frame: np.ndarray
    cone: np.ndarray
    blend: np.ndarray
    distribution: np.ndarray
    distributions: tuple[Distribution, ...] = ()

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Suns:
    """L suns, outside of the building and so far away that they stand in one direction.

    names : L;  toward : (L, 3) float64 unit, from the building to the sun
    irradiance : (L, 3) float64, W/m2, across its light;  angle : (L,) float64, radians, its diameter, below pi
    """

    names: tuple[str, ...]
    toward: np.ndarray
    irradiance: np.ndarray
    angle: np.ndarray

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Sky:
    """What is seen outside of the building where nothing else is: sky above, ground below.

    name : for messages
    radiance : (H, W, 3) float32, W/(m2 sr), equirectangular: row 0 looks down and the last up, column 0 begins at -x and the
        columns turn clockwise as seen from above, over +y
    """

    name: str
    radiance: np.ndarray


def no_area_lamps() -> AreaLamps:
    """Zero area lamps."""
    return AreaLamps((), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros((0, 3)), np.zeros(0))


def no_point_lamps() -> PointLamps:
    """Zero point lamps."""
    none, three = np.zeros(0), np.zeros((0, 3))
    index = np.zeros(0, np.int32)
    return PointLamps((), index, three, none, np.zeros(0, bool), three, np.zeros((0, 3, 3)), none, none, index)


def no_suns() -> Suns:
    """Zero suns."""
    return Suns((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def joined_suns(one: Suns, other: Suns) -> Suns:
    """The suns of both."""
    arrays = (np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("toward", "irradiance", "angle"))
    return Suns(one.names + other.names, *arrays)


@dataclass(frozen=True)
class Lamps:
    """All that shines on a scene beside its emitting surfaces; ``sky`` is None where the outside is black."""

    area: AreaLamps = field(default_factory=no_area_lamps)
    points: PointLamps = field(default_factory=no_point_lamps)
    suns: Suns = field(default_factory=no_suns)
    sky: Sky | None = None

    @property
    def any(self) -> bool:
        """Is there any lamp, sun or sky?"""
        return bool(len(self.area) or len(self.points) or len(self.suns) or self.sky is not None)

    @property
    def from_outside(self) -> bool:
        """Is there a sun or a sky?"""
        return bool(len(self.suns) or self.sky is not None)
