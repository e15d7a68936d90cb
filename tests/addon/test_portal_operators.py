"""Portals made from faces and from doors."""

import numpy as np
import pytest


def corners(thing):
    return np.array([thing.matrix_world @ v.co for v in thing.data.vertices])


def edit(shop, thing, faces):
    """Enter edit mode with these faces selected."""
    import bmesh

    bpy = shop.bpy
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_mode(type="FACE")
    bpy.ops.mesh.select_all(action="DESELECT")
    mesh = bmesh.from_edit_mesh(thing.data)
    mesh.faces.ensure_lookup_table()
    for k in faces:
        mesh.faces[k].select_set(True)


def test_a_face_becomes_a_portal(shop):
    thing = shop.box((0, 0, 0), (4, 3, 2), "House")
    thing.location.x = 10
    shop.bpy.context.view_layer.update()
    edit(shop, thing, [1])
    assert shop.bpy.ops.enfilade.portal_from_faces() == {"FINISHED"}
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    (portal,) = shop.bpy.data.collections["Portals"].objects
    shop.bpy.context.view_layer.update()
    assert portal.name == "Portal House"
    assert portal.hide_render
    assert sorted(map(tuple, corners(portal).round(5))) == [(14, 0, 0), (14, 0, 2), (14, 3, 0), (14, 3, 2)]
    assert len(thing.data.polygons) == 5


def test_faces_may_stay(shop):
    thing = shop.box((0, 0, 0), (4, 3, 2), "House")
    edit(shop, thing, [1])
    shop.bpy.ops.enfilade.portal_from_faces(remove=False)
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    assert len(thing.data.polygons) == 6


def test_flat_neighbours_are_one_portal(shop):
    """Two triangles and a rectangle that share a plane."""
    thing = shop.mesh([(0, 0, 0), (1, 0, 0), (1, 0, 2), (0, 0, 2), (2, 0, 0), (2, 0, 2)], [(0, 1, 2), (0, 2, 3), (1, 4, 5, 2)], "Doors")
    edit(shop, thing, [0, 1, 2])
    shop.bpy.ops.enfilade.portal_from_faces()
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    (portal,) = shop.bpy.data.collections["Portals"].objects
    assert [len(p.vertices) for p in portal.data.polygons] == [4]
    assert portal.data.polygons[0].area == pytest.approx(4)


def test_a_corner_shaped_opening_is_cut(shop):
    vertices = [(0, 0, 0), (2, 0, 0), (2, 0, 1), (1, 0, 1), (1, 0, 2), (0, 0, 2)]
    thing = shop.mesh(vertices, [range(6)], "Corner")
    edit(shop, thing, [0])
    shop.bpy.ops.enfilade.portal_from_faces()
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    (portal,) = shop.bpy.data.collections["Portals"].objects
    assert len(portal.data.polygons) == 2
    assert sum(p.area for p in portal.data.polygons) == pytest.approx(3)


def test_a_pane_selected_all_around_is_one_portal(shop):
    pane = shop.box((0, 0, 1), (1, 0.04, 2), "Pane", inward=False)
    edit(shop, pane, range(6))
    shop.bpy.ops.enfilade.portal_from_faces()
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    (portal,) = shop.bpy.data.collections["Portals"].objects
    shop.bpy.context.view_layer.update()
    assert len(portal.data.polygons) == 1
    assert corners(portal)[:, 1] == pytest.approx(0.02)
    assert portal.data.polygons[0].area == pytest.approx(1)


def test_nothing_selected_is_said(shop):
    thing = shop.box((0, 0, 0), (4, 3, 2), "House")
    with pytest.raises(RuntimeError, match="edit mode"):
        shop.bpy.ops.enfilade.portal_from_faces()
    edit(shop, thing, [])
    with pytest.raises(RuntimeError, match="No face is selected"):
        shop.bpy.ops.enfilade.portal_from_faces()
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    thing.select_set(False)
    with pytest.raises(RuntimeError, match="Select doors or windows"):
        shop.bpy.ops.enfilade.portal_from_objects()


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_a_door_becomes_a_portal_that_fills_its_opening(shop, turn):
    """The door of 0.96 x 0.05 x 1.97 m hangs in an opening of 1 x 0.2 x 2 m; all is turned about the origin."""
    from mathutils import Matrix

    bpy = shop.bpy
    made = shop.two_rooms()
    bpy.data.objects.remove(made["Door"])
    jambs = shop.box((4.0, 1, 0), (4.2, 2, 2), "Jambs", collection=bpy.data.collections["West"], leave_out=[0, 1])
    door = shop.box((-0.025, -0.48, 0), (0.025, 0.48, 1.97), "Leaf", inward=False, collection=bpy.data.collections["West"])
    door.location = (4.1, 1.5, 0.005)
    bpy.context.view_layer.update()
    for thing in bpy.data.objects:
        thing.matrix_world = Matrix.Rotation(turn, 4, "Z") @ thing.matrix_world
    bpy.context.view_layer.update()
    door.select_set(True)
    assert bpy.ops.enfilade.portal_from_objects() == {"FINISHED"}
    bpy.context.view_layer.update()
    portal = bpy.data.objects["Portal Leaf"]
    local = corners(portal) @ np.array(Matrix.Rotation(turn, 3, "Z"))
    assert local.min(axis=0) == pytest.approx([4.1, 1, 0], abs=1e-4)
    assert local.max(axis=0) == pytest.approx([4.1, 2, 2], abs=1e-4)
    assert door.enfilade.left_out
    assert not jambs.enfilade.left_out
    scene = shop.extract().scene
    assert sorted(scene.portals.rooms[0].tolist()) == [0, 1]
    assert "Leaf" not in scene.object_names


def test_a_door_may_keep_its_size_and_its_part(shop):
    door = shop.box((0, 0, 0), (0.9, 0.05, 2), "Leaf", inward=False)
    shop.box((-0.1, -1, 0), (1.0, 1, 2.1), "Around")
    door.select_set(True)
    shop.bpy.context.view_layer.update()
    shop.bpy.ops.enfilade.portal_from_objects(fit=False, leave_out=False)
    shop.bpy.context.view_layer.update()
    at = corners(shop.bpy.data.objects["Portal Leaf"])
    assert np.ptp(at, axis=0) == pytest.approx([0.9, 0, 2])
    assert at[:, 1] == pytest.approx(0.025)
    assert not door.enfilade.left_out
    # Asked again, the portal itself is no door.
    door.select_set(False)
    shop.bpy.data.objects["Portal Leaf"].select_set(True)
    with pytest.raises(RuntimeError, match="portals already"):
        shop.bpy.ops.enfilade.portal_from_objects()
