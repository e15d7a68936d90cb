"""Which side of a surface rays meet first among very many blockers: only those are tested whose boxes a ray touches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .box_tree import BoxTree
from .occlusion import Blockers


@dataclass(frozen=True)
class FirstHits:
    """What n rays meet first.

    side : (n,) int8, a front 1, a back -1, nothing 0;  blocker : (n,) int64, -1 for nothing;  way : (n,) float64, metres
    passed : (n,) bool, nothing, but only behind faces of both sides in one place
    """

    side: np.ndarray
    blocker: np.ndarray
    way: np.ndarray
    passed: np.ndarray


class RayTree:
    """Blockers of many rooms, met by rays of the same room only.

    group : (K,) int room of every blocker
    """

    def __init__(self, blockers: Blockers, group: np.ndarray) -> None:
        self.blockers = blockers
        corners, margin = blockers.corners.astype(np.float64), 4 * blockers.clearance
        low, high = corners.min(1) - margin, corners.max(1) + margin
        self._tree = BoxTree(low, high, group)
        self._far = 2 * float(np.abs(corners).max(initial=0.0))
        self._near = max(4 * float(np.median(blockers.size)), 1e-3 * self._far) if len(blockers) else 0.0
        self._same = margin

    def first_hits(self, origins: np.ndarray, directions: np.ndarray, group: np.ndarray) -> FirstHits:
        """What rays from ``origins`` along unit ``directions`` (n, 3) meet first in their ``group`` (n,).

        A front and a back in one place are where one solid touches the next: rays pass on. A blocker whose plane holds the
        origin is not met.
        """
        side, first, way = np.zeros(len(origins), np.int8), np.full(len(origins), -1), np.zeros(len(origins))
        passed = np.zeros(len(origins), bool)
        left, reach = np.arange(len(origins)), self._near
        while len(left) and len(self.blockers):
            # Most rays end close by: the others are followed farther.
            last = reach >= self._far
            rays = (origins[left], directions[left])
            for blocker, ray in self._tree.along(*rays, group[left], np.inf if last else reach):
                near = _nearness(self.blockers, blocker, *(end.take(ray, 0) for end in rays))
                met = np.flatnonzero(near > (0 if last else 1 / reach))
                passed[left[ray[met]]] = True
                place, ray, sense = self._nearest(blocker[met], ray[met], 1 / near[met], rays[1])
                # What may be one of two faces in one place is left to the next turn, which sees both.
                sure = np.flatnonzero(last | (near[met[place]] > 1 / (reach - self._same)))
                rows, met = left[ray[sure]], met[place[sure]]
                side[rows], first[rows], way[rows] = sense[sure], blocker[met], 1 / near[met]
            left = np.zeros(0, np.int64) if last else left[side[left] == 0]
            reach *= 4
        return FirstHits(side, first, way, passed & (side == 0))

    def _nearest(self, blocker: np.ndarray, ray: np.ndarray, way: np.ndarray, directions: np.ndarray):
        """Of hits (n,) those that end a ray: their index (k,), ray (k,) and side (k,)."""
        order = np.lexsort((blocker, way, ray))
        blocker, ray, way = blocker[order], ray[order], way[order]
        sense = -np.sign(np.einsum("ij,ij->i", directions[ray], self.blockers.normal[blocker]))
        place = np.flatnonzero(np.r_[True, (np.diff(ray) > 0) | (np.diff(way) > self._same)][: len(ray)])
        balance = np.add.reduceat(sense, place) if len(place) else sense
        place, balance = place[balance != 0], balance[balance != 0]
        nearest = np.flatnonzero(np.r_[True, np.diff(ray[place]) > 0][: len(place)])
        place = place[nearest]
        return order[place], ray[place], np.sign(balance[nearest])

    def at(self, points: np.ndarray, group: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (blocker (k,), point (k,)): blockers whose boxes come within ``margin`` (m) of points (n, 3) of their group."""
        pairs = list(self._tree.overlaps(points - margin, points + margin, group))
        return tuple(np.concatenate([np.zeros(0, np.int64), *column]) for column in (zip(*pairs, strict=True) if pairs else ((), ())))


def lies_in(blockers: Blockers, k: np.ndarray, points: np.ndarray, margin: float) -> np.ndarray:
    """(n,) bool: points (n, 3) lie in blockers k (n,), up to ``margin`` (m) off their planes."""
    height, x, y = (
        np.einsum("ij,ij->i", points, axis[k]) - blockers.offset[k, i]
        for i, axis in enumerate((blockers.normal, blockers.dual_x, blockers.dual_y))
    )
    inside = np.where(blockers.triangle[k], (x >= 0) & (y >= 0) & (x + y <= 1), (np.abs(x) <= 1) & (np.abs(y) <= 1))
    return (np.abs(height) < margin) & inside


def _nearness(blockers: Blockers, k: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(n,) one over the distance at which rays meet blockers k (n,), 0 where they do not."""
    dot = lambda a, b: np.einsum("ij,ij->i", a, b)  # noqa: E731
    offset, normal = blockers.offset.take(k, 0), blockers.normal.take(k, 0)
    height = dot(o, normal) - offset[:, 0]
    clear = np.abs(height) > blockers.clearance
    w = np.where(clear, -dot(d, normal) / np.where(clear, height, 1), 0)
    duals = (blockers.dual_x.take(k, 0), blockers.dual_y.take(k, 0))
    x, y = ((dot(o, dual) - offset[:, i]) * w + dot(d, dual) for i, dual in enumerate(duals, 1))
    inside = np.where(blockers.triangle[k], (x >= 0) & (y >= 0) & (x + y <= w), np.maximum(np.abs(x), np.abs(y)) <= w)
    return np.where(inside & (w > 0), w, 0)
