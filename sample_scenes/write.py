# SPDX-License-Identifier: GPL-3.0-or-later
"""From a model to a file: .npz for the solver alone, .blend with a collection per room and one of portals."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .model import Material, Model, Opening, to_scene, weld


@dataclass(frozen=True)
class View:
    """The camera of the .blend file: positions in metres, focal length in mm on a 36 mm sensor, exposure in stops."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    lens: float = 35.0
    size: tuple[int, int] = (1280, 960)
    exposure: float = 0.0


def command(model: Callable[[int], Model], view: View, cell: float, description: str) -> None:
    """The command line that every generator has."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=Path, help="file to write, .blend (needs bpy) or .npz")
    parser.add_argument("--seed", type=int, default=1, help="seed of what is random [1]")
    parser.add_argument("--cell", type=float, default=cell, help=f"longest edge of a face in the .blend file (m) [{cell}]")
    given = parser.parse_args()
    write(model(given.seed), given.out, view, given.cell)
    print(f"written: {given.out}")


def write(model: Model, path: Path, view: View, cell: float) -> None:
    """Write the model; the ending of ``path`` says as what. Raises ValueError for an unknown ending."""
    if path.suffix == ".blend":
        write_blend(model, path, view, cell)
    elif path.suffix == ".npz":
        from ..core.scene_files import save_scene

        save_scene(to_scene(model), path)
    else:
        raise ValueError(f"{path}: the file must end in .blend or .npz")


@dataclass(frozen=True)
class Thing:
    """One object of one room: (k, 3) corners of each face and its material; ``shell`` as in ``model.Piece``."""

    name: str
    room: int
    faces: list[np.ndarray]
    materials: list[Material]
    shell: bool


def write_blend(model: Model, path: Path, view: View, cell: float) -> None:
    """Save the model as :func:`save_building` does, its panels gridded so that no edge is longer than ``cell`` metres.

    Vertex colours can only carry as much of the light as the mesh has corners.
    """
    things = []
    for piece in model.pieces:
        grids = [panel.cells(cell) for panel in piece.panels]
        materials = [panel.material for panel, grid in zip(piece.panels, grids, strict=True) for _ in grid]
        things.append(Thing(piece.name, piece.room, list(np.concatenate(grids)), materials, piece.shell))
    save_building(model.name, model.rooms, things, model.openings, path, view)


def save_building(
    name: str, rooms: tuple[str, ...], things: list[Thing], openings: list[Opening], path: Path, view: View, cut: float = 0.0
):
    """Save a .blend file with the collections ``Rooms`` (a child for every room) and ``Portals``, and a camera.

    ``cut`` in metres, where it is not 0, cuts all meshes along the planes of a world grid of that width.
    """
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = name
    parent = _collection("Rooms", scene.collection)
    homes = [_collection(room, parent) for room in rooms]
    shaders: dict[Material, object] = {}
    for thing in things:
        used = list(dict.fromkeys(thing.materials))
        data = mesh(thing.name, thing.faces)
        data.polygons.foreach_set("material_index", np.array([used.index(m) for m in thing.materials], np.int32))
        for material in used:
            data.materials.append(shaders.get(material) or shaders.setdefault(material, shader(material)))
        if cut:
            cut_along_grid(data, cut)
        made = bpy.data.objects.new(thing.name, data)
        made.visible_camera = not (thing.shell and _behind(thing, view))
        homes[thing.room].objects.link(made)
    portals = _collection("Portals", scene.collection)
    for opening in openings:
        made = bpy.data.objects.new(opening.name, mesh(opening.name, [opening.corners]))
        made.display_type = "WIRE"
        made.hide_render = True
        portals.objects.link(made)
    camera(scene, view)
    _show_rooms_from_outside()
    save(path)


def mesh(name: str, faces: list[np.ndarray]):
    """A Blender mesh of faces with (k, 3) corners each, equal corners welded."""
    import bpy

    vertices, corner = weld(np.concatenate(faces))
    data = bpy.data.meshes.new(name)
    ends = np.cumsum([len(face) for face in faces])[:-1]
    data.from_pydata(vertices.tolist(), [], [loop.tolist() for loop in np.split(corner, ends)])
    return data


def cut_along_grid(data, cell: float) -> None:
    """Cut every face of a mesh where the planes x, y, z = k * ``cell`` cross it; neighbours stay joined."""
    import bmesh

    cloud = np.array([v.co for v in data.vertices])
    work = bmesh.new()
    work.from_mesh(data)
    for axis in range(3):
        normal = np.eye(3)[axis]
        low, high = cloud[:, axis].min(), cloud[:, axis].max()
        for k in range(int(np.floor(low / cell)) + 1, int(np.ceil(high / cell))):
            everything = [*work.verts, *work.edges, *work.faces]
            bmesh.ops.bisect_plane(work, geom=everything, dist=0.02 * cell, plane_co=normal * k * cell, plane_no=normal)
    work.to_mesh(data)
    work.free()


def shader(material: Material):
    """A Principled material of one constant colour; emission strength so that exitance = pi * strength * colour."""
    import bpy

    made = bpy.data.materials.new(material.name)
    if made.node_tree is None:  # Blender before 5.0
        made.use_nodes = True
    node = next(n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    node.inputs["Base Color"].default_value = (*material.reflectance, 1.0)
    node.inputs["Roughness"].default_value = 1.0
    node.inputs["Specular IOR Level"].default_value = 0.0
    strength = max(material.emission)
    if strength > 0:
        node.inputs["Emission Color"].default_value = (*(e / strength for e in material.emission), 1.0)
    node.inputs["Emission Strength"].default_value = strength / math.pi
    made.diffuse_color = (*material.reflectance, 1.0)
    return made


def camera(scene, view: View) -> None:
    """The scene's camera, its picture size and a neutral way to show linear light."""
    import bpy
    from mathutils import Vector

    data = bpy.data.cameras.new("Camera")
    data.lens, data.clip_end = view.lens, 500.0
    eye = Vector(view.eye)
    thing = bpy.data.objects.new("Camera", data)
    thing.location = eye
    thing.rotation_euler = (Vector(view.target) - eye).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(thing)
    scene.camera = thing
    scene.render.resolution_x, scene.render.resolution_y = view.size
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = view.exposure


def save(path: Path) -> None:
    """Save the open file, compressed and without the .blend1 copy of an older one."""
    import bpy

    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()), compress=True)


def _collection(name: str, parent):
    import bpy

    made = bpy.data.collections.new(name)
    parent.children.link(made)
    return made


def _behind(thing: Thing, view: View) -> bool:
    """True where the camera sees nothing but the backs of a thing's faces."""
    eye = np.array(view.eye)
    return all(np.dot(np.cross(f[1] - f[0], f[2] - f[0]), eye - f[0]) <= 0 for f in thing.faces)


def _show_rooms_from_outside() -> None:
    """Viewports that open with the file hide the backs of walls and ceilings, so that one looks into the rooms."""
    import bpy

    for screen in bpy.data.screens:
        for space in (area.spaces.active for area in screen.areas if area.type == "VIEW_3D"):
            space.shading.show_backface_culling = True
            if space.region_3d is not None:
                space.region_3d.view_perspective = "CAMERA"
