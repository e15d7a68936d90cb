"""Rooms made from selections, and rooms found."""

from pathlib import Path

import numpy as np
import pytest

APARTMENT = Path(__file__).resolve().parents[2] / "sample_scenes" / "apartment.blend"


def loosen(shop):
    """Take all objects of rooms out of their collections, and the collections away; returns the room of each object's name."""
    bpy = shop.bpy
    was = {}
    rooms = bpy.data.collections["Rooms"]
    for room in list(rooms.children):
        for thing in list(room.objects):
            was[thing.name] = room.name
            bpy.context.scene.collection.objects.link(thing)
        bpy.data.collections.remove(room)
    bpy.data.collections.remove(rooms)
    bpy.context.view_layer.update()
    return was


def now_in(shop):
    return {o.name: {c.name for c in o.users_collection} for o in shop.bpy.context.scene.objects if o.type == "MESH"}


def test_rooms_are_found_from_loose_objects(shop):
    made = shop.two_rooms()
    was = loosen(shop)
    assert shop.bpy.ops.enfilade.find_rooms() == {"FINISHED"}
    now = now_in(shop)
    assert {name: {room} for name, room in was.items()} != now  # new names
    west, east = now[made["West"].name], now[made["East"].name]
    assert len(west) == len(east) == 1
    assert west != east
    assert now == {**{n: west if r == "West" else east for n, r in was.items()}, "Door": {"Portals"}}
    assert {c.name for c in shop.bpy.data.collections["Rooms"].children} == west | east
    scene = shop.extract().scene
    assert scene.room_count == 2
    assert scene.portals.rooms.tolist() in ([[0, 1]], [[1, 0]])


def test_finding_again_changes_nothing(shop):
    made = shop.two_rooms()
    before = shop.state()
    shop.bpy.ops.enfilade.find_rooms()
    assert shop.state() == before
    # A new thing goes where it stands.
    chair = shop.box((5, 1, 0), (5.5, 1.5, 1), "Chair", inward=False)
    shop.bpy.ops.enfilade.find_rooms()
    assert [c.name for c in chair.users_collection] == ["East"]
    made["West"].users_collection[0].objects.unlink(made["Lamp"])
    shop.bpy.data.collections["East"].objects.link(made["Lamp"])
    shop.bpy.ops.enfilade.find_rooms()
    assert [c.name for c in made["Lamp"].users_collection] == ["West"]


def test_collections_that_are_rooms_already_are_taken(shop):
    """What the user has sorted stays; the collection only gets its role."""
    made = shop.two_rooms()
    loosen(shop)
    bpy = shop.bpy
    salon = shop.collection("Salon")
    for name in ("West", "West door wall"):
        salon.objects.link(made[name])
        bpy.context.scene.collection.objects.unlink(made[name])
    bpy.ops.enfilade.find_rooms()
    assert salon.enfilade.role == "ROOM"
    assert now_in(shop)["Lamp"] == {"Salon"}
    assert set(shop.extract().scene.room_names) >= {"Salon"}


def joined(shop, name="House"):
    """All meshes but portals as one object."""
    bpy = shop.bpy
    portals = set(bpy.data.collections["Portals"].objects)
    things = [o for o in bpy.context.scene.objects if o.type == "MESH" and o not in portals]
    for o in bpy.context.scene.objects:
        o.select_set(o in things)
    bpy.context.view_layer.objects.active = things[0]
    bpy.ops.object.join()
    house = bpy.context.view_layer.objects.active
    house.name = name
    return house


def test_one_mesh_is_cut_into_rooms(shop):
    shop.two_rooms()
    # Nothing fits in front of its underside: that goes with the rest of it, not with the largest room.
    shop.box((5, 1, 0), (5.5, 1.5, 1), "Chair", inward=False, collection=shop.bpy.data.collections["East"])
    loosen(shop)
    house = joined(shop)
    faces = len(house.data.polygons)
    shop.bpy.ops.enfilade.find_rooms()
    rooms = shop.bpy.data.collections["Rooms"].children
    assert len(rooms) == 2
    pieces = [o for room in rooms for o in room.objects]
    assert sum(len(o.data.polygons) for o in pieces) == faces
    scene = shop.extract().scene
    # Each piece lies at one side of the wall.
    for room in (0, 1):
        at = scene.vertices[
            np.concatenate(
                [
                    scene.corner_vertex[a:b]
                    for a, b, r in zip(scene.loop_start[:-1], scene.loop_start[1:], scene.room, strict=True)
                    if r == room
                ]
            )
        ]
        assert at[:, 0].max() <= 4.0 + 1e-6 or at[:, 0].min() >= 4.2 - 1e-6


def test_every_face_of_one_mesh_has_the_colour_of_its_room(shop):
    from enfilade.addon import overlay

    shop.two_rooms()
    east = shop.bpy.data.collections["East"]
    shop.box((5, 1, 0), (5.5, 1.5, 1), "Chair", inward=False, collection=east)
    # The underside of a cushion looks into the chair, where no room is.
    shop.box((5.1, 1.1, 1), (5.4, 1.4, 1.2), "Cushion", inward=False, collection=east)
    loosen(shop)
    house = joined(shop)
    triangles = sum(len(face.vertices) - 2 for face in house.data.polygons)
    shop.bpy.ops.enfilade.find_rooms()
    (layer,) = (layer for layer in overlay.content().layers if layer.part == "surfaces")
    assert len(layer.position) == 3 * (triangles - 2)  # the underside of the chair looks out below the floor
    beyond = layer.position[:, 0] > 4.1
    # Brighter and darker by the side that is seen, but of one ratio of red to green to blue in a room.
    hues = [c / c.max(axis=1, keepdims=True) for c in (layer.color[beyond, :3], layer.color[~beyond, :3])]
    assert all(np.ptp(hue, axis=0).max() < 0.002 for hue in hues)
    assert not np.allclose(hues[0][0], hues[1][0], atol=0.1)
    shop.bpy.ops.enfilade.hide_overlay()


def test_one_mesh_may_stay_whole(shop):
    shop.two_rooms()
    loosen(shop)
    house = joined(shop)
    shop.bpy.ops.enfilade.find_rooms(cut=False)
    assert len(house.users_collection) == 2


def test_a_mesh_with_modifiers_is_not_cut(shop):
    shop.two_rooms()
    loosen(shop)
    house = joined(shop)
    house.modifiers.new("Bevel", "BEVEL").width = 0.001
    shop.bpy.ops.enfilade.find_rooms()
    assert len(house.users_collection) == 2


def test_what_is_closed_nowhere_is_said(shop):
    shop.box((0, 0, 0), (4, 4, 3), "Shed", leave_out=[0, 2])
    before = shop.state()
    with pytest.raises(RuntimeError, match="No room is closed"):
        shop.bpy.ops.enfilade.find_rooms()
    assert shop.state() == before


def test_gaps_are_named_and_shown(shop):
    from enfilade.addon import overlay

    shop.two_rooms()
    loosen(shop)
    wall = shop.bpy.data.objects["West door wall"]
    wall.data.clear_geometry()
    wall.data.from_pydata(
        [(4, 0, 0), (4, 1, 0), (4, 1, 2.5), (4, 0, 2.5), (4, 2, 0), (4, 3, 0), (4, 3, 2.5), (4, 2, 2.5)], [], [(3, 2, 1, 0), (7, 6, 5, 4)]
    )
    shop.bpy.ops.enfilade.find_rooms()
    content = overlay.content()
    assert content.title == "2 rooms"
    assert any("gap" in text for _, text in content.legend)
    shop.bpy.ops.enfilade.hide_overlay()


def test_the_apartment_is_found_again(shop):
    """Six rooms with furniture, walls 0.15 m thick: all objects go back to where they were."""
    bpy = shop.bpy
    bpy.ops.wm.open_mainfile(filepath=str(APARTMENT))
    was = loosen(shop)
    bpy.ops.enfilade.find_rooms()
    now = now_in(shop)
    assert {name: now[name] for name in was} == {name: {room} for name, room in was.items()}
    assert {c.name for c in bpy.data.collections["Rooms"].children} == set(was.values())


def test_a_collection_is_marked(shop):
    bpy = shop.bpy
    home = shop.collection("Kitchen")
    box = shop.box((0, 0, 0), (2, 2, 2), "Box", collection=home)
    with pytest.raises(RuntimeError, match="Select objects of the room first"):
        bpy.ops.enfilade.mark_room()
    box.select_set(True)
    bpy.ops.enfilade.mark_room()
    assert home.enfilade.role == "ROOM"
    assert shop.extract().scene.room_names == ("Kitchen",)


def test_loose_objects_get_a_room(shop):
    bpy = shop.bpy
    box = shop.box((0, 0, 0), (2, 2, 2), "Bath")
    box.select_set(True)
    bpy.context.view_layer.objects.active = box
    bpy.ops.enfilade.mark_room()
    assert [c.name for c in box.users_collection] == ["Bath room"]
    assert shop.extract().scene.room_names == ("Bath room",)


def test_portals_are_no_room(shop):
    made = shop.two_rooms()
    made["Door"].select_set(True)
    with pytest.raises(RuntimeError, match="portals or ignored"):
        shop.bpy.ops.enfilade.mark_room()
