"""What is odd about the faces of a mesh: bent ones, ones that are turned against their neighbours, and how they hang together."""

from __future__ import annotations

import numpy as np

from .corners import corner_faces, face_area_vectors, next_corner
from .grouping import components

FLAT = 1e-3
"""A face is bent when its corners are farther than this from its plane, relative to its extent: less cannot be seen."""


def bent_faces(position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray) -> np.ndarray:
    """(n,) int64: faces whose corners do not lie in one plane.

    position : (V, 3) float64;  corner_vertex : (C,) int;  face_start : (F + 1,) int
    """
    count = len(face_start) - 1
    face = corner_faces(face_start)
    vector = face_area_vectors(position, corner_vertex, face_start)
    normal = vector / np.maximum(np.linalg.norm(vector, axis=1), 1e-300)[:, None]
    at = position[corner_vertex]
    local = at - at[face_start[:-1][face]]
    height = np.einsum("ij,ij->i", local, normal[face])
    lowest, highest, extent = np.zeros(count), np.zeros(count), np.zeros(count)
    np.minimum.at(lowest, face, height)
    np.maximum.at(highest, face, height)
    np.maximum.at(extent, face, np.linalg.norm(local, axis=1))
    return np.flatnonzero((highest - lowest > FLAT * extent) & (vector != 0).any(axis=1))


def turned_faces(corner_vertex: np.ndarray, face_start: np.ndarray) -> np.ndarray:
    """(n,) int64: faces with a neighbour that looks the other way: both run along their common edge in the same direction.

    Of each part of a mesh the smaller side is named. Edges of one or of more than two faces tell nothing.
    """
    count = len(face_start) - 1
    first, second, same = _neighbours(corner_vertex, face_start)
    if not same.any():
        return np.zeros(0, np.int64)
    # Two copies of every face, as it is and turned over: what hangs together must look the same way.
    a = np.concatenate([first, first + count])
    b = np.concatenate([np.where(same, second + count, second), np.where(same, second, second + count)])
    label = components(2 * count, a, b)
    island = components(count, first, second)
    firm = label[:count] != label[count:]  # a Moebius strip has no sides
    side = np.full(int(island.max(initial=-1)) + 1, 2 * count)
    np.minimum.at(side, island, np.minimum(label[:count], label[count:]))
    over = label[:count] != side[island]
    turned = np.bincount(island, over)
    total = np.bincount(island)
    smaller = np.where((turned * 2 > total)[island], ~over, over)
    return np.flatnonzero(firm & smaller)


def islands(corner_vertex: np.ndarray, face_start: np.ndarray) -> np.ndarray:
    """(F,) int64: the part of the mesh that each face hangs together with by edges."""
    first, second, _ = _neighbours(corner_vertex, face_start)
    return components(len(face_start) - 1, first, second)


def _neighbours(corner_vertex: np.ndarray, face_start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of faces with a common edge, and whether both run along it in the same direction."""
    face = corner_faces(face_start)
    start, end = corner_vertex.astype(np.int64), corner_vertex[next_corner(face_start)].astype(np.int64)
    forward = start < end
    key = np.where(forward, start, end) * (int(corner_vertex.max(initial=0)) + 1) + np.where(forward, end, start)
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.diff(key[order], prepend=-1))
    size = np.diff(np.append(begin, len(order)))
    pair = begin[size == 2]
    one, other = order[pair], order[pair + 1]
    return face[one], face[other], forward[one] == forward[other]
