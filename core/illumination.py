"""Direct light on the elements: the first shot of every lamp, on a mesh that follows its shadows."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from . import basis
from .building import Building
from .direct import direct_light
from .elements import Forest
from .emitters import emitters_of
from .light_kinds import Kind
from .links import Allocate
from .parallel import Crew

UNSEEN = 0.05
"""Part of the light of a lamp that an element's nodes see hidden, yet that may fall between them."""

UNFORESEEN = 0.25
"""Part of the mean light of a root element that may be the error of its few nodes."""

BLACK = 0.05
"""Surfaces are linked as though they reflected this much at least: to close a room the links between black ones must be right as well."""

_BLOCK = 1 << 15
"""Elements that are worked on at once."""


def illuminate(
    building: Building,
    forest: Forest,
    kinds: tuple[Kind, ...],
    tolerance: float,
    min_size: float,
    crew: Crew,
    allocate: Allocate = np.zeros,
) -> Iterator[float | tuple[np.ndarray, np.ndarray, int]]:
    """Direct irradiance on every element; elements are split where it is not smooth.

    tolerance : admissible error of an element, of its room's mean irradiance times the root of its room's area
    min_size : metres, elements are not split below it;  allocate : makes room for the result, like ``np.zeros``
    Yields the share of the work done, at last (coefficients (E, m, 3) float32 W/m2 of every element with its ancestors' part,
    room irradiance (R, 3) float64 W/m2 as estimated by :func:`room_irradiance`, pairs of lamp and blocker weighed).
    """
    own = np.zeros((len(forest), forest.functions, 3), np.float32)
    fresh, tests, room = np.arange(len(forest)), 0, None
    rounds = 0
    while len(fresh):
        nodes = forest.nodes_of(fresh).reshape(-1, 3)
        region = np.repeat(forest.region[fresh], forest.node_count)
        light, doubt, veil = np.zeros((len(nodes), 3), np.float32), np.zeros(len(nodes), np.float32), np.full(len(nodes), -1)
        done = 0
        for part in direct_light(building, kinds, nodes, region, crew):
            light[part.index], doubt[part.index], veil[part.index] = part.irradiance, part.doubt, part.veil
            tests += part.tests
            done += len(part.index)
            yield 1 - 0.5 ** (rounds + done / len(nodes))
        rounds += 1
        found = forest.from_nodes(fresh, light.reshape(-1, forest.node_count, 3))
        own[fresh] = found
        if room is None:
            room = room_irradiance(building, forest.mean(fresh, found))
            wall = np.bincount(building.regions.room, building.regions.area, minlength=len(room))
            limit = (tolerance * room.max(1) * np.sqrt(wall))[building.regions.room]
            # A root has no parent to foresee it: all that is not constant in it counts as unforeseen, and part of the
            # constant, since a lamp above the middle gives all nodes the same light and has its peak between them.
            foreseen = (1 - UNFORESEEN) * forest.mean(fresh, found)[:, None]
        else:
            filters = basis.two_scale(forest.order).astype(np.float32)[forest.slot[fresh]]
            foreseen = forest.at_nodes(fresh, np.matmul(filters.transpose(0, 2, 1), own[forest.parent[fresh]]))
        surprise = light.reshape(-1, forest.node_count, 3) - foreseen
        error = np.sqrt((surprise.astype(np.float64) ** 2).mean(1)).max(1) * np.sqrt(forest.area_of(fresh))
        error = np.maximum(error, UNSEEN * _hidden_light(doubt, veil, forest.node_count) * np.sqrt(forest.area_of(fresh)))
        parents = fresh[(error > limit[forest.region[fresh]]) & forest.can_split(fresh, min_size)]
        before = len(forest)
        forest.split(parents)
        fresh = np.arange(before, len(forest))
        own = np.concatenate([own, np.zeros((len(fresh), *own.shape[1:]), np.float32)])
    yield extended(forest, own, allocate), room, tests


def light_on(
    building: Building, forest: Forest, lit: int, kinds: tuple[Kind, ...], crew: Crew, allocate: Allocate = np.zeros
) -> Iterator[float | np.ndarray]:
    """Direct irradiance of ``kinds`` on the elements that the first ``lit`` of a forest had before it grew, and so on all.

    The light of parts of what :func:`illuminate` was given adds up to its own. Yields the share of the work done, at last
    the coefficients (E, m, 3) float32 W/m2.
    """
    leaf = np.flatnonzero(_leaves_among(forest, lit))
    nodes, region = forest.nodes_of(leaf).reshape(-1, 3), np.repeat(forest.region[leaf], forest.node_count)
    light, done = np.zeros((len(nodes), 3), np.float32), 0
    for part in direct_light(building, kinds, nodes, region, crew):
        light[part.index] = part.irradiance
        done += len(part.index)
        yield done / len(nodes)
    own = np.zeros((lit, forest.functions, 3), np.float32)
    own[leaf] = forest.from_nodes(leaf, light.reshape(-1, forest.node_count, 3))
    yield extended(forest, own, allocate)


def _hidden_light(doubt: np.ndarray, veil: np.ndarray, nodes: int) -> np.ndarray:
    """(n,) W/m2 of lamps that some node of an element does not see, unless one blocker hides them from all nodes."""
    doubt, veil = doubt.reshape(-1, nodes), veil.reshape(-1, nodes)
    surely = (veil[:, 0] >= 0) & (veil == veil[:, :1]).all(1)
    return np.where(surely, 0.0, doubt.max(1))


def room_irradiance(building: Building, direct: np.ndarray) -> np.ndarray:
    """(R, 3) rough mean irradiance of every room, direct (G, 3 per region) and reflected: rooms as integrating spheres that
    trade light through their portals. It steers the oracle and is no part of any result.
    """
    regions = building.regions
    rooms = building.room_count
    per_room = lambda x: np.stack([np.bincount(regions.room, x[:, k], minlength=rooms) for k in range(3)], 1)  # noqa: E731
    area = regions.area[:, None]
    wall = np.maximum(np.bincount(regions.room, regions.area, minlength=rooms), 1e-300)[:, None]
    reflectance = per_room(regions.reflectance * area) / wall
    first = per_room(regions.reflectance * direct * area) / wall
    emission = per_room(regions.emission * area) / wall
    doors = building.doors
    opening = np.zeros((rooms, 1))
    inner = (doors.rooms >= 0).all(1)
    for side in (0, 1):
        has = doors.rooms[:, side] >= 0
        np.add.at(opening[:, 0], doors.rooms[has, side], doors.area[has])
    reflected = np.zeros((rooms, 3))
    a, b, size = doors.rooms[inner, 0], doors.rooms[inner, 1], doors.area[inner, None]
    for _ in range(200):  # a fixed point with contraction by the reflectance; the estimate needs no more
        exitance = first + reflectance * reflected
        through = np.zeros((rooms, 3))
        np.add.at(through, a, size * exitance[b])
        np.add.at(through, b, size * exitance[a])
        update = (wall * exitance + through) / (wall + opening)
        settled = np.allclose(update, reflected, rtol=1e-3, atol=0)
        reflected = update
        if settled:
            break
    mean = per_room(direct * area) / wall + reflected
    # A room without any light has no scale of its own: it takes the building's, far down.
    return np.maximum(mean, 1e-4 * np.maximum(mean.max(initial=0.0), 1e-3 * emission.max(initial=0.0)) + 1e-30)


def exitance_estimate(forest: Forest, direct: np.ndarray, room: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rough reflected exitance (E,) float64 of every element, largest channel, W/m2, and the part of it (E,), as a root mean
    square, that is not constant: for the oracle.
    """
    regions = forest.regions
    exitance, slope = np.empty(len(forest)), np.empty(len(forest))
    for low in range(0, len(forest), _BLOCK):
        here = slice(low, min(low + _BLOCK, len(forest)))
        region, light = forest.region[here], direct[here]
        reflectance = np.maximum(regions.reflectance[region], BLACK)
        mean = np.maximum(forest.mean(np.arange(here.start, here.stop), light), 0) + room[regions.room[region]]
        exitance[here] = (mean * reflectance).max(1)
        slope[here] = (np.sqrt((light[:, 1:].astype(np.float64) ** 2).sum(1)) * reflectance).max(1)
    return exitance, slope


def extended(forest: Forest, light: np.ndarray, allocate: Allocate = np.zeros, breathe: Callable[[], None] = lambda: None) -> np.ndarray:
    """Coefficients of all elements (E, m, 3) from those of the first ones that were leaves then: a younger element is a part
    of its parent. ``allocate`` makes room like ``np.zeros``; ``breathe`` is called between blocks of work.
    """
    out = allocate((len(forest), *light.shape[1:]), np.float32)
    trees_in_turn = emitters_of(forest, forest.region, len(forest.regions), allocate)
    was_leaf = _leaves_among(forest, len(light))
    for places in trees_in_turn.blocks():
        elements, trees = trees_in_turn.order[places], trees_in_turn.trees_of_block(forest, places)
        rows = np.flatnonzero(elements < len(light))
        rows = rows[was_leaf[elements[rows]]]
        own = np.zeros((len(elements), *light.shape[1:]), np.float32)
        own[rows] = light[elements[rows]]
        out[elements] = trees.pull(np.where(forest.leaf_of(elements)[:, None, None], trees.push(own), 0))
        breathe()
    return out


def _leaves_among(forest: Forest, known: int) -> np.ndarray:
    """(known,) bool: the leaves of the forest when it had ``known`` elements."""
    return forest.leaf[:known] | (forest.first_child[:known] >= known)
