"""Light straight from the luminaires, at points: the exact polygon formula over what blockers leave of them.

Emission is constant over a region, so that Lambert's formula over the part that is seen is exact, near or far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import transport
from .building import Building
from .grouping import gathered, morton, ragged, starts_of
from .occlusion import Bodies, ShaftIndex, Shafts, near_axis
from .parallel import Crew
from .passages import Passages
from .regions import Regions
from .shadows import visible_form_factors

BLOCK_POINTS = 2048
"""Points that one worker treats at once."""
PATCH = 8
"""Most points that share the search for what is in their way."""
_PAIR_BLOCK = 1 << 16


@dataclass(frozen=True)
class Luminaires:
    """L regions that emit.

    region : (L,);  exitance : (L, 3) W/m2;  normal : (L, 3)
    outline_start : (L + 1,), outlines : (K, k, 3) float64 convex polygons that make up each
    """

    region: np.ndarray
    exitance: np.ndarray
    normal: np.ndarray
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
    return Luminaires(region, regions.emission[region], regions.normal[region], starts_of(row, len(region)), outlines)


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


def direct_light(building: Building, luminaires: Luminaires, points: np.ndarray, region: np.ndarray, crew: Crew) -> Iterator[DirectLight]:
    """Irradiance from all luminaires at points (N, 3) float32 (relative to the scene's centre) on the fronts of ``region`` (N,)."""
    if not len(luminaires.region) or not len(points):
        return
    patches = patches_of(building.regions, points, region)
    yield from crew.map(_block, (building, luminaires, patches, points), patch_blocks(building, patches))


def _block(building: Building, luminaires: Luminaires, patches: Patches, points: np.ndarray, block: np.ndarray) -> DirectLight:
    """Light at the points of the patches ``block`` (k,)."""
    members, patch = ragged(patches.start[block], np.diff(patches.start)[block])
    index = patches.order[members]
    return _light(building, luminaires, _scope(building, luminaires, patches, block), index, points[index], patch)


@dataclass(frozen=True)
class _Scope:
    """What matters to a block of K patches: ``lamps`` (L,), the bodies of the patches and then of the lamps, the clusters
    ``nearby`` that hold all that can be in the way, and the pairs (patch, lamp) within a room, and between rooms.
    """

    lamps: np.ndarray
    bodies: Bodies
    nearby: np.ndarray
    pairs: tuple[tuple[np.ndarray, np.ndarray], ...]


def _scope(building: Building, luminaires: Luminaires, patches: Patches, block: np.ndarray) -> _Scope:
    regions, count = building.regions, len(block)
    lamp_cluster = building.clusters.cluster_of[luminaires.region]
    cluster, row = np.unique(building.clusters.cluster_of[patches.region[block]], return_inverse=True)
    visible = building.graph.sees(cluster[:, None], lamp_cluster[None])
    lamps = np.flatnonzero(visible.any(0))
    source = luminaires.region[lamps]
    half = 0.5 * regions.size[source]
    sides = (regions.world(source, half), half[:, :1] * regions.u[source], half[:, 1:] * regions.v[source], regions.normal[source])
    mine = patches.bodies.take(block)
    bodies = mine.joined(Bodies(*(x.astype(np.float32) for x in sides)))
    anchor = luminaires.outlines[luminaires.outline_start[lamps], 0].astype(np.float32)
    normal = bodies.normal[count:]
    height = mine.centre @ normal.T - np.einsum("ij,ij->i", anchor, normal)
    height += np.abs(mine.half_u @ normal.T)
    height += np.abs(mine.half_v @ normal.T)
    patch, lamp = np.nonzero((height > building.blockers.clearance) & visible[:, lamps][row])
    room = regions.room[np.concatenate([patches.region[block], source])]
    same = room[patch] == room[count + lamp]
    beyond = np.flatnonzero(~same)
    beyond = beyond[Passages(building.doors, room).open(bodies, room, patch[beyond], count + lamp[beyond])]
    # A box around a point and a lamp in one room holds few blockers, one around several rooms holds many: so each kind apart.
    return _Scope(lamps, bodies, building.surroundings(cluster), ((patch[same], lamp[same]), (patch[beyond], lamp[beyond])))


def _light(building: Building, luminaires: Luminaires, scope: _Scope, index: np.ndarray, points: np.ndarray, patch) -> DirectLight:
    """Light at points (n, 3) of the patches ``patch`` (n,), sorted."""
    count = len(points)
    result = DirectLight(index, np.zeros((count, 3), np.float32), np.zeros(count, np.float32), np.full(count, -1), 0)
    for pairs in scope.pairs:
        if len(pairs[0]):
            result = _sum(result, _shine(building, luminaires, scope, *pairs, index, points, patch))
    return result


def _shine(building, luminaires, scope: _Scope, patch, lamp, index, points, patch_of) -> DirectLight:
    """The light of pairs (patch, lamp), sorted by patch."""
    count, first = len(index), np.searchsorted(patch_of, np.arange(patch_of[-1] + 2))
    source = scope.lamps[lamp]
    used, place = np.unique(np.concatenate([patch, patch_of[-1] + 1 + lamp]), return_inverse=True)
    bodies = scope.bodies.take(used)
    shafts = ShaftIndex(building.blockers_between(scope.nearby, *bodies.box()))
    pair, blocker = Shafts(bodies, shafts).candidates(place[: len(patch)], place[len(patch) :])
    # From patches to their points.
    point, of = ragged(first[patch], np.diff(first)[patch])
    normals = scope.bodies.normal[patch_of[point]]
    form = np.zeros(len(point))
    front = np.flatnonzero(_height(luminaires, source[of], points[point]) > building.blockers.clearance)
    form[front] = _form_factors(luminaires, source[of[front]], points[point[front]], normals[front])
    begin = np.searchsorted(pair, np.arange(len(patch) + 1))
    lit = np.flatnonzero(form > 0)
    members, row = ragged(begin[of[lit]], np.diff(begin)[of[lit]])
    row, blocker = lit[row], blocker[members]
    balls = np.ascontiguousarray(points.T), np.zeros(count, np.float32)
    near = near_axis(shafts, balls, scope.bodies.balls(), (point, patch_of[-1] + 1 + lamp[of]), row, blocker)
    row, blocker = row[near], blocker[near]
    doubtful = np.unique(row)
    at, lamps = point[doubtful], source[of[doubtful]]
    bright = form[doubtful] * luminaires.exitance[lamps].max(1)
    members, owner = ragged(luminaires.outline_start[lamps], np.diff(luminaires.outline_start)[lamps])
    rows = np.searchsorted(doubtful, row), blocker
    form[doubtful], veil = visible_form_factors(points[at], normals[doubtful], owner, luminaires.outlines[members], shafts.blockers, *rows)
    light = form[:, None] * luminaires.exitance[source[of]]
    irradiance = np.stack([np.bincount(point, light[:, k], minlength=count) for k in range(3)], 1).astype(np.float32)
    doubt = np.bincount(at, bright, minlength=count).astype(np.float32)
    return DirectLight(index, irradiance, doubt, _common(at, veil, count), len(row))


def _sum(one: DirectLight, other: DirectLight) -> DirectLight:
    """The light of two sets of lamps at the same points."""
    veil = np.where(one.doubt == 0, other.veil, np.where((other.doubt == 0) | (one.veil == other.veil), one.veil, -1))
    return DirectLight(one.index, one.irradiance + other.irradiance, one.doubt + other.doubt, veil, one.tests + other.tests)


def _height(luminaires: Luminaires, lamp: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) m of points (n, 3) over the planes of ``lamp`` (n,)."""
    return np.einsum("ij,ij->i", points - luminaires.outlines[luminaires.outline_start[lamp], 0], luminaires.normal[lamp])


def _form_factors(luminaires: Luminaires, lamp: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n,) unoccluded form factor of ``lamp`` (n,) from points (n, 3)."""
    form = np.zeros(len(lamp))
    for start in range(0, len(lamp), _PAIR_BLOCK):
        here = slice(start, start + _PAIR_BLOCK)
        members, row = ragged(luminaires.outline_start[lamp[here]], np.diff(luminaires.outline_start)[lamp[here]])
        factor = transport.lambert(points[here][row], normals[here][row], luminaires.outlines[members])
        form[here] = np.bincount(row, factor, minlength=len(lamp[here]))
    return form


def _common(owner: np.ndarray, value: np.ndarray, count: int) -> np.ndarray:
    """(count,) the value that all members of an owner share, -1 where they differ or there are none."""
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(low, owner, value)
    np.maximum.at(high, owner, value)
    return np.where(low == high, high, -1)
