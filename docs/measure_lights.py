"""Compare every kind of lamp with Cycles: ``python -m enfilade.docs.measure_lights`` (needs the ``bpy`` module).

For each case a small furnished room is built in Blender, lit by one kind of lamp, solved, and baked by Cycles with many samples at
the same points of its floor and of a wall. Printed are the mean irradiance of both, its difference, and the relative RMSE of the points.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import bpy
import enfilade
import numpy as np
from enfilade.addon.extract import extract
from enfilade.core.options import Options
from enfilade.core.pipeline import solve

HIGH = 2.5


def photometric_file() -> str:
    """Text of a luminaire that shines more along one half-plane than along the other, in steps of five degrees."""
    vertical, horizontal = range(0, 91, 5), range(0, 181, 15)
    candela = [[9000 * math.cos(math.radians(v)) ** (2 + h / 60) for v in vertical] for h in horizontal]
    head = f"IESNA:LM-63-1995\nTILT=NONE\n1 1000 1 {len(vertical)} {len(horizontal)} 1 2 0 0 0\n1 1 10\n"
    rows = [vertical, horizontal, *candela]
    return head + "\n".join(" ".join(f"{value:.3f}" for value in row) for row in rows) + "\n"


def cases() -> dict[str, Callable[[], object]]:
    """The lamps, by name; each stands in the room, or outside of its window where the name says so."""
    down, radians = (0, 0, 0), math.radians
    side = (radians(50), 0, radians(30))
    found = {
        "area square": lambda: lamp("AREA", 100, (2, 1.5, 2.3), down, size=0.5),
        "area rectangle, turned and scaled": lambda: lamp(
            "AREA", 100, (2, 1.5, 2), (0.4, 0.3, 0.2), shape="RECTANGLE", size=0.3, size_y=0.8, scale=(1.5, 0.7, 1)
        ),
        "area disk": lambda: lamp("AREA", 100, (2, 1.5, 2.2), (0.3, 0, 0), shape="DISK", size=0.6),
        "area ellipse": lambda: lamp("AREA", 100, (1.5, 1.5, 2.2), down, shape="ELLIPSE", size=0.4, size_y=1.0),
        "area of spread 90": lambda: lamp("AREA", 100, (2, 1.5, 2.3), down, size=0.5, spread=radians(90)),
        "point, radius 0": lambda: lamp("POINT", 100, (1.3, 1.2, 2), down, shadow_soft_size=0),
        "point, radius 0.15": lambda: lamp("POINT", 100, (1.3, 1.2, 2), down, shadow_soft_size=0.15),
        "point, radius 0.15, hard falloff": lambda: lamp("POINT", 100, (1.3, 1.2, 2), down, shadow_soft_size=0.15, use_soft_falloff=False),
        "point in colour": lambda: lamp("POINT", 100, (1.3, 1.2, 2), down, shadow_soft_size=0.1, color=(1, 0.5, 0.2)),
        "spot, radius 0": lambda: lamp(
            "SPOT", 300, (1.3, 1.2, 2.3), (0.4, 0.2, 0), shadow_soft_size=0, spot_size=radians(70), spot_blend=0.3
        ),
        "spot, radius 0.1": lambda: lamp(
            "SPOT", 300, (1.3, 1.2, 2.3), (0.4, 0.2, 0), shadow_soft_size=0.1, spot_size=radians(60), spot_blend=0.5
        ),
        "spot with nodes": lambda: nodes(
            lamp("SPOT", 100, (1.3, 1.2, 2.3), down, shadow_soft_size=0.05, spot_size=radians(90)), 2.0, (1, 0.8, 0.6)
        ),
        "photometric file": lambda: photometric(lamp("POINT", 1, (1.6, 1.4, 2.3), (0.1, 0.2, 0.5), shadow_soft_size=0.02)),
        "sun through a window": lambda: lamp("SUN", 10, (0, 0, 5), side, outside=True, angle=radians(0.5)),
        "wide sun through a window": lambda: lamp("SUN", 10, (0, 0, 5), side, outside=True, angle=radians(20)),
        "world colour through a window": lambda: sky(color=(0.5, 0.7, 1.0), strength=3.0),
        "world image through a window": lambda: sky(image=lambda: gradient(False)),
        "world image with a sun in it": lambda: sky(image=lambda: gradient(True)),
        "sun through glass": lambda: glazed(lamp("SUN", 10, (0, 0, 5), side, outside=True, angle=radians(20))),
        "world colour through glass": lambda: glazed(sky(color=(0.5, 0.7, 1.0), strength=3.0)),
        "world colour through a window without portal": lambda: bare(sky(color=(0.5, 0.7, 1.0), strength=3.0)),
        "screen with a picture": screen,
    }
    if "exposure" in bpy.types.PointLight.bl_rna.properties:
        found |= {
            "temperature and exposure": lambda: lamp(
                "POINT", 50, (1.3, 1.2, 2), down, shadow_soft_size=0.1, use_temperature=True, temperature=3000, exposure=1.0
            ),
            "area without normalization": lambda: lamp("AREA", 100, (2, 1.5, 2.3), down, size=0.5, normalize=False),
            "point without normalization": lambda: lamp("POINT", 100, (1.3, 1.2, 2), down, shadow_soft_size=0.15, normalize=False),
            "sun without normalization": lambda: lamp("SUN", 100, (0, 0, 5), side, outside=True, angle=radians(20), normalize=False),
        }
    return found


def lamp(kind: str, watts: float, at, rotation, scale=(1, 1, 1), outside: bool = False, **more) -> bpy.types.Object:
    """A lamp in a room, with a window where it stands ``outside``."""
    room(outside)
    light = bpy.data.lights.new("Lamp", kind)
    light.energy = watts
    for name, value in more.items():
        setattr(light, name, value)
    thing = bpy.data.objects.new("Lamp", light)
    thing.location, thing.rotation_euler, thing.scale = at, rotation, scale
    bpy.context.scene.collection.objects.link(thing)
    return thing


def nodes(thing: bpy.types.Object, strength: float, color) -> bpy.types.Object:
    """Give a lamp an emission node."""
    thing.data.use_nodes = True
    node = next(n for n in thing.data.node_tree.nodes if n.type == "EMISSION")
    node.inputs["Strength"].default_value = strength
    node.inputs["Color"].default_value = (*color, 1)
    return thing


def photometric(thing: bpy.types.Object) -> bpy.types.Object:
    """Give a lamp the distribution of a file."""
    nodes(thing, 1.0, (1, 1, 1))
    tree = thing.data.node_tree
    node = tree.nodes.new("ShaderNodeTexIES")
    node.mode = "INTERNAL"
    node.ies = bpy.data.texts.new("luminaire.ies")
    node.ies.write(photometric_file())
    node.inputs["Strength"].default_value = 1.0
    tree.links.new(node.outputs[0], next(n for n in tree.nodes if n.type == "EMISSION").inputs["Strength"])
    return thing


def screen() -> None:
    """A face beside the fine wall that shows a bright spot and a bright corner on a dim ground, with colours.

    Behind it is a black case: Cycles lets faces shine from both sides.
    """
    room(False)
    row, column = np.meshgrid(*2 * [(np.arange(128) + 0.5) / 128], indexing="ij")
    spot = np.exp(-20 * ((row - 0.7) ** 2 + (column - 0.3) ** 2))
    pixels = np.stack([0.05 + spot, 0.05 + 0.5 * spot, np.where((row < 0.3) & (column > 0.8), 3.0, 0.05), np.ones_like(row)], axis=2)
    image = bpy.data.images.new("picture", 128, 128, float_buffer=True)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.update()
    image.pack()
    material = diffuse("Screen", (0, 0, 0))
    tree = material.node_tree
    tree.nodes.clear()
    shader, output, texture = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial", "TexImage"))
    shader.inputs["Strength"].default_value = 5.0
    texture.image = image
    tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    data = bpy.data.meshes.new("Screen")
    data.from_pydata([(3.98, 1.2, 0.9), (3.98, 1.2, 1.9), (3.98, 2.8, 1.9), (3.98, 2.8, 0.9)], [], [(0, 1, 2, 3)])
    data.materials.append(material)
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.float32([1, 0, 1, 1, 0, 1, 0, 0]))
    vertices, faces = block((3.981, 1.2, 0.9), (4, 2.8, 1.9))
    case = bpy.data.meshes.new("Case")
    case.from_pydata(vertices, [], faces)
    case.materials.append(diffuse("Black", (0, 0, 0)))
    for part in (data, case):
        bpy.data.collections["Room"].objects.link(bpy.data.objects.new(part.name, part))


def sky(color=(1, 1, 1), strength: float = 1.0, image: Callable[[], bpy.types.Image] | None = None) -> None:
    """A room with a window, under a world."""
    room(True)
    world = bpy.data.worlds.new("World")
    bpy.context.scene.world = world
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    node = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*color, 1), strength
    if image is not None:
        texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image = image()
        world.node_tree.links.new(texture.outputs[0], node.inputs["Color"])


def glazed(_: object) -> None:
    """Put panes that let 0.7 of the light pass into the window: for Cycles a transparent face, which is in no room."""
    bpy.data.objects["Window"].enfilade.transmittance = 0.7
    material = diffuse("Glass", (0, 0, 0))
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (0.7, 0.7, 0.7, 1)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    pane = bpy.data.meshes.new("Pane")
    pane.from_pydata([(1, 0, 0.8), (3, 0, 0.8), (3, 0, 2), (1, 0, 2)], [], [(0, 1, 2, 3)])
    pane.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Pane", pane))


def bare(_: object) -> None:
    """Take the portal out of the window."""
    bpy.data.objects.remove(bpy.data.objects["Window"])


def gradient(sun: bool) -> bpy.types.Image:
    """An environment image that is brighter above and on one side, with a small very bright place if asked."""
    image = bpy.data.images.new("sky", 512, 256, float_buffer=True)
    row, column = np.meshgrid((np.arange(256) + 0.5) / 256, (np.arange(512) + 0.5) / 512, indexing="ij")
    level = np.where(row > 0.5, 1 + 4 * (row - 0.5) + np.cos(2 * np.pi * (column - 0.7)), 0.3)
    pixels = np.stack([level, level, 1.3 * level, np.ones_like(level)], axis=2).astype(np.float32)
    if sun:
        pixels[(np.abs(row - 0.72) < 0.01) & (np.abs(column - 0.72) < 0.006), :3] = 3000.0
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def diffuse(name: str, color) -> bpy.types.Material:
    """A diffuse material."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (*color, 1)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def room(window: bool) -> None:
    """A new scene: a grey room of 4 x 3 x 2.5 m with a shelf and a box; floor and one wall are fine grids.

    Where it has a window, a black awning hangs over that: Cycles lights walls from behind too, and nothing of that comes in.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    material, black = diffuse("Grey", (0.5, 0.4, 0.6)), diffuse("Black", (0, 0, 0))
    rooms, portals = (bpy.data.collections.new(n) for n in ("Rooms", "Portals"))
    inside = bpy.data.collections.new("Room")
    rooms.children.link(inside)
    for collection in (rooms, portals):
        bpy.context.scene.collection.children.link(collection)

    def mesh(name, vertices, faces, collection=inside, material=material):
        data = bpy.data.meshes.new(name)
        data.from_pydata([tuple(map(float, v)) for v in vertices], [], faces)
        data.materials.append(material)
        thing = bpy.data.objects.new(name, data)
        collection.objects.link(thing)
        thing.hide_render = collection == portals

    mesh("Floor", *grid((0, 0, 0), (4, 0, 0), (0, 3, 0), 16, 12))
    mesh("Wall", *grid((0, 3, 0), (4, 0, 0), (0, 0, HIGH), 16, 10))
    mesh("Ceiling", [(0, 0, HIGH), (0, 3, HIGH), (4, 3, HIGH), (4, 0, HIGH)], [(0, 1, 2, 3)])
    mesh("Left", [(0, 0, 0), (0, 3, 0), (0, 3, HIGH), (0, 0, HIGH)], [(0, 1, 2, 3)])
    mesh("Right", [(4, 0, 0), (4, 0, HIGH), (4, 3, HIGH), (4, 3, 0)], [(0, 1, 2, 3)])
    mesh("Box", *block((2.2, 1.6, 0), (2.9, 2.2, 0.8)))
    mesh("Shelf", *block((0.4, 2.2, 1.2), (1.4, 2.6, 1.25)))
    corner = lambda x0, x1, z0, z1: [(x0, 0, z0), (x0, 0, z1), (x1, 0, z1), (x1, 0, z0)]  # noqa: E731
    if not window:
        mesh("Front", corner(0, 4, 0, HIGH), [(0, 1, 2, 3)])
        return
    for k, frame in enumerate(((0, 4, 0, 0.8), (0, 4, 2, HIGH), (0, 1, 0.8, 2), (3, 4, 0.8, 2))):
        mesh(f"Front {k}", corner(*frame), [(0, 1, 2, 3)])
    mesh("Window", corner(1, 3, 0.8, 2)[::-1], [(0, 1, 2, 3)], portals)
    mesh("Awning", *block((0.8, -0.8, 2.2), (3.2, -0.02, 2.22)), material=black)


def grid(origin, a, b, n: int, m: int):
    """Vertices and faces of a rectangle in n by m parts, its normal along a x b."""
    o, a, b = (np.array(v, float) for v in (origin, a, b))
    vertices = [o + i / n * a + j / m * b for j in range(m + 1) for i in range(n + 1)]
    at = lambda i, j: j * (n + 1) + i  # noqa: E731
    return vertices, [(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for j in range(m) for i in range(n)]


def block(low, high):
    """Vertices and faces of a box."""
    (a, b, c), (d, e, f) = low, high
    vertices = [(x, y, z) for z in (c, f) for y in (b, e) for x in (a, d)]
    return vertices, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def by_cycles(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of floor and wall, all grid corners away from edges, and their irradiance (n, 3) by Cycles."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", samples, False, False
    cycles.max_bounces = cycles.diffuse_bounces = 64
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0
    cycles.use_fast_gi = False
    world = scene.world
    if world is not None:
        world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 1024
    bpy.context.view_layer.update()
    places, light = [], []
    for name in ("Floor", "Wall"):
        thing = bpy.data.objects[name]
        mesh = thing.data
        attribute = mesh.color_attributes.new("cycles", "FLOAT_COLOR", "POINT")
        mesh.color_attributes.active_color = attribute
        for other in bpy.context.view_layer.objects:
            other.select_set(other == thing)
        bpy.context.view_layer.objects.active = thing
        bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, target="VERTEX_COLORS")
        color, place = np.empty((len(mesh.vertices), 4), np.float32), np.empty((len(mesh.vertices), 3), np.float32)
        mesh.color_attributes["cycles"].data.foreach_get("color", color.ravel())
        mesh.vertices.foreach_get("co", place.ravel())
        places.append(place.astype(float))
        light.append(np.pi * color[:, :3].astype(float))
        mesh.color_attributes.remove(mesh.color_attributes["cycles"])
    at, found = np.concatenate(places), np.concatenate(light)
    return at, found


def inner(at: np.ndarray) -> np.ndarray:
    """(n,) bool: points of the floor and the wall that lie on no edge of the room, and not under the box or at its edge."""
    floor, wall = at[:, 2] < 1e-6, at[:, 1] > 3 - 1e-6
    inside = (at[:, 0] > 0.01) & (at[:, 0] < 3.99) & (at[:, 1] > 0.01) & (at[:, 2] < HIGH - 0.01) & ~(floor & wall)
    under = (at[:, 0] > 2.15) & (at[:, 0] < 2.95) & (at[:, 1] > 1.55) & (at[:, 1] < 2.25)
    return inside & ~(floor & under)


def by_enfilade(at: np.ndarray, options: Options) -> np.ndarray:
    """(n, 3) irradiance at the same points."""
    scene = extract(bpy.context).scene
    polygons = {name: scene.object_names.index(name) for name in ("Floor", "Wall")}
    first = {name: int(np.flatnonzero(scene.object == k)[0]) for name, k in polygons.items()}
    solution = solve(scene, options)
    # A grid is one surface after merging: any of its faces stands for all.
    return solution.irradiance(at, np.where(at[:, 2] < 1e-6, first["Floor"], first["Wall"])).astype(float)


def compare(build: Callable[[], object], samples: int, quality: str) -> dict[str, float]:
    """Mean irradiance of both, W/m2 over all channels, their relative difference, relative RMSE, and seconds."""
    build()
    at, reference = by_cycles(samples)
    keep = inner(at)
    at, reference = at[keep], reference[keep]
    begin = time.perf_counter()
    found = by_enfilade(at, Options(quality=quality))
    seconds = time.perf_counter() - begin
    rmse = float(np.sqrt(((found - reference) ** 2).mean()) / reference.mean())
    return {
        "cycles": float(reference.mean()),
        "enfilade": float(found.mean()),
        "difference": float(found.mean() / reference.mean() - 1),
        "rmse": rmse,
        "seconds": seconds,
    }


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4096)
    parser.add_argument("--quality", default="fine", choices=("draft", "good", "fine"))
    parser.add_argument("--case", default="", help="only cases whose names have this in them")
    arguments = parser.parse_args()
    enfilade.register()
    print(f"Blender {bpy.app.version_string}, quality {arguments.quality}, {arguments.samples} samples")
    print("| lamp | Cycles, W/m2 | Enfilade, W/m2 | difference | RMSE | seconds |\n|---|---|---|---|---|---|")
    for name, build in cases().items():
        if arguments.case in name:
            r = compare(build, arguments.samples, arguments.quality)
            row = f"{r['cycles']:.4f} | {r['enfilade']:.4f} | {r['difference']:+.2%} | {r['rmse']:.2%} | {r['seconds']:.1f}"
            print(f"| {name} | {row} |", flush=True)


if __name__ == "__main__":
    main()
