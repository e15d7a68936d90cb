"""Subdivision of a triangle mesh until no edge is longer than a limit, without gaps or T-junctions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import SceneError

LARGEST = 4_000_000
"""Most triangles that one mesh may become."""


@dataclass(frozen=True)
class Subdivided:
    """T triangles, each inside one of the triangles that were given.

    vertex : (T, 3) int64, vertices 0..count-1, shared between neighbours;  count : number of vertices
    parent : (T,) int64, the given triangle;  weight : (T, 3, 3) float64, barycentric coordinates of each corner in it
    """

    vertex: np.ndarray
    count: int
    parent: np.ndarray
    weight: np.ndarray


def subdivide(position: np.ndarray, triangles: np.ndarray, limit: float) -> Subdivided:
    """Halve edges longer than ``limit`` again and again; which edges are cut depends on the edge alone, so neighbours fit.

    position : (V, 3) float64;  triangles : (T, 3) int, vertices;  limit : unit of the positions, above 0

    Raises :class:`SceneError` when more than :data:`LARGEST` triangles would come out.
    """
    vertex = np.asarray(triangles, np.int64).copy()
    parent = np.arange(len(vertex))
    weight = np.broadcast_to(np.eye(3), (len(vertex), 3, 3)).copy()
    position = np.asarray(position, np.float64)
    while True:
        start, end = vertex, np.roll(vertex, -1, axis=1)
        long = np.linalg.norm(position[end] - position[start], axis=2) > limit
        if not long.any():
            return Subdivided(vertex, len(position), parent, weight)
        if len(vertex) + long.sum() > LARGEST:
            raise SceneError(f"edges of {limit:g} m would make more than {LARGEST} triangles of one mesh: take a longer edge")
        key = np.minimum(start, end) * len(position) + np.maximum(start, end)
        keys, number = np.unique(key[long], return_inverse=True)
        middle = np.full(vertex.shape, -1)
        middle[long] = len(position) + number.reshape(-1)
        a, b = np.divmod(keys, len(position))
        position = np.concatenate([position, 0.5 * (position[a] + position[b])])
        vertex, parent, weight = _split(position, vertex, parent, weight, middle)


def _split(position, vertex, parent, weight, middle):
    """One round: triangles with 1, 2 or 3 cut edges become 2, 3 or 4; ``middle`` (T, 3) holds the new vertices or -1."""
    cut = middle >= 0
    number = cut.sum(axis=1)
    # Turn each triangle so that its cut edges come first: edge 0, edges 0 and 1, or all.
    turn = np.where(number == 1, cut.argmax(axis=1), np.where(number == 2, ((~cut).argmax(axis=1) + 1) % 3, 0))
    column = (np.arange(3) + turn[:, None]) % 3
    vertex = np.take_along_axis(vertex, column, 1)
    middle = np.take_along_axis(middle, column, 1)
    weight = np.take_along_axis(weight, column[:, :, None], 1)
    points = np.concatenate([vertex, middle], axis=1)  # 0 1 2 corners, 3 4 5 middles of the edges 01 12 20
    places = np.concatenate([weight, 0.5 * (weight + np.roll(weight, -1, axis=1))], axis=1)
    # The quad that two cuts leave over is halved along its shorter diagonal.
    gap = lambda i, j: np.linalg.norm(position[points[:, i]] - position[points[:, j]], axis=1)  # noqa: E731
    other = gap(0, 4) <= gap(3, 2)
    patterns = [
        (number == 0, [(0, 1, 2)]),
        (number == 1, [(0, 3, 2), (3, 1, 2)]),
        ((number == 2) & other, [(3, 1, 4), (0, 3, 4), (0, 4, 2)]),
        ((number == 2) & ~other, [(3, 1, 4), (0, 3, 2), (3, 4, 2)]),
        (number == 3, [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]),
    ]
    parts = [(points[rows][:, t], parent[rows], places[rows][:, t]) for rows, shapes in patterns for t in shapes]
    vertex, parent, weight = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(parent, kind="stable")
    return vertex[order], parent[order], weight[order]
