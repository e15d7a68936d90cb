# SPDX-License-Identifier: GPL-3.0-or-later
"""What a material reflects and emits, read from its nodes by their constant values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import bpy
import numpy as np

DEFAULT_REFLECTANCE = 0.8
"""Reflectance of a face without material, Blender's own grey."""


@dataclass
class Surface:
    """(3,) diffuse reflectance 0..1 and (3,) emitted radiant exitance, W/m2, linear RGB."""

    reflectance: np.ndarray = field(default_factory=lambda: np.zeros(3))
    emission: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def mixed(self, share: float, other: Surface, other_share: float) -> Surface:
        return Surface(
            share * self.reflectance + other_share * other.reflectance,
            share * self.emission + other_share * other.emission,
        )


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
    return Surface(np.clip(surface.reflectance, 0.0, 1.0), np.maximum(surface.emission, 0.0)), reader.warnings


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
            return Surface(self.color(node.inputs["Color"]))
        if node.type == "EMISSION":
            return Surface(emission=math.pi * self.value(node.inputs["Strength"]) * self.color(node.inputs["Color"]))
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
        emission = self.value(node.inputs["Emission Strength"])
        return Surface(
            self.color(node.inputs["Base Color"]) * (1.0 - metallic) * (1.0 - through),
            math.pi * emission * self.color(node.inputs["Emission Color"]) if emission else np.zeros(3),
        )

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

    def color(self, socket: bpy.types.NodeSocket) -> np.ndarray:
        """(3,) linear colour: that of the socket, of an RGB node, the mean of an image; otherwise the socket's own."""
        node = source_of(socket)
        if node is None:
            return np.array(socket.default_value[:3], float)
        if node.type == "RGB":
            return np.array(node.outputs[0].default_value[:3], float)
        if node.type == "TEX_IMAGE" and node.image is not None and node.image.size[0] > 0:
            mean = image_mean(node.image)
            self.warn(f"is textured by the image '{node.image.name}': its mean colour is taken")
            return mean
        self.warn(f"has nodes at the input '{socket.name}' that cannot be read: the colour of the input itself is taken")
        return np.array(socket.default_value[:3], float)


def source_of(socket: bpy.types.NodeSocket) -> bpy.types.Node | None:
    """The node that feeds a socket, reroutes skipped; None where nothing is plugged in."""
    for _ in range(256):
        if not socket.is_linked or socket.links[0].is_muted:
            return None
        node = socket.links[0].from_node
        if node.type != "REROUTE":
            return node
        socket = node.inputs[0]
    return None


def image_pixels(image: bpy.types.Image) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) float32 linear colour of the pixels of an image, row by row from the bottom, and (n,) their alpha."""
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(-1, image.channels)
    if image.channels < 3:
        pixels = np.repeat(pixels[:, :1], 3, axis=1)
    color, alpha = pixels[:, :3], pixels[:, 3] if image.channels == 4 else np.ones(len(pixels), np.float32)
    # Byte buffers hold values as in the file; float buffers are linear already.
    if not image.is_float and image.colorspace_settings.name == "sRGB":
        color = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    return color, alpha


def image_mean(image: bpy.types.Image) -> np.ndarray:
    """(3,) float64 mean of an image in linear colour, weighted by its alpha."""
    color, alpha = image_pixels(image)
    weight = alpha if alpha.sum() > 0 else np.ones_like(alpha)
    return np.average(color.astype(np.float64), axis=0, weights=weight)
