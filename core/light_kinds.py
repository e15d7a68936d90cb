"""What every kind of light source tells the direct light: who may see it, what of it, and how bright that is.

A kind (``FlatLights``, ``PointLights``, ``SunLights``, ``WindowSky``) is a dataclass of arrays with four methods:

* ``reach(building, patches, block)``: a :class:`Reach`, which sources may shine on which patches of a block;
* ``faces(source, points)``: (n,) bool, the points (n, 3) may be lit by the source of each;
* ``pieces(source, points)``: what the points (n, 3) would see with nothing in the way, as convex polygons: (m,) rising rows
  of the points, and (m, k, 3) float64 corners relative to them;
* ``light(source, corners, normals)``: (m, 3) irradiance, W/m2, from parts (m, k, 3) of such polygons, all in front of the receiver.

``endless`` says whether all of the direction counts, as of the sky, or only what lies before the polygon, as of a lamp.
``sharp`` says whether shadows may fall between neighbouring points that both see none: those of the sky are too soft for that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .building import Building
from .occlusion import Bodies
from .passages import Passages
from .patches import Patches
from .scene import OUTSIDE
from .transport import edge_sum
from .vectors import following

FINEST = 3
"""Most times that a part of a source is quartered to find its mean brightness."""


@dataclass(frozen=True)
class Reach:
    """Which sources may shine on which of K patches.

    patches, ends : bodies of the patches, and those that shafts from them to the sources end in
    nearby : clusters that hold all that can be in the way
    pairs : sets of (patch (n,) rising, end (n,), source (n,)); blockers are sought for each set apart
    """

    patches: Bodies
    ends: Bodies
    nearby: np.ndarray
    pairs: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]


class Kind(Protocol):
    """A kind of light source, see the head of this module."""

    endless: bool
    sharp: bool

    def reach(self, building: Building, patches: Patches, block: np.ndarray) -> Reach: ...

    def faces(self, source: np.ndarray, points: np.ndarray) -> np.ndarray: ...

    def pieces(self, source: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...

    def light(self, source: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray: ...


def rooms_in_sight(building: Building, clusters: np.ndarray) -> np.ndarray:
    """(n, R + 1) bool: rooms that hold something that each of ``clusters`` (n,) may see; the last column, the outside, always."""
    out = np.zeros((len(clusters), building.room_count + 1), bool)
    for k, cluster in enumerate(clusters):
        out[k, building.clusters.room[building.graph.neighbours(int(cluster))]] = True
    out[:, OUTSIDE] = True
    return out


def reach_in_rooms(
    building: Building,
    patches: Patches,
    block: np.ndarray,
    ends: Bodies,
    end_room: np.ndarray,
    outdoors: np.ndarray,
    pairs: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> Reach:
    """Of the ``pairs`` (patch, end, source) those that portals leave open, within a room and between rooms.

    end_room : room of every end, -1 outside;  outdoors : (G,) bool, regions that see the outside where no portal is
    """
    patch, end, source = pairs
    mine = patches.bodies.take(block)
    room = np.concatenate([building.regions.room[patches.region[block]], end_room])
    away = end_room[end] == OUTSIDE
    same = (room[patch] == end_room[end]) | (away & outdoors[patches.region[block]][patch])
    beyond = np.flatnonzero(~same)
    if len(beyond):
        bodies = mine.joined(ends)
        beyond = beyond[Passages(building.doors, room).open(bodies, room, patch[beyond], len(block) + end[beyond])]
    cluster = np.unique(building.clusters.cluster_of[patches.region[block]])
    nearby = np.arange(len(building.clusters)) if away.any() else building.surroundings(cluster)
    # A box around a point and a lamp in one room holds few blockers, one around several rooms holds many: so each kind apart.
    sets = tuple((patch[x], end[x], source[x]) for x in (np.flatnonzero(same), beyond) if len(x))
    return Reach(mine, ends, nearby, sets)


def shaded(
    corners: np.ndarray, normals: np.ndarray, brightness: Callable[[np.ndarray, np.ndarray], np.ndarray], share: float
) -> np.ndarray:
    """(m, c) irradiance from parts (m, k, 3) of a source whose brightness differs from place to place.

    brightness : (rows (n,), directions (n, 3)) to exitance (n, c), of a surface in that direction that would shine alike all over
    share : parts are cut to triangles of no more than this form factor, up to ``FINEST`` times; each counts with its middle, and
        exactly with its form factor
    """
    middle = corners.mean(1, keepdims=True)
    count, k = corners.shape[:2]
    triangles = np.stack([np.broadcast_to(middle, corners.shape), corners, following(corners)], axis=2).reshape(-1, 3, 3)
    row = np.repeat(np.arange(count), k)
    channels = brightness(np.zeros(0, np.int64), np.zeros((0, 3))).shape[1]
    out = np.zeros((count, channels))
    for turn in range(FINEST + 1):
        form = edge_sum(triangles, normals[row])
        big = (form > share) & (turn < FINEST)
        done = (form > 0) & ~big
        direction = triangles[done] / np.maximum(np.linalg.norm(triangles[done], axis=2, keepdims=True), 1e-300)
        light = form[done, None] * brightness(row[done], direction.sum(1))
        for c in range(channels):
            out[:, c] += np.bincount(row[done], light[:, c], minlength=count)
        if not big.any():
            break
        triangles, row = _quartered(triangles[big]), np.repeat(row[big], 4)
    return out


def _quartered(triangles: np.ndarray) -> np.ndarray:
    """(4 n, 3, 3) the quarters of triangles (n, 3, 3) of about equal angles: cut where the directions of two corners have their mean."""
    unit = triangles / np.maximum(np.linalg.norm(triangles, axis=2, keepdims=True), 1e-300)
    a, b, c = unit[:, 0], unit[:, 1], unit[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.stack([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))], axis=1).reshape(-1, 3, 3)
