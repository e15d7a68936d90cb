"""How good a set of clusters is: their sizes, the boxes they need and the emptiness in these, and what they may see."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..grouping import ragged
from ..visibility_graph import VisibilityGraph
from .items import ClusterItems, Clusters

HISTOGRAM_EDGES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Least polygons of the bins of a histogram; the last bin has no upper end."""
VOID_CELLS = 8
"""Cells along each edge of a box, in which :func:`void_volume` looks for polygons."""
_BLOCK_CELLS = 1 << 22


@dataclass(frozen=True)
class ClusterQuality:
    """Figures of C clusters.

    clusters : their number;  polygons_mean, polygons_max : polygons in one
    histogram : (len(HISTOGRAM_EDGES),) int64, clusters by polygons in them
    box_volume : summed volume of the boxes, m3;  box_area : summed surface of the boxes, m2
    void_share : share of the summed volume that is empty, see :func:`void_volume`; 0 where no box has a volume
    pvs_mean, pvs_max : polygons in the potentially visible set of a cluster
    """

    clusters: int
    polygons_mean: float
    polygons_max: int
    histogram: np.ndarray
    box_volume: float
    box_area: float
    void_share: float
    pvs_mean: float
    pvs_max: int


def quality_of(items: ClusterItems, clusters: Clusters, graph: VisibilityGraph) -> ClusterQuality:
    """Figures of clusters of ``items`` and of their visibility graph."""
    edge = clusters.box_max - clusters.box_min
    volume = float(edge.prod(axis=1).sum())
    return ClusterQuality(
        clusters=len(clusters),
        polygons_mean=float(clusters.polygons.mean()) if len(clusters) else 0.0,
        polygons_max=int(clusters.polygons.max(initial=0)),
        histogram=histogram(clusters.polygons),
        box_volume=volume,
        box_area=float(2.0 * (edge * np.roll(edge, 1, axis=1)).sum()),
        void_share=float(void_volume(items, clusters).sum() / volume) if volume > 0 else 0.0,
        pvs_mean=float(graph.pvs_polygons.mean()) if len(clusters) else 0.0,
        pvs_max=int(graph.pvs_polygons.max(initial=0)),
    )


def as_report(quality: ClusterQuality) -> dict:
    """The figures as plain numbers, the histogram by the least polygons of each bin."""
    figures = {f.name: getattr(quality, f.name) for f in fields(quality) if f.name != "histogram"}
    return {**figures, "histogram": dict(zip(map(str, HISTOGRAM_EDGES), quality.histogram.tolist(), strict=True))}


def histogram(polygons: np.ndarray) -> np.ndarray:
    """(len(HISTOGRAM_EDGES),) int64: how many of ``polygons`` (C,), each 1 or more, fall in each bin."""
    return np.bincount(np.searchsorted(HISTOGRAM_EDGES, polygons, side="right") - 1, minlength=len(HISTOGRAM_EDGES))


def void_volume(items: ClusterItems, clusters: Clusters) -> np.ndarray:
    """(C,) float64, m3: what of each cluster's box is empty.

    The box is cut into VOID_CELLS along each edge; a cell is empty when no item reaches into it, neither by its bounding box nor by its
    plane. A share of the volume of the polygons themselves would say nothing, since they have none.
    """
    size = clusters.box_max - clusters.box_min
    volume = size.prod(axis=1)
    empty = np.zeros(len(clusters))
    cells = VOID_CELLS**3
    solid = np.flatnonzero(volume > 0)
    step = _BLOCK_CELLS // cells
    for block in (solid[i : i + step] for i in range(0, len(solid), step)):
        member, owner = ragged(clusters.start[block], np.diff(clusters.start)[block])
        item, low, unit = clusters.members[member], clusters.box_min[block][owner], (size[block] / VOID_CELLS)[owner]
        first = np.clip(np.floor((items.box_min[item] - low) / unit), 0, VOID_CELLS - 1).astype(np.int64)
        last = np.clip(np.ceil((items.box_max[item] - low) / unit) - 1, first, VOID_CELLS - 1).astype(np.int64)
        span = last - first + 1
        used = np.zeros(len(block) * cells, bool)
        for part in np.array_split(np.arange(len(item)), 1 + int(span.prod(axis=1).sum()) // _BLOCK_CELLS):
            cell, whose = ragged(np.zeros(len(part), np.int64), span[part].prod(axis=1))
            whose = part[whose]
            z, rest = cell % span[whose, 2], cell // span[whose, 2]
            y, x = rest % span[whose, 1], rest // span[whose, 1]
            place = first[whose] + np.stack([x, y, z], axis=1)
            centre = (place + 0.5) * unit[whose] + (low[whose] - items.barycenter[item[whose]])
            normal = items.normal[item[whose]]
            height = np.abs(np.einsum("ij,ij->i", normal, centre))
            met = height <= 0.5 * np.einsum("ij,ij->i", np.abs(normal), unit[whose]) * (1 + 1e-9)
            place, whose = place[met], whose[met]
            used[owner[whose] * cells + place @ (VOID_CELLS**2, VOID_CELLS, 1)] = True
        empty[block] = volume[block] * (1.0 - used.reshape(-1, cells).mean(axis=1))
    return empty
