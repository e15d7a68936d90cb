# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blender side: it reads the scene into arrays, hands them to the core and writes the light back."""

from __future__ import annotations

import atexit

import bpy  # its other modules, such as bmesh, can be imported only after it

from . import (
    check_operators,
    command_line,
    gltf_operators,
    last_light,
    light_report,
    menus,
    operators,
    outdated,
    overlay,
    overlay_operators,
    overlay_panel,
    panel,
    portal_operators,
    preferences,
    presets,
    properties,
    recombine,
    roles,
    room_operators,
    setup_panel,
    translations,
    viewport,
)

MODULES = (
    translations,
    preferences,
    properties,
    recombine,
    roles,
    viewport,
    last_light,
    outdated,
    operators,
    portal_operators,
    overlay,
    overlay_operators,
    room_operators,
    gltf_operators,
    presets,
    panel,
    setup_panel,
    check_operators,
    overlay_panel,
    light_report,
    menus,
    command_line,
)
"""In the order of their registration: panels draw what the properties hold."""


def register() -> None:
    """Make the properties, operators, panels and the command known to Blender."""
    for module in MODULES:
        module.register()
    # In plain Python nobody disables an extension before the end, and some versions of bpy crash on what is still registered then.
    if not bpy.app.binary_path:
        atexit.register(unregister)


def unregister() -> None:
    """Take everything back, in the opposite order."""
    atexit.unregister(unregister)
    for module in reversed(MODULES):
        module.unregister()
