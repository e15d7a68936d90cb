"""Light that no surface receives: rays from all surfaces tell how much leaves through openings or strikes backs.

The rays know nothing of links or kernels, so that emitted = absorbed + escaped is a check of the solution by other means.
They also tell which rooms are closed: there every point must receive from all sides, which corrects the links (closure).
"""

from __future__ import annotations

import numpy as np

from .building import Building
from .coverage import covered
from .elements import Forest
from .occlusion import first_hits, kronecker
from .parallel import Crew
from .regions import Regions

RAYS = 1 << 15
"""Rays for a whole building; a room gets ``MIN_RAYS`` of them at least."""
MIN_RAYS = 64

LEAK = 1e-2
"""Share of lost rays up to which a room counts as closed: what slips through seams, or starts in furniture that meets other furniture."""
_ROUNDING = 1e-5
"""Metres by which a node may lie beside its surface."""


def lost_share(building: Building, forest: Forest, crew: Crew) -> np.ndarray:
    """(R,) share of the rays from the surfaces of each room that no surface receives; a room is closed up to ``LEAK``."""
    weight = ~building.regions.buried[forest.region, None] * forest.node_weights
    room, _, lost = _cast(building, forest, weight, crew)
    number = np.bincount(room, minlength=building.room_count)
    return np.bincount(room, lost, minlength=building.room_count) / np.maximum(number, 1)


def escaped_power(building: Building, forest: Forest, irradiance: np.ndarray, share: np.ndarray, crew: Crew) -> float:
    """W, all channels together, that leave the building or strike backs.

    irradiance : (E, m, 3) of every element, W/m2;  share : (R,) of :func:`lost_share`. Rooms that are not closed cast rays
    anew, each with the same part of the power of its room, so that a small lamp has as many as it has light. In closed rooms
    the share holds for what their surfaces reflect, which is how their links are closed; a lamp is no mean of them.
    """
    elements = np.arange(len(forest))
    light = np.maximum(forest.at_nodes(elements, irradiance), 0)
    reflected = (forest.regions.reflectance[forest.region, None] * light).sum(2)
    emitted = forest.regions.emission[forest.region].sum(1, keepdims=True)
    sees = forest.node_weights * ~building.regions.buried[forest.region, None] * forest.leaf[:, None]
    room = building.regions.room[forest.region]
    open_ = (share > LEAK)[room]
    slow = float(((reflected * sees).sum(1) * np.where(open_, 0, share[room])).sum())
    _, power, lost = _cast(building, forest, (emitted + reflected) * sees * open_[:, None], crew)
    return slow + float(power[lost].sum())


def _cast(building: Building, forest: Forest, weight: np.ndarray, crew: Crew) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays from the nodes of leaves, as many as their weight (E, q*q) asks for: room (n,), weight (n,) and (n,) bool lost of each."""
    leaf = np.flatnonzero(forest.leaf)
    room = building.regions.room[forest.region[leaf]]
    leaf = leaf[np.argsort(room, kind="stable")]
    node_room = np.repeat(np.sort(room), forest.node_count)
    flat = weight[leaf].astype(np.float64).reshape(-1)
    total = np.bincount(node_room, flat, minlength=building.room_count)
    number = np.maximum(MIN_RAYS, np.round(RAYS * total / max(total.sum(), 1e-300))).astype(np.int64) * (total > 0)
    # Equal steps along the running weight of a room: points spread evenly over its surfaces.
    running, begin = np.cumsum(flat), np.cumsum(total) - total
    owner = np.repeat(np.arange(building.room_count), number)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
    position = begin[owner] + (rank + 0.5) / number[owner] * total[owner]
    chosen = np.minimum(np.searchsorted(running, position), len(flat) - 1)
    element, node = leaf[chosen // forest.node_count], chosen % forest.node_count
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
