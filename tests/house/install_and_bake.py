"""Install the zip into a clean Blender profile and press Bake on a small lit box; prints what came of it as JSON.

Run as ``python install_and_bake.py ENFILADE.zip`` with BLENDER_USER_RESOURCES set to an empty folder.
"""

import json
import sys

import bpy
import numpy as np

MODULE = "bl_ext.user_default.enfilade"


def lit_box():
    """A closed grey box, 2 m wide, faces inward, whose ceiling shines."""
    bpy.data.batch_remove(list(bpy.data.objects))
    corners = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, 2)]
    faces = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    mesh = bpy.data.meshes.new("Box")
    mesh.from_pydata(corners, [], faces)
    for strength in (0.0, 3.0):
        material = bpy.data.materials.new(f"Paint {strength}")
        if material.node_tree is None:
            material.use_nodes = True
        node = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
        node.inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1.0)
        node.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        node.inputs["Emission Strength"].default_value = strength
        mesh.materials.append(material)
    mesh.polygons[1].material_index = 1
    box = bpy.data.objects.new("Box", mesh)
    bpy.context.scene.collection.objects.link(box)
    bpy.context.view_layer.update()
    return box


def main():
    import addon_utils  # Blender puts it on the path

    bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True, overwrite=True)
    found, enabled = addon_utils.check(MODULE)
    box = lit_box()
    result = bpy.ops.enfilade.bake()
    attribute = box.data.color_attributes[box.data.color_attributes.active_color_index]
    colors = np.zeros(len(attribute.data) * 4, np.float32)
    attribute.data.foreach_get("color", colors)
    colors = colors.reshape(-1, 4)
    print(
        json.dumps(
            {
                "blender": bpy.app.version_string,
                "installed": bool(enabled or found),
                "from": sys.modules[MODULE].__file__,
                "result": sorted(result),
                "name": attribute.name,
                "type": attribute.data_type,
                "domain": attribute.domain,
                "normals_z": [round(p.normal.z) for p in box.data.polygons],
                "loops": [list(p.loop_indices) for p in box.data.polygons],
                "colors": colors.tolist(),
            }
        )
    )
    addon_utils.disable(MODULE)


main()
