# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of the sidebar that shows clusters and visibility."""

from __future__ import annotations

import bpy

from . import overlay


class ENFILADE_PT_overlay(bpy.types.Panel):
    """What the solver works with, drawn over the viewports."""

    bl_label = "Light and Visibility"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Enfilade"
    bl_parent_id = "ENFILADE_PT_sidebar"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        column = layout.column(align=True)
        settings = context.window_manager.enfilade_overlay
        row = column.row(align=True)
        clusters = _switch(row, "enfilade.show_clusters", "Show Clusters", "OUTLINER_OB_POINTCLOUD")
        if clusters is not None:
            clusters.level = settings.level
        row.prop(settings, "level")
        row = column.row(align=True)
        row.operator("enfilade.pick_visible", icon="EYEDROPPER", text="Pick Cluster")
        _switch(row, "enfilade.show_visible", "Of Active", "OBJECT_DATA")
        _switch(column, "enfilade.find_leaks", "Find Leaks", "ERROR")
        _draw_light(layout, settings)
        layout.operator("enfilade.hide_overlay", icon="HIDE_ON")
        if overlay.content() is None:
            return
        parts = {layer.part for layer in overlay.content().layers}
        column = layout.column(heading="Show", align=True)
        column.use_property_split = True
        column.use_property_decorate = False
        for name in ("surfaces", "boxes", "windows", "volumes"):
            if name in parts:
                column.prop(settings, name)
        column.prop(settings, "in_front")


def _switch(layout: bpy.types.UILayout, name: str, text: str, icon: str) -> bpy.types.OperatorProperties | None:
    """A button that shows something; while that is shown it is pressed in, and takes it away."""
    if overlay.shown_by() == name:
        layout.operator("enfilade.hide_overlay", text=text, icon=icon, depress=True)
        return None
    return layout.operator(name, text=text, icon=icon)


def _draw_light(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """What the last bake found."""
    column = layout.column(align=True)
    _switch(column, "enfilade.false_color", "False Colour", "COLOR")
    row = column.row(align=True)
    _switch(row, "enfilade.show_elements", "Elements", "MOD_TRIANGULATE")
    _switch(row, "enfilade.show_error", "Error", "SEQ_HISTOGRAM")
    drawn = overlay.content()
    if drawn is not None and drawn.scale is not None and drawn.scale.unit == "lux":
        row = column.row(align=True)
        row.prop(settings, "lux_top")
        row.prop(settings, "lux_logarithmic", text="", icon="IPO_EXPO")


def register() -> None:
    bpy.utils.register_class(ENFILADE_PT_overlay)


def unregister() -> None:
    bpy.utils.unregister_class(ENFILADE_PT_overlay)
