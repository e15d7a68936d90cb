"""What a cluster sees through one window: supporting planes, and polygons clipped by them (paper, section 5.1).

A supporting plane has the window on one side and the cluster's box on the other, and touches both: along an edge of the
window and at a corner of the box, or at a corner of the window and along an edge of the box. Any line from the box through
the window stays on the window's side of it behind the window.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from .grouping import ragged
from .portal_world import PortalWorld

_FLAT = 1e12
"""Cotangent of a plane that lies in the window: it lets everything pass."""
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_WAYS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
_BOX_EDGES = np.array([(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1])


@dataclass
class Windows:
    """Ways to look into a room: N windows that clusters (``source``) look through.

    source : (N,) clusters;  portal : (N,) directed windows of the world that these are parts of
    corner : (N, n, 3), last one repeated;  before : (N, m, 3) the window before, or None where there is none or it is not used
    path : (N, depth) directed windows from the cluster to this one;  parent : (N,) row of the window before, in its own front
    """

    source: np.ndarray
    portal: np.ndarray
    corner: np.ndarray
    before: np.ndarray | None
    path: np.ndarray
    parent: np.ndarray

    def __len__(self) -> int:
        return len(self.source)

    def take(self, index: np.ndarray | slice) -> Windows:
        """Some of the windows."""
        before = None if self.before is None else self.before[index]
        return Windows(self.source[index], self.portal[index], self.corner[index], before, self.path[index], self.parent[index])


def supporting_planes(world: PortalWorld, front: Windows) -> tuple[Windows, np.ndarray]:
    """The windows that their clusters can look through at all, and (N, k, 4) planes (a, b): visible is a.x <= b.

    The last plane is that of the window, before it are those through the window's edges. An edge whose plane cannot be laid,
    because box or window before touch it or cross the window's plane on the wrong side of it, has the window's plane too;
    what bounds nothing has an infinite b. From within a prism, or from behind it, everything counts as visible: an
    opening that is not planar may face any way there.
    """
    half = world.half[front.source] + world.slack
    box = world.centre[front.source][:, None] + _CORNERS * half[:, None]
    normal, reach = world.normal[front.portal], world.depth[front.portal]
    height = np.einsum("nc,nc->n", normal, front.corner[:, 0])
    depth = height[:, None] - np.einsum("nvc,nc->nv", box, normal)
    edge = np.roll(front.corner, -1, axis=1) - front.corner
    length = np.linalg.norm(edge, axis=2, keepdims=True)
    real = length[..., 0] > world.slack
    outward = np.cross(edge, normal[:, None]) / np.where(length > 0, length, 1)
    edge_height = np.einsum("nkc,nkc->nk", outward, front.corner)
    side = outward @ box.transpose(0, 2, 1) - edge_height[..., None]

    open_ = _in_front(world, front, depth, outward * real[..., None], edge_height) | (reach > 0)
    if front.before is not None:
        before_depth = height[:, None] - np.einsum("nvc,nc->nv", front.before, normal)
        before_side = outward @ front.before.transpose(0, 2, 1) - edge_height[..., None]
        deep = (reach > 0) | (world.depth[front.path[:, -2]] > 0)
        open_ &= _before_in_front(front, before_depth, before_side, real, world.slack) | deep
    if not open_.all():
        front = front.take(open_)
        normal, reach, height, depth, real, outward, edge_height, side = (
            x[open_] for x in (normal, reach, height, depth, real, outward, edge_height, side)
        )
        if front.before is not None:
            before_depth, before_side = before_depth[open_], before_side[open_]

    cotangent = _cotangent(side, depth, _BOX_EDGES, world.slack)
    deep = np.flatnonzero(reach > 0)
    cotangent[deep] = _deep_cotangent(side[deep], depth[deep], reach[deep])
    if front.before is not None:
        size = front.before.shape[1]
        ring = np.stack([np.arange(size), np.roll(np.arange(size), -1)], axis=1)
        from_before = _cotangent(before_side, before_depth, ring, world.slack)
        last = front.path[:, -2]
        deep_before = np.flatnonzero((reach > 0) | (world.depth[last] > 0))
        if len(deep_before):
            across, normal_before = world.depth[last][deep_before], world.normal[last][deep_before]
            spread = across[:, None] * np.einsum("nkc,nc->nk", outward[deep_before], normal_before)
            slant = across * np.einsum("nc,nc->n", normal[deep_before], normal_before)
            both = before_side[deep_before], before_depth[deep_before]
            sides = np.concatenate([both[0] + spread[..., None], both[0] - spread[..., None]], axis=2)
            depths = np.concatenate([both[1] - slant[:, None], both[1] + slant[:, None]], axis=1)
            from_before[deep_before] = _deep_cotangent(sides, depths, reach[deep_before])
        cotangent = np.maximum(cotangent, from_before)
    cotangent = np.where(real, cotangent, -_FLAT)
    length = np.sqrt(cotangent * cotangent + 1.0)
    planes = np.empty((len(front), real.shape[1] + 1, 4))
    planes[:, :-1, :3] = (cotangent[..., None] * normal[:, None] + outward) / length[..., None]
    planes[:, :-1, 3] = (cotangent * height[:, None] + edge_height + np.abs(cotangent) * reach[:, None]) / length
    planes[:, -1, :3] = -normal
    planes[:, -1, 3] = reach - height
    planes[deep[depth[deep].min(axis=1) <= reach[deep]], :, 3] = np.inf
    if not world.framed:
        planes = np.concatenate([_box_edge_planes(world, front), planes], axis=1)
    planes[..., 3] += world.slack
    return front, planes


def _box_edge_planes(world: PortalWorld, front: Windows) -> np.ndarray:
    """(N, 6, 4) planes that hold an edge of the box and touch a corner of the window.

    Seen along one of the axes, box and window are a rectangle and a polygon of the plane. Where a line of direction q
    separates them, the steepest and the flattest line from the one to the other are the tangents between them. With those
    through the window's edges alone the graph of a building with 648 rooms has a quarter more pairs.
    """
    planes = np.zeros((len(front), 6, 4))
    planes[..., 3] = np.inf
    normal = world.normal[front.portal]
    for axis in range(3):
        plane = [k for k in range(3) if k != axis]
        window, middle = front.corner[..., plane], world.centre[front.source][:, plane]
        half = world.half[front.source][:, plane] + world.slack
        across = normal[:, plane]
        length = np.linalg.norm(across, axis=1)
        across = across / np.maximum(length, 1e-300)[:, None]
        gap = np.einsum("nkc,nc->nk", window, across).min(axis=1) - ((middle * across) + half * np.abs(across)).sum(axis=1)
        gap = np.where(length > 0.5, gap, -1.0)
        gaps = np.column_stack([gap, window.min(axis=1) - middle - half, middle - half - window.max(axis=1)])
        way = gaps.argmax(axis=1)
        rows = np.flatnonzero((gaps.max(axis=1) > world.slack) & (world.depth[front.portal] == 0))
        q = np.where((way == 0)[:, None], across, _WAYS[way])[rows]
        p = np.stack([-q[:, 1], q[:, 0]], axis=1)
        window, box = window[rows], middle[rows, None] + _SQUARE * half[rows, None]
        rise = np.einsum("nkc,nc->nk", window, p)[:, None] - np.einsum("nkc,nc->nk", box, p)[:, :, None]
        run = np.einsum("nkc,nc->nk", window, q)[:, None] - np.einsum("nkc,nc->nk", box, q)[:, :, None]
        slope = rise / run
        steepest, flattest = -least(least(-slope)), least(least(slope))
        for side, extreme, sign in ((0, steepest, 1.0), (1, flattest, -1.0)):
            a = sign * (p - extreme[:, None] * q) / np.sqrt(1.0 + extreme * extreme)[:, None]
            at = 2 * axis + side
            planes[rows, at, plane[0]], planes[rows, at, plane[1]] = a.T
            planes[rows, at, 3] = np.einsum("nkc,nc->nk", window, a).max(axis=1)
    return planes


def _in_front(world: PortalWorld, front: Windows, depth: np.ndarray, outward: np.ndarray, edge_height: np.ndarray) -> np.ndarray:
    """(N,) bool: the clusters reach in front of the planes of their windows, or lie in the windows themselves.

    What lies in the plane of a window but beside it sees nothing through it: such is the wall around a door. It is asked item by
    item, since the box of a wall holds the door. depth (N, 8) : of the box;  outward (N, n, 3), edge_height (N, n) : of edges
    """
    result = depth.max(axis=1) > 2 * world.slack
    level = np.flatnonzero(~result & (depth.max(axis=1) > -world.slack))
    item, owner = ragged(world.item_start[front.source[level]], np.diff(world.item_start)[front.source[level]])
    middle, half, row = world.item_centre[item], world.item_half[item], level[owner]
    beside = np.zeros(len(item), bool)
    for k in range(outward.shape[1]):
        o = outward[row, k]
        nearest = np.einsum("nc,nc->n", o, middle) - np.einsum("nc,nc->n", np.abs(o), half) - edge_height[row, k]
        beside |= o.any(axis=1) & (nearest > -2 * world.slack)
    result[row[~beside]] = True
    return result


def _before_in_front(front: Windows, depth: np.ndarray, side: np.ndarray, real: np.ndarray, slack: float) -> np.ndarray:
    """(N,) bool: as :func:`_in_front` for the windows before: doors of one wall do not look through each other."""
    result = depth.max(axis=1) > 2 * slack
    level = np.flatnonzero(~result & (depth.max(axis=1) > -slack))
    result[level] = ~(real[level] & (side[level].min(axis=2) > -2 * slack)).any(axis=1)
    return result


def _cotangent(side: np.ndarray, depth: np.ndarray, edges: np.ndarray, slack: float) -> np.ndarray:
    """(N, K): side over depth of the point of a convex body that opens the view past an edge widest.

    side : (N, K, V) distance of the body's corners outward from each of K edges, in the window's plane
    depth : (N, V) distance in front of the window's plane;  edges : (E, 2) corners joined by the body's edges
    Only the part of the body in front of the plane counts. A body that reaches the edge, or meets the plane inward of
    it, opens the whole half-space: -_FLAT. No part in front says nothing either: -_FLAT.
    """
    ahead = depth > 0
    ratio = side / np.where(ahead, depth, 1.0)[:, None]
    partly = np.flatnonzero(~ahead.all(axis=1))
    ratio[partly] = np.where(ahead[partly, None], ratio[partly], np.inf)
    result = np.clip(least(ratio), -_FLAT, _FLAT)
    touching = np.flatnonzero((np.abs(depth) <= slack).any(axis=1))
    touches = ((np.abs(side[touching]) <= slack) & (np.abs(depth[touching]) <= slack)[:, None]).any(axis=2)
    result[touching] = np.where(touches, -_FLAT, result[touching])
    result[~ahead.any(axis=1)] = -_FLAT
    crossing = np.flatnonzero(~ahead.all(axis=1) & ahead.any(axis=1))
    if len(crossing):
        a, b = edges.T
        da, db = depth[crossing][:, a], depth[crossing][:, b]
        cuts = (da > 0) != (db > 0)
        t = np.where(cuts, da / np.where(cuts, da - db, 1.0), 0.0)
        sa, sb = side[crossing][:, :, a], side[crossing][:, :, b]
        at = np.where(cuts[:, None], sa + t[:, None] * (sb - sa), np.inf).min(axis=2)
        result[crossing] = np.where(at <= slack, -_FLAT, result[crossing])
    return result


def least(values: np.ndarray) -> np.ndarray:
    """``values.min(axis=-1)``: many times faster where the axis is short."""
    return functools.reduce(np.minimum, np.moveaxis(values, -1, 0))


def _deep_cotangent(side: np.ndarray, depth: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """As :func:`_cotangent`, for prisms that reach ``reach`` (N,) to both sides of the plane.

    The plane touches the far rim of the prism where it closes in on the view, the near rim where it opens out. A body that is
    not wholly in front of the prism opens the whole half-space.
    """
    before = depth.min(axis=1) > reach
    near, far = np.where(before[:, None], depth - reach[:, None], 1.0), np.where(before[:, None], depth + reach[:, None], 1.0)
    closing = (side / far[:, None]).min(axis=2)
    opening = (side / near[:, None]).min(axis=2)
    return np.where(before[:, None], np.maximum(np.where(closing >= 0, closing, opening), -_FLAT), -_FLAT)


def clipped(corner: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Cut from (N, n, 3) convex polygons what has ``inward`` (N, n) below zero; every polygon has a corner that stays.

    Returns (N, n, 3), last corner repeated; polygons that would get more than n corners are left whole.
    """
    size = corner.shape[1]
    following, next_height = np.roll(corner, -1, axis=1), np.roll(inward, -1, axis=1)
    inside = inward >= 0
    crosses = inside != (next_height >= 0)
    t = inward / np.where(crosses, inward - next_height, 1.0)
    # Every corner gives itself where it is inside and the crossing after it, packed to the left.
    slots = np.stack([corner, corner + t[..., None] * (following - corner)], axis=2).reshape(len(corner), 2 * size, 3)
    used = np.stack([inside, crosses], axis=2).reshape(len(corner), 2 * size)
    count = used.sum(axis=1)
    packed = np.argsort(~used, axis=1, kind="stable")[:, :size]
    packed = np.take_along_axis(packed, np.minimum(np.arange(size), count[:, None] - 1), axis=1)
    result = np.take_along_axis(slots, packed[..., None], axis=1)
    return np.where((count > size)[:, None, None], corner, result)


def joined(parts: list[np.ndarray], width: int) -> np.ndarray:
    """Arrays (n, k, width) one after another, each filled up to the longest k with its last entry."""
    longest = max((p.shape[1] for p in parts), default=3)
    return np.concatenate([np.zeros((0, longest, width)), *(p[:, np.minimum(np.arange(longest), p.shape[1] - 1)] for p in parts)])
