"""The sight of one cluster: how many portals lie between it and all that it sees, and the space behind each portal, to be drawn.

The graph only tells that two clusters may see each other. Why they do is found again for one cluster on demand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .clustering import ClusterItems, Clusters
from .polygons import clip_half
from .portal_world import PortalWorld
from .scene import Portals
from .sight_planes import joined, supporting_planes
from .visibility_graph import MAX_PORTALS, VisibilityGraph, first_windows, next_windows, seen_behind


@dataclass(frozen=True)
class Sight:
    """What one cluster of C sees, through W windows.

    cluster : the one that looks
    crossed : (C,) int32, least number of portals between, 0 in its own room, -1 for clusters that it does not see
    window_of : (C,) int64, the window that each cluster is seen through, with the fewest portals; -1 where there is none
    portal : (W,) int64, portal that each window is part of;  parent : (W,) int64, window before it, -1 for the first
    corners : (W, n, 3) float64, metres, windows as convex polygons, last corner repeated, normal away from the cluster
    room : (W,) int64, the room behind each window
    planes : (W, k, 4) float64, (a, b): what is seen behind a window has a.x <= b for all of its planes; infinite b: no bound
    room_low, room_high : (R, 3) float64, metres, boxes of the rooms
    """

    cluster: int
    crossed: np.ndarray
    window_of: np.ndarray
    portal: np.ndarray
    parent: np.ndarray
    corners: np.ndarray
    room: np.ndarray
    planes: np.ndarray
    room_low: np.ndarray
    room_high: np.ndarray

    def windows_to(self, c: int) -> np.ndarray:
        """(n,) int64 windows that lead to cluster ``c``, in the order in which they are passed; none in its own room."""
        chain = []
        w = int(self.window_of[c])
        while w >= 0:
            chain.append(w)
            w = int(self.parent[w])
        return np.array(chain[::-1], np.int64)

    def chain(self, c: int) -> np.ndarray:
        """(n,) int64 portals between the cluster and cluster ``c``, in the order in which they are passed."""
        return self.portal[self.windows_to(c)]

    def polygon(self, w: int) -> np.ndarray:
        """(n, 3) corners of window ``w``, none of them twice."""
        corners = self.corners[w]
        return corners[np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 0]

    def volume(self, w: int) -> list[np.ndarray]:
        """Faces, (n, 3) each, of the convex space that is seen behind window ``w`` in the room there, metres.

        The box of the room, cut by the planes of the window: no faces where nothing of the room is seen.
        """
        low, high = self.room_low[self.room[w]], self.room_high[self.room[w]]
        axes = np.concatenate([np.eye(3), -np.eye(3)])
        planes = np.concatenate([self.planes[w], np.column_stack([axes, np.concatenate([high, -low])])])
        planes = np.unique(planes[np.isfinite(planes[:, 3])], axis=0)
        return _faces(planes, 0.5 * (low + high), float(np.linalg.norm(high - low)))


def sight(
    clusters: Clusters,
    portals: Portals,
    room_count: int,
    cluster: int,
    graph: VisibilityGraph,
    volumes: str = "windows",
    items: ClusterItems | None = None,
) -> Sight:
    """All that ``cluster`` sees, window by window, in rising number of portals.

    Arguments as those of ``visibility_graph.build``, and the graph that it made: pairs that the graph lacks, because the other
    cluster does not see this one, are left out. Where the graph gave up on a chain of more than ``MAX_PORTALS`` portals,
    ``crossed`` is one more than that and there is no window.
    """
    world = PortalWorld(clusters, portals, room_count, volumes == "boxes", items)
    crossed = np.where(graph.sees(cluster, np.arange(len(clusters))), MAX_PORTALS + 1, -1).astype(np.int32)
    crossed[clusters.room == clusters.room[cluster]] = 0
    window_of = np.full(len(clusters), -1)
    fronts, all_planes, first = [], [], 0
    front = first_windows(world, np.array([cluster]))
    for depth in range(1, MAX_PORTALS + 1):
        front, planes = supporting_planes(world, front)
        if not len(front):
            break
        owner, member = seen_behind(world, front, planes)
        new = np.flatnonzero(crossed[member] > depth)
        # The same cluster may be seen through several windows of one depth: the first of them is kept.
        member, row = np.unique(member[new], return_index=True)
        crossed[member], window_of[member] = depth, first + owner[new][row]
        following = next_windows(world, front, planes)
        following.parent += first
        fronts.append(front)
        all_planes.append(planes)
        first += len(front)
        front = following
    corners = joined([f.corner for f in fronts], 3)
    planes = joined(all_planes, 4)
    planes[..., 3] += planes[..., :3] @ world.middle
    portal = np.concatenate([f.portal for f in fronts]) if fronts else np.zeros(0, np.int64)
    low, high = np.full((room_count, 3), np.inf), np.full((room_count, 3), -np.inf)
    np.minimum.at(low, clusters.room, clusters.box_min)
    np.maximum.at(high, clusters.room, clusters.box_max)
    return Sight(
        cluster=cluster,
        crossed=crossed,
        window_of=window_of,
        portal=world.portal[portal],
        parent=np.concatenate([f.parent for f in fronts]) if fronts else np.zeros(0, np.int64),
        corners=corners + world.middle,
        room=world.target[portal],
        planes=planes,
        room_low=low,
        room_high=high,
    )


def _faces(planes: np.ndarray, centre: np.ndarray, size: float) -> list[np.ndarray]:
    """Faces of the convex space a.x <= b (k, 4), which lies within ``size`` of ``centre``: large squares cut by each other's planes."""
    normal, offset = planes[:, :3], planes[:, 3] - planes[:, :3] @ centre
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u)
    square = [offset[:, None] * normal + 2 * size * (s * u + t * v) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    face = np.stack(square, axis=1)
    for k in range(len(planes)):
        height = offset[k] - face @ normal[k]
        height[k] = 0.0
        face = np.where((height < 0).all(axis=1)[:, None, None], face[:, :1], face)
        height = np.where((height < 0).all(axis=1)[:, None], 0.0, height)
        face = clip_half(face, height)
    out = []
    for k in range(len(planes)):
        corner = face[k][np.linalg.norm(face[k] - np.roll(face[k], 1, axis=0), axis=1) > 1e-9 * size]
        area = np.linalg.norm(np.cross(corner, np.roll(corner, -1, axis=0)).sum(axis=0)) if len(corner) > 2 else 0.0
        if area > 1e-12 * size * size:
            out.append(corner + centre)
    return out
