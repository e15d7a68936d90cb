# SPDX-License-Identifier: GPL-3.0-or-later
"""What a material reflects and emits, read from its nodes by their constant values and images."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from .pictures import Texture, image_mean, source_of, texture_of

DEFAULT_REFLECTANCE = 0.8
"""Reflectance of a face without material, Blender's own grey."""


@dataclass(frozen=True)
class Layer:
    """What a texture contributes to a surface: ``factor`` times its colour. mean : (3,) colour of the whole image."""

    texture: Texture
    mean: np.ndarray
    factor: float


@dataclass
class Surface:
    """(3,) diffuse reflectance 0..1 and (3,) emitted radiant exitance, W/m2, linear RGB, with the means of textures.

    reflecting, emitting : the textures that are in these
    """

    reflectance: np.ndarray = field(default_factory=lambda: np.zeros(3))
    emission: np.ndarray = field(default_factory=lambda: np.zeros(3))
    reflecting: tuple[Layer, ...] = ()
    emitting: tuple[Layer, ...] = ()

    @property
    def uv_maps(self) -> set[str]:
        """The names of those that its textures lie on, the empty one for that which renders take."""
        return {layer.texture.uv_map for layer in (*self.reflecting, *self.emitting)}

    def mixed(self, share: float, other: Surface, other_share: float) -> Surface:
        return Surface(
            share * self.reflectance + other_share * other.reflectance,
            share * self.emission + other_share * other.emission,
            _scaled(self.reflecting, share) + _scaled(other.reflecting, other_share),
            _scaled(self.emitting, share) + _scaled(other.emitting, other_share),
        )


def _scaled(layers: tuple[Layer, ...], factor: float) -> tuple[Layer, ...]:
    return tuple(replace(layer, factor=factor * layer.factor) for layer in layers) if factor else ()


def read_material(material: bpy.types.Material | None) -> tuple[Surface, list[str]]:
    """The surface that a material describes, and warnings about what was simplified.

    A shader of radiance L (Emission, Principled) has the exitance pi L. Materials that a bake made are not read:
    the material that they stand for is.
    """
    if material is not None and material.enfilade.made:
        material = material.enfilade.stands_for
    if material is None:
        return Surface(np.full(3, DEFAULT_REFLECTANCE)), []
    reader = _Reader(material.name)
    tree = material.node_tree
    # Touching use_nodes warns from Blender 5.0 on, where every material has its nodes.
    if tree is None or (bpy.app.version < (5, 0) and not material.use_nodes):
        return Surface(np.clip(np.array(material.diffuse_color[:3], float), 0.0, 1.0)), []
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    surface = reader.shader(output.inputs["Surface"], 0) if output is not None else Surface()
    if (surface.reflectance > 1.0).any() or (surface.reflectance < 0.0).any() or (surface.emission < 0.0).any():
        reader.warn("reflects more than it receives or less than nothing: limited to what is possible")
    return replace(surface, reflectance=np.clip(surface.reflectance, 0.0, 1.0), emission=np.maximum(surface.emission, 0.0)), reader.warnings


class _Reader:
    """Walks the nodes of one material from its output back."""

    def __init__(self, name: str):
        self.name = name
        self.warnings: list[str] = []

    def warn(self, what: str) -> None:
        text = f"material '{self.name}' {what}"
        if text not in self.warnings:
            self.warnings.append(text)

    def shader(self, socket: bpy.types.NodeSocket, depth: int) -> Surface:
        node = source_of(socket)
        if node is None or depth > 64:
            return Surface()
        if node.mute:
            return Surface()
        if node.type == "BSDF_PRINCIPLED":
            return self._principled(node)
        if node.type == "BSDF_DIFFUSE":
            color, layers = self.color(node.inputs["Color"])
            return Surface(color, reflecting=layers)
        if node.type == "EMISSION":
            strength = math.pi * self.value(node.inputs["Strength"])
            color, layers = self.color(node.inputs["Color"])
            return Surface(emission=strength * color, emitting=_scaled(layers, strength))
        if node.type == "MIX_SHADER":
            share = min(max(self.value(node.inputs[0], 0.5), 0.0), 1.0)
            return self.shader(node.inputs[1], depth + 1).mixed(1.0 - share, self.shader(node.inputs[2], depth + 1), share)
        if node.type == "ADD_SHADER":
            return self.shader(node.inputs[0], depth + 1).mixed(1.0, self.shader(node.inputs[1], depth + 1), 1.0)
        self.warn(f"has a {node.bl_label} node, which gives no diffuse light: taken as black and opaque")
        return Surface()

    def _principled(self, node: bpy.types.Node) -> Surface:
        metallic = min(max(self.value(node.inputs["Metallic"]), 0.0), 1.0)
        through = min(max(self.value(node.inputs["Transmission Weight"]), 0.0), 1.0)
        if through > 0.0 or self.value(node.inputs["Alpha"], 1.0) < 1.0:
            self.warn("lets light through: taken as opaque")
        diffuse = (1.0 - metallic) * (1.0 - through)
        color, layers = self.color(node.inputs["Base Color"])
        surface = Surface(color * diffuse, reflecting=_scaled(layers, diffuse))
        emission = math.pi * self.value(node.inputs["Emission Strength"])
        if emission:
            color, layers = self.color(node.inputs["Emission Color"])
            surface = replace(surface, emission=emission * color, emitting=_scaled(layers, emission))
        return surface

    def value(self, socket: bpy.types.NodeSocket, unknown: float | None = None) -> float:
        """A number: that of the socket or of a Value node; otherwise ``unknown``, or the socket's own."""
        node = source_of(socket)
        if node is None:
            return float(socket.default_value)
        if node.type == "VALUE":
            return float(node.outputs[0].default_value)
        fallback = float(socket.default_value) if unknown is None else unknown
        self.warn(f"has nodes at the input '{socket.name}' that cannot be read: {fallback:g} is taken")
        return fallback

    def color(self, socket: bpy.types.NodeSocket) -> tuple[np.ndarray, tuple[Layer, ...]]:
        """(3,) linear colour: that of the socket, of an RGB node, the mean of an image, with its layer; otherwise the socket's own."""
        node = source_of(socket)
        if node is None:
            return np.array(socket.default_value[:3], float), ()
        if node.type == "RGB":
            return np.array(node.outputs[0].default_value[:3], float), ()
        if node.type == "TEX_IMAGE" and node.image is not None and node.image.size[0] > 0:
            mean = image_mean(node.image, node.outputs["Alpha"].is_linked)
            texture = texture_of(node)
            if texture is not None:
                return mean, (Layer(texture, mean, 1.0),)
            self.warn(f"is textured by the image '{node.image.name}' without a UV map: its mean colour is taken")
            return mean, ()
        if node.type == "TEX_IMAGE":
            name = f"the image '{node.image.name}'" if node.image is not None else "an Image Texture without image"
            self.warn(f"has {name} at the input '{socket.name}', which is missing: the colour of the input itself is taken, find the file")
        else:
            self.warn(f"has nodes at the input '{socket.name}' that cannot be read: the colour of the input itself is taken")
        return np.array(socket.default_value[:3], float), ()
