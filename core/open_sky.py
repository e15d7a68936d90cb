"""The sky over regions that see it where no portal is: gathered by rays, since too much is in the way to cut it all out of the whole sky.

The sky is a cube so far away that all of the building is in its middle; its faces are surfaces of the brightness of the sky.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .building import Building
from .daylight import radiance_towards, span_of
from .exitance_map import ExitanceMap
from .gather import SHELF, ray_sheaves
from .lamps import Sky
from .occlusion import Blockers, flat_blockers
from .outdoors import Outdoors
from .ray_fans import Faces, Workspace, directed, faces_of, look, shelves

RAYS = 2048
"""From every point."""
TEXELS = 64
"""Along a side of the cube."""
FAR = 300.0
"""Half a side of the cube over the size of the building."""


@dataclass(frozen=True)
class OpenSky:
    """The sky over ``outdoors`` (G,) bool regions.

    cube : 6 blockers, numbered after those of the building;  radiant : exitance of the building, which is none, and of the cube
    """

    outdoors: np.ndarray
    cube: Blockers
    radiant: ExitanceMap

    def received(self, building: Building, points: np.ndarray, region: np.ndarray) -> np.ndarray:
        """(n, 3) irradiance, W/m2, of points (n, 3) float32 on the fronts of ``region`` (n,)."""
        regions, out = building.regions, np.zeros((len(points), 3))
        mine = np.flatnonzero(self.outdoors[region])
        if not len(mine):
            return out
        faces, work = faces_of(building.blockers.joined(self.cube), building.doors.frames.take(np.zeros(0, np.int64))), Workspace()
        frame = np.stack([regions.u[region[mine]], regions.v[region[mine]], regions.normal[region[mine]]], axis=1)
        frames, way = np.unique(np.round(frame, 6).reshape(-1, 9), axis=0, return_inverse=True)
        for k in range(len(frames)):
            rows = mine[np.flatnonzero(way.reshape(-1) == k)]
            self._over_hemisphere(faces, frames[k].reshape(3, 3), points, rows, work, out)
        return out

    def _over_hemisphere(self, faces: Faces, frame: np.ndarray, points: np.ndarray, rows: np.ndarray, work: Workspace, out) -> None:
        """Add to ``out`` (n, 3) what rays over the hemisphere find of the sky from the points ``rows``, all with one frame (3, 3)."""
        sheaves = ray_sheaves(RAYS)
        direction, axis = (sheaves.direction @ frame).astype(np.float32), sheaves.axis @ frame
        normal = frame[2].astype(np.float32)
        top = (faces.corners @ normal).max(1)
        for part, centre, radius in shelves(points, rows, SHELF):
            ahead = top > (points[part] @ normal).min() + faces.clearance
            seen = faces.toward(centre, radius, axis, sheaves.angle) & ahead[:, None]
            for t in range(len(axis)):
                some = faces.take(np.flatnonzero(seen[:, t]))
                fan = directed(some, direction[sheaves.start[t] : sheaves.start[t + 1]])
                for sights in look(some, fan, self.radiant, points[part], work):
                    light = self.radiant.all_of(sights.texel)
                    for c in range(3):
                        out[part, c] += np.bincount(sights.point, light[:, c], minlength=len(part)) / RAYS


def open_sky(sky: Sky, building: Building, outdoors: Outdoors) -> OpenSky | None:
    """The sky over what is open to it, None where nothing is."""
    if not outdoors.regions.any():
        return None
    size, count = FAR * span_of(building), len(building.blockers)
    axis, side = np.repeat(np.arange(3), 2), np.tile([-1.0, 1.0], 3)
    normal, a, b = (np.eye(3)[(axis + k) % 3] for k in range(3))
    # The faces look inward.
    a, b = np.where(side[:, None] > 0, b, a), np.where(side[:, None] > 0, a, b)
    origin = size * (side[:, None] * normal - a - b)
    cube = flat_blockers(origin, 2 * size * a, 2 * size * b, np.zeros(6, bool), -side[:, None] * normal, np.full(6, -1))
    cube = replace(cube, id=count + np.arange(6, dtype=np.int32), clearance=building.blockers.clearance)
    place = (np.arange(TEXELS) + 0.5) / TEXELS
    y, x = (g.ravel()[:, None] for g in np.meshgrid(place, place, indexing="ij"))
    towards = [origin[k] + 2 * size * (x * a[k] + y * b[k]) for k in range(6)]
    light = np.concatenate([np.pi * radiance_towards(sky, d) for d in towards])
    # One black texel for all of the building.
    start = np.concatenate([np.zeros(count, np.int64), 1 + TEXELS**2 * np.arange(6)])
    width = np.concatenate([np.ones(count, np.int32), np.full(6, TEXELS, np.int32)])
    values = np.concatenate([np.zeros((1, 3)), light]).astype(np.float32)
    return OpenSky(
        outdoors.regions, cube, ExitanceMap.of(start, width, width, values, values, np.zeros((count + 6, 3), np.float32), 2 * size / TEXELS)
    )
