# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels in the render properties, and the sidebar of the 3D viewport."""

from __future__ import annotations

import bpy

from . import operators, outdated, viewport
from .presets import ENFILADE_PT_presets
from .roles import rooms_of
from .setup_panel import draw_setup


def _draw_bake(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The button, or while it works how far it is."""
    step = operators.progress()
    if step is None:
        row = layout.row()
        row.scale_y = 1.6
        row.operator("enfilade.bake", icon="LIGHT_AREA")
        return
    row = layout.row(align=True)
    row.scale_y = 1.6
    row.progress(factor=step.fraction, text=f"{step.stage.capitalize()}  {100 * step.fraction:.0f} %  {step.time_left}".rstrip())
    row.operator("enfilade.cancel", text="", icon="X")


def _draw_after(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    row = layout.row(align=True)
    row.operator("enfilade.show_bake", icon="HIDE_OFF", depress=viewport.shown(context.window_manager), text="Show Bake")
    row.operator("enfilade.clear", icon="TRASH", text="Clear")
    row.operator("enfilade.export_gltf", icon="EXPORT", text="")
    if outdated.outdated(context.scene):
        layout.label(text="Out of date: something has changed", icon="ERROR")
    if context.scene.enfilade.summary:
        if len(rooms_of(context.scene)) > 1:
            layout.operator("enfilade.bake", text="Rooms of Selection", icon="FILE_REFRESH").scope = "SELECTED"
        column = layout.column(align=True)
        column.active = False
        for part in _lines(context.scene.enfilade.summary):
            column.label(text=part)


def _draw_groups(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """A slider and a colour for each light group."""
    column = layout.column(align=True)
    column.enabled = operators.progress() is None and context.mode == "OBJECT"
    for group in context.scene.enfilade.groups:
        row = column.split(factor=0.78, align=True)
        row.prop(group, "strength", text=group.name, translate=False, slider=True)
        row.prop(group, "color", text="")


def _lines(summary: str) -> list[str]:
    parts = summary.split(", ")
    return [", ".join(parts[:3]), ", ".join(parts[3:])] if len(parts) > 3 else [summary]


class _RenderPanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class ENFILADE_PT_render(_RenderPanel, bpy.types.Panel):
    """Bakes the light of a building."""

    bl_label = "Enfilade"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        ENFILADE_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        _draw_bake(layout, context)
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.active = operators.progress() is None
        column.prop(context.scene.enfilade.solve, "quality")
        column.row().prop(context.scene.enfilade.bake, "target", expand=True)
        _draw_after(layout, context)


class _SubPanel(_RenderPanel):
    bl_parent_id = "ENFILADE_PT_render"
    bl_options = {"DEFAULT_CLOSED"}

    def start(self) -> bpy.types.UILayout:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        column = self.layout.column()
        column.active = operators.progress() is None
        return column


class ENFILADE_PT_rooms(_SubPanel, bpy.types.Panel):
    """Which collections are rooms and portals."""

    bl_label = "Rooms and Portals"
    bl_order = 0

    def draw(self, context: bpy.types.Context) -> None:
        column = self.start()
        settings = context.scene.enfilade
        column.prop(settings, "rooms")
        column.prop(settings, "portals")
        draw_setup(self.layout, context)


class ENFILADE_PT_groups(_SubPanel, bpy.types.Panel):
    """Dims and colours the light groups of a bake."""

    bl_label = "Light Groups"
    bl_order = 1
    bl_options = set()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return len(context.scene.enfilade.groups) > 0

    def draw(self, context: bpy.types.Context) -> None:
        _draw_groups(self.layout, context)


class ENFILADE_PT_output(_SubPanel, bpy.types.Panel):
    """Where the light goes."""

    bl_label = "Output"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        column = self.start()
        bake = context.scene.enfilade.bake
        column.prop(bake, "quantity")
        column.prop(bake, "bake_name")
        column.separator()
        if bake.target == "vertex":
            column.prop(bake, "domain")
        else:
            for name in ("atlas", "texel_density", "max_resolution", "margin", "image_format", "image_folder"):
                column.prop(bake, name)
        column.separator()
        column.prop(bake, "groups")
        column.prop(bake, "material")
        column.prop(bake, "subdivide")


class ENFILADE_PT_solver(_SubPanel, bpy.types.Panel):
    """How the light is computed."""

    bl_label = "Solver"
    bl_order = 3

    def draw(self, context: bpy.types.Context) -> None:
        column = self.start()
        solve = context.scene.enfilade.solve
        for group in (
            ("reflected", "order", "min_element_size", "max_iterations"),
            ("average", "large_polygon", "distance", "reflectance_weight", "emission_weight", "orientation_weight"),
            ("seeding", "split_merge", "huge_room", "hierarchy_children"),
            ("emitters", "volumes", "ordering"),
            ("memory", "store", "threads", "seed"),
        ):
            for name in group:
                column.prop(solve, name)
            column.separator()


class ENFILADE_PT_sidebar(bpy.types.Panel):
    """The few things that one needs at hand."""

    bl_label = "Enfilade"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Enfilade"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        _draw_bake(layout, context)
        column = layout.column()
        column.active = operators.progress() is None
        column.row().prop(context.scene.enfilade.solve, "quality", expand=True)
        _draw_after(layout, context)


class ENFILADE_PT_sidebar_groups(bpy.types.Panel):
    """The light groups at hand."""

    bl_label = "Light Groups"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Enfilade"
    bl_parent_id = "ENFILADE_PT_sidebar"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return len(context.scene.enfilade.groups) > 0

    def draw(self, context: bpy.types.Context) -> None:
        _draw_groups(self.layout, context)


_CLASSES = (
    ENFILADE_PT_render,
    ENFILADE_PT_rooms,
    ENFILADE_PT_groups,
    ENFILADE_PT_output,
    ENFILADE_PT_solver,
    ENFILADE_PT_sidebar,
    ENFILADE_PT_sidebar_groups,
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
