"""Images on meshes: what each polygon of a scene emits and reflects."""

import math

import numpy as np
import pytest

STRENGTH = 5.0


class Screens:
    """Quads in the plane z = 2 that shine downward, side by side along x, each 1 m wide."""

    def __init__(self, shop):
        self.shop, self.bpy = shop, shop.bpy

    def image(self, pixels, name="Picture"):
        """From (H, W) or (H, W, 3) linear values, row 0 at the bottom."""
        pixels = np.asarray(pixels, np.float32)
        height, width = pixels.shape[:2]
        color = np.ones((height, width, 4), np.float32)
        color[:, :, :3] = pixels if pixels.ndim == 3 else pixels[:, :, None]
        made = self.bpy.data.images.new(name, width, height, float_buffer=True)
        made.pixels.foreach_set(color.ravel())
        made.update()
        return made

    def material(self, image, into="Emission Color", interpolation="Closest", extension="REPEAT"):
        made = self.shop.material("Screen", (0.2, 0.2, 0.2), STRENGTH if into == "Emission Color" else 0.0)
        tree = made.node_tree
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image, node.interpolation, node.extension = image, interpolation, extension
        principled = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
        tree.links.new(node.outputs["Color"], principled.inputs[into])
        return made, node

    def quads(self, uv, material):
        """Quads with their own coordinates (n, 4, 2); corners go around from (x, 0) to (x, 1)."""
        uv = np.asarray(uv, float)
        count = len(uv)
        vertices = [(x, y, 2.0) for x in range(count + 1) for y in (0, 1)]
        thing = self.shop.mesh(vertices, [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(count)], "Screen", material=material)
        self.lay(thing, uv, "Map")
        return thing

    @staticmethod
    def lay(thing, uv, name):
        layer = thing.data.uv_layers.new(name=name)
        layer.uv.foreach_set("vector", np.asarray(uv, np.float32).ravel())
        return layer

    def emission(self):
        """(P, 3), as parts of the radiance of a white pixel."""
        return self.shop.extract().scene.emission / (math.pi * STRENGTH)


@pytest.fixture
def screens(shop):
    return Screens(shop)


def part(low, high):
    """Coordinates of a quad that shows the columns from ``low`` to ``high``: its corners (x, 0), (x, 1), (x + 1, 1), (x + 1, 0)."""
    return [(low, 0), (low, 1), (high, 1), (high, 0)]


HALVES = np.repeat([[0.0, 1.0]], 4, axis=0).repeat(2, axis=1)


def test_each_face_emits_the_mean_of_what_it_shows(screens):
    material, _ = screens.material(screens.image(HALVES))
    screens.quads([part(0, 0.5), part(0.5, 1), part(0.25, 0.75)], material)
    assert screens.emission().sum(axis=0)[0] == pytest.approx(1.5, rel=1e-6)


def test_a_dark_and_a_bright_half(screens):
    material, _ = screens.material(screens.image(HALVES))
    screens.quads([part(0, 0.5), part(0.5, 1)], material)
    found = screens.shop.extract()
    assert found.scene.emission == pytest.approx(math.pi * STRENGTH * np.array([[0.0] * 3, [1.0] * 3]), rel=1e-6, abs=1e-9)
    assert found.warnings == ()


def test_the_map_that_a_node_names_counts_else_the_one_for_renders(screens):
    material, node = screens.material(screens.image(HALVES))
    thing = screens.quads([part(0, 0.5)], material)
    screens.lay(thing, [part(0.5, 1)], "Other")
    thing.data.uv_layers["Map"].active_render = True
    thing.data.uv_layers.active = thing.data.uv_layers["Other"]
    assert screens.emission() == pytest.approx(0.0, abs=1e-9)
    thing.data.uv_layers["Other"].active_render = True
    assert screens.emission() == pytest.approx(1.0)
    tree = material.node_tree
    place = tree.nodes.new("ShaderNodeUVMap")
    place.uv_map = "Map"
    tree.links.new(place.outputs[0], node.inputs["Vector"])
    assert screens.emission() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("POINT", {"Location": (0.5, 0, 0)}, 0.5625),  # columns 1/2 to 1
        ("POINT", {"Scale": (0.5, 1, 1), "Location": (0.25, 0, 0)}, 0.25),  # columns 1/4 to 1/2
        ("TEXTURE", {"Location": (-0.5, 0, 0)}, 0.5625),
        ("TEXTURE", {"Scale": (2, 1, 1), "Location": (-0.5, 0, 0)}, 0.25),  # (x + 1/2) / 2
        ("VECTOR", {"Scale": (0.5, 1, 1)}, 0.0),  # columns 0 to 1/4
        ("POINT", {"Rotation": (0, 0, math.pi / 2)}, 0.34375),  # (-y, x): all columns
        ("TEXTURE", {"Rotation": (0, 0, -math.pi / 2)}, 0.34375),
    ],
)
def test_a_mapping_node_moves_the_image(screens, kind, values, expected):
    material, node = screens.material(screens.image([[0.0, 0.25, 0.125, 1.0]]))
    tree = material.node_tree
    mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.vector_type = kind
    for name, value in values.items():
        mapping.inputs[name].default_value = value
    tree.links.new(place.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], node.inputs["Vector"])
    screens.quads([part(0, 0.5)], material)
    assert screens.emission() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("extension", "expected"), [("REPEAT", 0.5), ("MIRROR", 0.5), ("EXTEND", 1.0), ("CLIP", 0.0)])
def test_beyond_its_border_an_image_goes_on_as_the_node_says(screens, extension, expected):
    material, _ = screens.material(screens.image(HALVES), extension=extension)
    screens.quads([part(3, 4)], material)
    assert screens.emission() == pytest.approx(expected, abs=1e-9)


def test_a_face_shows_colours(screens):
    pixels = np.zeros((2, 2, 3))
    pixels[0, 0], pixels[0, 1], pixels[1, 0], pixels[1, 1] = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)
    material, _ = screens.material(screens.image(pixels))
    screens.quads([part(0, 0.5)], material)
    assert screens.emission().mean(0) == pytest.approx([0.5, 0.0, 0.5], abs=1e-9)


def test_a_fine_mesh_does_not_become_as_many_lamps(screens):
    """A screen of 40 x 40 faces and one of even light: about as many surfaces as cells, and one; not a watt less."""
    n = 40
    corner = lambda x, y: x * (n + 1) + y  # noqa: E731
    faces = [(corner(x, y), corner(x, y + 1), corner(x + 1, y + 1), corner(x + 1, y)) for x in range(n) for y in range(n)]
    vertices = [(x / n, y / n, 2.0) for x in range(n + 1) for y in range(n + 1)]
    pixels = np.random.default_rng(0).random((n, n))
    for picture, most in ((pixels, 100), (0.5 + 0.001 * pixels, 1)):
        material, _ = screens.material(screens.image(picture))
        thing = screens.shop.mesh(vertices, faces, "Fine", material=material)
        screens.lay(thing, [vertices[k][:2] for face in faces for k in face], "Map")
        found = screens.emission()[:, 0]
        assert len(np.unique(found)) <= most
        assert found.mean() == pytest.approx(picture.mean(), rel=1e-6)
        screens.bpy.data.objects.remove(thing)


def test_reflectance_differs_where_large_faces_do(screens):
    material, _ = screens.material(screens.image(HALVES * 0.5), into="Base Color")
    screens.quads([part(0, 0.5), part(0.5, 1), part(0.49, 0.99)], material)
    found = screens.shop.extract().scene.reflectance[:, 0]
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    assert found[1] == found[2] == pytest.approx(0.495)  # alike enough to be one surface


def test_a_mesh_without_the_map_takes_the_mean(screens):
    material, _ = screens.material(screens.image(HALVES))
    thing = screens.quads([part(0, 0.5)], material)
    thing.data.uv_layers.remove(thing.data.uv_layers[0])
    assert screens.emission() == pytest.approx(0.5)
