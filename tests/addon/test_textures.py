"""Images on meshes: what each polygon of a scene emits and reflects."""

import math

import numpy as np
import pytest
from enfilade.core.corners import face_area_vectors

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
    scene = screens.shop.extract().scene
    area = np.linalg.norm(face_area_vectors(scene.vertices, scene.corner_vertex, scene.loop_start), axis=1)
    middle = np.array([scene.vertices[c].mean(0)[0] for c in np.split(scene.corner_vertex, scene.loop_start[1:-1])])
    power = [(area * scene.emission[:, 0])[np.floor(middle) == k].sum() / (math.pi * STRENGTH) for k in range(3)]
    assert power == pytest.approx([0.0, 1.0, 0.5], abs=1e-6)


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
    assert screens.emission().mean() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("extension", "expected"), [("REPEAT", 0.5), ("MIRROR", 0.5), ("EXTEND", 1.0), ("CLIP", 0.0)])
def test_beyond_its_border_an_image_goes_on_as_the_node_says(screens, extension, expected):
    material, _ = screens.material(screens.image(HALVES), extension=extension)
    screens.quads([part(3, 4)], material)
    assert screens.emission().mean() == pytest.approx(expected, abs=1e-9)


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


def gradient(n=64):
    """Dark at the left, bright at the right."""
    return np.tile((np.arange(n) + 0.5) / n, (n, 1))


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_uneven_screen_is_cut_into_cells(screens, mirrored):
    """Every cell has the mean of what it shows, at its place, with the front where it was."""
    material, _ = screens.material(screens.image(gradient()), interpolation="Linear", extension="EXTEND")
    thing = screens.quads([part(0, 1)], material)
    thing.scale.y = -1 if mirrored else 1
    scene = screens.shop.extract().scene
    assert scene.polygon_count == 16
    corners = scene.vertices[scene.corner_vertex].reshape(16, 4, 3)
    vector = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert vector == pytest.approx(np.tile([0, 0, -1 / 16], (16, 1)))
    expected = corners.mean(axis=1)[:, 0]
    assert scene.emission[:, 0] / (math.pi * STRENGTH) == pytest.approx(expected, abs=0.02)
    assert scene.emission[:, 0].mean() / (math.pi * STRENGTH) == pytest.approx(0.5, rel=1e-3)
    assert (scene.object == 0).all()
    assert scene.reflectance == pytest.approx(0.2)


def test_both_directions_of_a_picture_lie_right(screens):
    rng = np.random.default_rng(3)
    pixels = rng.random((8, 8))
    material, _ = screens.material(screens.image(pixels))
    for mirrored in (False, True):
        thing = screens.quads([part(0, 1)], material)
        thing.scale.y = -1 if mirrored else 1
        scene = screens.shop.extract().scene
        middle = scene.vertices[scene.corner_vertex].reshape(64, 4, 3).mean(axis=1)
        row, column = np.floor(8 * np.abs(middle[:, 1])).astype(int), np.floor(8 * middle[:, 0]).astype(int)
        assert scene.emission[:, 0] / (math.pi * STRENGTH) == pytest.approx(pixels[row, column], abs=0.021)
        screens.bpy.data.objects.remove(thing)


def test_a_screen_is_cut_no_finer_than_it_shows(screens):
    coarse = np.kron([[0.0, 1.0], [0.5, 0.0]], np.ones((8, 8)))
    for pixels, cells in ((np.ones((4, 4)), 1), (coarse, 4), (0.5 + 0.02 * gradient(), 1)):
        material, _ = screens.material(screens.image(pixels))
        thing = screens.quads([part(0, 1)], material)
        assert screens.shop.extract().scene.polygon_count == cells
        screens.bpy.data.objects.remove(thing)


def test_faces_that_hardly_count_stay_whole(screens):
    material, _ = screens.material(screens.image(gradient()))
    thing = screens.quads([part(0, 1)], material)
    small = thing.copy()
    screens.bpy.context.scene.collection.objects.link(small)
    small.location, small.scale = (3, 0, 0), (0.05, 0.05, 0.05)
    assert screens.shop.extract().scene.polygon_count == 17


@pytest.mark.parametrize("target", ["vertex", "texture"])
def test_a_screen_carries_its_own_light_where_it_is(screens, target):
    """The four corners of a screen that is dark on one side: each with the emission of its own cell, and the light of its place."""
    shop = screens.shop
    material, _ = screens.material(screens.image(HALVES))
    thing = screens.quads([part(0, 1)], material)
    shop.bake(target=target, quantity="radiosity", **({"texel_density": 16.0} if target == "texture" else {}))
    light = lambda at: 0.2 * shop.light(at) / math.pi  # noqa: E731
    if target == "vertex":
        at = shop.corners(thing)
        expected = light(at) + STRENGTH * (at[:, :1] > 0.5)
        assert shop.colors(thing)[:, :3] == pytest.approx(expected, rel=1e-5)
    else:
        image = shop.pixels(shop.bpy.data.images["Enfilade Screen"])
        uv = shop.lightmap(thing) * (image.shape[1], image.shape[0])
        low, high = np.floor(uv.min(0)).astype(int), np.floor(uv.max(0)).astype(int)
        inside = image[low[1] : high[1], low[0] : high[0], 0]
        assert (inside > STRENGTH).mean() == pytest.approx(0.5, abs=0.04)
        assert ((inside < 10) & (inside > 0.2 * 20 * 0.3 / math.pi)).all()


def test_subdivided_copies_show_the_cells(screens):
    shop = screens.shop
    material, _ = screens.material(screens.image(HALVES))
    screens.quads([part(0, 1)], material)
    shop.bake(quantity="radiosity", subdivide=0.11)
    copy = next(o for o in shop.bpy.context.scene.objects if o.enfilade.carries is not None)
    at = shop.corners(copy)
    far = np.abs(at[:, 0] - 0.5) > 0.01
    shining = shop.colors(copy)[:, 0] - 0.2 * shop.light(at)[:, 0] / math.pi
    assert shining[far] == pytest.approx(STRENGTH * (at[far, 0] > 0.5), abs=1e-4)
