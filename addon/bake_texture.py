# SPDX-License-Identifier: GPL-3.0-or-later
"""Lightmaps: an image, and a UV map of their own on the meshes."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import bpy
import numpy as np

from ..core.photometry import recombined

SUFFIX = {"exr": ".exr", "png": ".png"}


def uv_name(name: str) -> str:
    """Name of the lightmap UV map; not the bare name, which a colour attribute may have: both share one name space."""
    return f"{name} UV"


def write_uv(mesh: bpy.types.Mesh, name: str, uv: np.ndarray) -> None:
    """Put texture coordinates (C, 2), 0..1, into a new UV map; the active one and the one for renders stay."""
    layers = mesh.uv_layers
    active = layers.active.name if layers.active is not None else ""
    render = next((layer.name for layer in layers if layer.active_render), "")
    made = layers.new(name=name, do_init=False)
    mesh.enfilade.uv_map = made.name
    layers[mesh.enfilade.uv_map].uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).ravel())
    if active:
        layers.active = layers[active]
    if render:
        layers[render].active_render = True


def remove_uv(mesh: bpy.types.Mesh) -> None:
    """Take away what :func:`write_uv` made."""
    layers, name = mesh.uv_layers, mesh.enfilade.uv_map
    if name and name in layers:
        active = layers.active.name if layers.active is not None else ""
        render = next((layer.name for layer in layers if layer.active_render), "")
        layers.remove(layers[name])
        if active in layers:
            layers.active = layers[active]
        if render in layers:
            layers[render].active_render = True
    mesh.enfilade.uv_map = ""
    mesh.enfilade.image = None


def write_image(name: str, pixels: np.ndarray, image_format: str, folder: str) -> bpy.types.Image:
    """An image of (H, W, 4) float32 linear pixels, saved in a folder or, without one, packed into the .blend file.

    EXR files hold the linear values in single precision, PNG files 16 bit of what a display shows of 0..1.
    """
    height, width = pixels.shape[:2]
    # As "data" the buffer reaches the file as it is; any other colour space would encode an EXR as well.
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=True)
    if image_format == "png":
        pixels = np.concatenate([display_encoded(pixels[:, :, :3]), pixels[:, :, 3:]], axis=2)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.update()
    image.file_format = {"exr": "OPEN_EXR", "png": "PNG"}[image_format]
    if folder:
        path = Path(folder) / (re.sub(r"[^\w .()-]", "_", image.name) + SUFFIX[image_format])
        image.filepath_raw = str(path)
        image.save()
        if image_format == "png":
            image = _reloaded(image, path)
    elif image_format == "png":
        # Packing a float buffer would make an EXR of it.
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "image.png"
            image.filepath_raw = str(path)
            image.save()
            image = _reloaded(image, path)
            image.pack()
        image.filepath_raw = ""
    else:
        image.pack()
    image.use_fake_user = True  # without a user it would not be saved
    image.enfilade.made = True
    return image


def keep(image: bpy.types.Image) -> None:
    """Put the pixels of an image from :func:`write_image` that were changed since to where they are saved: its file, or the .blend."""
    if image.packed_file is None:
        image.save()
    elif image.file_format == "PNG":
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "image.png"
            image.filepath_raw = str(path)
            image.save()
            packed = path.read_bytes()
            image.pack(data=packed, data_len=len(packed))
        image.filepath_raw = ""
    else:
        image.pack()


def recombine(image: bpy.types.Image, factors: Mapping[str, Sequence[float]]) -> None:
    """Add the light groups of an image up in its pixels; ``factors`` (3,) by their names, 1 for others.

    An image that has none, or has lost one of them or its size, is left as it is.
    """
    tags, size = image.enfilade, tuple(image.size)
    groups = [part.image for part in tags.parts]
    if not groups or any(group is None or tuple(group.size) != size or group.channels != image.channels for group in groups):
        return
    pixels = recombined(tags.quantity, map(_pixels, groups), [factors.get(part.name, (1.0, 1.0, 1.0)) for part in tags.parts])
    # Its file takes no more than a display shows, so nor does the image. From a PNG file the buffer is linear as well.
    image.pixels.foreach_set((np.clip(pixels, 0.0, 1.0) if image.file_format == "PNG" else pixels).ravel())
    image.update()


def _pixels(image: bpy.types.Image) -> np.ndarray:
    """(n, 4) float32."""
    out = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(out)
    return out.reshape(-1, image.channels)


def _reloaded(image: bpy.types.Image, path: Path) -> bpy.types.Image:
    name = image.name
    bpy.data.images.remove(image)
    image = bpy.data.images.load(str(path))
    image.name = name
    image.colorspace_settings.name = "sRGB"
    return image


def display_encoded(linear: np.ndarray) -> np.ndarray:
    """Linear values as sRGB (IEC 61966-2-1), limited to 0..1."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055).astype(np.float32)
