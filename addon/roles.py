# SPDX-License-Identifier: GPL-3.0-or-later
"""What collections are to a bake: rooms, portals, or left out. Said by the user, by where they lie, or by their names."""

from __future__ import annotations

import re

import bpy

ROOMS, PORTALS = "Rooms", "Portals"
"""Collections of these names hold the rooms and the portals where the user has chosen none."""

ROOM_NAME = re.compile(r"room[_-].+|.+[_-]room", re.IGNORECASE)
PORTAL_NAME = re.compile(r"portals?[_-].+|.+[_-]portals?", re.IGNORECASE)
_NUMBER = re.compile(r"\.\d{3,}$")

ROLES = (
    ("AUTO", "By Name", "What the name and the place say: room_..., ...-room, portal_..., ...-portal, or a child of the collection Rooms"),
    ("ROOM", "Room", "The objects in this collection are one room, with the collections inside it"),
    ("PORTALS", "Portals", "Every mesh face in this collection is an opening between two rooms or to the outside"),
    ("IGNORED", "Ignored", "What lies in this collection takes no part in the bake: it neither carries nor blocks light"),
)


class ENFILADE_PG_collection(bpy.types.PropertyGroup):
    """What a collection is to a bake."""

    role: bpy.props.EnumProperty(name="Role", description="What this collection is when light is baked", items=ROLES, default="AUTO")


def habit(name: str) -> str:
    """``"ROOM"`` or ``"PORTALS"`` where a name follows one of the habits, else an empty text; numbers as in .001 do not count."""
    name = _NUMBER.sub("", name)
    return "ROOM" if ROOM_NAME.fullmatch(name) else "PORTALS" if PORTAL_NAME.fullmatch(name) else ""


def chosen_collections(scene: bpy.types.Scene) -> tuple[bpy.types.Collection | None, bpy.types.Collection | None]:
    """The collections of rooms and of portals: those that are chosen, or those called Rooms and Portals in this scene."""
    settings = scene.enfilade
    own = {child.name: child for child in scene.collection.children_recursive}
    return settings.rooms or own.get(ROOMS), settings.portals or own.get(PORTALS)


def roles(scene: bpy.types.Scene) -> dict[bpy.types.Collection, str]:
    """The collections of a scene that have a role, in the order of the outliner: ``"ROOM"``, ``"PORTALS"`` or ``"IGNORED"``.

    What the user says comes first, then what is chosen for the scene, then the place, then the name. Below collections of
    portals and ignored ones nothing else has a role of its own.
    """
    rooms, portals = chosen_collections(scene)
    found: dict[bpy.types.Collection, str] = {}

    def visit(parent: bpy.types.Collection) -> None:
        for child in parent.children:
            role = child.enfilade.role
            if role == "AUTO":
                holds_rooms = parent == rooms and rooms.enfilade.role != "ROOM"
                role = "PORTALS" if child == portals else "" if child == rooms else "ROOM" if holds_rooms else habit(child.name)
            if role:
                found.setdefault(child, role)
            if role not in ("PORTALS", "IGNORED"):
                visit(child)

    visit(scene.collection)
    if rooms is not None and "ROOM" not in found.values() and found.get(rooms) is None:
        found[rooms] = "ROOM"  # a collection of rooms without any is one itself
    return found


def rooms_of(scene: bpy.types.Scene) -> tuple[bpy.types.Collection, ...]:
    """The collections that are rooms; none where the whole scene is one."""
    return tuple(c for c, role in roles(scene).items() if role == "ROOM")


def portal_objects(scene: bpy.types.Scene) -> tuple[bpy.types.Object, ...]:
    """The meshes whose faces are portals: those in collections of portals, and those that are named so."""
    kinds = roles(scene)
    found = {o: None for c, role in kinds.items() if role == "PORTALS" for o in c.all_objects if o.type == "MESH"}
    ignored = {o for c, role in kinds.items() if role == "IGNORED" for o in c.all_objects}
    named = (o for o in scene.objects if o.type == "MESH" and habit(o.name) == "PORTALS" and o not in ignored)
    return tuple(o for o in (*found, *(o for o in named if o not in found)) if not o.enfilade.left_out)


def home_of(scene: bpy.types.Scene, name: str, role: str) -> bpy.types.Collection:
    """The collection of the scene that new rooms or portals go into, made with this name where there is none."""
    chosen = chosen_collections(scene)[0 if role == "ROOM" else 1]
    if chosen is None and role == "PORTALS":
        chosen = next((c for c, kind in roles(scene).items() if kind == role), None)
    if chosen is None:
        chosen = bpy.data.collections.new(name)
        scene.collection.children.link(chosen)
        if chosen.name != name:  # another scene has one of this name
            setattr(scene.enfilade, "rooms" if role == "ROOM" else "portals", chosen)
    return chosen


def register() -> None:
    bpy.utils.register_class(ENFILADE_PG_collection)
    bpy.types.Collection.enfilade = bpy.props.PointerProperty(type=ENFILADE_PG_collection)


def unregister() -> None:
    del bpy.types.Collection.enfilade
    bpy.utils.unregister_class(ENFILADE_PG_collection)
