# SPDX-License-Identifier: GPL-3.0-or-later
"""Enfilade: diffuse global illumination for buildings of rooms and portals, baked into Blender meshes.

This file stays lazy: test runners and Blender's extension scanner import it without wanting anything of it.
"""


def register():
    """Called by Blender when the extension is enabled."""
    from . import addon

    addon.register()


def unregister():
    """Called by Blender when the extension is disabled."""
    from . import addon

    addon.unregister()
