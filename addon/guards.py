# SPDX-License-Identifier: GPL-3.0-or-later
"""What buttons have in common: when they can be pressed, how they say what is wrong, and that the panels show what they did."""

from __future__ import annotations

import bpy

from ..core.options import OptionError
from ..core.scene import SceneError

REFUSALS = (SceneError, OptionError, MemoryError, OSError)
"""What is wrong with the input or the machine, said in one sentence; everything else is a defect and keeps its traceback."""


def in_object_mode(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """True in object mode; otherwise the operator's poll message says what to do."""
    if context.mode == "OBJECT":
        return True
    operator.poll_message_set("Switch to object mode first")
    return False


def sentence(error: BaseException) -> str:
    """What was refused, for people."""
    if isinstance(error, MemoryError):
        return "There is not enough memory for this bake: take a lower quality or a smaller part of the building"
    return capital(str(error))


def capital(text: str) -> str:
    """The text with a capital first letter; all others stay as they are."""
    return text[:1].upper() + text[1:]


def redraw_panels(context: bpy.types.Context) -> None:
    """Draw the panels anew, and not the 3D viewports themselves: that would take the machine from the solver."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            kind = {"PROPERTIES": "WINDOW", "VIEW_3D": "UI"}.get(area.type)
            for region in area.regions:
                if region.type == kind:
                    region.tag_redraw()
