"""Final gathering: the reflected light that a point receives, by rays to the exitance that the solution found around it.

What a room sees of other rooms comes through its portals. So a point in a room looks twice: with rays over its whole
hemisphere, which end at the surfaces of the room and find nothing in a portal, and with rays through places spread over
each portal, which find what lies behind. A room that is lit through a small door alone is seen as finely as any other.
Near a portal the two change roles: there rays of the hemisphere pass it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import transport
from .building import Building
from .exitance_map import ExitanceMap
from .occlusion import Blockers, hemisphere
from .parallel import ordered_map

NEAR = 0.1
"""Form factor of a portal from which the rays of the hemisphere are enough of them."""
PORTAL_SHARE = 0.25
"""Rays to a portal, as a part of those of the hemisphere."""
SAME = np.float32(1 + 1e-3)
"""Surfaces this little nearer than a portal are behind it: walls that a portal lies in."""
SEAM = np.float32(1 - 1e-5)
BLOCK_POINTS = 1024
SHELF = 64
"""Points facing one way that share the choice of the surfaces in front of them."""
_CELLS = 1 << 19
"""Pairs of ray and blocker that are compared at once: a handful of such arrays stay in the cache."""


@dataclass(frozen=True)
class Gathered:
    """Reflected irradiance (n, 3) float32, W/m2, at the points ``index`` (n,), and the ray-blocker tests that it took."""

    index: np.ndarray
    irradiance: np.ndarray
    tests: int


@dataclass(frozen=True)
class _Faces:
    """Blockers as rays meet them: parallelograms first, then triangles, then ``stops`` portals, where rays end and find nothing.

    normal, dual_x, dual_y : (K, 3) float32;  offset : (K, 3);  quads : number of parallelograms;  id : (K,) of the blockers
    """

    normal: np.ndarray
    dual_x: np.ndarray
    dual_y: np.ndarray
    offset: np.ndarray
    quads: int
    stops: int
    id: np.ndarray
    clearance: float


@dataclass(frozen=True)
class _Room:
    """What the points of a room may meet.

    inside : its own surfaces;  frames : its portals that lead to other rooms
    beyond : for each of them, all surfaces behind it and in the room
    """

    inside: Blockers
    frames: Blockers
    beyond: tuple[Blockers, ...]


def gather(
    building: Building, exitance: ExitanceMap, points: np.ndarray, region: np.ndarray, rays: int, workers: int
) -> Iterator[Gathered]:
    """Reflected irradiance at points (N, 3) float32 (relative to the scene's centre) on the fronts of ``region`` (N,).

    rays : over the hemisphere of each point
    """
    regions = building.regions
    order = np.lexsort((np.arange(len(region)), region, regions.room[region]))
    room = regions.room[region[order]]
    cuts = np.flatnonzero(np.diff(room)) + 1
    blocks = [part for rows in np.split(order, cuts) if len(rows) for part in np.array_split(rows, -(-len(rows) // BLOCK_POINTS))]
    rooms: dict[int, _Room] = {}

    def light(index: np.ndarray) -> Gathered:
        here = int(regions.room[region[index[0]]])
        if here not in rooms:
            rooms[here] = _room(building, here)
        return _gather(building, rooms[here], exitance, index, points[index], region[index], rays)

    yield from ordered_map(light, blocks, workers)


def _room(building: Building, room: int) -> _Room:
    regions, doors = building.regions, building.doors
    clusters = np.flatnonzero(building.clusters.room == room)
    inside = building.blockers_of(building.regions_of(clusters)[0])
    open_ = np.flatnonzero((doors.rooms == room).any(1) & (doors.rooms >= 0).all(1))
    frames = doors.frames.take(open_)
    near = building.blockers_of(building.regions_of(building.surroundings(clusters))[0])
    near_room = regions.room[near.region]
    beyond = []
    for k, (first, second) in zip(range(len(open_)), doors.rooms[open_], strict=True):
        reached = _reached(doors.rooms, building.room_count, room, second if first == room else first)
        # The normal of a portal runs from its first room to its second.
        side = 1.0 if first == room else -1.0
        height = side * (near.corners @ frames.normal[k] - frames.offset[k, 0])
        behind = (height.max(1) > near.clearance) & reached[near_room]
        beyond.append(near.take(np.flatnonzero(behind | (near_room == room))))
    return _Room(inside, frames, tuple(beyond))


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


def _faces(blockers: Blockers, stops: Blockers) -> _Faces:
    """Parallelograms are a trifle larger than they are, so that no ray slips through the seam of two."""
    order = np.argsort(blockers.triangle, kind="stable")
    parts = [np.concatenate([getattr(blockers, name)[order], getattr(stops, name)]) for name in ("normal", "dual_x", "dual_y", "offset")]
    parts[1:3] = (m * SEAM for m in parts[1:3])
    parts[3][:, 1:] *= SEAM
    ids = np.concatenate([blockers.id[order], np.full(len(stops), -1)])
    return _Faces(*parts, int((~blockers.triangle).sum()), len(stops), ids, blockers.clearance)


@dataclass(frozen=True)
class _Fan:
    """r rays of one shape from every point, as faces k see them; distances are measured in units of each ray.

    Hemisphere: unit directions, the same for all points. Portal: from each point to the same places, at distance 1.
    along, across_x, across_y : (r, K) float32, directions or places in the coordinates of the faces
    begin : 1 over the distance of what ``along`` zero stands for, 0 for directions and 1 for places
    """

    along: np.ndarray
    across_x: np.ndarray
    across_y: np.ndarray
    begin: float


def _directions(faces: _Faces, directions: np.ndarray) -> _Fan:
    return _Fan(*(directions @ m.T for m in (faces.normal, faces.dual_x, faces.dual_y)), 0.0)


def _targets(faces: _Faces, places: np.ndarray) -> _Fan:
    return _Fan(*(places @ m.T - faces.offset[:, k] for k, m in enumerate((faces.normal, faces.dual_x, faces.dual_y))), 1.0)


def _gather(building: Building, room: _Room, exitance: ExitanceMap, index, points, region, rays: int) -> Gathered:
    frame = np.stack([building.regions.u[region], building.regions.v[region], building.regions.normal[region]], axis=1)
    normals = frame[:, 2].astype(np.float32)
    count = len(room.frames)
    form = np.zeros((len(points), count))
    for k in range(count):
        form[:, k] = _form(points, normals, room.frames.corners[k])
    near = np.where(form.max(1, initial=0) > NEAR, form.argmax(1), -1) if count else np.full(len(points), -1)
    out, tests = np.zeros((len(points), 3)), 0
    # Points that face one way share the directions of their rays, whatever surface they lie on.
    frames, way = np.unique(np.round(frame, 6).reshape(-1, 9), axis=0, return_inverse=True)
    frames, way = frames.reshape(-1, 3, 3), way.reshape(-1)
    for portal in np.unique(near):
        stops = room.frames.take(np.flatnonzero(np.arange(count) != portal))
        blockers = room.inside if portal < 0 else room.beyond[portal]
        for k in np.unique(way[near == portal]):
            mine = np.flatnonzero((near == portal) & (way == k))
            level = points[mine] @ frames[k, 2].astype(np.float32)
            order = np.argsort(level, kind="stable")
            top = (blockers.corners @ frames[k, 2].astype(np.float32)).max(1)
            directions = (hemisphere(rays) @ frames[k]).astype(np.float32)
            for part in np.array_split(order, -(-len(order) // SHELF)):
                faces = _faces(blockers.take(np.flatnonzero(top > level[part[0]] + blockers.clearance)), stops)
                fan = _directions(faces, directions)
                for rows in _chunks(mine[part], rays, len(faces.id)):
                    out[rows] += _look(faces, fan, exitance, points[rows]).mean(1)
                    tests += len(rows) * rays * len(faces.id)
    number = max(8, int(rays * PORTAL_SHARE))
    for portal in range(count):
        mine = np.flatnonzero((form[:, portal] > 0) & (near != portal))
        if not len(mine):
            continue
        faces = _faces(room.beyond[portal], room.frames.take(np.zeros(0, np.int64)))
        places = _places(room.frames.corners[portal], number)
        fan = _targets(faces, places)
        for rows in _chunks(mine, number, len(faces.id)):
            offset = places - points[rows, None]
            squared = (offset * offset).sum(2)
            # Both cosines over the squared distance; the ratio to the exact form factor takes the constant.
            weight = np.maximum(np.einsum("nrc,nc->nr", offset, normals[rows]), 0) * np.abs(offset @ room.frames.normal[portal])
            weight /= squared * squared
            weight *= (form[rows, portal] / np.maximum(weight.sum(1), 1e-30))[:, None]
            out[rows] += np.einsum("nr,nrc->nc", weight, _look(faces, fan, exitance, points[rows]))
            tests += len(rows) * number * len(faces.id)
    return Gathered(index, out.astype(np.float32), tests)


def _chunks(rows: np.ndarray, rays: int, faces: int) -> list[np.ndarray]:
    step = max(1, _CELLS // max(1, rays * faces))
    return [rows[k : k + step] for k in range(0, len(rows), step)]


def _look(faces: _Faces, fan: _Fan, exitance: ExitanceMap, points: np.ndarray) -> np.ndarray:
    """(n, r, 3) exitance that the rays of a fan from points (n, 3) meet first, zero at backs and portals.

    To places only what lies behind them counts: a ray is blocked by what is nearer. With w = 1 / distance along the ray a face is met
    where |x w| <= w and |y w| <= w, and all three are linear in the direction: no divisions, and the nearest face has the greatest w.
    """
    out = np.zeros((len(points), len(fan.along), 3), np.float32)
    if not len(faces.id):
        return out
    height = points @ faces.normal.T
    height -= faces.offset[:, 0]
    x0, y0 = (points @ d.T - faces.offset[:, k] for k, d in ((1, faces.dual_x), (2, faces.dual_y)))
    clear = np.abs(height) > faces.clearance
    scale = np.where(clear, -1 / np.where(clear, height, 1), 0).astype(np.float32)
    w = scale[:, None] * fan.along
    x = x0[:, None] * w
    x += fan.across_x
    y = y0[:, None] * w
    y += fan.across_y
    if fan.begin:
        w += np.float32(fan.begin)
        w *= clear[:, None]
    _meet(w, x, y, faces)
    if faces.stops:
        w[..., -faces.stops :] *= SAME
    best = w.argmax(2)
    row = np.arange(len(points))[:, None]
    found = np.take_along_axis(w, best[..., None], 2)[..., 0]
    lit = (found > 0) & (height[row, best] > 0) & (faces.id[best] >= 0)
    if fan.begin:
        lit &= found <= fan.begin * SAME
    p, r = np.nonzero(lit)
    k, w = best[p, r], found[p, r]
    sx, sy = ((z[p, k] * (w - np.float32(fan.begin)) + across[r, k]) / w for z, across in ((x0, fan.across_x), (y0, fan.across_y)))
    quad = k < faces.quads
    sx, sy = (np.clip(np.where(quad, 0.5 * s + 0.5, s), 0, 1) for s in (sx, sy))
    out[p, r] = exitance.at(faces.id[k], sx, sy)
    return out


def _meet(w: np.ndarray, x: np.ndarray, y: np.ndarray, faces: _Faces) -> None:
    """Set ``w`` (n, r, K) to zero where the ray misses the face; x and y are used up."""
    end = w.shape[2] - faces.stops
    for part in (slice(0, faces.quads), slice(end, w.shape[2])):
        if part.start < part.stop:
            a, b, c = w[..., part], x[..., part], y[..., part]
            np.abs(b, out=b)
            np.abs(c, out=c)
            np.maximum(b, c, out=b)
            a *= b <= a
    if faces.quads < end:
        part = slice(faces.quads, end)
        a, b, c = w[..., part], x[..., part], y[..., part]
        a *= (b >= 0) & (c >= 0) & (b + c <= a)


def _form(points: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) form factor of a portal (4, 3) from points (n, 3)."""
    return transport.lambert(points, normals, np.broadcast_to(corners, (len(points), 4, 3)))


def _places(corners: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) places spread evenly over a parallelogram (4, 3)."""
    k = np.arange(count)
    x, y = ((0.5 + (k + 1) * step) % 1 for step in (0.7548776662466927, 0.5698402909980532))
    return (corners[0] + x[:, None] * (corners[1] - corners[0]) + y[:, None] * (corners[3] - corners[0])).astype(np.float32)
