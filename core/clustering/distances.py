"""How far an item is from a cluster: the distances of section 4.3 of the paper, geometric and photometric, and their sums."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..grouping import ragged
from .items import ClusterItems


class Groups:
    """Clusters while they form: the means and the boxes of their items, kept for what a distance has asked for.

    A cluster starts as its seed alone. One that loses all its items stays as it last was, so that it can win some back.
    """

    def __init__(self, items: ClusterItems, seeds: np.ndarray) -> None:
        self._items = items
        self._seeds = seeds
        self._values: dict[str, np.ndarray] = {"barycenter": items.barycenter[seeds]}
        self._rows = self._label = np.zeros(0, np.int64)

    def of(self, name: str) -> np.ndarray:
        """(g, 3) float64: the mean of an attribute of :class:`ClusterItems` over each cluster; of the boxes' corners the extreme."""
        if name not in self._values:
            self._values[name] = getattr(self._items, name)[self._seeds].astype(np.float64)
            self._gather(name)
        return self._values[name]

    def move(self, rows: np.ndarray, label: np.ndarray) -> None:
        """Take ``rows`` (m,) as all the items of the clusters ``label`` (m,) that they name."""
        self._rows, self._label = rows, label
        for name in self._values:
            self._gather(name)

    def _gather(self, name: str) -> None:
        values, new = self._values[name], getattr(self._items, name).take(self._rows, axis=0)
        if name.startswith("box"):
            extreme = np.minimum if name == "box_min" else np.maximum
            values[self._label] = np.inf if name == "box_min" else -np.inf
            extreme.at(values, self._label, new)
            return
        count = np.maximum(np.bincount(self._label, minlength=len(values)), 1)
        for axis in range(3):
            # About where the mean was, so that no digits are lost far from the origin.
            offset = new[:, axis] - values[:, axis].take(self._label)
            values[:, axis] += np.bincount(self._label, offset, minlength=len(values)) / count


class Candidates:
    """The clusters that each item of a block may join, as the last step left them.

    Every attribute is (m, k, 3) float64, one row of k candidates per item, or (1, k, 3) when all items share them.
    """

    def __init__(self, groups: Groups, index: np.ndarray) -> None:
        self._groups = groups
        self._index = index

    @property
    def barycenter(self) -> np.ndarray:
        """Mean of the items' barycenters, metres."""
        return self._groups.of("barycenter").take(self._index, axis=0)

    @property
    def box_min(self) -> np.ndarray:
        """Lower corner of the bounding box of the items, metres."""
        return self._groups.of("box_min").take(self._index, axis=0)

    @property
    def box_max(self) -> np.ndarray:
        """Upper corner of the bounding box of the items, metres."""
        return self._groups.of("box_max").take(self._index, axis=0)

    @property
    def normal(self) -> np.ndarray:
        """Mean of the items' unit normals: shorter than one where they differ."""
        return self._groups.of("normal").take(self._index, axis=0)

    @property
    def reflectance(self) -> np.ndarray:
        """Mean of the items' reflectances, 0..1."""
        return self._groups.of("reflectance").take(self._index, axis=0)

    @property
    def emission(self) -> np.ndarray:
        """Mean of the items' emitted exitances, W/m2."""
        return self._groups.of("emission").take(self._index, axis=0)


Distance = Callable[[ClusterItems, np.ndarray, Candidates], np.ndarray]
"""A distance between items and clusters: ``distance(items, rows, candidates) -> (m, k) float64``.

``rows`` (m,) int64 are the items of the block, ``candidates`` the k clusters that each may join. Entry (i, j) says how far item
``rows[i]`` is from its candidate j. Only the order of the values in a row matters; the first of equal ones wins. Any function of
this form can be given to ``cluster_items``; those of this module may be called in it.
"""


def barycenter_distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Distance between the item's barycenter and the cluster's, metres (section 4.3)."""
    return _point_distance(items.barycenter[rows], candidates.barycenter)


def closest_vertex_distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Distance between the cluster's barycenter and the item's closest vertex, metres (section 4.3)."""
    counts = np.diff(items.vertex_start)[rows]
    vertex, owner = ragged(items.vertex_start[:-1][rows], counts)
    barycenter = candidates.barycenter
    distance = _point_distance(items.vertices[vertex], barycenter if len(barycenter) == 1 else barycenter[owner])
    return np.minimum.reduceat(distance, np.cumsum(counts) - counts, axis=0)


def orthogonal_distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Distance between the cluster's barycenter and the plane of the item, metres (section 4.3).

    An item without area has no plane: the distance to its barycenter then.
    """
    normal, barycenter = items.normal[rows], candidates.barycenter
    height = np.abs(np.einsum("ic,ikc->ik", normal, barycenter - items.barycenter[rows][:, None]))
    flat = ~normal.any(axis=1)
    if flat.any():
        height[flat] = _point_distance(items.barycenter[rows[flat]], barycenter if len(barycenter) == 1 else barycenter[flat])
    return height


def volume_increase(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """What the item adds to the volume of the cluster's bounding box, m3 (section 4.3).

    A flat box has no volume, and grows in its plane for nothing.
    """
    before, after = _box_sizes(items, rows, candidates)
    return after[0] * after[1] * after[2] - before[0] * before[1] * before[2]


def area_increase(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """What the item adds to the surface of the cluster's bounding box, m2.

    Goldsmith and Salmon (1987) mean this: the chance that a ray meets a box goes with its surface.
    """
    before, after = _box_sizes(items, rows, candidates)
    return _box_area(*after) - _box_area(*before)


def reflectance_distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Euclidean distance between the reflectances of the item and the cluster's mean, 0..sqrt(3)."""
    return _difference(items.reflectance[rows], candidates.reflectance)


def emission_distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Euclidean distance between the emitted exitances of the item and the cluster's mean, W/m2."""
    return _difference(items.emission[rows], candidates.emission)


def orientation_distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Euclidean distance between the unit normal of the item and the mean normal of the cluster, 0..2."""
    return _difference(items.normal[rows], candidates.normal)


DISTANCE_FUNCTIONS: dict[str, Distance] = {
    "barycenter": barycenter_distance,
    "closest_vertex": closest_vertex_distance,
    "orthogonal": orthogonal_distance,
    "volume_increase": volume_increase,
    "area_increase": area_increase,
    "reflectance": reflectance_distance,
    "emission": emission_distance,
    "orientation": orientation_distance,
}


def weighted_sum(*terms: tuple[float, Distance]) -> Distance:
    """The distance ``sum of weight * distance``, such as ``weighted_sum((1.0, barycenter_distance), (2.0, reflectance_distance))``.

    Raises ValueError when there are no terms or a weight is negative.
    """
    if not terms or any(not weight >= 0 for weight, _ in terms):
        raise ValueError("a weighted sum of distances takes one term at least, and no negative weight")

    def distance(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> np.ndarray:
        return sum(weight * term(items, rows, candidates) for weight, term in terms)

    return distance


def _point_distance(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    if len(centres) > 1 or len(points) == 1:
        return _difference(points, centres)
    # One matrix product where all share the candidates; taken about their middle so that no digits cancel far from the origin.
    middle = centres[0].mean(axis=0)
    p, b = points - middle, centres[0] - middle
    squared = np.einsum("ij,ij->i", p, p)[:, None] - 2.0 * (p @ b.T) + np.einsum("ij,ij->i", b, b)
    return np.sqrt(np.maximum(squared, 0.0))


def _difference(values: np.ndarray, centres: np.ndarray) -> np.ndarray:
    return np.sqrt(sum((values[:, None, axis] - centres[..., axis]) ** 2 for axis in range(3)))


def _box_sizes(items: ClusterItems, rows: np.ndarray, candidates: Candidates) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Edges of the boxes without the item (m or 1, k) and with it (m, k), axis by axis."""
    low, high = candidates.box_min, candidates.box_max
    item_low, item_high = items.box_min[rows], items.box_max[rows]
    before = [high[..., a] - low[..., a] for a in range(3)]
    return before, [np.maximum(high[..., a], item_high[:, None, a]) - np.minimum(low[..., a], item_low[:, None, a]) for a in range(3)]


def _box_area(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return 2.0 * (x * y + y * z + z * x)
