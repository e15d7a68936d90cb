"""Values at the corners of a mesh's faces: averaged across each surface, kept apart at hard edges."""

from __future__ import annotations

import math

import numpy as np

from .grouping import components

HARD_ANGLE = math.radians(40.0)
"""Faces whose normals differ by more than this (radians) do not share the light of their common corners."""


def next_corner(face_start: np.ndarray) -> np.ndarray:
    """(C,) int64: the corner that follows each corner in its face; face f owns corners ``face_start[f]:face_start[f + 1]``."""
    following = np.arange(1, face_start[-1] + 1)
    filled = np.diff(face_start) > 0
    following[face_start[1:][filled] - 1] = face_start[:-1][filled]
    return following


def corner_faces(face_start: np.ndarray) -> np.ndarray:
    """(C,) int64: the face of every corner."""
    return np.repeat(np.arange(len(face_start) - 1), np.diff(face_start))


def face_area_vectors(position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray) -> np.ndarray:
    """(F, 3) float64: unit normal times area of every face (Newell), in the squared unit of ``position`` (V, 3)."""
    at, face = position[corner_vertex], corner_faces(face_start)
    # Measured from a corner of the face: products of coordinates far from the origin would cancel.
    local = at - at[face_start[:-1]][face] if len(at) else at
    out = np.zeros((len(face_start) - 1, 3))
    np.add.at(out, face, 0.5 * np.cross(local, local[next_corner(face_start)]))
    return out


def corner_angles(position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray) -> np.ndarray:
    """(C,) float64: the angle of the face at every corner, radians; 0 where an edge has no length."""
    at, following = position[corner_vertex], next_corner(face_start)
    forward = at[following] - at
    backward = np.empty_like(forward)
    backward[following] = -forward
    return np.arctan2(np.linalg.norm(np.cross(forward, backward), axis=1), np.einsum("ij,ij->i", forward, backward))


def linked_corners(
    position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray, sharp: np.ndarray | None = None, angle: float = HARD_ANGLE
) -> np.ndarray:
    """(C,) int64: number of the group of every corner.

    Two corners are in one group when they are at the same vertex and a walk around it leads from one to the other
    without crossing a hard edge. An edge is hard where it is marked, where other than two faces meet or two that turn
    opposite ways, and where the normals of its faces differ by more than ``angle`` (radians).

    position : (V, 3) float64;  corner_vertex : (C,) int;  face_start : (F + 1,) int
    sharp : (C,) bool or None, whether the edge from a corner to the next one is marked hard
    """
    count = len(corner_vertex)
    if count == 0:
        return np.zeros(0, np.int64)
    following, face = next_corner(face_start), corner_faces(face_start)
    start, end = corner_vertex.astype(np.int64), corner_vertex[following].astype(np.int64)
    key = np.minimum(start, end) * len(position) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    pairs = first[np.diff(first, append=count) == 2]
    a, b = order[pairs], order[pairs + 1]

    vector = face_area_vectors(position, corner_vertex, face_start)
    normal = vector / np.maximum(np.linalg.norm(vector, axis=1), 1e-300)[:, None]
    soft = (start[a] == end[b]) & (start[a] != end[a])
    soft &= np.einsum("ij,ij->i", normal[face[a]], normal[face[b]]) >= math.cos(angle)
    if sharp is not None:
        soft &= ~(sharp[a] | sharp[b])
    a, b = a[soft], b[soft]
    # An edge shared by two faces joins, at each of its two ends, one corner of each.
    return components(count, np.concatenate([a, following[a]]), np.concatenate([following[b], b]))


def average_groups(value: np.ndarray, group: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(C, K) float64: every value replaced by the weighted mean of its group; the plain mean where all weights are 0.

    value : (C, K);  group : (C,) int, from 0 without gaps;  weight : (C,), 0 or more
    """
    count = int(group.max()) + 1 if len(group) else 0
    weight = np.asarray(weight, np.float64)
    idle = np.bincount(group, weight, count) <= 0.0
    weight = np.where(idle[group], 1.0, weight)
    total = np.bincount(group, weight, count)
    mean = np.stack([np.bincount(group, weight * column, count) / total for column in np.asarray(value, np.float64).T], axis=1)
    return mean[group]
