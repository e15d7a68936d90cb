"""A bench scene in Blender, and what receives the bake of Cycles: its own meshes, or a tiny face at every point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

from ...core.charts import make_charts, pack
from ...core.corners import corner_faces
from ...core.polygons import area_vectors
from ...core.scene import Scene
from ...core.subdivision import subdivide

BOUNCES = 64
"""Diffuse bounces: enough that none are missed, also in white rooms."""
LIFT, HALF = 1e-4, 2e-4
"""Metres: tiny receivers over their surface, and half their side. Lamps are lifted half as far."""
MARGIN, SPREAD = 2, 16
"""Texels around the charts of a light map, and how far the bake goes on beyond them where there is room: the rim of a chart runs
through texel centres, and next to black a denoiser darkens it."""


@dataclass(frozen=True)
class Receiver:
    """An object whose bake gives light at the points of a scene.

    target : of Blender's bake, ``IMAGE_TEXTURES`` or ``VERTEX_COLORS``
    read : after a bake the irradiance (N, 3) W/m2 at the points;  smoothed : the same through OpenImageDenoise, None without an image
    margin : texels that the bake adds around what it covers;  size : what was baked, in words
    """

    object: bpy.types.Object
    target: str
    read: Callable[[], np.ndarray]
    smoothed: Callable[[], np.ndarray] | None
    margin: int
    size: str


def prepare(samples: int, threads: int) -> bpy.types.Scene:
    """An empty Blender scene with the settings of Cycles that suit interiors best.

    Many bounces and no clamping, so that only noise is left; the light tree; no adaptive sampling, which the bake does not
    follow. Path guiding was tried: it left more noise in the same time.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", samples
    cycles.max_bounces = cycles.diffuse_bounces = BOUNCES
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.use_light_tree, cycles.use_adaptive_sampling = True, False
    cycles.caustics_reflective = cycles.caustics_refractive = False
    scene.world = bpy.data.worlds.new("black")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def add_building(scene: Scene) -> tuple[bpy.types.Object, np.ndarray]:
    """The polygons of a scene (none with holes) as one object with its materials, and its corners (C,) by polygon.

    Lamps are lifted a little: rays of Cycles meet the ceiling in whose plane one lies as soon as the lamp, which then stays dark, as all of
    three corridors of ``building`` did.
    """
    start = scene.loop_start[scene.polygon_start]
    normal = area_vectors(scene)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    polygon = np.repeat(np.arange(scene.polygon_count), np.diff(start))
    shines = np.flatnonzero((scene.emission > 0).any(1)[polygon])
    lifted = scene.vertices[scene.corner_vertex[shines]] + 0.5 * LIFT * normal[polygon[shines]]
    corner, vertices = scene.corner_vertex.copy(), np.concatenate([scene.vertices, lifted])
    corner[shines] = len(scene.vertices) + np.arange(len(shines))
    faces = [c.tolist() for c in np.split(corner, start[1:-1])]
    kind = np.concatenate([scene.reflectance, scene.emission], axis=1)
    kinds, index = np.unique(kind, axis=0, return_inverse=True)
    return _object("building", vertices, faces, [_material(*row[:3], *row[3:]) for row in kinds], index.reshape(-1)), start


def at_points(scene: Scene) -> Receiver:
    """Irradiance at the points themselves: a tiny white face over each, one texel for every face. Nothing meets these faces."""
    point, normal = scene.points.position, scene.points.normal
    count = len(point)
    u = np.cross(np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0, 1]], [[1.0, 0, 0]]), normal)
    u /= np.linalg.norm(u, axis=1)[:, None]
    v = np.cross(normal, u)
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    place = (point + LIFT * normal)[:, None] + HALF * (corner[:, :1] * u[:, None] + corner[:, 1:] * v[:, None])
    side = int(np.ceil(np.sqrt(count)))
    texel = np.stack([np.arange(count) % side, np.arange(count) // side], axis=1)
    uv = (texel[:, None] + (corner + 1) / 2) / side
    receiver = _object("points", place.reshape(-1, 3), np.arange(4 * count).reshape(-1, 4).tolist(), [_material(1, 1, 1)])
    image = _image(receiver, uv.reshape(-1, 2), side, side)
    for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(receiver, f"visible_{ray}", False)
    return Receiver(receiver, "IMAGE_TEXTURES", lambda: np.pi * _pixels(image)[:count], None, 0, f"{count:,} points")


def in_vertex_colours(scene: Scene, edge: float) -> Receiver:
    """Vertex colours of the building, its faces cut until no edge is longer than ``edge`` metres; interpolated at the points.

    Polygons share no vertices, so that each has its own light at its edges; within one the samples of all corners of a vertex count.
    """
    building, start = add_building(scene)
    triangle, owner = _triangles(scene, start)
    fine = subdivide(scene.vertices, scene.corner_vertex[triangle], edge)
    polygon = owner[fine.parent]
    corners = np.einsum("tck,tkd->tcd", fine.weight, scene.vertices[scene.corner_vertex[triangle[fine.parent]]])
    key = polygon[:, None] * fine.count + fine.vertex
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    mesh = building.data
    slots = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", slots)
    materials = list(mesh.materials)
    bpy.data.objects.remove(building)
    receiver = _object("building", corners.reshape(-1, 3)[first], vertex.tolist(), materials, slots[polygon])
    receiver.data.color_attributes.active_color = receiver.data.color_attributes.new("light", "FLOAT_COLOR", "POINT")
    corner, weight = _locate(corners, polygon, scene)

    def read() -> np.ndarray:
        colour = np.empty((len(first), 4), np.float32)
        receiver.data.color_attributes["light"].data.foreach_get("color", colour.reshape(-1))
        return np.pi * np.einsum("nk,nkc->nc", weight, colour[vertex.reshape(-1)[corner], :3])

    return Receiver(receiver, "VERTEX_COLORS", read, None, 0, f"{len(first):,} vertices")


def in_light_map(scene: Scene, density: float) -> Receiver:
    """A light map of the building with ``density`` texels per metre, looked up at the points between its texels."""
    receiver, start = add_building(scene)
    charts = make_charts(scene.vertices, scene.corner_vertex, start, density)
    layout = pack(charts.size, MARGIN, 16384)
    owner = charts.chart[corner_faces(start)]
    width, height = layout.width, layout.height
    texel = np.where(owner[:, None] >= 0, charts.local + layout.offset[owner], 0.0)
    image = _image(receiver, (texel + 0.5) / [width, height], width, height)
    triangle, polygon = _triangles(scene, start)
    corner, weight = _locate(scene.vertices[scene.corner_vertex[triangle]], polygon, scene)
    at = np.einsum("nk,nkc->nc", weight, texel[triangle.reshape(-1)[corner]])

    def look_up(pixels: np.ndarray) -> np.ndarray:
        low = np.clip(np.floor(at).astype(int), 0, [width - 2, height - 2])
        rest = np.clip(at - low, 0, 1)
        out = 0.0
        for i in (0, 1):
            for j in (0, 1):
                share = np.abs(1 - i - rest[:, 0]) * np.abs(1 - j - rest[:, 1])
                out = out + share[:, None] * pixels[(low[:, 1] + j) * width + low[:, 0] + i]
        return np.pi * out

    return Receiver(
        receiver,
        "IMAGE_TEXTURES",
        lambda: look_up(_pixels(image)),
        lambda: look_up(_denoised(image)),
        SPREAD,
        f"{width} x {height} texels",
    )


def _denoised(image: bpy.types.Image) -> np.ndarray:
    """(n, 3) the image through OpenImageDenoise, which Blender has as a node of its compositor."""
    scene = bpy.data.scenes.new("denoise")
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera, scene.render.engine, scene.cycles.samples = camera, "CYCLES", 1
    scene.render.resolution_x, scene.render.resolution_y = image.size
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Raw"
    if hasattr(scene, "compositing_node_group"):
        tree = scene.compositing_node_group = bpy.data.node_groups.new("denoise", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        end = tree.nodes.new("NodeGroupOutput")
    else:  # before Blender 5.0
        scene.use_nodes, tree = True, scene.node_tree
        tree.nodes.clear()
        end = tree.nodes.new("CompositorNodeComposite")
    source, denoise = tree.nodes.new("CompositorNodeImage"), tree.nodes.new("CompositorNodeDenoise")
    source.image = image
    tree.links.new(source.outputs["Image"], denoise.inputs["Image"])
    tree.links.new(denoise.outputs[0], end.inputs[0])
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    scene.render.filepath = bpy.app.tempdir + "denoised.exr"
    bpy.ops.render.render(scene=scene.name, write_still=True)
    result = bpy.data.images.load(scene.render.filepath)
    result.colorspace_settings.name = "Non-Color"
    return _pixels(result)


def _pixels(image: bpy.types.Image) -> np.ndarray:
    """(width * height, 3) float32, row after row from the bottom."""
    out = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(out)
    return out.reshape(-1, 4)[:, :3].copy()


def _object(name: str, vertices, faces: list, materials: list, index: np.ndarray | None = None) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(vertices).tolist(), [], faces)
    for material in materials:
        mesh.materials.append(material)
    if index is not None:
        mesh.polygons.foreach_set("material_index", index.astype(np.int32))
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def _material(*colour: float) -> bpy.types.Material:
    """Diffuse reflectance (3 numbers) on both sides and, with 3 more, an exitance in W/m2 on the front alone."""
    material = bpy.data.materials.new("surface")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    end, diffuse = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*colour[:3], 1)
    shader = diffuse.outputs[0]
    if any(colour[3:]):
        light, side = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeNewGeometry")
        front, both = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("ShaderNodeAddShader")
        radiance = max(colour[3:]) / np.pi
        light.inputs["Color"].default_value = (*(c / max(colour[3:]) for c in colour[3:]), 1)
        front.operation = "MULTIPLY_ADD"
        front.inputs[1].default_value, front.inputs[2].default_value = -radiance, radiance
        tree.links.new(side.outputs["Backfacing"], front.inputs[0])
        tree.links.new(front.outputs[0], light.inputs["Strength"])
        tree.links.new(shader, both.inputs[0])
        tree.links.new(light.outputs[0], both.inputs[1])
        shader = both.outputs[0]
        material.cycles.emission_sampling = "FRONT"
    tree.links.new(shader, end.inputs["Surface"])
    return material


def _image(receiver: bpy.types.Object, uv: np.ndarray, width: int, height: int) -> bpy.types.Image:
    """An image that a bake of ``receiver`` fills, with texture coordinates ``uv`` (C, 2) of its corners."""
    image = bpy.data.images.new("light", width, height, float_buffer=True, is_data=True)
    receiver.data.uv_layers.new(name="light").data.foreach_set("uv", np.ascontiguousarray(uv, np.float32).reshape(-1))
    for material in receiver.data.materials:
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        material.node_tree.nodes.active = node
    return image


def _triangles(scene: Scene, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (T, 3) of a fan of triangles for every polygon, and their polygons (T,)."""
    count = np.diff(start)
    polygon = np.repeat(np.arange(len(count)), count - 2)
    k = np.arange(len(polygon)) - np.repeat(np.cumsum(count - 2) - (count - 2), count - 2)
    first = start[polygon]
    return np.stack([first, first + k + 1, first + k + 2], axis=1), polygon


def _locate(triangles: np.ndarray, polygon: np.ndarray, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """For every point of the scene the corners (N, 3) of the triangle that it lies in, and its weights (N, 3) there.

    triangles : (T, 3, 3);  polygon : (T,) the polygon of each
    """
    order = np.argsort(polygon, kind="stable")
    start = np.searchsorted(polygon[order], np.arange(polygon.max() + 2))
    corner, weight = np.zeros((len(scene.points.polygon), 3), np.int64), np.zeros((len(scene.points.polygon), 3))
    for p in np.unique(scene.points.polygon):
        rows, mine = order[start[p] : start[p + 1]], np.flatnonzero(scene.points.polygon == p)
        a, b, c = (triangles[rows, k] for k in range(3))
        normal = np.cross(b - a, c - a)
        squared = np.maximum((normal * normal).sum(1), 1e-300)
        for part in np.array_split(mine, 1 + len(mine) * len(rows) // 1_000_000):
            x = scene.points.position[part][:, None]
            inner = [(np.cross(q - p_, x - p_) * normal).sum(2) / squared for p_, q in ((b, c), (c, a))]
            share = np.stack([*inner, 1 - inner[0] - inner[1]], axis=2)
            best = share.min(2).argmax(1)
            corner[part] = 3 * rows[best][:, None] + np.arange(3)
            chosen = np.clip(share[np.arange(len(part)), best], 0, None)
            weight[part] = chosen / chosen.sum(1, keepdims=True)
    return corner, weight
