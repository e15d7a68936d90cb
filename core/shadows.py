"""The part of a polygon that is seen from a point past flat blockers, exactly.

A convex blocker hides from a point what lies beyond its plane within the cone through its edges. A convex piece of the
polygon loses that part and is left in at most one convex piece for each plane; blocker after blocker the pieces become
fewer or smaller, and Lambert's formula adds up what remains. No samples, so that penumbrae are smooth and contact shadows
sharp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .grouping import ragged, runs
from .occlusion import Blockers
from .polygons import clip_half
from .vectors import cross, following

_ROUNDS = (0, 2, 8, 1 << 62)
"""Blockers of a pair by number, those up to the next of these at once."""
_ROWS = 1 << 14
_CORNERS = 1 << 15


@dataclass(frozen=True)
class Hiding:
    """What stands between n points and a polygon each.

    pair, blocker : (r,) rows, the blockers that may hide some of the polygon but not all of it by themselves
    veil : (n,) int64 the ``id`` of one that does, -1 where none does;  doubtful : (n,) bool, some opaque blocker was asked about
    asked : number of rows that were
    """

    pair: np.ndarray
    blocker: np.ndarray
    veil: np.ndarray
    doubtful: np.ndarray
    asked: int


Candidates = Callable[[np.ndarray, int, int], tuple[np.ndarray, np.ndarray]]
"""Rows (pair, blocker) of some pairs (m,) rising, of those blockers of each that may stand between, from one number to before another;
quickest where those that may hide most come first.
"""


def in_front(owner: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The parts of convex pieces (m, k, 3), relative to the points ``owner`` (m,), before the planes with ``normals`` (n, 3) there."""
    return clip_half(corners, np.einsum("nkd,nd->nk", corners, normals.astype(np.float64)[owner]))


def hiding(
    points: np.ndarray,
    owner: np.ndarray,
    corners: np.ndarray,
    blockers: Blockers,
    candidates: Candidates,
    depth: float = 1.0,
    passes: np.ndarray | None = None,
) -> Hiding:
    """Which blockers hide some of the polygons of points; for the arguments see :func:`visible_light`.

    Most points that see nothing see nothing past one of the first few blockers alone: the others are not asked.
    """
    count = len(points)
    passes = np.zeros(len(blockers)) if passes is None else passes
    veil, doubtful, asked, found = np.full(count, -1), np.zeros(count, bool), 0, []
    for low, high in pairwise(_ROUNDS):
        pair, blocker = candidates(np.flatnonzero(veil < 0), low, high)
        asked += len(pair)
        opaque = passes[blocker] == 0
        doubtful[pair[opaque]] = True
        meets, covers = _reach(points, owner, corners, blockers, pair, blocker, depth)
        whole = np.flatnonzero(covers & opaque)[::-1]
        veil[pair[whole]] = blockers.id[blocker[whole]]
        some = np.flatnonzero(meets)
        found.append((pair[some], blocker[some]))
    pair, blocker = (np.concatenate(column) for column in zip(*found, strict=True))
    left = np.flatnonzero(veil[pair] < 0)
    return Hiding(pair[left], blocker[left], veil, doubtful, asked)


def visible_light(
    points: np.ndarray,
    owner: np.ndarray,
    corners: np.ndarray,
    blockers: Blockers,
    pair: np.ndarray,
    blocker: np.ndarray,
    light: Callable[[np.ndarray, np.ndarray], np.ndarray],
    depth: float = 1.0,
    passes: np.ndarray | None = None,
) -> np.ndarray:
    """Light (n, c) float64 from what points see of polygons.

    points : (n, 3), one point and one polygon make a pair
    owner : (m,) sorted, corners : (m, k, 3) float64, the convex pieces of the polygon of each pair, relative to its point and
        :func:`in_front` of it
    pair, blocker : (r,) rows, the blockers that may hide some of it
    light : (owner (m,), parts (m, k, 3) of the polygons) to the light (m, c) of these
    depth : 1 when blockers hide what lies beyond their planes, 0 when all that lies in their directions, as of the sky
    passes : (K,) 0..1, part of the light that each blocker lets through, as glass does, or None for opaque ones
    """
    count = len(points)
    passes = np.zeros(len(blockers)) if passes is None else passes
    # The largest first: what they hide is never cut up by the smaller ones.
    size = blockers.size[blocker] / np.maximum(np.linalg.norm(blockers.middle[blocker] - points[pair], axis=1), 1e-9)
    # Glass last: it hides nothing that would then not have to be cut.
    order = np.lexsort((-size, passes[blocker] > 0, pair))
    pair, blocker = pair[order], blocker[order]
    start = np.searchsorted(pair, np.arange(count + 1))
    planes = _cones(blockers, blocker, points[pair].astype(np.float64), depth)
    weight = np.ones(len(owner))
    seen = [(owner[:0], weight[:0], corners[:0])]
    # Every piece has its own list of what may hide some of it, and is cut by the first: a piece of a piece meets fewer.
    row, piece = ragged(start[owner], np.diff(start)[owner])
    while len(owner):
        some = _touched(corners, planes, piece, row)
        row, piece = row[some], piece[some]
        first = runs(piece)
        waiting = np.zeros(len(owner), bool)
        waiting[piece] = True
        seen.append((owner[~waiting], weight[~waiting], corners[~waiting]))
        cut = np.flatnonzero(waiting)
        owner, weight, corners = owner.take(cut), weight.take(cut), corners.take(cut, 0)
        now = row[first]
        parent, weight, corners = _subtract(weight, corners, planes.take(now, 1), passes[blocker[now]])
        owner = owner[parent]
        members, piece = ragged(first[parent] + 1, np.diff(first, append=len(row))[parent] - 1)
        row = row[members]
    owners, weights, pieces = zip(*seen, strict=True)
    owner, weight, corners = np.concatenate(owners), np.concatenate(weights), _joined(pieces)
    found = weight[:, None] * light(owner, corners)
    return np.stack([np.bincount(owner, x, minlength=count) for x in found.T], 1)


def _reach(points, owner, corners, blockers, pair, blocker, depth) -> tuple[np.ndarray, np.ndarray]:
    """(r,) bool: the cone of the row's blocker may meet the polygon of the row's pair; and surely holds all of it.

    Most meet nothing, so this is done in float32 with rows running fastest; what rounding leaves open is left to the exact cut.
    """
    first = np.searchsorted(owner, np.arange(len(points) + 1))
    meets, covers = np.zeros(len(pair), bool), np.zeros(len(pair), bool)
    polygon = np.ascontiguousarray(corners.transpose(1, 2, 0), dtype=np.float32)
    plates = np.ascontiguousarray(blockers.corners.transpose(1, 2, 0))
    # Normals about which the corners turn to the left; the diagonals tell, also for a triangle with its double corner.
    faces = np.ascontiguousarray(blockers.normal.T)
    faces *= np.sign((_cross(plates[2] - plates[0], plates[3] - plates[1]) * faces).sum(0))
    for begin in range(0, len(pair), _ROWS):
        here = slice(begin, begin + _ROWS)
        p = pair[here]
        members, row = ragged(first[p], np.diff(first)[p])
        plate, face = plates.take(blocker[here], 2), faces.take(blocker[here], 1)
        plate -= points.take(p, 0).T
        touched, held = _cone_test(plate, face, polygon, members, row, blockers.clearance, depth)
        meets[here] = np.bincount(row[touched], minlength=len(p)) > 0
        covers[here] = np.bincount(row[held], minlength=len(p)) == np.diff(first)[p]
    return meets, covers


def _cone_test(
    plate: np.ndarray, face: np.ndarray, polygon: np.ndarray, members: np.ndarray, row: np.ndarray, clearance: float, depth: float
) -> tuple[np.ndarray, np.ndarray]:
    """Indices into ``members`` (m,) of convex pieces (k, 3, n) that may meet the hidden side of plates (4, 3, r); that surely lie in it.

    All corners are relative to the point that looks;  face : (3, r) unit normals of the plates, which turn to the left about them
    """
    # Seen from the point all edges turn the same way.
    away = face[0] * plate[0, 0] + face[1] * plate[0, 1] + face[2] * plate[0, 2]
    turn = np.sign(away)
    # A plate whose plane holds the point hides nothing.
    left = np.flatnonzero((np.abs(away) > clearance)[row])
    held, edges = np.ones(len(left), bool), np.zeros(len(left), np.int8)
    sides = [(plate[k], plate[(k + 1) % 4]) for k in range(4)]
    for side in (*sides, None):
        r = row.take(left)
        if side is None:
            normal, offset = (face * turn).take(r, 1), depth * np.abs(away.take(r))
        else:
            normal, offset = _cross(side[0].take(r, 1), side[1].take(r, 1)) * turn.take(r), 0
        # In float32 a product of three lengths keeps six digits of the largest.
        slack = 1e-5 * np.sqrt((normal * normal).sum(0))
        height = _heights(polygon.take(members.take(left), 2), normal)
        # An edge seen end on, or between the two equal corners of a triangle, bounds nothing.
        flat = slack == 0
        held &= (height.min(0) - offset > slack) | flat
        some = np.flatnonzero((height.max(0) - offset > -slack) | flat)
        edges += ~flat
        left, held, edges = left.take(some), held.take(some), edges.take(some)
    # A plate of fewer edges than a triangle, and its plane, is finer than single precision.
    solid = edges > 3
    return left[solid], left[held & solid]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, r) cross products of vectors (3, r)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _touched(corners: np.ndarray, planes: np.ndarray, piece: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Indices of the pairs (piece, row) where no half-space of the row's ``planes`` (h, r, 4) is clear of the piece's corners (n, k, 3)."""
    found = []
    turned = np.ascontiguousarray(corners.transpose(1, 2, 0))
    slack = _slack(corners)
    step = max(1, _CORNERS // corners.shape[1])
    for begin in range(0, len(piece), step):
        left = np.arange(begin, min(begin + step, len(piece)))
        for plane in planes:
            p, normal = piece.take(left), plane.take(row.take(left), 0).T
            height = _heights(turned.take(p, 2), normal)
            left = left.take(np.flatnonzero(height.max(0) + normal[3] > slack.take(p)))
        found.append(left)
    return np.concatenate(found) if found else np.zeros(0, np.int64)


def _heights(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(k, r) products of corners (k, 3, r) with a normal (3 or more, r) each."""
    height = corners[:, 0] * normal[0]
    height += corners[:, 1] * normal[1]
    height += corners[:, 2] * normal[2]
    return height


def _slack(corners: np.ndarray) -> np.ndarray:
    """(n,) the rounding of heights over planes of convex pieces (n, k, 3)."""
    return 1e-9 * np.abs(corners).max((1, 2), initial=0)


def _cones(blockers: Blockers, k: np.ndarray, points: np.ndarray, depth: float) -> np.ndarray:
    """(5, n, 4) half-spaces (normal, offset), relative to the points (n, 3), whose common part blockers k hide from them.

    A blocker whose plane holds the point hides nothing: its half-spaces are empty.
    """
    corners = blockers.corners.take(k, 0).astype(np.float64) - points[:, None]
    # A triangle has its last corner twice: the edge between is none, and everything is inside its half-space.
    side = cross(corners, following(corners))
    side *= np.sign(np.einsum("nkd,nd->nk", side, corners.mean(1)))[..., None]
    length = np.linalg.norm(side, axis=2, keepdims=True)
    side /= np.maximum(length, 1e-300)
    normal = blockers.normal.take(k, 0).astype(np.float64)
    height = np.einsum("nd,nd->n", corners[:, 0], normal)
    planes = np.zeros((5, len(k), 4))
    planes[1:, :, :3] = side.transpose(1, 0, 2)
    planes[1:, :, 3] = (length[..., 0] <= 0).T
    planes[0, :, :3] = normal * np.sign(height)[:, None]
    planes[0, :, 3] = -depth * (np.abs(height) + blockers.clearance)
    planes[0, np.abs(height) <= blockers.clearance] = [0, 0, 0, -1]
    return planes


def _subtract(weight: np.ndarray, corners: np.ndarray, planes: np.ndarray, passes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is left of convex pieces (n, k, 3) outside the common part of their half-spaces (h, n, 4), as convex pieces: index of the
    piece that each is of, sorted, weights and corners. The part inside stays with as much of its weight as ``passes`` (n,).
    """
    row, rest, slack = np.arange(len(corners)), corners, _slack(corners)
    rows, pieces, missed = [], [], np.zeros(len(corners), bool)
    for plane in planes:
        mine = plane.take(row, 0)
        height = np.einsum("nkd,nd->nk", rest, mine[:, :3]) + mine[:, 3, None]
        # What lies on the plane is no crossing: it would add corner upon corner.
        height[np.abs(height) <= slack.take(row)[:, None]] = 0
        above = height > 0
        some = above.any(1)
        if not some.all():
            missed[row[~some]] = True
            some = np.flatnonzero(some)
            row, rest, height = row.take(some), rest.take(some, 0), height.take(some, 0)
        # Most planes leave most pieces whole.
        cut = np.flatnonzero((height < 0).any(1))
        if len(cut):
            whole, height = rest.take(cut, 0), height.take(cut, 0)
            sides = clip_half(np.concatenate([whole, whole]), np.concatenate([-height, height]))
            rows.append(row[cut])
            pieces.append(sides[: len(cut)])
            rest = np.concatenate([rest, rest[:, -1:]], axis=1)
            rest[cut] = sides[len(cut) :]
    glass = passes[row] > 0
    rows, pieces = [*rows, row[glass]], [*pieces, rest[glass]]
    weights = np.concatenate([*(weight[r] for r in rows[:-1]), (weight * passes)[rows[-1]]])
    row, corners_left = np.concatenate(rows), _joined(pieces)
    # Nothing inside all of them: the piece has not to be in parts.
    kept, whole = np.flatnonzero(~missed[row] & _has_area(corners_left)), np.flatnonzero(missed)
    row = np.concatenate([whole, row[kept]])
    order = np.argsort(row, kind="stable")
    left = _tight(_joined([corners.take(whole, 0), corners_left.take(kept, 0)]).take(order, 0))
    return row.take(order), np.concatenate([weight[whole], weights[kept]]).take(order), left


def _tight(corners: np.ndarray) -> np.ndarray:
    """Convex pieces (n, k, 3) with as few slots as the one with most corners needs; a repeated corner is one corner."""
    distinct = np.ones(corners.shape[:2], bool)
    (corners[:, 1:] != corners[:, :-1]).any(2, out=distinct[:, 1:])
    number = distinct.sum(1)
    need = max(3, int(number.max(initial=0)))
    if need >= corners.shape[1]:
        return corners
    place = np.argsort(~distinct, axis=1, kind="stable")
    place = np.take_along_axis(place, np.minimum(np.arange(need), number[:, None] - 1), 1)
    return np.take_along_axis(corners, place[..., None], 1)


def _joined(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """One array of pieces (n, k, 3), the last corner of short ones repeated."""
    most = max(p.shape[1] for p in pieces)
    return np.concatenate([p if p.shape[1] == most else p.take(np.minimum(np.arange(most), p.shape[1] - 1), 1) for p in pieces])


def _has_area(corners: np.ndarray) -> np.ndarray:
    """(n,) bool of pieces (n, k, 3)."""
    local = corners - corners[:, :1]
    area = np.linalg.norm(cross(local, following(local)).sum(1), axis=1)
    return area > 1e-14 * np.abs(corners).max((1, 2), initial=1e-30) ** 2
