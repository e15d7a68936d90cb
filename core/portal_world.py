"""The boxes of clusters and the portals between rooms, as the visibility graph looks at them.

Every portal becomes two directed windows, one for each way through it. A window is a planar convex polygon and a depth: the
opening lies within the prism that reaches the depth to both sides of the polygon. The depth of a planar portal is zero.
"""

from __future__ import annotations

import numpy as np

from .clustering import ClusterItems, Clusters
from .grouping import components, starts_of
from .scene import Portals

MAX_CORNERS = 16
"""Most corners of a window; a cut that would make more is left out, and portals with more are framed by tangents."""
TOLERANCE = 1e-7
"""Slack of all comparisons, of the diagonal of the building: boxes are grown and planes moved out by it, against rounding."""
_UPRIGHT = 1e-3
"""Largest component of a unit vector that counts as zero when a portal is asked whether it is an upright rectangle."""


class PortalWorld:
    """Boxes and directed windows about the middle of the building, sorted by room.

    C clusters: ``centre, half`` (C, 3) boxes; ``room`` (C,); ``by_room`` (C,) clusters in the order of their rooms, room r owns
    ``by_room[room_start[r]:room_start[r + 1]]``; cluster c holds the boxes ``item_centre, item_half`` [item_start[c]:item_start[c + 1]]
    D directed windows: ``window`` (D, n, 3) corners, the last repeated; ``normal`` (D, 3) to the room behind; ``depth`` (D,)
    metres; ``source, target`` (D,) rooms before and behind; ``portal`` (D,) the portal it belongs to; room r looks through
    ``portal_start[r]:portal_start[r + 1]``
    ``component`` (R,) label of the connected part of the building; ``middle`` (3,) what was subtracted; ``slack`` metres
    """

    def __init__(self, clusters: Clusters, portals: Portals, rooms: int, framed: bool, items: ClusterItems | None) -> None:
        """``items`` that the clusters are of, or None to go by the boxes of clusters alone.

        ``framed``: portals that are no upright rectangles become their bounding boxes, as in the paper (section 5.1).
        """
        corners = [clusters.box_min, clusters.box_max, portals.vertices]
        low = np.min([c.min(axis=0) for c in corners if len(c)], axis=0, initial=np.inf)
        high = np.max([c.max(axis=0) for c in corners if len(c)], axis=0, initial=-np.inf)
        self.middle = 0.5 * (low + high) if len(clusters) else np.zeros(3)
        self.slack = TOLERANCE * float(np.linalg.norm(high - low)) if len(clusters) else 0.0
        self.centre = 0.5 * (clusters.box_min + clusters.box_max) - self.middle
        self.half = 0.5 * (clusters.box_max - clusters.box_min)
        if items is None:
            self.item_start, self.item_centre, self.item_half = np.arange(len(clusters) + 1), self.centre, self.half
        else:
            low, high = items.box_min[clusters.members], items.box_max[clusters.members]
            self.item_start = clusters.start
            self.item_centre, self.item_half = 0.5 * (low + high) - self.middle, 0.5 * (high - low)
        self.room = clusters.room
        self.by_room = np.argsort(clusters.room, kind="stable")
        self.room_start = starts_of(clusters.room[self.by_room], rooms)
        self.framed = framed

        window = _padded(portals, self.middle)
        normal, area = _normals(window)
        depth = np.zeros(len(portals)) if portals.depth is None else portals.depth
        if framed:
            window, normal, depth = _framed(window, normal, depth)
        useful = np.flatnonzero((area > self.slack**2) & (portals.rooms >= 0).all(axis=1))
        # Every portal is looked through both ways: in the other direction its corners run the other way round.
        ends = portals.rooms[useful]
        source = np.concatenate([ends[:, 0], ends[:, 1]])
        order = np.argsort(source, kind="stable")
        self.window = np.concatenate([window[useful], window[useful, ::-1]])[order]
        self.normal = np.concatenate([normal[useful], -normal[useful]])[order]
        self.depth = np.tile(depth[useful], 2)[order]
        self.portal = np.tile(useful, 2)[order]
        self.source = source[order]
        self.target = np.concatenate([ends[:, 1], ends[:, 0]])[order]
        self.portal_start = starts_of(self.source, rooms)
        self.component = components(rooms, ends[:, 0], ends[:, 1])


def _normals(window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (K, 3) and areas (K,) of polygons (K, n, 3)."""
    vector = 0.5 * np.cross(window - window[:, :1], np.roll(window, -1, axis=1) - window[:, :1]).sum(axis=1)
    area = np.linalg.norm(vector, axis=1)
    return vector / np.maximum(area, 1e-300)[:, None], area


def _padded(portals: Portals, middle: np.ndarray) -> np.ndarray:
    """(K, n, 3) corners of all portals, the last one repeated; portals of too many corners become the frame of their tangents."""
    counts = np.diff(portals.start)
    many = counts > MAX_CORNERS - 4
    size = min(int(counts.max(initial=3)), MAX_CORNERS - 4)
    slot = portals.start[:-1, None] + np.minimum(np.arange(size), counts[:, None] - 1)
    window = portals.vertices[slot] - middle
    for k in np.flatnonzero(many):  # round windows: rare
        window[k] = _tangent_frame(portals.polygon(k) - middle, size)
    return window


def _tangent_frame(polygon: np.ndarray, sides: int) -> np.ndarray:
    """(sides, 3) corners of the equiangular polygon around a planar convex one, same orientation."""
    origin = polygon.mean(axis=0)
    local = polygon - origin
    normal = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
    u = local[np.argmax(np.einsum("ij,ij->i", local, local))]
    u = u / np.linalg.norm(u)
    v = np.cross(normal / max(np.linalg.norm(normal), 1e-300), u)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    support = (np.stack([local @ u, local @ v], axis=1) @ direction.T).max(axis=0)
    # Corner between the tangents i and i + 1: along tangent i from its foot.
    turn = 2.0 * np.pi / sides
    along = (np.roll(support, -1) - support * np.cos(turn)) / np.sin(turn)
    flat = support[:, None] * direction + along[:, None] * np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    return origin + flat[:, :1] * u + flat[:, 1:] * v


def _framed(window: np.ndarray, normal: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Windows (K, 4, 3), normals and depths of the paper: upright rectangles stay, all others become their bounding boxes.

    The box of an oblique or horizontal portal is a prism across the axis nearest to the normal.
    """
    count = len(window)
    edge = np.roll(window, -1, axis=1) - window
    length = np.linalg.norm(edge, axis=2, keepdims=True)
    along = np.abs(edge[..., 2]) / np.maximum(length[..., 0], 1e-300)
    level, plumb = along < _UPRIGHT, along > 1.0 - _UPRIGHT**2
    upright = (np.abs(normal[:, 2]) < _UPRIGHT) & (depth == 0) & (level | plumb | (length[..., 0] == 0)).all(axis=1)
    axis = np.abs(normal).argmax(axis=1)
    sign = np.sign(normal[np.arange(count), axis])
    low, high = window.min(axis=1) - depth[:, None], window.max(axis=1) + depth[:, None]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    box = np.repeat(middle[:, None], 4, axis=1)
    row = np.arange(count)
    for corner, (x, y) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        box[row, corner, u] += x * half[row, u]
        box[row, corner, v] += y * sign * half[row, v]
    flat = np.zeros((count, 3))
    flat[row, axis] = sign
    rectangle = frames(window, normal)
    return (
        np.where(upright[:, None, None], rectangle, box),
        np.where(upright[:, None], normal, flat),
        np.where(upright, 0.0, half[row, axis]),
    )


def frames(window: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(N, 4, 3) rectangles around polygons (N, n, 3) across ``normal`` (N, 3), with sides level and as upright as can be.

    Across a vertical normal the sides run along x and y. Same orientation as the polygons.
    """
    lying = np.abs(normal[:, 2]) > 0.5 * np.sqrt(2.0)
    level = np.where(lying[:, None], [1.0, 0.0, 0.0], np.stack([-normal[:, 1], normal[:, 0], np.zeros(len(normal))], axis=1))
    level -= np.einsum("ij,ij->i", level, normal)[:, None] * normal
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    other = np.cross(normal, level)
    origin = window[:, 0]
    x, y = (np.einsum("nkc,nc->nk", window - origin[:, None], axis) for axis in (level, other))
    span = [(x.min(axis=1), y.min(axis=1)), (x.max(axis=1), y.min(axis=1)), (x.max(axis=1), y.max(axis=1)), (x.min(axis=1), y.max(axis=1))]
    return np.stack([origin + s[:, None] * level + t[:, None] * other for s, t in span], axis=1)
