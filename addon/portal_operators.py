# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that make portals."""

from __future__ import annotations

import bmesh
import bpy

from .guards import in_object_mode
from .openings import add_portal, fitted, loops_of_faces, middle_of_box
from .roles import portal_objects


class ENFILADE_OT_portal_from_faces(bpy.types.Operator):
    """Make a portal of the selected faces: the opening through which one room lights the other"""

    bl_idname = "enfilade.portal_from_faces"
    bl_label = "Portal from Faces"
    bl_options = {"REGISTER", "UNDO"}

    remove: bpy.props.BoolProperty(
        name="Remove Faces", description="Take the faces out of the mesh, so that light passes where they were", default=True
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "EDIT_MESH":
            cls.poll_message_set("Select faces in edit mode first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        made = []
        for thing in context.objects_in_mode_unique_data:
            mesh = bmesh.from_edit_mesh(thing.data)
            chosen = [f for f in mesh.faces if f.select]
            if not chosen:
                continue
            made.append(add_portal(context.scene, f"Portal {thing.name}", loops_of_faces(mesh, thing.matrix_world)))
            if self.remove:
                bmesh.ops.delete(mesh, geom=chosen, context="FACES")
                bmesh.update_edit_mesh(thing.data)
        if not made:
            self.report({"ERROR"}, "No face is selected: select the faces that fill the opening")
            return {"CANCELLED"}
        self.report({"INFO"}, _made(made))
        return {"FINISHED"}


class ENFILADE_OT_portal_from_objects(bpy.types.Operator):
    """Make a portal where each selected door or window stands"""

    bl_idname = "enfilade.portal_from_objects"
    bl_label = "Portal from Objects"
    bl_options = {"REGISTER", "UNDO"}

    leave_out: bpy.props.BoolProperty(
        name="Leave Objects Out",
        description="Leave the doors and windows themselves out of the bake, so that light passes where they stand, and show them as wires",
        default=True,
    )
    fit: bpy.props.BoolProperty(
        name="Fit to Opening", description="Widen each portal to the wall around it where that is nearer than 25 cm", default=True
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not in_object_mode(cls, context):
            return False
        if not any(o.type == "MESH" for o in context.selected_objects):
            cls.poll_message_set("Select doors or windows first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        taken = set(portal_objects(context.scene))
        chosen = [o for o in context.selected_objects if o.type == "MESH" and o not in taken and len(o.data.vertices) > 2]
        if not chosen:
            self.report({"ERROR"}, "No door or window is selected: the selected objects are portals already, or have no faces")
            return {"CANCELLED"}
        context.view_layer.update()
        made = []
        for thing in chosen:
            corners = middle_of_box(thing.bound_box, thing.matrix_world)
            if self.fit:
                corners = fitted(context, corners, {*chosen, *taken})
            made.append((thing, corners))
        portals = []
        for thing, corners in made:
            portals.append(add_portal(context.scene, f"Portal {thing.name}", [corners]))
            if self.leave_out:
                thing.enfilade.left_out = True
                thing.display_type = "WIRE"  # it carries no light, and would stand white before the room behind it
        self.report({"INFO"}, _made(portals))
        return {"FINISHED"}


def _made(portals: list[bpy.types.Object]) -> str:
    names = ", ".join(f"'{p.name}'" for p in portals[:4]) + (", ..." if len(portals) > 4 else "")
    return f"{len(portals)} portal{'s' * (len(portals) != 1)} in '{portals[0].users_collection[0].name}': {names}"


_CLASSES = (ENFILADE_OT_portal_from_faces, ENFILADE_OT_portal_from_objects)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
