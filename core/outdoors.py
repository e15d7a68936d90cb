"""Which surfaces see the outside where no portal is: faces of the building's outer side, and rooms without a roof or a wall.

Light from outside comes to all others through portals alone, which spares them most of the search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .building import Building
from .escape import LEAK
from .grouping import ragged
from .occlusion import Blockers, first_hits, kronecker
from .scene import OUTSIDE

RAYS = 48
"""Rays from each region."""
OUTER = 0.5
"""Part of its rays that a face of the outer side of a building loses at least; rooms are judged by the others."""
_BLOCK = 1 << 14


@dataclass(frozen=True)
class Outdoors:
    """rooms : (R,) bool, open to the outside beyond their portals;  regions : (G,) bool, those of such rooms and outer faces."""

    rooms: np.ndarray
    regions: np.ndarray


def outdoors_of(building: Building) -> Outdoors:
    """Judge regions and rooms by rays that meet neither a surface nor a portal of their room."""
    regions, doors = building.regions, building.doors
    lost = np.zeros(len(regions))
    for room in range(building.room_count):
        own = np.flatnonzero((regions.room == room) & ~regions.buried)
        if not len(own):
            continue
        clusters = np.flatnonzero(building.clusters.room == room)
        near = building.blockers_of(building.regions_of(building.surroundings(clusters))[0])
        near = near.joined(doors.frames.take(np.flatnonzero((doors.rooms == room).any(1))))
        for start in range(0, len(own), _BLOCK // RAYS):
            some = own[start : start + _BLOCK // RAYS]
            lost[some] = _lost(building, some, near)
    outer = lost > OUTER
    weight = regions.area * ~outer * ~regions.buried
    count = building.room_count
    total = np.bincount(regions.room, weight, minlength=count)
    share = np.bincount(regions.room, weight * lost, minlength=count) / np.maximum(total, 1e-300)
    rooms = np.where(total > 0, share > LEAK, True)
    return Outdoors(rooms, outer | rooms[regions.room])


def _lost(building: Building, region: np.ndarray, near: Blockers) -> np.ndarray:
    """(n,) part of the rays from regions (n,) that meet nothing."""
    regions = building.regions
    owner = np.repeat(region, RAYS)
    # Places in the pieces of a region by their area, and directions by the cosine.
    members, row = ragged(regions.piece_start[region], np.diff(regions.piece_start)[region])
    a, b = regions.piece_a[members], regions.piece_b[members]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) * np.where(regions.piece_triangle[members], 0.5, 1.0)
    running = np.cumsum(area)
    end = running[np.searchsorted(row, np.arange(len(region)), side="right") - 1]
    begin = np.concatenate([[0.0], end[:-1]])
    k = np.arange(len(owner))
    which = np.repeat(begin, RAYS) + (k % RAYS + 0.5) / RAYS * np.repeat(end - begin, RAYS)
    piece = np.minimum(np.searchsorted(running, which), len(members) - 1)
    x, y = kronecker(k)
    over = regions.piece_triangle[members[piece]] & (x + y > 1)
    x, y = np.where(over, 1 - x, x), np.where(over, 1 - y, y)
    uv = regions.piece_origin[members[piece]] + x[:, None] * a[piece] + y[:, None] * b[piece]
    first, second = kronecker(7 * k + 3)
    radius, angle = np.sqrt(first), 2 * np.pi * second
    local = (radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - first))
    direction = sum(z[:, None] * axis[owner] for z, axis in zip(local, (regions.u, regions.v, regions.normal), strict=True))
    hits = first_hits(near, regions.world(owner, uv).astype(np.float32), direction.astype(np.float32))
    return (hits.blocker < 0).reshape(-1, RAYS).mean(1)


def openings(rooms: np.ndarray, outdoors: Outdoors) -> np.ndarray:
    """(K, 2) the rooms of portals as light from outside sees them: a room that is open counts as the outside."""
    open_room = np.concatenate([outdoors.rooms, [True]])
    return np.where(open_room[rooms], OUTSIDE, rooms)
