# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows a bake in the 3D viewports and gives them back as they were.

Solid shading with flat light and attribute colours shows a colour attribute exactly as an emission of it would look.
"""

from __future__ import annotations

import json

import bpy

_KEYS = ("type", "light", "color_type")


def shown(manager: bpy.types.WindowManager) -> bool:
    """True while the viewports show the bake."""
    return bool(manager.enfilade_shading)


def show(context: bpy.types.Context, textured: bool) -> None:
    """Switch all viewports to the bake, remembering their shading."""
    if shown(context.window_manager):
        return
    saved = {}
    for key, space in _viewports(context):
        saved[key] = {name: getattr(space.shading, name) for name in _KEYS}
        # The type comes first: what "light" may be depends on it.
        space.shading.type = "MATERIAL" if textured else "SOLID"
        if not textured:
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
