"""Output that is right where bakes go wrong: seams, leaks, margins, colour spaces, and scenes that are not tidy."""

import math

import numpy as np
import pytest
from enfilade.core.options import BakeOptions, Options

TEXTURE = {"target": "texture", "texel_density": 16.0, "quantity": "lighting"}


def lookup(data, uv):
    """Bilinear values of (H, W, 4) pixels at coordinates 0..1, as a viewer takes them."""
    x, y = uv[:, 0] * data.shape[1] - 0.5, uv[:, 1] * data.shape[0] - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - i)[:, None], (y - j)[:, None]
    low = data[j, i] * (1 - fx) + data[j, i + 1] * fx
    return low * (1 - fy) + (data[j + 1, i] * (1 - fx) + data[j + 1, i + 1] * fx) * fy


def along(corners, uv, share):
    """Coordinates (n, 2) along an edge from the first to the second of two corners."""
    return uv[corners[0]] + share[:, None] * (uv[corners[1]] - uv[corners[0]])


# ------------------------------------------------------------------------------------------------ seams and margins


@pytest.mark.parametrize("margin", [1, 4])
def test_walls_agree_along_the_edge_that_they_share(shop, margin):
    """On both sides of every seam, at every place along it, the texture has the light of that place."""
    thing = shop.box((0, 0, 0), (2.3, 1.7, 1.1), "Room")
    thing.rotation_euler = (0.3, 0.2, 0.7)
    shop.bpy.context.view_layer.update()
    shop.bake(**TEXTURE, margin=margin)
    data, uv, place = shop.pixels(shop.bpy.data.images["Enfilade Room"]), shop.lightmap(thing), shop.corners(thing)
    mesh, share, seams = thing.data, np.linspace(0, 1, 41), {}
    for face in mesh.polygons:
        loops = list(face.loop_indices)
        for a, b in zip(loops, loops[1:] + loops[:1], strict=True):
            ends = mesh.loops[a].vertex_index, mesh.loops[b].vertex_index
            seams.setdefault(tuple(sorted(ends)), []).append((a, b) if ends[0] < ends[1] else (b, a))
    assert len(seams) == 12
    for sides in seams.values():
        one, other = (lookup(data, along(pair, uv, share)) for pair in sides)
        assert one == pytest.approx(other, rel=1e-4)
        exact = shop.light(place[sides[0][0]] + share[:, None] * (place[sides[0][1]] - place[sides[0][0]])) / math.pi
        assert one[:, :3] == pytest.approx(exact, rel=1e-4)


def test_charts_have_their_margin_all_around(shop):
    """As many texels as asked for hold the light of the rim, so that filters and smaller versions read nothing foreign."""
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room")
    shop.bake(**TEXTURE, step=40.0, margin=5)
    data, uv = shop.pixels(shop.bpy.data.images["Enfilade Room"]), shop.lightmap(thing)
    size = np.array([data.shape[1], data.shape[0]])
    for face in thing.data.polygons:
        corner = uv[list(face.loop_indices)] * size - 0.5
        low, high = np.round(corner.min(0)).astype(int), np.round(corner.max(0)).astype(int)
        inner = data[low[1] : high[1] + 1, low[0] : high[0] + 1, :3]
        outer = data[low[1] - 5 : high[1] + 6, low[0] - 5 : high[0] + 6, :3]
        assert outer.shape[0] == inner.shape[0] + 10
        # Faces differ by steps of 40: whatever came from another face would lie outside the range of this one.
        slack = 0.02 * inner.max() + 0.5
        assert outer.min() > inner.min() - slack
        assert outer.max() < inner.max() + slack


def test_the_margin_is_kept_between_objects_of_one_texture(shop):
    for name, x in (("A", 0.0), ("B", 3.0), ("C", 6.0)):
        shop.box((x, 0, 0), (x + 1, 1, 1), name)
    shop.bake(**TEXTURE, atlas="room", margin=3)
    boxes = []
    (image,) = (i for i in shop.bpy.data.images if i.enfilade.made)
    for name in "ABC":
        thing = shop.bpy.data.objects[name]
        uv = shop.lightmap(thing) * image.size[:] - 0.5
        boxes += [(uv[list(f.loop_indices)].min(0), uv[list(f.loop_indices)].max(0)) for f in thing.data.polygons]
    for k, (low, high) in enumerate(boxes):
        assert (low >= 3 - 1e-3).all()
        assert (high <= np.array(image.size) - 4 + 1e-3).all()
        for other_low, other_high in boxes[:k]:
            assert np.maximum(low - other_high, other_low - high).max() > 2 * 3


# ------------------------------------------------------------------------------------------------------------ leaks


def divided_room(shop, thickness):
    """A closed room in two by a wall from floor to ceiling, all in one room; the lamp on one side. Floor and walls run through."""
    paint = shop.material("Paint", (0.7, 0.7, 0.7))
    room = shop.box((0, 0, 0), (4, 3, 2.5), "Shell", material=paint)
    wall = shop.box((2, 0, 0), (2 + thickness, 3, 2.5), "Wall", inward=False, material=paint)
    shop.mesh(
        [(0.5, 1, 2.4), (0.5, 2, 2.4), (1.5, 2, 2.4), (1.5, 1, 2.4)], [(0, 1, 2, 3)], "Lamp", material=shop.material("Glow", emission=10.0)
    )
    shop.bpy.context.view_layer.update()
    return room, wall


@pytest.mark.parametrize("thickness", [0.2, 0.05])
def test_no_light_comes_through_a_wall_into_a_texture(shop, thickness):
    from enfilade.core.pipeline import run

    room, wall = divided_room(shop, thickness)
    shop.bake(solver=run, options=Options(quality="draft"), **{**TEXTURE, "texel_density": 12.0})
    weight = np.stack(np.meshgrid(np.linspace(0.02, 0.98, 40), np.linspace(0.02, 0.98, 30)), -1).reshape(-1, 2)
    data, uv, place = shop.pixels(shop.bpy.data.images["Enfilade Shell"]), shop.lightmap(room), shop.corners(room)
    dark, lit = [], []
    for face in room.data.polygons:
        a, b, _, d = face.loop_indices
        at = place[a] + weight[:, :1] * (place[b] - place[a]) + weight[:, 1:] * (place[d] - place[a])
        values = lookup(data, uv[a] + weight[:, :1] * (uv[b] - uv[a]) + weight[:, 1:] * (uv[d] - uv[a]))[:, :3].mean(1)
        # A texel beside the foot of the wall stands for both of its sides.
        dark.append(values[at[:, 0] > 2 + thickness + 1.5 / 12])
        lit.append(values[at[:, 0] < 2 - 1.5 / 12])
    dark, lit = np.concatenate(dark), np.concatenate(lit)
    assert len(dark) > 1000
    assert lit.mean() > 0.1
    assert dark.max() < 0.002 * lit.mean()
    image = shop.pixels(shop.bpy.data.images["Enfilade Wall"])
    uv, place = shop.lightmap(wall), shop.corners(wall)
    for face in wall.data.polygons:
        if all(place[c][0] > 2 + 0.5 * thickness for c in face.loop_indices):
            assert lookup(image, uv[list(face.loop_indices)].mean(0)[None])[0, :3].max() < 0.002 * lit.mean()


def test_no_light_comes_through_a_wall_into_vertex_colours(shop):
    from enfilade.core.pipeline import run

    divided_room(shop, 0.1)
    shop.bake(solver=run, options=Options(quality="draft"), subdivide=0.4, quantity="lighting")
    copy = shop.bpy.data.objects["Shell (bake)"]
    place, color = shop.corners(copy), shop.colors(copy)[:, :3].mean(1)
    lit = color[place[:, 0] < 1.9].mean()
    assert lit > 0.1
    assert color[place[:, 0] > 2.2].max() < 0.002 * lit


def test_two_rooms_without_a_door_share_no_light(shop):
    """A house of two rooms: not even where their textures, walls and vertices touch."""
    from enfilade.core.pipeline import run

    rooms = shop.collection("Rooms")
    for name, x in (("West", 0.0), ("East", 3.0)):
        shop.box((x, 0, 0), (x + 3, 3, 2.5), f"{name} walls", collection=shop.collection(name, rooms))
    shop.mesh(
        [(1, 1, 2.4), (1, 2, 2.4), (2, 2, 2.4), (2, 1, 2.4)],
        [(0, 1, 2, 3)],
        "Lamp",
        rooms.children["West"],
        shop.material("Glow", emission=9.0),
    )
    for bake in ({"quantity": "lighting"}, {**TEXTURE, "texel_density": 4.0, "atlas": "room"}):
        shop.bake(solver=run, options=Options(quality="draft"), **bake)
        if "target" in bake:
            west, east = (shop.pixels(shop.bpy.data.images[f"Enfilade {n}"])[..., :3] for n in ("West", "East"))
        else:
            west, east = (shop.colors(shop.bpy.data.objects[f"{n} walls"])[:, :3] for n in ("West", "East"))
        assert west.max() > 0.1
        assert (east == 0).all()


# --------------------------------------------------------------------------------------------- range and colour space


def test_an_exr_file_holds_the_light_as_it_is(shop, tmp_path):
    """From a thousandth to ten thousand, in single precision and linear, also for programs that know nothing of Blender."""
    from enfilade.addon.bake_texture import write_image

    ramp = np.ones((4, 64, 4), np.float32)
    ramp[:, :, :3] = np.geomspace(1e-3, 1e4, 64, dtype=np.float32)[None, :, None]
    ramp[:, :, 1] *= 0.5
    write_image("Ramp", ramp, "exr", str(tmp_path))
    image = shop.bpy.data.images.load(str(tmp_path / "Ramp.exr"))
    image.colorspace_settings.name = "Non-Color"
    assert np.array_equal(shop.pixels(image), ramp)
    image.colorspace_settings.name = next(n for n in ("Linear Rec.709", "Linear") if n in names_of_spaces(image))
    image.reload()
    assert shop.pixels(image) == pytest.approx(ramp, rel=1e-5)


def names_of_spaces(image):
    return [item.identifier for item in image.colorspace_settings.bl_rna.properties["name"].enum_items]


# ---------------------------------------------------------------------------------------------- scenes that are not tidy


@pytest.mark.parametrize("bake", [{}, {"target": "texture", "texel_density": 8.0}], ids=["vertex", "texture"])
@pytest.mark.parametrize("scale", [(-1, 1, 1), (-2, -1, -0.5), (0.01, 3, 1)])
def test_mirrored_and_stretched_objects_carry_the_light_of_their_place(shop, bake, scale):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room")
    thing.scale, thing.location = scale, (1, 2, 0)
    parent = shop.bpy.data.objects.new("Parent", None)
    shop.bpy.context.scene.collection.objects.link(parent)
    parent.scale, thing.parent = (1, -1, 2), parent
    shop.bpy.context.view_layer.update()
    shop.bake(quantity="lighting", **bake)
    expected = shop.light(shop.corners(thing)) / math.pi
    got = lookup(shop.pixels(shop.bpy.data.images["Enfilade Room"]), shop.lightmap(thing)) if bake else shop.colors(thing)
    assert got[:, :3] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("bake", [{}, {"target": "texture", "texel_density": 8.0}, {"subdivide": 0.5}], ids=["vertex", "texture", "copy"])
def test_hidden_and_excluded_objects(shop, bake):
    """What renders do not show is not there; what only viewports hide is baked and stays hidden."""
    bpy = shop.bpy
    away = shop.collection("Away")
    dull = shop.collection("Dull")
    for name, home in (("Shown", None), ("No render", None), ("No viewport", None), ("Eye", None), ("Out", away), ("Disabled", dull)):
        shop.box((0, 0, 0), (1, 1, 1), name, collection=home)
    bpy.data.objects["No render"].hide_render = True
    bpy.data.objects["No viewport"].hide_viewport = True
    bpy.data.objects["Eye"].hide_set(True)
    bpy.context.view_layer.layer_collection.children["Away"].exclude = True
    dull.hide_render = True
    before = shop.state()
    reading, _, written = shop.bake(**bake)
    assert set(reading.extraction.scene.object_names) == {"Shown", "No viewport", "Eye"}
    ending = " (bake)" if "subdivide" in bake else ""
    assert set(written.objects) == {f"{name}{ending}" for name in ("Shown", "No viewport", "Eye")}
    for name in ("No render", "Out", "Disabled"):
        tags = bpy.data.objects[name].data.enfilade
        assert (tags.attribute, tags.uv_map, tags.image) == ("", "", None)
    assert bpy.data.objects["Eye"].hide_get()
    shop.bpy.ops.enfilade.clear()
    assert shop.state() == before


def test_instances_of_a_collection_are_named_and_their_source_is_left_alone(shop):
    bpy = shop.bpy
    kit = bpy.data.collections.new("Kit")
    shop.box((0, 0, 0), (1, 1, 1), "Chair", collection=kit)
    shop.box((-5, -5, -5), (9, 9, 9), "Room")
    for k in range(3):
        place = bpy.data.objects.new(f"Place {k}", None)
        place.instance_type, place.instance_collection, place.location.x = "COLLECTION", kit, 2.0 * k
        bpy.context.scene.collection.objects.link(place)
    reading, _, written = shop.bake()
    assert reading.extraction.scene.polygon_count == 6 + 3 * 6
    assert written.objects == ("Room",)
    assert any("instances" in w and "'Chair'" in w for w in written.warnings)
    assert len(bpy.data.objects["Chair"].data.color_attributes) == 0


def test_linked_libraries_are_read_and_never_written(shop, tmp_path):
    """A linked object shapes the light; an object of one's own with a linked mesh gets a mesh of its own, and gives it back."""
    bpy = shop.bpy
    shop.box((0, 0, 0), (1, 1, 1), "Crate")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    shop.box((-5, -5, -5), (9, 9, 9), "Room")
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.objects = ["Crate"]
    linked = bpy.data.objects["Crate"]
    bpy.context.scene.collection.objects.link(linked)
    own = bpy.data.objects.new("Own", linked.data)
    own.location.x = 3.0
    bpy.context.scene.collection.objects.link(own)
    bpy.context.view_layer.update()
    for bake in ({"quantity": "lighting"}, {**TEXTURE, "texel_density": 4.0}, {"quantity": "lighting", "material": True}):
        reading, _, written = shop.bake(**bake)
        assert reading.extraction.scene.polygon_count == 18
        assert set(written.objects) == {"Room", "Own"}
        assert any("linked objects" in w and "'Crate'" in w for w in written.warnings)
        assert linked.data.library is not None
        assert len(linked.data.color_attributes) == len(linked.data.uv_layers) == 0
        assert own.data.library is None
        if "target" not in bake:
            assert shop.colors(own)[:, :3] == pytest.approx(shop.light(shop.corners(own)) / math.pi, rel=1e-5)
        bpy.ops.enfilade.clear()
        assert own.data == linked.data


def test_several_uv_maps_and_paint_keep_their_place(shop):
    """The lightmap has a map of its own, whatever is active, and materials go on finding theirs by name and by default."""
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room")
    for name in ("Paint", "Decals"):
        thing.data.uv_layers.new(name=name)
    thing.data.uv_layers["Paint"].active_render = True
    thing.data.uv_layers.active = thing.data.uv_layers["Decals"]
    for _ in range(2):
        shop.bake(**TEXTURE, material=True)
        assert [layer.name for layer in thing.data.uv_layers] == ["Paint", "Decals", "Enfilade UV"]
        assert thing.data.uv_layers.active.name == "Decals"
        assert next(layer.name for layer in thing.data.uv_layers if layer.active_render) == "Paint"
        tree = thing.material_slots[0].material.node_tree
        assert [node.uv_map for node in tree.nodes if node.type == "UVMAP"] == ["Enfilade UV"]


def test_one_bake_is_one_step_of_undo(shop):
    bpy = shop.bpy
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room")
    bpy.context.scene.enfilade.solve.quality = "draft"
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="before")
    before = shop.state()
    bpy.ops.enfilade.bake("EXEC_DEFAULT", True)
    assert thing.data.color_attributes.keys() == ["Enfilade"]
    assert bpy.context.scene.enfilade.baked_from
    bpy.ops.ed.undo()
    assert shop.state() == before
    assert (bpy.context.scene.enfilade.summary, bpy.context.scene.enfilade.baked_from) == ("", "")
    bpy.ops.ed.redo()
    assert bpy.data.objects["Room"].data.color_attributes.keys() == ["Enfilade"]


# ------------------------------------------------------------------------------------------------------------ speed


def test_writing_a_million_corners_takes_less_than_a_second(shop):
    import time

    from enfilade.addon.bake_vertex import write_colors

    side = 500
    thing = shop.mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    mesh = thing.data
    grid = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], -1).reshape(-1, 4)
    mesh.clear_geometry()
    mesh.vertices.add(grid.size)
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.reshape(-1).astype(np.int32))
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    color = np.random.default_rng(0).random((quads.size, 4), np.float32)
    started = time.process_time()
    write_colors(mesh, "Light", "corner", color)
    assert time.process_time() - started < 1.0
    assert quads.size == 1_000_000
    assert np.array_equal(shop.colors(thing, "Light"), color)


def test_writing_a_texture_of_2048_takes_less_than_five_seconds(shop):
    import time

    from enfilade.addon.bake_texture import write_image

    pixels = np.random.default_rng(0).random((2048, 2048, 4), np.float32)
    started = time.process_time()
    image = write_image("Large", pixels, "exr", "")
    assert time.process_time() - started < 5.0
    assert np.array_equal(shop.pixels(image), pixels)


def test_options_are_what_the_file_remembers(shop):
    """A bake by other options than those of the panel is not out of date at once."""
    from enfilade.addon import job, outdated

    shop.box((0, 0, 0), (1, 1, 1), "Room")
    scene, view_layer = shop.bpy.context.scene, shop.bpy.context.view_layer
    reading = job.read(shop.bpy.context, Options(quality="draft"), BakeOptions(quantity="lux"))
    baked = job.solve_all(reading)
    written = job.write(shop.bpy.context, reading, baked)
    assert outdated.look(scene, view_layer)
    job.remember(scene, reading, baked, written)
    assert not outdated.look(scene, view_layer)
