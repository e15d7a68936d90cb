"""Blender's lamps and world: their light in watts, their shapes and rooms, and what cannot be read."""

import math

import numpy as np
import pytest
from enfilade.core.scene import SceneError

IES = "IESNA:LM-63-1995\nTILT=NONE\n1 1000 2 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n"


def hang(shop, kind, energy=100.0, at=(0.5, 0.5, 0.5), rotation=(0, 0, 0), scale=(1, 1, 1), name="Bulb", collection=None, **more):
    light = shop.bpy.data.lights.new(name, kind)
    light.energy = energy
    for key, value in more.items():
        setattr(light, key, value)
    thing = shop.bpy.data.objects.new(name, light)
    thing.location, thing.rotation_euler, thing.scale = at, rotation, scale
    (collection or shop.bpy.context.scene.collection).objects.link(thing)
    return thing


def world(shop, color=(0, 0, 0), strength=1.0):
    made = shop.bpy.data.worlds.new("Sky")
    if made.node_tree is None:
        made.use_nodes = True
    shop.bpy.context.scene.world = made
    node = next(n for n in made.node_tree.nodes if n.type == "BACKGROUND")
    node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*color, 1), strength
    return made, node


def lamps_of(shop):
    shop.box((0, 0, 0), (1, 1, 1))
    found = shop.extract()
    assert not [w for w in found.warnings if "Bulb" in w or "world" in w]
    return found.scene.lamps


def area_of(outline):
    local = outline - outline[0]
    return 0.5 * np.cross(local, np.roll(local, -1, 0)).sum(0)


@pytest.mark.parametrize(("shape", "area"), [("SQUARE", 0.16), ("RECTANGLE", 0.32), ("DISK", 0.04 * math.pi), ("ELLIPSE", 0.08 * math.pi)])
@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 0.5, 3), (-1, 1, 1)])
def test_area_lamps_have_their_shape_and_power(shop, shape, area, scale):
    hang(shop, "AREA", 50, rotation=(0, math.pi / 2, 0), scale=scale, shape=shape, size=0.4, size_y=0.8, color=(1, 0.5, 0.25))
    lamps = lamps_of(shop).area
    vector = area_of(lamps.vertices)
    expected = area * abs(scale[0] * scale[1])
    # It shines along its -z, which is turned to -x.
    np.testing.assert_allclose(vector, [-expected, 0, 0], atol=2e-5 * expected)
    np.testing.assert_allclose(lamps.exitance, [[50 / expected * c for c in (1, 0.5, 0.25)]], rtol=1e-5)
    assert lamps.spread[0] == pytest.approx(math.pi)


def test_points_and_spots(shop):
    hang(shop, "POINT", 40, (0.25, 0.5, 0.75), shadow_soft_size=0.1, use_soft_falloff=False)
    hang(shop, "SPOT", 80, rotation=(math.pi / 2, 0, 0), name="Spot", spot_size=1.0, spot_blend=0.25, shadow_soft_size=0)
    points = lamps_of(shop).points
    assert points.names == ("Bulb", "Spot")
    np.testing.assert_allclose(points.position[0], [0.25, 0.5, 0.75])
    np.testing.assert_allclose(points.intensity, np.repeat([[10 / math.pi], [20 / math.pi]], 3, 1), rtol=1e-6)
    assert points.radius == pytest.approx([0.1, 0])
    assert points.ball.tolist() == [True, False]
    assert points.cone == pytest.approx([math.pi, 0.5])
    assert points.blend[1] == pytest.approx(0.25)
    # The spot looks along +y: that is -z of its frame.
    np.testing.assert_allclose(points.frame[1] @ [0, 1, 0], [0, 0, -1], atol=1e-6)


def test_suns_shine_along_their_axis(shop):
    hang(shop, "SUN", 3, rotation=(0, math.pi / 2, 0), angle=0.02)
    suns = lamps_of(shop).suns
    np.testing.assert_allclose(suns.toward, [[1, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(suns.irradiance, [[3, 3, 3]])
    assert suns.angle == pytest.approx([0.02])


def test_units_of_length_change_the_scene_but_not_the_picture(shop):
    shop.bpy.context.scene.unit_settings.scale_length = 0.1
    hang(shop, "POINT", 40, (5, 5, 5))
    hang(shop, "AREA", 40, (5, 5, 5), name="Panel", size=2.0)
    shop.box((0, 0, 0), (10, 10, 10))
    lamps = shop.extract().scene.lamps
    np.testing.assert_allclose(lamps.points.position, [[0.5, 0.5, 0.5]])
    # Irradiance at a tenth of the distance, in metres, from a hundredth of the intensity.
    np.testing.assert_allclose(lamps.points.intensity, 0.1 / math.pi, rtol=1e-6)
    np.testing.assert_allclose(lamps.area.exitance, 10.0, rtol=1e-6)
    assert np.linalg.norm(area_of(lamps.area.vertices)) == pytest.approx(0.04)


def test_nodes_and_colours(shop):
    thing = hang(shop, "POINT", 40, color=(1, 0.5, 0.5))
    thing.data.use_nodes = True
    node = next(n for n in thing.data.node_tree.nodes if n.type == "EMISSION")
    node.inputs["Strength"].default_value, node.inputs["Color"].default_value = 2.0, (0.5, 1, 1, 1)
    np.testing.assert_allclose(lamps_of(shop).points.intensity, [[10 / math.pi] * 3], rtol=1e-6)


def test_temperature_exposure_and_no_normalization(shop):
    light = shop.bpy.types.PointLight.bl_rna.properties
    if "exposure" not in light:
        pytest.skip("this Blender has neither")
    warm = hang(shop, "POINT", 40, use_temperature=True, temperature=3000, exposure=1, shadow_soft_size=0)
    hang(shop, "AREA", 40, name="Panel", size=2.0, normalize=False)
    hang(shop, "SUN", 40, name="Sun", angle=1.0, normalize=False)
    lamps = lamps_of(shop)
    np.testing.assert_allclose(lamps.points.intensity[0], 20 / math.pi * np.array(warm.data.temperature_color[:]), rtol=1e-5)
    np.testing.assert_allclose(lamps.area.exitance, 40.0)
    np.testing.assert_allclose(lamps.suns.irradiance, 40 * math.pi * math.sin(0.5) ** 2, rtol=1e-6)


def photometric(shop, text=IES, external=""):
    thing = hang(shop, "POINT", 1)
    thing.data.use_nodes = True
    tree = thing.data.node_tree
    node = tree.nodes.new("ShaderNodeTexIES")
    if external:
        node.mode, node.filepath = "EXTERNAL", external
    else:
        node.mode, node.ies = "INTERNAL", shop.bpy.data.texts.new("lamp.ies")
        node.ies.write(text)
    node.inputs["Strength"].default_value = 1.0
    tree.links.new(node.outputs[0], next(n for n in tree.nodes if n.type == "EMISSION").inputs["Strength"])


def test_a_photometric_file_makes_a_distribution(shop):
    photometric(shop)
    points = lamps_of(shop).points
    down = points.distributions[points.distribution[0]].intensity(np.array([(0, 0, -1), (1, 0, -1), (0, 0, 1.0)]))
    np.testing.assert_allclose(down, [200, 100, 0])
    np.testing.assert_allclose(points.intensity, 1 / 177.83)


MALFORMED = [(IES[:60], "more than the file can hold"), (IES.replace("100 50", "100 x"), "no number"), ("nothing", "TILT")]


@pytest.mark.parametrize(("text", "said"), MALFORMED)
def test_a_malformed_photometric_file_is_named(shop, text, said):
    photometric(shop, text)
    shop.box((0, 0, 0), (1, 1, 1))
    with pytest.raises(SceneError, match=f"(?s)'Bulb'.*'lamp.ies'.*{said}"):
        shop.extract()


def test_a_missing_photometric_file_is_named(shop, tmp_path):
    photometric(shop, external=str(tmp_path / "gone.ies"))
    shop.box((0, 0, 0), (1, 1, 1))
    with pytest.raises(SceneError, match=r"'Bulb'.*gone\.ies.*no such file"):
        shop.extract()


def test_hidden_lamps_and_portals_of_cycles_are_no_lamps(shop):
    hang(shop, "POINT").hide_render = True
    hang(shop, "AREA", name="Help").data.cycles.is_portal = True
    hang(shop, "POINT", 0, name="Off")
    lamps = lamps_of(shop)
    assert not lamps.any


def test_lamps_hang_in_the_rooms_around_them(shop):
    shop.two_rooms()
    hang(shop, "POINT", at=(1.0, 1, 1))
    hang(shop, "SPOT", at=(6.0, 1, 1), name="Spot")
    hang(shop, "AREA", at=(1.0, 1, 50), name="Lost")
    found = shop.extract()
    names = found.scene.room_names
    assert [names[r] for r in found.scene.lamps.points.room] == [names[0], names[1]]
    assert found.scene.lamps.area.room.tolist() == [-1]
    assert len([w for w in found.warnings if "'Lost' stands in no room" in w]) == 1


def test_instances_of_lamps_shine_too(shop):
    group = shop.bpy.data.collections.new("Fitting")
    hang(shop, "POINT", at=(0, 0, 0.5), collection=group)
    empty = shop.bpy.data.objects.new("Here", None)
    empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", group, (0.5, 0.5, 0)
    shop.bpy.context.scene.collection.objects.link(empty)
    shop.box((0, 0, 0), (1, 1, 1))
    points = shop.extract().scene.lamps.points
    assert points.names == ("Bulb in Here",)
    np.testing.assert_allclose(points.position, [[0.5, 0.5, 0.5]])


def test_portals_have_their_glass(shop):
    things = shop.two_rooms()
    assert shop.extract().scene.portals.transmittance is None
    portals = [thing for name, thing in things.items() if thing.users_collection[0].name == "Portals"]
    portals[0].enfilade.transmittance = 0.8
    assert 0.8 in shop.extract().scene.portals.transmittance.tolist()


# ---------------------------------------------------------------------------------------------------------- world


def test_the_colour_of_the_world_is_a_sky(shop):
    world(shop, (0.5, 0.25, 1), 2.0)
    np.testing.assert_allclose(lamps_of(shop).sky.radiance, [[[1, 0.5, 2]]])


def test_a_black_world_is_no_sky(shop):
    world(shop)
    assert lamps_of(shop).sky is None


def environment(shop, image):
    made, node = world(shop, strength=2.0)
    texture = made.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    made.node_tree.links.new(texture.outputs[0], node.inputs["Color"])
    return made, texture


def picture(shop, pixels):
    height, width = pixels.shape[:2]
    image = shop.bpy.data.images.new("sky", width, height, float_buffer=True)
    image.pixels.foreach_set(np.concatenate([pixels, np.ones((height, width, 1))], 2).astype(np.float32).ravel())
    return image


def test_an_environment_image_is_a_sky_and_its_bright_place_a_sun(shop):
    pixels = np.ones((64, 128, 3))
    pixels[40, 96] = 5000  # a quarter turn before its end: -y, above the horizon
    environment(shop, picture(shop, pixels))
    lamps = lamps_of(shop)
    assert len(lamps.suns) == 1
    tilt = math.pi * (40.5 / 64 - 0.5)
    np.testing.assert_allclose(lamps.suns.toward[0], [-0.0245 * math.cos(tilt), -math.cos(tilt), math.sin(tilt)], atol=2e-3)
    solid = 2 * math.pi / 128 * (math.sin(math.pi * (41 / 64 - 0.5)) - math.sin(math.pi * (40 / 64 - 0.5)))
    # What the sun has and what its place in the sky has are the light of the texel.
    rest = lamps.sky.radiance.max()
    assert lamps.suns.irradiance[0, 0] / solid + rest == pytest.approx(10000, rel=0.01)
    assert np.median(lamps.sky.radiance) == pytest.approx(2.0)


def test_the_image_turns_with_its_mapping(shop):
    pixels = np.zeros((32, 64, 3))
    pixels[:, 30:34] = 1  # towards +x
    made, texture = environment(shop, picture(shop, pixels))
    mapping, coordinates = (made.node_tree.nodes.new(n) for n in ("ShaderNodeMapping", "ShaderNodeTexCoord"))
    made.node_tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    made.node_tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    mapping.inputs["Rotation"].default_value = (0, 0, math.pi / 2)
    # A direction d is looked up a quarter turn further: what the image has at +x is seen at -y.
    row = lamps_of(shop).sky.radiance[16, :, 0]
    assert abs(int(row.argmax()) - 48) <= 2
    assert row.sum() == pytest.approx(2 * 4, rel=0.1)


def test_a_missing_image_is_named(shop):
    environment(shop, None)
    shop.box((0, 0, 0), (1, 1, 1))
    found = shop.extract()
    assert found.scene.lamps.sky is None
    assert len([w for w in found.warnings if "'Sky' is missing" in w or "world 'Sky' is missing" in w]) == 1


def test_other_nodes_are_named(shop):
    made, node = world(shop, (1, 1, 1))
    made.node_tree.links.new(made.node_tree.nodes.new("ShaderNodeTexSky").outputs[0], node.inputs["Color"])
    shop.box((0, 0, 0), (1, 1, 1))
    assert any("Sky Texture" in w and "'Sky'" in w for w in shop.extract().warnings)


@pytest.mark.parametrize("case", ["area rectangle, turned and scaled", "spot with nodes", "sun without normalization"])
def test_cycles_says_the_same(shop, case):
    from enfilade.docs.measure_lights import cases, compare

    if case not in cases():
        pytest.skip("this Blender has no such lamp")
    result = compare(cases()[case], 64, "draft")
    # At draft the reflected light is within a few per cent; a wrong unit or a wrong place is off by far more.
    assert abs(result["difference"]) < 0.02
