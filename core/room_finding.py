"""Rooms from surfaces and portals alone: the free space falls into parts where surfaces and portals close it off.

The space is filled with cells. Those that a surface or a portal passes through are closed; what hangs together of the others is a
room, the outside, or a hollow such as that between the two sheets of a wall. A hole of less than a cell closes itself.
Through a wider one a room hangs together with the outside: there the space is made narrower from all sides until the two part, and
where they meet again when they grow back lies the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import OUTSIDE
from .voxels import Grid, eroded, grid_around, grown, occupied, parts, sample

CELL = 0.08
"""Edge of a cell, metres; larger where a building would take more than ``MOST_CELLS``."""
MOST_CELLS = 8_000_000
HOLLOW = -2
"""In place of a room: a space that is closed but no room, or so narrow that no cell fits into it."""
MIN_VOLUME, MIN_HEIGHT = 1.0, 1.2
"""Least volume of a room, m3, and least height of one that no portal leads into, metres: the space under a bed is none."""
WHOLE_SCALE = 3.0
"""A building smaller than this, metres, is a model: all lengths here shrink with it."""
WIDEST_GAP = 1.4
"""A hole to the outside up to this width is a gap in a room, metres; through a wider one the room is a part of the outside."""
_AHEAD = (0.75, 1.25, 1.6)
"""Where the air in front of a surface is looked for, in cells: not so far that it could be the air behind a wall."""
SEEN_IN = 0.25
"""An object that has so many m2 in a room is in that room, however large it is elsewhere."""
_NEAR = 6
"""Cells around a point in which :meth:`FoundRooms.near` looks."""
_SAMPLES = 4.0
"""Distance of the places of a surface at which that is done, in cells."""


@dataclass(frozen=True)
class Gap:
    """A hole between a room and the outside. place : (3,) its middle;  inside : (3,) a place in the room near it

    width : metres, the side of a square as large as the hole, about
    """

    room: int
    place: np.ndarray
    inside: np.ndarray
    width: float


@dataclass(frozen=True)
class FoundRooms:
    """The rooms of a building (R rooms, P polygons, K portals); lengths in metres.

    front, back : (P,) int64, the room that most of the front and of the back of every polygon looks into, OUTSIDE, or HOLLOW
    spread : (P, R) float64, m2 of the front of each polygon that look into each room
    volume : (R,) m3 of free space;  inside : (R, 3) a place far from all walls;  low, high : (R, 3) boxes of the free space
    portal_rooms : (K, 2) int64, the rooms behind and in front of every portal, as ``front``
    gaps : holes to the outside that no portal closes;  lid : the top of the building was taken as closed, for no room has a ceiling
    grid, room_of_cell : the cells, and (N,) the room of each as ``front``
    """

    front: np.ndarray
    back: np.ndarray
    spread: np.ndarray
    volume: np.ndarray
    inside: np.ndarray
    low: np.ndarray
    high: np.ndarray
    portal_rooms: np.ndarray
    gaps: tuple[Gap, ...]
    lid: bool
    grid: Grid
    room_of_cell: np.ndarray

    @property
    def cell(self) -> float:
        """Edge of a cell, metres; what is narrower is not seen."""
        return self.grid.size

    def __len__(self) -> int:
        return len(self.volume)

    def near(self, point: np.ndarray) -> np.ndarray:
        """(n,) int64 the room of the cell of a room nearest to each point (n, 3) within ``_NEAR`` cells, OUTSIDE where there is none."""
        around = np.stack(np.meshgrid(*3 * [np.arange(-_NEAR, _NEAR + 1)], indexing="ij"), axis=-1).reshape(-1, 3)
        around = around[np.argsort((around**2).sum(axis=1), kind="stable")]
        out = np.full(len(point), OUTSIDE, np.int64)
        for k, place in enumerate(point):
            room = self.room_of_cell[self.grid.cell(place + self.grid.size * around)]
            if (room >= 0).any():
                out[k] = room[(room >= 0).argmax()]
        return out


def find_rooms(
    corners: np.ndarray,
    polygon: np.ndarray,
    portal_corners: np.ndarray,
    portal: np.ndarray,
    cell: float = CELL,
    most_cells: int = MOST_CELLS,
) -> FoundRooms:
    """Sort the surfaces of a building into rooms.

    corners : (T, 3, 3) triangles of all surfaces, metres, counter-clockwise seen from their front
    polygon : (T,) the polygon of each, 0..P-1;  portal_corners : (S, 3, 3) triangles of the portals;  portal : (S,) the portal of each

    Where nothing is closed off, the top of the building is taken as closed: models are often made without ceilings. Where that does not
    help, spaces that only backs look into are rooms: their normals are the wrong way. Rooms are in the order of storeys, then from
    left to right.
    """
    both = np.concatenate([corners, portal_corners]).reshape(-1, 3)
    low, high = both.min(axis=0), both.max(axis=0)
    scale = min(1.0, float((high - low).max()) / WHOLE_SCALE)
    grid = grid_around(low, high, scale * cell, most_cells, 0.5 * scale * WIDEST_GAP)
    free = ~(occupied(grid, corners) | occupied(grid, portal_corners))
    portals = int(portal.max(initial=-1)) + 1
    probes = _Probes.of(grid, corners, polygon, int(polygon.max(initial=-1)) + 1)
    doors = _Probes.of(grid, portal_corners, portal, portals)
    covered = free.copy()
    covered[:, :, np.flatnonzero(~free.all(axis=(0, 1))).max()] = False
    for lid, backs in ((False, False), (True, False), (False, True)):
        space = _Space.of(grid, covered if lid else free, probes, doors, scale, backs)
        if space.count:
            break
    front, back = probes.votes(space), probes.flipped().votes(space)
    ahead = np.stack([_best(doors.flipped().votes(space)), _best(doors.votes(space))], axis=1)
    gaps = () if space.count == 0 else space.gaps
    order, inside, low, high = _order(space)
    rank = np.empty(space.count + 2, np.int64)
    rank[order] = np.arange(space.count)
    rank[space.count :] = OUTSIDE, HOLLOW
    volume = np.bincount(space.room[space.room >= 0], minlength=space.count)[: space.count] * grid.size**3
    return FoundRooms(
        front=rank[_best(front)],
        back=rank[_best(back)],
        spread=front[:, order],
        volume=volume[order],
        inside=inside[order],
        low=low[order],
        high=high[order],
        portal_rooms=rank[ahead],
        gaps=tuple(Gap(int(rank[g.room]), g.place, g.inside, g.width) for g in sorted(gaps, key=lambda g: (rank[g.room], -g.width))),
        lid=bool(lid and space.count),
        grid=grid,
        room_of_cell=rank.astype(np.int32)[np.where(space.room < 0, space.count + 1, space.room)],
    )


def _best(votes: np.ndarray) -> np.ndarray:
    """The column with most votes; hollows, the last one, only where nothing else has any."""
    known = votes[:, :-1]
    return np.where(known.max(axis=1, initial=0) > 0, known.argmax(axis=1), votes.shape[1] - 1)


def rooms_of_objects(spread: np.ndarray) -> np.ndarray:
    """(n, R) bool: the rooms that objects belong to, whose surfaces look into the rooms with ``spread`` (n, R) m2.

    The one that most of it looks into; and any other with a quarter of it, or with ``SEEN_IN`` m2. None where all is zero.
    """
    total = spread.sum(axis=1, keepdims=True)
    main = spread == spread.max(axis=1, keepdims=True, initial=0)
    main &= np.cumsum(main, axis=1) == 1
    return (main | (spread >= 0.25 * total) | (spread >= SEEN_IN)) & (spread > 0)


@dataclass(frozen=True)
class _Probes:
    """Places on surfaces (n,), with the unit normals there, the m2 that each stands for and the polygon (of ``count``) it is on."""

    point: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    polygon: np.ndarray
    count: int

    @classmethod
    def of(cls, grid: Grid, corners: np.ndarray, polygon: np.ndarray, count: int) -> _Probes:
        vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(vector, axis=1)
        used = np.flatnonzero(area > 1e-12)
        point, triangle = sample(corners[used], _SAMPLES * grid.size)
        # Off the edges, where the cells beside them are closed: the places of small triangles come together at their middle.
        point = point + 0.25 * (corners[used].mean(axis=1)[triangle] - point)
        number = np.bincount(triangle, minlength=len(used))
        triangle = used[triangle]
        share = area[triangle] / np.maximum(number, 1)[np.searchsorted(used, triangle)]
        return cls(point, vector[triangle] / area[triangle, None], share, polygon[triangle], count)

    def flipped(self) -> _Probes:
        """The same places, seen from the other side."""
        return _Probes(self.point, -self.normal, self.area, self.polygon, self.count)

    def parts(self, grid: Grid, label: np.ndarray) -> np.ndarray:
        """(n,) label (N,) of the nearest free cell in front of every place, -1 for none."""
        found = np.full(len(self.point), -1, np.int64)
        for step in _AHEAD:
            open_ = np.flatnonzero(found < 0)
            found[open_] = label[grid.cell(self.point[open_] + step * grid.size * self.normal[open_])]
        return found

    def votes(self, space: _Space) -> np.ndarray:
        """(count, R + 2) m2 of every polygon that look into the rooms, the outside and hollows."""
        seen = self.parts(space.grid, space.room)
        column = np.where(seen < 0, space.count + 1, seen)
        out = np.bincount(self.polygon * (space.count + 2) + column, self.area, self.count * (space.count + 2))
        return out.reshape(self.count, space.count + 2)


@dataclass(frozen=True)
class _Space:
    """Which room every cell is in: room (N,) 0..count-1, ``count`` for the outside, -1 for all else; and the gaps between them."""

    grid: Grid
    room: np.ndarray
    count: int
    gaps: tuple[Gap, ...]

    @classmethod
    def of(cls, grid: Grid, free: np.ndarray, probes: _Probes, doors: _Probes, scale: float, backs: bool) -> _Space:
        """``backs``: a space that only backs look into may be a room as well."""
        label, count = parts(free)
        label = label.reshape(-1)
        outside = int(label[0])
        leaky = _leaky_parts(grid, free, label == outside, scale)
        label, count = np.where(leaky >= 0, leaky + count, label), count + int(leaky.max(initial=-1)) + 1
        ahead, behind = probes.parts(grid, label), probes.flipped().parts(grid, label)
        looked = [np.bincount(side[side >= 0], probes.area[side >= 0], count) for side in (ahead, behind)]
        joined = np.concatenate([doors.parts(grid, label), doors.flipped().parts(grid, label)])
        at_door = np.bincount(joined[joined >= 0], minlength=count) > 0
        volume = np.bincount(label[label >= 0], minlength=count) * grid.size**3
        # What mostly backs look into is the inside of a wall or of a cupboard, unless a door leads there.
        fronts = (looked[0] + backs * looked[1] >= 0.5 * looked[1]) & (looked[0] + backs * looked[1] > 0)
        high = _heights(label, grid, count) >= scale * MIN_HEIGHT
        real = (volume >= scale**3 * MIN_VOLUME) & (at_door | (high & fronts))
        real[outside] = False
        number = np.full(count + 1, -1, np.int64)
        number[np.flatnonzero(real)] = np.arange(real.sum())
        number[outside] = real.sum()
        room = number[label].astype(np.int32)
        return cls(grid, room, int(real.sum()), _gaps(grid, room, int(real.sum())))


def _heights(label: np.ndarray, grid: Grid, count: int) -> np.ndarray:
    """(count,) metres from the lowest to the highest cell of every label."""
    layers = label.reshape(grid.shape)
    low, high = np.full(count, grid.shape[2]), np.full(count, -1)
    for k in range(grid.shape[2]):
        here = np.unique(layers[:, :, k])
        here = here[here >= 0]
        low[here], high[here] = np.minimum(low[here], k), k
    return (high - low + 1) * grid.size


def _leaky_parts(grid: Grid, free: np.ndarray, outside: np.ndarray, scale: float) -> np.ndarray:
    """(N,) number of the parts of the ``outside`` (N,) that hang together with it by a gap only, -1 for all else."""
    number = np.full(outside.shape, -1, np.int64)
    open_ = outside.reshape(free.shape)
    rim = np.zeros(free.shape, bool)
    rim[0], rim[-1], rim[:, 0], rim[:, -1], rim[:, :, 0], rim[:, :, -1] = (True,) * 6
    narrow, found = open_, 0
    seeds = np.full(outside.shape, -1, np.int64)
    for _ in range(max(1, round(0.5 * scale * WIDEST_GAP / grid.size))):
        narrow = eroded(narrow)
        label, count = parts(narrow)
        if count < 2:
            continue
        label = label.reshape(-1)
        volume = np.bincount(label[label >= 0], minlength=count) * grid.size**3
        known = np.bincount(label[(label >= 0) & (seeds >= 0)], minlength=count) > 0
        fresh = (volume >= scale**3 * MIN_VOLUME) & ~known
        fresh[label[0]] = False
        for part in np.flatnonzero(fresh):
            seeds[label == part] = found
            found += 1
        away = label == label[0]
    if found == 0:
        return number
    seeds[(seeds < 0) & (away | rim.reshape(-1))] = found
    spread = grown(grid, np.where(rim.reshape(-1), -1, seeds), outside & ~rim.reshape(-1))
    return np.where(spread == found, -1, spread)


def _gaps(grid: Grid, room: np.ndarray, count: int) -> tuple[Gap, ...]:
    """Where rooms and the outside touch cell to cell, each place once."""
    box = room.reshape(grid.shape)
    touch = np.zeros(grid.shape, bool)
    for axis in range(3):
        a, t = np.moveaxis(box, axis, 0), np.moveaxis(touch, axis, 0)
        t[:-1] |= (a[:-1] >= 0) & (a[:-1] < count) & (a[1:] == count)
        t[1:] |= (a[1:] >= 0) & (a[1:] < count) & (a[:-1] == count)
    if not touch.any():
        return ()
    # Cells that touch by an edge only belong together as well: so do those that lie three apart at most.
    near, places = parts(~eroded(~touch))
    gaps = []
    cell = np.flatnonzero(touch.reshape(-1))
    place = near.reshape(-1)[cell]
    for k in range(places):
        own = cell[place == k]
        for r in np.unique(room[own]):
            side = own[room[own] == r]
            middle = grid.middle(side).mean(axis=0)
            nearest = grid.middle(side)[np.linalg.norm(grid.middle(side) - middle, axis=1).argmin()]
            gaps.append(Gap(int(r), middle, nearest, float(np.sqrt(len(side)) * grid.size)))
    return tuple(gaps)


def _order(space: _Space) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The order of the rooms, and in their old order a place inside each, and their boxes."""
    inside, low, high = (np.zeros((space.count, 3)) for _ in range(3))
    box = space.room.reshape(space.grid.shape)
    for r in range(space.count):
        here = np.stack(np.nonzero(box == r))
        first, last = here.min(axis=1), here.max(axis=1) + 1
        low[r], high[r] = (space.grid.low + space.grid.size * end for end in (first, last))
        shape = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        left = np.pad(box[shape] == r, 1)
        while (less := eroded(left))[1:-1, 1:-1, 1:-1].any():
            left = less
        deep = np.stack(np.nonzero(left)) - 1
        middle = deep[:, np.abs(deep - deep.mean(axis=1, keepdims=True)).sum(axis=0).argmin()]
        inside[r] = space.grid.low + space.grid.size * (first + middle + 0.5)
    return np.lexsort((np.round(low[:, 1], 1), np.round(low[:, 0], 1), np.round(low[:, 2] / 1.5))), inside, low, high
