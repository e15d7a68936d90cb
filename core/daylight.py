"""Light from outside: suns, and the sky through portals and over open ground. Walls and furniture are in its way, no distance is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .building import Building
from .lamps import Sky, Suns
from .light_kinds import Reach, reach_in_rooms, rooms_in_sight, shaded
from .occlusion import Blockers, Bodies
from .outdoors import Outdoors, openings
from .patches import Patches
from .point_lights import disc
from .polygons import clip_half
from .scene import OUTSIDE, Portals
from .transport import edge_sum, lambert

SMALLEST = 1e-4
"""Half-angle in radians that a sun is given at least, less than a fortieth of the real one's."""
CORNERS, WIDE_CORNERS, WIDE = 8, 32, 0.1
"""Corners of the polygon that stands for a sun, more of them where its half-angle is above ``WIDE`` radians."""
WIDEST = 1.45
"""Half-angle in radians, the most that the polygon of a sun can have."""
SKY_SHARE = 1 / 400
"""Form factor of a part of the sky that counts as even: some five degrees."""
FARTHEST = 1e4
"""What hides the sky is sought as far beyond a portal as this, times the distance to it."""


@dataclass(frozen=True)
class SunLights:
    """L suns.

    corners : (L, k, 3) polygons in their directions, at a distance of 1;  exitance : (L, 3) of these, W/m2
    toward : (L, 3);  half : (L,) radians;  distance : metres, farther than anything of the building
    rooms : (K, 2) of portals, rooms that are open being the outside;  outdoors : (G,) bool, regions that need no portal
    """

    corners: np.ndarray
    exitance: np.ndarray
    toward: np.ndarray
    half: np.ndarray
    distance: float
    rooms: np.ndarray
    outdoors: np.ndarray
    endless = True
    sharp = True

    def reach(self, building: Building, patches: Patches, block: np.ndarray) -> Reach:
        """Suns above the planes of the patches, through portals that lead outside."""
        mine = patches.bodies.take(block)
        patch, sun = np.nonzero(mine.normal @ self.toward.T > -np.sin(self.half))
        ends = mine.take(patch)
        centre = ends.centre + (self.distance * self.toward[sun]).astype(np.float32)
        radius = (self.distance * np.tan(self.half))[sun].astype(np.float32)
        ends = Bodies(centre, ends.half_u, ends.half_v, np.zeros_like(ends.normal), radius)
        pairs = (patch, np.arange(len(patch)), sun)
        return reach_in_rooms(_opened(building, self.rooms), patches, block, ends, np.full(len(patch), OUTSIDE), self.outdoors, pairs)

    def faces(self, source: np.ndarray, points: np.ndarray) -> np.ndarray:
        """All points."""
        return np.ones(len(source), bool)

    def pieces(self, source: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same directions everywhere."""
        return np.arange(len(source)), self.corners[source]

    def light(self, source: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Lambert's formula."""
        return edge_sum(corners, normals)[:, None] * self.exitance[source]


@dataclass(frozen=True)
class WindowSky:
    """The sky through L portals, in rooms that are closed but for their portals.

    sky : what is seen;  outlines : (L, k, 3) relative to the scene's centre;  inward : (L, 3) unit normals into the room
    room : (L,) the room of each;  frames : L rectangles around them;  distance : metres, as large as the building
    rooms, outdoors : as of :class:`SunLights`; regions that need no portal see the sky as ``OpenSky`` has it
    """

    sky: Sky
    outlines: np.ndarray
    inward: np.ndarray
    room: np.ndarray
    frames: Blockers
    distance: float
    rooms: np.ndarray
    outdoors: np.ndarray
    endless = True
    sharp = False

    def reach(self, building: Building, patches: Patches, block: np.ndarray) -> Reach:
        """Portals in sight of the clusters of the patches, whose inner side the patch is on."""
        cluster, row = np.unique(building.clusters.cluster_of[patches.region[block]], return_inverse=True)
        visible = rooms_in_sight(building, cluster)[:, self.room]
        mine = patches.bodies.take(block)
        anchor = np.einsum("ij,ij->i", self.outlines[:, 0], self.inward)
        height = mine.centre @ self.inward.T - anchor
        inside = (height + mine.reach(self.inward) > self.frames.clearance) & ~self.outdoors[patches.region[block], None]
        patch, window = np.nonzero(inside & visible[row])
        # As seen from the middle of the patch the portal is moved away until all that may hide the sky lies before it; seen from
        # the rest of the patch it is then the wider.
        near = np.maximum(height[patch, window], 1e-9)
        scale = np.minimum(1 + self.distance / near, FARTHEST)[:, None]
        corner, own = self.frames.corners[window].astype(np.float64), mine.centre[patch].astype(np.float64)
        centre = own + scale * (0.5 * (corner[:, 0] + corner[:, 2]) - own)
        halves = (0.5 * scale * (corner[:, k] - corner[:, 0]) for k in (1, 3))
        radius = (scale[:, 0] - 1) * mine.balls()[1][patch]
        arrays = (centre, *halves, np.zeros((len(patch), 3)), radius)
        ends = Bodies(*(x.astype(np.float32) for x in arrays))
        pairs = (patch, np.arange(len(patch)), window)
        reach = reach_in_rooms(building, patches, block, ends, self.room[window], self.outdoors, pairs)
        return replace(reach, nearby=np.arange(len(building.clusters)))

    def faces(self, source: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(n,) bool: points (n, 3) lie on the inner side."""
        return np.einsum("ij,ij->i", points - self.outlines[source, 0], self.inward[source]) > self.frames.clearance

    def pieces(self, source: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The outlines of the portals."""
        return np.arange(len(source)), self.outlines[source] - points[:, None]

    def light(self, source: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """The part of the sky in these directions."""
        return sky_light(self.sky, corners, normals)


def sky_light(sky: Sky, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(m, 3) irradiance, W/m2, from the sky within cones (m, k, 3) before the receivers."""
    if sky.radiance.shape[:2] == (1, 1):
        return np.pi * edge_sum(corners, normals)[:, None] * sky.radiance[0, 0].astype(np.float64)
    out = np.zeros((len(corners), 3))
    height = corners[..., 2]
    # Nothing is as uneven as the horizon: no part of the sky reaches over it.
    for sign in (1, -1):
        over = np.flatnonzero((sign * height > 0).any(1))
        parts = clip_half(corners[over], sign * height[over])
        out[over] += shaded(parts, normals[over], lambda row, direction: np.pi * radiance_towards(sky, direction), SKY_SHARE)
    return out


def radiance_towards(sky: Sky, directions: np.ndarray) -> np.ndarray:
    """(n, 3) W/(m2 sr) in directions (n, 3) of any length, linear between the middles of the texels."""
    height, width = sky.radiance.shape[:2]
    x, y, z = directions.T
    column = (0.5 - np.arctan2(y, x) / (2 * np.pi)) * width - 0.5
    row = np.clip((0.5 + np.arctan2(z, np.hypot(x, y)) / np.pi) * height - 0.5, 0, height - 1)
    left, low = np.floor(column).astype(np.int64), np.minimum(np.floor(row).astype(np.int64), max(height - 2, 0))
    s, t = (column - left)[:, None], (row - low)[:, None]
    high = np.minimum(low + 1, height - 1)
    at = lambda r, c: sky.radiance[r, c % width]  # noqa: E731
    return (1 - t) * ((1 - s) * at(low, left) + s * at(low, left + 1)) + t * ((1 - s) * at(high, left) + s * at(high, left + 1))


def sun_lights(suns: Suns, building: Building, outdoors: Outdoors) -> SunLights:
    """Suns over a building."""
    half = np.clip(0.5 * suns.angle, SMALLEST, WIDEST)
    count = WIDE_CORNERS if half.max() > WIDE else CORNERS
    corners = disc(suns.toward, suns.toward, np.tan(half), count)
    # What arrives across the light is known: so is the exitance of a polygon of any shape.
    exitance = suns.irradiance / lambert(np.zeros((len(half), 3)), suns.toward, corners)[:, None]
    rooms = openings(building.doors.rooms, outdoors)
    return SunLights(corners, exitance, suns.toward, half, span_of(building), rooms, outdoors.regions)


def window_sky(sky: Sky, building: Building, portals: Portals, outdoors: Outdoors) -> WindowSky | None:
    """The sky through portals that lead outside, None where there is none."""
    doors = building.doors
    rooms = openings(doors.rooms, outdoors)
    windows = np.flatnonzero((rooms == OUTSIDE).sum(1) == 1)
    if not len(windows):
        return None
    count = np.diff(portals.start)[windows]
    corner = portals.start[windows, None] + np.minimum(np.arange(int(count.max())), count[:, None] - 1)
    first = rooms[windows, 0] == OUTSIDE
    frames = doors.frames.take(windows)
    # The normal of a portal runs from its first room to its second.
    inward = np.where(first[:, None], 1.0, -1.0) * frames.normal
    room = np.where(first, rooms[windows, 1], rooms[windows, 0])
    outlines = portals.vertices[corner] - building.regions.centre
    return WindowSky(sky, outlines, inward.astype(np.float64), room, frames, span_of(building), rooms, outdoors.regions)


def span_of(building: Building) -> float:
    """Metres, more than between any two places of a building."""
    regions = building.regions
    return 2 * float(np.linalg.norm(regions.box_max.max(0) - regions.box_min.min(0))) + 1.0


def _opened(building: Building, rooms: np.ndarray) -> Building:
    """The building with portals to open rooms as portals to the outside."""
    return replace(building, doors=replace(building.doors, rooms=rooms))
