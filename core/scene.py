"""Scene: the planar polygons of a building, their materials, rooms and portals, as arrays.

All lengths are metres, z is up, light is linear RGB. A polygon is one-sided for emission: its outer loop runs
counter-clockwise seen from the front, its holes run clockwise, and it emits from the front only.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .lamps import Lamps
from .light_groups import LightGroups

OUTSIDE = -1
"""Room index of the outside of the building, as one of the two rooms of a portal."""


class SceneError(ValueError):
    """A scene that cannot be solved; the message is one sentence that names the offender and the remedy."""


@dataclass(frozen=True)
class Portals:
    """Openings between rooms: planar convex polygons.

    vertices : (M, 3) float64, corner positions of all portals one after another, metres
    start : (K + 1,) int64, portal k owns corners ``start[k]:start[k + 1]`` (3 or more)
    rooms : (K, 2) int32, the two rooms, the normal runs from ``rooms[:, 0]`` to ``rooms[:, 1]``; -1 is the outside
    names : K names for messages (object and face in Blender), may be empty texts
    depth : (K,) float64 or None for zeros, metres; an opening that is not planar lies within this of the plane of its polygon
    transmittance : (K,) float64 or None for ones, 0..1, part of the light that passes, as of a pane of glass
    """

    vertices: np.ndarray
    start: np.ndarray
    rooms: np.ndarray
    names: tuple[str, ...] = ()
    depth: np.ndarray | None = None
    transmittance: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.rooms)

    def polygon(self, k: int) -> np.ndarray:
        """(n, 3) float64 corners of portal ``k``."""
        return self.vertices[self.start[k] : self.start[k + 1]]


def no_portals() -> Portals:
    """Zero portals."""
    return Portals(np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros((0, 2), np.int32))


@dataclass(frozen=True)
class EvaluationPoints:
    """Fixed surface points at which a result is wanted (N points on the front sides of polygons).

    position : (N, 3) float64, metres;  normal : (N, 3) float64, unit;  polygon : (N,) int32
    """

    position: np.ndarray
    normal: np.ndarray
    polygon: np.ndarray


@dataclass(frozen=True)
class Scene:
    """Planar polygons with holes, in rooms that are joined by portals.

    vertices : (V, 3) float64, metres
    corner_vertex : (C,) int32, vertex of every corner, loop after loop
    loop_start : (L + 1,) int64, loop l owns corners ``loop_start[l]:loop_start[l + 1]``
    polygon_start : (P + 1,) int64, polygon p owns loops ``polygon_start[p]:polygon_start[p + 1]``: outer loop, then holes
    reflectance : (P, 3) float64, diffuse reflectance 0..1
    emission : (P, 3) float64, emitted radiant exitance of the front, W/m2 (radiance = emission / pi)
    room : (P,) int32, room of every polygon, 0..R-1
    object : (P,) int32, index into ``object_names``: polygons of different objects are never merged
    portals : Portals
    points : EvaluationPoints or None
    lamps : what shines on the scene beside its emitting polygons
    groups : LightGroups, or None where all light is one
    """

    name: str
    vertices: np.ndarray
    corner_vertex: np.ndarray
    loop_start: np.ndarray
    polygon_start: np.ndarray
    reflectance: np.ndarray
    emission: np.ndarray
    room: np.ndarray
    object: np.ndarray
    room_names: tuple[str, ...]
    object_names: tuple[str, ...]
    portals: Portals = field(default_factory=no_portals)
    points: EvaluationPoints | None = None
    lamps: Lamps = field(default_factory=Lamps)
    groups: LightGroups | None = None

    @property
    def polygon_count(self) -> int:
        return len(self.room)

    @property
    def room_count(self) -> int:
        return len(self.room_names)
