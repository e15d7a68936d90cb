# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear: remove exactly what a bake made, which its tags say."""

from __future__ import annotations

import bpy
import numpy as np

from . import bake_texture, bake_vertex, fine_mesh, materials
from .mesh_arrays import bulk, same_topology


def has_bake(scene: bpy.types.Scene) -> bool:
    """True where something of a bake is left in a scene."""
    return any(
        o.enfilade.carries is not None
        or o.enfilade.hidden
        or o.enfilade.own_mesh_of is not None
        or (o.type == "MESH" and bool(o.data.enfilade.attribute or o.data.enfilade.uv_map))
        for o in scene.objects
    )


def clear(scene: bpy.types.Scene, names: frozenset[str] | None = None) -> list[str]:
    """Remove every trace of a bake from a scene, or from the objects ``names``.

    Returns what was kept and why (meshes that the user has edited since).
    """
    kept = []
    fine_mesh.remove_copies(scene, names)
    for thing in scene.objects:
        if thing.type != "MESH" or thing.library is not None or (names is not None and thing.name not in names):
            continue
        materials.hide(thing)
        if thing.data.library is None:
            bake_vertex.remove_colors(thing.data)
            bake_texture.remove_uv(thing.data)
            thing.data.enfilade.quantity = ""
        shared = thing.enfilade.own_mesh_of
        if shared is not None:
            own = thing.data
            if _same_shape(own, shared):
                thing.data = shared
                if own.users == 0 and own.enfilade.made:
                    bpy.data.meshes.remove(own)
            else:
                own.enfilade.made = False
                kept.append(f"object '{thing.name}' was edited after the bake: it keeps a mesh of its own")
            thing.enfilade.own_mesh_of = None
    for material in [m for m in bpy.data.materials if m.enfilade.made and m.users == 0]:
        bpy.data.materials.remove(material)
    # The lightmap of a light group is in use by the one that it is a part of.
    while unused := [i for i in bpy.data.images if i.enfilade.made and i.users - i.use_fake_user <= 0]:
        for image in unused:
            bpy.data.images.remove(image)
    if names is None:
        scene.enfilade.groups.clear()
        scene.enfilade.summary = scene.enfilade.baked_from = ""
    return kept


def _same_shape(a: bpy.types.Mesh, b: bpy.types.Mesh) -> bool:
    return same_topology(a, b) and np.array_equal(bulk(a.vertices, "co", np.float32, 3), bulk(b.vertices, "co", np.float32, 3))
