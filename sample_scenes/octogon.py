# SPDX-License-Identifier: GPL-3.0-or-later
"""A library of the size of the paper's Octogon: 28 rooms, 277,942 polygons, two of the rooms with more than 60,000.

Three eight-sided halls stand above one another around an open eye in their floors, with a lantern on top; eight rooms
lie around each hall, with doors to the hall and to one another.

Run it: ``python -m enfilade.sample_scenes.octogon --out octogon.npz``
"""

from __future__ import annotations

import math

import numpy as np

from ..core.scene import Scene
from . import fittings as fit
from .filling import Place, Room, command, fill, lamps
from .model import Material
from .plans import Plan, Space

ROOMS, POLYGONS = 28, 277_942
STOREYS = 3
HALL, EYE, INNER, OUTER = 14.8, 3.7, 15.2, 24.0
"""Distances (m) from the axis to the sides of the hall, of the eye, and to both sides of the rooms around."""
HEIGHT, STOREY, HALF_WALL = 4.6, 5.0, 0.15
WEIGHTS = (64.0, 64.0, 21.0)
"""Shares of the three halls; a room around a hall has about 5."""
DARK = (3, 12, 16, 22)
"""Rooms without a lamp."""

PLASTER = Material("Plaster", (0.74, 0.71, 0.65))
SIDES = tuple(Material(f"Paint {k}", c) for k, c in enumerate(((0.62, 0.2, 0.1), (0.18, 0.26, 0.5), (0.72, 0.5, 0.18), (0.25, 0.42, 0.25))))
FLOOR = Material("Floor", (0.5, 0.36, 0.22))
CEILING = Material("Ceiling white", (0.82, 0.82, 0.8))


def scene(scale: float = 1.0, seed: int = 1) -> Scene:
    """The library, or the first of its rooms, ``scale`` times their number and polygons; ways to missing rooms are closed."""
    count = max(1, round(ROOMS * scale))
    plan, rooms = Plan([], fit.OAK), []
    for index in range(count):
        storey, k = divmod(index, 9)
        plan.spaces.append(_space(storey, k - 1))
        rooms.append(Room())
        hall = 9 * storey
        if k == 0 and storey:
            plan.shaft(hall - 9, hall, _octagon(EYE))
        if k:
            plan.door(hall, k - 1, index, 3, _at(k - 1, (HALL + INNER) / 2, 0.0), 2.0, 2.6)
        if k > 1:
            plan.door(index - 1, 2, index, 0, _between(k - 2), 1.2, 2.3)
        if k == 8:
            plan.door(index, 2, hall + 1, 0, _between(7), 1.2, 2.3)
    for index, room in enumerate(rooms):
        rng = np.random.default_rng([seed, index])
        (_furnish_hall if index % 9 == 0 else _furnish_side)(plan, index, room, rng)
    return fill("Octogon", plan, rooms, round(POLYGONS * scale), seed)


def _axes(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions outwards and along side ``k``."""
    angle = math.radians(45 * k)
    return np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])


def _at(k: int, out: float, along: float) -> np.ndarray:
    """(2,) a place seen from side ``k``."""
    outward, aside = _axes(k)
    return outward * out + aside * along


def _octagon(apothem: float) -> np.ndarray:
    """(8, 2) corners, counter-clockwise, side k facing 45 k degrees."""
    angle = np.radians(45 * np.arange(8) - 22.5)
    return apothem / math.cos(math.pi / 8) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _half(out: float) -> float:
    """Half width (m) of a room around the hall at a distance from the axis."""
    return out * math.tan(math.pi / 8) - HALF_WALL / math.cos(math.pi / 8)


def _between(k: int) -> np.ndarray:
    """(2,) the middle of the wall between rooms ``k`` and ``k + 1``."""
    out = (INNER + OUTER) / 2
    return _at(k, out, out * math.tan(math.pi / 8))


def _space(storey: int, k: int) -> Space:
    base = storey * STOREY
    if storey == STOREYS:
        return Space("Lantern", _octagon(EYE + 1.6), base, 3.0, PLASTER, (FLOOR,), CEILING)
    if k < 0:
        return Space(f"Hall {storey + 1}", _octagon(HALL), base, HEIGHT, PLASTER, (FLOOR,), CEILING)
    corners = [(INNER, -1), (OUTER, -1), (OUTER, 1), (INNER, 1)]
    outline = np.array([_at(k, out, side * _half(out)) for out, side in corners])
    return Space(f"Room {storey + 1}.{k + 1}", outline, base, HEIGHT, SIDES[k % len(SIDES)], (FLOOR,), CEILING)


def _furnish_hall(plan: Plan, index: int, room: Room, rng: np.random.Generator) -> None:
    space, storey = plan.spaces[index], index // 9
    if storey == STOREYS:
        room.must += lamps(plan, index, [(*_at(k, 3.0, 0.0).tolist(), 45.0 * k) for k in range(0, 8, 2)], (0.8, 0.8), fit.LAMPS[1], 0.2)
        room.must.append(("rail", fit.balusters(_octagon(EYE + 0.25), fit.OAK).at(0.0, 0.0, space.base)))
        room.pots = [tuple((corner * 0.93).tolist()) for corner in space.outline]
        room.weight = 0.5
        return
    spots: list[Place] = [(*_at(k, out, 0.0).tolist(), 45.0 * k) for k in range(8) for out in (6.5, 11.5)]
    room.must += lamps(plan, index, spots, (1.2, 1.2), fit.LAMPS[storey % 3], 0.4)
    room.must += [(f"column {k}", fit.column(HEIGHT).at(*(_octagon(13.2)[k]).tolist(), space.base)) for k in range(8)]
    if space.floor_hole is not None:
        room.must.append(("rail", fit.balusters(_octagon(EYE + 0.25), fit.OAK).at(0.0, 0.0, space.base)))
    for k in range(8):
        cloth = fit.CLOTHS[k % len(fit.CLOTHS)]
        for number, (out, along) in enumerate(((5.6, -1.1), (5.6, 1.1))):
            room.may.append(
                (f"table {k}.{number}", fit.dining(fit.WALNUT, cloth).at(*_at(k, out, along).tolist(), space.base, 45 * k - 90))
            )
    for ring in (12.9, 10.9, 8.9):
        # Two shelves back to back; the way to the door stays clear.
        side = ring * math.tan(math.pi / 8) - 0.9
        for k in range(8):
            for j in range(int((side - 1.2) / 1.25)):
                for along in (1.2 + 1.25 * j + 0.625, -1.2 - 1.25 * j - 0.625):
                    room.shelves.append((*_at(k, ring + 0.19, along).tolist(), 45.0 * k + 90))
                    room.shelves.append((*_at(k, ring - 0.19, along).tolist(), 45.0 * k - 90))
    walls = space.wall_places(*fit.SHELF[:2])
    room.shelves = walls + room.shelves
    room.pots = space.corner_places()
    room.weight = WEIGHTS[storey]


def _furnish_side(plan: Plan, index: int, room: Room, rng: np.random.Generator) -> None:
    space, k = plan.spaces[index], index % 9 - 1
    if index not in DARK:
        spots = [(*_at(k, out, along).tolist(), 45.0 * k) for out in (17.7, 21.3) for along in (-3.2, 3.2)]
        room.must += lamps(plan, index, spots, (1.2, 0.6), fit.LAMPS[rng.integers(3)], 0.4)
    wood, cloth = fit.WOODS[rng.integers(3)], fit.CLOTHS[rng.integers(5)]
    sets = (fit.dining(wood, cloth), fit.desk_with_chair(wood, cloth), fit.sofa(cloth))
    for number, (x, y, turn) in enumerate(space.floor_places(1.4, 2.4, 2.6)):
        if rng.random() < 0.6:
            room.may.append((f"seats {number}", sets[rng.integers(3)].at(x, y, space.base, turn + float(rng.choice([0, 90, 180])))))
    places = space.wall_places(*fit.SHELF[:2])
    room.shelves = [places[i] for i in rng.permutation(len(places))]
    room.pots = space.corner_places()
    room.weight = float(rng.uniform(4.0, 6.0))


def main() -> None:
    """Write the library as a .blend or an .npz file."""
    command(scene, __doc__)


if __name__ == "__main__":
    main()
