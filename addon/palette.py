# SPDX-License-Identifier: GPL-3.0-or-later
"""What the polygons of a mesh reflect and emit: the constants of their materials, and the means of their images over each of them."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ..core.charts import coplanar_faces
from ..core.corners import face_area_vectors
from ..core.face_grids import parallelograms
from ..core.faces import PlanarFaces
from ..core.patch_means import patch_means
from ..core.picture_sums import PictureSums
from .mesh_arrays import MeshArrays
from .pictures import Texture, shown, sums_of
from .screens import CELLS, SMALL, Screens
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
        self._sums: dict[tuple[bpy.types.Image, str, bool, bool], PictureSums] = {}

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
                    value = self._painted(mesh, surface.reflecting, surface.reflectance, around.uv, around.mean)
                    reflectance[own] = around.gathered(np.clip(value, 0.0, 1.0), REFLECTING_CELLS, REFLECTANCE_TOLERANCE)
                if surface.emitting:
                    value = np.maximum(self._painted(mesh, surface.emitting, surface.emission, around.uv, around.mean), 0.0)
                    scale = max(float(value.max()), 1e-300)
                    emission[own] = scale * around.gathered(value / scale, EMITTING_CELLS, EMISSION_TOLERANCE)
        return reflectance, emission

    def screens(self, mesh: MeshArrays, faces: PlanarFaces, surfaces: list[Surface], emission: np.ndarray) -> Screens | None:
        """The quads of a mesh that shine by an image, where any do, without those that hardly count; ``emission`` (P, 3) as found."""
        slot = np.clip(mesh.material[faces.face], 0, len(surfaces) - 1)
        painted = np.array([bool(s.emitting) for s in surfaces])[slot]
        if not painted.any():
            return None
        power = np.where(painted, emission.sum(axis=1) * _areas(mesh, faces), 0.0)
        total = float(power.sum())
        quad = np.flatnonzero((np.diff(faces.start) == 4) & (power > SMALL * total))
        corner = faces.corner[faces.start[quad][:, None] + np.arange(4)]
        good = parallelograms(mesh.position[mesh.corner_vertex[corner]])
        quad, corner = quad[good], corner[good]
        fine = np.zeros((len(quad), CELLS**2, 3))
        for number, surface in enumerate(surfaces):
            own = np.flatnonzero(slot[quad] == number)
            if len(own) and surface.emitting:
                lattice = _Lattice(corner[own])
                value = self._painted(mesh, surface.emitting, surface.emission, lattice.uv, lattice.mean)
                fine[own] = np.broadcast_to(np.maximum(value, 0.0), (len(own) * CELLS**2, 3)).reshape(len(own), -1, 3)
        return Screens(quad, power[quad], total, fine.reshape(-1, CELLS, CELLS, 3))

    def _painted(
        self,
        mesh: MeshArrays,
        layers: tuple[Layer, ...],
        whole: np.ndarray,
        triangles: Callable[[np.ndarray], np.ndarray],
        mean: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """(p, 3) colours whose mean is ``whole`` where the whole of each image is taken; that alone, (3,), where there is no UV map.

        triangles : makes (T, 3, 2) out of the (C, 2) of a UV map;  mean : (p, 4) out of the (T, 4) means over these
        """
        out = whole
        for layer in layers:
            uv = mesh.uv.get(layer.texture.uv_map)
            if uv is not None:
                turn = layer.texture.turn
                found = mean(self._sums_of(layer.texture).means(triangles(uv) @ turn[:, :2].T + turn[:, 2]))
                out = out + layer.factor * (shown(found, layer.texture.cut_out) - layer.mean)
        return out

    def _sums_of(self, texture: Texture) -> PictureSums:
        key = (texture.image, texture.extension, texture.smooth, texture.cut_out)
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

    def uv(self, uv: np.ndarray) -> np.ndarray:
        """(T, 3, 2) coordinates of the triangles in a UV map (C, 2)."""
        return uv[self.mesh.triangle[self._triangle]]

    def mean(self, mean: np.ndarray) -> np.ndarray:
        """(p, c) means over the polygons of means (T, c) over the triangles."""
        total = [np.bincount(self._polygon, self._area * channel, len(self.own)) for channel in mean.T]
        area = np.bincount(self._polygon, self._area, len(self.own))
        return np.stack(total, axis=1) / np.maximum(area, 1e-300)[:, None]

    def gathered(self, value: np.ndarray, cells: int, tolerance: float) -> np.ndarray:
        """(p, 3) values (p, 3) or (3,), fewer of them: see :func:`patch_means`."""
        mesh, faces = self.mesh, self.faces
        area = _areas(mesh, faces)[self.own]
        patch = coplanar_faces(mesh.position, mesh.corner_vertex, mesh.face_start)[faces.face]
        bent = np.bincount(faces.face, minlength=len(mesh.face_start))[faces.face] > 1
        patch = np.where(bent, len(mesh.face_start) + np.arange(len(patch)), patch)[self.own]
        patch = np.unique(patch, return_inverse=True)[1].reshape(-1)
        at = mesh.position[mesh.corner_vertex[faces.corner[faces.start[:-1][self.own]]]]
        value = np.broadcast_to(value, (len(area), 3))
        return patch_means(value, area, patch, at, cells, np.full(int(patch.max()) + 1, tolerance))


class _Lattice:
    """The cells of quads, whose corners are ``corner`` (p, 4)."""

    def __init__(self, corner: np.ndarray):
        self._corner = corner

    def uv(self, uv: np.ndarray) -> np.ndarray:
        """(T, 3, 2) coordinates of the halves of the cells in a UV map (C, 2)."""
        at = uv[self._corner]
        s, t = (x[None, :, :, None] for x in np.meshgrid(*2 * [np.arange(CELLS + 1) / CELLS], indexing="ij"))
        a, b, c, d = (at[:, k, None, None] for k in range(4))
        knots = (1 - s) * ((1 - t) * a + t * d) + s * ((1 - t) * b + t * c)
        low, right, high, left = knots[:, :-1, :-1], knots[:, 1:, :-1], knots[:, 1:, 1:], knots[:, :-1, 1:]
        halves = np.stack([low, right, high, low, high, left], axis=3)
        return halves.reshape(-1, 3, 2)

    def mean(self, mean: np.ndarray) -> np.ndarray:
        """(p * cells, c) means over the cells of means (T, c) over their halves."""
        return mean.reshape(-1, 2, mean.shape[1]).mean(axis=1)


def _areas(mesh: MeshArrays, faces: PlanarFaces) -> np.ndarray:
    """(P,) m2 of the polygons."""
    return np.linalg.norm(face_area_vectors(mesh.position, mesh.corner_vertex[faces.corner], faces.start), axis=1)
