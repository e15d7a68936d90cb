"""Points in small groups of neighbours, which share the search for what is in their way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .building import Building
from .grouping import gathered, morton
from .occlusion import Bodies
from .regions import Regions

BLOCK_POINTS = 2048
"""Points that one worker treats at once."""
PATCH = 8
"""Most points that share the search for what is in their way."""


@dataclass(frozen=True)
class Patches:
    """Points in small groups of neighbours on one region, which share what is in their way.

    order : (N,) the points, patch after patch;  start : (K + 1,), patch k owns ``order[start[k]:start[k + 1]]``
    region : (K,);  bodies : the rectangles around them
    """

    order: np.ndarray
    start: np.ndarray
    region: np.ndarray
    bodies: Bodies


def patches_of(regions: Regions, points: np.ndarray, region: np.ndarray) -> Patches:
    """Points (N, 3) float32 on ``region`` (N,) in groups of at most ``PATCH``, neighbours along a Morton curve."""
    order = np.lexsort((morton(points), region))
    start = np.flatnonzero(np.r_[True, np.diff(region[order]) > 0])
    size = np.diff(np.r_[start, len(order)])
    rank = np.arange(len(order)) - np.repeat(start, size)
    start = np.flatnonzero(rank % PATCH == 0)
    owner = region[order[start]]
    row = region[order]
    low_high = []
    for axis in (regions.u, regions.v):
        x = np.einsum("ij,ij->i", points[order].astype(np.float64), axis[row])
        low_high.append((np.minimum.reduceat(x, start), np.maximum.reduceat(x, start), x[start]))
    centre, halves = points[order[start]].astype(np.float64), []
    for axis, (low, high, first) in zip((regions.u, regions.v), low_high, strict=True):
        centre += (0.5 * (low + high) - first)[:, None] * axis[owner]
        halves.append(0.5 * (high - low)[:, None] * axis[owner])
    bodies = Bodies(*(x.astype(np.float32) for x in (centre, *halves, regions.normal[owner])))
    return Patches(order, np.r_[start, len(order)], owner, bodies)


def patch_blocks(building: Building, patches: Patches, size: int = BLOCK_POINTS) -> list[np.ndarray]:
    """Indices of patches in blocks of neighbours, ``size`` points at most.

    A long corridor is cut across, because all of it sees the doors of half a storey, a few metres of it see theirs; small rooms
    that lie side by side share a block.
    """
    room, number = building.regions.room[patches.region], np.diff(patches.start)
    order = np.argsort(room, kind="stable")
    parts = []
    for rows in np.split(order, np.flatnonzero(np.diff(room[order])) + 1):
        at = patches.bodies.centre[rows]
        along = at[:, np.argmax(at.max(0) - at.min(0))]
        rows = rows[np.argsort(along, kind="stable")]
        # As few parts as hold the points, alike in size; a patch more than the share of each does not matter but at the limit.
        count = -(-int(number[rows].sum()) // max(1, size - PATCH))
        part = np.cumsum(number[rows]) * count // (int(number[rows].sum()) + 1)
        parts += np.split(rows, np.flatnonzero(np.diff(part)) + 1)
    places = np.array([patches.bodies.centre[rows].mean(0) for rows in parts])
    return gathered(parts, places, np.array([number[rows].sum() for rows in parts]), size)
