"""Materials read by their constant values."""

import math

import numpy as np
import pytest


@pytest.fixture
def nodes(shop):
    """A material with nothing but an output, and functions to build its nodes."""
    material = shop.material("Test")
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")

    class Nodes:
        def add(self, kind, to=None, **values):
            node = tree.nodes.new(kind)
            for name, value in values.items():
                node.inputs[name.replace("_", " ")].default_value = value
            if to is not None:
                tree.links.new(node.outputs[0], to)
            return node

        def read(self):
            from enfilade.addon.shading import read_material

            return read_material(material)

        surface = output.inputs["Surface"]
        link = staticmethod(tree.links.new)

    return Nodes()


def check(read, reflectance, emission, *words):
    surface, warnings = read
    assert surface.reflectance == pytest.approx(np.broadcast_to(reflectance, 3), rel=1e-6)
    assert surface.emission == pytest.approx(np.broadcast_to(emission, 3), rel=1e-6)
    assert len(warnings) == len(words), warnings
    for word in words:
        assert any(word in w and "'Test'" in w for w in warnings)


def test_no_material_is_blenders_grey(shop):
    from enfilade.addon.shading import read_material

    assert read_material(None)[0].reflectance == pytest.approx(0.8)


def test_diffuse_and_emission(nodes):
    nodes.add("ShaderNodeBsdfDiffuse", nodes.surface, Color=(0.1, 0.2, 0.3, 1))
    check(nodes.read(), (0.1, 0.2, 0.3), 0)
    nodes.add("ShaderNodeEmission", nodes.surface, Color=(1, 0.5, 0.25, 1), Strength=4)
    check(nodes.read(), 0, np.array([4, 2, 1]) * math.pi)


def test_principled(nodes):
    nodes.add("ShaderNodeBsdfPrincipled", nodes.surface, Base_Color=(0.8, 0.4, 0.2, 1), Metallic=0.25, Emission_Strength=0)
    check(nodes.read(), (0.6, 0.3, 0.15), 0)


def test_glass_is_opaque_with_a_warning(nodes):
    nodes.add("ShaderNodeBsdfPrincipled", nodes.surface, Base_Color=(0.8, 0.8, 0.8, 1), Transmission_Weight=0.5)
    check(nodes.read(), 0.4, 0, "taken as opaque")


def test_mixed_and_added_shaders(nodes):
    mix = nodes.add("ShaderNodeMixShader", None)
    mix.inputs[0].default_value = 0.25
    nodes.add("ShaderNodeBsdfDiffuse", mix.inputs[1], Color=(0.8, 0.8, 0.8, 1))
    nodes.add("ShaderNodeEmission", mix.inputs[2], Color=(1, 1, 1, 1), Strength=4)
    both = nodes.add("ShaderNodeAddShader", nodes.surface)
    nodes.link(mix.outputs[0], both.inputs[0])
    nodes.add("ShaderNodeEmission", both.inputs[1], Color=(1, 0, 0, 1), Strength=1)
    check(nodes.read(), 0.6, (2 * math.pi, math.pi, math.pi))


def test_other_shaders_are_black_with_a_warning(nodes):
    nodes.add("ShaderNodeBsdfGlass", nodes.surface)
    check(nodes.read(), 0, 0, "Glass")


def test_nothing_plugged_in_is_black(nodes):
    check(nodes.read(), 0, 0)


def test_values_come_through_reroutes_and_value_nodes(nodes):
    emission = nodes.add("ShaderNodeEmission", nodes.surface)
    reroute = nodes.add("NodeReroute", emission.inputs["Color"])
    rgb = nodes.add("ShaderNodeRGB", reroute.inputs[0])
    rgb.outputs[0].default_value = (0.5, 0.25, 1, 1)
    value = nodes.add("ShaderNodeValue", emission.inputs["Strength"])
    value.outputs[0].default_value = 2
    check(nodes.read(), 0, np.array([1, 0.5, 2]) * math.pi)


def test_what_cannot_be_read_is_named(nodes):
    diffuse = nodes.add("ShaderNodeBsdfDiffuse", nodes.surface, Color=(0.5, 0.5, 0.5, 1))
    nodes.add("ShaderNodeTexNoise", diffuse.inputs["Color"])
    check(nodes.read(), 0.5, 0, "'Color' that cannot be read")


@pytest.mark.parametrize(("floating", "cut_out", "mean"), [(False, False, 6 / 16), (False, True, 6 / 12), (True, False, 10 / 16)])
def test_a_texture_is_its_mean(nodes, shop, floating, cut_out, mean):
    """As in Cycles: bytes are multiplied with alpha, floats are taken to be so; where alpha is made use of, what is see-through is not."""
    image = shop.bpy.data.images.new("Checker", 4, 4, float_buffer=floating, alpha=True)
    pixels = np.zeros((16, 4), np.float32)
    pixels[::2, :3] = 1.0
    pixels[:, 3] = 1.0
    pixels[12:, 3] = 0.0
    pixels[12:, :3] = 1.0
    image.pixels.foreach_set(pixels.ravel())
    principled = nodes.add("ShaderNodeBsdfPrincipled", nodes.surface, Emission_Strength=0)
    texture = nodes.add("ShaderNodeTexImage", principled.inputs["Base Color"])
    texture.image = image
    if cut_out:
        nodes.link(texture.outputs["Alpha"], principled.inputs["Alpha"])
    check(nodes.read(), mean, 0, *(["'Alpha' that cannot be read"] if cut_out else []))


@pytest.mark.parametrize(("cut_out", "seen"), [(False, 0.033105), (True, 0.603827)])
def test_half_transparent_bytes_are_as_in_cycles(nodes, shop, cut_out, seen):
    """sRGB 0.8 with alpha 1/4: Cycles shows 0.0331, which is 0.2 made linear, and 0.60 where alpha is made use of."""
    image = shop.bpy.data.images.new("Veil", 2, 2, alpha=True)
    image.pixels.foreach_set(np.tile(np.float32([0.8, 0.8, 0.8, 0.25]), 4))
    principled = nodes.add("ShaderNodeBsdfPrincipled", nodes.surface, Emission_Strength=0)
    texture = nodes.add("ShaderNodeTexImage", principled.inputs["Base Color"])
    texture.image = image
    if cut_out:
        nodes.link(texture.outputs["Alpha"], principled.inputs["Alpha"])
    assert nodes.read()[0].reflectance == pytest.approx(seen, rel=0.01)


def test_a_texture_that_lies_on_no_uv_map_is_said_to_be_its_mean(nodes, shop):
    image = shop.bpy.data.images.new("Red", 2, 2)
    image.pixels.foreach_set(np.tile(np.float32([1, 0, 0, 1]), 4))
    diffuse = nodes.add("ShaderNodeBsdfDiffuse", nodes.surface)
    texture = nodes.add("ShaderNodeTexImage", diffuse.inputs["Color"])
    texture.image = image
    place = nodes.add("ShaderNodeTexCoord")
    nodes.link(place.outputs["Generated"], texture.inputs["Vector"])
    check(nodes.read(), (1, 0, 0), 0, "image 'Red' without a UV map")


def test_a_missing_image_is_named(nodes, shop):
    diffuse = nodes.add("ShaderNodeBsdfDiffuse", nodes.surface, Color=(0.3, 0.3, 0.3, 1))
    texture = nodes.add("ShaderNodeTexImage", diffuse.inputs["Color"])
    check(nodes.read(), 0.3, 0, "without image")
    image = texture.image = shop.bpy.data.images.new("Gone", 2, 2)
    image.source, image.filepath = "FILE", "//nothing.png"
    image.reload()
    check(nodes.read(), 0.3, 0, "the image 'Gone'")


def test_byte_textures_are_made_linear(nodes, shop):
    image = shop.bpy.data.images.new("Grey", 2, 2)
    image.pixels.foreach_set(np.tile(np.float32([0.5, 0.5, 0.5, 1.0]), 4))
    diffuse = nodes.add("ShaderNodeBsdfDiffuse", nodes.surface)
    nodes.add("ShaderNodeTexImage", diffuse.inputs["Color"]).image = image
    surface, _ = nodes.read()
    assert surface.reflectance == pytest.approx(0.214, abs=0.002)


def test_more_than_white_is_limited(nodes):
    nodes.add("ShaderNodeBsdfDiffuse", nodes.surface, Color=(1.5, 0.5, 0.5, 1))
    check(nodes.read(), (1, 0.5, 0.5), 0, "limited")


def test_exitance_is_that_of_blenders_own_renderer(shop):
    """An emission of strength 1 above a small white patch: Cycles stores E/pi of what the exitance pi gives."""
    bpy = shop.bpy
    lamp = shop.mesh([(-1, -1, 1), (-1, 1, 1), (1, 1, 1), (1, -1, 1)], [(0, 1, 2, 3)], "Lamp", material=shop.material("L", (0, 0, 0), 1.0))
    patch = shop.mesh([(-0.01, -0.01, 0), (0.01, -0.01, 0), (0.01, 0.01, 0), (-0.01, 0.01, 0)], [(0, 1, 2, 3)], "Patch")
    patch.data.materials.append(shop.material("P", (1, 1, 1)))
    patch.data.color_attributes.new(name="Light", type="FLOAT_COLOR", domain="CORNER")
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device, scene.cycles.seed = "CYCLES", 256, "CPU", 1
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = patch
    patch.select_set(True)
    lamp.select_set(False)
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT"}, target="VERTEX_COLORS")
    # A square of half width 1 at distance 1, seen from below its middle (Lambert): four corner squares.
    a = 1 / math.sqrt(2)
    form_factor = 4 / (2 * math.pi) * (a * math.atan(a) * 2)
    from enfilade.addon.shading import read_material

    exitance = read_material(lamp.data.materials[0])[0].emission
    assert shop.colors(patch, "Light")[:, :3].mean(0) * math.pi == pytest.approx(exitance * form_factor, rel=0.02)
