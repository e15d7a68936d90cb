"""The values of a bake: light at the corners of meshes and at the texels of lightmaps, from any solution.

An item (:class:`CornerItem`, :class:`PageItem`) knows at which surface points it wants light and what becomes of it;
:func:`evaluate` asks the solution for all of them in blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .charts import Layout, coplanar_faces, cover_texels, fill_margin, make_charts, pack
from .corners import average_groups, corner_angles, corner_faces, linked_corners, next_corner
from .face_grids import FaceGrids
from .photometry import stored_quantity
from .scene import Scene, SceneError
from .subdivision import subdivide

BLOCK = 1 << 12
"""Points that are asked for at once."""


class Light(Protocol):
    """What a bake needs of a solution: see :class:`enfilade.core.solution.Solution`."""

    def irradiance(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray: ...

    def irradiance_of_groups(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray: ...

    def shows(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class Carrier:
    """A mesh that carries light (V vertices, F faces, C corners, T triangles).

    position : (V, 3) float64, metres;  corner_vertex : (C,) int;  face_start : (F + 1,) int
    sharp : (C,) bool, the edge from a corner to the next is hard
    triangle : (T, 3) int, corners;  triangle_polygon : (T,) int, polygon of the scene that each lies in, -1 for none
    grids : the polygons of the scene that were cut, where any were, the same for all carriers
    texel_scale : it gets this many times the texels per metre of others in textures
    """

    position: np.ndarray
    corner_vertex: np.ndarray
    face_start: np.ndarray
    sharp: np.ndarray
    triangle: np.ndarray
    triangle_polygon: np.ndarray
    grids: FaceGrids | None = None
    texel_scale: float = 1.0

    def polygon_at(self, triangle: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(N,) the polygons of the scene at points (N, 3) of triangles (N,), -1 for none."""
        polygon = self.triangle_polygon[triangle].astype(np.int64)
        return polygon if self.grids is None else self.grids.at(polygon, points)

    @property
    def corner_position(self) -> np.ndarray:
        """(C, 3) float64, metres."""
        return self.position[self.corner_vertex]


@dataclass(frozen=True)
class FineCarrier:
    """A carrier whose faces are pieces of the triangles of a coarse one.

    parent : (F,) int64, triangle of the coarse carrier;  weight : (C, 3) float64, barycentric coordinates in it
    """

    carrier: Carrier
    parent: np.ndarray
    weight: np.ndarray


def refined(coarse: Carrier, limit: float) -> FineCarrier:
    """A carrier with no edge longer than ``limit`` metres.

    Raises :class:`SceneError` when that takes too many faces.
    """
    fine = subdivide(coarse.position, coarse.corner_vertex[coarse.triangle], limit)
    corners = np.einsum("tij,tjk->tik", fine.weight, coarse.corner_position[coarse.triangle[fine.parent]]).reshape(-1, 3)
    position = np.zeros((fine.count, 3))
    vertex = fine.vertex.reshape(-1)
    position[vertex] = corners
    count = len(fine.vertex)
    # An edge of a piece lies on an edge of its parent where both its ends have no share of the corner across.
    marked = np.zeros((count, 3), bool)
    following = np.roll(fine.weight, -1, axis=1)
    start = coarse.triangle[fine.parent]
    next_of = next_corner(coarse.face_start)
    for e in range(3):
        real = next_of[start[:, e]] == start[:, (e + 1) % 3]
        on_edge = (fine.weight[:, :, (e + 2) % 3] == 0.0) & (following[:, :, (e + 2) % 3] == 0.0)
        marked |= on_edge & (real & coarse.sharp[start[:, e]])[:, None]
    carrier = Carrier(
        position,
        vertex,
        np.arange(count + 1) * 3,
        marked.reshape(-1),
        np.arange(3 * count).reshape(-1, 3),
        coarse.triangle_polygon[fine.parent],
        coarse.grids,
        coarse.texel_scale,
    )
    return FineCarrier(carrier, fine.parent, fine.weight.reshape(-1, 3))


_WAYS = np.array([0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 0.97])[:, None]
"""Parts of the way from a hidden corner into its faces at which one in the open is looked for."""


class CornerItem:
    """Light at the corners of a carrier, averaged across each surface and split at hard edges.

    The irradiance is averaged, and only then multiplied with what each face reflects: colours do not bleed over
    the border of two materials.
    """

    def __init__(self, carrier: Carrier, quantity: str, domain: str) -> None:
        self.carrier, self.quantity, self.domain = carrier, quantity, domain

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) points and (N,) polygons at which irradiance is wanted: one for coplanar faces around a vertex."""
        mesh = self.carrier
        corner = mesh.triangle.reshape(-1).astype(np.int64)
        polygon = mesh.polygon_at(np.repeat(np.arange(len(mesh.triangle)), 3), mesh.corner_position[corner])
        known = np.flatnonzero(polygon >= 0)
        plane = coplanar_faces(mesh.position, mesh.corner_vertex, mesh.face_start)[corner_faces(mesh.face_start)]
        # A bent face is several polygons: a corner that two of them share is asked for in both.
        bent = self._bent(corner[known], polygon[known])
        self._group = linked_corners(mesh.position, mesh.corner_vertex, mesh.face_start, mesh.sharp)
        place = plane[corner[known]] * len(mesh.corner_vertex) + self._group[corner[known]]
        places = np.unique(place, return_inverse=True)[1].reshape(-1)
        key = np.where(bent, len(known) + np.arange(len(known)), places)
        _, first, sample = np.unique(key, return_index=True, return_inverse=True)
        pair = np.unique(np.stack([corner[known], sample.reshape(-1)], axis=1), axis=0)
        self._corner, self._sample = pair[:, 0], pair[:, 1]
        self._polygon = np.full(len(mesh.corner_vertex), -1)
        self._polygon[corner[known][::-1]] = polygon[known][::-1]
        self._triangle, self._sample_of = known // 3, sample.reshape(-1)
        return mesh.corner_position[corner[known][first]], polygon[known][first]

    def in_the_open(self, at: np.ndarray, polygon: np.ndarray, light: Light) -> tuple[np.ndarray, np.ndarray]:
        """The samples, those under something that lies on the surface moved to the nearest place of their faces in the open.

        Otherwise the dark under a rug would creep out along the edges of the faces that reach under it.
        """
        hidden = ~light.shows(at, polygon)
        entry = np.flatnonzero(hidden[self._sample_of])
        if len(entry) == 0:
            return at, polygon
        mesh, sample, triangle = self.carrier, self._sample_of[entry], self._triangle[entry]
        corners = mesh.corner_position[mesh.triangle[triangle]]
        # Along the edges of the triangle to its other corners, and straight across.
        ends = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)[:, None]
        places = at[sample][:, None, None] + _WAYS[:, None] * (ends - at[sample][:, None, None])
        distance = np.linalg.norm(places - at[sample][:, None, None], axis=3)
        count = places.shape[1] * places.shape[2]
        places, owner = places.reshape(-1, 3), np.repeat(sample, count)
        face = mesh.polygon_at(np.repeat(triangle, count), places)
        open_ = np.flatnonzero((distance.reshape(-1) > 0) & light.shows(places, face))
        open_ = open_[np.lexsort((distance.reshape(-1)[open_], owner[open_]))]
        moved, first = np.unique(owner[open_], return_index=True)
        at, polygon = at.copy(), polygon.copy()
        at[moved], polygon[moved] = places[open_[first]], face[open_[first]]
        return at, polygon

    def _bent(self, corner: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """(N,) bool: the face of each corner is more than one polygon."""
        face = corner_faces(self.carrier.face_start)[corner]
        count = len(self.carrier.face_start) - 1
        low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
        np.minimum.at(low, face, polygon)
        np.maximum.at(high, face, polygon)
        return (low != high)[face]

    def finish(self, irradiance: np.ndarray, scene: Scene) -> np.ndarray:
        """(C, 4) or, per vertex, (V, 4) float32 colours with alpha 1."""
        mesh = self.carrier
        count = len(mesh.corner_vertex)
        number = np.bincount(self._corner, minlength=count)
        light = np.stack([np.bincount(self._corner, channel, count) for channel in irradiance[self._sample].T], axis=1)
        light /= np.maximum(number, 1)[:, None]
        weight = np.where(number > 0, corner_angles(mesh.position, mesh.corner_vertex, mesh.face_start), 0.0)
        light = np.maximum(average_groups(light, self._group, weight), 0.0)
        polygon = self._polygon
        known = (polygon >= 0)[:, None]
        color = stored_quantity(
            self.quantity, light, np.where(known, scene.reflectance[polygon], 0.0), np.where(known, scene.emission[polygon], 0.0)
        )
        if self.domain == "point":
            vertices = len(mesh.position)
            mean = average_groups(color, mesh.corner_vertex, weight)
            color = np.zeros((vertices, 3), np.float32)
            color[mesh.corner_vertex] = mean
        return np.concatenate([color, np.ones((len(color), 1), np.float32)], axis=1)


@dataclass(frozen=True)
class Page:
    """One texture and the charts of its members.

    members : indices of carriers;  uv : for every member (C, 2) float64, texels (the first texel's centre is 0)
    density : texels per metre of members whose ``texel_scale`` is 1
    """

    members: tuple[int, ...]
    uv: tuple[np.ndarray, ...]
    width: int
    height: int
    density: float


def plan_page(carriers: Sequence[Carrier], members: Sequence[int], density: float, margin: int, limit: int, name: str) -> Page:
    """Lay the charts of some carriers out in one texture, coarser than ``density`` (texels per metre) where they do not fit.

    Raises :class:`SceneError` that names the texture when no density fits.
    """
    chosen = [carriers[m] for m in members]
    while True:
        charts = [make_charts(c.position, c.corner_vertex, c.face_start, density * c.texel_scale) for c in chosen]
        layout = pack(np.concatenate([c.size for c in charts]), margin, limit)
        if layout is not None:
            return Page(tuple(members), _texture_coordinates(carriers, members, charts, layout), layout.width, layout.height, density)
        # Charts of two texels do not shrink any more: then no density helps.
        if all((c.size == 2).all() for c in charts):
            raise SceneError(
                f"the lightmap of '{name}' does not fit into {limit} x {limit} texels: raise max_resolution or lower the margin"
            )
        density *= 0.84


def _texture_coordinates(carriers, members, charts, layout: Layout) -> tuple[np.ndarray, ...]:
    out, first = [], 0
    for m, chart in zip(members, charts, strict=True):
        owner = chart.chart[corner_faces(carriers[m].face_start)]
        offset = np.concatenate([layout.offset[first : first + len(chart.size)], np.zeros((1, 2), np.int64)])
        out.append(chart.local + offset[owner])
        first += len(chart.size)
    return tuple(out)


class PageItem:
    """Light at the texels of one texture."""

    def __init__(self, carriers: Sequence[Carrier], page: Page, quantity: str, margin: int) -> None:
        self.carriers, self.page, self.quantity, self.margin = carriers, page, quantity, margin

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) points and (N,) polygons at which irradiance is wanted."""
        page = self.page
        chosen = [self.carriers[m] for m in page.members]
        known = [c.triangle_polygon >= 0 for c in chosen]
        flat = np.concatenate([uv[c.triangle[k]] for c, uv, k in zip(chosen, page.uv, known, strict=True)])
        solid = np.concatenate([c.corner_position[c.triangle[k]] for c, k in zip(chosen, known, strict=True)])
        polygon = np.concatenate([c.triangle_polygon[k] for c, k in zip(chosen, known, strict=True)])
        edge, other = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        wide = np.abs(edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0]) > 1e-12
        flat, solid, polygon = flat[wide], solid[wide], polygon[wide]
        found = cover_texels(flat, page.width, page.height)
        at = np.einsum("ni,nij->nj", found.weight, solid[found.triangle])
        grids = chosen[0].grids
        self._index, self._polygon = found.index, polygon[found.triangle]
        self._polygon = self._polygon if grids is None else grids.at(self._polygon, at)
        return at, self._polygon

    def finish(self, irradiance: np.ndarray, scene: Scene) -> np.ndarray:
        """(H, W, 4) float32 image, row 0 at the bottom, alpha 1."""
        light = np.maximum(irradiance, 0.0)
        color = stored_quantity(self.quantity, light, scene.reflectance[self._polygon], scene.emission[self._polygon])
        image = np.zeros((self.page.height * self.page.width, 4), np.float32)
        image[:, 3] = 1.0
        image[self._index, :3] = color
        filled = np.zeros(len(image), bool)
        filled[self._index] = True
        image = image.reshape(self.page.height, self.page.width, 4)
        fill_margin(image, filled.reshape(self.page.height, self.page.width), self.margin)
        return image


def evaluate(items: Sequence[CornerItem | PageItem], light: Light, scene: Scene) -> Generator[float, None, list[np.ndarray]]:
    """Ask for the light of all items in blocks of points; yields the finished fraction, returns the values of each item."""
    values = yield from _evaluated(items, light, lambda at, polygon: light.irradiance(at, polygon)[:, None], (scene,))
    return [value for (value,) in values]


def evaluate_groups(
    items: Sequence[CornerItem | PageItem], light: Light, scenes: Sequence[Scene]
) -> Generator[float, None, list[tuple[np.ndarray, ...]]]:
    """As :func:`evaluate`, the values of each item by each light group alone; ``scenes``, one for each group, shine with it alone."""
    return (yield from _evaluated(items, light, light.irradiance_of_groups, scenes))


def _evaluated(
    items: Sequence[CornerItem | PageItem],
    light: Light,
    ask: Callable[[np.ndarray, np.ndarray], np.ndarray],
    scenes: Sequence[Scene],
) -> Generator[float, None, list[tuple[np.ndarray, ...]]]:
    """The values of each item by the light of each of K ``scenes``; ``ask`` for irradiance (N, K, 3) at points of polygons."""
    values: list[tuple[np.ndarray, ...]] = []
    waiting: list[tuple[CornerItem | PageItem, int]] = []
    points: list[np.ndarray] = []
    polygons: list[np.ndarray] = []
    for number, item in enumerate(items):
        at, polygon = item.samples()
        if isinstance(item, CornerItem):
            at, polygon = item.in_the_open(at, polygon, light)
        waiting.append((item, len(at)))
        points.append(at)
        polygons.append(polygon)
        if sum(count for _, count in waiting) < BLOCK and number + 1 < len(items):
            continue
        at, polygon = np.concatenate(points), np.concatenate(polygons)
        received = np.zeros((len(at), len(scenes), 3))
        for begin in range(0, len(at), BLOCK):
            block = slice(begin, begin + BLOCK)
            received[block] = ask(at[block], polygon[block])
            done = min(1.0, (begin + BLOCK) / max(len(at), 1))
            yield (number + 1 - len(waiting) * (1.0 - done)) / len(items)
        first = 0
        for one, count in waiting:
            mine = received[first : first + count]
            values.append(tuple(one.finish(mine[:, k], scene) for k, scene in enumerate(scenes)))
            first += count
        waiting, points, polygons = [], [], []
    return values
