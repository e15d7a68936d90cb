# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons in Blender's menus, where its search finds them."""

from __future__ import annotations

import bpy


class ENFILADE_MT_object(bpy.types.Menu):
    """All that one does with rooms, portals and light."""

    bl_label = "Enfilade"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("enfilade.portal_from_objects", icon="MESH_PLANE")
        layout.operator("enfilade.mark_room", icon="OUTLINER_COLLECTION")
        layout.operator("enfilade.find_rooms", icon="VIEWZOOM")
        layout.separator()
        layout.operator("enfilade.check", icon="CHECKMARK")
        layout.operator("enfilade.bake", text="Bake Light", icon="LIGHT_AREA")
        layout.operator("enfilade.bake", text="Bake Light of Selected Rooms").scope = "SELECTED"
        layout.separator()
        layout.operator("enfilade.show_bake", icon="HIDE_OFF")
        layout.operator("enfilade.false_color", icon="COLOR")
        layout.operator("enfilade.clear", icon="TRASH")


def _in_object_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu("ENFILADE_MT_object")


def _in_face_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator("enfilade.portal_from_faces", icon="MESH_PLANE")


_PLACES = (("VIEW3D_MT_object", _in_object_menu), ("VIEW3D_MT_edit_mesh_faces", _in_face_menu))


def register() -> None:
    bpy.utils.register_class(ENFILADE_MT_object)
    for name, draw in _PLACES:
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    for name, draw in _PLACES:
        getattr(bpy.types, name).remove(draw)
    bpy.utils.unregister_class(ENFILADE_MT_object)
