# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as textures: their pixels, and where on a mesh they lie."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..core.picture_sums import PictureSums


@dataclass(frozen=True)
class Texture:
    """An image on a mesh.

    uv_map : its name, empty for the one that renders take;  turn : (2, 3) from the coordinates (u, v, 1) there to those of the image
    extension : as in :class:`PictureSums`;  smooth : interpolated between pixels
    cut_out : what is see-through does not count, otherwise it is black
    """

    image: bpy.types.Image
    uv_map: str
    turn: np.ndarray
    extension: str
    smooth: bool
    cut_out: bool


def texture_of(node: bpy.types.Node) -> Texture | None:
    """What an Image Texture node shows; None where it has no image or does not lie on a UV map."""
    if node.image is None or node.image.size[0] == 0 or node.image.source == "TILED" or node.projection != "FLAT":
        return None
    turn = np.eye(2, 3)
    plug = plug_of(node.inputs["Vector"])
    if plug is not None and plug.node.type == "MAPPING":
        turn, plug = _mapped(plug.node), plug_of(plug.node.inputs["Vector"])
        if turn is None or plug is None:
            return None
    uv_map = ""
    if plug is not None and plug.node.type == "UVMAP":
        uv_map = plug.node.uv_map
    elif plug is not None and (plug.node.type != "TEX_COORD" or plug.name != "UV"):
        return None
    cut_out = node.outputs["Alpha"].is_linked
    return Texture(node.image, uv_map, turn, node.extension, node.interpolation != "Closest", cut_out)


def _mapped(node: bpy.types.Node) -> np.ndarray | None:
    """(2, 3) what a Mapping node does to texture coordinates; None where it cannot be read."""
    if node.vector_type == "NORMAL" or any(s.is_linked for s in node.inputs if s.name != "Vector"):
        return None
    turned = rotation(node.inputs["Rotation"].default_value)
    scale = np.array(node.inputs["Scale"].default_value, float)
    moved = np.array(node.inputs["Location"].default_value, float) if node.vector_type != "VECTOR" else np.zeros(3)
    if node.vector_type == "TEXTURE":
        linear = turned.T / np.where(scale != 0, scale, 1.0)[:, None]
        moved = -linear @ moved
    else:
        linear = turned * scale
    return np.column_stack([linear[:2, :2], moved[:2]])


def rotation(angles: tuple[float, float, float]) -> np.ndarray:
    """(3, 3) the rotation about x, then y, then z by ``angles``, radians."""
    turns = []
    for axis, angle in enumerate(angles):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        turns.append(turn)
    return turns[2] @ turns[1] @ turns[0]


def plug_of(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """The output that feeds a socket, reroutes skipped; None where nothing is plugged in."""
    for _ in range(256):
        if not socket.is_linked or socket.links[0].is_muted:
            return None
        if socket.links[0].from_node.type != "REROUTE":
            return socket.links[0].from_socket
        socket = socket.links[0].from_node.inputs[0]
    return None


def source_of(socket: bpy.types.NodeSocket) -> bpy.types.Node | None:
    """The node that feeds a socket, as in :func:`plug_of`."""
    plug = plug_of(socket)
    return plug.node if plug is not None else None


def image_pixels(image: bpy.types.Image, cut_out: bool = False) -> np.ndarray:
    """(H, W, 4) float32 linear colour times alpha, and alpha, of the pixels of an image, row 0 at the bottom.

    cut_out : where alpha is made use of, Cycles takes colours as they are, else bytes times alpha, and only then are they made linear
    """
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(-1, image.channels)
    out = np.ones((len(pixels), 4), np.float32)
    out[:, :3] = pixels[:, :3] if image.channels >= 3 else pixels[:, :1]
    if image.channels == 4 and image.alpha_mode not in ("NONE", "CHANNEL_PACKED"):
        out[:, 3] = pixels[:, 3]
    if image.is_float:  # linear, and multiplied with alpha
        return out.reshape(height, width, 4)
    if not cut_out:
        out[:, :3] *= out[:, 3:]
    if image.colorspace_settings.name == "sRGB":
        linear = np.arange(256) / 255.0
        linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4).astype(np.float32)
        out[:, :3] = linear[np.round(np.clip(out[:, :3], 0.0, 1.0) * 255.0).astype(np.uint8)]
    if cut_out:
        out[:, :3] *= out[:, 3:]
    return out.reshape(height, width, 4)


def shown(mean: np.ndarray, cut_out: bool) -> np.ndarray:
    """(.., 3) colours of means (.., 4) of pixels as in :func:`image_pixels`."""
    return mean[..., :3] / np.maximum(mean[..., 3:], 1e-6) if cut_out else mean[..., :3]


def image_mean(image: bpy.types.Image, cut_out: bool) -> np.ndarray:
    """(3,) float64 mean of an image in linear colour."""
    return shown(image_pixels(image, cut_out).mean(axis=(0, 1), dtype=np.float64), cut_out)


def sums_of(texture: Texture) -> PictureSums:
    """The picture of a texture, to be asked for means over parts of it."""
    return PictureSums(image_pixels(texture.image, texture.cut_out), texture.extension, texture.smooth)
