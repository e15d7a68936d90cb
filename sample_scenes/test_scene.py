# SPDX-License-Identifier: GPL-3.0-or-later
"""An office building of the size of the paper's Test scene: 3 floors, 648 rooms and corridors, 58,608 polygons.

On each floor corridors run west to east, two in line, with up to nine rooms to the north and eight to the south; some
neighbours have a door between them, and one room in every wing opens into the wing behind it. A stairwell joins the floors.
The originals of the paper's scenes were never published: this one has their counts and their structure.

Run it: ``python -m enfilade.sample_scenes.test_scene --out test_scene.npz``
"""

from __future__ import annotations

import numpy as np

from ..core.scene import Scene
from . import fittings as fit
from .filling import Room, command, fill, lamps
from .model import Material
from .plans import Plan, Space, rectangle

ROOMS, POLYGONS, FLOORS = 648, 58_608, 3
WING = 18
"""Spaces of a full wing: a corridor and 17 rooms."""
HEIGHT, STOREY, DEPTH, WIDE, WALL = 2.8, 3.2, 4.5, 2.4, 0.15
PITCH = 2 * DEPTH + WIDE + 3 * WALL
STAIRS = 4.6
DARK = 0.15
"""Share of the rooms without a lamp."""
SOUTH, EAST, NORTH, WEST = range(4)

PLASTER = tuple(
    Material(f"Plaster {k}", c) for k, c in enumerate(((0.76, 0.73, 0.68), (0.7, 0.72, 0.74), (0.74, 0.66, 0.5), (0.55, 0.66, 0.58)))
)
CARPET = tuple(Material(f"Carpet {k}", c) for k, c in enumerate(((0.36, 0.34, 0.32), (0.2, 0.26, 0.36), (0.42, 0.3, 0.2))))
CEILING = Material("Ceiling white", (0.82, 0.82, 0.8))


def scene(scale: float = 1.0, seed: int = 1) -> Scene:
    """The building, or a smaller one of the same kind with ``scale`` times the rooms and polygons."""
    rng = np.random.default_rng(seed)
    plan = Plan([], fit.BIRCH)
    rooms: list[Room] = []
    count = max(FLOORS, round(ROOMS * scale))
    stairs = []
    for floor in range(FLOORS):
        spaces = count // FLOORS + (floor < count % FLOORS)
        _floor(plan, rooms, floor, spaces - 1, rng)
        stairs.append(_stairwell(plan, rooms, floor))
    for floor in range(FLOORS - 1):
        _stairs(plan, rooms, stairs[floor], stairs[floor + 1], floor)
    for index, room in enumerate(rooms):
        _furnish(plan, index, room, np.random.default_rng([seed, index]))
    return fill("Test scene", plan, rooms, max(round(POLYGONS * scale), 1), seed)


def _floor(plan: Plan, rooms: list[Room], floor: int, spaces: int, rng: np.random.Generator) -> None:
    base = floor * STOREY
    backs: list[tuple[int, float, float]] = []
    for row, first in enumerate(range(0, spaces, 2 * WING)):
        x, previous, behind, backs = 0.0, None, backs, []
        for half, begin in enumerate(range(first, min(first + 2 * WING, spaces), WING)):
            count, name = min(WING, spaces - begin) - 1, f"{'ABC'[floor]}{2 * row + half + 1}"
            x, corridor = _wing(plan, rooms, base, x, row * PITCH, count, name, rng, behind, backs)
            if previous is not None:
                centre = np.array([plan.spaces[corridor].outline[0, 0] - WALL / 2, row * PITCH + DEPTH + WALL + WIDE / 2])
                plan.door(previous, EAST, corridor, WEST, centre, 1.6, 2.2)
            previous = corridor


def _wing(plan, rooms, base, x, y, count, name, rng, behind, backs) -> tuple[float, int]:
    """A corridor with ``count`` rooms from (x, y) on; returns where the next wing begins and the corridor's number."""
    sides = (count - count // 2, count // 2)  # north, south
    length = 4.0 * max(sides[0], 2)
    south = y + DEPTH + WALL
    corridor = len(plan.spaces)
    _space(plan, rooms, f"{name} corridor", rectangle(x, south, x + length, south + WIDE), base, 0)
    plan.spaces[corridor].bays = max(sides[0], 2)
    for side, number in zip((NORTH, SOUTH), sides, strict=True):
        width = length / max(number, 1)
        low = south + WIDE + WALL if side == NORTH else y
        for k in range(number):
            x0, x1 = x + k * width + (WALL / 2 if k else 0), x + (k + 1) * width - (WALL / 2 if k < number - 1 else 0)
            room = len(plan.spaces)
            _space(plan, rooms, f"{name} {'north' if side == NORTH else 'south'} {k + 1}", rectangle(x0, low, x1, low + DEPTH), base, None)
            centre = np.array([rng.uniform(x0 + 1.3, x1 - 1.3), low - WALL / 2 if side == NORTH else low + DEPTH + WALL / 2])
            plan.door(corridor, side, room, SOUTH if side == NORTH else NORTH, centre, 0.9, 2.05)
            if k and rng.random() < 0.2:
                near = low + (1.35 if side == NORTH else DEPTH - 1.35)
                plan.door(room - 1, EAST, room, WEST, np.array([x0 - WALL / 2, near]), 0.9, 2.05)
            if side == NORTH:
                backs.append((room, x0, x1))
            elif k == number // 2:
                _back_door(plan, room, x0, x1, behind)
    return x + length + WALL, corridor


def _back_door(plan: Plan, room: int, x0: float, x1: float, behind: list[tuple[int, float, float]]) -> None:
    """A door to the room of the row to the south that shares the longest piece of wall."""
    shared = [(min(x1, b) - max(x0, a), other, a, b) for other, a, b in behind]
    if shared and max(shared)[0] > 1.5:
        _, other, a, b = max(shared)
        y = plan.spaces[room].outline[0, 1] - WALL / 2
        plan.door(other, NORTH, room, SOUTH, np.array([(max(x0, a) + min(x1, b)) / 2, y]), 0.9, 2.05)


def _space(plan: Plan, rooms: list[Room], name: str, outline: np.ndarray, base: float, paint: int | None) -> None:
    k = len(plan.spaces) if paint is None else paint
    plan.spaces.append(Space(name, outline, base, HEIGHT, PLASTER[k % len(PLASTER)], (CARPET[k % len(CARPET)],), CEILING))
    rooms.append(Room())


def _stairwell(plan: Plan, rooms: list[Room], floor: int) -> int:
    """A room for the stairs at the west end of the first corridor; returns its number."""
    corridor = next(k for k, space in enumerate(plan.spaces) if space.name == f"{'ABC'[floor]}1 corridor")
    (x, y), room = plan.spaces[corridor].outline[0], len(plan.spaces)
    _space(plan, rooms, f"{'ABC'[floor]} stairwell", rectangle(x - WALL - STAIRS, y, x - WALL, y + WIDE), floor * STOREY, 0)
    plan.door(room, EAST, corridor, WEST, np.array([x - WALL / 2, y + WIDE / 2]), 1.2, 2.1)
    return room


def _stairs(plan: Plan, rooms: list[Room], lower: int, upper: int, floor: int) -> None:
    """A flight from one floor to the next; flights of neighbouring floors stand side by side."""
    x, y = plan.spaces[lower].outline[0]
    y += 0.65 if floor % 2 == 0 else WIDE - 0.65
    plan.shaft(lower, upper, rectangle(x + 0.35, y - 0.53, x + 4.25, y + 0.53))
    flight = fit.steps(13, 0.21, 0.28, 0.96, fit.STONE)
    rooms[lower].must.append(("stairs", flight.at(x + 0.5, y, plan.spaces[lower].base)))


def _furnish(plan: Plan, index: int, room: Room, rng: np.random.Generator) -> None:
    space = plan.spaces[index]
    (x0, y0), (x1, y1) = space.outline[0], space.outline[2]
    lamp = fit.LAMPS[rng.integers(len(fit.LAMPS))]
    if "stairwell" in space.name:
        room.must += lamps(plan, index, [(x1 - 0.18, (y0 + y1) / 2, 90.0)], (0.6, 0.2), lamp, 0.12)
        room.pots = [(x1 - 0.45, y0 + 0.4)]
        room.weight = 0.1
        return
    if "corridor" in space.name:
        room.must += lamps(
            plan, index, [(x, (y0 + y1) / 2, 0.0) for x in np.arange(x0 + 3.0, x1 - 1.0, 6.0).tolist()], (1.2, 0.3), lamp, 0.12
        )
        room.pots = [(x1 - 0.5, y0 + 0.5), (x1 - 0.5, y1 - 0.5), (x0 + 0.5, y0 + 0.5), (x0 + 0.5, y1 - 0.5)]
        places = [p for p in space.wall_places(1.0, 0.4) if x0 + 1.2 < p[0] < x1 - 1.2]
        spread = places[:: max(1, len(places) // 3)][:3]
        room.may = [(f"bench {k}", fit.bench(fit.OAK).at(x, y, space.base, turn)) for k, (x, y, turn) in enumerate(spread)]
        room.weight = 1.6
        return
    if index == 0 or rng.random() >= DARK:
        room.must += lamps(plan, index, [((x0 + x1) / 2, (y0 + y1) / 2, 0.0)], (0.6, 0.6), lamp, 0.12)
    corners = space.corner_places()
    room.pots = [corners[k] for k in rng.permutation(4)]
    places = space.wall_places(*fit.SHELF[:2])
    places = [places[k] for k in rng.permutation(len(places))]
    wood, cloth = fit.WOODS[rng.integers(3)], fit.CLOTHS[rng.integers(5)]
    middle = ((x0 + x1) / 2 + rng.uniform(-0.1, 0.1), (y0 + y1) / 2 + rng.uniform(-0.2, 0.2), space.base, float(rng.choice([0, 180])))
    room.weight = float(rng.uniform(0.3, 1.7))
    # What a poor room has takes fewer polygons.
    poor = (("bed", fit.bed(wood, cloth)), ("sofa", fit.sofa(cloth)), ("desk", fit.desk(wood)))[rng.integers(3)]
    name, solid = ("desk and chair", fit.desk_with_chair(wood, cloth)) if room.weight > 0.9 else poor
    room.may.append((name, solid.at(*middle)))
    closets = int(rng.integers(1, 4))
    for k, (x, y, turn) in enumerate(places[:closets]):
        room.may.append((f"cupboard {k}", fit.cupboard(wood, 1.0, round(float(rng.uniform(0.8, 2.0)), 1)).at(x, y, space.base, turn)))
    room.shelves = places[closets:]


def main() -> None:
    """Write the building as a .blend or an .npz file."""
    command(scene, __doc__)


if __name__ == "__main__":
    main()
