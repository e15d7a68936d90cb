"""From Blender to arrays: geometry, materials, rooms and portals."""

import math

import numpy as np
import pytest
from enfilade.core.corners import face_area_vectors
from enfilade.core.scene import OUTSIDE, SceneError


def areas(scene):
    return face_area_vectors(scene.vertices, scene.corner_vertex, scene.loop_start)


def outline(scene, p):
    return scene.vertices[scene.corner_vertex[scene.loop_start[p] : scene.loop_start[p + 1]]]


def test_a_box_without_collections_is_one_room(shop):
    shop.box((0, 0, 0), (2, 3, 1), material=shop.material(emission=2.0))
    found = shop.extract()
    scene = found.scene
    assert (scene.polygon_count, scene.room_count, len(scene.portals)) == (6, 1, 0)
    assert np.linalg.norm(areas(scene), axis=1).sum() == pytest.approx(22)
    centre = np.array([outline(scene, p).mean(0) for p in range(6)])
    assert (np.einsum("ij,ij->i", areas(scene), centre - [1, 1.5, 0.5]) < 0).all()
    assert scene.reflectance == pytest.approx(0.5)
    assert scene.emission == pytest.approx(2 * math.pi)
    assert [r.name for r in found.receivers] == ["Box"]
    assert found.warnings == ()


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 0.5, 3), (-1, 1, 1), (-2, -1, 0.5), (-1, -1, -1)])
def test_transforms_keep_fronts_in_front(shop, scale):
    parent = shop.bpy.data.objects.new("Parent", None)
    shop.bpy.context.scene.collection.objects.link(parent)
    parent.location = (5, -2, 1)
    thing = shop.box((0, 0, 0), (1, 1, 1), inward=False)
    thing.parent = parent
    thing.scale = scale
    thing.rotation_euler = (0.3, 0.7, -1.1)
    scene = shop.extract().scene
    assert np.linalg.norm(areas(scene), axis=1).sum() == pytest.approx(
        2 * abs(scale[0] * scale[1]) + 2 * abs(scale[1] * scale[2]) + 2 * abs(scale[0] * scale[2])
    )
    centre = np.array(thing.matrix_world.translation) + np.array(thing.matrix_world.to_3x3()) @ [0.5, 0.5, 0.5]
    out = np.array([outline(scene, p).mean(0) for p in range(6)]) - centre
    assert (np.einsum("ij,ij->i", areas(scene), out) > 0).all()


def test_lengths_come_in_metres(shop):
    shop.bpy.context.scene.unit_settings.scale_length = 0.01
    shop.box((0, 0, 0), (200, 300, 100))
    assert shop.extract().scene.vertices.max(0) == pytest.approx([2, 3, 1])


def test_modifiers_are_evaluated(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1))
    array = thing.modifiers.new("Array", "ARRAY")
    array.count, array.relative_offset_displace = 3, (2, 0, 0)
    found = shop.extract()
    assert found.scene.polygon_count == 18
    assert found.scene.vertices[:, 0].max() == pytest.approx(5)
    assert not found.receivers[0].in_place
    assert found.receivers[0].modified_by == "Array"


def test_modifiers_that_only_move_keep_the_mesh_in_place(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1))
    cast = thing.modifiers.new("Wave", "CAST")
    cast.factor = 0.5
    assert shop.extract().receivers[0].in_place


def test_instances_shape_the_light_but_carry_none(shop):
    source = shop.bpy.data.collections.new("Library")
    shop.box((0, 0, 0), (1, 1, 1), "Crate", collection=source)
    for k in range(3):
        made = shop.bpy.data.objects.new(f"Copy {k}", None)
        made.instance_type, made.instance_collection = "COLLECTION", source
        made.location = (3 * k, 0, 0)
        made.scale = (-1, 1, 1)
        shop.bpy.context.scene.collection.objects.link(made)
    shop.box((-5, -5, -5), (20, 20, 20), "Hall")
    found = shop.extract()
    assert found.scene.polygon_count == 24
    assert sorted(found.scene.object_names) == ["Crate in Copy 0", "Crate in Copy 1", "Crate in Copy 2", "Hall"]
    assert [r.name for r in found.receivers] == ["Hall"]
    assert any("'Crate'" in w and "cannot carry" in w for w in found.warnings)
    mine = found.scene.object == found.scene.object_names.index("Crate in Copy 1")
    x = np.concatenate([outline(found.scene, p) for p in np.flatnonzero(mine)])[:, 0]
    assert (x.min(), x.max()) == pytest.approx((2, 3))
    inward = areas(found.scene)[mine]
    centre = np.array([outline(found.scene, p).mean(0) for p in np.flatnonzero(mine)]) - [2.5, 0.5, 0.5]
    assert (np.einsum("ij,ij->i", inward, centre) < 0).all()


def test_visible_to_renders_is_what_counts(shop):
    for name, attribute in (("Seen", ""), ("Unrendered", "hide_render"), ("Disabled", "hide_viewport")):
        thing = shop.box((0, 0, 0), (1, 1, 1), name)
        if attribute:
            setattr(thing, attribute, True)
    shop.box((0, 0, 0), (1, 1, 1), "Eye closed").hide_set(True)
    off = shop.collection("Off")
    off.hide_render = True
    shop.box((0, 0, 0), (1, 1, 1), "In an unrendered collection", collection=off)
    closed = shop.collection("Closed")
    closed.hide_viewport = True
    thing = shop.box((0, 0, 0), (1, 1, 1), "In a disabled collection", collection=closed)
    thing.modifiers.new("Sub", "SUBSURF").subdivision_type = "SIMPLE"
    gone = shop.collection("Gone")
    shop.box((0, 0, 0), (1, 1, 1), "Excluded", collection=gone)
    shop.bpy.context.view_layer.layer_collection.children["Gone"].exclude = True
    before = shop.state()
    found = shop.extract()
    assert sorted(found.scene.object_names) == ["Disabled", "Eye closed", "In a disabled collection", "Seen"]
    assert found.scene.polygon_count == 3 * 6 + 24
    assert shop.state() == before


def test_concave_and_bent_faces_are_cut(shop):
    shop.mesh([(0, 0, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0)], [(0, 1, 2, 3)], "Dart")
    shop.mesh([(5, 0, 0), (6, 0, 0), (6, 1, 0.3), (5, 1, 0)], [(0, 1, 2, 3)], "Bent")
    shop.mesh([(np.cos(t), np.sin(t), 4) for t in np.linspace(0, 2 * np.pi, 7)[:-1]], [range(6)], "Hexagon")
    scene = shop.extract().scene
    assert np.bincount(scene.object).tolist() == [2, 2, 1]
    assert areas(scene)[scene.object == 0].sum(0) == pytest.approx([0, 0, 2])
    assert len(outline(scene, 4)) == 6


def test_triangles_find_their_way_back(shop):
    shop.box((0, 0, 0), (2, 3, 1), "First")
    dart = shop.mesh([(0, 0, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (9, 9, 0), (9, 9, 0)], [(0, 4, 5), (0, 1, 2, 3)], "Dart")
    dart.scale = (-1, 1, 1)
    found = shop.extract()
    for receiver in found.receivers:
        mesh = receiver.mesh
        for t, p in zip(mesh.triangle, receiver.triangle_polygon, strict=True):
            corners = mesh.position[mesh.corner_vertex[t]]
            area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
            if p < 0:
                assert area < 1e-12
            else:
                inside = {tuple(np.round(c, 9)) for c in outline(found.scene, p)}
                assert {tuple(np.round(c, 9)) for c in corners} <= inside


def test_texts_and_curves_shape_the_light(shop):
    data = shop.bpy.data.curves.new("Words", "FONT")
    data.body, data.extrude = "Light", 0.1
    shop.bpy.context.scene.collection.objects.link(shop.bpy.data.objects.new("Words", data))
    found = shop.extract()
    assert found.scene.polygon_count > 20
    assert found.receivers == ()


# --------------------------------------------------------------------------------------------- rooms and portals


def test_two_rooms_and_a_door(shop):
    shop.two_rooms()
    found = shop.extract()
    scene = found.scene
    assert scene.room_names == ("West", "East")
    assert scene.portals.rooms.tolist() == [[0, 1]]
    assert scene.portals.names == ("Door",)
    assert {scene.object_names[o]: int(r) for o, r in zip(scene.object, scene.room, strict=True)} == {
        "West walls": 0, "West door wall": 0, "Lamp": 0, "East walls": 1, "East door wall": 1,
    }  # fmt: skip
    assert found.warnings == ()
    assert {r.name: r.room for r in found.receivers}["East walls"] == 1


def test_a_portal_that_is_turned_round_or_mirrored_swaps_its_rooms(shop):
    door = shop.two_rooms()["Door"]
    middle = door.data.vertices[0].co.x
    door.scale.x = -1
    door.location.x = 2 * middle
    assert shop.extract().scene.portals.rooms.tolist() == [[1, 0]]
    door.data.flip_normals()
    assert shop.extract().scene.portals.rooms.tolist() == [[0, 1]]


def test_a_window_leads_outside_and_hidden_portals_count(shop):
    made = shop.two_rooms()
    portals = shop.bpy.data.collections["Portals"]
    window = shop.mesh([(0, 1, 1), (0, 2, 1), (0, 2, 2), (0, 1, 2)], [(0, 1, 2, 3)], "Window", portals)
    for thing in (window, made["Door"]):
        thing.hide_render = thing.hide_viewport = True
    # The wall behind the window has to have a hole, or its own face is what the portal sees.
    wall = made["West"].data
    import bmesh

    work = bmesh.new()
    work.from_mesh(wall)
    work.faces.ensure_lookup_table()
    bmesh.ops.delete(work, geom=[f for f in work.faces if abs(f.calc_center_median().x) < 1e-6], context="FACES")
    work.to_mesh(wall)
    work.free()
    portals = shop.extract().scene.portals
    assert dict(zip(portals.names, portals.rooms.tolist(), strict=True)) == {"Door": [0, 1], "Window": [OUTSIDE, 0]}


def test_rooms_of_a_portal_by_hand(shop):
    made = shop.two_rooms()
    tags = made["Door"].enfilade
    tags.by_hand = True
    tags.behind, tags.in_front = None, shop.bpy.data.collections["East"]
    assert shop.extract().scene.portals.rooms.tolist() == [[OUTSIDE, 1]]
    tags.behind = shop.bpy.data.collections["Portals"]
    with pytest.raises(SceneError, match=r"portal 'Door' .* 'Portals', which is not a room"):
        shop.extract()


def test_collections_may_be_chosen(shop):
    shop.two_rooms()
    data, settings = shop.bpy.data, shop.bpy.context.scene.enfilade
    data.collections["Rooms"].name, data.collections["Portals"].name = "Flat", "Doors"
    # Without rooms the door is a surface like any other.
    assert (shop.extract().scene.room_count, len(shop.extract().scene.portals)) == (1, 0)
    settings.rooms, settings.portals = data.collections["Flat"], data.collections["Doors"]
    scene = shop.extract().scene
    assert (scene.room_names, len(scene.portals)) == (("West", "East"), 1)
    assert scene.polygon_count == 21


@pytest.mark.parametrize("how", ["linked", "in the rooms collection"])
def test_a_wall_between_two_rooms_gives_each_its_side(shop, how):
    """One solid wall with a doorway is shared by both rooms; its outer faces go to either."""
    made = shop.two_rooms()
    for name in ("West door wall", "East door wall"):
        shop.bpy.data.objects.remove(made[name])
    rooms = shop.bpy.data.collections["Rooms"]
    home = rooms if how != "linked" else rooms.children["West"]
    pieces = [((4, 0, 0), (4.2, 1, 2.5)), ((4, 2, 0), (4.2, 3, 2.5)), ((4, 1, 2), (4.2, 2, 2.5))]
    for k, (low, high) in enumerate(pieces):
        thing = shop.box(low, high, f"Wall {k}", inward=False, collection=home)
        if how == "linked":
            rooms.children["East"].objects.link(thing)
    found = shop.extract()
    scene = found.scene
    assert scene.portals.rooms.tolist() == [[0, 1]]
    wall = [p for p in range(scene.polygon_count) if scene.object_names[scene.object[p]].startswith("Wall")]
    assert len(wall) == 18
    for p in wall:
        x = outline(scene, p)[:, 0]
        if np.ptp(x) < 1e-6:
            assert scene.room[p] == (0 if x[0] < 4.1 else 1)
    assert not any("reach over" in w for w in found.warnings)


def test_a_floor_under_two_rooms_goes_to_one_with_a_warning(shop):
    shop.two_rooms()
    rooms = shop.bpy.data.collections["Rooms"]
    shop.mesh([(0, 0, -0.01), (7.2, 0, -0.01), (7.2, 3, -0.01), (0, 3, -0.01)], [(0, 1, 2, 3)], "Floor", rooms)
    found = shop.extract()
    assert found.scene.polygon_count == 22
    assert any("object 'Floor'" in w and "'West', 'East'" in w for w in found.warnings)


def test_what_is_in_no_room_takes_no_part(shop):
    shop.two_rooms()
    shop.box((50, 0, 0), (51, 1, 1), "Shed")
    found = shop.extract()
    assert "Shed" not in found.scene.object_names
    assert any("'Shed' is in no room" in w for w in found.warnings)


def test_a_rooms_collection_with_objects_only_is_one_room(shop):
    home = shop.collection("Rooms")
    shop.box((0, 0, 0), (1, 1, 1), collection=home)
    assert shop.extract().scene.room_names == ("Rooms",)


def test_portals_on_both_sides_of_the_same_room_are_refused(shop):
    made = shop.two_rooms()
    made["Door"].location.x = -2.0
    with pytest.raises(SceneError, match="portal 'Door' joins no rooms, both of its sides are inside the room 'West'"):
        shop.extract()
    made["Door"].location.x = -20.0
    with pytest.raises(SceneError, match="portal 'Door' joins no rooms, both of its sides are outside"):
        shop.extract()


def test_portals_that_are_bent_are_refused(shop):
    made = shop.two_rooms()
    made["Door"].data.vertices[0].co.x += 0.2
    with pytest.raises(SceneError, match="portal 'Door' is not one flat convex face"):
        shop.extract()


# --------------------------------------------------------------------------------------------------- bad input


def test_an_empty_scene(shop):
    with pytest.raises(SceneError, match="no mesh that is visible"):
        shop.extract()


def test_a_mesh_without_faces(shop):
    shop.mesh([(0, 0, 0)], [], "Point")
    with pytest.raises(SceneError, match="nothing to bake"):
        shop.extract()


def test_a_room_without_meshes(shop):
    made = shop.two_rooms()
    for name in ("East", "East door wall"):
        made[name].hide_render = True
    with pytest.raises(SceneError, match="room collection 'East' has no mesh"):
        shop.extract()


def test_an_empty_rooms_collection(shop):
    shop.box((0, 0, 0), (1, 1, 1))
    shop.collection("Rooms")
    with pytest.raises(SceneError, match="rooms collection 'Rooms' is empty"):
        shop.extract()


def test_vertices_that_are_no_numbers(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Broken")
    thing.data.vertices[3].co.y = math.nan
    with pytest.raises(SceneError, match="object 'Broken' has vertices that are not numbers"):
        shop.extract()


@pytest.mark.parametrize("inward", [True, False])
def test_a_room_that_is_inside_out_is_named(shop, inward):
    shop.box((0, 0, 0), (4, 3, 2.5), "Shell", inward=inward)
    shop.box((1, 1, 0), (2, 2, 0.7), "Table", inward=False)
    shop.mesh([(1, 1, 2.4), (1, 2, 2.4), (2, 2, 2.4), (2, 1, 2.4)], [(0, 1, 2, 3)], "Lamp", material=shop.material(emission=5.0))
    said = [w for w in shop.extract().warnings if "look outward" in w]
    assert len(said) == (0 if inward else 1)
    assert inward or "'Shell'" in said[0]


def test_a_large_building_comes_back_from_its_file(shop, tmp_path):
    """Rooms, portals and their rooms, areas and light of a generated building, through the importer and a .blend file."""
    from enfilade.core.polygons import area_vectors
    from enfilade.sample_scenes.import_building import write_building
    from enfilade.sample_scenes.test_scene import scene

    made = scene(1 / 27)
    write_building(made, tmp_path / "building.blend", 0.0)
    shop.bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "building.blend"), load_ui=False)
    found = shop.extract().scene
    assert found.polygon_count == made.polygon_count
    assert found.room_names == made.room_names
    assert sorted(map(tuple, found.portals.rooms)) == sorted(map(tuple, made.portals.rooms))
    for scene_of in (lambda s: np.bincount(s.room), lambda s: np.bincount(s.room, np.linalg.norm(area_vectors(s), axis=1))):
        assert np.allclose(scene_of(found), scene_of(made), rtol=1e-5)
    power = [np.bincount(s.room, np.linalg.norm(area_vectors(s), axis=1) * s.emission.sum(axis=1)) for s in (made, found)]
    assert np.allclose(*power, rtol=1e-4)
