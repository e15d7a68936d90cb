"""Which places of a region's plane the region covers, and how much of a rectangle: exact, by its convex pieces."""

from __future__ import annotations

import numpy as np

from .box_tree import BoxTree
from .plane_cuts import holds
from .polygons import areas_and_centroids, clip_to_boxes
from .regions import Regions


def clipped_pieces(regions: Regions, box: np.ndarray, row: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """(r, k, 2) convex polygons, counter-clockwise in the frame: ``regions.cover[piece[r]]`` cut to ``box[row[r]]``.

    box : (n, 4) float64 u, v, width, height;  row, piece : (r,). Missing corners repeat the last one.
    """
    corners = regions.cover[piece]
    return clip_to_boxes(corners, box[row, :2], box[row, :2] + box[row, 2:])


def measure(regions: Regions, box: np.ndarray, row: np.ndarray, piece: np.ndarray, parts: int):
    """Cover of boxes by the pieces listed in rows (``row`` sorted), for each of ``parts`` x ``parts`` equal parts of a box.

    Returns area (n, parts**2) and first moment (n, parts**2, 2) of the cover in each part, u running slowest; corners
    low and high (n, 2) of the cover; and touched (r,) bool, whether the row's piece meets the box at all.
    """
    n = len(box)
    whole = clipped_pieces(regions, box, row, piece)
    touched = areas_and_centroids(whole)[0] > 1e-9 * box[row, 2] * box[row, 3]
    low, high = np.full((n, 2), np.inf), np.full((n, 2), -np.inf)
    np.minimum.at(low, row[touched], whole[touched].min(1))
    np.maximum.at(high, row[touched], whole[touched].max(1))
    area, moment = np.zeros((n, parts * parts)), np.zeros((n, parts * parts, 2))
    live = np.flatnonzero(touched)
    step = box[:, 2:] / parts
    for k in range(parts * parts):
        start = box[:, :2] + np.array([k // parts, k % parts]) * step
        size, first = areas_and_centroids(clip_to_boxes(whole[live], start[row[live]], (start + step)[row[live]]))
        area[:, k] = np.bincount(row[live], size, minlength=n)
        for axis in (0, 1):
            moment[:, k, axis] = np.bincount(row[live], first[:, axis], minlength=n)
    # Overlapping pieces would count twice: no part holds more than all of itself.
    limit = np.minimum(1.0, step.prod(1)[:, None] / np.maximum(area, 1e-300))
    return np.maximum(area * limit, 0.0), moment * limit[..., None], low, high, touched


def covered(regions: Regions, region: np.ndarray, uv: np.ndarray, slack: float) -> np.ndarray:
    """(n,) bool: regions (n,) cover the places uv (n, 2) of their frames, or come within ``slack`` (m) of them."""
    asked = np.zeros(len(regions), bool)
    asked[region] = True
    owner = np.repeat(np.arange(len(regions)), np.diff(regions.cover_start))
    members = np.flatnonzero(asked[owner])
    cover = regions.cover[members]
    out = np.zeros(len(region), bool)
    for piece, place in BoxTree(cover.min(1), cover.max(1), owner[members]).overlaps(uv - slack, uv + slack, region):
        inside = holds(cover[piece], uv[place][:, None], -slack)[:, 0]
        out[place[inside]] = True
    return out
