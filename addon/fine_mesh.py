# SPDX-License-Identifier: GPL-3.0-or-later
"""Subdivided copies of objects that carry the light where their own mesh is too coarse."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.bake_values import FineCarrier
from .mesh_arrays import bulk

COLLECTION = "Enfilade Bake"
"""The copies lie in this collection, which goes when the last of them goes."""

_KEYS = {
    "FLOAT": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
}
_FACE_KEYS = {"INT": ("value", np.int32), "BOOLEAN": ("value", bool), "FLOAT": ("value", np.float32)}


def make_mesh(thing: bpy.types.Object, depsgraph: bpy.types.Depsgraph, fine: FineCarrier, triangle: np.ndarray) -> bpy.types.Mesh:
    """The evaluated mesh of an object, subdivided, with its UV maps, attributes and materials.

    triangle : (T, 3) corners of the coarse mesh's triangulation, which ``fine`` refers to
    """
    source = bpy.data.meshes.new_from_object(thing.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph)
    try:
        return _mesh(source, fine, triangle)
    finally:
        bpy.data.meshes.remove(source)


def make_copy(scene: bpy.types.Scene, thing: bpy.types.Object, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """A copy of an object with another mesh, in the scene; the original is hidden and both are tagged."""
    copy = thing.copy()
    copy.name = f"{thing.name} (bake)"
    copy.modifiers.clear()
    copy.data = mesh
    copy.enfilade.carries = thing
    home = scene.collection.children.get(COLLECTION)
    if home is None:
        home = bpy.data.collections.new(COLLECTION)
        scene.collection.children.link(home)
    home.objects.link(copy)
    thing.enfilade.hidden = True
    thing.enfilade.was_shown = not thing.hide_viewport
    thing.hide_render = thing.hide_viewport = True
    return copy


def remove_copies(scene: bpy.types.Scene, names: frozenset[str] | None = None) -> int:
    """Take all copies of a scene away, or those of the objects ``names``, show what they stood for, and return how many there were."""
    removed = 0
    for thing in [o for o in scene.objects if o.enfilade.carries is not None and (names is None or o.enfilade.carries.name in names)]:
        mesh = thing.data
        bpy.data.objects.remove(thing)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
        removed += 1
    for thing in scene.objects:
        if thing.enfilade.hidden and (names is None or thing.name in names):
            thing.hide_render = False
            thing.hide_viewport = thing.hide_viewport and not thing.enfilade.was_shown
            thing.enfilade.hidden = thing.enfilade.was_shown = False
    home = scene.collection.children.get(COLLECTION)
    if removed and home is not None and not home.objects and not home.children:
        bpy.data.collections.remove(home)
    return removed


def _mesh(source: bpy.types.Mesh, fine: FineCarrier, triangle: np.ndarray) -> bpy.types.Mesh:
    corner = triangle[np.repeat(fine.parent, 3)]
    weight = fine.weight
    vertex = bulk(source.loops, "vertex_index", np.int32)
    at = np.einsum("ci,cij->cj", weight, bulk(source.vertices, "co", np.float32, 3).astype(np.float64)[vertex[corner]])
    count, faces = len(fine.carrier.position), len(fine.parent)
    position = np.zeros((count, 3), np.float32)
    position[fine.carrier.corner_vertex] = at
    mesh = bpy.data.meshes.new(f"{source.name} (bake)")
    mesh.enfilade.made = True
    mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", position.ravel())
    mesh.loops.add(3 * faces)
    mesh.loops.foreach_set("vertex_index", fine.carrier.corner_vertex.astype(np.int32))
    mesh.polygons.add(faces)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * faces, 3, dtype=np.int32))
    for material in source.materials:
        mesh.materials.append(material)
    owner = np.empty(len(vertex), np.int64)
    starts = bulk(source.polygons, "loop_start", np.int32)
    owner[:] = np.searchsorted(starts, np.arange(len(vertex)), side="right") - 1
    face = owner[triangle[fine.parent, 0]]
    mesh.polygons.foreach_set("material_index", bulk(source.polygons, "material_index", np.int32)[face])
    mesh.update(calc_edges=True)
    for name in [a.name for a in source.attributes if not a.name.startswith(".") and a.name != "position" and not a.is_internal]:
        _copy_attribute(mesh, source, name, corner, weight, vertex, fine.carrier.corner_vertex, face)
    mesh.update()
    return mesh


def _copy_attribute(mesh, source, name, corner, weight, vertex, fine_vertex, face) -> None:
    """Carry one attribute over: interpolated at corners and vertices, as it is on faces."""
    old = source.attributes[name]
    if old.domain == "FACE" and old.data_type in _FACE_KEYS and name != "material_index":
        key, dtype = _FACE_KEYS[old.data_type]
        values = bulk(old.data, key, dtype)[face]
        made = mesh.attributes.get(name) or mesh.attributes.new(name, old.data_type, "FACE")
        if made is not None:
            mesh.attributes[name].data.foreach_set(key, values)
        return
    if old.domain not in ("CORNER", "POINT") or old.data_type not in _KEYS:
        return
    key, width = _KEYS[old.data_type]
    values = bulk(old.data, key, np.float32, width).reshape(-1, width)
    spread = np.einsum("ci,cij->cj", weight, values[corner if old.domain == "CORNER" else vertex[corner]]).astype(np.float32)
    if old.domain == "POINT":
        at_vertex = np.zeros((len(mesh.vertices), width), np.float32)
        at_vertex[fine_vertex] = spread
        spread = at_vertex
    if mesh.attributes.new(name, old.data_type, old.domain) is not None:
        mesh.attributes[name].data.foreach_set(key, np.ascontiguousarray(spread).ravel())
