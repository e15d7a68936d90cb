"""Lightmap charts: planar pieces of a mesh laid out in a texture, snapped to its texels.

A chart is a connected set of coplanar faces. Its bounding rectangle, with one side along its longest edge, is
stretched to a whole number of texels so that its rim runs through texel centres: a bilinear lookup inside the chart
then reads texels of this chart only, a rectangular wall has its corner values exactly at its corners, and two walls
that share an edge agree along it. Coordinates in a texture count in texels, texel (i, j) has its centre at (i, j), row 0
is at the bottom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .corners import corner_faces, face_area_vectors, next_corner
from .grouping import components

COPLANAR_COSINE = 1.0 - 5e-7
"""Neighbouring faces whose normals have at least this cosine may share a chart (a thousandth of a radian)."""

FLATNESS = 0.25
"""Largest distance of a chart's corners from its plane, in texels; what bends more is cut into single faces."""

REACH = 1.5
"""A texel gets a point of the surface when its centre is nearer to it than this (texels): more than the reach of a bilinear lookup."""

_BLOCK = 1 << 19


@dataclass(frozen=True)
class Charts:
    """K charts of the F faces and C corners of a mesh.

    chart : (F,) int64, the chart of every face, -1 for a face without area
    local : (C, 2) float64, every corner in its chart, texels from the centre of the chart's first texel
    size : (K, 2) int64, width and height of every chart, texels, 2 or more, width >= height
    """

    chart: np.ndarray
    local: np.ndarray
    size: np.ndarray


@dataclass(frozen=True)
class Layout:
    """Where K charts lie in a texture of ``width`` by ``height`` texels; offset : (K, 2) int64, the first texel of each."""

    offset: np.ndarray
    width: int
    height: int


def make_charts(position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray, density: float) -> Charts:
    """Cut a mesh into charts of ``density`` texels per unit of length.

    position : (V, 3) float64;  corner_vertex : (C,) int;  face_start : (F + 1,) int
    """
    face = corner_faces(face_start)
    vector = face_area_vectors(position, corner_vertex, face_start)
    area = np.linalg.norm(vector, axis=1)
    flat = area > 1e-14
    group = coplanar_faces(position, corner_vertex, face_start)
    group = _split_bent(position[corner_vertex], face, group, vector, flat, FLATNESS / density)
    chart = np.full(len(area), -1)
    chart[flat] = np.unique(group[flat], return_inverse=True)[1].reshape(-1)
    count = int(chart.max()) + 1 if len(chart) else 0

    corner = np.flatnonzero(chart[face] >= 0)
    owner = chart[face[corner]]
    u, v = _chart_axes(position, corner_vertex, face_start, chart, count, vector)
    at = position[corner_vertex[corner]]
    plane = np.stack([np.einsum("ij,ij->i", at, u[owner]), np.einsum("ij,ij->i", at, v[owner])], axis=1)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, owner, plane)
    np.maximum.at(high, owner, plane)
    extent = high - low
    # The longer side lies along the rows: sorted by height such charts fill their shelves well.
    tall = extent[:, 1] > extent[:, 0]
    plane -= low[owner]
    turned = tall[owner]
    plane[turned] = np.stack([plane[turned, 1], extent[owner[turned], 0] - plane[turned, 0]], axis=1)
    extent[tall] = extent[tall][:, ::-1]
    size = np.maximum(np.ceil(extent * density - 1e-6).astype(np.int64) + 1, 2)
    local = np.zeros((len(corner_vertex), 2))
    local[corner] = plane * ((size - 1) / np.maximum(extent, 1e-300))[owner]
    return Charts(chart, local, size)


def coplanar_faces(position: np.ndarray, corner_vertex: np.ndarray, face_start: np.ndarray) -> np.ndarray:
    """(F,) int64 label of the set of faces that hang together over edges between almost parallel faces.

    A set may bend as a whole, but hardly from a face to the next.
    """
    face, following = corner_faces(face_start), next_corner(face_start)
    vector = face_area_vectors(position, corner_vertex, face_start)
    area = np.linalg.norm(vector, axis=1)
    start, end = corner_vertex.astype(np.int64), corner_vertex[following].astype(np.int64)
    key = np.minimum(start, end) * len(position) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    pairs = first[np.diff(first, append=len(key)) == 2]
    a, b = order[pairs], order[pairs + 1]
    normal = vector / np.maximum(area, 1e-300)[:, None]
    even = (start[a] == end[b]) & (area[face[a]] > 1e-14) & (area[face[b]] > 1e-14)
    even &= np.einsum("ij,ij->i", normal[face[a]], normal[face[b]]) >= COPLANAR_COSINE
    return components(len(area), face[a[even]], face[b[even]])


def _split_bent(at, face, group, vector, flat, tolerance) -> np.ndarray:
    """Groups whose corners leave their common plane by more than the tolerance become single faces."""
    count = int(group.max()) + 1 if len(group) else 0
    total = np.zeros((count, 3))
    np.add.at(total, group, vector)
    normal = total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
    height = np.einsum("ij,ij->i", at, normal[group[face]])
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, group[face], height)
    np.maximum.at(high, group[face], height)
    bent = (high - low > 2 * tolerance)[group] & flat
    return np.where(bent, count + np.arange(len(group)), group)


def _chart_axes(position, corner_vertex, face_start, chart, count, vector) -> tuple[np.ndarray, np.ndarray]:
    """Two (K, 3) unit axes of every chart, right-handed with its normal, the first along its longest edge."""
    total = np.zeros((count, 3))
    used = chart >= 0
    np.add.at(total, chart[used], vector[used])
    normal = total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
    owner = chart[corner_faces(face_start)]
    at = position[corner_vertex]
    edge = at[next_corner(face_start)] - at
    length = np.linalg.norm(edge, axis=1)
    order = np.lexsort((np.arange(len(length)), -length, owner))
    order = order[owner[order] >= 0]
    u = edge[order[np.flatnonzero(np.diff(owner[order], prepend=-1))]]
    u = u - np.einsum("ij,ij->i", u, normal)[:, None] * normal
    u /= np.maximum(np.linalg.norm(u, axis=1), 1e-300)[:, None]
    return u, np.cross(normal, u)


def pack(size: np.ndarray, margin: int, limit: int) -> Layout | None:
    """Lay rectangles out on shelves in the smallest texture whose width is a power of two, or None when none is small enough.

    size : (K, 2) int, texels;  margin : texels kept free around every one;  limit : largest width and height
    """
    box = np.asarray(size, np.int64) + 2 * margin
    if len(box) == 0:
        return Layout(np.zeros((0, 2), np.int64), 4, 4)
    layouts = []
    width = 4
    while width <= limit:
        if width >= box[:, 0].max():
            offset, used = _shelves(box, width)
            height = -(-used // 4) * 4
            if height <= limit:
                layouts.append(Layout(offset + margin, width, height))
        width *= 2
    return min(layouts, key=lambda one: (one.width * one.height, max(one.width, one.height)), default=None)


def _shelves(box: np.ndarray, width: int) -> tuple[np.ndarray, int]:
    """(K, 2) places of boxes put side by side in order of falling height, shelf upon shelf, and the height of all."""
    order = np.lexsort((np.arange(len(box)), -box[:, 0], -box[:, 1]))
    right = np.cumsum(box[order, 0])
    offset = np.empty_like(box)
    begin = top = 0
    while begin < len(order):
        before = right[begin - 1] if begin else 0
        stop = int(np.searchsorted(right, before + width, side="right"))
        row = order[begin:stop]
        offset[row, 0] = right[begin:stop] - box[row, 0] - before
        offset[row, 1] = top
        top += int(box[order[begin], 1])
        begin = stop
    return offset, top


@dataclass(frozen=True)
class Texels:
    """Surface points of N texels of a texture.

    index : (N,) int64, ``row * width + column``, ascending;  triangle : (N,) int64
    weight : (N, 3) float64, barycentric coordinates of the point of the triangle that is nearest to the texel's centre
    """

    index: np.ndarray
    triangle: np.ndarray
    weight: np.ndarray


def cover_texels(triangles: np.ndarray, width: int, height: int) -> Texels:
    """The texels that a bilinear lookup on some triangle may read, each with the nearest point of the nearest triangle.

    triangles : (T, 3, 2) float64, corners in texels, none without area
    """
    low = np.clip(np.ceil(triangles.min(axis=1) - REACH).astype(np.int64), 0, [width - 1, height - 1])
    high = np.clip(np.floor(triangles.max(axis=1) + REACH).astype(np.int64), 0, [width - 1, height - 1])
    span = high - low + 1
    number = span[:, 0] * span[:, 1]
    nearest = np.full(width * height, np.inf, np.float32)
    owner = np.full(width * height, -1, np.int64)
    weight = np.zeros((width * height, 3))
    total = np.cumsum(number)
    begin = 0
    while begin < len(triangles):
        before = total[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(total, before + _BLOCK, side="right")))
        t = np.repeat(np.arange(begin, stop), number[begin:stop])
        k = np.arange(len(t)) - np.repeat(total[begin:stop] - number[begin:stop] - before, number[begin:stop])
        x, y = low[t, 0] + k % span[t, 0], low[t, 1] + k // span[t, 0]
        bary, distance = _nearest_in_triangle(np.stack([x, y], axis=1).astype(np.float64), triangles[t])
        texel = y * width + x
        order = np.lexsort((t, distance, texel))
        first = order[np.flatnonzero(np.diff(texel[order], prepend=-1))]
        first = first[(distance[first] < REACH) & (distance[first] < nearest[texel[first]])]
        nearest[texel[first]], owner[texel[first]], weight[texel[first]] = distance[first], t[first], bary[first]
        begin = stop
    index = np.flatnonzero(owner >= 0)
    return Texels(index, owner[index], weight[index])


def _nearest_in_triangle(point: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates (N, 3) of the nearest point of each triangle (N, 3, 2) and its distance (N,) float32."""
    a, b, c = triangle[:, 0], triangle[:, 1], triangle[:, 2]
    ab, ac, ap = b - a, c - a, point - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    area = np.where(area == 0.0, 1e-300, area)
    s = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / area
    t = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / area
    weight = np.stack([1.0 - s - t, s, t], axis=1)
    distance = np.zeros(len(point))
    out = np.flatnonzero((weight < 0.0).any(axis=1))
    if len(out):
        corner = triangle[out]
        rows = np.arange(len(out))
        nearest = np.full(len(out), np.inf)
        chosen = np.zeros((len(out), 3))
        for i in range(3):
            p, q = corner[:, i], corner[:, (i + 1) % 3]
            edge, to = q - p, point[out] - p
            along = np.clip((to * edge).sum(1) / np.maximum((edge * edge).sum(1), 1e-300), 0.0, 1.0)
            gap = np.hypot(*(to - along[:, None] * edge).T)
            bary = np.zeros((len(out), 3))
            bary[rows, i], bary[rows, (i + 1) % 3] = 1.0 - along, along
            better = gap < nearest
            nearest[better], chosen[better] = gap[better], bary[better]
        weight[out], distance[out] = chosen, nearest
    return weight, distance.astype(np.float32)


def fill_margin(image: np.ndarray, filled: np.ndarray, steps: int) -> np.ndarray:
    """Grow the filled texels by ``steps`` texels, each new one the mean of its filled neighbours (eight of them).

    image : (H, W, K) float32, changed in place;  filled : (H, W) bool;  returns the (H, W) bool mask of all filled texels
    """
    height, width = filled.shape
    shifts = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    mask = np.zeros((height + 2, width + 2), bool)
    mask[1:-1, 1:-1] = filled
    for _ in range(steps):
        near = np.zeros_like(filled)
        for i, j in shifts:
            near |= mask[1 + i : 1 + i + height, 1 + j : 1 + j + width]
        row, column = np.nonzero(near & ~mask[1:-1, 1:-1])
        if len(row) == 0:
            break
        total, count = np.zeros((len(row), image.shape[2])), np.zeros(len(row))
        for i, j in shifts:
            there = mask[row + 1 + i, column + 1 + j]
            total[there] += image[row[there] + i, column[there] + j]
            count += there
        image[row, column] = total / count[:, None]
        mask[row + 1, column + 1] = True
    return mask[1:-1, 1:-1].copy()
