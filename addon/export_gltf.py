# SPDX-License-Identifier: GPL-3.0-or-later
"""A baked scene as a binary glTF file for web viewers: meshes in world coordinates with unlit materials that show the bake."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from ..core.glb_files import GlbMaterial, GlbMesh, GlbPart, write_glb
from ..core.photometry import LUMINOUS_EFFICACY
from ..core.png_files import png
from ..core.scene import SceneError
from .bake_texture import display_encoded
from .materials import painted_by
from .membership import everything_evaluated
from .mesh_arrays import bulk, read_mesh
from .shading import read_material


@dataclass(frozen=True)
class Exported:
    """What went into a file: names of objects, and what the user should know."""

    objects: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass
class _Book:
    """The materials and images of a file, each once."""

    exposure: float
    double_sided: bool
    materials: list[GlbMaterial] = field(default_factory=list)
    images: list[tuple[str, bytes]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    _image_of: dict[tuple[str, float], int] = field(default_factory=dict)

    def material(self, made: GlbMaterial) -> int:
        if made not in self.materials:
            self.materials.append(made)
        return self.materials.index(made)

    def image(self, image: bpy.types.Image, factor: float) -> int:
        """Index of an image in the file, with linear values times ``factor``."""
        key = (image.name_full, factor)
        if key not in self._image_of:
            self._image_of[key] = len(self.images)
            self.images.append((image.name, png(_display_pixels(image, factor))))
        return self._image_of[key]


def export(context: bpy.types.Context, path: str | Path, exposure: float = 0.0, double_sided: bool = False) -> Exported:
    """Write everything in the scene that carries a bake.

    exposure : stops by which the light is made brighter;  double_sided : show also the backs of faces
    Colours are the radiance of the lit surfaces, W/(m2 sr), times 2**exposure, limited to 0..1 as the format demands: COLOR_0
    linear in single precision, textures as sRGB of eight bits. Lengths are metres, y is up.
    Raises SceneError when nothing carries a bake, OSError when the file cannot be written.
    """
    scene, view_layer = context.scene, context.view_layer
    carriers = [o for o in scene.objects if o.type == "MESH" and not o.hide_render and (o.data.enfilade.attribute or o.data.enfilade.image)]
    if not carriers:
        raise SceneError("nothing in this scene carries a bake: bake first, then export")
    book, meshes = _Book(exposure, double_sided), []
    with everything_evaluated(scene, view_layer):
        depsgraph = context.evaluated_depsgraph_get()
        for thing in carriers:
            parts = _parts(thing, thing.evaluated_get(depsgraph), scene.unit_settings.scale_length, book)
            if parts:
                meshes.append(GlbMesh(thing.name, tuple(parts)))
    quantity = sorted({o.data.enfilade.quantity for o in carriers})
    unit = "W/(m2 sr) * 2**exposure, limited to 0..1"
    notes = {"quantity": quantity[0] if len(quantity) == 1 else quantity, "exposure": exposure, "unit": unit}
    write_glb(path, meshes, book.materials, book.images, {"enfilade": notes})
    return Exported(tuple(mesh.name for mesh in meshes), tuple(dict.fromkeys(book.warnings)))


def _parts(thing: bpy.types.Object, evaluated: bpy.types.Object, scale: float, book: _Book) -> list[GlbPart]:
    """The triangles of an object by their materials. Modifiers carry attributes and UV maps along."""
    tags = thing.data.enfilade
    mesh = evaluated.to_mesh()
    try:
        if tags.attribute and tags.attribute not in mesh.color_attributes:
            book.warnings.append(f"object '{thing.name}' is left out: its modifiers take the colours of the bake away")
            return []
        arrays = read_mesh(mesh, np.array(evaluated.matrix_world), scale)
        if len(arrays.triangle) == 0:
            return []
        color = _corner_colors(mesh, tags.attribute) if tags.attribute else None
        slots = [slot.material for slot in thing.material_slots] or [None]
        slot = np.clip(arrays.material[arrays.triangle_face], 0, len(slots) - 1)
        triangle = arrays.triangle[:, ::-1] if arrays.mirrored else arrays.triangle
        corner = arrays.position[arrays.corner_vertex[triangle]]
        parts = []
        for number in np.unique(slot):
            here = slot == number
            made, tint, glow, uv_map = _look(thing, slots[number], tags, book)
            factor = 2.0**book.exposure
            shown = np.clip((color[triangle[here]] * tint + glow) * factor, 0.0, 1.0) if color is not None else None
            uv = bulk(mesh.uv_layers[uv_map].uv, "vector", np.float32, 2)[triangle[here]] if uv_map else None
            parts.append(GlbPart(corner[here], shown, uv, book.material(made)))
        return parts
    finally:
        evaluated.to_mesh_clear()


def _look(thing: bpy.types.Object, material, tags, book: _Book) -> tuple[GlbMaterial, np.ndarray, np.ndarray, str]:
    """How the bake of one slot is shown: the material, what stored values are multiplied with and what is added, and a UV map."""
    original = material.enfilade.stands_for if material is not None and material.enfilade.made else material
    name = original.name if original is not None else "No material"
    surface, one, none = read_material(original)[0], np.ones(3), np.zeros(3)
    glow = surface.emission / math.pi
    if tags.image is not None:
        scale = 2.0**book.exposure * (1.0 / (math.pi * LUMINOUS_EFFICACY) if tags.quantity == "lux" else 1.0)
        image, factor = book.image(tags.image, scale), one
        if tags.quantity == "lighting":
            factor = surface.reflectance
            if glow.any():
                book.warnings.append(f"material '{name}' glows: in a texture of lighting only it shows its own light alone")
                made = GlbMaterial(name, _triple(glow * 2.0**book.exposure), double_sided=book.double_sided)
                return made, one, none, ""
        return GlbMaterial(name, _triple(factor), image, double_sided=book.double_sided), one, none, tags.uv_map
    if tags.quantity == "lux":
        return GlbMaterial(name, double_sided=book.double_sided), one / (math.pi * LUMINOUS_EFFICACY), none, ""
    if tags.quantity == "radiosity":
        return GlbMaterial(name, double_sided=book.double_sided), one, none, ""
    if glow.any():
        return GlbMaterial(name, double_sided=book.double_sided), surface.reflectance, glow, ""
    image, uv_map = painted_by(original, thing.data)
    if image is not None:
        return GlbMaterial(name, image=book.image(image, 1.0), repeat=True, double_sided=book.double_sided), one, none, uv_map
    return GlbMaterial(name, _triple(surface.reflectance), double_sided=book.double_sided), one, none, ""


def _triple(color: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = (float(c) for c in color)
    return red, green, blue


def _corner_colors(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """(C, 3) float64."""
    made = mesh.color_attributes[name]
    color = bulk(made.data, "color", np.float32, 4)[:, :3].astype(np.float64)
    return color if made.domain == "CORNER" else color[bulk(mesh.loops, "vertex_index", np.int32)]


def _display_pixels(image: bpy.types.Image, factor: float) -> np.ndarray:
    """(H, W, 3) uint8 sRGB pixels of an image with its linear values times ``factor``, row 0 at the top."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, image.channels)[::-1]
    color = pixels[:, :, :3] if image.channels >= 3 else np.repeat(pixels[:, :, :1], 3, axis=2)
    # Byte buffers hold what is in the file, float buffers linear light.
    if image.is_float or image.colorspace_settings.name != "sRGB":
        color = display_encoded(color * np.float32(factor))
    return np.round(np.clip(color, 0.0, 1.0) * 255.0).astype(np.uint8)
