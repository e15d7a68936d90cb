# SPDX-License-Identifier: GPL-3.0-or-later
"""What the solver makes of a scene before it sends light: its clusters and who may see whom, with the faces to draw them by."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..core.building import items_of
from ..core.clustering import ClusterItems, Clusters, cluster_as_chosen, hierarchy_of
from ..core.footprints import uncover
from ..core.leaks import Leak, find_leaks
from ..core.occlusion import blockers_of
from ..core.options import Options
from ..core.polygons import loop_polygon
from ..core.regions import merge
from ..core.scene import Scene
from ..core.sight import Sight, sight
from ..core.visibility_graph import VisibilityGraph, build_as_chosen
from .extract import Extraction, extract
from .properties import read_options


@dataclass(frozen=True)
class Inspection:
    """The clusters of a scene, the graph of their visibility, and the faces that belong to them.

    cluster_of : (P,) int64, cluster of every polygon of ``scene``, -1 for polygons without area
    triangle : (T, 3, 3) float64, metres, faces as Blender draws them;  polygon : (T,) int64, the polygon of each
    shown : (P,) bool, the polygon belongs to an object that the viewport shows
    """

    scene: Scene
    options: Options
    items: ClusterItems
    clusters: Clusters
    graph: VisibilityGraph
    cluster_of: np.ndarray
    triangle: np.ndarray
    polygon: np.ndarray
    shown: np.ndarray
    metres_per_unit: float
    warnings: tuple[str, ...]


def inspect(context: bpy.types.Context) -> Inspection:
    """Read the scene and go as far as the graph. Nothing in the file is changed.

    Raises :class:`SceneError` or :class:`OptionError` with one sentence, as a bake would.
    """
    extraction = extract(context)
    scene = extraction.scene
    options = read_options(context.scene.enfilade.solve, Options, extraction.metres_per_unit)
    surfaces = merge(scene)
    items = items_of(surfaces)
    clusters = cluster_as_chosen(items, scene.room_count, options, np.random.default_rng(options.seed))
    graph, findings = build_as_chosen(clusters, items, scene.portals, scene.room_names, options)
    region = surfaces.polygon_region
    triangle, polygon = _triangles(scene)
    return Inspection(
        scene=scene,
        options=options,
        items=items,
        clusters=clusters,
        graph=graph,
        cluster_of=np.where(region >= 0, clusters.cluster_of[region], -1).astype(np.int64),
        triangle=triangle,
        polygon=polygon,
        shown=_shown(scene, context)[scene.object],
        metres_per_unit=extraction.metres_per_unit,
        warnings=(*extraction.warnings, *findings),
    )


def sight_of(found: Inspection, cluster: int) -> Sight:
    """All that a cluster may see, window by window."""
    scene = found.scene
    return sight(found.clusters, scene.portals, scene.room_count, cluster, found.graph, found.options.volumes, found.items)


@dataclass(frozen=True)
class Groups:
    """The clusters gathered as at one level of their hierarchy, G groups.

    level : 1 for the parts of a room, 2 for the parts of these, ..;  of_cluster : (C,) int64, group of every cluster
    low, high : (G, 3) float64, metres, bounding boxes
    """

    level: int
    of_cluster: np.ndarray
    low: np.ndarray
    high: np.ndarray


def groups_of(found: Inspection, level: int) -> Groups:
    """What the clusters are gathered into at a level; where the hierarchy is less deep, the clusters themselves."""
    options = found.options
    tree = hierarchy_of(found.items, found.clusters, children=(options.hierarchy_children,), rng=np.random.default_rng(options.seed))
    leaf = np.flatnonzero(tree.cluster >= 0)
    node = np.empty(len(found.clusters), np.int64)
    node[tree.cluster[leaf]] = leaf
    while (deep := tree.level[node] > level).any():
        node[deep] = tree.parent[node[deep]]
    used, of_cluster = np.unique(node, return_inverse=True)
    return Groups(level, of_cluster.reshape(-1), tree.box_min[used], tree.box_max[used])


@dataclass(frozen=True)
class Leaks:
    """The leaks of a scene, and what is needed to name and draw them."""

    scene: Scene
    leaks: tuple[Leak, ...]
    metres_per_unit: float


def leaks_of(context: bpy.types.Context) -> Leaks:
    """Read the scene and look for gaps between its rooms. Nothing in the file is changed. Raises as :func:`inspect`."""
    return leaks_in(extract(context))


def leaks_in(extraction: Extraction) -> Leaks:
    """Look for gaps between the rooms of a scene that was read."""
    scene = extraction.scene
    surfaces = merge(scene)
    blockers = blockers_of(surfaces)
    leaks = find_leaks(uncover(surfaces, blockers), blockers, scene.portals, scene.room_count)
    return Leaks(scene, leaks, extraction.metres_per_unit)


def cluster_under(found: Inspection, origin: np.ndarray, direction: np.ndarray, fronts_only: bool) -> int:
    """The cluster of the first face that the viewport shows along a ray (3,), (3,) in metres; -1 where there is none."""
    a = found.triangle[:, 0]
    e, f = found.triangle[:, 1] - a, found.triangle[:, 2] - a
    across = np.cross(direction, f)
    det = np.einsum("ij,ij->i", e, across)
    to = origin - a
    turned = np.cross(to, e)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = np.einsum("ij,ij->i", to, across) / det, turned @ direction / det
        way = np.einsum("ij,ij->i", f, turned) / det
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (way > 0) & found.shown[found.polygon]
    if fronts_only:
        met &= det > 0
    if not met.any():
        return -1
    return int(found.cluster_of[found.polygon[np.where(met, way, np.inf).argmin()]])


def cluster_of_object(found: Inspection, name: str, near: np.ndarray | None = None) -> int:
    """The cluster with most of the area of an object, or that of its face with its middle nearest to ``near`` (3,), metres; -1: none."""
    here = np.flatnonzero((np.array(found.scene.object_names) == name)[found.scene.object[found.polygon]])
    here = here[found.cluster_of[found.polygon[here]] >= 0]
    if len(here) == 0:
        return -1
    cluster, corners = found.cluster_of[found.polygon[here]], found.triangle[here]
    if near is not None:
        return int(cluster[np.linalg.norm(corners.mean(axis=1) - near, axis=1).argmin()])
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return int(np.bincount(cluster, area).argmax())


def _triangles(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, 3, 3) of the polygons, which extraction leaves convex and without holes, and the polygon (T,) of each."""
    count = np.diff(scene.loop_start) - 2
    loop = np.repeat(np.arange(len(count)), count)
    first = scene.loop_start[:-1][loop]
    k = np.arange(len(loop)) - np.repeat(np.cumsum(count) - count, count)
    return scene.vertices[scene.corner_vertex[np.stack([first, first + k + 1, first + k + 2], axis=1)]], loop_polygon(scene)[loop]


def _shown(scene: Scene, context: bpy.types.Context) -> np.ndarray:
    """(objects,) bool: no object of that name is hidden in the viewport; instances have names of their own and count as shown."""
    hidden = {thing.name for thing in context.scene.objects if not thing.visible_get(view_layer=context.view_layer)}
    return np.array([name not in hidden for name in scene.object_names])
