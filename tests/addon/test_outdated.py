"""A bake knows whether it is still that of its scene; rooms baked anew leave all others as they are."""

import numpy as np
import pytest


@pytest.fixture
def baked(shop):
    made = shop.two_rooms()
    shop.bake()
    return made


def stale(shop):
    from enfilade.addon.outdated import look

    shop.bpy.context.view_layer.update()
    return look(shop.bpy.context.scene, shop.bpy.context.view_layer)


@pytest.mark.parametrize(
    "bake", [{}, {"material": True}, {"target": "texture", "texel_density": 2.0, "material": True}, {"subdivide": 1.0}, {"domain": "point"}]
)
def test_what_a_bake_itself_changes_does_not_count(shop, bake, tmp_path):
    from enfilade.addon.properties import write_options
    from enfilade.core.options import BakeOptions

    bpy = shop.bpy
    made = shop.two_rooms()
    linked = bpy.data.objects.new("Linked", made["Lamp"].data)
    bpy.data.collections["East"].objects.link(linked)
    linked.location.x = 4.0
    made["East"].hide_viewport = True
    write_options(bpy.context.scene.enfilade.bake, BakeOptions(**bake))
    assert not stale(shop)  # there is no bake
    shop.bake(**bake)
    assert not stale(shop)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert not stale(shop)
    bpy.data.objects["Lamp"].location.z -= 0.1
    assert stale(shop)


def change_material(shop, made):
    node = next(n for n in shop.bpy.data.materials["East paint"].node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    node.inputs["Base Color"].default_value[1] += 0.1


def add_lamp(shop, made):
    lamp = shop.bpy.data.objects.new("Bulb", shop.bpy.data.lights.new("Bulb", "POINT"))
    shop.bpy.data.collections["East"].objects.link(lamp)


CHANGES = {
    "moved": lambda shop, made: setattr(made["West"], "location", (0, 0, 0.01)),
    "a vertex": lambda shop, made: setattr(made["West"].data.vertices[0], "co", (-0.1, 0, 0)),
    "paint": change_material,
    "another material": lambda shop, made: made["West"].data.materials.__setitem__(0, shop.material("New")),
    "a lamp": add_lamp,
    "gone": lambda shop, made: shop.bpy.data.objects.remove(made["Lamp"]),
    "portal": lambda shop, made: setattr(made["Door"].data.vertices[0], "co", (4.1, 1.1, 0)),
    "another room": lambda shop, made: (
        shop.bpy.data.collections["West"].objects.unlink(made["Lamp"]),
        shop.bpy.data.collections["East"].objects.link(made["Lamp"]),
    ),
    "not rendered": lambda shop, made: setattr(made["Lamp"], "hide_render", True),
    "modifier": lambda shop, made: made["Lamp"].modifiers.new("Thick", "SOLIDIFY"),
    "quality": lambda shop, made: setattr(shop.bpy.context.scene.enfilade.solve, "quality", "fine"),
    "unit": lambda shop, made: setattr(shop.bpy.context.scene.unit_settings, "scale_length", 0.5),
    "role": lambda shop, made: setattr(shop.bpy.data.collections["East"].enfilade, "role", "IGNORED"),
    "texel scale": lambda shop, made: setattr(made["Lamp"].enfilade, "texel_scale", 0.5),
    "left out": lambda shop, made: setattr(made["Lamp"].enfilade, "left_out", True),
    "flipped": lambda shop, made: made["West"].data.flip_normals(),
    "parent": lambda shop, made: (
        setattr(made["Lamp"], "parent", shop.bpy.data.objects.new("Hook", None)),
        setattr(made["Lamp"].parent, "location", (0, 0, -0.2)),
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_changes_of_the_scene_count(shop, baked, change):
    assert not stale(shop)
    CHANGES[change](shop, baked)
    assert stale(shop), change
    shop.bpy.ops.enfilade.clear()
    assert not stale(shop)


def test_where_an_image_lies_counts_where_there_is_one(shop, baked):
    from enfilade.addon.properties import write_options
    from enfilade.core.options import BakeOptions

    bpy, bake = shop.bpy, {"target": "texture", "texel_density": 2.0, "material": True}
    write_options(bpy.context.scene.enfilade.bake, BakeOptions(**bake))
    mesh = baked["Lamp"].data
    mesh.uv_layers.new(name="Map")
    material = mesh.materials[0]
    shop.bake(**bake)
    assert not stale(shop)
    mesh.uv_layers["Map"].uv[0].vector = (0.3, 0.4)
    assert not stale(shop)  # nothing lies on it
    material.node_tree.nodes.new("ShaderNodeTexImage").image = bpy.data.images.new("Picture", 4, 4)
    shop.bake(**bake)
    assert not stale(shop)
    mesh.uv_layers["Map"].uv[0].vector = (0.5, 0.4)
    assert stale(shop)


@pytest.mark.parametrize("kind", ["POINT", "SUN", "AREA", "SPOT"])
def test_lamps_and_sky_count(shop, kind):
    bpy = shop.bpy
    shop.two_rooms()
    lamp = bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", kind))
    bpy.data.collections["West"].objects.link(lamp)
    world = bpy.context.scene.world = bpy.data.worlds.new("Sky")
    if world.node_tree is None:
        world.use_nodes = True
    shop.bake()
    assert not stale(shop)
    strength = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND").inputs["Strength"]
    for target, key, value in ((lamp.data, "energy", 55.0), (lamp.data, "color", (1, 0, 0)), (strength, "default_value", 3.0)):
        old = getattr(target, key)
        old = tuple(old) if key == "color" else old
        setattr(target, key, value)
        assert stale(shop), key
        setattr(target, key, old)
        assert not stale(shop), key
    lamp.rotation_euler.x = 0.5
    assert stale(shop)


def test_what_changes_no_light_does_not_count(shop, baked):
    bpy = shop.bpy
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    baked["West"].select_set(True)
    bpy.context.view_layer.objects.active = baked["West"]
    baked["West"].hide_set(True)
    baked["West"].color = (1, 0, 0, 1)
    baked["West"].data.uv_layers.new(name="Mine")
    bpy.context.scene.enfilade.solve.threads = 3
    node = bpy.data.materials["East paint"].node_tree.nodes[0]
    node.location.x += 100
    bpy.context.scene.frame_set(7)
    assert not stale(shop)
    baked["Lamp"].location.z -= 0.1
    assert stale(shop)
    baked["Lamp"].location.z = 0.0
    assert not stale(shop)


def test_a_change_during_the_bake_counts(shop):
    from enfilade.addon import job
    from enfilade.core.options import BakeOptions, Options

    made = shop.two_rooms()
    reading = job.read(shop.bpy.context, Options(quality="draft"), BakeOptions())
    shop.bpy.context.scene.enfilade.solve.quality = "draft"
    baked = job.solve_all(reading)
    made["Lamp"].location.z -= 0.1
    job.write(shop.bpy.context, reading, baked)
    assert stale(shop)


def test_the_window_is_told_bit_by_bit(shop, baked, monkeypatch):
    """What the timer does, called here as Blender would call it."""
    from enfilade.addon import outdated

    scene = shop.bpy.context.scene
    monkeypatch.setattr(outdated, "SLICE", 0.0)

    def look_on():
        count = 0
        while outdated._look_on() is not None:
            count += 1
        return count

    assert look_on() > 3
    assert not outdated.outdated(scene)
    baked["Lamp"].location.z -= 0.1
    look_on()
    assert outdated.outdated(scene)
    baked["Lamp"].location.z = 0.0
    # A change in the middle starts anew.
    outdated._look_on()
    outdated._after_change(scene, shop.bpy.context.evaluated_depsgraph_get())
    look_on()
    assert not outdated.outdated(scene)


# ------------------------------------------------------------------------------------------------- some rooms anew


def all_colors(shop):
    return {o.name: shop.colors(o) for o in shop.bpy.data.objects if o.type == "MESH" and o.data.enfilade.attribute}


@pytest.mark.parametrize("subdivide", [0.0, 1.0])
def test_one_room_is_baked_anew_and_lit_by_all(shop, subdivide):
    bpy = shop.bpy
    made = shop.two_rooms()
    settings = bpy.context.scene.enfilade
    settings.solve.quality, settings.bake.subdivide = "draft", subdivide
    bpy.ops.enfilade.bake()
    before = all_colors(shop)
    made["Lamp"].location.z -= 0.5
    node = next(n for n in bpy.data.materials["Lamp"].node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    node.inputs["Emission Strength"].default_value = 30.0
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing.name in ("East walls", "East walls (bake)"))
    assert bpy.ops.enfilade.bake(scope="SELECTED") == {"FINISHED"}
    partly = all_colors(shop)
    assert set(partly) == set(before)
    assert stale(shop)  # the other room is as old as it was
    bpy.ops.enfilade.bake()
    whole = all_colors(shop)
    assert not stale(shop)
    for name in before:
        assert np.array_equal(partly[name], (whole if name.startswith("East") else before)[name]), name
    assert partly["East walls (bake)" if subdivide else "East walls"].mean() > 0
    bpy.ops.enfilade.clear()
    assert all_colors(shop) == {}


@pytest.mark.parametrize("atlas", ["object", "room"])
@pytest.mark.parametrize("material", [False, True])
def test_textures_of_one_room_are_baked_anew(shop, atlas, material):
    from enfilade.addon import job
    from enfilade.core.options import BakeOptions, Options

    shop.two_rooms()
    bake = {"target": "texture", "texel_density": 4.0, "atlas": atlas, "material": material}
    shop.bake(**bake)
    names = {i.name for i in shop.bpy.data.images}
    before = {i.name: shop.pixels(i) for i in shop.bpy.data.images}

    class Brighter:
        report = {}

        def irradiance(self, points, polygon):
            return 2 * shop.light(points)

    def known(scene, options):
        yield job.Step("solve", 0.5, "")
        return Brighter()

    reading = job.read(shop.bpy.context, Options(), BakeOptions(**bake), ("East",))
    assert {r.name for r in reading.receivers} == {"East walls", "East door wall"}
    job.write(shop.bpy.context, reading, job.solve_all(reading, None, known))
    assert {i.name for i in shop.bpy.data.images} == names
    for image in shop.bpy.data.images:
        factor = 2 if "East" in image.name else 1
        assert shop.pixels(image)[..., :3] == pytest.approx(factor * before[image.name][..., :3], rel=1e-5)
    for thing in shop.bpy.data.objects:
        if thing.type == "MESH" and thing.name != "Door":
            assert thing.data.enfilade.image.name in names
            assert [layer.name for layer in thing.data.uv_layers] == ["Enfilade UV"]
    shop.bpy.ops.enfilade.clear()
    assert len(shop.bpy.data.images) == 0


def test_what_cannot_be_baked_anew_is_a_sentence(shop, baked):
    bpy = shop.bpy
    for thing in bpy.context.view_layer.objects:
        thing.select_set(False)
    with pytest.raises(RuntimeError, match="o selected object is in a room"):
        bpy.ops.enfilade.bake(scope="SELECTED")
    from enfilade.addon import job
    from enfilade.core.options import BakeOptions, Options
    from enfilade.core.scene import SceneError

    with pytest.raises(SceneError, match="no room 'Attic' to bake: the rooms are West, East"):
        job.read(bpy.context, Options(), BakeOptions(), ["Attic"])
