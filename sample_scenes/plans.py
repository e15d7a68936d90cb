# SPDX-License-Identifier: GPL-3.0-or-later
"""Buildings drawn as plans: rooms with convex outlines, doors through their walls, shafts through their slabs.

Walls and slabs are solid: between two rooms there is a gap, lined where a door or a shaft runs through it; the portal
lies in the middle of the gap.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .model import Material, Opening, Panel
from .solids import Solid, faces, join, of_panels

PLANT_ROOM = 0.36
"""Distance (m) of a plant in a corner from both walls; its leaves stay within this."""
UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Space:
    """A room: a prism over ``outline`` (n, 2), counter-clockwise from above, from ``base`` to ``base + height`` metres.

    Wall i stands on the edge from corner i to corner i + 1. ``holes`` maps a wall to (s0, t0, s1, t1) as in ``Panel``.
    A slab with an opening keeps its outline ``floor_hole`` or ``ceiling_hole`` (n, 2), corner i near corner i of the room.
    A room of four corners may have a floor of ``tiles`` along wall 0 and wall 1, whose materials alternate; a long one of four
    corners may be built in ``bays`` along wall 0, whose floors, ceilings and walls are objects of their own.
    """

    name: str
    outline: np.ndarray
    base: float
    height: float
    walls: Material
    floor: tuple[Material, ...]
    ceiling: Material
    tiles: tuple[int, int] = (1, 1)
    bays: int = 1
    holes: dict[int, list[tuple[float, float, float, float]]] = field(default_factory=dict)
    floor_hole: np.ndarray | None = None
    ceiling_hole: np.ndarray | None = None

    def wall(self, i: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Origin (3,) and direction (3,) of a wall's lower edge, so that direction x up points into the room; its length."""
        start, end = self.outline[(i + 1) % len(self.outline)], self.outline[i]
        length = float(np.linalg.norm(end - start))
        return np.array([*start, self.base]), np.array([*((end - start) / length), 0.0]), length

    def shell(self) -> dict[str, Solid]:
        """Floor, ceiling and walls, seen from inside."""
        walls = []
        for i in range(len(self.outline)):
            origin, along, length = self.wall(i)
            walls.append(Panel(origin, along * length, UP * self.height, self.walls, tuple(self.holes.get(i, ()))))
        top = self.base + self.height
        if self.bays > 1:
            across = (self.bays, 1)
            parts = {"floor": _tiles(self.outline, across, self.base), "ceiling": _tiles(self.outline, across, top)[:, ::-1]}
            return self._in_bays(
                {**{k: faces(v, self.floor[0] if k == "floor" else self.ceiling) for k, v in parts.items()}, "wall": of_panels(walls)}
            )
        if self.tiles == (1, 1):
            floor = faces(_slab(self.outline, self.floor_hole, self.base), self.floor[0])
        else:
            tiles = _tiles(self.outline, self.tiles, self.base)
            colour = np.add.outer(np.arange(self.tiles[0]), np.arange(self.tiles[1])).ravel() % len(self.floor)
            floor = join([faces(tiles[colour == k], material) for k, material in enumerate(self.floor)])
        return {
            "floor": floor,
            "ceiling": faces(_slab(self.outline, self.ceiling_hole, top)[:, ::-1], self.ceiling),
            "wall": of_panels(walls),
        }

    def _in_bays(self, parts: dict[str, Solid]) -> dict[str, Solid]:
        """Every part cut into one for each bay, by the middles of its faces."""
        ahead = self.outline[1] - self.outline[0]
        found = {}
        for name, solid in parts.items():
            way = (solid.corners.mean(axis=1)[:, :2] - self.outline[0]) @ ahead / (ahead @ ahead)
            bay = np.clip((way * self.bays).astype(int), 0, self.bays - 1)
            for k in np.unique(bay).tolist():
                found[f"{name} {k + 1}"] = Solid(solid.corners[bay == k], solid.look[bay == k])
        return found

    def wall_places(self, width: float, depth: float) -> list[tuple[float, float, float]]:
        """(x, y, degrees) for things with their back (+y) to a wall, clear of doors, corners and one another."""
        found = []
        for i in range(len(self.outline)):
            origin, along, length = self.wall(i)
            into = np.cross(along, UP)
            free = [(self._corner_room(i + 1), length - self._corner_room(i))]
            for s0, _, s1, _ in self.holes.get(i, ()):
                free = [part for a, b in free for part in ((a, min(b, s0 - 0.25)), (max(a, s1 + 0.25), b))]
            for a, b in free:
                count = int((b - a + 0.05) / (width + 0.05)) if b > a else 0
                start = (a + b) / 2 - (count * (width + 0.05) - 0.05) / 2
                for k in range(count):
                    spot = origin + along * (start + k * (width + 0.05) + width / 2) + into * (depth / 2 + 0.02)
                    found.append((float(spot[0]), float(spot[1]), float(np.degrees(np.arctan2(-into[1], -into[0])) - 90)))
        return found

    def corner_places(self) -> list[tuple[float, float]]:
        """(x, y) for a plant in every corner."""
        found = []
        for i, corner in enumerate(self.outline):
            back, ahead = self._edges(i)
            found.append(tuple((corner + (ahead - back) * PLANT_ROOM / abs(back[0] * ahead[1] - back[1] * ahead[0])).tolist()))
        return found

    def floor_places(self, inset: float, width: float, depth: float) -> list[tuple[float, float, float]]:
        """(x, y, degrees) of cells of ``width`` along wall 0 and ``depth`` across, ``inset`` away from every wall."""
        u = -self.wall(0)[1][:2]
        v = np.array([-u[1], u[0]])
        local = self.outline @ np.stack([u, v], axis=1)
        low, high = local.min(axis=0) + inset, local.max(axis=0) - inset
        count = np.maximum(((high - low) / (width, depth)).astype(int), 0)
        first = (low + high - (count - 1) * (width, depth)) / 2
        found = []
        for j in range(count[1]):
            for i in range(count[0]):
                cell = first + (i * width, j * depth)
                box = cell + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (width / 2, depth / 2)
                if self._clear(box @ np.stack([u, v])).min() > inset - 1e-9:
                    found.append((*(cell @ np.stack([u, v])).tolist(), float(np.degrees(np.arctan2(u[1], u[0])))))
        return found

    def _clear(self, points: np.ndarray) -> np.ndarray:
        """(n,) distance of points (n, 2) from the nearest wall, negative outside."""
        ahead = np.roll(self.outline, -1, axis=0) - self.outline
        into = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / np.linalg.norm(ahead, axis=1)[:, None]
        return np.einsum("nij,ij->ni", points[:, None] - self.outline, into).min(axis=1)

    def _edges(self, i: int) -> tuple[np.ndarray, np.ndarray]:
        n = len(self.outline)
        back, ahead = self.outline[i % n] - self.outline[(i - 1) % n], self.outline[(i + 1) % n] - self.outline[i % n]
        return back / np.linalg.norm(back), ahead / np.linalg.norm(ahead)

    def _corner_room(self, i: int) -> float:
        """Length of wall (m) that a plant in corner ``i`` takes."""
        back, ahead = self._edges(i)
        half = (np.pi - np.arccos(np.clip(back @ ahead, -1, 1))) / 2
        return float(PLANT_ROOM / np.tan(half) + PLANT_ROOM + 0.02)


@dataclass
class Plan:
    """Rooms and what joins them. ``frames`` holds the linings of the doors and shafts of each room."""

    spaces: list[Space]
    frame: Material
    openings: list[Opening] = field(default_factory=list)
    frames: dict[int, list[Solid]] = field(default_factory=dict)

    def door(self, a: int, i: int, b: int, j: int, centre: np.ndarray, width: float, height: float) -> None:
        """Cut a door from wall ``i`` of room ``a`` into wall ``j`` of room ``b``, which face each other; ``centre`` (2,) in between."""
        first, second = self.spaces[a], self.spaces[b]
        origin, along, _ = first.wall(i)
        out = -np.cross(along, UP)
        gap = float((second.wall(j)[0] - origin) @ out)
        middle = np.array([*centre, first.base])
        for room, wall in ((a, i), (b, j)):
            self._line(room, wall, middle, width, height, gap / 2)
        left, right = ((middle @ along - origin @ along + side * width / 2) * along + origin + out * gap / 2 for side in (-1, 1))
        corners = np.array([right, left, left + UP * height, right + UP * height])
        self.openings.append(Opening(f"Door {first.name} - {second.name}", corners, (a, b)))

    def shaft(self, lower: int, upper: int, outline: np.ndarray) -> None:
        """Open the ceiling of ``lower`` and the floor of ``upper``; ``outline`` (n, 2) as in :class:`Space`."""
        below, above = self.spaces[lower], self.spaces[upper]
        below.ceiling_hole = above.floor_hole = outline
        low, high = below.base + below.height, above.base
        middle = (low + high) / 2
        self.frames.setdefault(lower, []).append(faces(_fence(outline, low, middle), self.frame))
        self.frames.setdefault(upper, []).append(faces(_fence(outline, middle, high), self.frame))
        corners = np.column_stack([outline, np.full(len(outline), middle)])
        self.openings.append(Opening(f"Shaft {below.name} - {above.name}", corners, (lower, upper)))

    def shell(self, room: int) -> dict[str, Solid]:
        """Everything that bounds a room but its portals."""
        parts = self.spaces[room].shell()
        if room in self.frames:
            parts["frame"] = join(self.frames[room])
        return parts

    def _line(self, room: int, wall: int, middle: np.ndarray, width: float, height: float, depth: float) -> None:
        space = self.spaces[room]
        origin, along, _ = space.wall(wall)
        s = float((middle - origin) @ along)
        space.holes.setdefault(wall, []).append((s - width / 2, 0.0, s + width / 2, height))
        left, right, out = origin + (s - width / 2) * along, origin + (s + width / 2) * along, -np.cross(along, UP) * depth
        rise = UP * height
        self.frames.setdefault(room, []).append(
            faces(
                [
                    [left, left + out, left + out + rise, left + rise],
                    [right + out, right, right + rise, right + out + rise],
                    [left + rise, left + out + rise, right + out + rise, right + rise],
                    [left, right, right + out, left + out],
                ],
                self.frame,
            )
        )


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """(4, 2) outline; wall 0 looks south, then east, north, west."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _slab(outline: np.ndarray, hole: np.ndarray | None, z: float) -> np.ndarray:
    """(k, 4, 3) faces of a horizontal polygon or ring, seen from above."""
    n = len(outline)
    if hole is None:
        index = np.array([(0, k, k + 1, min(k + 2, n - 1)) for k in range(1, n - 1, 2)])
        flat = outline[index]
    else:
        flat = np.stack([outline, np.roll(outline, -1, axis=0), np.roll(hole, -1, axis=0), hole], axis=1)
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), z)], axis=2)


def _tiles(outline: np.ndarray, count: tuple[int, int], z: float) -> np.ndarray:
    """(n * m, 4, 3) tiles of a parallelogram (4, 2), n along its first edge and m along its second, seen from above."""
    n, m = count
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    s = np.stack([i, i + 1, i + 1, i], axis=1)[..., None] / n
    t = np.stack([j, j, j + 1, j + 1], axis=1)[..., None] / m
    flat = outline[0] + s * (outline[1] - outline[0]) + t * (outline[3] - outline[0])
    return np.concatenate([flat, np.full((n * m, 4, 1), z)], axis=2)


def _fence(outline: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n, 4, 3) vertical faces along an outline, seen from inside it."""
    start, end = np.roll(outline, -1, axis=0), outline
    at = lambda points, z: np.column_stack([points, np.full(len(points), z)])  # noqa: E731
    return np.stack([at(start, low), at(end, low), at(end, high), at(start, high)], axis=1)
