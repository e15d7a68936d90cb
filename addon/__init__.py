# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blender side: it reads the scene into arrays, hands them to the core and writes the light back."""

from __future__ import annotations

from . import roles
from . import command_line, operators, overlay, overlay_operators, overlay_panel, panel, properties, viewport

MODULES = (properties, viewport, operators, overlay, overlay_operators, panel, overlay_panel, command_line)
"""In the order of their registration: panels draw what the properties hold."""

SET_UP = (roles,)
"""What prepares a scene for the bake; its panels lie inside those above."""


def register() -> None:
    """Make the properties, operators, panels and the command known to Blender."""
    for module in (*MODULES, *SET_UP):
        module.register()


def unregister() -> None:
    """Take everything back, in the opposite order."""
    for module in reversed((*MODULES, *SET_UP)):
        module.unregister()
