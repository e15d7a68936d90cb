# SPDX-License-Identifier: GPL-3.0-or-later
"""What the polygons of a mesh reflect and emit: the constants of their materials, and the means of their images over each of them."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.charts import coplanar_faces
from ..core.corners import face_area_vectors
from ..core.faces import PlanarFaces
from ..core.patch_means import patch_means
from ..core.picture_sums import PictureSums
from .mesh_arrays import MeshArrays
from .pictures import Texture, shown, sums_of
from .shading import Layer, Surface, read_material

EMITTING_CELLS = 8
"""A flat part of a mesh that shines by an image is resolved into about as many parts along its longer side."""

REFLECTING_CELLS = 4

EMISSION_TOLERANCE = 0.02
"""Parts whose emission differs from the mean of their flat part by less, relative to it, share it."""

REFLECTANCE_TOLERANCE = 0.05


class Palette:
    """Materials and images, each read once; ``warnings`` are added to."""

    def __init__(self, warnings: list[str]):
        self._warnings = warnings
        self._surfaces: dict[bpy.types.Material | None, Surface] = {}
        self._sums: dict[tuple[bpy.types.Image, str, bool], PictureSums] = {}

    def surface(self, material: bpy.types.Material | None) -> Surface:
        """That of a material, not of a copy of it that was evaluated."""
        if material not in self._surfaces:
            self._surfaces[material], said = read_material(material)
            self._warnings.extend(said)
        return self._surfaces[material]

    def colors(self, mesh: MeshArrays, faces: PlanarFaces, surfaces: list[Surface]) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) reflectance and (P, 3) emitted exitance, W/m2, of the polygons of a mesh; ``surfaces`` are those of its slots."""
        # Slots beyond the last show as the last, as in Blender.
        slot = np.clip(mesh.material[faces.face], 0, len(surfaces) - 1)
        reflectance = np.array([s.reflectance for s in surfaces])[slot]
        emission = np.array([s.emission for s in surfaces])[slot]
        for number, surface in enumerate(surfaces):
            own = np.flatnonzero(slot == number)
            if len(own) and (surface.reflecting or surface.emitting):
                around = _Polygons(mesh, faces, own)
                if surface.reflecting:
                    value = np.clip(self._painted(around, surface.reflecting, surface.reflectance), 0.0, 1.0)
                    reflectance[own] = around.gathered(value, REFLECTING_CELLS, REFLECTANCE_TOLERANCE)
                if surface.emitting:
                    value = np.maximum(self._painted(around, surface.emitting, surface.emission), 0.0)
                    scale = max(float(value.max()), 1e-300)
                    emission[own] = scale * around.gathered(value / scale, EMITTING_CELLS, EMISSION_TOLERANCE)
        return reflectance, emission

    def _painted(self, around: _Polygons, layers: tuple[Layer, ...], whole: np.ndarray) -> np.ndarray:
        """(p, 3) colours of polygons whose mean is ``whole`` where the whole of each image is taken."""
        out = np.tile(whole, (len(around.own), 1))
        for layer in layers:
            uv = around.mesh.uv.get(layer.texture.uv_map)
            if uv is not None:
                out += layer.factor * (around.means(uv, layer.texture, self._sums_of(layer.texture)) - layer.mean)
        return out

    def _sums_of(self, texture: Texture) -> PictureSums:
        key = (texture.image, texture.extension, texture.smooth)
        if key not in self._sums:
            self._sums[key] = sums_of(texture)
        return self._sums[key]


class _Polygons:
    """Some polygons ``own`` (p,) of a mesh, and the triangles of the mesh that they consist of."""

    def __init__(self, mesh: MeshArrays, faces: PlanarFaces, own: np.ndarray):
        self.mesh, self.faces, self.own = mesh, faces, own
        number = np.full(len(faces.face) + 1, -1)
        number[own] = np.arange(len(own))
        polygon = number[faces.triangle_polygon]
        self._triangle = np.flatnonzero(polygon >= 0)
        self._polygon = polygon[self._triangle]
        at = mesh.position[mesh.corner_vertex[mesh.triangle[self._triangle]]]
        self._area = 0.5 * np.linalg.norm(np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), axis=1)

    def means(self, uv: np.ndarray, texture: Texture, sums: PictureSums) -> np.ndarray:
        """(p, 3) mean colours of a texture over each; ``uv`` (C, 2)."""
        place = uv[self.mesh.triangle[self._triangle]] @ texture.turn[:, :2].T + texture.turn[:, 2]
        mean = sums.means(place)
        total = [np.bincount(self._polygon, self._area * channel, len(self.own)) for channel in mean.T]
        area = np.bincount(self._polygon, self._area, len(self.own))
        return shown(np.stack(total, axis=1) / np.maximum(area, 1e-300)[:, None], texture.cut_out)

    def gathered(self, value: np.ndarray, cells: int, tolerance: float) -> np.ndarray:
        """(p, 3) values (p, 3), fewer of them: see :func:`patch_means`."""
        mesh, faces = self.mesh, self.faces
        area = np.linalg.norm(face_area_vectors(mesh.position, mesh.corner_vertex[faces.corner], faces.start), axis=1)[self.own]
        patch = coplanar_faces(mesh.position, mesh.corner_vertex, mesh.face_start)[faces.face]
        bent = np.bincount(faces.face, minlength=len(mesh.face_start))[faces.face] > 1
        patch = np.where(bent, len(mesh.face_start) + np.arange(len(patch)), patch)[self.own]
        patch = np.unique(patch, return_inverse=True)[1].reshape(-1)
        at = mesh.position[mesh.corner_vertex[faces.corner[faces.start[:-1][self.own]]]]
        return patch_means(value, area, patch, at, cells, np.full(int(patch.max()) + 1, tolerance))
