"""The .glb of a baked scene, read back from its bytes and by Blender's own importer, against the bake."""

import json
import math
import struct
import zlib

import numpy as np
import pytest

WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


class Glb:
    """A file as the specification says it must be read."""

    def __init__(self, path):
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        rest, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        self.bytes = data[28 + size : 28 + size + rest]
        assert len(self.bytes) == rest == self.json["buffers"][0]["byteLength"]

    def view(self, k):
        view = self.json["bufferViews"][k]
        assert view["byteOffset"] % 4 == 0
        return self.bytes[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def array(self, k):
        accessor = self.json["accessors"][k]
        values = np.frombuffer(self.view(accessor["bufferView"]), {5126: "<f4", 5125: "<u4"}[accessor["componentType"]])
        values = values.reshape(accessor["count"], WIDTH[accessor["type"]])
        if "min" in accessor:
            assert values.min(0).tolist() == accessor["min"]
            assert values.max(0).tolist() == accessor["max"]
        return values

    def primitives(self, name):
        (node,) = [n for n in self.json["nodes"] if n["name"] == name]
        assert set(node) == {"name", "mesh"}  # already in the world
        return self.json["meshes"][node["mesh"]]["primitives"]

    def corners(self, primitive, what):
        """(T, 3, k) values at the corners of triangles; places back in Blender's axes."""
        values = self.array(primitive["attributes"][what])[self.array(primitive["indices"])[:, 0]]
        if what == "POSITION":
            values = np.stack([values[:, 0], -values[:, 2], values[:, 1]], axis=1)
        return values.reshape(-1, 3, values.shape[1])

    def material(self, primitive):
        material = self.json["materials"][primitive["material"]]
        assert material["extensions"] == {"KHR_materials_unlit": {}}
        assert self.json["extensionsUsed"] == ["KHR_materials_unlit"]
        return material["pbrMetallicRoughness"]

    def picture(self, primitive):
        """(H, W, 3) linear pixels of the texture of a primitive, row 0 at the bottom, and its sampler."""
        texture = self.json["textures"][self.material(primitive)["baseColorTexture"]["index"]]
        image = self.json["images"][texture["source"]]
        assert image["mimeType"] == "image/png"
        value = decoded(self.view(image["bufferView"]))[::-1] / 255.0
        return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4), self.json["samplers"][texture["sampler"]]


def decoded(data):
    """A PNG of eight bits RGB whose rows all have filter 2."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, chunks = 8, []
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        assert struct.unpack_from(">I", data, at + 8 + size)[0] == zlib.crc32(data[at + 4 : at + 8 + size])
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 12 + size
    assert [kind for kind, _ in chunks] == [b"IHDR", b"sRGB", b"IDAT", b"IEND"]
    width, height, *form = struct.unpack(">IIBBBBB", chunks[0][1])
    assert form == [8, 2, 0, 0, 0]
    rows = np.frombuffer(zlib.decompress(chunks[2][1]), np.uint8).reshape(height, 1 + 3 * width)
    assert (rows[:, 0] == 2).all()
    return np.cumsum(rows[:, 1:].astype(np.int64), axis=0).astype(np.uint8).reshape(height, width, 3)


@pytest.fixture
def export(shop, tmp_path):
    def write(**more):
        path = tmp_path / "baked.glb"
        assert shop.bpy.ops.enfilade.export_gltf(filepath=str(path), **more) == {"FINISHED"}
        return Glb(path)

    return write


@pytest.mark.parametrize("exposure", [-7.0, -5.5])
def test_colours_are_those_of_the_bake_times_two_to_the_exposure(shop, export, exposure):
    thing = shop.box((0, 0, 0), (2, 3, 1), "Room", material=shop.material(color=(0.5, 0.25, 0.9), emission=3.0))
    thing.location = (1, 2, 3)
    shop.bake()
    file = export(exposure=exposure)
    (primitive,) = file.primitives("Room")
    place, color = file.corners(primitive, "POSITION"), file.corners(primitive, "COLOR_0")
    assert color == pytest.approx((3.0 + shop.light(place) * [0.5, 0.25, 0.9] / math.pi) * 2.0**exposure, rel=1e-5)
    assert color.max() < 1
    # The format takes no more than white; what is brighter is white, as in Blender without a view transform.
    (primitive,) = export(exposure=exposure + 5).primitives("Room")
    white = export(exposure=exposure + 5).corners(primitive, "COLOR_0")
    assert white == pytest.approx(np.minimum(32 * color, 1.0), rel=1e-5)
    assert (white == 1).any()
    assert file.material(primitive)["baseColorFactor"] == [1, 1, 1, 1]
    assert "TEXCOORD_0" not in primitive["attributes"]
    assert len(file.array(primitive["attributes"]["POSITION"])) == 8  # this light has no steps: corners in one place are one vertex
    assert file.json["scenes"][0]["extras"]["enfilade"] == {
        "quantity": "radiosity",
        "exposure": exposure,
        "unit": "W/(m2 sr) * 2**exposure, limited to 0..1",
    }


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-2, -1, -0.5)])
def test_fronts_stay_in_front_and_lengths_are_metres(shop, export, scale):
    shop.bpy.context.scene.unit_settings.scale_length = 0.01
    thing = shop.box((-100, -100, -100), (100, 100, 100), "Room")
    thing.scale = scale
    shop.bake()
    file = export()
    (primitive,) = file.primitives("Room")
    corner = file.corners(primitive, "POSITION")
    assert np.abs(corner).max((0, 1)) == pytest.approx(np.abs(scale))
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("ij,ij->i", normal, corner.mean(1)) < 0).all()  # towards the middle of the room
    assert not any("doubleSided" in m for m in file.json["materials"])
    assert all(m["doubleSided"] for m in export(double_sided=True).json["materials"])


def test_lighting_alone_is_shown_on_the_paint(shop, export):
    bpy = shop.bpy
    image = bpy.data.images.new("Wood", 2, 2, float_buffer=True)
    image.pixels.foreach_set(np.float32([0.2, 0.4, 0.6, 1, 0.8, 0.1, 0.1, 1, 0.1, 0.8, 0.1, 1, 0.1, 0.1, 0.8, 1]))
    wood = shop.material("Wood")
    node = next(n for n in wood.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    texture = wood.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    wood.node_tree.links.new(texture.outputs[0], node.inputs["Base Color"])
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)]
    table = shop.mesh(*square, "Table", material=wood)
    layer = table.data.uv_layers.new(name="Paint")
    layer.uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1]))
    shop.mesh(*square, "Plain", material=shop.material("Red", (0.7, 0.2, 0.1)))
    shop.mesh(*square, "Lamp", material=shop.material("Glow", (0.5, 0.5, 0.5), 2.0))
    shop.bake(quantity="lighting")
    file = export(exposure=-5.0)
    expected = shop.light([[0, 0, 0]])[0] / math.pi
    for name, factor, added in (("Plain", 1, 0), ("Lamp", 0.5, 2.0), ("Table", 1, 0)):
        (primitive,) = file.primitives(name)
        first = np.abs(file.corners(primitive, "POSITION")).max(2) == 0
        assert file.corners(primitive, "COLOR_0")[first][0] == pytest.approx((expected * factor + added) / 32, rel=1e-5), name
    assert file.material(file.primitives("Plain")[0])["baseColorFactor"] == pytest.approx([0.7, 0.2, 0.1, 1])
    assert file.material(file.primitives("Lamp")[0])["baseColorFactor"] == [1, 1, 1, 1]
    (primitive,) = file.primitives("Table")
    paint, sampler = file.picture(primitive)
    assert paint == pytest.approx(shop.pixels(image)[:, :, :3], abs=0.004)
    assert sampler["wrapS"] == 10497  # paint may repeat
    uv, place = file.corners(primitive, "TEXCOORD_0"), file.corners(primitive, "POSITION")
    assert np.stack([uv[..., 0], 1 - uv[..., 1]], -1) == pytest.approx(place[..., :2])


@pytest.mark.parametrize("atlas", ["object", "room"])
def test_lightmaps_show_the_light_at_every_place(shop, export, atlas):
    shop.two_rooms()
    shop.bake(target="texture", texel_density=8.0, atlas=atlas, material=True)
    file = export(exposure=-5.0)
    assert len(file.json["images"]) == len({i.name for i in shop.bpy.data.images if i.enfilade.made})
    weight = np.random.default_rng(0).dirichlet([1, 1, 1], 40)
    for name, color in (("West walls", (0.7, 0.6, 0.5)), ("East walls", (0.7, 0.6, 0.5))):
        (primitive,) = file.primitives(name)
        assert "COLOR_0" not in primitive["attributes"]
        picture, sampler = file.picture(primitive)
        assert sampler == {"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}
        uv, place = file.corners(primitive, "TEXCOORD_0"), file.corners(primitive, "POSITION")
        for triangle in range(len(uv)):
            at = weight @ uv[triangle]
            x, y = at[:, 0] * picture.shape[1] - 0.5, (1 - at[:, 1]) * picture.shape[0] - 0.5
            i, j = np.floor(x).astype(int), np.floor(y).astype(int)
            fx, fy = (x - i)[:, None], (y - j)[:, None]
            got = (picture[j, i] * (1 - fx) + picture[j, i + 1] * fx) * (1 - fy) + (
                picture[j + 1, i] * (1 - fx) + picture[j + 1, i + 1] * fx
            ) * fy
            assert got == pytest.approx(shop.light(weight @ place[triangle]) * color / math.pi / 32, rel=0.012)  # eight bits


def test_lux_is_shown_as_white_surfaces(shop, export):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room")
    shop.bake(quantity="lux")
    file = export(exposure=-5.0)
    (primitive,) = file.primitives("Room")
    place, color = file.corners(primitive, "POSITION"), file.corners(primitive, "COLOR_0")
    grey = shop.light(place) @ [0.2126, 0.7152, 0.0722] / math.pi / 32
    assert color == pytest.approx(np.repeat(grey[..., None], 3, 2), rel=1e-5)
    shop.bake(quantity="lux", target="texture", texel_density=8.0)
    file = export(exposure=-5.0)
    picture, _ = file.picture(file.primitives("Room")[0])
    uv = shop.lightmap(thing)
    expected = shop.light(shop.corners(thing)) @ [0.2126, 0.7152, 0.0722] / math.pi / 32
    flipped = np.stack([uv[:, 0] * picture.shape[1] - 0.5, uv[:, 1] * picture.shape[0] - 0.5], 1).round().astype(int)
    assert picture[flipped[:, 1], flipped[:, 0], 0] == pytest.approx(expected, rel=0.012)


def test_subdivided_copies_stand_for_their_originals(shop, export):
    shop.box((0, 0, 0), (2, 2, 2), "Room")
    shop.bake(subdivide=0.5)
    file = export(exposure=-5.0)
    assert [n["name"] for n in file.json["nodes"]] == ["Room (bake)"]
    (primitive,) = file.primitives("Room (bake)")
    place, color = file.corners(primitive, "POSITION"), file.corners(primitive, "COLOR_0")
    assert len(place) > 100
    assert color == pytest.approx(shop.light(place) * 0.8 / math.pi / 32, rel=1e-5)


def test_hidden_and_unbaked_objects_are_left_out(shop, export):
    for name in ("Shown", "In viewport hidden", "In renders hidden"):
        shop.box((0, 0, 0), (1, 1, 1), name)
    shop.bake()
    shop.box((0, 0, 0), (1, 1, 1), "Later")
    shop.bpy.data.objects["In renders hidden"].hide_render = True
    shop.bpy.data.objects["In viewport hidden"].hide_viewport = True
    assert {n["name"] for n in export().json["nodes"]} == {"Shown", "In viewport hidden"}
    assert shop.bpy.data.objects["In viewport hidden"].hide_viewport


def test_modifiers_after_the_bake_are_in_the_file(shop, export):
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room")
    shop.bake()
    thing.modifiers.new("Two", "ARRAY").relative_offset_displace[0] = 2.0
    (primitive,) = export().primitives("Room")
    assert len(primitive and export().corners(primitive, "POSITION")) == 24


@pytest.fixture
def blenders_own():
    """Blender's own reader and writer of glTF, gone again afterwards."""
    import addon_utils

    addon_utils.enable("io_scene_gltf2")
    yield
    addon_utils.disable("io_scene_gltf2")


@pytest.mark.usefixtures("blenders_own")
def test_blenders_own_importer_reads_the_same(shop, export, tmp_path):
    shop.two_rooms()
    shop.bake(material=True)
    before = {name: (shop.corners(o), shop.colors(o)) for name in ("West walls", "Lamp") for o in [shop.bpy.data.objects[name]]}
    export(exposure=-5.0)
    bpy = shop.bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "baked.glb"))
    bpy.context.view_layer.update()
    for name, (place, color) in before.items():
        thing = bpy.data.objects[name]
        attribute = thing.data.color_attributes[0]
        mine = np.array([tuple(d.color)[:3] for d in attribute.data])
        if attribute.domain == "POINT":
            mine = mine[[loop.vertex_index for loop in thing.data.loops]]
        there = shop.corners(thing)
        for at, value in zip(there, mine, strict=True):
            near = np.abs(place - at).max(1) < 1e-5
            assert 0.1 < value.max() < 0.9
            assert near.any()
            assert np.abs(color[near, :3] / 32 - value).max(1).min() < 5e-3  # some versions read colours as bytes


def test_what_cannot_be_written_is_a_sentence(shop, tmp_path):
    bpy = shop.bpy
    shop.box((0, 0, 0), (1, 1, 1), "Room")
    with pytest.raises(RuntimeError, match="no bake in this scene"):
        bpy.ops.enfilade.export_gltf(filepath=str(tmp_path / "a.glb"))
    shop.bake()
    with pytest.raises(RuntimeError, match="none"):
        bpy.ops.enfilade.export_gltf(filepath=str(tmp_path / "none" / "a.glb"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("blenders_own")
def test_the_recipe_for_blenders_own_exporter(shop, tmp_path):
    """A Color Attribute node at the Base Color brings the bake into COLOR_0, in all versions and in full range."""
    if shop.bpy.app.version < (4, 5):
        pytest.skip("as a Python module Blender 4.2 crashes when it ends, once its own exporter has run")
    paint = shop.material("Paint")
    thing = shop.box((0, 0, 0), (1, 1, 1), "Room", material=paint)
    shop.bake()
    tree = paint.node_tree
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Enfilade"
    principled = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
    tree.links.new(node.outputs["Color"], principled.inputs["Base Color"])
    shop.bpy.ops.export_scene.gltf(filepath=str(tmp_path / "own.glb"), export_format="GLB")
    file = Glb(tmp_path / "own.glb")
    (primitive,) = file.json["meshes"][0]["primitives"]
    accessor = file.json["accessors"][primitive["attributes"]["COLOR_0"]]
    color = np.frombuffer(file.view(accessor["bufferView"]), "<f4").reshape(accessor["count"], -1)[:, :3]
    at = file.array(primitive["attributes"]["POSITION"])
    assert color == pytest.approx(shop.light(np.stack([at[:, 0], -at[:, 2], at[:, 1]], 1)) * 0.5 / math.pi, rel=1e-5)
    assert color.max() > 1
    assert len(thing.data.color_attributes) == 1
