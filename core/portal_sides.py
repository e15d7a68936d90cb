"""On which side of a portal its two rooms lie, found from where their polygons are.

Seen from the middle of a portal, the surfaces of a room cover the half of all directions on the room's side, fronts less
backs, and the other half not at all: what turns round a corner there is seen from the front as often as from behind. A
room whose polygons all face the wrong way covers the same half, with the other sign.
"""

from __future__ import annotations

import numpy as np

from .grouping import ragged, starts_of
from .polygons import clip_half, loop_polygon
from .scene import Scene

CLEAR = 1.0
"""Solid angle, sr, by which one half must be covered more than the other to decide; where less is there to see, portals stay."""
FLAT = 1e-5
"""Height over distance of what counts as in the plane of the portal."""
_BLOCK = 1 << 16
"""Triangles that are worked on at once."""


def reversed_portals(scene: Scene) -> np.ndarray:
    """(K,) bool: portals whose normal clearly runs from their second to their first room.

    Indices and corners must be sound. Portals without area are not asked.
    """
    portals = scene.portals
    count = len(portals)
    if not count:
        return np.zeros(0, bool)
    owner = np.repeat(np.arange(count), np.diff(portals.start))
    middle = np.add.reduceat(portals.vertices, portals.start[:-1]) / np.diff(portals.start)[:, None]
    local = portals.vertices - middle[owner]
    following = np.arange(1, len(local) + 1)
    following[portals.start[1:] - 1] = portals.start[:-1]
    normal = np.add.reduceat(np.cross(local, local[following]), portals.start[:-1])
    length = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(length, 1e-300)[:, None]

    triangle, room = _fans(scene)
    order = np.argsort(room, kind="stable")
    triangle, start = triangle[order], starts_of(room[order], scene.room_count)
    balance = np.zeros(count)  # what speaks for the given sense, less what speaks against it
    for end, sign in ((0, -1.0), (1, 1.0)):
        asked = np.flatnonzero((portals.rooms[:, end] >= 0) & (length > 0))
        size = np.diff(start)[portals.rooms[asked, end]]
        for block in np.split(asked, np.flatnonzero(np.diff(np.cumsum(size) // _BLOCK)) + 1):
            here = portals.rooms[block, end]
            member, row = ragged(start[here], np.diff(start)[here])
            seen = triangle[member] - middle[block][row][:, None]
            height = np.einsum("nkc,nc->nk", seen, normal[block][row])
            height[np.abs(height) <= FLAT * np.linalg.norm(seen, axis=2)] = 0.0  # walls in the plane fill no angle
            for side in (1.0, -1.0):
                balance[block] += sign * side * np.abs(np.bincount(row, _half_angles(seen, side * height), minlength=len(block)))
    return balance < -CLEAR


def _fans(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(T, 3, 3) triangles from the first corner of every loop to its edges, and their rooms (T,).

    Triangles of concave loops and of holes overlap others with the opposite sense: signed angles add up to what is covered.
    """
    counts = np.diff(scene.loop_start)
    sides = np.maximum(counts - 2, 0)
    corner, loop = ragged(scene.loop_start[:-1] + 1, sides)
    position = scene.vertices[scene.corner_vertex]
    first = scene.loop_start[:-1][loop]
    return np.stack([position[first], position[corner], position[corner + 1]], axis=1), scene.room[loop_polygon(scene)[loop]]


def _half_angles(triangle: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(T,) solid angles of the parts of triangles (T, 3, 3) with ``height`` (T, 3) above zero."""
    out = np.zeros(len(triangle))
    whole = (height >= 0).all(axis=1) & (height > 0).any(axis=1)
    cut = np.flatnonzero(~whole & (height > 0).any(axis=1))
    out[whole] = _solid_angles(triangle[whole])
    out[cut] = _solid_angles(clip_half(triangle[cut], height[cut]))
    return out


def _solid_angles(polygon: np.ndarray) -> np.ndarray:
    """(T,) signed solid angles, sr, that convex polygons (T, n, 3) fill from the origin; positive where their front is seen.

    Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
    """
    length = np.linalg.norm(polygon, axis=2, keepdims=True)
    unit = polygon / np.maximum(length, 1e-300)
    total = np.zeros(len(polygon))
    for k in range(1, polygon.shape[1] - 1):
        a, b, c = unit[:, 0], unit[:, k], unit[:, k + 1]
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot = lambda x, y: np.einsum("ij,ij->i", x, y)  # noqa: E731
        total -= 2.0 * np.arctan2(volume, 1.0 + dot(a, b) + dot(b, c) + dot(c, a))
    return total
