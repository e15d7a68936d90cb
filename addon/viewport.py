# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows a bake in the 3D viewports and gives them back as they were.

Solid shading with flat light shows a colour attribute at once, exactly as an emission of it would look without a view
transform, and goes on hiding the backs of walls. Textures need materials that use them, and the material preview.
"""

from __future__ import annotations

import json

import bpy

from .clear import has_bake

_KEYS = ("type", "light", "color_type")


def shown(manager: bpy.types.WindowManager) -> bool:
    """True while the viewports show the bake."""
    return bool(manager.enfilade_shading)


def way_to_show(scene: bpy.types.Scene) -> str:
    """The shading that shows the bake of a scene, ``"MATERIAL"`` or ``"SOLID"``, empty where none does."""
    meshes = [o for o in scene.objects if o.type == "MESH"]
    if any(o.data.enfilade.attribute for o in meshes):
        return "SOLID"
    slots = (slot for o in meshes for slot in o.material_slots)
    return "MATERIAL" if any(slot.material is not None and slot.material.enfilade.made for slot in slots) else ""


def show(context: bpy.types.Context) -> None:
    """Switch all viewports to the bake, remembering their shading; nothing is done where it cannot be shown."""
    kind = way_to_show(context.scene)
    if shown(context.window_manager) or not kind:
        return
    saved = {}
    for key, space in _viewports(context):
        saved[key] = {name: getattr(space.shading, name) for name in _KEYS}
        # The type comes first: what "light" may be depends on it.
        space.shading.type = kind
        if kind == "SOLID":
            space.shading.light = "FLAT"
            space.shading.color_type = "VERTEX"
    context.window_manager.enfilade_shading = json.dumps(saved)


def restore(context: bpy.types.Context) -> None:
    """Give the viewports the shading back that they had before :func:`show`."""
    saved = json.loads(context.window_manager.enfilade_shading or "{}")
    for key, space in _viewports(context):
        if key in saved:
            space.shading.type = "SOLID"
            for name in ("light", "color_type", "type"):
                setattr(space.shading, name, saved[key][name])
    context.window_manager.enfilade_shading = ""


def _viewports(context: bpy.types.Context):
    for screen in bpy.data.screens:
        for number, area in enumerate(screen.areas):
            if area.type == "VIEW_3D":
                yield f"{screen.name}/{number}", area.spaces.active


@bpy.app.handlers.persistent
def _after_undo(*_) -> None:
    """Shading is no part of undo: without this, viewports would show a bake that is gone."""
    if shown(bpy.context.window_manager) and not has_bake(bpy.context.scene):
        restore(bpy.context)


def register() -> None:
    bpy.types.WindowManager.enfilade_shading = bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(_after_undo)


def unregister() -> None:
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.remove(_after_undo)
    del bpy.types.WindowManager.enfilade_shading
