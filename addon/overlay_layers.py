# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters, visible sets and leaks as coloured triangles and lines, ready to be drawn."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np

from ..core.sight import Sight
from .inspection import Groups, Inspection, Leaks

PICKED = (0.90, 0.14, 0.12)
CROSSED = ((0.98, 0.78, 0.20), (0.45, 0.75, 0.28), (0.10, 0.62, 0.58), (0.16, 0.42, 0.76), (0.35, 0.26, 0.66), (0.42, 0.14, 0.42))
"""Colours of what is seen through 0, 1, 2, .. portals; the last one holds for all further numbers. Display colours, no linear light."""
WINDOW, LEAK = (1.0, 1.0, 1.0), (1.0, 0.1, 0.45)
MOST_NAMED = 8
"""Leaks that the legend lists."""
_BOX_EDGES = np.array([[a, b] for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)])
_SUN = np.array([0.32, 0.48, 0.82])


@dataclass(frozen=True)
class Layer:
    """Something to draw. part : the switch that shows it, ``"surfaces"``, ``"boxes"``, ``"windows"`` or ``"volumes"``; others always are

    lines : lines (n even) or triangles (n a multiple of three);  position : (n, 3) float32, Blender's units
    color : (n, 4) float32;  width : of lines, pixels;  smooth : colours run from corner to corner of triangles
    """

    part: str
    lines: bool
    position: np.ndarray
    color: np.ndarray
    width: float = 1.0
    smooth: bool = False


@dataclass(frozen=True)
class Scale:
    """A bar of colours with numbers beside it.

    colors : (n, 3) display colours from the lower end to the upper;  ticks : places 0..1 along the bar, and the text at each
    unit : of the numbers
    """

    colors: np.ndarray
    ticks: tuple[tuple[float, str], ...]
    unit: str


@dataclass(frozen=True)
class Content:
    """All layers of one view, in the order of drawing, and the legend: a title, rows of a colour, or none, and a text, and a scale."""

    title: str
    layers: tuple[Layer, ...]
    legend: tuple[tuple[tuple[float, float, float] | None, str], ...] = ()
    scale: Scale | None = None


def clusters_content(found: Inspection) -> Content:
    """Every cluster in a colour of its own, with its box; clusters of one large surface are paler and have no box."""
    clusters = found.clusters
    gathered = np.diff(clusters.start) > 1
    title = f"{len(clusters):,} clusters of {found.scene.polygon_count:,} polygons in {found.scene.room_count} rooms"
    note = f"{gathered.sum():,} of several surfaces, in colours and boxes; {(~gathered).sum():,} of one surface, pale"
    return _groups_content(found, np.arange(len(clusters)), gathered, clusters.box_min, clusters.box_max, title, note)


def groups_content(found: Inspection, groups: Groups) -> Content:
    """The nodes of one level of the hierarchy of clusters, each in a colour of its own, with their boxes."""
    many = np.bincount(groups.of_cluster, minlength=len(groups.low)) > 1
    title = f"{len(many)} groups of {len(found.clusters)} clusters in {found.scene.room_count} rooms: level {groups.level} of the hierarchy"
    note = f"{many.sum()} of several clusters, in colours and boxes; {(~many).sum()} of one cluster, pale"
    return _groups_content(found, groups.of_cluster, many, groups.low, groups.high, title, note)


def _groups_content(
    found: Inspection, of_cluster: np.ndarray, strong: np.ndarray, low: np.ndarray, high: np.ndarray, title: str, note: str
):
    """Groups of clusters: ``of_cluster`` (C,) their numbers; ``strong``, ``low`` and ``high`` one row for each group."""
    colors = _distinct_colors(len(strong), strong)
    cluster = found.cluster_of[found.polygon]
    surfaces = _surfaces(found, cluster >= 0, colors[of_cluster[cluster]])
    boxes = _boxes(found, low[strong], high[strong], _dark(colors[strong]), 1.5)
    return Content(title, (surfaces, boxes), ((None, note),))


def sight_content(found: Inspection, seen: Sight) -> Content:
    """The picked cluster, what it sees coloured by the number of portals between, and the windows and volumes behind them."""
    clusters, scene = found.clusters, found.scene
    level = np.minimum(seen.crossed, len(CROSSED) - 1)
    colors = np.array([*CROSSED, PICKED])[np.where(np.arange(len(clusters)) == seen.cluster, len(CROSSED), level)]
    drawn = found.cluster_of[found.polygon]
    visible = np.flatnonzero(seen.crossed >= 0)
    boxed = np.flatnonzero((seen.crossed >= 0) & (np.diff(clusters.start) > 1) & (np.arange(len(clusters)) != seen.cluster))
    low, high = clusters.box_min, clusters.box_max
    layers = [
        _surfaces(found, (drawn >= 0) & (seen.crossed[drawn] >= 0) & (drawn != seen.cluster), colors[drawn]),
        _surfaces(found, drawn == seen.cluster, colors[drawn], "picked"),
        _boxes(found, low[boxed], high[boxed], _dark(colors[boxed]), 1.0),
        *_windows(found, seen),
        _boxes(found, low[[seen.cluster]], high[[seen.cluster]], np.array([PICKED]), 3.0, "picked"),
    ]
    polygons = np.bincount(np.maximum(seen.crossed, 0)[visible], clusters.polygons[visible]).astype(int)
    counts = np.bincount(seen.crossed[visible])
    legend = [(PICKED, f"the cluster, {clusters.polygons[seen.cluster]:,} polygons in {scene.room_names[clusters.room[seen.cluster]]}")]
    for k in range(min(len(counts), len(CROSSED))):
        last = k == len(CROSSED) - 1
        number, held = (counts[k:].sum(), polygons[k:].sum()) if last else (counts[k], polygons[k])
        if number:
            way = "its own room" if k == 0 else f"through {k}{' and more' if last else ''} portal{'s' * (k > 1)}"
            legend.append((CROSSED[k], f"{way}: {number:,} clusters, {held:,} polygons"))
    total = int(clusters.polygons[visible].sum())
    return Content(f"Sees {total:,} of {scene.polygon_count:,} polygons", tuple(layers), tuple(legend))


def leaks_content(found: Leaks) -> Content:
    """A line for every leak, a cross at both ends, and the names of the rooms."""
    names = found.scene.room_names
    if not found.leaks:
        return Content("No room leaks: every line from room to room that was tried passes a portal", ())
    lines = np.array([[leak.start, leak.end] for leak in found.leaks]) / found.metres_per_unit
    ends = lines.reshape(-1, 3)
    arm = 0.06 / found.metres_per_unit * np.concatenate([np.eye(3), -np.eye(3)]).reshape(2, 3, 3).swapaxes(0, 1).reshape(-1, 3)
    cross = (ends[:, None] + arm).reshape(-1, 3)
    layers = (
        Layer("leaks", True, ends.astype(np.float32), _flat(LEAK, len(ends)), 4.0),
        Layer("leaks", True, cross.astype(np.float32), _flat((1.0, 1.0, 1.0), len(cross)), 2.0),
    )
    legend = [
        (LEAK, f"from {names[leak.room]} into {names[leak.other]}: {np.linalg.norm(leak.end - leak.start):.2f} m") for leak in found.leaks
    ]
    if len(legend) > MOST_NAMED:
        legend = [*legend[:MOST_NAMED], (LEAK, f"and {len(legend) - MOST_NAMED} more")]
    count = len(found.leaks)
    return Content(f"{count} leak{'s' * (count > 1)} past the portals", layers, tuple(legend))


def _windows(found: Inspection, seen: Sight) -> list[Layer]:
    """Outlines of the windows, and the volumes behind them as faint bodies with edges."""
    frames, faces, edges, hues = [], [], [], []
    depth = np.zeros(len(seen.portal), int)
    for w in range(len(seen.portal)):
        depth[w] = 1 if seen.parent[w] < 0 else depth[seen.parent[w]] + 1
        frames.append(_outline(seen.polygon(w)))
        for face in seen.volume(w):
            fan = np.stack([np.broadcast_to(face[0], (len(face) - 2, 3)), face[1:-1], face[2:]], axis=1).reshape(-1, 3)
            faces.append(fan)
            edges.append(_outline(face))
            hues.append((min(depth[w], len(CROSSED) - 1), len(fan), 2 * len(face)))
    if not frames:
        return []
    frame = np.concatenate(frames)
    layers = [Layer("windows", True, _units(found, frame), _flat(WINDOW, len(frame)), 3.0)]
    if faces:
        hue = np.array(CROSSED)[[h for h, _, _ in hues]]
        fill = np.repeat(hue, [n for _, n, _ in hues], axis=0)
        line = np.repeat(hue, [n for _, _, n in hues], axis=0)
        layers.insert(0, Layer("volumes", False, _units(found, np.concatenate(faces)), _rgba(fill, 0.10)))
        layers.insert(1, Layer("volumes", True, _units(found, np.concatenate(edges)), _rgba(line, 0.8), 1.5))
    return layers


def _surfaces(found: Inspection, chosen: np.ndarray, color: np.ndarray, part: str = "surfaces") -> Layer:
    """The triangles ``chosen`` (T,) in ``color`` (T, 3), darkened a little by the way that they face."""
    corners = found.triangle[chosen]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    shade = 0.6 + 0.4 * (0.5 + 0.5 * normal @ _SUN)
    return Layer(part, False, _units(found, corners.reshape(-1, 3)), np.repeat(_rgba(color[chosen] * shade[:, None], 1.0), 3, axis=0))


def _boxes(found: Inspection, low: np.ndarray, high: np.ndarray, color: np.ndarray, width: float, part: str = "boxes") -> Layer:
    """The edges of boxes ``low`` .. ``high`` (n, 3), metres, in ``color`` (n, 3)."""
    bits = np.arange(8)[:, None] >> np.arange(3) & 1
    corner = np.where(bits, high[:, None], low[:, None])[:, _BOX_EDGES].reshape(-1, 3)
    return Layer(part, True, _units(found, corner), np.repeat(_rgba(color, 1.0), 24, axis=0), width)


def _distinct_colors(count: int, strong: np.ndarray) -> np.ndarray:
    """(count, 3) colours whose hues are far apart for groups that follow each other; pale ones where not ``strong``."""
    hue = np.arange(count) * 0.61803398875 % 1.0
    # A rug on a floor, both pale: they differ in lightness too.
    value = np.where(strong, 0.95 - 0.2 * (np.arange(count) % 3 == 1), 0.98 - 0.19 * (np.arange(count) % 3))
    return np.array([colorsys.hsv_to_rgb(h, 0.68 if s else 0.24, v) for h, v, s in zip(hue, value, strong, strict=True)]).reshape(-1, 3)


def _outline(corners: np.ndarray) -> np.ndarray:
    """(2 n, 3) lines around a polygon (n, 3)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 3)


def _units(found: Inspection, metres: np.ndarray) -> np.ndarray:
    return (metres / found.metres_per_unit).astype(np.float32)


def _dark(colors: np.ndarray) -> np.ndarray:
    return 0.55 * colors


def _rgba(color: np.ndarray, alpha: float) -> np.ndarray:
    return np.column_stack([color, np.full(len(color), alpha)]).astype(np.float32)


def _flat(color: tuple[float, float, float], count: int) -> np.ndarray:
    return np.broadcast_to(np.array([*color, 1.0], np.float32), (count, 4)).copy()
