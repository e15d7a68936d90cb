"""Lamps that are points or balls: light bulbs, spots, and luminaires with a measured distribution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .building import Building
from .lamps import PointLamps
from .light_kinds import Reach, reach_in_rooms, rooms_in_sight, shaded
from .occlusion import Bodies
from .patches import Patches
from .transport import edge_sum

SMALLEST = 1e-3
"""Radius in metres that a point is given: its shadows are sharp to less than a millimetre per metre."""
CORNERS = 12
"""Corners of the polygon that stands for a disc, of the same area."""
THIN = 0.01
"""Radius over distance up to which four corners do."""
CONE_SHARE = 2e-3
"""Form factor of a part of a lamp in which the light of a cone or a distribution counts as even."""


@dataclass(frozen=True)
class PointLights:
    """L lamps as :class:`PointLamps` has them, ``position`` (L, 3) relative to the scene's centre, ``radius`` (L,) above 0.

    outdoors : (G,) bool, regions that see the outside where no portal is, for lamps outside
    """

    lamps: PointLamps
    position: np.ndarray
    radius: np.ndarray
    outdoors: np.ndarray
    endless = False
    sharp = True

    def __len__(self) -> int:
        return len(self.position)

    def reach(self, building: Building, patches: Patches, block: np.ndarray) -> Reach:
        """Lamps in rooms that the clusters of the patches see."""
        cluster, row = np.unique(building.clusters.cluster_of[patches.region[block]], return_inverse=True)
        visible = rooms_in_sight(building, cluster)[:, self.lamps.room]
        lamps = np.flatnonzero(visible.any(0))
        centre, zero = self.position[lamps].astype(np.float32), np.zeros((len(lamps), 3), np.float32)
        ends = Bodies(centre, zero, zero, zero, self.radius[lamps].astype(np.float32))
        mine = patches.bodies.take(block)
        height = mine.normal @ centre.T - np.einsum("ij,ij->i", mine.centre, mine.normal)[:, None]
        patch, end = np.nonzero(visible[:, lamps][row] & (height > -self.radius[lamps]))
        return reach_in_rooms(building, patches, block, ends, self.lamps.room[lamps], self.outdoors, (patch, end, lamps[end]))

    def faces(self, source: np.ndarray, points: np.ndarray) -> np.ndarray:
        """All points."""
        return np.ones(len(source), bool)

    def pieces(self, source: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A polygon for the disc of the lamp, across the line of sight; a ball is the disc in which the lines touch it."""
        toward = self.position[source] - points
        distance = np.maximum(np.linalg.norm(toward, axis=1), 1e-9)
        axis = toward / distance[:, None]
        radius = self.radius[source]
        ball = self.lamps.ball[source]
        sine = np.where(ball, np.minimum(radius / distance, 0.999), 0.0)
        # Lines touch a ball before its centre, in a circle that is smaller than its equator.
        centre = axis * (distance * (1 - sine**2))[:, None]
        return np.arange(len(source)), disc(centre, axis, radius * np.sqrt(1 - sine**2), _corners(radius, distance))

    def light(self, source: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Intensity over the area of the disc, as an exitance; a cone and a distribution depend on where the receiver is."""
        # A disc of radius r and radiance L has the intensity pi r2 L on its axis, and the exitance pi L.
        exitance = self.lamps.intensity[source] / (self.radius[source] ** 2)[:, None]
        out = edge_sum(corners, normals)[:, None] * exitance
        directed = np.flatnonzero((self.lamps.cone[source] < np.pi) | (self.lamps.distribution[source] >= 0))
        if len(directed):
            which = source[directed]

            def brightness(row: np.ndarray, direction: np.ndarray) -> np.ndarray:
                return self._factor(which[row], direction)[:, None] * exitance[directed[row]]

            out[directed] = shaded(corners[directed], normals[directed], brightness, CONE_SHARE)
        return out

    def _factor(self, lamp: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """(n,) factor of the intensity of ``lamp`` (n,), seen from points in ``direction`` (n, 3): towards the lamp."""
        local = -np.einsum("nij,nj->ni", self.lamps.frame[lamp], direction)
        return spot_factor(self.lamps, lamp, local) * distribution_factor(self.lamps, lamp, local)


def spot_factor(lamps: PointLamps, lamp: np.ndarray, local: np.ndarray) -> np.ndarray:
    """(n,) 0..1, part of the intensity that cones leave in directions (n, 3) of the frames of ``lamp`` (n,): smooth at their edges."""
    cosine = -local[:, 2] / np.maximum(np.linalg.norm(local, axis=1), 1e-300)
    edge = np.cos(lamps.cone[lamp])
    x = np.clip((cosine - edge) / np.maximum((1 - edge) * lamps.blend[lamp], 1e-6), 0, 1)
    return np.where(lamps.cone[lamp] < np.pi, x * x * (3 - 2 * x), 1.0)


def distribution_factor(lamps: PointLamps, lamp: np.ndarray, local: np.ndarray) -> np.ndarray:
    """(n,) cd in directions (n, 3) of the frames of ``lamp`` (n,), 1 for lamps without a distribution."""
    out = np.ones(len(lamp))
    for k, distribution in enumerate(lamps.distributions):
        rows = np.flatnonzero(lamps.distribution[lamp] == k)
        if len(rows):
            out[rows] = distribution.intensity(local[rows])
    return out


def point_lights(lamps: PointLamps, centre: np.ndarray, outdoors: np.ndarray) -> PointLights:
    """Point lamps; ``centre`` (3,) of the scene, ``outdoors`` (G,) as of :class:`PointLights`."""
    return PointLights(lamps, lamps.position - centre, np.maximum(lamps.radius, SMALLEST), outdoors)


def disc(centre: np.ndarray, axis: np.ndarray, radius: np.ndarray, corners: int) -> np.ndarray:
    """(n, corners, 3) regular polygons around ``centre`` (n, 3) across unit ``axis`` (n, 3) with the area of discs of ``radius`` (n,)."""
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin(1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(axis, u)
    turn = 2 * np.pi * (np.arange(corners) + 0.5) / corners
    reach = (radius * np.sqrt(2 * np.pi / (corners * np.sin(2 * np.pi / corners))))[:, None, None]
    return centre[:, None] + reach * (np.cos(turn)[:, None] * u[:, None] + np.sin(turn)[:, None] * v[:, None])


def _corners(radius: np.ndarray, distance: np.ndarray) -> int:
    return 4 if not len(radius) or float((radius / distance).max()) < THIN else CORNERS
