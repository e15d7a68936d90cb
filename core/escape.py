"""Light that no surface receives: rays from all surfaces tell how much leaves through openings or strikes backs.

The rays know nothing of links or kernels, so that emitted = absorbed + escaped is a check of the solution by other means.
They also tell which rooms are closed: there every point must receive from all sides, which corrects the links (closure).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .building import Building
from .coverage import covered
from .elements import Forest
from .grouping import ragged, runs
from .occlusion import first_hits, kronecker
from .parallel import Crew
from .regions import Regions

RAYS = 1 << 15
"""Rays for a whole building; a room gets ``MIN_RAYS`` of them at least."""
MIN_RAYS = 64

LEAK = 1e-2
"""Share of lost rays up to which a room counts as closed: what slips through seams, or starts in furniture that meets other furniture."""
_BLOCK = 1 << 15
"""Leaves that are worked on at once, about."""
_ROUNDING = 1e-5
"""Metres by which a node may lie beside its surface."""


def lost_share(building: Building, forest: Forest, crew: Crew) -> np.ndarray:
    """(R,) share of the rays from the surfaces of each room that no surface receives; a room is closed up to ``LEAK``."""
    room, _, lost = _cast(building, forest, lambda leaf: _open_weight(building, forest, leaf), crew)
    number = np.bincount(room, minlength=building.room_count)
    return np.bincount(room, lost, minlength=building.room_count) / np.maximum(number, 1)


def escaped_power(building: Building, forest: Forest, irradiance: np.ndarray, share: np.ndarray, crew: Crew) -> float:
    """W, all channels together, that leave the building or strike backs.

    irradiance : (E, m, 3) of every element, W/m2;  share : (R,) of :func:`lost_share`. Rooms that are not closed cast rays
    anew, each with the same part of the power of its room, so that a small lamp has as many as it has light. In closed rooms
    the share holds for what their surfaces reflect, which is how their links are closed; a lamp is no mean of them.
    """
    regions = building.regions
    slow = share * (share <= LEAK)

    def reflected(leaf: np.ndarray) -> np.ndarray:
        """(n, q*q) W/m2."""
        light = np.maximum(forest.at_nodes(leaf, irradiance[leaf]), 0)
        return (regions.reflectance[forest.region[leaf], None] * light).sum(2)

    def sent(leaf: np.ndarray) -> np.ndarray:
        """(n, q*q) W in rooms that are not closed, 0 in others."""
        region = forest.region[leaf]
        emitted = regions.emission[region].sum(1, keepdims=True)
        return (emitted + reflected(leaf)) * _open_weight(building, forest, leaf) * (share > LEAK)[regions.room[region], None]

    leaves, _, cuts = _leaves_by_room(building, forest)
    through_seams = 0.0
    for leaf in np.split(leaves, cuts):
        power = (reflected(leaf) * _open_weight(building, forest, leaf)).sum(1)
        through_seams += float((power * slow[regions.room[forest.region[leaf]]]).sum())
    _, power, lost = _cast(building, forest, sent, crew)
    return through_seams + float(power[lost].sum())


def _open_weight(building: Building, forest: Forest, leaf: np.ndarray) -> np.ndarray:
    """(n, q*q) float32 weights of the nodes of leaves, 0 of those that are buried."""
    return forest.node_weights_of(leaf) * ~building.regions.buried[forest.region[leaf], None]


def _leaves_by_room(building: Building, forest: Forest) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The leaves (n,) int32 in the order of their rooms, their rooms (n,), and where to cut them into blocks of whole rooms."""
    leaf = np.flatnonzero(forest.leaf).astype(np.int32)
    room = building.regions.room[forest.region[leaf]]
    leaf = leaf[np.argsort(room, kind="stable")]
    room.sort()
    begins = np.flatnonzero(np.diff(room)) + 1
    return leaf, room, begins[runs(begins // _BLOCK)]


def _cast(
    building: Building, forest: Forest, weight: Callable[[np.ndarray], np.ndarray], crew: Crew
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays from the nodes of leaves, as many as the ``weight`` (n, q*q) of leaves (n,) asks for: room (n,), weight (n,) and (n,) bool
    lost of each.
    """
    leaves, room, cuts = _leaves_by_room(building, forest)
    blocks, total = list(zip(np.split(leaves, cuts), np.split(room, cuts), strict=True)), np.zeros(building.room_count)
    for leaf, within in blocks:
        total += np.bincount(np.repeat(within, forest.node_count), weight(leaf).reshape(-1), minlength=len(total))
    number = np.maximum(MIN_RAYS, np.round(RAYS * total / max(total.sum(), 1e-300))).astype(np.int64) * (total > 0)
    owners, elements, nodes = ([np.zeros(0, np.int64)] for _ in range(3))
    for leaf, within in blocks:
        # Equal steps along the running weight of a room: points spread evenly over its surfaces.
        rooms = within[runs(within)]
        size, count = total[rooms], number[rooms]
        running, begin = np.cumsum(weight(leaf).astype(np.float64)), np.cumsum(size) - size
        rank, own = ragged(np.zeros(len(rooms)), count)
        position = begin[own] + (rank + 0.5) / count[own] * size[own]
        chosen = np.minimum(np.searchsorted(running, position), len(running) - 1)
        owners.append(rooms[own])
        elements.append(leaf[chosen // forest.node_count])
        nodes.append(chosen % forest.node_count)
    owner, element, node = (np.concatenate(x) for x in (owners, elements, nodes))
    kept = np.flatnonzero(_on_the_surface(building.regions, forest, element, node))
    owner, element, node = owner[kept], element[kept], node[kept]
    number = np.bincount(owner, minlength=building.room_count)
    direction = _directions(len(owner), building.regions, forest.region[element])
    lost = np.zeros(len(owner), bool)
    cuts = np.flatnonzero(np.diff(owner)) + 1
    blocks = np.split(np.arange(len(owner)), cuts) if len(owner) else []
    for rows, result in crew.map(_lost, (building, forest.region[element], forest.node_of(element, node), direction), blocks):
        lost[rows] = result
    return owner, total[owner] / np.maximum(number[owner], 1), lost


def _on_the_surface(regions: Regions, forest: Forest, element: np.ndarray, node: np.ndarray) -> np.ndarray:
    """(n,) bool: the node is a place of its surface. Where this goes around what stands on it, the middle of a part may lie under that."""
    out = np.ones(len(element), bool)
    cut = np.flatnonzero(forest.cut(element))
    region = forest.region[element[cut]]
    uv = regions.local(region, forest.node_of(element[cut], node[cut]) + regions.centre)
    out[cut] = covered(regions, region, uv, _ROUNDING)
    return out


def _lost(
    building: Building, region: np.ndarray, origin: np.ndarray, direction: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which of the rays ``rows`` (k,), all from one room, meet nothing or a back: (rows, (k,) bool)."""
    cluster = np.unique(building.clusters.cluster_of[region[rows]])
    near = building.blockers_of(building.regions_of(building.surroundings(cluster))[0])
    hits = first_hits(near, origin[rows], direction[rows])
    return rows, (hits.blocker < 0) | hits.behind


def _directions(count: int, regions: Regions, region: np.ndarray) -> np.ndarray:
    """(n, 3) float32 cosine-distributed directions about the normals of ``region``, a two-dimensional Kronecker sequence."""
    first, second = kronecker(np.arange(count))
    radius, angle = np.sqrt(first), 2 * np.pi * second
    local = (radius * np.cos(angle), radius * np.sin(angle), np.sqrt(np.maximum(1 - first, 0)))
    return sum(x[:, None] * axis[region] for x, axis in zip(local, (regions.u, regions.v, regions.normal), strict=True)).astype(np.float32)
