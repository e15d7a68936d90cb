"""Glass in portals: how much of the light between two places it lets through."""

from __future__ import annotations

import numpy as np

from .building import Building
from .occlusion import Blockers, cut_segments


def through_glass(
    building: Building, region: np.ndarray, ia: np.ndarray, ib: np.ndarray, a: np.ndarray, b: np.ndarray
) -> np.ndarray | float:
    """Part of the light that passes between points a (n, i, 3) and b (n, j, 3) of bodies ia and ib (n,): (n, i, j), or 1 without glass.

    region : region of every body. Only light between rooms meets portals.
    """
    panes, room = building.doors.panes, building.regions.room[region]
    if not len(panes):
        return 1.0
    out = np.ones((len(a), a.shape[1], b.shape[1]), np.float32)
    other = np.flatnonzero(room[ia] != room[ib])
    for door in np.unique(panes.region) if len(other) else ():
        mine = panes.take(np.flatnonzero(panes.region == door))
        pair, pane = np.repeat(other, len(mine)), np.tile(np.arange(len(mine)), len(other))
        cut = cut_segments(mine, pair, pane, a, b).hidden
        out[cut] *= np.float32(building.doors.transmittance[door])
    return out


def through_panes(panes: Blockers, transmittance: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) float32: part of the light that passes along segments from a to b (n, 3) float32, each on its own.

    panes : triangles, ``region`` being the portal of each;  transmittance : (K,) of all portals
    """
    out = np.ones(len(a), np.float32)
    for door in np.unique(panes.region):
        mine = panes.take(np.flatnonzero(panes.region == door))
        pair, pane = np.repeat(np.arange(len(a)), len(mine)), np.tile(np.arange(len(mine)), len(a))
        out[cut_segments(mine, pair, pane, a[:, None], b[:, None]).hidden[:, 0, 0]] *= np.float32(transmittance[door])
    return out


def dimmed_rooms(building: Building) -> np.ndarray:
    """(R,) bool: rooms from which some glass may be seen, so that what they receive from all sides is less than all."""
    panes, clusters = building.doors.panes, building.clusters
    out = np.zeros(building.room_count, bool)
    rooms = building.doors.rooms[np.unique(panes.region)]
    for room in np.unique(rooms[rooms >= 0]):
        out[room] = True
        out[clusters.room[building.surroundings(np.flatnonzero(clusters.room == room))]] = True
    return out
