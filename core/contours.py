"""The contours of flat shapes that convex polygons make up: what two polygons share cancels, only what lies around them is left.

A sum over edges, as Lambert's formula is, needs the contour alone. A floor that furniture stands on may be cut into a thousand
polygons, with a fifth of their edges around it.
"""

from __future__ import annotations

import numpy as np

from .grouping import components, runs

WELD = 1e-7
"""Corners closer than this (m) are one."""
_TURN = 1e-4
"""Edges that meet at a corner and differ in direction by less (radians) are sought on one line."""
_STRAIGHT = 1e-6
"""How far corners of a line lie off it at most, m."""


def contours(row: np.ndarray, polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges around shapes: their rows (e,), sorted, and their ends start and end (e, 2).

    row : (n,) shape of every polygon, rising;  polygons : (n, k, 2) float64 convex, counter-clockwise, repeated corners allowed,
    without overlap (what lies on one another has its edges twice). The edges have the shape on their left and make closed
    chains whose corners are equal to the bit. Edges that are not found to cancel are there twice, in both senses: no sum is
    wrong by it.
    """
    corner, place = _welded(row, polygons)
    count = len(place)
    start, end = corner, np.roll(corner, -1, 1)
    real = start != end
    start, end, row = start[real], end[real], np.repeat(row, polygons.shape[1]).reshape(corner.shape)[real]
    line = _lines(start, end, place, count)
    # Every edge runs over the corners of its line: between two that follow each other, edges of both senses cancel.
    ends, where = np.concatenate([start, end]), np.tile(line, 2)
    along = np.einsum("ij,ij->i", place[ends], _directions(start, end, line, place)[where])
    order = np.lexsort((ends, along, where))
    first = _new(where[order], ends[order])
    stop = np.zeros(len(ends), np.int64)
    stop[order] = np.cumsum(first) - 1
    stops = order[first]
    depart, arrive = stop[: len(start)], stop[len(start) :]
    change = np.bincount(depart, minlength=len(stops)) - np.bincount(arrive, minlength=len(stops))
    net = np.cumsum(change)  # of edges that run forward from a stop to the next; a line ends with none
    lead = np.flatnonzero(change != 0)
    times = np.abs(net[lead])
    kept = np.repeat(np.arange(len(lead)), times)
    a, b = ends[stops[lead[kept]]], ends[stops[lead[np.minimum(kept + 1, len(lead) - 1)]]]
    forward = net[lead[kept]] > 0
    start, end = np.where(forward, a, b), np.where(forward, b, a)
    row_of = np.zeros(count, np.int64)
    row_of[ends] = np.tile(row, 2)
    out = row_of[start]
    order = np.argsort(out, kind="stable")
    return out[order], place[start[order]], place[end[order]]


def _welded(row: np.ndarray, polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of every corner (n, k), equal corners of a shape alike, and the place (c, 2) of each."""
    n, k = polygons.shape[:2]
    key = np.column_stack([np.repeat(row, k), np.round(polygons.reshape(-1, 2) / WELD).astype(np.int64)])
    order = np.lexsort(key.T)
    first = _new(*key[order].T)
    number = np.zeros(n * k, np.int64)
    number[order] = np.cumsum(first) - 1
    return number.reshape(n, k), polygons.reshape(-1, 2)[order[first]]


def _lines(start: np.ndarray, end: np.ndarray, place: np.ndarray, count: int) -> np.ndarray:
    """(e,) number of the line of every edge: edges that follow each other straight on have one."""
    step = place[end] - place[start]
    angle = np.mod(np.arctan2(step[:, 1], step[:, 0]), np.pi)
    number, edge = [], np.arange(len(start))
    # Directions about a border between two bins share a bin of the other division.
    for shift in (0.0, 0.5):
        turn = np.floor(angle / _TURN + shift).astype(np.int64) % int(np.pi / _TURN)
        key = np.concatenate([start, end]) * (int(np.pi / _TURN) + 1) + np.tile(turn, 2)
        found, index = np.unique(key, return_inverse=True)
        number.append((found, index.reshape(-1)))
    nodes = len(start) + len(number[0][0])
    joins = [np.concatenate([len(start) + number[0][1], nodes + number[1][1]]), np.tile(edge, 4)]
    line = components(nodes + len(number[1][0]), *joins)[: len(start)]
    direction = _directions(start, end, line, place)
    aside = np.stack([-direction[:, 1], direction[:, 0]], axis=1)[line]
    offset = np.stack([np.einsum("ij,ij->i", place[x], aside) for x in (start, end)])
    low, high = np.full(len(direction), np.inf), np.full(len(direction), -np.inf)
    np.minimum.at(low, line, offset.min(0))
    np.maximum.at(high, line, offset.max(0))
    bent = (high - low > _STRAIGHT)[line]
    return np.where(bent, len(direction) + edge, line)


def _directions(start: np.ndarray, end: np.ndarray, line: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(l, 2) unit direction of each line, that of its longest edge."""
    step = place[end] - place[start]
    length = np.hypot(step[:, 0], step[:, 1])
    order = np.lexsort((length, line))
    longest = order[np.r_[runs(line[order])[1:], len(line)] - 1] if len(line) else order
    out = np.zeros((int(line.max(initial=-1)) + 1, 2))
    out[line[longest]] = step[longest] / length[longest, None]
    return out


def _new(*columns: np.ndarray) -> np.ndarray:
    """(n,) bool: the row of sorted columns differs from the one before."""
    out = np.ones(len(columns[0]), bool)
    if len(out):
        out[1:] = np.any([x[1:] != x[:-1] for x in columns], axis=0)
    return out
