# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects take part, and which rooms and portals the collections say.

An object takes part when it is visible to renders: neither it nor every collection on the way to it is disabled in
renders, excluded from the view layer or ignored by its role; and it is not left out itself. What is hidden in the viewport
only takes part all the same. Portals count whether or not they are rendered.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy

from ..core.scene import SceneError
from .roles import chosen_collections, portal_objects, roles


@dataclass(frozen=True)
class Membership:
    """room_names : the R rooms; rooms : for every object that takes part, its rooms in ascending order; portals : their objects

    left_out : names of meshes that are in no room; collections : the rooms' collections, empty when the scene is one room
    """

    room_names: tuple[str, ...]
    rooms: dict[bpy.types.Object, tuple[int, ...]]
    portals: tuple[bpy.types.Object, ...]
    left_out: tuple[str, ...]
    collections: tuple[bpy.types.Collection, ...]


def membership(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Membership:
    """Sort the objects of a view layer into rooms and portals.

    Raises SceneError for a rooms collection without rooms and a room without anything to see.
    """
    kinds = roles(scene)
    home = chosen_collections(scene)[0]
    openings = portal_objects(scene)
    passages = set(openings)
    solid = [o for o in rendered_objects(view_layer) if o not in passages]
    children = tuple(c for c, role in kinds.items() if role == "ROOM")
    if not children:
        if not any(_has_surface(o) for o in solid):
            raise SceneError("the scene has no mesh that is visible in renders: there is nothing to bake")
        return Membership((scene.name,), {o: (0,) for o in solid}, openings, (), ())
    if children == (home,) and not any(_has_surface(o) for o in home.all_objects):
        raise SceneError(f"the rooms collection '{home.name}' is empty: put a collection for every room into it")
    places: dict[bpy.types.Object, list[int]] = {o: [] for o in solid}
    for number, child in enumerate(children):
        inside = [o for o in own_objects(child, kinds) if o in places]
        if not any(_has_surface(o) for o in inside):
            raise SceneError(
                f"the room collection '{child.name}' has no mesh that is visible in renders: add one or take the collection out"
            )
        for thing in inside:
            places[thing].append(number)
    # What lies in the rooms collection itself belongs to every room: each face goes to the one that it looks into.
    for thing in home.objects if home is not None and home not in children else ():
        if thing in places and not places[thing]:
            places[thing] = list(range(len(children)))
    left_out = tuple(sorted(o.name for o, numbers in places.items() if not numbers and _has_surface(o)))
    members = {o: tuple(sorted(set(numbers))) for o, numbers in places.items() if numbers}
    return Membership(tuple(c.name for c in children), members, openings, left_out, children)


def own_objects(room: bpy.types.Collection, kinds: dict[bpy.types.Collection, str]) -> Iterator[bpy.types.Object]:
    """The objects of a room, without those of collections inside it that have a role of their own."""
    yield from room.objects
    for child in room.children:
        if child not in kinds:
            yield from own_objects(child, kinds)


def rendered_objects(view_layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """The objects that take part, in the order of the collections.

    Subdivided copies that a bake made do not, and what they stand for does although the bake hid it.
    """
    scene = view_layer.id_data
    ignored = {c for c, role in roles(scene).items() if role == "IGNORED"}
    found: dict[bpy.types.Object, None] = {}
    for layer in _layers(view_layer.layer_collection, ignored):
        for thing in layer.collection.objects:
            if thing.enfilade.carries is None and not thing.enfilade.left_out and (not thing.hide_render or thing.enfilade.hidden):
                found.setdefault(thing)
    return list(found)


@contextmanager
def everything_evaluated(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Iterator[None]:
    """Within, nothing is hidden in the viewport, so that Blender evaluates all that takes part; afterwards all is as before."""
    layers = [(layer, layer.hide_viewport) for layer in _layers(view_layer.layer_collection) if layer.hide_viewport]
    collections = [c for c in scene.collection.children_recursive if c.hide_viewport]
    disabled = [o for o in view_layer.objects if o.hide_viewport]
    try:
        for layer, _ in layers:
            layer.hide_viewport = False
        for collection in collections:
            collection.hide_viewport = False
        for thing in disabled:
            thing.hide_viewport = False
        # Only now are objects of collections that were disabled in the layer.
        hidden = [o for o in view_layer.objects if o.hide_get(view_layer=view_layer)]
        disabled += [o for o in view_layer.objects if o.hide_viewport]
        for thing in hidden:
            thing.hide_set(False, view_layer=view_layer)
        for thing in disabled:
            thing.hide_viewport = False
        view_layer.update()
        try:
            yield
        finally:
            for thing in hidden:
                thing.hide_set(True, view_layer=view_layer)
    finally:
        for thing in disabled:
            thing.hide_viewport = True
        for collection in collections:
            collection.hide_viewport = True
        for layer, state in layers:
            layer.hide_viewport = state
        view_layer.update()


def _layers(layer: bpy.types.LayerCollection, ignored: Collection = ()) -> Iterator[bpy.types.LayerCollection]:
    if layer.exclude or layer.collection.hide_render or layer.collection in ignored:
        return
    yield layer
    for child in layer.children:
        yield from _layers(child, ignored)


def _has_surface(thing: bpy.types.Object) -> bool:
    return thing.type in ("MESH", "CURVE", "SURFACE", "META", "FONT") or thing.instance_type != "NONE"
