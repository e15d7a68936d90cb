"""Rooms that leak: straight lines from one room into another that pass no portal between them.

Light that takes such a line is lost, since the visibility graph knows of portals only. Rays from the surfaces of every room are
followed from portal to portal; one that meets the front of a surface of a room that it has not come through has found a gap:
a wall that was left out, a hole without a portal, a portal that names the wrong rooms, an object that belongs to the
room next door. Lines through the outside are no leaks, and surfaces met from behind take no light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .box_tree import BoxTree
from .grouping import ragged, starts_of
from .occlusion import Blockers, first_hits, flat_blockers
from .regions import Regions
from .scene import OUTSIDE, Portals

RAYS = 1 << 15
"""Rays for a whole building, shared out by the surface of the rooms; every room casts ``MIN_RAYS`` at least."""
MIN_RAYS = 128
WIDTH = 2e-3
"""Lines at this distance to four sides of a leak, metres, leak as well: edges that merely touch are no gaps."""
MAX_CROSSINGS = 16
"""Most portals that a ray is followed through."""


@dataclass(frozen=True)
class Leak:
    """A line from a surface of one room to a surface of another that passes no portal between them.

    room : where the line starts;  other : the room of the surface that it meets
    start, end : (3,) float64, metres, in the frame of the scene;  lines : how many of the rays do the same
    """

    room: int
    other: int
    start: np.ndarray
    end: np.ndarray
    lines: int


def find_leaks(regions: Regions, blockers: Blockers, portals: Portals, room_count: int, rays: int = RAYS) -> tuple[Leak, ...]:
    """At most one leak for every ordered pair of rooms, the shortest that was found; sorted by rooms.

    regions, blockers : of one scene (``regions.merge``, ``occlusion.blockers_of``);  portals : convex, in the scene's own frame
    """
    places = _Places(regions, blockers, portals, room_count)
    origin, direction, room = _rays(regions, blockers, room_count, rays)
    clear = ~_in_a_door(places, origin, room)
    origin, direction, room = origin[clear], direction[clear], room[clear]
    reach, other = _follow(places, origin, direction, room)
    rows = np.flatnonzero(other >= 0)
    u = np.cross(direction[rows], np.eye(3, dtype=np.float32)[np.abs(direction[rows]).argmin(axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(direction[rows], u)
    wide = np.ones(len(rows), bool)
    for shift in (u, -u, v, -v):
        # They start a little way along the line, where there is air on all sides of it.
        ahead = np.minimum(0.05, 0.25 * reach[rows])[:, None] * direction[rows]
        wide &= _follow(places, origin[rows] + ahead + np.float32(WIDTH) * shift, direction[rows], room[rows])[1] >= 0
    rows = rows[wide]
    key = room[rows].astype(np.int64) * room_count + other[rows]
    order = np.lexsort((reach[rows], key))
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    return tuple(
        Leak(int(room[k]), int(other[k]), origin[k] + regions.centre, origin[k] + reach[k] * direction[k] + regions.centre, int(n))
        for k, n in zip(rows[order[first]], np.diff(np.append(first, len(order))), strict=True)
    )


class _Places:
    """What a ray can meet in each room: the blockers of all rooms that reach into its box, and its doors."""

    def __init__(self, regions: Regions, blockers: Blockers, portals: Portals, room_count: int) -> None:
        self.blockers, self.region_room = blockers, regions.room
        self.portal_rooms, self.openings = portals.rooms, _triangles(portals, regions.centre)
        self._low, self._high = np.full((room_count, 3), np.inf), np.full((room_count, 3), -np.inf)
        np.minimum.at(self._low, regions.room, regions.box_min - 10 * blockers.clearance)
        np.maximum.at(self._high, regions.room, regions.box_max + 10 * blockers.clearance)
        self._bounds = blockers.corners.min(axis=1), blockers.corners.max(axis=1)
        self._near: dict[int, Blockers] = {}

    def surfaces(self, room: int, origin: np.ndarray, direction: np.ndarray, far: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Way (n,) from within ``room`` to the nearest surface, infinite for none, and the room (n,) whose front it is, -1 for none.

        far : (n,) bool, rays that are followed beyond the box of the room
        """
        if room not in self._near:
            meets = (self._bounds[0] <= self._high[room]).all(axis=1) & (self._bounds[1] >= self._low[room]).all(axis=1)
            self._near[room] = self.blockers.take(np.flatnonzero(meets))
        way, region, behind = _first(self._near[room], origin, direction)
        gone = np.flatnonzero((region < 0) & far)
        if len(gone):
            way[gone], region[gone], behind[gone] = _first(self.blockers, origin[gone], direction[gone])
        return way, np.where((region >= 0) & ~behind, self.region_room[region], -1)

    def doors_of(self, room: int, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Way (n,) to the nearest portal of ``room``, infinite for none, and the portal (n,)."""
        of_room = (self.portal_rooms[self.openings.region] == room).any(axis=1)
        way, portal, _ = _first(self.openings.take(np.flatnonzero(of_room)), origin, direction)
        return way, portal


def _triangles(portals: Portals, centre: np.ndarray) -> Blockers:
    """Portals as fans of triangles, relative to ``centre``; their ``region`` is the portal."""
    sides = np.diff(portals.start) - 2
    corner, portal = ragged(portals.start[:-1] + 1, sides)
    origin = portals.vertices[portals.start[:-1][portal]]
    a, b = portals.vertices[corner] - origin, portals.vertices[corner + 1] - origin
    normal = np.cross(a, b)
    area = np.linalg.norm(normal, axis=1)
    used = area > 1e-12
    normal = normal[used] / area[used, None]
    return flat_blockers(origin[used] - centre, a[used], b[used], np.ones(used.sum(), bool), normal, portal[used])


def _rays(regions: Regions, blockers: Blockers, room_count: int, rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins, directions (n, 3) float32 and rooms (n,): evenly over the surfaces of each room, cosine-distributed about their fronts."""
    corner = blockers.corners.astype(np.float64)
    a, b = corner[:, 1] - corner[:, 0], corner[:, 3] - corner[:, 0]
    area = np.linalg.norm(np.cross(a, b), axis=1) * np.where(blockers.triangle, 0.5, 1.0) * ~regions.buried[blockers.region]
    piece_room = regions.room[blockers.region]
    order = np.argsort(piece_room, kind="stable")
    start = starts_of(piece_room[order], room_count)
    total = np.bincount(piece_room, area, minlength=room_count)
    number = np.where(total > 0, np.maximum(MIN_RAYS, np.round(rays * total / max(total.sum(), 1e-300))), 0).astype(np.int64)
    rank, room = ragged(np.zeros(room_count, np.int64), number)
    running = np.cumsum(area[order])
    before = np.concatenate([np.zeros(1), running])[start[:-1]]
    position = before[room] + (rank + 0.5) / number[room] * total[room]
    piece = order[np.minimum(np.searchsorted(running, position), len(order) - 1)]
    # A Kronecker sequence of four dimensions: place on the piece, and direction.
    s, t, first, second = (
        (0.5 + np.arange(len(room)) * g) % 1.0 for g in (0.8566748838545029, 0.733891856627126, 0.6287067210378087, 0.5385972572236101)
    )
    fold = blockers.triangle[piece] & (s + t > 1.0)
    s, t = np.where(fold, 1.0 - s, s)[:, None], np.where(fold, 1.0 - t, t)[:, None]
    normal, u = blockers.normal[piece], a[piece] / np.linalg.norm(a[piece], axis=1, keepdims=True)
    radius, angle = np.sqrt(first)[:, None], (2.0 * np.pi * second)[:, None]
    direction = radius * (np.cos(angle) * u + np.sin(angle) * np.cross(normal, u)) + np.sqrt(1.0 - radius**2) * normal
    origin = corner[piece, 0] + s * a[piece] + t * b[piece]
    return origin.astype(np.float32), direction.astype(np.float32), room


def _in_a_door(places: _Places, origin: np.ndarray, room: np.ndarray) -> np.ndarray:
    """(n,) bool: the origin lies in an opening of its room. Which way it passes that is chance: it has no distance from there."""
    openings, margin = places.openings, 10 * places.blockers.clearance
    rooms = places.portal_rooms[openings.region]
    low, high = (np.tile(x.astype(np.float64), (2, 1)) for x in (openings.corners.min(axis=1), openings.corners.max(axis=1)))
    out = np.zeros(len(origin), bool)
    tree = BoxTree(low - margin, high + margin, np.concatenate([rooms[:, 0], rooms[:, 1]]))
    for opening, ray in tree.overlaps(origin.astype(np.float64), origin.astype(np.float64), room):
        k = opening % max(len(openings), 1)
        height = np.einsum("ij,ij->i", origin[ray], openings.normal[k]) - openings.offset[k, 0]
        out[ray[np.abs(height) <= margin]] = True
    return out


def _follow(places: _Places, origin: np.ndarray, direction: np.ndarray, room: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rays (n,) from ``room`` (n,) end: the way there (n,) in metres, and the room of a leak (n,), -1 for none."""
    count = len(origin)
    travelled, other = np.zeros(count), np.full(count, -1)
    at, here = origin.copy(), room.astype(np.int64)
    visited = np.full((count, MAX_CROSSINGS + 1), -1)
    alive = np.arange(count)
    for crossing in range(MAX_CROSSINGS + 1):
        visited[alive, crossing] = here[alive]
        alive = alive[np.argsort(here[alive], kind="stable")]
        onward = [np.zeros(0, np.int64)]
        for rows in np.split(alive, np.flatnonzero(np.diff(here[alive])) + 1) if len(alive) else []:
            now = int(here[rows[0]])
            to_door, portal = places.doors_of(now, at[rows], direction[rows])
            to_wall, owner = places.surfaces(now, at[rows], direction[rows], np.isinf(to_door))
            passes = to_door < to_wall
            foreign = ~passes & (owner >= 0) & (owner[:, None] != visited[rows, : crossing + 1]).all(axis=1)
            other[rows[foreign]] = owner[foreign]
            step = np.where(passes, to_door, np.where(np.isfinite(to_wall), to_wall, 0.0))
            travelled[rows] += step
            going = rows[passes]
            at[going] += step[passes, None].astype(np.float32) * direction[going]
            here[going] = places.portal_rooms[portal[passes]].sum(axis=1) - now
            onward.append(going[here[going] != OUTSIDE])
        alive = np.concatenate(onward)
    return travelled, other


def _first(blockers: Blockers, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Way (n,) to what rays meet first, infinite for nothing; its ``region`` (n,), -1 for nothing; and (n,) bool met from behind."""
    hits = first_hits(blockers, origin, direction)
    way, region = np.full(len(origin), np.inf), np.full(len(origin), -1)
    met = np.flatnonzero(hits.blocker >= 0)
    blocker = hits.blocker[met]
    height = np.einsum("ij,ij->i", origin[met], blockers.normal[blocker]) - blockers.offset[blocker, 0]
    way[met] = -height / np.einsum("ij,ij->i", direction[met], blockers.normal[blocker])
    region[met] = blockers.region[blocker]
    return way, region, hits.behind
