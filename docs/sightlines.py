"""Sightlines by brute force, to measure the visibility graph against: rays and segments, no planes, no windows, no graph."""

from __future__ import annotations

import numpy as np

from ..core.clustering import ClusterItems, Clusters
from ..core.occlusion import Blockers, first_hits
from ..core.polygons import decompose
from ..core.regions import Regions
from ..core.scene import Scene

STEPS = 12
"""Most portals that a line is followed through."""
NEAR = 1e-5
"""Lengths below this are rounding, metres."""
_SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def _crossings(scene: Scene, portals: np.ndarray, p: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, k) where lines p + t d (n, 3) cross the interior of portals (k,), infinite elsewhere, and from their first to second room."""
    t, forward = np.full((len(p), len(portals)), np.inf), np.zeros((len(p), len(portals)), bool)
    for column, k in enumerate(portals):
        corner = scene.portals.polygon(k)
        normal = np.cross(corner - corner[0], np.roll(corner, -1, axis=0) - corner[0]).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = ((corner[0] - p) @ normal) / (d @ normal)
            at = p + way[:, None] * d
            inside = np.isfinite(way)
            for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True):
                inside &= (at - a) @ np.cross(normal, b - a) > 0
        t[inside, column] = way[inside]
        forward[:, column] = d @ normal > 0
    return t, forward


def seen(
    scene: Scene, surfaces: Regions, blockers: Blockers, clusters: Clusters, a: int, b: int, segments: int, rng: np.random.Generator
) -> tuple[bool, bool]:
    """Does one of ``segments`` between two clusters pass portals from room to room, and does one that does meet nothing else?"""
    p, q = (_points(scene, clusters, c, segments, rng) for c in (a, b))
    low, high = np.minimum(p.min(axis=0), q.min(axis=0)) - NEAR, np.maximum(p.max(axis=0), q.max(axis=0)) + NEAR
    near = [
        k
        for k in range(len(scene.portals))
        if (scene.portals.rooms[k] >= 0).all()
        and (scene.portals.polygon(k).max(0) >= low).all()
        and (scene.portals.polygon(k).min(0) <= high).all()
    ]
    if not near:
        return False, False
    t, forward = _crossings(scene, np.array(near), p, q - p)
    ends = scene.portals.rooms[near]
    room, reached = np.full(segments, clusters.room[a]), np.zeros(segments)
    alive = np.ones(segments, bool)
    for _ in range(STEPS):
        before = np.where(forward, ends[:, 0], ends[:, 1])
        ahead = np.where((before == room[:, None]) & (t > reached[:, None] + 1e-9) & (t < 1), t, np.inf)
        nearest = ahead.argmin(axis=1)
        moves = alive & np.isfinite(ahead[np.arange(segments), nearest])
        if not moves.any():
            break
        room[moves] = ends[nearest[moves]].sum(axis=1) - room[moves]
        reached[moves] = t[moves, nearest[moves]]
        alive &= room != clusters.room[b]
    passed = np.flatnonzero(room == clusters.room[b])
    if not len(passed):
        return False, False
    within = blockers.within(low - surfaces.centre, high - surfaces.centre)
    for rows in np.array_split(passed, max(1, len(passed) * len(within) >> 20)):
        origin, d = p[rows] - surfaces.centre, q[rows] - p[rows]
        length = np.linalg.norm(d, axis=1)
        d = (d / length[:, None]).astype(np.float32)
        hits = first_hits(within, origin.astype(np.float32), d)
        met = np.flatnonzero(hits.blocker >= 0)
        way = np.full(len(rows), np.inf)
        k = hits.blocker[met]
        height = np.einsum("ij,ij->i", origin[met], within.normal[k]) - within.offset[k, 0]
        way[met] = -height / np.einsum("ij,ij->i", d[met], within.normal[k])
        if (way > length - 1e-3).any():
            return True, True
    return True, False


def _points(scene: Scene, clusters: Clusters, c: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) points on the polygons of a cluster, taken as fans of triangles, by area."""
    polygons = clusters.members[clusters.start[c] : clusters.start[c + 1]]
    loops = [scene.corner_vertex[scene.loop_start[k] : scene.loop_start[k + 1]] for k in scene.polygon_start[polygons]]
    corner = np.array([scene.vertices[[loop[0], loop[i], loop[i + 1]]] for loop in loops for i in range(1, len(loop) - 1)])
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    chosen = corner[rng.choice(len(corner), count, p=area / area.sum())]
    return np.einsum("nk,nkc->nc", rng.dirichlet(np.ones(3), count), chosen)


def pairs_met(scene: Scene, cluster_of: np.ndarray, rays: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Clusters (m,) and (m,), pairs in different rooms that rays join, each once, the lesser cluster first.

    Rays start on polygons, half of them towards a random point of a random portal of the room, and go through portals until
    they meet a polygon; in each room only what belongs to it stops them.
    """
    rng = np.random.default_rng(seed)
    pieces = decompose(scene)
    source = rng.choice(len(pieces.polygon), rays, p=pieces.area / pieces.area.sum())
    s, t = rng.random((2, rays, 1))
    fold = pieces.triangle[source, None] & (s + t > 1)
    s, t = np.where(fold, 1 - s, s), np.where(fold, 1 - t, t)
    p = pieces.origin[source] + s * pieces.a[source] + t * pieces.b[source]
    normal = np.cross(pieces.a, pieces.b)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    room = scene.room[pieces.polygon[source]].astype(np.int64)
    d = rng.normal(size=(rays, 3))
    doors = [
        np.flatnonzero((scene.portals.rooms == r).any(axis=1) & (scene.portals.rooms >= 0).all(axis=1)) for r in range(scene.room_count)
    ]
    for ray in np.flatnonzero(rng.random(rays) < 0.5):
        if len(doors[room[ray]]):
            corner = scene.portals.polygon(rng.choice(doors[room[ray]]))
            d[ray] = rng.dirichlet(np.ones(len(corner))) @ corner - p[ray]
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    piece_room = scene.room[pieces.polygon]
    reached, met, alive = np.full(rays, NEAR), np.full(rays, -1), np.arange(rays)
    for _ in range(STEPS):
        onward = [np.zeros(0, np.int64)]
        for r in np.unique(room[alive]):
            rows, here = alive[room[alive] == r], np.flatnonzero(piece_room == r)
            wall = np.full(len(rows), np.inf)
            for part in np.array_split(np.arange(len(rows)), max(1, len(rows) * len(here) >> 20)):
                at = _hits(pieces, normal, here, p[rows[part]], d[rows[part]], reached[rows[part]])
                first = at.argmin(axis=1)
                wall[part] = at[np.arange(len(part)), first]
                met[rows[part]] = np.where(np.isfinite(wall[part]), pieces.polygon[here[first]], -1)
            cross, forward = _crossings(scene, doors[r], p[rows], d[rows])
            fits = np.where(forward, scene.portals.rooms[doors[r], 0], scene.portals.rooms[doors[r], 1]) == r
            cross = np.where(fits & (cross > reached[rows, None]), cross, np.inf)
            cross = np.column_stack([cross, np.full(len(rows), np.inf)])
            door = cross.argmin(axis=1)
            through = np.flatnonzero(cross[np.arange(len(rows)), door] < wall)
            room[rows[through]] = scene.portals.rooms[doors[r][door[through]]].sum(axis=1) - r
            reached[rows[through]] = cross[through, door[through]]
            met[rows[through]] = -1
            onward.append(rows[through])
        alive = np.concatenate(onward)
    done = np.flatnonzero(met >= 0)
    a, b = cluster_of[pieces.polygon[source[done]]], cluster_of[met[done]]
    across = scene.room[pieces.polygon[source[done]]] != scene.room[met[done]]
    pairs = np.unique(np.sort(np.stack([a, b], axis=1)[across], axis=1), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _hits(pieces, normal: np.ndarray, here: np.ndarray, p: np.ndarray, d: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """(n, k) way along rays to the pieces ``here``, infinite where they are not met."""
    a, b, n = pieces.a[here], pieces.b[here], normal[here]
    across = np.linalg.norm(np.cross(a, b), axis=1)[:, None]
    dual_a, dual_b = np.cross(b, n) / across, np.cross(n, a) / across
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (np.einsum("kc,kc->k", n, pieces.origin[here]) - p @ n.T) / (d @ n.T)
        s = p @ dual_a.T + way * (d @ dual_a.T) - np.einsum("kc,kc->k", dual_a, pieces.origin[here])
        t = p @ dual_b.T + way * (d @ dual_b.T) - np.einsum("kc,kc->k", dual_b, pieces.origin[here])
        inside = (s >= 0) & (t >= 0) & np.where(pieces.triangle[here], s + t <= 1, (s <= 1) & (t <= 1))
    return np.where(inside & (way > reached[:, None]), way, np.inf)


def looking_away(items: ClusterItems, clusters: Clusters, matrix: np.ndarray) -> np.ndarray:
    """(C, C) bool: pairs of ``matrix`` where all items of one have the other's box behind them."""
    centre, half = 0.5 * (clusters.box_min + clusters.box_max), 0.5 * (clusters.box_max - clusters.box_min)
    offset = np.einsum("ij,ij->i", items.normal, items.barycenter)
    faces = np.zeros_like(matrix)
    for c in range(len(matrix)):
        near, members = np.flatnonzero(matrix[c]), clusters.members[clusters.start[c] : clusters.start[c + 1]]
        n = items.normal[members]
        faces[c, near] = (n @ centre[near].T + np.abs(n) @ half[near].T - offset[members, None]).max(axis=0) > NEAR
    gone = matrix & ~(faces & faces.T)
    np.fill_diagonal(gone, False)
    return gone


def hidden(items: ClusterItems, clusters: Clusters, matrix: np.ndarray) -> np.ndarray:
    """(C, C) bool: pairs of ``matrix`` that one quadrilateral with a smaller edge above 1 m hides from each other altogether.

    A convex polygon hides two boxes when every segment between their corners crosses it: past an edge, the steepest
    slopes of the two sides, distance outward over height, then add up to no more than zero.
    """
    centre, half = 0.5 * (clusters.box_min + clusters.box_max), 0.5 * (clusters.box_max - clusters.box_min)
    gone = np.zeros_like(matrix)
    for p in np.flatnonzero((np.diff(items.vertex_start) == 4) & (items.smaller_edge > 1.0)):
        corner, normal = items.vertices[items.vertex_start[p] : items.vertex_start[p + 1]], items.normal[p]
        near = np.flatnonzero(matrix[clusters.cluster_of[p]])
        box = centre[near, None] + _SIGNS * half[near, None] - corner[0]
        height = box @ normal
        sides = [near_side for near_side in (height.min(axis=1) > NEAR, height.max(axis=1) < -NEAR)]
        if not (sides[0].any() and sides[1].any()):
            continue
        outward = np.cross(np.roll(corner, -1, axis=0) - corner, normal)
        distance = np.einsum("nvc,kc->nkv", box, outward) - np.einsum("kc,kc->k", corner - corner[0], outward)[:, None]
        slope = [(distance[side] / np.abs(height[side])[:, None]).max(axis=2) for side in sides]
        hides = (slope[0][:, None] + slope[1][None] <= 0).all(axis=2)
        gone[np.ix_(near[sides[0]], near[sides[1]])] |= hides
    return (gone | gone.T) & matrix
