"""The part of a polygon that is seen from a point past flat blockers, exactly.

A convex blocker hides from a point what lies beyond its plane within the cone through its edges. A convex piece of the
polygon loses that part and is left in at most one convex piece for each plane; blocker after blocker the pieces become
fewer or smaller, and Lambert's formula adds up what remains. No samples, so that penumbrae are smooth and contact shadows
sharp.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .grouping import ragged
from .occlusion import Blockers
from .polygons import clip_half
from .vectors import cross, following

_ROWS = 1 << 14


def visible_light(
    points: np.ndarray,
    normals: np.ndarray,
    owner: np.ndarray,
    corners: np.ndarray,
    blockers: Blockers,
    pair: np.ndarray,
    blocker: np.ndarray,
    light: Callable[[np.ndarray, np.ndarray], np.ndarray],
    depth: float = 1.0,
    passes: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Light (n, c) float64 from what points see of polygons.

    Also (n,) int64 the ``id`` of a blocker that hides all of the polygon by itself, -1 where none does.

    points, normals : (n, 3), one point and one polygon make a pair
    owner : (m,) sorted, corners : (m, k, 3) float64, the convex pieces of the polygon of each pair, relative to its point
    pair, blocker : (r,) rows, ``pair`` sorted, the blockers that may stand between
    light : (owner (m,), parts (m, k, 3) of the polygons, before the planes of their points) to the light (m, c) of these
    depth : 1 when blockers hide what lies beyond their planes, 0 when all that lies in their directions, as of the sky
    passes : (K,) 0..1, part of the light that each blocker lets through, as glass does, or None for opaque ones
    """
    count = len(points)
    normals = normals.astype(np.float64)
    corners = clip_half(corners, np.einsum("nkd,nd->nk", corners, normals[owner]))
    passes = np.zeros(len(blockers)) if passes is None else passes
    meets, covers = _reach(points, owner, corners, blockers, pair, blocker, depth)
    covers &= passes[blocker] == 0
    veil = np.full(count, -1)
    veil[pair[covers][::-1]] = blockers.id[blocker[covers][::-1]]
    dark = veil >= 0
    meets &= ~dark[pair]
    pair, blocker = pair[meets], blocker[meets]
    owner, corners = owner[~dark[owner]], corners[~dark[owner]]
    # The largest first: what they hide is never cut up by the smaller ones.
    size = blockers.size[blocker] / np.maximum(np.linalg.norm(blockers.middle[blocker] - points[pair], axis=1), 1e-9)
    # Glass last: it hides nothing that would then not have to be cut.
    order = np.lexsort((-size, passes[blocker] > 0, pair))
    pair, blocker = pair[order], blocker[order]
    start = np.searchsorted(pair, np.arange(count + 1))
    degree = np.diff(start)
    weight = np.ones(len(owner))
    out = np.zeros((count, light(np.zeros(0, np.int64), np.zeros((0, 3, 3))).shape[1]))
    for turn in range(int(degree.max(initial=0)) + 1):
        done = degree[owner] <= turn
        if done.any():
            found = weight[done, None] * light(owner[done], corners[done])
            for k in range(out.shape[1]):
                out[:, k] += np.bincount(owner[done], found[:, k], minlength=count)
        owner, weight, corners = owner[~done], weight[~done], corners[~done]
        if not len(owner):
            break
        hiding = blocker[start[owner] + turn]
        planes = _cones(blockers, hiding, points[owner].astype(np.float64), depth)
        owner, weight, corners = _subtract(owner, weight, corners, planes, passes[hiding])
    return out, veil


def _reach(points, owner, corners, blockers, pair, blocker, depth) -> tuple[np.ndarray, np.ndarray]:
    """(r,) bool: the cone of the row's blocker may meet the polygon of the row's pair; and surely holds all of it.

    Most meet nothing, so this is done in float32 with rows running fastest; what rounding leaves open is left to the exact cut.
    """
    first = np.searchsorted(owner, np.arange(len(points) + 1))
    meets, covers = np.zeros(len(pair), bool), np.zeros(len(pair), bool)
    polygon = np.ascontiguousarray(corners.transpose(1, 2, 0), dtype=np.float32)
    plates = np.ascontiguousarray(blockers.corners.transpose(1, 2, 0))
    for begin in range(0, len(pair), _ROWS):
        here = slice(begin, begin + _ROWS)
        p = pair[here]
        members, row = ragged(first[p], np.diff(first)[p])
        touched, held = _cone_test(plates[:, :, blocker[here]] - points[p].T, polygon, members, row, blockers.clearance, depth)
        meets[here] = np.bincount(row[touched], minlength=len(p)) > 0
        covers[here] = np.bincount(row[held], minlength=len(p)) == np.diff(first)[p]
    return meets, covers


def _cone_test(
    plate: np.ndarray, polygon: np.ndarray, members: np.ndarray, row: np.ndarray, clearance: float, depth: float
) -> tuple[np.ndarray, np.ndarray]:
    """(m,) bool each: convex pieces ``polygon[:, :, members]`` may meet, surely lie in, the hidden side of plates (4, 3, r).

    All corners are relative to the point that looks.
    """
    count = len(polygon)
    corner = [polygon[k][:, members] for k in range(count)]
    side = [_cross(plate[k], plate[(k + 1) % 4]) for k in range(4)]
    # Seen from the point all edges turn the same way; the diagonals tell which, also for a triangle with its double corner.
    face = _cross(plate[2] - plate[0], plate[3] - plate[1])
    away = (face * plate[0]).sum(0)
    turn = np.sign(away)
    # A plate whose plane holds the point hides nothing.
    stands = (np.abs(away) > clearance * np.sqrt((face * face).sum(0)))[row]
    touched, held = stands, stands.copy()
    for normal, offset in [*((n * turn, None) for n in side), (face * turn, depth * np.abs(away))]:
        # In float32 a product of three lengths keeps six digits of the largest.
        slack = 1e-5 * np.sqrt((normal * normal).sum(0))[row]
        normal = normal[:, row]
        low = high = None
        for c in corner:
            height = normal[0] * c[0] + normal[1] * c[1] + normal[2] * c[2]
            low = height if low is None else np.minimum(low, height)
            high = height if high is None else np.maximum(high, height)
        if offset is not None:
            low, high = low - offset[row], high - offset[row]
        # An edge seen end on, or between the two equal corners of a triangle, bounds nothing.
        touched &= (high > -slack) | (slack == 0)
        held &= (low > slack) | (slack == 0)
    return touched, held


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, r) cross products of vectors (3, r)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _heights(corners: np.ndarray, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest height (n, h) of convex pieces (n, k, 3) over planes (n, h, 4), and the rounding (n, 1) of both."""
    height = np.matmul(corners, planes[:, :, :3].transpose(0, 2, 1))
    height += planes[:, None, :, 3]
    return height.min(1), height.max(1), 1e-9 * np.abs(corners).max((1, 2), initial=0)[:, None]


def _cones(blockers: Blockers, k: np.ndarray, points: np.ndarray, depth: float) -> np.ndarray:
    """(n, 5, 4) half-spaces (normal, offset), relative to the points (n, 3), whose common part blockers k hide from them.

    A blocker whose plane holds the point hides nothing: its half-spaces are empty.
    """
    corners = blockers.corners[k].astype(np.float64) - points[:, None]
    # A triangle has its last corner twice: the edge between is none, and everything is inside its half-space.
    side = cross(corners, following(corners))
    side *= np.sign(np.einsum("nkd,nd->nk", side, corners.mean(1)))[..., None]
    length = np.linalg.norm(side, axis=2, keepdims=True)
    side /= np.maximum(length, 1e-300)
    normal = blockers.normal[k].astype(np.float64)
    height = np.einsum("nd,nd->n", corners[:, 0], normal)
    planes = np.zeros((len(k), 5, 4))
    planes[:, 1:, :3] = side
    planes[:, 1:, 3] = length[..., 0] <= 0
    planes[:, 0, :3] = normal * np.sign(height)[:, None]
    planes[:, 0, 3] = -depth * (np.abs(height) + blockers.clearance)
    planes[np.abs(height) <= blockers.clearance, 0] = [0, 0, 0, -1]
    return planes


def _subtract(
    owner: np.ndarray, weight: np.ndarray, corners: np.ndarray, planes: np.ndarray, passes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is left of convex pieces (n, k, 3) outside the common part of their half-spaces (n, h, 4), as convex pieces with their
    owners and weights (n,). The part inside stays with as much of its weight as ``passes`` (n,).
    """
    _, high, slack = _heights(corners, planes)
    outside = (high <= slack).any(1)
    owners, weights, pieces = [owner[outside]], [weight[outside]], [corners[outside]]
    owner, weight, rest, planes, passes, slack = (x[~outside] for x in (owner, weight, corners, planes, passes, slack[:, 0]))
    for h in range(planes.shape[1]):
        if not len(owner):
            break
        height = np.einsum("nkd,nd->nk", rest, planes[:, h, :3]) + planes[:, h, 3, None]
        cut, some = height.min(1) < -slack, height.max(1) > slack
        if cut.any():
            owners.append(owner[cut])
            weights.append(weight[cut])
            pieces.append(clip_half(rest[cut], -height[cut]))
        if not some.all():
            owner, weight, planes, passes, slack = (x[some] for x in (owner, weight, planes, passes, slack))
            rest, height, cut = rest[some], height[some], cut[some]
        # Most planes leave most pieces whole.
        if cut.any():
            rest = np.concatenate([rest, rest[:, -1:]], axis=1)
            rest[cut] = clip_half(rest[cut, :-1], height[cut])
            rest = _tight(rest)
    glass = passes > 0
    if glass.any():
        owners.append(owner[glass])
        weights.append((weight * passes)[glass])
        pieces.append(rest[glass])
    return _merged(owners, weights, pieces)


def _tight(corners: np.ndarray) -> np.ndarray:
    """Convex pieces (n, k, 3) with fewer slots: repeated corners at the end are dropped where no piece needs them."""
    distinct = (np.abs(np.diff(corners, axis=1)) > 0).any(2)
    need = 1 + max(2, int((distinct * np.arange(1, corners.shape[1])).max(initial=0)))
    return corners[:, :need]


def _merged(owners: list[np.ndarray], weights: list[np.ndarray], pieces: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One array of pieces, short ones with their last corner repeated, without those of no area."""
    pieces = [_tight(p) for p in pieces]
    most = max(p.shape[1] for p in pieces)
    members = [np.minimum(np.arange(most), p.shape[1] - 1) for p in pieces]
    corners = np.concatenate([p[:, m] for p, m in zip(pieces, members, strict=True)])
    owner, weight = np.concatenate(owners), np.concatenate(weights)
    local = corners - corners[:, :1]
    area = np.linalg.norm(cross(local, following(local)).sum(1), axis=1)
    keep = area > 1e-14 * np.abs(corners).max((1, 2), initial=1e-30) ** 2
    return owner[keep], weight[keep], corners[keep]
