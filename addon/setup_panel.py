# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels that prepare a scene: the buttons for rooms and portals, and what a collection or an object is to a bake."""

from __future__ import annotations

import bpy

from . import operators
from .membership import rendered_objects
from .roles import portal_objects, roles, rooms_of

_SAYS = {
    "ROOM": "A room",
    "PORTALS": "Its faces are portals",
    "IGNORED": "Takes no part in the bake",
}


def draw_setup(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The buttons that make rooms and portals, those of the mode that one is in."""
    column = layout.column(align=True)
    column.active = operators.progress() is None
    if context.mode == "EDIT_MESH":
        column.operator("enfilade.portal_from_faces", icon="MESH_PLANE")
    else:
        column.operator("enfilade.portal_from_objects", icon="MESH_PLANE")
        column.operator("enfilade.mark_room", icon="OUTLINER_COLLECTION")
        column.operator("enfilade.find_rooms", icon="VIEWZOOM")
    note = layout.column(align=True)
    note.active = False
    note.label(text=count_of(context.scene), translate=False)


def count_of(scene: bpy.types.Scene) -> str:
    """How many rooms and portals a scene has."""
    rooms = len(rooms_of(scene))
    portals = sum(len(o.data.polygons) for o in portal_objects(scene))
    said = f"{rooms} room{'s' * (rooms != 1)}" if rooms else "The whole scene is one room"
    return f"{said}, {portals} portal{'s' * (portals != 1)}" if rooms or portals else said


class ENFILADE_PT_setup(bpy.types.Panel):
    """Rooms and portals."""

    bl_label = "Rooms and Portals"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Enfilade"
    bl_parent_id = "ENFILADE_PT_sidebar"
    bl_order = 0

    def draw(self, context: bpy.types.Context) -> None:
        draw_setup(self.layout, context)


class ENFILADE_PT_collection(bpy.types.Panel):
    """What a collection is to a bake."""

    bl_label = "Enfilade"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "collection"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.collection is not None and context.collection != context.scene.collection

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        collection = context.collection
        layout.prop(collection.enfilade, "role")
        if collection.enfilade.role == "AUTO":
            note = layout.row()
            note.active = False
            note.label(text=_SAYS.get(roles(context.scene).get(collection, ""), "Nothing of its own"), icon="INFO")


class ENFILADE_PT_object(bpy.types.Panel):
    """Whether an object takes part in a bake."""

    bl_label = "Enfilade"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = context.object
        return thing is not None and thing.type in ("MESH", "CURVE", "SURFACE", "META", "FONT", "LIGHT", "EMPTY")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        thing = context.object
        layout.prop(thing.enfilade, "left_out")
        if thing in portal_objects(context.scene):
            layout.prop(thing.enfilade, "by_hand")
            column = layout.column()
            column.active = thing.enfilade.by_hand
            column.prop(thing.enfilade, "behind")
            column.prop(thing.enfilade, "in_front")
            layout.prop(thing.enfilade, "transmittance")
            return
        if thing.type == "MESH":
            row = layout.row()
            row.active = not thing.enfilade.left_out and context.scene.enfilade.bake.target == "texture"
            row.prop(thing.enfilade, "texel_scale")
        if not thing.enfilade.left_out and thing not in rendered_objects(context.view_layer):
            note = layout.row()
            note.active = False
            note.label(text="Not visible in renders: takes no part", icon="INFO")


_CLASSES = (ENFILADE_PT_setup, ENFILADE_PT_collection, ENFILADE_PT_object)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
