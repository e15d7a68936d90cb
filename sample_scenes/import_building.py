# SPDX-License-Identifier: GPL-3.0-or-later
"""Turn a building .json (rooms, polygons, portals) or a scene .npz into a .blend with room and portal collections.

Run it: ``python -m enfilade.sample_scenes.import_building fzk-haus.json --out fzk-haus.blend``
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from ..core.scene import Scene
from ..core.scene_files import load_scene
from .model import Material, Opening
from .write import Thing, View, save_building

SIDES = ("east", "west", "north", "south", "top", "bottom")
SHELL = ("wall", "ceiling", "floor")


def write_building(scene: Scene, path: Path, cell: float) -> None:
    """Save a scene as a .blend file: an object for every object of the scene (walls one for each side), one per portal.

    Meshes are cut along a world grid of ``cell`` metres. Polygons with holes raise ValueError.
    """
    if (np.diff(scene.polygon_start) != 1).any():
        raise ValueError(f"{scene.name}: polygon {int(np.argmax(np.diff(scene.polygon_start) != 1))} has a hole; cut it into parts without")
    faces = np.split(scene.vertices[scene.corner_vertex], scene.loop_start[1:-1])
    looks = [tuple(row) for row in np.concatenate([scene.reflectance, scene.emission], axis=1).tolist()]
    names = {look: _material(look, i) for i, look in enumerate(dict.fromkeys(looks))}
    things: dict[tuple[str, int], Thing] = {}
    for p, face in enumerate(faces):
        name, room = scene.object_names[scene.object[p]], int(scene.room[p])
        shell = name.startswith(SHELL)
        if name.startswith("wall"):
            name = f"{name} {_side(face)}"
        thing = things.setdefault((name, room), Thing(name, room, [], [], shell))
        thing.faces.append(face)
        thing.materials.append(names[looks[p]])
    portals = scene.portals
    rooms = (*scene.room_names, "outside")
    openings = [
        Opening(f"{portals.names[k]}: {rooms[a]} to {rooms[b]}", portals.polygon(k), (int(a), int(b)))
        for k, (a, b) in enumerate(portals.rooms)
    ]
    save_building(scene.name, scene.room_names, list(things.values()), openings, path, _view(scene), cut=cell)


def _material(look: tuple[float, ...], index: int) -> Material:
    return Material(f"{'Lamp' if max(look[3:]) > 0 else 'Paint'} {index}", look[:3], look[3:])


def _side(face: np.ndarray) -> str:
    """Which side of its room a wall stands on, from the direction of its inward normal."""
    normal = np.cross(face[1:-1] - face[0], face[2:] - face[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    return SIDES[2 * axis + int(normal[axis] > 0)]


def _view(scene: Scene) -> View:
    """From above one of the long sides, far enough to see all; exposed for the light that the lamps send out."""
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    centre, size, lens = (low + high) / 2, (1280, 960), 50.0
    back = np.array([0.2, -0.62, 1.0] if high[0] - low[0] >= high[1] - low[1] else [0.62, 0.2, 1.0])
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back], axis=1)
    box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    seen = (box - centre) @ axes
    half = np.array([18.0 / lens, 18.0 / lens * size[1] / size[0]]) * 0.95
    eye = centre + back * float((np.abs(seen[:, :2]) / half + seen[:, 2:]).max())
    corner = scene.vertices[scene.corner_vertex]
    start = scene.loop_start[:-1]
    fan = corner - np.repeat(corner[start], np.diff(scene.loop_start), axis=0)
    area = 0.5 * np.linalg.norm(np.add.reduceat(np.cross(fan, np.roll(fan, -1, axis=0)), start), axis=1)
    # Average radiance of a closed space: emitted power over absorbing area, times reflectance, over pi.
    rho = scene.reflectance.mean(axis=1)
    power = float((scene.emission.mean(axis=1) * area).sum())
    radiance = power / max(float(((1 - rho) * area).sum()), 1e-9) * float((rho * area).sum() / area.sum()) / math.pi
    exposure = math.log2(0.4 / radiance) if radiance > 0 else 0.0
    return View(tuple(eye), tuple(centre), lens, size, exposure=round(exposure, 1))


def main() -> None:
    """Read a building and write a .blend file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("building", type=Path, help="building .json or scene .npz")
    parser.add_argument("--out", required=True, type=Path, help=".blend file to write (needs bpy)")
    parser.add_argument("--cell", type=float, default=0.25, help="width of the grid that cuts the faces (m), 0: faces as they are [0.25]")
    given = parser.parse_args()
    write_building(load_scene(given.building), given.out, given.cell)
    print(f"written: {given.out}")


if __name__ == "__main__":
    main()
