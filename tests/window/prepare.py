"""Make the plain model that the window test begins with: the sample apartment as one mesh, doors in its openings, nothing set up.

Run by ``blender --background --python prepare.py -- APARTMENT.blend PLAIN.blend``. The doors are left selected.
"""

import sys

import bpy
from mathutils import Vector

source, target = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.open_mainfile(filepath=source)
scene = bpy.context.scene
for portal in list(bpy.data.collections["Portals"].objects):
    corners = [portal.matrix_world @ v.co for v in portal.data.vertices]
    middle = sum(corners, Vector()) / len(corners)
    normal = portal.matrix_world.to_3x3() @ portal.data.polygons[0].normal
    leaf = [middle + 0.97 * (c - middle) for c in corners]
    vertices = [c + side * 0.02 * normal.normalized() for side in (-1, 1) for c in leaf]
    n = len(leaf)
    faces = [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *((k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n))]
    mesh = bpy.data.meshes.new(f"Door {portal.name}")
    mesh.from_pydata(vertices, [], faces)
    scene.collection.objects.link(bpy.data.objects.new(mesh.name, mesh))
    bpy.data.objects.remove(portal)
things = [o for o in scene.objects if o.type == "MESH" and not o.name.startswith("Door ")]
for thing in things:
    if thing.name not in scene.collection.objects:
        scene.collection.objects.link(thing)
for collection in list(bpy.data.collections):
    bpy.data.collections.remove(collection)
bpy.context.view_layer.update()
for thing in scene.objects:
    thing.select_set(thing in things)
bpy.context.view_layer.objects.active = things[0]
bpy.ops.object.join()
bpy.context.object.name = "House"
for thing in scene.objects:
    thing.select_set(thing.name.startswith("Door "))
bpy.ops.wm.save_as_mainfile(filepath=target)
