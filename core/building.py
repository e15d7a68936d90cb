"""Everything about a scene that stays fixed while light moves: regions, blockers, clusters of regions and their PVS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .clustering import ClusterItems, Clusters
from .grouping import ragged
from .occlusion import Blockers, flat_blockers
from .regions import Regions
from .scene import Portals
from .visibility_graph import VisibilityGraph


@dataclass(frozen=True)
class Doors:
    """Portals as light meets them: rooms (K, 2) int, -1 outside; area (K,) float64 m2; frames, K rectangles around them.

    transmittance : (K,) float64, 0..1;  panes : (T,) triangles that cover those of less than 1, ``region`` being the portal of each
    """

    rooms: np.ndarray
    area: np.ndarray
    frames: Blockers
    transmittance: np.ndarray
    panes: Blockers


def doors_of(portals: Portals, centre: np.ndarray) -> Doors:
    """Rooms, areas and surrounding rectangles of all portals; ``centre`` (3,) of the scene, to which frames are relative."""
    count = len(portals)
    following = np.arange(len(portals.vertices)) + 1
    following[portals.start[1:] - 1] = portals.start[:-1]
    owner = np.repeat(np.arange(count), np.diff(portals.start))
    local = portals.vertices - portals.vertices[portals.start[:-1]][owner]
    vector = np.zeros((count, 3))
    np.add.at(vector, owner, 0.5 * np.cross(local, local[following]))
    area = np.linalg.norm(vector, axis=1)
    normal = vector / np.maximum(area, 1e-300)[:, None]
    edge = portals.vertices[portals.start[:-1] + 1] - portals.vertices[portals.start[:-1]]
    u = edge / np.maximum(np.linalg.norm(edge, axis=1), 1e-300)[:, None]
    v = np.cross(normal, u)
    x, y = (np.einsum("ij,ij->i", local, d[owner]) for d in (u, v))
    reach = [f.reduceat(z, portals.start[:-1]) if count else np.zeros(0) for z in (x, y) for f in (np.minimum, np.maximum)]
    first = portals.vertices[portals.start[:-1]] - centre
    origin = first + reach[0][:, None] * u + reach[2][:, None] * v
    a, b = (reach[1] - reach[0])[:, None] * u, (reach[3] - reach[2])[:, None] * v
    glass = np.ones(count) if portals.transmittance is None else portals.transmittance
    dim = np.flatnonzero((glass < 1) & (area > 0))
    member, row = ragged(portals.start[dim] + 1, np.diff(portals.start)[dim] - 2)
    door = dim[row]
    corner = portals.vertices[portals.start[door]]
    sides = (portals.vertices[member] - corner, portals.vertices[member + 1] - corner)
    wide = np.linalg.norm(np.cross(*sides), axis=1) > 0
    corner, door, sides = corner[wide], door[wide], (sides[0][wide], sides[1][wide])
    panes = flat_blockers(corner - centre, *sides, np.ones(len(door), bool), normal[door], door)
    return Doors(portals.rooms, area, flat_blockers(origin, a, b, np.zeros(count, bool), normal, np.arange(count)), glass, panes)


@dataclass(frozen=True)
class Building:
    """The fixed part of a solve. ``clusters`` and ``graph`` are over regions, not over the polygons they were merged from."""

    regions: Regions
    blockers: Blockers
    clusters: Clusters
    graph: VisibilityGraph
    doors: Doors
    room_count: int

    def surroundings(self, clusters: np.ndarray) -> np.ndarray:
        """Sorted clusters in the PVS of any of ``clusters`` (n,).

        The first thing that a segment from a point of a cluster meets can be seen from there, so that it lies in the
        cluster's PVS: the blockers of these surroundings decide every segment that starts in ``clusters``.
        """
        return np.unique(np.concatenate([self.graph.neighbours(int(c)) for c in clusters]))

    def regions_of(self, clusters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Regions of ``clusters`` (n,) one after another, and for each the index into ``clusters``."""
        members, owner = ragged(self.clusters.start[clusters], np.diff(self.clusters.start)[clusters])
        return self.clusters.members[members], owner

    def blockers_of(self, regions: np.ndarray) -> Blockers:
        """The blockers that stand for ``regions`` (n,)."""
        start = self.regions.piece_start
        return self.blockers.take(ragged(start[regions], np.diff(start)[regions])[0])

    def blockers_between(self, nearby: np.ndarray, low: np.ndarray, high: np.ndarray) -> Blockers:
        """The blockers of the clusters ``nearby`` (n,) that meet the box low..high (3,): all that a segment in the box can hit."""
        inside = self.regions_of(nearby)[0]
        meets = (self.regions.box_min[inside] <= high).all(1) & (self.regions.box_max[inside] >= low).all(1)
        return self.blockers_of(inside[meets])


def items_of(surfaces: Regions) -> ClusterItems:
    """Regions as things to be clustered, by the corners of their rectangles and the polygons that each stands for."""
    places = [(0, 0), (1, 0), (1, 1), (0, 1)]
    origin = surfaces.origin + surfaces.centre
    corners = np.stack([origin + x * surfaces.size[:, :1] * surfaces.u + y * surfaces.size[:, 1:] * surfaces.v for x, y in places], axis=1)
    count = len(surfaces)
    used = surfaces.polygon_region[surfaces.polygon_region >= 0]
    return ClusterItems(
        barycenter=surfaces.centroid + surfaces.centre,
        normal=surfaces.normal,
        box_min=surfaces.box_min + surfaces.centre,
        box_max=surfaces.box_max + surfaces.centre,
        smaller_edge=surfaces.size.min(1),
        room=surfaces.room,
        weight=np.bincount(used, minlength=count).astype(np.int64),
        reflectance=surfaces.reflectance,
        emission=surfaces.emission,
        vertices=corners.reshape(-1, 3),
        vertex_start=4 * np.arange(count + 1),
    )
