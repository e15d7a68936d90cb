"""The check before a bake."""

import pytest


@pytest.fixture
def checked(shop):
    def run():
        from enfilade.addon.checks import check

        shop.bpy.context.view_layer.update()
        return check(shop.bpy.context)

    return run


def about(found, words):
    return [f for f in found if words in f.message]


def test_a_good_scene_is_ready(shop, checked):
    shop.two_rooms()
    assert [f for f in checked() if f.level != "NOTE"] == []
    assert shop.bpy.ops.enfilade.check() == {"FINISHED"}
    from enfilade.addon.check_operators import headline

    assert headline(shop.bpy.context.window_manager.enfilade_check) == "Ready to bake"


def test_every_portal_that_joins_nothing_is_named(shop, checked):
    shop.two_rooms()
    portals = shop.bpy.data.collections["Portals"]
    for k, x in enumerate((1.0, 20.0)):
        shop.mesh([(x, 1, 0), (x, 2, 0), (x, 2, 2), (x, 1, 2)], [(0, 1, 2, 3)], f"Stray {k}", portals)
    found = about(checked(), "joins no rooms")
    assert [(f.level, f.title, f.objects) for f in found] == [
        ("ERROR", "Stray 0 joins no rooms", ("Stray 0",)),
        ("ERROR", "Stray 1 joins no rooms", ("Stray 1",)),
    ]


def test_a_bent_portal_is_named_with_its_face(shop, checked):
    shop.two_rooms()
    vertices = [(4.1, 1, 0), (4.1, 2, 0), (4.1, 2, 2), (4.1, 1, 2), (4.1, 2.5, 0), (4.3, 2.9, 2)]
    shop.mesh(vertices, [(0, 1, 2, 3), (1, 4, 5, 2)], "Two", shop.bpy.data.collections["Portals"])
    (finding,) = about(checked(), "not one flat convex face")
    assert (finding.objects, finding.faces) == (("Two",), (1,))


def test_a_door_without_a_portal_leaks(shop, checked):
    made = shop.two_rooms()
    shop.bpy.data.objects.remove(made["Door"])
    (finding,) = about(checked(), "past the portals")
    assert finding.level == "WARNING"
    assert finding.title in ("West leaks into East", "East leaks into West")
    assert finding.objects
    assert finding.place is not None


def test_a_room_with_a_hole_or_without_a_ceiling(shop, checked):
    import bmesh

    made = shop.two_rooms()
    walls = made["East"].data
    ceiling = next(p.index for p in walls.polygons if p.center.z > 2.4)
    work = bmesh.new()
    work.from_mesh(walls)
    work.faces.ensure_lookup_table()
    bmesh.ops.delete(work, geom=[work.faces[ceiling]], context="FACES")
    work.to_mesh(walls)
    (finding,) = about(checked(), "is open")
    assert (finding.level, "East walls" in finding.objects) == ("NOTE", True)
    assert "'East'" in finding.message
    # The hole is closed but for 0.6 m.
    shop.mesh([(4.2, 0, 2.5), (7.2, 0, 2.5), (7.2, 2.4, 2.5), (4.2, 2.4, 2.5)], [(3, 2, 1, 0)], "Lid", shop.bpy.data.collections["East"])
    found = checked()
    assert about(found, "is open") == []
    (gap,) = about(found, "has a gap")
    assert gap.place[1] == pytest.approx(2.7, abs=0.3)


def test_normals(shop, checked):
    import bmesh

    made = shop.two_rooms()
    made["East"].data.flip_normals()
    found = about(checked(), "away from the room")
    assert [f.objects for f in found] == [("East walls",)]
    assert len(found[0].faces) == 5
    made["East"].data.flip_normals()
    shop.box((1, 1, 0), (2, 2, 1), "Table", inward=False, collection=shop.bpy.data.collections["West"])
    assert about(checked(), "away from the room") == []
    table = shop.bpy.data.objects["Table"]
    work = bmesh.new()
    work.from_mesh(table.data)
    work.faces.ensure_lookup_table()
    work.faces[3].normal_flip()
    work.to_mesh(table.data)
    (finding,) = about(checked(), "the other way")
    assert (finding.objects, finding.faces) == (("Table",), (3,))


def test_bent_faces_and_shared_meshes(shop, checked):
    made = shop.two_rooms()
    made["West"].data.vertices[0].co.z -= 0.05
    twin = shop.bpy.data.objects.new("Twin", made["Lamp"].data)
    shop.bpy.data.collections["West"].objects.link(twin)
    twin.location.x = 1.5
    found = checked()
    (bent,) = about(found, "not flat")
    assert (bent.level, bent.objects, len(bent.faces)) == ("NOTE", ("West walls",), 1)
    (shared,) = about(found, "is shared by 2 objects")
    assert sorted(shared.objects) == ["Lamp", "Twin"]


def test_rooms_without_light(shop, checked):
    made = shop.two_rooms()
    shop.bpy.data.objects.remove(made["Door"])
    shop.mesh([(4.1, 0.5, 0), (4.1, 2.5, 0), (4.1, 2.5, 2.2), (4.1, 0.5, 2.2)], [(0, 1, 2, 3)], "Board", shop.bpy.data.collections["West"])
    (finding,) = about(checked(), "stays black")
    assert "'East'" in finding.message
    assert "East walls" in finding.objects
    made["Lamp"].enfilade.left_out = True
    assert about(checked(), "Nothing in the scene emits light")


def test_a_click_selects_the_offender(shop):
    bpy = shop.bpy
    made = shop.two_rooms()
    made["West"].data.vertices[0].co.z -= 0.05
    bpy.context.view_layer.update()
    bpy.ops.enfilade.check()
    checked = bpy.context.window_manager.enfilade_check
    number = next(k for k, f in enumerate(checked.findings) if "not flat" in f.message)
    made["Lamp"].select_set(True)
    checked.active = number
    assert [o.name for o in bpy.context.selected_objects] == ["West walls"]
    assert bpy.context.view_layer.objects.active == made["West"]
    chosen = [p.index for p in made["West"].data.polygons if p.select]
    assert chosen == [int(f) for f in checked.findings[number].faces.split()]


def test_findings_of_one_file_are_not_shown_in_another(shop):
    bpy = shop.bpy
    shop.two_rooms()
    bpy.ops.enfilade.check()
    assert bpy.context.window_manager.enfilade_check.done
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert not bpy.context.window_manager.enfilade_check.done
    bpy.context.view_layer.objects.active = shop.box((0, 0, 0), (1, 1, 1), "Box")
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="object mode"):
        bpy.ops.enfilade.check()


def test_boxes_welded_along_an_edge_are_in_order(shop, checked):
    """Two steps that meet in one edge, which their neighbouring faces run along in the same direction."""
    shop.two_rooms()
    vertices = [(1 + x, 1 + y, z) for y in (0, 0.5) for x, z in ((0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5), (1, 0.5), (1, 1), (0.5, 1))]
    lower, upper = [0, 1, 2, 3], [2, 4, 5, 6]
    faces = []
    for ring in (lower, upper):
        sides = [(a, b, b + 7, a + 7) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
        faces += sides + [tuple(ring[::-1]), tuple(v + 7 for v in ring)]
    shop.mesh(vertices, [f[::-1] for f in faces], "Steps", shop.bpy.data.collections["West"])
    assert about(checked(), "Steps") == []


def test_what_a_bake_costs(shop):
    from enfilade.addon.checks import cost

    shop.two_rooms()
    words, basis = cost(shop.bpy.context)
    assert " to " in words
    assert words.endswith("MB")
    assert basis.startswith("For 21 polygons in 2 rooms and 84 values")
    bake = shop.bpy.context.scene.enfilade.bake
    bake.target, bake.texel_density = "texture", 10.0
    # 2 x 42 m2 of walls and ceilings less the doors, and 1 m2 of lamp.
    values = int(cost(shop.bpy.context)[1].split(" values")[0].split()[-1].replace(",", ""))
    assert values == pytest.approx(100 * (2 * (12 + 7.5 + 10) + 2 * (9 + 7.5 + 7.5) - 4 + 1), rel=0.01)
    shop.bpy.ops.enfilade.check()
    assert shop.bpy.context.window_manager.enfilade_check.estimate
