"""Which pieces of surfaces no light can get to: what solids that touch or pierce each other hide between them."""

from __future__ import annotations

import numpy as np

from .box_tree import BoxTree
from .grouping import components
from .occlusion import Blockers, hemisphere
from .plane_cuts import holds
from .polygons import areas_and_centroids
from .ray_tree import RayTree, lies_in
from .regions import Regions

RAYS = (1, 3, 8, 64)
"""Rays from the middle of a piece: a few join nearly all of a room, the others go where that leaves doubts."""
_SURE = 8
HOLLOW = 0.1
"""Part of the rays of a hollow that meets backs, at least. A dark room next door, through whose door no ray fell, has less."""
SHINING = 0.3
"""The same where surfaces of the hollow shine: more is at stake."""


def buried(regions: Regions, blockers: Blockers, owner: np.ndarray, pieces: np.ndarray, contact: float) -> np.ndarray:
    """(n,) bool: pieces (n, k, 2), in the frames of the regions ``owner`` (n,), that no light gets to.

    All rays from the middle of such a piece meet backs, or nothing behind a face that lies on it; or the piece belongs to a hollow:
    pieces that see each other and many backs, and neither the rest of their room nor a way out. contact : metres
    """
    sight = _Sight(regions, blockers, owner, pieces, contact)
    count, area = len(owner), np.maximum(areas_and_centroids(pieces)[0], 0.0)
    room, shines = regions.room[owner], (regions.emission[owner] > 0).any(1)
    edges, backs, free = np.zeros((2, 0), np.int64), np.zeros(count), np.zeros(count, bool)
    blind = np.zeros(count, bool)
    asked = np.arange(count)
    for rays in RAYS:
        seen, back, out = sight.look(asked, rays)
        edges = np.concatenate([edges, np.stack([np.repeat(asked, rays)[seen.reshape(-1) >= 0], seen[seen >= 0]])], axis=1)
        free[asked] |= out.any(1)
        if rays >= _SURE:
            blind[asked[back.all(1)]] = True
        # A front that nothing can be seen from sends no light either: it hides as well as a back.
        edges = edges[:, ~blind[edges].any(0)]
        backs[asked] = (back | (seen >= 0) & blind[seen]).mean(1)
        group = components(count, *edges)
        size = np.bincount(group, area, minlength=count)
        largest = np.zeros(int(room.max(initial=0)) + 1)
        np.maximum.at(largest, room, size[group])
        apart = size[group] < largest[room]
        bright = np.bincount(group, shines, minlength=count) > 0
        dark = np.bincount(group, area * backs, minlength=count) >= np.where(bright, SHINING, HOLLOW) * size
        doubtful = apart & ((rays == RAYS[0]) | dark[group])
        asked = np.flatnonzero(~blind & (doubtful | (backs > 0) & (rays < _SURE)))
        if not len(asked):
            break
    way_out = np.bincount(group, free, minlength=count) > 0
    return blind | apart & ~way_out[group] & dark[group]


class _Sight:
    """Rays from the middles of pieces of regions, and the pieces that they meet."""

    def __init__(self, regions: Regions, blockers: Blockers, owner: np.ndarray, pieces: np.ndarray, contact: float) -> None:
        area, moment = areas_and_centroids(pieces)
        middle = moment / np.maximum(area, 1e-300)[:, None]
        self._regions, self._pieces, self._contact = regions, pieces, contact
        self._origin = regions.world(owner, middle)
        self._frame = np.stack([regions.u[owner], regions.v[owner], regions.normal[owner]], axis=1)
        self._room = regions.room[owner]
        self._blockers, self._tree = blockers, RayTree(blockers, regions.room[blockers.region])
        self._places = BoxTree(pieces.min(1), pieces.max(1), owner)

    def look(self, rows: np.ndarray, rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays from pieces (n,): the piece (n, rays) whose front each meets, -1 for none; and (n, rays) bool: it meets a back; is free."""
        direction = np.einsum("rk,nkd->nrd", hemisphere(rays), self._frame[rows]).reshape(-1, 3)
        origin = np.repeat(self._origin[rows], rays, 0)
        hits = self._tree.first_hits(origin, direction, np.repeat(self._room[rows], rays))
        front = np.flatnonzero(hits.side > 0)
        seen = np.full(len(origin), -1)
        there = origin[front] + hits.way[front, None] * direction[front]
        seen[front] = self._piece_at(self._blockers.region[hits.blocker[front]], there)
        # Rays pass through a twin. One side of a wall without thickness sees the room all the same; the underside of a
        # cupboard looks into the floor, where there is nothing. What two faces share is no sign of either.
        nothing = ((hits.side == 0) & ~hits.passed).reshape(-1, rays)
        some = np.flatnonzero(nothing.any(1))
        twin = np.zeros(len(rows), bool)
        twin[some] = self._has_twin(rows[some])
        back, passed = (hits.side < 0).reshape(-1, rays) | nothing & twin[:, None], hits.passed.reshape(-1, rays)
        return seen.reshape(-1, rays), back | passed & back.any(1, keepdims=True), nothing & ~twin[:, None]

    def _piece_at(self, region: np.ndarray, position: np.ndarray) -> np.ndarray:
        """(n,) piece of regions (n,) that holds positions (n, 3), -1 for none."""
        regions = self._regions
        uv = regions.local(region, position + regions.centre)
        found = np.full(len(region), -1)
        for piece, row in self._places.overlaps(uv - self._contact, uv + self._contact, region):
            inside = holds(self._pieces[piece], uv[row][:, None], -self._contact)[:, 0]
            found[row[inside]] = piece[inside]
        return found

    def _has_twin(self, rows: np.ndarray) -> np.ndarray:
        """(n,) bool: a blocker that faces the other way holds the middle of the piece."""
        blockers, origin, normal = self._blockers, self._origin[rows], self._frame[rows, 2]
        k, point = self._tree.at(origin, self._room[rows], self._contact)
        opposed = np.einsum("ij,ij->i", normal[point], blockers.normal[k]) < -1 + 1e-6
        out = np.zeros(len(rows), bool)
        out[point[opposed & lies_in(blockers, k, origin[point], self._contact)]] = True
        return out
