# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes portals: from faces that fill an opening, or from a door or a window that stands in it."""

from __future__ import annotations

import math
from collections.abc import Iterable

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector

from .roles import PORTALS, home_of

FLAT = math.radians(1.0)
"""Faces whose normals differ by less make one portal."""
REACH = 0.25
"""A door or window may be this much smaller than its opening on every side, metres."""
_STEP = 1e-4


def add_portal(scene: bpy.types.Scene, name: str, loops: Iterable[Iterable[Vector]]) -> bpy.types.Object:
    """A new portal object with these faces, corners in the world; it lies in the scene's collection of portals."""
    mesh = bpy.data.meshes.new(name)
    loops = [list(loop) for loop in loops]
    middle = sum((v for loop in loops for v in loop), Vector()) / sum(map(len, loops))
    corners = [v - middle for loop in loops for v in loop]
    numbers = iter(range(len(corners)))
    mesh.from_pydata(corners, [], [[next(numbers) for _ in loop] for loop in loops])
    thing = bpy.data.objects.new(name, mesh)
    thing.location = middle
    thing.display_type = "WIRE"
    thing.hide_render = True
    home_of(scene, PORTALS, "PORTALS").objects.link(thing)
    return thing


def loops_of_faces(mesh: bmesh.types.BMesh, matrix: Matrix) -> list[list[Vector]]:
    """Outlines, in the world, of what the selected faces of a mesh in edit mode fill.

    Flat neighbours are one opening, cut where it would not be convex. A body that is selected all around, such as a pane with
    both of its sides, gives the rectangle through its middle.
    """
    copy = mesh.copy()
    try:
        bmesh.ops.delete(copy, geom=[f for f in copy.faces if not f.select], context="FACES")
        loops = []
        for island in _islands(copy):
            area = sum(f.calc_area() for f in island)
            if sum((f.normal * f.calc_area() for f in island), Vector()).length < 0.1 * area:
                loops.append(middle_of_box([v.co for f in island for v in f.verts], matrix))
                bmesh.ops.delete(copy, geom=island, context="FACES")
        bmesh.ops.dissolve_limit(copy, angle_limit=FLAT, verts=copy.verts, edges=copy.edges)
        bmesh.ops.connect_verts_concave(copy, faces=copy.faces)
        return loops + [[matrix @ v.co for v in f.verts] for f in copy.faces]
    finally:
        copy.free()


def _islands(mesh: bmesh.types.BMesh) -> list[list[bmesh.types.BMFace]]:
    """The faces of a mesh that hang together by edges."""
    left, islands = dict.fromkeys(mesh.faces), []
    while left:
        queue = [next(iter(left))]
        del left[queue[0]]
        for face in queue:
            for near in (f for e in face.edges for f in e.link_faces):
                if near in left:
                    del left[near]
                    queue.append(near)
        islands.append(queue)
    return islands


def middle_of_box(points: Iterable[Vector], matrix: Matrix) -> list[Vector]:
    """Corners, in the world, of the rectangle half way through the bounding box of points along the thinnest of its sides."""
    at = np.array([tuple(p) for p in points])
    low, high = at.min(axis=0), at.max(axis=0)
    thin = int(((high - low) * np.array(matrix.to_scale())).argmin())
    u, v = (thin + 1) % 3, (thin + 2) % 3
    corners = []
    for a, b in ((low[u], low[v]), (high[u], low[v]), (high[u], high[v]), (low[u], high[v])):
        corner = 0.5 * (low + high)
        corner[u], corner[v] = a, b
        corners.append(matrix @ Vector(corner))
    return corners


def fitted(context: bpy.types.Context, corners: list[Vector], skip: set[bpy.types.Object]) -> list[Vector]:
    """A rectangle whose sides are moved outward to the surfaces around it, where such are near; ``skip`` are looked through."""
    depsgraph = context.evaluated_depsgraph_get()
    reach = REACH / context.scene.unit_settings.scale_length
    middle = sum(corners, Vector()) / 4
    half = [(corners[1] - corners[0]) / 2, (corners[3] - corners[0]) / 2]
    ends = []
    for axis, other in ((0, 1), (1, 0)):
        length = half[axis].length
        along = half[axis].normalized()
        for sign in (-1, 1):
            starts = [middle + share * half[other] for share in (-0.9, -0.45, 0.0, 0.45, 0.9)]
            ways = [_clear(context.scene, depsgraph, start, sign * along, length + reach, skip) for start in starts]
            near = [w for w in ways if w is not None and w > 0.5 * length]
            ends.append(min(near) if near else length)
    u, v = half[0].normalized(), half[1].normalized()
    left, right, down, up = ends
    return [middle + a * u + b * v for a, b in ((-left, -down), (right, -down), (right, up), (-left, up))]


def _clear(scene, depsgraph, start: Vector, direction: Vector, reach: float, skip: set) -> float | None:
    """How far one can go from a place before anything but ``skip`` is met; None where that is farther than ``reach``."""
    gone = 0.0
    for _ in range(64):
        hit, at, _normal, _face, thing, _matrix = scene.ray_cast(depsgraph, start + gone * direction, direction, distance=reach - gone)
        if not hit:
            return None
        gone = (at - start).length
        if thing.original not in skip:
            return gone
        gone += _STEP
        if gone >= reach:
            return None
    return None
