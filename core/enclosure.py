"""Which room encloses a point: a vote of rays that go from it to the surfaces around.

Rooms are open at their portals and may lack a ceiling, walls may be solid or sheets, so neither bounding boxes nor
winding numbers can tell. What a point sees does: with the portals closed, everything in sight belongs to its room.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import OUTSIDE

RAYS = 48
"""Rays of one vote, spread evenly over the half space in front."""

BACK_WEIGHT = 0.25
"""Vote of a ray that meets the back of a surface: it tells little, but more than nothing where normals are the wrong way."""

_BLOCK = 1 << 21


@dataclass(frozen=True)
class Walls:
    """What rays may meet (T triangles).

    corners : (T, 3, 3) float64, metres
    room : (T,) int, the room whose surface this is, or :data:`UNDECIDED` for what only blocks
    """

    corners: np.ndarray
    room: np.ndarray


UNDECIDED = -2
"""Room of a triangle that blocks rays and votes for none: a portal, or a surface whose room is still to be found."""


def directions(count: int) -> np.ndarray:
    """(count, 3) float64 unit vectors spread over the half sphere z > 0, the same every time (Fibonacci lattice)."""
    i = np.arange(count) + 0.5
    z = i / count
    turn = np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def enclosing_room(
    point: np.ndarray, normal: np.ndarray, low: np.ndarray, high: np.ndarray, walls: Walls, allowed: np.ndarray | None = None
) -> np.ndarray:
    """(N,) int32: the room around every point, :data:`OUTSIDE` where more rays leave the building than meet any one room.

    point : (N, 3), metres;  normal : (N, 3) unit, rays go to this side only
    low, high : (R, 3), bounding boxes of the rooms; only rooms whose box holds the point are asked, and only they block
    allowed : (N, R) bool or None, the rooms that a point may be in at all
    """
    margin = 1e-6 + 1e-4 * float((high - low).max(initial=0.0))
    candidate = ((point[:, None] >= low - margin) & (point[:, None] <= high + margin)).all(axis=2)
    if allowed is not None:
        candidate &= allowed
    out = np.full(len(point), OUTSIDE, np.int32)
    asked = np.flatnonzero(candidate.any(axis=1))
    # Points with the same candidates share the triangles that their rays can meet.
    sets, member = np.unique(candidate[asked], axis=0, return_inverse=True)
    triangle_low, triangle_high = walls.corners.min(axis=1), walls.corners.max(axis=1)
    by_room = np.argsort(walls.room, kind="stable")
    start = np.searchsorted(walls.room[by_room], np.arange(len(low) + 1))
    for k, rooms in enumerate(sets):
        chosen = asked[member.reshape(-1) == k]
        lowest, highest = low[rooms].min(axis=0) - margin, high[rooms].max(axis=0) + margin
        # In the order of the triangles, which decides where two of them are met at once.
        own = [by_room[start[r] : start[r + 1]] for r in np.flatnonzero(rooms)]
        near = np.sort(np.concatenate([by_room[: start[0]], *own]))
        near = near[(triangle_high[near] >= lowest).all(axis=1) & (triangle_low[near] <= highest).all(axis=1)]
        out[chosen] = _vote(point[chosen], normal[chosen], walls.corners[near], walls.room[near], len(low))
    return out


def _vote(point: np.ndarray, normal: np.ndarray, corners: np.ndarray, room: np.ndarray, room_count: int) -> np.ndarray:
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    u /= np.linalg.norm(u, axis=1)[:, None]
    frame = np.stack([u, np.cross(normal, u), normal], axis=1)
    ray = np.einsum("ri,nij->nrj", directions(RAYS), frame).reshape(-1, 3)
    hit, front = _first_hits(np.repeat(point, RAYS, axis=0), ray, corners)
    owner = np.where(hit >= 0, room[hit] if len(room) else UNDECIDED, OUTSIDE)
    weight = np.where((hit < 0) | front, 1.0, BACK_WEIGHT)
    weight[owner == UNDECIDED] = 0.0
    ballot = np.where(owner < 0, room_count, owner) + np.repeat(np.arange(len(point)), RAYS) * (room_count + 1)
    votes = np.bincount(ballot, weight, len(point) * (room_count + 1)).reshape(len(point), room_count + 1)
    best = votes.argmax(axis=1)  # a tie goes to the lower room, and to a room before the outside
    return np.where((best == room_count) | (votes.max(axis=1) <= 0.0), OUTSIDE, best)


def _first_hits(origin: np.ndarray, ray: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) first triangle in the way of every ray, -1 for none, and (N,) whether its front was met.

    Plucker coordinates: a line passes an edge p-q on the side given by the sign of ``d.(p x q) + (o x d).(q - p)``, so
    that all rays against all triangles are matrix products.
    """
    count = len(origin)
    hit, front = np.full(count, -1), np.zeros(count, bool)
    if len(corners) == 0 or count == 0:
        return hit, front
    centre = corners.reshape(-1, 3).mean(axis=0)
    corners, origin = corners - centre, origin - centre
    a, e, f = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e, f)
    moment = np.stack([np.cross(corners[:, i], corners[:, (i + 1) % 3]) for i in range(3)])
    edge = np.stack([corners[:, (i + 1) % 3] - corners[:, i] for i in range(3)])
    height = np.einsum("ij,ij->i", a, normal)
    step = max(1, _BLOCK // len(corners))
    for begin in range(0, count, step):
        o, d = origin[begin : begin + step], ray[begin : begin + step]
        od = np.cross(o, d)
        side = [d @ moment[i].T + od @ edge[i].T for i in range(3)]
        inside = ((side[0] >= 0) & (side[1] >= 0) & (side[2] >= 0)) | ((side[0] <= 0) & (side[1] <= 0) & (side[2] <= 0))
        slope = d @ normal.T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (height - o @ normal.T) / slope
        t[~inside | ~(t > 0.0)] = np.inf
        first = t.argmin(axis=1)
        rows = np.arange(len(o))
        met = np.isfinite(t[rows, first])
        hit[begin : begin + step] = np.where(met, first, -1)
        front[begin : begin + step] = met & (slope[rows, first] < 0.0)
    return hit, front
