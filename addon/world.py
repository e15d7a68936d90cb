# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as a sky: its colour and strength, or its environment image, of which what is as bright as a sun becomes one."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.lamps import Sky, Suns, no_suns
from ..core.sky_maps import sky_of_image
from .pictures import image_pixels, rotation, source_of


def read_world(world: bpy.types.World | None, warnings: list[str]) -> tuple[Sky | None, Suns]:
    """The sky of a world, None where it is black, and the suns that its image has."""
    if world is None:
        return None, no_suns()
    tree = world.node_tree
    if tree is None or (bpy.app.version < (5, 0) and not world.use_nodes):
        return _even(world, np.array(world.color[:3], float)), no_suns()
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    node = source_of(output.inputs["Surface"]) if output is not None else None
    if node is None or node.mute:
        return None, no_suns()
    if node.type not in ("BACKGROUND", "EMISSION"):
        warnings.append(f"the world '{world.name}' has a {node.bl_label} node where Background is due: it is taken as black")
        return None, no_suns()
    strength = node.inputs["Strength"]
    value = source_of(strength)
    if value is not None and value.type != "VALUE":
        warnings.append(f"the world '{world.name}' has nodes at the input 'Strength' that cannot be read: its own value is taken")
    number = value.outputs[0] if value is not None and value.type == "VALUE" else strength
    strength = float(number.default_value)
    color = node.inputs["Color"]
    source = source_of(color)
    if source is not None and source.type == "TEX_ENVIRONMENT":
        return _image(world, source, strength, warnings)
    if source is not None and source.type != "RGB":
        what = "its own colour is taken; render it to an image and use an Environment Texture"
        warnings.append(f"the world '{world.name}' has a {source.bl_label} node that cannot be read: {what}")
    socket = source.outputs[0] if source is not None and source.type == "RGB" else color
    return _even(world, strength * np.array(socket.default_value[:3], float)), no_suns()


def _even(world: bpy.types.World, radiance: np.ndarray) -> Sky | None:
    return Sky(world.name, radiance.astype(np.float32)[None, None]) if (radiance > 0).any() else None


def _image(world: bpy.types.World, node: bpy.types.Node, strength: float, warnings: list[str]) -> tuple[Sky | None, Suns]:
    image = node.image
    if image is None or image.size[0] == 0:
        name = f"the image '{image.name}'" if image is not None else "the Environment Texture"
        warnings.append(f"{name} of the world '{world.name}' is missing, so its sky is black: find the file or choose another image")
        return None, no_suns()
    if node.projection != "EQUIRECTANGULAR":
        warnings.append(f"the image of the world '{world.name}' is a mirror ball: it is taken as equirectangular, choose such an image")
    if strength <= 0:
        return None, no_suns()
    color = image_pixels(image)[:, :, :3]
    turn = _rotation(node, world.name, warnings)
    return sky_of_image(world.name, strength * color, turn)


def _rotation(node: bpy.types.Node, name: str, warnings: list[str]) -> np.ndarray:
    """(3, 3) the rotation from directions of the world to those of the image."""
    mapping = source_of(node.inputs["Vector"])
    if mapping is None or mapping.type == "TEX_COORD":
        return np.eye(3)
    if mapping.type != "MAPPING":
        warnings.append(f"the world '{name}' has a {mapping.bl_label} node before its image that cannot be read: it is left out")
        return np.eye(3)
    forth = rotation(mapping.inputs["Rotation"].default_value)
    return forth.T if mapping.vector_type == "TEXTURE" else forth
