# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes, rooms, doors and windows as panels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .model import Material, Model, Opening, Panel, Piece

FACES = ("west", "east", "south", "north", "bottom", "top")
BOTTOM = ("bottom",)


def panel(origin, along, across, material: Material, holes=()) -> Panel:
    """A panel from any triples of numbers."""
    return Panel(np.array(origin, float), np.array(along, float), np.array(across, float), material, tuple(holes))


def box(low, high, material: Material, without: tuple[str, ...] = (), top: Material | None = None) -> list[Panel]:
    """The outside of an axis-aligned box; ``without`` names faces that are left out, ``top`` has its own material."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    w, d, h = (x1 - x0, 0, 0), (0, y1 - y0, 0), (0, 0, z1 - z0)
    back_w, back_d = (x0 - x1, 0, 0), (0, y0 - y1, 0)
    faces = {
        "west": ((x0, y1, z0), back_d, h),
        "east": ((x1, y0, z0), d, h),
        "south": ((x0, y0, z0), w, h),
        "north": ((x1, y1, z0), back_w, h),
        "bottom": ((x0, y0, z0), d, w),
        "top": ((x0, y0, z1), w, d),
    }
    return [panel(*faces[f], top if f == "top" and top else material) for f in FACES if f not in without]


def turned(panels: list[Panel], degrees: float, centre) -> list[Panel]:
    """The panels turned about the vertical through ``centre`` (x, y), counter-clockwise seen from above."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    pivot = np.array([*centre, 0.0])
    return [Panel(turn @ (p.origin - pivot) + pivot, turn @ p.along, turn @ p.across, p.material, p.holes) for p in panels]


@dataclass
class Room:
    """An axis-aligned room with inward faces; materials by face, ``walls`` for a wall that has none of its own."""

    name: str
    low: tuple[float, float]
    high: tuple[float, float]
    height: float
    walls: Material
    floor: Material
    ceiling: Material
    accents: dict[str, Material] = field(default_factory=dict)

    def wall(self, side: str) -> tuple[np.ndarray, np.ndarray]:
        """Origin and edge of a wall along the floor, so that edge x up points into the room."""
        (x0, y0), (x1, y1) = self.low, self.high
        start, end = {
            "south": ((x1, y0), (x0, y0)),
            "north": ((x0, y1), (x1, y1)),
            "west": ((x0, y0), (x0, y1)),
            "east": ((x1, y1), (x1, y0)),
        }[side]
        return np.array([*start, 0.0]), np.array([end[0] - start[0], end[1] - start[1], 0.0])


@dataclass
class Door:
    """An opening between two rooms (indices), through the gap between ``side`` of the first and the second.

    ``span`` is its extent along the wall in world coordinates (x or y), ``height`` its lower and upper edge.
    """

    name: str
    rooms: tuple[int, int]
    side: str
    span: tuple[float, float]
    height: tuple[float, float]
    frame: Material


@dataclass
class Window:
    """A closed window: a dark pane in a recess of the wall. ``span`` and ``height`` as for a door."""

    room: int
    side: str
    span: tuple[float, float]
    height: tuple[float, float]
    depth: float
    pane: Material
    frame: Material


OPPOSITE = {"north": "south", "south": "north", "east": "west", "west": "east"}
OUTWARD = {"north": (0, 1, 0), "south": (0, -1, 0), "east": (1, 0, 0), "west": (-1, 0, 0)}


def build(name: str, rooms: list[Room], doors: list[Door], windows: list[Window]) -> Model:
    """The shell of a building: floors, ceilings, walls with their openings, door frames and windows."""
    model = Model(name, tuple(r.name for r in rooms))
    reveals: list[list[Panel]] = [[] for _ in rooms]
    panes: list[list[Panel]] = [[] for _ in rooms]
    holes: dict[tuple[int, str], list] = {}
    for door in doors:
        a, b = door.rooms
        gap = _gap(rooms[a], rooms[b], door.side)
        _tunnel(rooms[a], door.side, door.span, door.height, gap / 2, door.frame, reveals[a], holes.setdefault((a, door.side), []))
        back = OPPOSITE[door.side]
        _tunnel(rooms[b], back, door.span, door.height, gap / 2, door.frame, reveals[b], holes.setdefault((b, back), []))
        model.openings.append(Opening(door.name, _opening(rooms[a], door, gap / 2), door.rooms))
    for window in windows:
        room, where = rooms[window.room], holes.setdefault((window.room, window.side), [])
        _tunnel(room, window.side, window.span, window.height, window.depth, window.frame, panes[window.room], where)
        panes[window.room] += _pane(room, window)
    for index, room in enumerate(rooms):
        (x0, y0), (x1, y1) = room.low, room.high
        w, d = x1 - x0, y1 - y0
        floor = panel((x0, y0, 0), (w, 0, 0), (0, d, 0), room.floor)
        ceiling = panel((x0, y0, room.height), (0, d, 0), (w, 0, 0), room.ceiling)
        model.pieces.append(Piece(f"{room.name} floor", index, (floor,)))
        model.pieces.append(Piece(f"{room.name} ceiling", index, (ceiling,), shell=True))
        for side in ("south", "north", "west", "east"):
            origin, along = room.wall(side)
            material = room.accents.get(side, room.walls)
            wall = panel(origin, along, (0, 0, room.height), material, holes.get((index, side), ()))
            model.pieces.append(Piece(f"{room.name} wall {side}", index, (wall,), shell=True))
        if reveals[index]:
            model.pieces.append(Piece(f"{room.name} door frames", index, tuple(reveals[index])))
        if panes[index]:
            model.pieces.append(Piece(f"{room.name} windows", index, tuple(panes[index])))
    return model


def _gap(a: Room, b: Room, side: str) -> float:
    axis = 0 if side in ("east", "west") else 1
    return b.low[axis] - a.high[axis] if side in ("east", "north") else a.low[axis] - b.high[axis]


def _local(room: Room, side: str, span) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Wall origin, unit edge, and the span along that edge."""
    origin, along = room.wall(side)
    u = along / np.linalg.norm(along)
    axis = 0 if side in ("north", "south") else 1
    a, b = sorted((np.array(span) - origin[axis]) * u[axis])
    return origin, u, float(a), float(b)


def _tunnel(room: Room, side: str, span, height, depth: float, material: Material, panels: list, holes: list) -> None:
    """Cut a hole into a wall and line it outwards to ``depth``, with faces that look into the opening."""
    origin, u, a, b = _local(room, side, span)
    up, out = np.array([0.0, 0.0, 1.0]), np.array(OUTWARD[side], float)
    low, high = height
    holes.append((a, low, b, high))
    left, right = origin + a * u, origin + b * u
    rise = (high - low) * up
    panels.append(panel(left + low * up, depth * out, rise, material))
    panels.append(panel(right + low * up + depth * out, -depth * out, rise, material))
    panels.append(panel(left + high * up, depth * out, right - left, material))
    panels.append(panel(left + low * up, right - left, depth * out, material))


def _opening(room: Room, door: Door, depth: float) -> np.ndarray:
    origin, u, a, b = _local(room, door.side, door.span)
    up, out = np.array([0.0, 0.0, 1.0]), np.array(OUTWARD[door.side], float)
    low, high = door.height
    base = origin + depth * out
    # Seen from inside the first room the edge runs to the right, so this order gives a normal out of it.
    return np.array([base + b * u + low * up, base + a * u + low * up, base + a * u + high * up, base + b * u + high * up])


def _pane(room: Room, window: Window) -> list[Panel]:
    origin, u, a, b = _local(room, window.side, window.span)
    up, out = np.array([0.0, 0.0, 1.0]), np.array(OUTWARD[window.side], float)
    low, high = window.height
    corner = origin + a * u + low * up + window.depth * out
    return [panel(corner, (b - a) * u, (high - low) * up, window.pane)]
