# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender mesh as NumPy arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import bpy
import numpy as np


@dataclass(frozen=True)
class MeshArrays:
    """The faces of a mesh, its positions in the world.

    position : (V, 3) float64, metres;  corner_vertex : (C,) int32;  face_start : (F + 1,) int64
    material : (F,) int32, slot of every face;  sharp : (C,) bool, the edge from a corner to the next is marked sharp
    triangle : (T, 3) int32, corners of Blender's triangulation;  triangle_face : (T,) int32
    mirrored : the transform turns the faces over, so that loops must be read backwards
    uv : (C, 2) of the UV maps that were asked for, by name; the empty name is the one that renders take
    """

    position: np.ndarray
    corner_vertex: np.ndarray
    face_start: np.ndarray
    material: np.ndarray
    sharp: np.ndarray
    triangle: np.ndarray
    triangle_face: np.ndarray
    mirrored: bool
    uv: dict[str, np.ndarray] = field(default_factory=dict)


def read_mesh(mesh: bpy.types.Mesh, matrix: np.ndarray, scale: float, uv_maps: Iterable[str] = ()) -> MeshArrays:
    """All arrays of a mesh; ``matrix`` (4, 4) puts it into the world, ``scale`` are the metres of one unit.

    Of the ``uv_maps`` those that it has.
    """
    position = bulk(mesh.vertices, "co", np.float32, 3).astype(np.float64)
    position = (position @ matrix[:3, :3].T + matrix[:3, 3]) * scale
    face_start = np.append(bulk(mesh.polygons, "loop_start", np.int32), len(mesh.loops)).astype(np.int64)
    sharp = np.zeros(len(mesh.loops), bool)
    marks = mesh.attributes.get("sharp_edge")
    if marks is not None and marks.domain == "EDGE" and len(marks.data) == len(mesh.edges):
        sharp = bulk(marks.data, "value", bool)[bulk(mesh.loops, "edge_index", np.int32)]
    mesh.calc_loop_triangles()
    return MeshArrays(
        position,
        bulk(mesh.loops, "vertex_index", np.int32),
        face_start,
        bulk(mesh.polygons, "material_index", np.int32),
        sharp,
        bulk(mesh.loop_triangles, "loops", np.int32, 3),
        bulk(mesh.loop_triangles, "polygon_index", np.int32),
        bool(np.linalg.det(matrix[:3, :3]) < 0.0),
        {name: uv for name in uv_maps if (uv := _uv(mesh, name)) is not None},
    )


def _uv(mesh: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """(C, 2) float64 of a UV map, without name of the one that renders take."""
    layer = mesh.uv_layers.get(name) if name else next((layer for layer in mesh.uv_layers if layer.active_render), None)
    if layer is None or len(layer.uv) != len(mesh.loops):
        return None
    return bulk(layer.uv, "vector", np.float32, 2).astype(np.float64)


def bulk(data: bpy.types.bpy_prop_collection, key: str, dtype: type, width: int = 1) -> np.ndarray:
    """One property of every item: (N,) or, wider, (N, width)."""
    out = np.empty(len(data) * width, dtype)
    data.foreach_get(key, out)
    return out.reshape(-1, width) if width > 1 else out


def same_topology(a: bpy.types.Mesh, b: bpy.types.Mesh) -> bool:
    """True where two meshes have the same faces with the same corners."""
    if (len(a.vertices), len(a.loops), len(a.polygons)) != (len(b.vertices), len(b.loops), len(b.polygons)):
        return False
    return np.array_equal(bulk(a.loops, "vertex_index", np.int32), bulk(b.loops, "vertex_index", np.int32)) and np.array_equal(
        bulk(a.polygons, "loop_start", np.int32), bulk(b.polygons, "loop_start", np.int32)
    )
