"""From the faces of a mesh to the planar polygons of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .corners import corner_faces, face_area_vectors, next_corner

PLANAR = 1e-4
"""A face is planar when its corners stay this near to its plane, relative to its extent."""


@dataclass(frozen=True)
class PlanarFaces:
    """P polygons that cover the faces of a mesh, in the order of the faces.

    corner : (S,) int64, corners of the mesh;  start : (P + 1,) int64, polygon p owns ``corner[start[p]:start[p + 1]]``
    face : (P,) int64, the face that each polygon is, or is a triangle of
    triangle_polygon : (T,) int64, the polygon of every triangle of the mesh, -1 where there is none
    """

    corner: np.ndarray
    start: np.ndarray
    face: np.ndarray
    triangle_polygon: np.ndarray


def planar_faces(
    position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray, triangle: np.ndarray, triangle_face: np.ndarray
) -> PlanarFaces:
    """Faces that are planar and convex stay whole, others fall into their triangles; what has no area is left out.

    position : (V, 3) float64;  corner_vertex : (C,) int;  face_start : (F + 1,) int
    triangle : (T, 3) int, corners of a triangulation of all faces;  triangle_face : (T,) int
    """
    count = len(face_start) - 1
    at, face, following = position[corner_vertex], corner_faces(face_start), next_corner(face_start)
    vector = face_area_vectors(position, corner_vertex, face_start)
    area = np.linalg.norm(vector, axis=1)
    normal = vector / np.maximum(area, 1e-300)[:, None]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, face, at)
    np.maximum.at(high, face, at)
    extent = np.linalg.norm(np.where(high >= low, high - low, 0.0), axis=1)
    local = at - low[face]
    height = np.einsum("ij,ij->i", local, normal[face])
    lowest, highest = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(lowest, face, height)
    np.maximum.at(highest, face, height)
    whole = (area > 1e-14) & (highest - lowest <= 2 * PLANAR * extent)
    edge = at[following] - at
    turn = np.empty(len(at))
    turn[following] = np.einsum("ij,ij->i", np.cross(edge, edge[following]), normal[face])
    length = np.linalg.norm(edge, axis=1)
    slack = np.empty(len(at))
    slack[following] = -1e-6 * length * length[following]
    # The turns of a convex polygon add up to one revolution: a star that winds twice turns left everywhere, too.
    angle = np.empty(len(at))
    angle[following] = np.arctan2(turn[following], np.einsum("ij,ij->i", edge, edge[following]))
    revolution = np.bincount(face, angle, count)
    whole &= np.bincount(face, turn < slack - 1e-14, count) == 0
    whole &= np.abs(revolution - 2 * np.pi) < 1e-2

    p = position[corner_vertex[triangle]]
    own_area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    single = ~whole[triangle_face] & (own_area > 1e-14)
    kept = np.flatnonzero(whole)
    alone = np.flatnonzero(single)
    owner = np.concatenate([kept, triangle_face[alone]])
    sizes = np.concatenate([np.diff(face_start)[kept], np.full(len(alone), 3)])
    source = np.concatenate([face_start[:-1][kept], 3 * alone + len(corner_vertex)])
    pool = np.concatenate([np.arange(len(corner_vertex)), triangle.reshape(-1)])
    order = np.argsort(owner, kind="stable")
    owner, sizes, source = owner[order], sizes[order], source[order]
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    corner = pool[np.repeat(source - start[:-1], sizes) + np.arange(start[-1])]

    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    of_face, of_triangle = np.full(count, -1), np.full(len(triangle), -1)
    of_face[kept] = number[: len(kept)]
    of_triangle[alone] = number[len(kept) :]
    of_triangle = np.where(whole[triangle_face], of_face[triangle_face], of_triangle)
    return PlanarFaces(corner.astype(np.int64), start, owner.astype(np.int64), of_triangle.astype(np.int64))
