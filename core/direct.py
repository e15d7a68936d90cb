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
from .occlusion import Bodies, ShaftIndex, Shafts
from .parallel import ordered_map
from .regions import Regions
from .shadows import visible_form_factors

BLOCK_POINTS = 2048
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


def point_blocks(building: Building, region: np.ndarray, size: int = BLOCK_POINTS) -> list[np.ndarray]:
    """Indices of points on ``region`` (n,) in blocks of neighbours: about ``size`` points of clusters of one room."""
    cluster = building.clusters.cluster_of[region]
    order = np.argsort(cluster, kind="stable")
    if not len(order):
        return []
    room = building.clusters.room[cluster[order]]
    fresh = np.r_[True, room[1:] != room[:-1]]
    run = np.cumsum(fresh) - 1
    since = np.arange(len(order)) - np.flatnonzero(fresh)[run]
    part = since // size
    cut = np.flatnonzero(fresh | np.r_[False, part[1:] != part[:-1]])
    return np.split(order, cut[1:])


def direct_light(building: Building, luminaires: Luminaires, points: np.ndarray, region: np.ndarray, workers: int) -> Iterator[DirectLight]:
    """Irradiance from all luminaires at points (N, 3) float32 (relative to the scene's centre) on the fronts of ``region`` (N,)."""
    if not len(luminaires.region):
        return
    lamp_cluster = building.clusters.cluster_of[luminaires.region]

    def light(index: np.ndarray) -> DirectLight:
        nearby = building.surroundings(np.unique(building.clusters.cluster_of[region[index]]))
        lamps = np.flatnonzero(np.isin(lamp_cluster, nearby))
        return _light(building, luminaires, lamps, nearby, index, points[index], region[index])

    yield from ordered_map(light, point_blocks(building, region), workers)


def _light(building, luminaires, lamps, nearby, index, points, region) -> DirectLight:
    regions = building.regions
    out = np.zeros((len(points), 3))
    if not len(lamps):
        return DirectLight(index, out.astype(np.float32), np.zeros(len(points), np.float32), np.full(len(points), -1), 0)
    eps = building.blockers.clearance
    normal = regions.normal[region].astype(np.float32)
    source = luminaires.region[lamps]
    facing = regions.normal[source].astype(np.float32)
    anchor = luminaires.outlines[luminaires.outline_start[lamps], 0].astype(np.float32)
    in_front = points @ facing.T - np.einsum("ij,ij->i", anchor, facing) > eps
    pair_point, pair_lamp = np.nonzero(in_front)
    form = np.zeros(len(pair_point))
    lamp_of_pair = lamps[pair_lamp]
    for start in range(0, len(pair_point), _PAIR_BLOCK):
        here = slice(start, start + _PAIR_BLOCK)
        members, row = ragged(luminaires.outline_start[lamp_of_pair[here]], np.diff(luminaires.outline_start)[lamp_of_pair[here]])
        p = pair_point[here][row]
        factor = transport.lambert(points[p], normal[p], luminaires.outlines[members])
        form[here] = np.bincount(row, factor, minlength=len(pair_point[here]))
    some = np.flatnonzero(form > 0)
    pair_point, pair_lamp, lamp_of_pair, form = pair_point[some], pair_lamp[some], lamp_of_pair[some], form[some]
    shafts, blockers = _lamp_shafts(building, luminaires, lamps, nearby, points, normal)
    pair, blocker = shafts.candidates(pair_point, len(points) + pair_lamp)
    doubtful = np.unique(pair)
    rows = np.searchsorted(doubtful, pair), blocker
    lamp = lamp_of_pair[doubtful]
    at = points[pair_point[doubtful]], normal[pair_point[doubtful]]
    bright = form[doubtful] * luminaires.exitance[lamp].max(1)
    form[doubtful], veil_of_pair = _seen(luminaires, lamp, *at, blockers, *rows)
    doubt = np.bincount(pair_point[doubtful], bright, minlength=len(points))
    veil = _common(pair_point[doubtful], veil_of_pair, len(points))
    light = form[:, None] * luminaires.exitance[lamp_of_pair]
    for channel in range(3):
        out[:, channel] = np.bincount(pair_point, light[:, channel], minlength=len(points))
    return DirectLight(index, out.astype(np.float32), doubt.astype(np.float32), veil, len(pair))


def _common(owner: np.ndarray, value: np.ndarray, count: int) -> np.ndarray:
    """(count,) the value that all members of an owner share, -1 where they differ or there are none."""
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(low, owner, value)
    np.maximum.at(high, owner, value)
    return np.where(low == high, high, -1)


def _seen(luminaires, lamp, points, normal, blockers, pair, blocker):
    members, owner = ragged(luminaires.outline_start[lamp], np.diff(luminaires.outline_start)[lamp])
    return visible_form_factors(points, normal, owner, luminaires.outlines[members], blockers, pair, blocker)


def _lamp_shafts(building, luminaires, lamps, nearby, points, normal):
    """Shafts between points (bodies 0..n-1) and lamps (bodies n..), and the blockers that may stand in them."""
    regions, source = building.regions, luminaires.region[lamps]
    low = np.minimum(points.min(0), regions.box_min[source].min(0))
    high = np.maximum(points.max(0), regions.box_max[source].max(0))
    blockers = building.blockers_between(nearby, low, high)
    half = 0.5 * regions.size[source]
    zero = np.zeros_like(points)
    bodies = Bodies(
        np.concatenate([points, regions.world(source, half)]).astype(np.float32),
        np.concatenate([zero, half[:, :1] * regions.u[source]]).astype(np.float32),
        np.concatenate([zero, half[:, 1:] * regions.v[source]]).astype(np.float32),
        np.concatenate([normal, regions.normal[source]]).astype(np.float32),
    )
    return Shafts(bodies, ShaftIndex(blockers)), blockers
