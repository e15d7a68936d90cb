"""Direct light on the elements: the first shot of every lamp, on a mesh that follows its shadows."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from . import basis
from .building import Building
from .direct import DirectLight, direct_light
from .elements import Forest
from .emitters import emitters_of
from .grouping import GrowingArray
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
    own = GrowingArray((forest.functions, 3), np.float32)
    own.allocate = allocate
    fresh, tests, room, rounds = np.arange(len(forest)), 0, None, 0
    while len(fresh):
        error = np.zeros(len(fresh))
        for low in range(0, len(fresh), _BLOCK):
            some = fresh[low : low + _BLOCK]
            lit = _Lit(forest, some)
            for part in direct_light(building, kinds, lit.nodes, lit.region, crew):
                tests += part.tests
                yield 1 - 0.5 ** (rounds + (low + lit.take(part) / forest.node_count) / len(fresh))
            found = forest.from_nodes(some, lit.light)
            error[low : low + _BLOCK] = lit.error(_foreseen(forest, some, found, own.view()))
            own.extend(found)
        rounds += 1
        if room is None:
            room = room_irradiance(building, forest.mean(fresh, own.view()))
            wall = np.bincount(building.regions.room, building.regions.area, minlength=len(room))
            limit = (tolerance * room.max(1) * np.sqrt(wall))[building.regions.room]
        parents = fresh[(error > limit[forest.region[fresh]]) & forest.can_split(fresh, min_size)]
        before = len(forest)
        forest.split(parents)
        fresh = np.arange(before, len(forest))
    yield extended(forest, own.view(), allocate), room, tests


class _Lit:
    """Some elements (n,) and the light of the luminaires at their nodes, as it comes in.

    nodes : (n * q, 3) float32, region : (n * q,), where it is asked for;  light : (n, q, 3) float32 W/m2
    """

    def __init__(self, forest: Forest, elements: np.ndarray):
        self._area, count = forest.area_of(elements), forest.node_count
        self.nodes, self.region = forest.nodes_of(elements).reshape(-1, 3), np.repeat(forest.region[elements], count)
        self.light = np.zeros((len(elements), count, 3), np.float32)
        self._doubt, self._veil, self._done = np.zeros((len(elements), count), np.float32), np.full((len(elements), count), -1), 0

    def take(self, part: DirectLight) -> int:
        """Keep the light of some nodes; returns of how many it is known."""
        for mine, theirs in ((self.light, part.irradiance), (self._doubt, part.doubt), (self._veil, part.veil)):
            mine.reshape(len(self.nodes), *mine.shape[2:])[part.index] = theirs
        self._done += len(part.index)
        return self._done

    def error(self, foreseen: np.ndarray) -> np.ndarray:
        """(n,) W/m: root mean square of the light that was not ``foreseen`` (n, 1 or q, 3), or what hides from the nodes, times the
        root of the area.
        """
        surprise = self.light.astype(np.float64) - foreseen
        rms = np.sqrt((surprise**2).mean(1)).max(1)
        return np.maximum(rms, UNSEEN * _hidden_light(self._doubt, self._veil)) * np.sqrt(self._area)


def _foreseen(forest: Forest, elements: np.ndarray, found: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(n, 1 or q, 3) the light that is expected at the nodes of elements whose own is ``found``, from that ``known`` of their parents."""
    parent = forest.parent[elements]
    if parent[0] < 0:
        # A root has no parent to foresee it: all that is not constant in it counts as unforeseen, and part of the
        # constant, since a lamp above the middle gives all nodes the same light and has its peak between them.
        return (1 - UNFORESEEN) * forest.mean(elements, found)[:, None]
    filters = basis.two_scale(forest.order).astype(np.float32).take(forest.slot[elements], 0)
    return forest.at_nodes(elements, np.matmul(filters.transpose(0, 2, 1), known.take(parent, 0)))


def light_on(
    building: Building, forest: Forest, lit: int, kinds: tuple[Kind, ...], crew: Crew, allocate: Allocate = np.zeros
) -> Iterator[float | np.ndarray]:
    """Direct irradiance of ``kinds`` on the elements that the first ``lit`` of a forest had before it grew, and so on all.

    The light of parts of what :func:`illuminate` was given adds up to its own. Yields the share of the work done, at last
    the coefficients (E, m, 3) float32 W/m2.
    """
    leaf = np.flatnonzero(_leaves_among(forest, lit))
    own = allocate((lit, forest.functions, 3), np.float32)
    for low in range(0, len(leaf), _BLOCK):
        some = leaf[low : low + _BLOCK]
        here = _Lit(forest, some)
        for part in direct_light(building, kinds, here.nodes, here.region, crew):
            yield (low + here.take(part) / forest.node_count) / len(leaf)
        own[some] = forest.from_nodes(some, here.light)
    yield extended(forest, own, allocate)


def _hidden_light(doubt: np.ndarray, veil: np.ndarray) -> np.ndarray:
    """(n,) W/m2 of lamps that some node of an element does not see, unless one blocker hides them from all nodes: (n, q) of each."""
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
