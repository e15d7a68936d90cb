# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that make rooms."""

from __future__ import annotations

import bpy

from . import overlay
from .guards import REFUSALS, in_object_mode, sentence
from .roles import ROOMS, chosen_collections, home_of, roles
from .room_overlay import rooms_content
from .room_sorting import sort_into_rooms, survey


class ENFILADE_OT_mark_room(bpy.types.Operator):
    """Make a room of the collection that the selected objects are in"""

    bl_idname = "enfilade.mark_room"
    bl_label = "Mark as Room"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not in_object_mode(cls, context):
            return False
        if not context.selected_objects:
            cls.poll_message_set("Select objects of the room first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        root = chosen_collections(scene)[0]
        kinds = roles(scene)
        loose = [o for o in context.selected_objects if set(o.users_collection) <= {scene.collection, root}]
        inside = set(scene.collection.children_recursive)
        homes = dict.fromkeys(
            c
            for o in context.selected_objects
            for c in o.users_collection
            if c in inside and c != root and kinds.get(c) not in ("PORTALS", "IGNORED")
        )
        for home in homes:
            if kinds.get(home) != "ROOM":
                home.enfilade.role = "ROOM"
        if loose:
            names = [o.name for o in loose]
            home = bpy.data.collections.new(f"{context.active_object.name if context.active_object in loose else names[0]} room")
            home_of(scene, ROOMS, "ROOM").children.link(home)
            for thing in loose:
                for collection in thing.users_collection:
                    collection.objects.unlink(thing)
                home.objects.link(thing)
            homes[home] = None
        if not homes:
            self.report({"ERROR"}, "The selected objects are portals or ignored: select what a room is made of")
            return {"CANCELLED"}
        self.report({"INFO"}, f"{_listed([h.name for h in homes])} {'is a room' if len(homes) == 1 else 'are rooms'} now")
        return {"FINISHED"}


class ENFILADE_OT_find_rooms(bpy.types.Operator):
    """Sort all objects into rooms: what walls and portals close off is a room. Shows them in colours, and gaps to the outside"""

    bl_idname = "enfilade.find_rooms"
    bl_label = "Find Rooms"
    bl_options = {"REGISTER", "UNDO"}

    cut: bpy.props.BoolProperty(
        name="Cut Objects Apart",
        description="Cut objects with faces in several rooms into one object for each; off: they are linked into all these rooms",
        default=True,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            seen = survey(context)
        except REFUSALS as error:
            self.report({"ERROR"}, sentence(error))
            return {"CANCELLED"}
        found = seen.rooms
        if len(found) == 0:
            self.report({"ERROR"}, "No room is closed: close the walls, and put portals into doors and windows")
            return {"CANCELLED"}
        done = sort_into_rooms(context, seen, self.cut)
        names = tuple(room.name for room in done.rooms)
        if done.shared:
            self.report({"WARNING"}, f"{_listed(done.shared)} lie in several rooms: their faces are sorted when baking")
        if done.elsewhere:
            self.report({"WARNING"}, f"{_listed(done.elsewhere)} lie outside of all rooms and stay where they are")
        if found.lid:
            self.report({"WARNING"}, "There is no ceiling: the top of the building was taken as closed")
        for gap in found.gaps[:8]:
            self.report({"WARNING"}, f"'{names[gap.room]}' leaks: a gap of about {gap.width:.1f} m to the outside has no portal")
        cut = f", {len(done.cut)} cut apart" if done.cut else ""
        self.report({"INFO"}, f"{len(names)} room{'s' * (len(names) != 1)}, {done.objects} objects sorted{cut}")
        overlay.show(rooms_content(seen, names), "enfilade.find_rooms")
        return {"FINISHED"}


def _listed(names: list[str] | tuple[str, ...], most: int = 4) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


_CLASSES = (ENFILADE_OT_mark_room, ENFILADE_OT_find_rooms)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
