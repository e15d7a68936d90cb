"""What a bake writes, and that Clear takes exactly that away, under light that is known everywhere."""

import math

import numpy as np
import pytest
from enfilade.core.options import BakeOptions, Options
from enfilade.core.scene import SceneError

SLOPE = np.array([[0.3, 0.6, 0.9], [0.5, 1.0, 1.5], [0.7, 1.4, 2.1]])


def light(points):
    return (np.asarray(points, float) + 20.0) @ SLOPE


def clear(shop):
    from enfilade.addon.clear import clear as clear_all

    return clear_all(shop.bpy.context.scene)


# -------------------------------------------------------------------------------------------------- vertex colours


@pytest.mark.parametrize("quantity", ["radiosity", "lighting", "lux"])
def test_corner_colours_keep_their_range(shop, quantity):
    thing = shop.box((0, 0, 0), (2, 3, 1), material=shop.material(color=(0.5, 0.25, 0.9), emission=3.0))
    thing.location = (1, 2, 3)
    shop.bake(quantity=quantity)
    e = light(shop.corners(thing))
    expected = {
        "radiosity": 3.0 + e * [0.5, 0.25, 0.9] / math.pi,
        "lighting": e / math.pi,
        "lux": np.repeat(179 * e @ np.array([[0.2126], [0.7152], [0.0722]]), 3, 1),
    }[quantity]
    made = thing.data.color_attributes["Enfilade"]
    assert (made.data_type, made.domain) == ("FLOAT_COLOR", "CORNER")
    assert shop.colors(thing)[:, :3] == pytest.approx(expected, rel=1e-5)
    assert (shop.colors(thing)[:, 3] == 1).all()
    assert expected.max() > 1


def test_vertex_colours_per_vertex(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1))
    shop.bake(step=12.0, domain="point", quantity="lighting", name="Light")
    made = thing.data.color_attributes["Light"]
    assert (made.domain, len(made.data)) == ("POINT", 8)
    positions = np.array([v.co for v in thing.data.vertices])
    steps = np.zeros(8)
    for face in thing.data.polygons:
        steps[list(face.vertices)] += 12.0 * face.index / 3
    assert shop.colors(thing, "Light")[:, :3] == pytest.approx((light(positions) + steps[:, None]) / math.pi, rel=1e-5)


def test_light_is_split_at_hard_edges_and_marked_ones(shop):
    thing = shop.mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0.1), (0, 1, 0), (1, 1, 0), (2, 1, 0.1)], [(0, 1, 4, 3), (1, 2, 5, 4)])
    shop.bake(step=6.0, quantity="lighting")
    e = light(shop.corners(thing))
    shared = np.array([0, 3, 3, 0, 3, 6, 6, 3.0])
    assert shop.colors(thing)[:, :3] == pytest.approx((e + shared[:, None]) / math.pi, rel=1e-5)
    edge = next(e for e in thing.data.edges if set(e.vertices) == {1, 4})
    edge.use_edge_sharp = True
    shop.bake(step=6.0, quantity="lighting")
    apart = np.repeat([0.0, 6.0], 4)
    assert shop.colors(thing)[:, :3] == pytest.approx((e + apart[:, None]) / math.pi, rel=1e-5)


def test_modifiers_that_move_vertices_are_sampled_where_they_move_them(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1))
    move = thing.modifiers.new("Move", "DISPLACE")
    move.direction, move.strength, move.mid_level = "X", 5.0, 0.0
    shop.bake(quantity="lighting")
    assert shop.colors(thing)[:, :3] == pytest.approx(light(shop.corners(thing) + np.array([5, 0, 0])) / math.pi, rel=1e-5)


def test_modifiers_that_change_faces_are_skipped_with_a_sentence(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Smooth")
    thing.modifiers.new("Subdivision", "SUBSURF")
    shop.box((5, 0, 0), (6, 1, 1), "Plain")
    _, _, written = shop.bake()
    assert written.objects == ("Plain",)
    assert any("'Smooth' carries no light because its modifiers (Subdivision)" in w for w in written.warnings)
    assert len(thing.data.color_attributes) == 0
    shop.bpy.data.objects.remove(shop.bpy.data.objects["Plain"])
    with pytest.raises(SceneError, match="'Smooth'"):
        shop.bake()


def test_shared_meshes_become_single_and_are_shared_again(shop):
    first = shop.box((0, 0, 0), (1, 1, 1), "First")
    second = shop.bpy.data.objects.new("Second", first.data)
    shop.bpy.context.scene.collection.objects.link(second)
    second.location.x = 5
    before = shop.state()
    shop.bake(quantity="lighting")
    assert first.data != second.data
    for thing in (first, second):
        assert shop.colors(thing)[:, :3] == pytest.approx(light(shop.corners(thing)) / math.pi, rel=1e-5)
    assert clear(shop) == []
    assert first.data == second.data
    assert shop.state() == before


def test_a_single_mesh_that_was_edited_is_kept(shop):
    first = shop.box((0, 0, 0), (1, 1, 1), "First")
    second = shop.bpy.data.objects.new("Second", first.data)
    shop.bpy.context.scene.collection.objects.link(second)
    shop.bake()
    second.data.vertices[0].co.x -= 1
    said = clear(shop)
    assert len(said) == 1
    assert "'Second' was edited" in said[0]
    assert second.data.vertices[0].co.x == pytest.approx(-1)
    assert len(second.data.color_attributes) == 0


def test_the_users_own_colours_stay(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1))
    thing.data.color_attributes.new(name="Mine", type="BYTE_COLOR", domain="CORNER")
    thing.data.color_attributes.new(name="Other", type="FLOAT_COLOR", domain="POINT")
    thing.data.attributes.active_color_name, thing.data.attributes.default_color_name = "Other", "Mine"
    before = shop.state()
    shop.bake()
    assert thing.data.attributes.active_color_name == "Enfilade"
    assert thing.data.attributes.default_color_name == "Mine"
    clear(shop)
    assert shop.state() == before


@pytest.mark.parametrize("target", ["vertex", "texture"])
def test_a_name_that_is_taken_is_refused(shop, target):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Owner")
    thing.data.attributes.new("Enfilade" if target == "vertex" else "Enfilade UV", "FLOAT", "POINT")
    before = shop.state()
    with pytest.raises(SceneError, match="object 'Owner' has an attribute"):
        shop.bake(target=target)
    assert shop.state() == before


def test_baking_again_replaces_what_was_there(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1), material=shop.material())
    before = shop.state()
    shop.bake(material=True)
    shop.bake(target="texture", material=True, atlas="room")
    assert len(thing.data.color_attributes) == 0
    shop.bake(domain="point", name="Again", material=True)
    assert [a.name for a in thing.data.color_attributes] == ["Again"]
    assert len(thing.data.uv_layers) == 0
    clear(shop)
    assert shop.state() == before


def test_an_object_that_changed_meanwhile_is_left_alone(shop):
    from enfilade.addon import job

    for name in ("Gone", "Edited", "Same"):
        shop.box((0, 0, 0), (1, 1, 1), name)
    shop.bpy.context.view_layer.update()
    reading = job.read(shop.bpy.context, Options(), BakeOptions())

    def known(scene, options):
        yield job.Step("solve", 0.5, "")
        known = {
            "irradiance": lambda self, points, polygon: light(points),
            "shows": lambda self, points, polygon: np.full(len(points), True),
        }
        return type("Light", (), {"report": {}, **known})()

    baked = job.solve_all(reading, None, known)
    shop.bpy.data.objects.remove(shop.bpy.data.objects["Gone"])
    shop.bpy.data.objects["Edited"].data = shop.mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]).data
    written = job.write(shop.bpy.context, reading, baked)
    assert written.objects == ("Same",)
    assert any("'Gone' was deleted" in w for w in written.warnings)
    assert any("'Edited' were changed" in w for w in written.warnings)
    assert len(shop.bpy.data.objects["Edited"].data.color_attributes) == 0


# ------------------------------------------------------------------------------------------------ subdivided copies


def test_a_subdivided_copy_carries_the_light(shop):
    thing = shop.box((0, 0, 0), (2, 2, 2), "Room", material=shop.material())
    layer = thing.data.uv_layers.new(name="Own")
    uv = np.random.default_rng(0).random((24, 2)).astype(np.float32)
    layer.uv.foreach_set("vector", uv.ravel())
    thing.data.attributes.new("Mark", "INT", "FACE").data.foreach_set("value", np.arange(6, dtype=np.int32))
    thing.location, thing.scale = (3, 1, 0), (1, -1, 2)
    before = shop.state()
    _, _, written = shop.bake(subdivide=0.5, quantity="lighting")
    assert written.objects == ("Room (bake)",)
    copy = shop.bpy.data.objects["Room (bake)"]
    assert (thing.hide_render, thing.hide_viewport, copy.hide_render, copy.hide_viewport) == (True, True, False, False)
    at = shop.corners(copy).reshape(-1, 3, 3)
    assert len(at) > 500
    assert np.linalg.norm(at - np.roll(at, 1, axis=1), axis=2).max() <= 0.5 + 1e-6
    assert shop.colors(copy)[:, :3] == pytest.approx(light(shop.corners(copy)) / math.pi, rel=1e-5)
    assert len(copy.data.vertices) == 2 + len(copy.data.edges) - len(copy.data.polygons)  # closed, no cracks
    assert copy.data.materials[0] == thing.data.materials[0]
    # Whatever was on the mesh is on the copy, interpolated.
    marks = np.array([d.value for d in copy.data.attributes["Mark"].data])
    corners = {f.index: (shop.corners(thing)[list(f.loop_indices)], uv[list(f.loop_indices)]) for f in thing.data.polygons}
    mapped = np.array([d.vector for d in copy.data.uv_layers["Own"].uv])
    places = shop.corners(copy)
    for k in range(0, len(places), 97):
        p, q = corners[marks[k // 3]]
        for half in ([0, 1, 2], [0, 2, 3], [1, 2, 3], [0, 1, 3]):
            w = np.linalg.lstsq(np.vstack([p[half].T, np.ones(3)]), np.append(places[k], 1), rcond=None)[0]
            if np.allclose(w @ p[half], places[k], atol=1e-5) and w.min() > -1e-5 and np.allclose(w @ q[half], mapped[k], atol=1e-5):
                break
        else:
            pytest.fail("a texture coordinate is on no triangle of its face")
    assert clear(shop) == []
    assert shop.state() == before


def test_modified_meshes_are_baked_as_copies(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Array")
    array = thing.modifiers.new("Array", "ARRAY")
    array.count, array.relative_offset_displace = 2, (2, 0, 0)
    before = shop.state()
    shop.bake(subdivide=0.6)
    copy = shop.bpy.data.objects["Array (bake)"]
    assert len(copy.modifiers) == 0
    assert shop.corners(copy)[:, 0].max() == pytest.approx(3)
    # What the copy stands for is read the next time, not the copy.
    reading, _, _ = shop.bake(subdivide=0.6)
    assert reading.extraction.scene.polygon_count == 12
    assert sum(o.name.startswith("Array (bake)") for o in shop.bpy.data.objects) == 1
    clear(shop)
    assert shop.state() == before


# -------------------------------------------------------------------------------------------------------- textures


def pixels(image):
    out = np.zeros(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(out)
    return out.reshape(image.size[1], image.size[0], 4)


def lookup(image, uv):
    """Bilinear values at texture coordinates 0..1."""
    data = pixels(image).astype(float)
    x, y = np.clip(uv * [data.shape[1], data.shape[0]] - 0.5, 0, [data.shape[1] - 1, data.shape[0] - 1]).T
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - i)[:, None], (y - j)[:, None]
    k, m = np.minimum(i + 1, data.shape[1] - 1), np.minimum(j + 1, data.shape[0] - 1)
    return (data[j, i] * (1 - fx) + data[j, k] * fx) * (1 - fy) + (data[m, i] * (1 - fx) + data[m, k] * fx) * fy


def lightmap(thing, name="Enfilade UV"):
    return np.array([d.vector for d in thing.data.uv_layers[name].uv])


@pytest.mark.parametrize("atlas", ["object", "room"])
def test_textures_show_the_light_everywhere(shop, atlas):
    made = shop.two_rooms()
    _, _, written = shop.bake(step=3.0, target="texture", texel_density=8.0, quantity="lighting", atlas=atlas, margin=2)
    names = {"Enfilade West", "Enfilade East"} if atlas == "room" else {f"Enfilade {n.name}" for k, n in made.items() if k != "Door"}
    assert set(written.images) == names
    reading = shop.extract()
    number = {name: k for k, name in enumerate(reading.scene.object_names)}
    weight = np.random.default_rng(0).dirichlet([1, 1, 1, 1], 60)
    for name, room in (("West walls", "West"), ("Lamp", "West"), ("East door wall", "East")):
        thing = shop.bpy.data.objects[name]
        image = shop.bpy.data.images[f"Enfilade {room if atlas == 'room' else name}"]
        corners, uv = shop.corners(thing), lightmap(thing)
        first = np.flatnonzero(reading.scene.object == number[name])[0]
        for k, face in enumerate(thing.data.polygons):
            loops = list(face.loop_indices)
            expected = (light(weight @ corners[loops]) + 3.0 * (first + k)) / math.pi
            got = lookup(image, weight @ uv[loops])[:, :3]
            if name == "East door wall":  # one chart of five polygons: the steps between them are smeared over a texel
                assert np.median(np.abs(got / expected - 1)) < 0.02
            else:
                assert got == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize("atlas", ["object", "room"])
def test_objects_have_texels_of_their_own_scale(shop, atlas):
    made = shop.two_rooms()
    made["West"].enfilade.texel_scale = 2.0
    made["Lamp"].enfilade.texel_scale = 0.5
    shop.bake(target="texture", texel_density=8.0, atlas=atlas)
    for name, density in (("West", 16.0), ("Lamp", 4.0), ("East", 8.0)):
        thing = made[name]
        room = "East" if name == "East" else "West"
        image = shop.bpy.data.images[f"Enfilade {room if atlas == 'room' else thing.name}"]
        corners, uv = shop.corners(thing), lightmap(thing) * image.size
        for face in thing.data.polygons:
            a, b = face.loop_start, face.loop_start + 1
            assert np.linalg.norm(uv[b] - uv[a]) == pytest.approx(density * np.linalg.norm(corners[b] - corners[a]), rel=1e-3)


def test_charts_of_one_texture_do_not_overlap(shop):
    shop.two_rooms()
    shop.bake(target="texture", texel_density=16.0, atlas="room", margin=1)
    image = shop.bpy.data.images["Enfilade West"]
    taken = np.zeros((image.size[1], image.size[0]), int)
    for name in ("West walls", "West door wall", "Lamp"):
        uv = lightmap(shop.bpy.data.objects[name]) * image.size[:] - 0.5
        charts = [uv] if name == "West door wall" else [uv[4 * k : 4 * k + 4] for k in range(len(uv) // 4)]
        for chart in charts:
            low, high = np.round(chart.min(0)).astype(int), np.round(chart.max(0)).astype(int)
            assert chart.min(0) == pytest.approx(low, abs=1e-3)
            taken[low[1] : high[1] + 1, low[0] : high[0] + 1] += 1
    assert taken.max() == 1


def test_the_users_uv_maps_stay(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1))
    for name in ("First", "Second", "Third"):
        thing.data.uv_layers.new(name=name)
    thing.data.uv_layers["Second"].active_render = True
    thing.data.uv_layers.active = thing.data.uv_layers["Third"]
    before = shop.state()
    values = [np.array([d.vector for d in layer.uv]) for layer in thing.data.uv_layers]
    shop.bake(target="texture")
    assert thing.data.uv_layers.active.name == "Third"
    assert [layer.name for layer in thing.data.uv_layers if layer.active_render] == ["Second"]
    for layer, value in zip(thing.data.uv_layers, values, strict=False):
        assert np.array_equal(np.array([d.vector for d in layer.uv]), value)
    assert len(thing.data.uv_layers) == 4
    clear(shop)
    assert shop.state() == before


def test_eight_uv_maps_leave_no_room(shop):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Full")
    for k in range(8):
        thing.data.uv_layers.new(name=f"UV {k}")
    with pytest.raises(SceneError, match="object 'Full' has eight UV maps"):
        shop.bake(target="texture")


@pytest.mark.parametrize("image_format", ["exr", "png"])
@pytest.mark.parametrize("packed", [True, False])
def test_images_survive_the_file(shop, tmp_path, image_format, packed):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Cube")
    folder = "" if packed else str(tmp_path)
    shop.bake(target="texture", quantity="radiosity", texel_density=8.0, image_format=image_format, image_folder=folder)
    image = shop.bpy.data.images["Enfilade Cube"]
    assert (image.packed_file is not None) == packed
    assert (tmp_path / f"Enfilade Cube.{image_format}").exists() != packed
    uv, exact = lightmap(thing), light(shop.corners(thing)) * 0.8 / math.pi
    assert exact.min() > 1  # PNG can only say that this is white
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "baked.blend"))
    shop.bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "baked.blend"))
    image = shop.bpy.data.images["Enfilade Cube"]
    expected = exact if image_format == "exr" else np.ones_like(exact)
    assert lookup(image, uv)[:, :3] == pytest.approx(expected, rel=1e-5 if image_format == "exr" else 1e-4)
    assert image.colorspace_settings.name == ("Non-Color" if image_format == "exr" else "sRGB")
    clear(shop)
    assert "Enfilade Cube" not in shop.bpy.data.images


def test_png_holds_what_a_display_shows(shop):
    from enfilade.addon.bake_texture import write_image

    ramp = np.ones((4, 64, 4), np.float32)
    ramp[:, :, :3] = np.linspace(0, 1, 64)[None, :, None] ** 3
    image = write_image("Ramp", ramp, "png", "")
    assert image.colorspace_settings.name == "sRGB"
    # Blender gives float buffers as linear values.
    assert pixels(image)[0, :, 0] == pytest.approx(ramp[0, :, 0], abs=6e-5)  # 16 bit


def test_a_folder_that_is_not_there_is_refused(shop, tmp_path):
    shop.box((0, 0, 0), (1, 1, 1))
    with pytest.raises(SceneError, match="does not exist"):
        shop.bake(target="texture", image_folder=str(tmp_path / "none"))


def test_a_texture_that_does_not_fit_gets_coarser_with_a_warning(shop):
    shop.box((0, 0, 0), (4, 4, 4), "Large")
    _, baked, written = shop.bake(target="texture", texel_density=64.0, max_resolution=256)
    assert max(baked.pages[0].width, baked.pages[0].height) <= 256
    assert any("'Large' takes" in w and "256 x 256" in w for w in written.warnings)


# ------------------------------------------------------------------------------------------------------- materials


def render(shop, thing, tmp_path):
    """Mean colour of the middle of a picture of an object's top, taken by Cycles with no other light."""
    bpy = shop.bpy
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location = (*np.array(thing.location)[:2], 5.0)
    camera.data.lens = 5000.0
    scene.camera = camera
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 4, "CPU"
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.resolution_percentage = 100
    if hasattr(scene.render.image_settings, "media_type"):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    out = pixels(image)[2:6, 2:6, :3].mean((0, 1))
    bpy.data.images.remove(image)
    bpy.data.objects.remove(camera)
    return out


@pytest.mark.parametrize("target", ["vertex", "texture"])
@pytest.mark.parametrize("quantity", ["radiosity", "lighting"])
def test_materials_show_the_bake_and_go_again(shop, tmp_path, target, quantity):
    bpy = shop.bpy
    paint = shop.material("Paint", (0.5, 0.25, 0.125), 2.0, (0, 0, 1))
    table = shop.mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)], "Table", material=paint)
    bare = shop.mesh([(9, 0, 0), (10, 0, 0), (10, 1, 0)], [(0, 1, 2)], "Bare")
    linked = bpy.data.objects.new("Linked", shop.box((3, 0, 0), (4, 1, 1)).data)
    bpy.context.scene.collection.objects.link(linked)
    linked.data.materials.append(paint)
    linked.material_slots[0].link = "OBJECT"
    linked.material_slots[0].material = shop.material("Own")
    before = shop.state()
    shop.bake(material=True, target=target, quantity=quantity, texel_density=4.0)
    assert bare.material_slots[0].material.name == "No material (bake)"
    shown = render(shop, table, tmp_path)
    # Radiosity holds all of it; lighting is multiplied with the paint, and the lamp's own light is added.
    expected = light([0, 0, 0]) * [0.5, 0.25, 0.125] / math.pi + [0, 0, 2.0]
    assert shown == pytest.approx(expected, rel=2e-3)
    # Its own materials are no input: the same scene is read again.
    reading = shop.extract()
    assert reading.scene.emission[0] == pytest.approx([0, 0, 2 * math.pi])
    assert reading.scene.reflectance[0] == pytest.approx([0.5, 0.25, 0.125])
    clear(shop)
    after = shop.state()
    for state in (before, after):
        state["cameras"] = state["images"] = None
    assert after == before


def test_textured_paint_is_multiplied_with_lighting(shop, tmp_path):
    image = shop.bpy.data.images.new("Wood", 2, 2, float_buffer=True)
    image.pixels.foreach_set(np.tile(np.float32([0.2, 0.4, 0.6, 1.0]), 4))
    paint = shop.material("Wood")
    node = next(n for n in paint.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    texture = paint.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    paint.node_tree.links.new(texture.outputs[0], node.inputs["Base Color"])
    table = shop.mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)], "Table", material=paint)
    shop.bake(material=True, quantity="lighting")
    assert render(shop, table, tmp_path) == pytest.approx(light([0, 0, 0]) * [0.2, 0.4, 0.6] / math.pi, rel=2e-3)


@pytest.mark.parametrize(
    ("target", "asked", "expected"),
    [("vertex", "auto", "auto"), ("texture", "auto", "elements"), ("texture", "gathered", "gathered"), ("vertex", "elements", "elements")],
)
def test_textures_are_interpolated_unless_asked_otherwise(shop, target, asked, expected):
    shop.box((0, 0, 0), (1, 1, 1), "Crate")
    seen = []

    def asked_for(scene, options):
        seen.append(options.reflected)
        raise SceneError("far enough")
        yield

    with pytest.raises(SceneError, match="far enough"):
        shop.bake(options=Options(reflected=asked), solver=asked_for, target=target)
    assert seen == [expected]
