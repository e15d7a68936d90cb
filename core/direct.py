"""Light straight from the luminaires, at points: the exact polygon formula times a sampled visibility.

Emission is constant over a region, so that without a blocker Lambert's formula is exact, near or far. Where blockers
stand in the shaft, a grid of points of the luminaire, weighed by the kernel, says which part of it is seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import transport
from .building import Building
from .coverage import measure
from .grouping import ragged, starts_of
from .occlusion import Bodies, Shafts, cut_segments
from .parallel import ordered_map
from .regions import Regions

BLOCK_POINTS = 2048
_PAIR_BLOCK = 1 << 16


@dataclass(frozen=True)
class Luminaires:
    """L regions that emit.

    region : (L,);  exitance : (L, 3) W/m2
    samples : (L, s, 3) float32 points on each, and shares : (L, s) float32 the part of its area that each stands for
    outline_start : (L + 1,), outlines : (K, k, 3) float64 convex polygons that make up each
    """

    region: np.ndarray
    exitance: np.ndarray
    samples: np.ndarray
    shares: np.ndarray
    outline_start: np.ndarray
    outlines: np.ndarray


def luminaires_of(regions: Regions, samples_per_axis: int) -> Luminaires:
    """The emitting regions, each with a grid of ``samples_per_axis``**2 sample points."""
    region = np.flatnonzero((regions.emission > 0).any(1))
    count = len(region)
    members, row = ragged(regions.piece_start[region], np.diff(regions.piece_start)[region])
    box = np.concatenate([np.zeros((count, 2)), regions.size[region]], axis=1)
    area, moment, *_ = measure(regions, box, row, members, samples_per_axis)
    empty = area <= 1e-9 * area.sum(1, keepdims=True)
    mean = moment.sum(1) / area.sum(1, keepdims=True)
    uv = np.where(empty[..., None], mean[:, None], moment / np.where(empty, 1.0, area)[..., None])
    flat = np.repeat(region, samples_per_axis**2)
    samples = regions.world(flat, uv.reshape(-1, 2)).reshape(count, -1, 3)
    shares = np.where(empty, 0.0, area) / area.sum(1, keepdims=True)
    owner = region[row]
    a, b, p = regions.piece_a[members], regions.piece_b[members], regions.piece_origin[members]
    far = np.where(regions.piece_triangle[members, None], p + b, p + a + b)
    outlines = np.stack([regions.world(owner, x) for x in (p, p + a, far, p + b)], axis=1)
    return Luminaires(
        region, regions.emission[region], samples.astype(np.float32), shares.astype(np.float32), starts_of(row, count), outlines
    )


@dataclass(frozen=True)
class DirectLight:
    """Irradiance (n, 3) float32 W/m2 of a block of points ``index`` (n,), and the segment tests that it took."""

    index: np.ndarray
    irradiance: np.ndarray
    segment_tests: int


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
        return DirectLight(index, out.astype(np.float32), 0)
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
    seen, tests = _visible_share(building, luminaires, lamps, nearby, points, normal, pair_point, pair_lamp)
    light = (form * seen)[:, None] * luminaires.exitance[lamp_of_pair]
    for channel in range(3):
        out[:, channel] = np.bincount(pair_point, light[:, channel], minlength=len(points))
    return DirectLight(index, out.astype(np.float32), tests)


def _visible_share(building, luminaires, lamps, nearby, points, normal, pair_point, pair_lamp):
    """(n,) share of the light of a lamp that reaches a point past all blockers, and the number of segment tests."""
    regions, source = building.regions, luminaires.region[lamps]
    low = np.minimum(points.min(0), regions.box_min[source].min(0))
    high = np.maximum(points.max(0), regions.box_max[source].max(0))
    blockers = building.blockers_between(nearby, low, high)
    half = 0.5 * regions.size[source]
    centre = regions.world(source, half)
    zero = np.zeros_like(points)
    bodies = Bodies(
        np.concatenate([points, centre]).astype(np.float32),
        np.concatenate([zero, half[:, :1] * regions.u[source]]).astype(np.float32),
        np.concatenate([zero, half[:, 1:] * regions.v[source]]).astype(np.float32),
        np.concatenate([normal, regions.normal[source]]).astype(np.float32),
    )
    shafts = Shafts(bodies, blockers)
    pair, blocker = shafts.candidates(pair_point, len(points) + pair_lamp)
    seen = np.ones(len(pair_point))
    if not len(pair):
        return seen, 0
    partly = np.flatnonzero(np.r_[True, pair[1:] != pair[:-1]])
    doubtful = pair[partly]
    place = np.cumsum(np.r_[0, np.diff(pair) != 0])
    start, samples = points[pair_point[doubtful]], luminaires.samples[lamps[pair_lamp[doubtful]]]
    free = ~cut_segments(blockers, place, blocker, start[:, None], samples).hidden[:, 0]
    weight = luminaires.shares[lamps[pair_lamp[doubtful]]]
    weight = (
        weight
        * transport.kernel(start[:, None], normal[pair_point[doubtful]], samples, bodies.normal[len(points) + pair_lamp[doubtful]])[:, 0]
    )
    total = weight.sum(1)
    seen[doubtful] = np.where(total > 0, (weight * free).sum(1) / np.maximum(total, 1e-30), 0.0)
    return seen, len(pair) * samples.shape[1]
