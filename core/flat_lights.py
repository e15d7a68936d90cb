"""Surfaces that emit, and area lamps: polygons of one exitance each, that shine from their front."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .building import Building
from .clustering import Clusters
from .grouping import ragged, starts_of
from .lamps import AreaLamps
from .light_kinds import Reach, reach_in_rooms, rooms_in_sight, shaded
from .occlusion import Bodies
from .patches import Patches
from .regions import Regions
from .transport import edge_sum

SPREAD_SHARE = 1e-3
"""Form factor of a part of a lamp in which the light of a narrow spread counts as even."""


@dataclass(frozen=True)
class FlatLights:
    """L flat light sources; positions are relative to the scene's centre.

    room : (L,);  cluster : (L,) cluster of a surface, -1 for a lamp, which is seen wherever something of its room is
    exitance : (L, 3) W/m2;  normal : (L, 3);  spread : (L,) radians, full angle of the cone that it shines into, pi for diffuse
    outline_start : (L + 1,), outlines : (K, k, 3) float64 convex polygons that make up each;  bodies : rectangles around them
    outdoors : (G,) bool, regions that see the outside where no portal is, for lamps outside
    """

    room: np.ndarray
    cluster: np.ndarray
    exitance: np.ndarray
    normal: np.ndarray
    spread: np.ndarray
    outline_start: np.ndarray
    outlines: np.ndarray
    bodies: Bodies
    outdoors: np.ndarray
    clearance: float
    endless = False
    sharp = True

    def __len__(self) -> int:
        return len(self.room)

    def reach(self, building: Building, patches: Patches, block: np.ndarray) -> Reach:
        """Lamps in sight of the clusters of the patches, whose front the patch is on."""
        cluster, row = np.unique(building.clusters.cluster_of[patches.region[block]], return_inverse=True)
        if (self.cluster >= 0).all():
            visible = building.graph.sees(cluster[:, None], self.cluster[None])
        else:
            visible = rooms_in_sight(building, cluster)[:, self.room]
        lamps = np.flatnonzero(visible.any(0))
        mine, ends = patches.bodies.take(block), self.bodies.take(lamps)
        anchor = self.outlines[self.outline_start[lamps], 0].astype(np.float32)
        height = mine.centre @ ends.normal.T - np.einsum("ij,ij->i", anchor, ends.normal)
        height += mine.reach(ends.normal)
        patch, end = np.nonzero((height > self.clearance) & visible[:, lamps][row])
        return reach_in_rooms(building, patches, block, ends, self.room[lamps], self.outdoors, (patch, end, lamps[end]))

    def faces(self, source: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(n,) bool: points (n, 3) lie before the front."""
        offset = points - self.outlines[self.outline_start[source], 0]
        return np.einsum("ij,ij->i", offset, self.normal[source]) > self.clearance

    def pieces(self, source: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The outlines."""
        members, row = ragged(self.outline_start[source], np.diff(self.outline_start)[source])
        return row, self.outlines.take(members, 0) - points.take(row, 0)[:, None]

    def light(self, source: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Lambert's formula; a narrow spread weakens what leaves at an angle to the normal."""
        out = edge_sum(corners, normals)[:, None] * self.exitance[source]
        narrow = np.flatnonzero(self.spread[source] < np.pi)
        if len(narrow):
            half, axis, exitance = 0.5 * self.spread[source[narrow]], self.normal[source[narrow]], self.exitance[source[narrow]]

            def brightness(row: np.ndarray, direction: np.ndarray) -> np.ndarray:
                cosine = -np.einsum("ij,ij->i", direction, axis[row])
                sine = np.linalg.norm(np.cross(direction, axis[row]), axis=1)
                # The power stays the same at any spread: what the edge loses the axis gains.
                edge = np.tan(half[row])
                factor = np.maximum(edge - sine / np.maximum(cosine, 1e-12), 0) / (edge - half[row])
                return factor[:, None] * exitance[row]

            out[narrow] = shaded(corners[narrow], normals[narrow], brightness, SPREAD_SHARE)
        return out


def shining_surfaces(regions: Regions, clusters: Clusters, clearance: float) -> FlatLights:
    """The emitting regions, as far as they are covered: what lies under other things, or belongs to another lamp, shines not."""
    region = np.flatnonzero((regions.emission > 0).any(1))
    members, row = ragged(regions.cover_start[region], np.diff(regions.cover_start)[region])
    cover = regions.cover[members]
    while cover.shape[1] > 3 and (cover[:, -1] == cover[:, -2]).all():  # the missing corners of all
        cover = cover[:, :-1]
    flat = regions.world(np.repeat(region[row], cover.shape[1]), cover.reshape(-1, 2))
    outlines = flat.reshape(-1, cover.shape[1], 3)
    half = 0.5 * regions.size[region]
    sides = (regions.world(region, half), half[:, :1] * regions.u[region], half[:, 1:] * regions.v[region], regions.normal[region])
    return FlatLights(
        regions.room[region],
        clusters.cluster_of[region],
        regions.emission[region],
        regions.normal[region],
        np.full(len(region), np.pi),
        starts_of(row, len(region)),
        outlines,
        Bodies(*(x.astype(np.float32) for x in sides)),
        np.zeros(len(regions), bool),
        clearance,
    )


def area_lights(lamps: AreaLamps, centre: np.ndarray, outdoors: np.ndarray, clearance: float) -> FlatLights:
    """Area lamps; ``centre`` (3,) of the scene, ``outdoors`` (G,) as of :class:`FlatLights`."""
    count = np.diff(lamps.start)
    most = int(count.max())
    corner = lamps.start[:-1, None] + np.minimum(np.arange(most), count[:, None] - 1)
    outlines = lamps.vertices[corner] - centre
    local = outlines - outlines[:, :1]
    normal = np.cross(local, np.roll(local, -1, 1)).sum(1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    u = local[:, 1] / np.linalg.norm(local[:, 1], axis=1, keepdims=True)
    v = np.cross(normal, u)
    middle, halves = outlines[:, 0].copy(), []
    for axis in (u, v):
        x = np.einsum("lkd,ld->lk", local, axis)
        middle += 0.5 * (x.min(1) + x.max(1))[:, None] * axis
        halves.append(0.5 * np.ptp(x, axis=1)[:, None] * axis)
    bodies = Bodies(*(x.astype(np.float32) for x in (middle, *halves, normal)))
    lone = np.full(len(lamps), -1)
    return FlatLights(
        lamps.room, lone, lamps.exitance, normal, lamps.spread, np.arange(len(lamps) + 1), outlines, bodies, outdoors, clearance
    )
