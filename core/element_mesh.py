"""The elements of a solution as triangles with their light: to be drawn, in true colours, in false ones or by their error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import basis
from .coverage import clipped_pieces
from .grouping import ragged
from .solution import Solution

BESIDE = 1e-3
"""Neighbours are looked for this far beyond the sides of an element, as a part of its size."""


@dataclass(frozen=True)
class ElementMesh:
    """N elements as T triangles, which cover each surface once.

    corner : (T, 3, 3) float64, metres;  element : (T,) int64, 0..N-1
    irradiance, exitance : (T, 3, 3) float32, W/m2, RGB at the corners
    outline : (L, 3, 3) float64, metres: both ends of every side of an element, and a point within the element
    error : (N,) float32, estimated error of the irradiance relative to the mean of the room, NaN where nothing is known
    room : (N,) int32;  leaves : number of the elements that the solution has, N or more
    """

    corner: np.ndarray
    element: np.ndarray
    irradiance: np.ndarray
    exitance: np.ndarray
    outline: np.ndarray
    error: np.ndarray
    room: np.ndarray
    leaves: int


def element_mesh(solution: Solution, most: int = 200_000) -> ElementMesh:
    """The leaves of the quadtrees, or where these are more than ``most`` what lies above them, coarser by whole levels."""
    forest, regions, light = solution.forest, solution.regions, solution.light
    chosen = _cut_through(light.level, light.children, most)
    total = light.direct + light.reflected
    polygons, row = _outlines(solution, chosen)
    region, box = light.region[chosen][row], light.box[chosen][row]
    local = np.clip((polygons - box[:, None, :2]) / box[:, None, 2:], 0.0, 1.0)
    values = basis.evaluate(forest.order, local.reshape(-1, 2)).astype(np.float32).reshape(*local.shape[:2], -1)
    received = np.maximum(np.einsum("nkm,nmc->nkc", values, total[chosen][row]), 0.0)
    sent = regions.emission[region][:, None].astype(np.float32) + regions.reflectance[region][:, None].astype(np.float32) * received
    world = regions.world(np.repeat(region, polygons.shape[1]), polygons.reshape(-1, 2)).reshape(*polygons.shape[:2], 3) + regions.centre

    fan = np.stack([np.zeros(polygons.shape[1] - 2, int), np.arange(1, polygons.shape[1] - 1), np.arange(2, polygons.shape[1])], axis=1)
    edge, other = polygons[:, fan[:, 1]] - polygons[:, fan[:, 0]], polygons[:, fan[:, 2]] - polygons[:, fan[:, 0]]
    real = np.abs(edge[..., 0] * other[..., 1] - edge[..., 1] * other[..., 0]) > 1e-9 * (box[:, 2] * box[:, 3])[:, None]
    within = np.broadcast_to(world.mean(axis=1, keepdims=True), world.shape)
    outline = np.stack([world, np.roll(world, -1, axis=1), within], axis=2).reshape(-1, 3, 3)
    outline = outline[np.abs(outline[:, 0] - outline[:, 1]).max(axis=1) > 0]
    return ElementMesh(
        corner=world[:, fan][real],
        element=np.repeat(row, len(fan)).reshape(-1, len(fan))[real],
        irradiance=received[:, fan][real],
        exitance=sent[:, fan][real],
        outline=outline,
        error=_steps(solution, chosen, total),
        room=regions.room[light.region[chosen]],
        leaves=int((light.children < 0).all(1).sum()),
    )


def _cut_through(level: np.ndarray, children: np.ndarray, most: int) -> np.ndarray:
    """Ids of elements that cover everything once: all leaves, or at most about ``most`` elements of no deeper than some level."""
    leaf = (children < 0).all(1)
    depth = int(level.max(initial=0))
    shallow = np.cumsum(np.bincount(level[leaf], minlength=depth + 1))
    count = shallow + np.bincount(level[~leaf], minlength=depth + 1)
    fit = np.flatnonzero(count <= most)
    deepest = int(fit[-1]) if len(fit) else 0
    return np.flatnonzero((leaf & (level <= deepest)) | (level == deepest))


def _outlines(solution: Solution, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, k, 2) convex polygons in the frames of their regions, and the index into ``chosen`` (N,) of each, ascending.

    An element that its region covers in part is cut to the pieces of the cover. Missing corners repeat the last one.
    """
    forest, regions, light = solution.forest, solution.regions, solution.light
    box, cut = light.box[chosen], np.flatnonzero(forest.cut(chosen))
    whole = np.flatnonzero(~forest.cut(chosen))
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    quads = box[whole, None, :2] + square * box[whole, None, 2:]
    owner = light.region[chosen[cut]]
    piece, k = ragged(regions.cover_start[:-1][owner], np.diff(regions.cover_start)[owner])
    low, high = regions.cover.min(axis=1), regions.cover.max(axis=1)
    row = cut[k]
    near = (low[piece] < box[row, :2] + box[row, 2:]).all(1) & (high[piece] > box[row, :2]).all(1)
    piece, row = piece[near], row[near]
    if not len(row):
        return quads, whole
    parts = clipped_pieces(regions, box, row, piece)
    quads = np.concatenate([quads, np.repeat(quads[:, -1:], parts.shape[1] - 4, axis=1)], axis=1)
    rows = np.concatenate([whole, row])
    order = np.argsort(rows, kind="stable")
    return np.concatenate([quads, parts])[order], rows[order]


def _steps(solution: Solution, chosen: np.ndarray, total: np.ndarray) -> np.ndarray:
    """(N,) float32: half the step between the light of an element and its neighbours', in the mean square over its four sides,
    relative to the mean irradiance of the room.

    The exact light has no steps within a surface but at the edges of sharp shadows. NaN for an element without neighbours.
    """
    forest, regions = solution.forest, solution.regions
    box, region = forest.box[chosen], forest.region[chosen]
    square, count = np.zeros(len(chosen)), np.zeros(len(chosen))
    for side in np.array([[-1, 0], [1, 0], [0, -1], [0, 1]]):
        uv = box[:, :2] + (0.5 + (0.5 + BESIDE) * side) * box[:, 2:]
        there = np.flatnonzero((uv > 0).all(1) & (uv < regions.size[region]).all(1))
        other, outside = forest.locate(region[there], uv[there])
        known = forest.leaf[other]
        there, other, outside = there[known], other[known], outside[known]
        inside = np.broadcast_to(0.5 + 0.5 * side, (len(there), 2))
        step = _value(forest, total, chosen[there], inside) - _value(forest, total, other, outside)
        square[there] += (0.5 * step.mean(1)) ** 2
        count[there] += 1
    root = np.arange(len(regions))
    room_area = np.bincount(regions.room, regions.area)
    mean = np.bincount(regions.room, forest.mean(root, total[root]).mean(1) * regions.area) / np.maximum(room_area, 1e-300)
    scale = np.maximum(mean[regions.room[region]], 1e-12)
    return np.where(count > 0, np.sqrt(square / np.maximum(count, 1)) / scale, np.nan).astype(np.float32)


def _value(forest, coefficients: np.ndarray, element: np.ndarray, local: np.ndarray) -> np.ndarray:
    return np.einsum("nm,nmc->nc", basis.evaluate(forest.order, local).astype(np.float32), coefficients[element])
