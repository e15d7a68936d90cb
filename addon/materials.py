# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials that show a bake: copies of the user's own in their place, so that theirs stay as they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy

from ..core.photometry import LUMINOUS_EFFICACY
from .shading import read_material


@dataclass(frozen=True)
class Display:
    """Where a material finds the bake: a colour attribute, or an image by its UV map; and what it holds.

    quantity : as in ``BakeOptions``;  open_backs : the backs of faces are invisible
    """

    quantity: str
    attribute: str = ""
    image: str = ""
    uv_map: str = ""
    open_backs: bool = False


def show(thing: bpy.types.Object, display: Display, made: dict[tuple[str, Display], bpy.types.Material]) -> None:
    """Give every slot of an object a copy of its material that shows the bake; ``made`` is shared between objects."""
    if not thing.material_slots:
        material = _display_material(None, display, made)
        material.enfilade.new_slot = True
        thing.data.materials.append(material)
        return
    for slot in thing.material_slots:
        if slot.material is None or not slot.material.enfilade.made:
            slot.material = _display_material(slot.material, display, made)


def hide(thing: bpy.types.Object) -> None:
    """Give the slots of an object their own materials back."""
    if len(thing.material_slots) == 1 and _is_new_slot(thing.material_slots[0].material):
        thing.data.materials.clear()
        return
    for slot in thing.material_slots:
        if slot.material is not None and slot.material.enfilade.made:
            slot.material = slot.material.enfilade.stands_for


def _is_new_slot(material: bpy.types.Material | None) -> bool:
    return material is not None and material.enfilade.made and material.enfilade.new_slot


def _display_material(original, display: Display, made) -> bpy.types.Material:
    key = (original.name_full if original is not None else "", display)
    if key in made:
        return made[key]
    name = original.name if original is not None else "No material"
    material = original.copy() if original is not None else bpy.data.materials.new(name)
    material.name = f"{name} (bake)"
    material.enfilade.made = True
    material.enfilade.stands_for = original
    if material.node_tree is None or (bpy.app.version < (5, 0) and not material.use_nodes):
        material.use_nodes = True
    _build(material, original, display)
    if hasattr(material, "cycles"):
        # What shows a bake is no lamp: Cycles need not search its light.
        material.cycles.emission_sampling = "NONE"
    made[key] = material
    return material


def _build(material: bpy.types.Material, original: bpy.types.Material | None, display: Display) -> None:
    """The nodes: bake, times what the quantity asks for, as an emission to an output of their own."""
    tree = material.node_tree
    before = tree.get_output_node("ALL")
    right = max((n.location.x for n in tree.nodes), default=0.0) + 300.0
    frame = tree.nodes.new("NodeFrame")
    frame.label = "Bake"

    def add(kind: str, column: int, row: int = 0) -> bpy.types.Node:
        node = tree.nodes.new(kind)
        node.location = (right + 220.0 * column, 300.0 - 220.0 * row)
        node.parent = frame
        return node

    def math_node(operation: str, column: int, a, b) -> bpy.types.NodeSocket:
        node = add("ShaderNodeVectorMath", column)
        node.operation = operation
        for socket, value in zip(node.inputs, (a, b), strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    if display.image:
        place = add("ShaderNodeUVMap", 0, 1)
        place.uv_map = display.uv_map
        picture = add("ShaderNodeTexImage", 1)
        picture.image = bpy.data.images[display.image]
        picture.extension = "EXTEND"
        tree.links.new(place.outputs[0], picture.inputs["Vector"])
        color = picture.outputs["Color"]
    else:
        node = add("ShaderNodeVertexColor", 1)
        node.layer_name = display.attribute
        color = node.outputs["Color"]
    if display.quantity == "lighting":
        surface = read_material(original)[0]
        color = math_node("MULTIPLY", 2, color, _base_color(before) or tuple(surface.reflectance))
        if surface.emission.any():
            color = math_node("ADD", 3, color, tuple(surface.emission / math.pi))
    elif display.quantity == "lux":
        color = math_node("MULTIPLY", 2, color, (1.0 / (math.pi * LUMINOUS_EFFICACY),) * 3)
    shader = add("ShaderNodeEmission", 4)
    tree.links.new(color, shader.inputs["Color"])
    light = shader.outputs[0]
    if display.open_backs:
        side, nothing, mix = add("ShaderNodeNewGeometry", 4, 1), add("ShaderNodeBsdfTransparent", 4, 2), add("ShaderNodeMixShader", 5)
        tree.links.new(side.outputs["Backfacing"], mix.inputs[0])
        tree.links.new(light, mix.inputs[1])
        tree.links.new(nothing.outputs[0], mix.inputs[2])
        light = mix.outputs[0]
    output = add("ShaderNodeOutputMaterial", 6)
    tree.links.new(light, output.inputs["Surface"])
    for node in tree.nodes:
        if node.type == "OUTPUT_MATERIAL":
            node.is_active_output = node == output
    tree.nodes.active = output


def _base_color(output: bpy.types.Node | None) -> bpy.types.NodeSocket | None:
    """What feeds the base colour of a material's one diffuse or Principled shader, where something does."""
    if output is None or not output.inputs["Surface"].is_linked:
        return None
    node = output.inputs["Surface"].links[0].from_node
    socket = (
        node.inputs.get("Base Color")
        if node.type == "BSDF_PRINCIPLED"
        else node.inputs.get("Color")
        if node.type == "BSDF_DIFFUSE"
        else None
    )
    return socket.links[0].from_socket if socket is not None and socket.is_linked else None


def painted_by(material: bpy.types.Material | None, mesh: bpy.types.Mesh) -> tuple[bpy.types.Image | None, str]:
    """The image that alone is the base colour of a material, and the UV map that it lies on; None where there is no such image."""
    tree = material.node_tree if material is not None else None
    if tree is None or (bpy.app.version < (5, 0) and not material.use_nodes):
        return None, ""
    socket = _base_color(tree.get_output_node("ALL"))
    node = socket.node if socket is not None else None
    if node is None or node.type != "TEX_IMAGE" or node.image is None or node.image.size[0] == 0 or socket.name != "Color":
        return None, ""
    place = node.inputs["Vector"].links[0].from_node if node.inputs["Vector"].is_linked else None
    if place is not None and place.type not in ("UVMAP", "TEX_COORD"):
        return None, ""
    if place is not None and place.type == "TEX_COORD" and node.inputs["Vector"].links[0].from_socket.name != "UV":
        return None, ""
    chosen = place.uv_map if place is not None and place.type == "UVMAP" else ""
    active = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    name = chosen if chosen in mesh.uv_layers else active
    return (node.image, name) if name else (None, "")
