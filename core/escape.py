"""Light that no surface receives: rays from all surfaces tell how much leaves through openings or strikes backs.

The rays know nothing of links or kernels, so that emitted = absorbed + escaped is a check of the solution by other means.
They also tell which rooms are closed: there every point must receive from all sides, which corrects the links (closure).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .building import Building
from .elements import Forest
from .occlusion import first_hits
from .parallel import ordered_map

RAYS = 1 << 15
"""Rays for a whole building; a room gets ``MIN_RAYS`` of them at least."""
MIN_RAYS = 64

LEAK = 1e-2
"""Share of lost rays up to which a room counts as closed: what slips through seams, or starts in furniture that meets other furniture."""


@dataclass(frozen=True)
class Probe:
    """Rays from points spread evenly over the surfaces of each room, cosine-distributed.

    element : (n,) int64 leaf, node : (n,) int64 of its nodes;  area : (n,) float64 m2 that the ray speaks for
    lost : (n,) bool, the ray meets nothing, or the back of a surface;  room_closed : (R,) bool, next to no ray of the room is lost
    """

    element: np.ndarray
    node: np.ndarray
    area: np.ndarray
    lost: np.ndarray
    room_closed: np.ndarray


def probe(building: Building, forest: Forest, workers: int) -> Probe:
    """Send the rays."""
    leaf = np.flatnonzero(forest.leaf & ~building.regions.buried[forest.region])
    room = building.regions.room[forest.region[leaf]]
    leaf = leaf[np.argsort(room, kind="stable")]
    room = np.sort(room)
    weight = forest.node_weights[leaf].astype(np.float64).reshape(-1)
    node_room = np.repeat(room, forest.node_count)
    wall = np.bincount(node_room, weight, minlength=building.room_count)
    number = np.maximum(MIN_RAYS, np.round(RAYS * wall / max(wall.sum(), 1e-300))).astype(np.int64) * (wall > 0)
    # Equal steps along the running area of a room: points spread evenly over its surfaces.
    running = np.cumsum(weight)
    begin = np.cumsum(wall) - wall
    owner = np.repeat(np.arange(building.room_count), number)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
    position = begin[owner] + (rank + 0.5) / number[owner] * wall[owner]
    chosen = np.minimum(np.searchsorted(running, position), len(weight) - 1)
    element, node = leaf[chosen // forest.node_count], chosen % forest.node_count
    direction = _directions(len(owner), building.regions, forest.region[element])
    lost = np.zeros(len(owner), bool)

    def shoot(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cluster = np.unique(building.clusters.cluster_of[forest.region[element[rows]]])
        near = building.blockers_of(building.regions_of(building.surroundings(cluster))[0])
        hit, behind = first_hits(near, forest.nodes[element[rows], node[rows]], direction[rows])
        return rows, (hit < 0) | behind

    cuts = np.flatnonzero(np.diff(owner)) + 1
    for rows, result in ordered_map(shoot, np.split(np.arange(len(owner)), cuts), workers):
        lost[rows] = result
    closed = np.bincount(owner, lost, minlength=building.room_count) <= LEAK * number
    return Probe(element, node, wall[owner] / np.maximum(number[owner], 1), lost, closed)


def escaped_power(found: Probe, forest: Forest, irradiance: np.ndarray) -> np.ndarray:
    """(3,) W that leave the building or strike backs. irradiance : (E, m, 3) of every element, ancestors included, W/m2."""
    rows = np.flatnonzero(found.lost)
    element = found.element[rows]
    region = forest.region[element]
    light = forest.at_nodes(element, irradiance[element])[np.arange(len(rows)), found.node[rows]]
    exitance = forest.regions.emission[region] + forest.regions.reflectance[region] * light
    return (exitance * found.area[rows, None]).sum(0)


def _directions(count: int, regions, region: np.ndarray) -> np.ndarray:
    """(n, 3) float32 cosine-distributed directions about the normals of ``region``, a two-dimensional Kronecker sequence."""
    k = np.arange(count)
    first, second = (0.5 + k * 0.7548776662466927) % 1, (0.5 + k * 0.5698402909980532) % 1
    radius, angle = np.sqrt(first), 2 * np.pi * second
    local = (radius * np.cos(angle), radius * np.sin(angle), np.sqrt(np.maximum(1 - first, 0)))
    return sum(x[:, None] * axis[region] for x, axis in zip(local, (regions.u, regions.v, regions.normal), strict=True)).astype(np.float32)
