"""Convex pieces of many planes cut along segments: what lies on either side of a line becomes a piece of its own."""

from __future__ import annotations

import numpy as np

from .box_tree import BoxTree
from .polygons import clip_half


def cut_along(
    owner: np.ndarray, pieces: np.ndarray, segment_owner: np.ndarray, start: np.ndarray, end: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pieces cut by the lines of the segments of their owner that run through them: (owner (m,), pieces (m, k, 2)), sorted by owner.

    owner, pieces : (n,) and (n, k, 2) float64 convex, counter-clockwise; the last corner may be repeated
    segment_owner, start, end : (s,), (s, 2), (s, 2);  slack : metres, what is cut off is wider than this

    A piece is cut by one segment after another, in an order as good as random: then the number of cuts that a piece goes through
    grows with the logarithm of the number of segments, as in binary space partitions.
    """
    length = np.linalg.norm(end - start, axis=1)
    real = np.flatnonzero(length > 0)
    segment_owner, start, end = segment_owner[real], start[real], end[real]
    low, high = np.minimum(start, end), np.maximum(start, end)
    tree = BoxTree(low, high, segment_owner)
    found = [tree.overlaps(pieces.min(1), pieces.max(1), owner)]
    pairs = [(piece, segment) for blocks in found for segment, piece in blocks]
    piece = np.concatenate([np.zeros(0, np.int64), *(p for p, _ in pairs)])
    segment = np.concatenate([np.zeros(0, np.int64), *(s for _, s in pairs)])
    rank = np.arange(len(start), dtype=np.int64) * 2654435761 % (1 << 32)
    while True:
        height = _heights(pieces[piece], start[segment], end[segment])
        crossed = (height.min(1) < -slack) & (height.max(1) > slack)
        piece, segment, height = piece[crossed], segment[crossed], height[crossed]
        through = _runs_through(pieces[piece], start[segment], end[segment], slack)
        piece, segment, height = piece[through], segment[through], height[through]
        if not len(piece):
            break
        order = np.lexsort((rank[segment], piece))
        piece, segment, height = piece[order], segment[order], height[order]
        first = np.flatnonzero(np.r_[True, piece[1:] != piece[:-1]])
        cut = piece[first]
        upper, lower = clip_half(pieces[cut], height[first]), clip_half(pieces[cut], -height[first])
        pieces, upper, lower = alike(pieces, upper, lower)
        pieces[cut] = upper
        place = np.full(len(pieces), -1)
        place[cut] = len(pieces) + np.arange(len(cut))
        pieces, owner = np.concatenate([pieces, lower]), np.concatenate([owner, owner[cut]])
        rest = np.ones(len(piece), bool)
        rest[first] = False
        piece, segment = piece[rest], segment[rest]
        piece, segment = np.concatenate([piece, place[piece]]), np.tile(segment, 2)
    order = np.argsort(owner, kind="stable")
    return owner[order], pieces[order]


def holds(pieces: np.ndarray, points: np.ndarray, slack: float) -> np.ndarray:
    """(n, j) bool: points (n, j, 2) lie inside counter-clockwise convex pieces (n, k, 2), ``slack`` (m) away from the border."""
    edge = np.roll(pieces, -1, 1) - pieces
    offset = points[:, None] - pieces[:, :, None]
    side = _cross(edge[:, :, None], offset)
    length = np.linalg.norm(edge, axis=2)
    return ((side > slack * length[..., None]) | (length[..., None] < 1e-9)).all(1)


def alike(*stacks: np.ndarray) -> list[np.ndarray]:
    """Stacks of pieces with one number of corner slots, as few as all have different corners."""
    kept = []
    for pieces in stacks:
        new = np.ones(pieces.shape[:2], bool)
        new[:, 1:] = (np.abs(np.diff(pieces, axis=1)) > 1e-12).any(2)
        kept.append((pieces, new))
    slots = max(4, *(int(new.sum(1).max(initial=0)) for _, new in kept))
    out = []
    for pieces, new in kept:
        order = np.argsort(~new, axis=1, kind="stable")
        place = np.minimum(np.arange(slots), new.sum(1)[:, None] - 1)
        out.append(np.take_along_axis(pieces, np.take_along_axis(order, place, 1)[..., None], 1))
    return out


def _heights(pieces: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n, k) distances of the corners of pieces from the lines, positive to their left."""
    along = end - start
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    offset = pieces - start[:, None]
    return _cross(along[:, None], offset)


def _runs_through(pieces: np.ndarray, s: np.ndarray, t: np.ndarray, slack: float) -> np.ndarray:
    """(n,) bool: part of the segment lies inside the convex piece, not merely on its border."""
    edge = np.roll(pieces, -1, 1) - pieces
    length = np.linalg.norm(edge, axis=2)
    real = length > 1e-9
    unit = edge / np.where(real, length, 1)[..., None]
    # Cyrus and Beck: the part of the segment that lies ``slack`` within every edge.
    a, b = (np.where(real, _cross(unit, point[:, None] - pieces) - slack, 1.0) for point in (s, t))
    fall = a - b
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.where(fall != 0, a / np.where(fall == 0, 1, fall), 0)
    leave = np.where(fall > 0, place, 1.0).min(1)
    enter = np.where(fall < 0, place, 0.0).max(1)
    outside = ((a < 0) & (b < 0)).any(1)
    return ~outside & (np.minimum(leave, 1) - np.maximum(enter, 0) > 0)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
