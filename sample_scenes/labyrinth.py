# SPDX-License-Identifier: GPL-3.0-or-later
"""A maze of furnished rooms of the size of the paper's Labyrinth: 182 rooms, 146,266 polygons.

Rooms of many sizes stand in a grid; the doors are a random tree that reaches every room, and a few more, so that light
finds its way in enfilades, around corners and in rings.

Run it: ``python -m enfilade.sample_scenes.labyrinth --out labyrinth.npz``
"""

from __future__ import annotations

import math

import numpy as np

from ..core.scene import Scene
from . import fittings as fit
from .filling import Room, command, fill, lamps
from .model import Material
from .plans import Plan, Space, rectangle

ROOMS, POLYGONS = 182, 146_266
HEIGHT, WALL, DOOR, TILE = 3.0, 0.2, (1.0, 2.1), 1.25
LOOPS = 0.12
"""Share of the doors that the tree leaves closed and that are opened all the same."""
DARK = 0.15
"""Share of the rooms without a lamp."""
SOUTH, EAST, NORTH, WEST = range(4)

PLASTER = tuple(
    Material(f"Plaster {k}", c)
    for k, c in enumerate(((0.76, 0.73, 0.68), (0.62, 0.2, 0.1), (0.18, 0.26, 0.5), (0.72, 0.5, 0.18), (0.25, 0.42, 0.25)))
)
BLACK = Material("Black marble", (0.12, 0.12, 0.13))
FLOORS = tuple((Material(f"Marble {k}", c), BLACK) for k, c in enumerate(((0.6, 0.36, 0.28), (0.62, 0.6, 0.57), (0.66, 0.56, 0.38))))
"""Two colours of a chequered floor."""
CEILING = Material("Ceiling white", (0.82, 0.82, 0.8))


def scene(scale: float = 1.0, seed: int = 1) -> Scene:
    """The maze, or a smaller one of the same kind with ``scale`` times the rooms and polygons."""
    rng = np.random.default_rng(seed)
    count = max(1, round(ROOMS * scale))
    across = math.ceil(math.sqrt(count))
    lines = [np.concatenate([[0.0], np.cumsum(rng.uniform(4.6, 6.4, n) + WALL)]) for n in (across, math.ceil(count / across))]
    plan, rooms = Plan([], fit.WALNUT), []
    for index in range(count):
        j, i = divmod(index, across)
        outline = rectangle(lines[0][i], lines[1][j], lines[0][i + 1] - WALL, lines[1][j + 1] - WALL)
        walls, floor = PLASTER[rng.integers(len(PLASTER))], FLOORS[rng.integers(len(FLOORS))]
        tiles = tuple(np.round((outline[2] - outline[0]) / TILE).astype(int).tolist())
        plan.spaces.append(Space(f"Room {j + 1}.{i + 1}", outline, 0.0, HEIGHT, walls, floor, CEILING, tiles))
        rooms.append(Room())
    for a, b in _doors(count, across, rng):
        _door(plan, a, b, rng)
    for index, room in enumerate(rooms):
        _furnish(plan, index, room, np.random.default_rng([seed, index]))
    return fill("Labyrinth", plan, rooms, round(POLYGONS * scale), seed)


def _doors(count: int, across: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Pairs of neighbours with a door: a random spanning tree (Kruskal), then some of the others."""
    pairs = [(a, a + 1) for a in range(count - 1) if (a + 1) % across] + [(a, a + across) for a in range(count - across)]
    root = list(range(count))

    def find(a: int) -> int:
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        return a

    opened = []
    for k in rng.permutation(len(pairs)):
        a, b = pairs[k]
        tree = find(a) != find(b)
        if tree:
            root[find(a)] = find(b)
        if tree or rng.random() < LOOPS:
            opened.append((a, b))
    return opened


def _door(plan: Plan, a: int, b: int, rng: np.random.Generator) -> None:
    (x0, y0), (x1, y1) = plan.spaces[b].outline[0], plan.spaces[b].outline[2]
    shift = float(rng.uniform(-0.5, 0.5))
    if b == a + 1:
        plan.door(a, EAST, b, WEST, np.array([x0 - WALL / 2, (y0 + y1) / 2 + shift]), *DOOR)
    else:
        plan.door(a, NORTH, b, SOUTH, np.array([(x0 + x1) / 2 + shift, y0 - WALL / 2]), *DOOR)


def _furnish(plan: Plan, index: int, room: Room, rng: np.random.Generator) -> None:
    space = plan.spaces[index]
    if index == 0 or rng.random() >= DARK:
        size = ((0.8, 0.8), (1.2, 0.4), (0.6, 0.6))[rng.integers(3)]
        x, y = space.outline.mean(axis=0).tolist()
        room.must += lamps(plan, index, [(x, y, float(rng.choice([0, 45, 90])))], size, fit.LAMPS[rng.integers(3)], 0.25)
    corners = space.corner_places()
    room.pots = [corners[k] for k in rng.permutation(4)]
    wood, cloth = fit.WOODS[rng.integers(3)], fit.CLOTHS[rng.integers(5)]
    kind = int(rng.integers(4))
    for k, (x, y, turn) in enumerate(space.floor_places(1.05, 1.7, 2.15)):
        turn += float(rng.choice([0, 180]))
        if kind == 0:
            room.may.append((f"table and chairs {k}", fit.dining(wood, cloth).at(x, y, 0.0, turn)))
        elif kind == 1:
            room.may.append((f"desk and chair {k}", fit.desk_with_chair(wood, cloth).at(x, y, 0.0, turn)))
            room.may.append((f"vase {k}", fit.vase(fit.CLAY).at(*_beside(x, y, turn, 0.5, 0.35), 0.74)))
        elif kind == 2:
            room.may.append((f"column {k}", fit.column(HEIGHT).at(x, y, 0.0)))
        else:
            room.may.append((f"bed {k}", fit.bed(wood, cloth).at(x, y, 0.0, turn)))
    places = space.wall_places(*fit.SHELF[:2])
    places = [places[k] for k in rng.permutation(len(places))]
    for k, (x, y, turn) in enumerate(places[: len(places) // 4]):
        height = float(rng.uniform(0.8, 1.1))
        room.may.append((f"cupboard {k}", fit.cupboard(wood, 1.1, height).at(x, y, 0.0, turn)))
        room.may.append((f"vase on cupboard {k}", fit.vase(fit.CLAY, 16).at(*_beside(x, y, turn, 0.2, 0.0), height)))
    room.shelves = places[len(places) // 4 :]
    room.weight = float(rng.uniform(0.5, 1.5))


def _beside(x: float, y: float, degrees: float, right: float, ahead: float) -> tuple[float, float]:
    """A place beside (x, y) in the frame of a thing turned by ``degrees``."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return x + c * right - s * ahead, y + s * right + c * ahead


def main() -> None:
    """Write the maze as a .blend or an .npz file."""
    command(scene, __doc__)


if __name__ == "__main__":
    main()
