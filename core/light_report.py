"""Illuminance room by room, as lighting design asks for it: average, minimum, maximum and uniformity, on surfaces and on work planes.

A work plane is a level grid of points over the floor, ``height`` above it, without what furniture covers and without a border along the
walls (EN 12464-1: work planes at 0.75 to 0.85 m, borders of up to 0.5 m). Uniformity is the minimum over the average.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .building import Building
from .coverage import covered
from .occlusion import first_hits
from .photometry import LUMINOUS_EFFICACY, luminance
from .solution import Solution

SPACING = 0.25
"""Metres between points of a grid, less in small rooms."""
FEWEST = 8
"""Points along the longer side of a surface or room at least."""
MOST = 64
"""And at most."""
STEP = 0.05
"""Metres by which parts of a floor may differ in height."""
LEVEL = 0.95
"""Least height of the normal of a floor or ceiling."""
EDGE = 0.5
"""Places of a grid lie in the middles of its cells, never on the border, where the light of corners is singular."""


@dataclass(frozen=True)
class RoomLight:
    """Illuminance, lx, on one part of a room, see ``PARTS``.

    area : m2 that the points stand for;  uniformity : minimum over average, 0 in the dark
    """

    room: str
    part: str
    area: float
    average: float
    minimum: float
    maximum: float
    points: int

    @property
    def uniformity(self) -> float:
        return self.minimum / self.average if self.average > 0 else 0.0


@dataclass(frozen=True)
class Grid:
    """Points (n, 3) float64, metres, facing as ``polygon`` (n,), that stand for ``area`` (n,) m2 of a ``part`` (n,) of a ``room`` (n,)."""

    points: np.ndarray
    polygon: np.ndarray
    area: np.ndarray
    room: np.ndarray
    part: np.ndarray


PARTS = ("floor", "walls", "ceilings", "other surfaces", "work plane")
"""Floors lie as high as the largest surface of a room that faces up, walls are upright, ceilings face down; the rest is other."""


def light_report(
    solution: Solution, height: float = 0.8, border: float = 0.5, efficacy: float = LUMINOUS_EFFICACY
) -> Iterator[float | list[RoomLight]]:
    """Yields the share of the work done, at last the rows of all rooms, in their order and that of ``PARTS``.

    height : of work planes, m;  border : along walls that work planes leave out, m, where a room is wide enough
    efficacy : lm/W, lux over W/m2 of white light
    """
    scene = solution.scene
    surfaces, plane = surface_grid(solution), work_plane(solution, height, border)
    values = []
    for k, (grid, steps) in enumerate(((surfaces, solution.irradiance_steps), (plane, solution.irradiance_above_steps))):
        light = np.zeros((len(grid.points), 3), np.float32)
        for share in steps(grid.points, grid.polygon, light):
            yield 0.5 * (k + share)
        values.append(efficacy * luminance(light.astype(np.float64)))
    lux, part = np.concatenate(values), np.concatenate([surfaces.part, plane.part])
    room, area = np.concatenate([surfaces.room, plane.room]), np.concatenate([surfaces.area, plane.area])
    rows = []
    for r, name in enumerate(scene.room_names):
        for p, what in enumerate(PARTS):
            here = np.flatnonzero((room == r) & (part == p))
            if len(here):
                e, weight = lux[here], area[here]
                average = float((e * weight).sum() / weight.sum())
                rows.append(RoomLight(name, what, float(weight.sum()), average, float(e.min()), float(e.max()), len(here)))
    yield rows


def report_of_light(solution: Solution, height: float = 0.8, border: float = 0.5) -> list[RoomLight]:
    """:func:`light_report`, run to its end."""
    *_, rows = light_report(solution, height, border)
    return rows


def as_csv(rows: Sequence[RoomLight], unit: str = "lx") -> str:
    """The rows as comma-separated values with a line of headings."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["room", "part", "area (m2)", f"average ({unit})", f"minimum ({unit})", f"maximum ({unit})", "uniformity", "points"])
    for row in rows:
        figures = (row.area, row.average, row.minimum, row.maximum, row.uniformity)
        writer.writerow([row.room, row.part, *(f"{x:.4g}" for x in figures), row.points])
    return out.getvalue()


def surface_grid(solution: Solution) -> Grid:
    """Points over the surfaces of all rooms, by the places that regions cover; furniture and lamps count with what they face as."""
    building = solution.building
    regions = building.regions
    usable = np.flatnonzero(~regions.buried & (regions.area > 0))
    step = np.minimum(SPACING, np.maximum(regions.size[usable].max(1) / FEWEST, 1e-9))
    number = np.clip(np.ceil(regions.size[usable] / step[:, None]), 1, MOST).astype(np.int64)
    count = number[:, 0] * number[:, 1]
    owner = np.repeat(np.arange(len(usable)), count)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    x, y = rank % number[owner, 0], rank // number[owner, 0]
    region = usable[owner]
    uv = (np.stack([x, y], 1) + EDGE) / number[owner] * regions.size[region]
    inside = covered(regions, region, uv, 0.0)
    region, owner, uv = region[inside], owner[inside], uv[inside]
    # The points of a region share its area, whatever part of its rectangle it covers.
    share = regions.area[region] / np.bincount(owner, minlength=len(usable))[owner]
    polygon = _polygon_of(regions.polygon_region, len(regions))[region]
    up = regions.normal[region, 2]
    low = np.abs(regions.centroid[region, 2] - _floor_heights(building)[regions.room[region]]) < STEP
    part = np.select([(up > LEVEL) & low, np.abs(up) < 1 - LEVEL, up < -LEVEL], [0, 1, 2], 3)
    return Grid(regions.world(region, uv) + regions.centre, polygon, share, regions.room[region], part)


def work_plane(solution: Solution, height: float, border: float) -> Grid:
    """A level grid over the floor of every room: points from which the next thing below is a surface of the room that faces up."""
    building = solution.building
    regions = building.regions
    polygon_of = _polygon_of(regions.polygon_region, len(regions))
    parts: list[tuple] = []
    heights = _floor_heights(building)
    for room in np.flatnonzero(np.isfinite(heights)):
        z = heights[room]
        level = (regions.room == room) & (regions.normal[:, 2] > LEVEL) & ~regions.buried
        floor = np.flatnonzero(level & (np.abs(regions.centroid[:, 2] - z) < STEP))
        ground = floor[regions.area[floor].argmax()]
        low, high = regions.box_min[floor].min(0), regions.box_max[floor].max(0)
        step = min(SPACING, max(float((high - low)[:2].max()) / FEWEST, 1e-6))
        number = np.clip(np.ceil((high - low)[:2] / step), 1, MOST).astype(int)
        x, y = (low[k] + (np.arange(number[k]) + EDGE) / number[k] * (high - low)[k] for k in (0, 1))
        grid = np.stack([*(g.ravel() for g in np.meshgrid(x, y, indexing="ij")), np.full(number.prod(), z + height)], 1)
        kept = grid[_free(building, room, grid, border)]
        cell = float(np.prod((high - low)[:2] / number))
        parts.append((kept + regions.centre, np.full(len(kept), polygon_of[ground]), np.full(len(kept), cell), np.full(len(kept), room)))
    points, polygon, area, room = (np.concatenate(column) for column in zip(*parts, strict=True)) if parts else _nothing()
    return Grid(points, polygon, area, room, np.full(len(points), PARTS.index("work plane")))


def _floor_heights(building: Building) -> np.ndarray:
    """(R,) height of the largest surface of each room that faces up, infinite without any."""
    regions = building.regions
    level = np.flatnonzero((regions.normal[:, 2] > LEVEL) & ~regions.buried)
    level = level[np.argsort(regions.area[level], kind="stable")]
    out = np.full(building.room_count, np.inf)
    out[regions.room[level]] = regions.centroid[level, 2]
    return out


def _free(building: Building, room: int, points: np.ndarray, border: float) -> np.ndarray:
    """(n,) bool: points above the floor of a room, not inside furniture, and off its walls where the room is wide enough."""
    regions = building.regions
    clusters = np.flatnonzero(building.clusters.room == room)
    near = building.blockers_of(building.regions_of(building.surroundings(clusters))[0])
    start = points.astype(np.float32)
    down, up = (first_hits(near, start, np.repeat([[0, 0, z]], len(points), 0).astype(np.float32)) for z in (-1, 1))
    below = near.region[np.maximum(down.blocker, 0)]
    free = (down.blocker >= 0) & ~down.behind & (regions.room[below] == room) & (regions.normal[below, 2] > LEVEL) & ~up.behind
    if border > 0:
        turn = 2 * np.pi * np.arange(8) / 8
        wide = free.copy()
        for direction in np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1):
            hits = first_hits(near, start, np.repeat(direction[None], len(points), 0).astype(np.float32))
            k = np.maximum(hits.blocker, 0)
            slope = near.normal[k] @ direction
            height = np.einsum("ij,ij->i", near.normal[k], points) - near.offset[k, 0]
            distance = np.where(hits.blocker >= 0, np.abs(height) / np.maximum(np.abs(slope), 1e-9), np.inf)
            wide &= distance > border
        if wide.any():
            return wide
    return free


def _polygon_of(polygon_region: np.ndarray, count: int) -> np.ndarray:
    """(G,) a polygon of each region."""
    out = np.zeros(count, np.int64)
    known = np.flatnonzero(polygon_region >= 0)[::-1]
    out[polygon_region[known]] = known
    return out


def _nothing():
    return np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64)
