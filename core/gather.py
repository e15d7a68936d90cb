"""Final gathering: the reflected light that a point receives, by rays to the exitance that the solution found around it.

What a room sees of other rooms comes through its portals. So a point in a room looks twice: with rays over its whole
hemisphere, which end at the surfaces of the room and find nothing in a portal, and with rays through places spread over
each portal, which find what lies behind. A room that is lit through a small door alone is seen as finely as any other.
Near a portal the two change roles: there rays of the hemisphere pass it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from . import transport
from .building import Building
from .exitance_map import ExitanceMap
from .glass import through_panes
from .occlusion import Blockers, hemisphere, kronecker
from .parallel import Crew
from .ray_fans import Faces, Sights, Workspace, aimed, directed, faces_of, look, shelves
from .short_paths import Ends, close, ends_of, followed, joined

NEAR = 0.1
"""Form factor of a portal from which the rays of the hemisphere are enough of them."""
PORTAL_SHARE = 0.25
"""Most rays to a portal, as a part of those of the hemisphere."""
PORTAL_DENSITY = 10.0
"""Rays to a portal over those of the hemisphere that it takes the place of."""
BLOCK_POINTS = 1024
SHELF, SHEAF = 16, 96
"""Neighbouring points, and neighbouring rays of each, that share the choice of the surfaces that they may meet."""


@dataclass(frozen=True)
class Gathered:
    """Reflected irradiance (n, c) float32, W/m2, in the channels of the exitance map, at the points ``index`` (n,)."""

    index: np.ndarray
    irradiance: np.ndarray


@dataclass(frozen=True)
class _Room:
    """What the points of a room may meet.

    frames : its portals that lead to other rooms, transmittance : (p,) of each
    all_round : faces for rays over the hemisphere, where these end in all portals, and then where they pass the first, second, ..
    beyond : for each portal, the faces behind it and in the room;  glass : for each portal, what dims the light behind it once more
    """

    frames: Blockers
    transmittance: np.ndarray
    all_round: tuple[Faces, ...]
    beyond: tuple[Faces, ...]
    glass: tuple[_Glass | None, ...]


@dataclass(frozen=True)
class _Glass:
    """Panes that rays through a portal may meet after it, where there are any; what lies in the room next to it is seen through none.

    next : (P,) bool, pieces in the room behind the portal;  transmittance : (K,) of all portals
    """

    panes: Blockers
    next: np.ndarray
    transmittance: np.ndarray

    def dimmed(self, sights: Sights, origins: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """(s,) part of the light that passes from what rays (s, 3) from ``origins`` (s, 3) meet."""
        out = np.ones(len(sights.piece), np.float32)
        far = np.flatnonzero(~self.next[sights.piece])
        if len(far):
            end = origins[far] + rays[far] / sights.near[far, None]
            out[far] = through_panes(self.panes, self.transmittance, origins[far], end)
        return out


def gather(building: Building, exitance: ExitanceMap, points: np.ndarray, region: np.ndarray, rays: int, crew: Crew) -> Iterator[Gathered]:
    """Reflected irradiance at points (N, 3) float32 (relative to the scene's centre) on the fronts of ``region`` (N,).

    rays : over the hemisphere of each point
    """
    regions = building.regions
    order = np.lexsort((np.arange(len(region)), region, regions.room[region]))
    room = regions.room[region[order]]
    cuts = np.flatnonzero(np.diff(room)) + 1
    blocks = [part for rows in np.split(order, cuts) if len(rows) for part in np.array_split(rows, -(-len(rows) // BLOCK_POINTS))]
    yield from crew.map(_block, (building, exitance, points, region, rays), blocks)


def _block(building: Building, exitance: ExitanceMap, points: np.ndarray, region: np.ndarray, rays: int, index: np.ndarray) -> Gathered:
    """Light at the points ``index`` (k,), all in one room."""
    room = _room(building, int(building.regions.room[region[index[0]]]))
    return _gather(building, room, exitance, index, points[index], region[index], rays)


def _room(building: Building, room: int) -> _Room:
    regions, doors = building.regions, building.doors
    clusters = np.flatnonzero(building.clusters.room == room)
    inside = building.blockers_of(building.regions_of(clusters)[0])
    open_ = np.flatnonzero((doors.rooms == room).any(1) & (doors.rooms >= 0).all(1))
    frames = doors.frames.take(open_)
    near = building.blockers_of(building.regions_of(building.surroundings(clusters))[0])
    near_room = regions.room[near.region]
    everything = np.arange(len(open_))
    all_round, beyond, glass = [faces_of(inside, frames)], [], []
    piece_room = regions.room[building.blockers.region]
    for k, (first, second) in zip(range(len(open_)), doors.rooms[open_], strict=True):
        other = second if first == room else first
        reached = _reached(doors.rooms, building.room_count, room, other)
        # The normal of a portal runs from its first room to its second.
        side = 1.0 if first == room else -1.0
        height = side * (near.corners @ frames.normal[k] - frames.offset[k, 0])
        behind = (height.max(1) > near.clearance) & reached[near_room]
        found = near.take(np.flatnonzero(behind | (near_room == room)))
        all_round.append(faces_of(found, frames.take(everything[everything != k])))
        beyond.append(faces_of(found, frames.take(everything[:0])))
        reached[room] = True
        after = (doors.rooms >= 0).all(1) & reached[doors.rooms].all(1) & (np.arange(len(doors.rooms)) != open_[k])
        panes = doors.panes.take(np.flatnonzero(after[doors.panes.region]))
        glass.append(_Glass(panes, piece_room == other, doors.transmittance) if len(panes) else None)
    return _Room(frames, doors.transmittance[open_], tuple(all_round), tuple(beyond), tuple(glass))


def _reached(links: np.ndarray, count: int, room: int, start: int) -> np.ndarray:
    """(count,) bool rooms that can be reached from ``start`` over portals ``links`` (K, 2) without passing ``room``."""
    links = links[(links >= 0).all(1) & (links != room).all(1)]
    reached = np.zeros(count, bool)
    reached[start] = True
    while True:
        more = links[reached[links].any(1)]
        if reached[more].all():
            return reached
        reached[more] = True


@dataclass(frozen=True)
class _Sheaves:
    """The rays of a hemisphere in bundles of neighbours.

    direction : (r, 3), bundle after bundle;  start : (t + 1,);  axis : (t, 3) unit, angle : (t,) a cone around each bundle
    """

    direction: np.ndarray
    start: np.ndarray
    axis: np.ndarray
    angle: np.ndarray


@lru_cache(maxsize=8)
def ray_sheaves(rays: int) -> _Sheaves:
    direction = hemisphere(rays)
    bundles = [np.arange(rays)]
    for turn in range(max(0, round(float(np.log2(rays / SHEAF))))):
        halves = []
        for rows in bundles:
            rows = rows[np.argsort(direction[rows, turn % 2], kind="stable")]
            halves += np.array_split(rows, 2)
        bundles = halves
    axis = np.array([direction[rows].mean(0) for rows in bundles])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.array([np.arccos(np.clip(direction[rows] @ d, -1, 1)).max() for rows, d in zip(bundles, axis, strict=True)])
    start = np.concatenate([[0], np.cumsum([len(rows) for rows in bundles])])
    return _Sheaves(direction[np.concatenate(bundles)], start, axis, angle)


def _gather(building: Building, room: _Room, exitance: ExitanceMap, index, points, region, rays: int) -> Gathered:
    frame = np.stack([building.regions.u[region], building.regions.v[region], building.regions.normal[region]], axis=1)
    normals = frame[:, 2].astype(np.float32)
    count = len(room.frames)
    form = np.zeros((len(points), count))
    for k in range(count):
        form[:, k] = _form(points, normals, room.frames.corners[k])
    clear = form * (room.transmittance == 1)  # what is behind glass is seen through it alone, and dimmed
    near = np.where(clear.max(1, initial=0) > NEAR, clear.argmax(1), -1) if count else np.full(len(points), -1)
    out, work, ends = np.zeros((len(points), exitance.channels)), Workspace(), []
    # Points that face one way share the directions of their rays, whatever surface they lie on.
    frames, way = np.unique(np.round(frame, 6).reshape(-1, 9), axis=0, return_inverse=True)
    way = way.reshape(-1)
    for portal in np.unique(near):
        for k in np.unique(way[near == portal]):
            rows = np.flatnonzero((near == portal) & (way == k))
            ends += _over_hemisphere(
                room, int(portal), frames[k].reshape(3, 3), building.blockers.normal, exitance, points, rows, rays, work, out
            )
    for portal in range(count):
        rows = np.flatnonzero((form[:, portal] > 0) & (near != portal))
        corners = room.frames.corners[portal]
        # A small portal needs few rays: still many times as many as those of the hemisphere that it takes the place of.
        most = max(8, int(rays * PORTAL_SHARE))
        number = np.clip(PORTAL_DENSITY * rays * form[rows, portal], 8, most)
        number = 8 * 2 ** np.floor(np.log2(number / 8)).astype(np.int64)
        for n in np.unique(number):
            mine = rows[number == n]
            dimmed = form[:, portal] * room.transmittance[portal]
            _through(room.beyond[portal], room.glass[portal], corners, exitance, points, normals, dimmed, mine, int(n), work, out)
    if ends:
        row, share, places = (np.concatenate([e[j] for e in ends]) if j < 2 else joined([e[j] for e in ends]) for j in range(3))
        light = share[:, None] * followed(places, room.all_round, room.beyond, room.transmittance, building.blockers.normal, exitance, work)
        _add(out, row, light / rays)
    return Gathered(index, out.astype(np.float32))


def _add(out: np.ndarray, row: np.ndarray, light: np.ndarray) -> None:
    """Add light (s, c) to ``out`` (n, c) at ``row`` (s,)."""
    for k in range(out.shape[1]):
        out[:, k] += np.bincount(row, light[:, k], minlength=len(out))


def _over_hemisphere(
    room: _Room, portal: int, frame: np.ndarray, blocker_normals: np.ndarray, exitance: ExitanceMap, points, rows, rays: int, work, out
) -> list[tuple[np.ndarray, np.ndarray, Ends]]:
    """Add to ``out`` (n, c) what rays over the hemisphere find from the points ``rows``, all with one frame (3, 3), near ``portal`` or -1.

    Returns the rays that end close by, which have not been counted: their points, what part of their light arrives, and ends.
    """
    faces, glass = room.all_round[portal + 1], room.glass[portal] if portal >= 0 else None
    ends = []
    sheaves = ray_sheaves(rays)
    direction, axis = (sheaves.direction @ frame).astype(np.float32), sheaves.axis @ frame
    normal = frame[2].astype(np.float32)
    top = (faces.corners @ normal).max(1)
    for part, centre, radius in shelves(points, rows, SHELF):
        found = np.zeros((len(part), exitance.channels))
        ahead = top > (points[part] @ normal).min() + faces.clearance
        seen = faces.toward(centre, radius, axis, sheaves.angle) & ahead[:, None]
        for t in range(len(axis)):
            here = slice(sheaves.start[t], sheaves.start[t + 1])
            some = faces.take(np.flatnonzero(seen[:, t]))
            for sights in look(some, directed(some, direction[here]), exitance, points[part], work):
                near = close(sights, exitance, normal, blocker_normals)
                far, near = np.flatnonzero(~near), np.flatnonzero(near)
                light, share = exitance.all_of(sights.texel[far]), np.float32(1)
                if glass is not None:
                    share = glass.dimmed(sights, points[part[sights.point]], direction[here][sights.ray])
                    light *= share[far, None]
                _add(found, sights.point[far], light)
                if len(near):
                    share = np.broadcast_to(share, len(sights.piece))[near]
                    sights = sights.take(near)
                    row = part[sights.point]
                    ends.append((row, share, ends_of(sights, points[row], direction[here][sights.ray], portal)))
        out[part] += found / rays
    return ends


def _through(
    faces: Faces,
    glass: _Glass | None,
    portal: np.ndarray,
    exitance: ExitanceMap,
    points,
    normals,
    form,
    rows,
    rays: int,
    work: Workspace,
    out,
) -> None:
    """Add to ``out`` (n, c) what rays to places in a portal (4, 3) find behind it from the points ``rows``."""
    places = _places(portal, rays)
    middle = portal.mean(0)
    size = float(np.linalg.norm(portal - middle, axis=1).max())
    across = np.cross(portal[1] - portal[0], portal[3] - portal[0])
    for part, centre, radius in shelves(points, rows, SHELF):
        axis = middle - centre
        distance = max(float(np.linalg.norm(axis)), 1e-9)
        angle = np.arcsin((size + radius) / distance) if size + radius < distance else np.pi
        some = faces.take(np.flatnonzero(faces.toward(centre, radius, axis[None] / distance, np.array([angle]))[:, 0]))
        offset = places - points[part, None]
        squared = (offset * offset).sum(2)
        # Both cosines over the squared distance; the ratio to the exact form factor takes the constant.
        weight = np.maximum(np.einsum("nrc,nc->nr", offset, normals[part]), 0) * np.abs(offset @ across)
        weight /= squared * squared
        weight *= (form[part] / np.maximum(weight.sum(1), 1e-30))[:, None]
        found = np.zeros((len(part), exitance.channels))
        for sights in look(some, aimed(some, places), exitance, points[part], work):
            share = weight[sights.point, sights.ray]
            if glass is not None:
                share = share * glass.dimmed(sights, points[part[sights.point]], offset[sights.point, sights.ray])
            _add(found, sights.point, exitance.all_of(sights.texel) * share[:, None])
        out[part] += found


def _form(points: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) form factor of a portal (4, 3) from points (n, 3)."""
    return transport.lambert(points, normals, np.broadcast_to(corners, (len(points), 4, 3)))


def _places(corners: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) places spread evenly over a parallelogram (4, 3)."""
    x, y = kronecker(np.arange(count) + 1)
    return (corners[0] + x[:, None] * (corners[1] - corners[0]) + y[:, None] * (corners[3] - corners[0])).astype(np.float32)
