# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill the rooms of a plan with furniture until the building has an exact number of polygons, and make it a Scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..core.scene import Portals, Scene
from . import fittings as fit
from .model import Material, weld
from .plans import Plan
from .solids import Solid

LEAST_LEAVES = 12
"""From this number on every number is a sum of fours and fives: leaves of a plant have four or five faces."""
MOST_LEAVES = 240
"""Faces of leaves that one plant may have."""

Place = tuple[float, float, float]


@dataclass
class Room:
    """What may stand in a room, in the order in which it is brought.

    must : name and solid of what is there in any case (lamps, columns)
    may : the same, brought while the number of polygons allows it
    shelves : places (x, y, degrees) for shelves;  pots : places (x, y) for plants, the first one always used
    weight : share of the room in what the building has beyond the least
    """

    must: list[tuple[str, Solid]] = field(default_factory=list)
    may: list[tuple[str, Solid]] = field(default_factory=list)
    shelves: list[Place] = field(default_factory=list)
    pots: list[tuple[float, float]] = field(default_factory=list)
    weight: float = 1.0


def fill(name: str, plan: Plan, rooms: list[Room], total: int, seed: int) -> Scene:
    """The furnished building with exactly ``total`` polygons. Raises ValueError when a room cannot take its share."""
    shells = [plan.shell(r) for r in range(len(rooms))]
    least = np.array([sum(map(len, shell.values())) + sum(len(s) for _, s in room.must) for shell, room in zip(shells, rooms, strict=True)])
    shares = share(total, least + fit.POT + LEAST_LEAVES, np.array([room.weight for room in rooms]))
    solids, owner_room, names = [], [], []
    for r, (shell, room) in enumerate(zip(shells, rooms, strict=True)):
        things = [*shell.items(), *room.must]
        rng = np.random.default_rng([seed, r, 1])
        things += _furniture(room, plan.spaces[r].base, int(shares[r] - least[r]), rng, plan.spaces[r].name)
        for thing, solid in things:
            solids.append(solid)
            owner_room.append(r)
            names.append(f"{thing} of {plan.spaces[r].name}")
    return _scene(name, plan, solids, np.array(owner_room, np.int32), tuple(names))


def share(total: int, least: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(R,) whole numbers of sum ``total``: ``least``, and of the rest parts in proportion to ``weight``."""
    rest = total - int(least.sum())
    if rest < 0:
        raise ValueError(f"{total} polygons are too few: the empty rooms and their lamps alone have {int(least.sum())}")
    part = rest * weight / weight.sum()
    whole = np.floor(part).astype(np.int64)
    first = np.argsort(whole - part, kind="stable")[: rest - int(whole.sum())]
    whole[first] += 1
    return least + whole


def _furniture(room: Room, base: float, count: int, rng: np.random.Generator, name: str) -> list[tuple[str, Solid]]:
    """Things with ``count`` polygons in all."""
    left = count - fit.POT  # of the first plant
    things = []
    for thing, solid in room.may:
        if len(solid) + LEAST_LEAVES <= left:
            things.append((thing, solid))
            left -= len(solid)
    for number, (x, y, turn) in enumerate(room.shelves):
        books = (left - LEAST_LEAVES - fit.SHELF_FRAME) // 5
        if books < 4:
            break
        solid = fit.shelf(fit.WOODS[rng.integers(len(fit.WOODS))], rng, books)
        things.append((f"shelf {number}", solid.at(x, y, base, turn)))
        left -= len(solid)
    plants = max(1, math.ceil((left + fit.POT) / (MOST_LEAVES + fit.POT)))
    if plants > len(room.pots):
        raise ValueError(f"{name!r} has no place for the last {left} of its polygons; give it more shelves or a smaller share")
    faces = left - (plants - 1) * fit.POT
    for number in range(plants):
        part = faces // plants + (number < faces % plants)
        four = -part % 5
        solid = fit.plant(rng, four, (part - 4 * four) // 5)
        things.append((f"plant {number}", solid.at(*room.pots[number], base)))
    return things


def _scene(name: str, plan: Plan, solids: list[Solid], owner_room: np.ndarray, object_names: tuple[str, ...]) -> Scene:
    corners = np.concatenate([s.corners for s in solids])
    look = np.concatenate([s.look for s in solids])
    owner = np.repeat(np.arange(len(solids), dtype=np.int32), [len(s) for s in solids])
    vertices, index = weld(corners.reshape(-1, 3))
    index = index.reshape(-1, 4)
    kept = index != np.roll(index, 1, axis=1)
    portals = plan.openings
    return Scene(
        name=name,
        vertices=vertices,
        corner_vertex=index[kept].astype(np.int32),
        loop_start=np.concatenate([[0], np.cumsum(kept.sum(axis=1))]).astype(np.int64),
        polygon_start=np.arange(len(look) + 1, dtype=np.int64),
        reflectance=np.clip(look[:, :3], 0, 0.9),
        emission=look[:, 3:],
        room=owner_room[owner],
        object=owner,
        room_names=tuple(space.name for space in plan.spaces),
        object_names=object_names,
        portals=Portals(
            vertices=np.concatenate([o.corners for o in portals]) if portals else np.zeros((0, 3)),
            start=np.concatenate([[0], np.cumsum([len(o.corners) for o in portals])]).astype(np.int64),
            rooms=np.array([o.rooms for o in portals], np.int32).reshape(-1, 2),
            names=tuple(o.name for o in portals),
        ),
    )


def lamps(plan: Plan, room: int, spots: list[Place], size: tuple[float, float], lamp: Material, drop: float) -> list[tuple[str, Solid]]:
    """Ceiling lamps at (x, y, degrees), ``drop`` metres under the ceiling."""
    space = plan.spaces[room]
    height = space.base + space.height - drop
    solid = fit.ceiling_lamp(*size, lamp)
    return [(f"lamp {k}", solid.at(x, y, height, turn)) for k, (x, y, turn) in enumerate(spots)]


def command(scene: Callable[[float, int], Scene], description: str) -> None:
    """The command line of the large buildings."""
    import argparse
    from fractions import Fraction
    from pathlib import Path

    from ..core.scene_files import save_scene
    from .import_building import write_building

    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=Path, help="file to write, .blend (needs bpy) or .npz")
    parser.add_argument("--scale", type=Fraction, default=Fraction(1), help="part of the rooms, such as 1/2, 1/8 or 1/27 [1]")
    parser.add_argument("--seed", type=int, default=1, help="seed of what is random [1]")
    parser.add_argument("--cell", type=float, default=0.0, help="width of the grid that cuts faces in the .blend file (m), 0: none [0]")
    given = parser.parse_args()
    made = scene(float(given.scale), given.seed)
    if given.out.suffix == ".blend":
        write_building(made, given.out, given.cell)
    else:
        save_scene(made, given.out)
    print(f"written: {given.out} ({made.polygon_count} polygons, {made.room_count} rooms, {len(made.portals)} portals)")
