"""Light straight from the luminaires, at points: the exact polygon formula over what blockers leave of them.

Emission is constant over a region, so that Lambert's formula over the part that is seen is exact, near or far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import transport
from .building import Building
from .grouping import ragged, starts_of
from .occlusion import Blockers, Bodies, ShaftIndex, Shafts
from .parallel import ordered_map
from .regions import Regions
from .shadows import visible_form_factors

BLOCK_POINTS = 1024
_PAIR_BLOCK = 1 << 16


@dataclass(frozen=True)
class Luminaires:
    """L regions that emit.

    region : (L,);  exitance : (L, 3) W/m2
    outline_start : (L + 1,), outlines : (K, k, 3) float64 convex polygons that make up each
    """

    region: np.ndarray
    exitance: np.ndarray
    outline_start: np.ndarray
    outlines: np.ndarray


def luminaires_of(regions: Regions) -> Luminaires:
    """The emitting regions."""
    region = np.flatnonzero((regions.emission > 0).any(1))
    members, row = ragged(regions.piece_start[region], np.diff(regions.piece_start)[region])
    owner = region[row]
    a, b, p = regions.piece_a[members], regions.piece_b[members], regions.piece_origin[members]
    far = np.where(regions.piece_triangle[members, None], p + b, p + a + b)
    outlines = np.stack([regions.world(owner, x) for x in (p, p + a, far, p + b)], axis=1)
    return Luminaires(region, regions.emission[region], starts_of(row, len(region)), outlines)


@dataclass(frozen=True)
class DirectLight:
    """Light of the luminaires at a block of points ``index`` (n,), and the pairs of lamp and blocker that it took.

    irradiance : (n, 3) float32 W/m2
    doubt : (n,) float32 W/m2, irradiance, largest channel, from the lamps that something hides at least in part, were it not there
    veil : (n,) int64, the one blocker that alone hides all these lamps, -1 where there is none
    """

    index: np.ndarray
    irradiance: np.ndarray
    doubt: np.ndarray
    veil: np.ndarray
    tests: int


def point_blocks(building: Building, region: np.ndarray, points: np.ndarray, size: int = BLOCK_POINTS) -> list[np.ndarray]:
    """Indices of points (n, 3) on ``region`` (n,) in blocks of neighbours, ``size`` points of one room at most.

    Blocks follow each other along the longest side of a room: all of a long corridor sees the doors of half a storey, a few
    metres of it see theirs.
    """
    if not len(region):
        return []
    room = building.regions.room[region]
    order = np.argsort(room, kind="stable")
    blocks = []
    for rows in np.split(order, np.flatnonzero(np.diff(room[order])) + 1):
        at = points[rows]
        along = at[:, np.argmax(at.max(0) - at.min(0))]
        rows = rows[np.argsort(along, kind="stable")]
        blocks += np.array_split(rows, -(-len(rows) // size))
    return blocks


def direct_light(building: Building, luminaires: Luminaires, points: np.ndarray, region: np.ndarray, workers: int) -> Iterator[DirectLight]:
    """Irradiance from all luminaires at points (N, 3) float32 (relative to the scene's centre) on the fronts of ``region`` (N,)."""
    if not len(luminaires.region):
        return
    lamp_cluster = building.clusters.cluster_of[luminaires.region]

    def light(index: np.ndarray) -> DirectLight:
        nearby = building.surroundings(np.unique(building.clusters.cluster_of[region[index]]))
        lamps = np.flatnonzero(np.isin(lamp_cluster, nearby))
        return _light(building, luminaires, lamps, nearby, index, points[index], region[index])

    yield from ordered_map(light, point_blocks(building, region, points), workers)


def _light(building, luminaires, lamps, nearby, index, points, region) -> DirectLight:
    count = len(points)
    if not count or not len(lamps):
        return DirectLight(index, np.zeros((count, 3), np.float32), np.zeros(count, np.float32), np.full(count, -1), 0)
    bodies = _bodies(building, luminaires.region[lamps], points, region)
    point, lamp = _pairs(building, luminaires, lamps, bodies, region)
    form = _form_factors(luminaires, lamps[lamp], points[point], bodies.normal[point])
    some = np.flatnonzero(form > 0)
    point, lamp, form = point[some], lamp[some], form[some]
    blockers = _blockers(building, luminaires.region[lamps[np.unique(lamp)]], nearby, points)
    pair, blocker = Shafts(bodies, ShaftIndex(blockers)).candidates(point, count + lamp)
    doubtful = np.unique(pair)
    at, source = point[doubtful], lamps[lamp[doubtful]]
    bright = form[doubtful] * luminaires.exitance[source].max(1)
    members, owner = ragged(luminaires.outline_start[source], np.diff(luminaires.outline_start)[source])
    outlines = luminaires.outlines[members]
    rows = np.searchsorted(doubtful, pair), blocker
    form[doubtful], veil = visible_form_factors(points[at], bodies.normal[at], owner, outlines, blockers, *rows)
    light = form[:, None] * luminaires.exitance[lamps[lamp]]
    irradiance = np.stack([np.bincount(point, light[:, k], minlength=count) for k in range(3)], 1).astype(np.float32)
    doubt = np.bincount(at, bright, minlength=count).astype(np.float32)
    return DirectLight(index, irradiance, doubt, _common(at, veil, count), len(pair))


def _bodies(building: Building, source: np.ndarray, points: np.ndarray, region: np.ndarray) -> Bodies:
    """The points (bodies 0..n-1) and the lamps on the regions ``source`` (bodies n..)."""
    regions = building.regions
    half = 0.5 * regions.size[source]
    zero = np.zeros_like(points)
    parts = (
        (points, regions.world(source, half)),
        (zero, half[:, :1] * regions.u[source]),
        (zero, half[:, 1:] * regions.v[source]),
        (regions.normal[region], regions.normal[source]),
    )
    return Bodies(*(np.concatenate(part).astype(np.float32) for part in parts))


def _pairs(building: Building, luminaires: Luminaires, lamps: np.ndarray, bodies: Bodies, region: np.ndarray):
    """Pairs (point, lamp) of points in front of a lamp that, in another room, lies beyond a portal of either room."""
    count = len(region)
    facing = bodies.normal[count:]
    anchor = luminaires.outlines[luminaires.outline_start[lamps], 0].astype(np.float32)
    height = bodies.centre[:count] @ facing.T - np.einsum("ij,ij->i", anchor, facing)
    point, lamp = np.nonzero(height > building.blockers.clearance)
    here, there = building.regions.room[region[0]], building.regions.room[luminaires.region[lamps]]
    same = there[lamp] == here
    found = [(point[same], lamp[same])]
    point, lamp = _through(building, here, bodies, count, point[~same], lamp[~same])
    for room in np.unique(there[lamp]):
        mine = there[lamp] == room
        found.append(_through(building, room, bodies, count, point[mine], lamp[mine]))
    point, lamp = (np.concatenate(side) for side in zip(*found, strict=True))
    order = np.lexsort((lamp, point))
    return point[order], lamp[order]


def _through(building: Building, room: int, bodies: Bodies, count: int, point: np.ndarray, lamp: np.ndarray):
    """The pairs whose shaft meets a portal of ``room``."""
    if not len(point):
        return point, lamp
    used, index = np.unique(np.concatenate([point, count + lamp]), return_inverse=True)
    shafts = Shafts(bodies.take(used), ShaftIndex(building.doors.of_room(room)))
    passes = shafts.crossed(index[: len(point)], index[len(point) :])
    return point[passes], lamp[passes]


def _form_factors(luminaires: Luminaires, lamp: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n,) unoccluded form factor of ``lamp`` (n,) from points (n, 3)."""
    form = np.zeros(len(lamp))
    for start in range(0, len(lamp), _PAIR_BLOCK):
        here = slice(start, start + _PAIR_BLOCK)
        members, row = ragged(luminaires.outline_start[lamp[here]], np.diff(luminaires.outline_start)[lamp[here]])
        factor = transport.lambert(points[here][row], normals[here][row], luminaires.outlines[members])
        form[here] = np.bincount(row, factor, minlength=len(lamp[here]))
    return form


def _blockers(building: Building, source: np.ndarray, nearby: np.ndarray, points: np.ndarray) -> Blockers:
    """Blockers of the clusters ``nearby`` in the box around the points and the lamps on ``source``."""
    regions = building.regions
    low = np.minimum(points.min(0), regions.box_min[source].min(0, initial=np.inf))
    high = np.maximum(points.max(0), regions.box_max[source].max(0, initial=-np.inf))
    return building.blockers_between(nearby, low, high)


def _common(owner: np.ndarray, value: np.ndarray, count: int) -> np.ndarray:
    """(count,) the value that all members of an owner share, -1 where they differ or there are none."""
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(low, owner, value)
    np.maximum.at(high, owner, value)
    return np.where(low == high, high, -1)
