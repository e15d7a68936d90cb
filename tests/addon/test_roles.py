"""What collections are to a bake."""

import pytest


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("room_kitchen", "ROOM"),
        ("Room-2", "ROOM"),
        ("living-room", "ROOM"),
        ("Bath_Room.001", "ROOM"),
        ("portal_door", "PORTALS"),
        ("front-portal", "PORTALS"),
        ("portals_ground_floor", "PORTALS"),
        ("Kitchen", ""),
        ("bedrooms", ""),
        ("room", ""),
        ("mushroom", ""),
        ("Living room", ""),
        ("broom_cupboard", ""),
    ],
)
def test_names_say_what_collections_are(name, role):
    from enfilade.addon.roles import habit

    assert habit(name) == role


def boxes(shop, *names):
    """Collections at the top of the scene, with a box each, side by side."""
    made = [shop.collection(name) for name in names]
    for k, home in enumerate(made):
        shop.box((3 * k, 0, 0), (3 * k + 2, 2, 2), f"Box {k}", collection=home)
    return made


def members(shop):
    from enfilade.addon.membership import membership

    found = membership(shop.bpy.context.scene, shop.bpy.context.view_layer)
    return found.room_names, {o.name: rooms for o, rooms in found.rooms.items()}, found


def test_rooms_by_name_anywhere(shop):
    boxes(shop, "room_a", "b-room", "Elsewhere")
    names, rooms, found = members(shop)
    assert names == ("room_a", "b-room")
    assert rooms == {"Box 0": (0,), "Box 1": (1,)}
    assert found.left_out == ("Box 2",)


def test_roles_overrule_names_and_places(shop):
    a, _, c = boxes(shop, "room_a", "b-room", "Attic")
    a.enfilade.role, c.enfilade.role = "IGNORED", "ROOM"
    names, rooms, found = members(shop)
    assert names == ("b-room", "Attic")
    assert rooms == {"Box 1": (0,), "Box 2": (1,)}
    assert found.left_out == ()
    c.enfilade.role = "PORTALS"
    assert [o.name for o in members(shop)[2].portals] == ["Box 2"]


def test_the_innermost_room_counts(shop):
    rooms = shop.collection("Rooms")
    kitchen = shop.collection("Kitchen", rooms)
    pantry = shop.collection("pantry-room", kitchen)
    chairs = shop.collection("Chairs", kitchen)
    for k, home in enumerate((kitchen, pantry, chairs)):
        shop.box((3 * k, 0, 0), (3 * k + 2, 2, 2), f"Box {k}", collection=home)
    names, members_, _ = members(shop)
    assert names == ("Kitchen", "pantry-room")
    assert members_ == {"Box 0": (0,), "Box 1": (1,), "Box 2": (0,)}


def test_a_rooms_collection_may_be_one_room(shop):
    rooms = shop.collection("Rooms")
    shop.box((0, 0, 0), (1, 1, 1), "Box", collection=shop.collection("Inner", rooms))
    assert members(shop)[0] == ("Inner",)
    rooms.enfilade.role = "ROOM"
    assert members(shop)[0] == ("Rooms",)


def test_portals_by_the_name_of_the_object(shop):
    shop.two_rooms()
    bpy = shop.bpy
    door = bpy.data.objects["Door"]
    bpy.context.scene.collection.objects.link(door)
    bpy.data.collections.remove(bpy.data.collections["Portals"])
    assert members(shop)[2].portals == ()
    door.name = "portal_west_east"
    assert members(shop)[2].portals == (door,)
    assert len(shop.extract().scene.portals) == 1


def test_an_object_that_is_left_out_lets_light_pass(shop):
    made = shop.two_rooms()
    before = shop.extract().scene
    made["Lamp"].enfilade.left_out = True
    after = shop.extract().scene
    assert before.polygon_count - after.polygon_count == 1
    assert "Lamp" not in after.object_names


def test_ignored_rooms_are_out_of_the_bake(shop):
    shop.two_rooms()
    shop.bpy.data.collections["East"].enfilade.role = "IGNORED"
    scene = shop.extract().scene
    assert scene.room_names == ("West",)
    assert scene.portals.rooms.tolist() in ([[0, -1]], [[-1, 0]])
