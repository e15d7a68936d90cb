# SPDX-License-Identifier: GPL-3.0-or-later
"""A building made of rectangles: what the sample generators write, before it becomes a Scene or a .blend file.

Lengths are metres, z is up, colours are linear RGB. A panel is a rectangle with rectangular holes; a piece is
what becomes one Blender object; an opening becomes one portal.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..core.scene import Portals, Scene


@dataclass(frozen=True)
class Material:
    """Diffuse reflectance (0..1) and emitted exitance of the front (W/m2; radiance = exitance / pi), linear RGB."""

    name: str
    reflectance: tuple[float, float, float]
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Panel:
    """Rectangle ``origin + s * along + t * across``, 0 <= s, t <= 1, seen from the side of ``along x across``.

    ``holes`` are (s0, t0, s1, t1) in metres along the two edges.
    """

    origin: np.ndarray
    along: np.ndarray
    across: np.ndarray
    material: Material
    holes: tuple[tuple[float, float, float, float], ...] = ()

    @property
    def size(self) -> tuple[float, float]:
        """Lengths of the two edges, metres."""
        return float(np.linalg.norm(self.along)), float(np.linalg.norm(self.across))

    def rectangles(self) -> np.ndarray:
        """(n, 4, 3) corners of few rectangles that cover the panel without its holes, counter-clockwise."""
        width, height = self.size
        lines = _lines(width, [h[0] for h in self.holes] + [h[2] for h in self.holes])
        spans = []
        for s0, s1 in itertools.pairwise(lines):
            t = 0.0
            for hole in sorted((h for h in self.holes if h[0] < (s0 + s1) / 2 < h[2]), key=lambda h: h[1]):
                if hole[1] > t + 1e-6:
                    spans.append((s0, t, s1, hole[1]))
                t = max(t, hole[3])
            if t < height - 1e-6:
                spans.append((s0, t, s1, height))
        return self._corners(np.array(spans).reshape(-1, 4))

    def cells(self, cell: float) -> np.ndarray:
        """(n, 4, 3) corners of a grid without T-junctions, no edge longer than ``cell`` metres, without the holes."""
        width, height = self.size
        s = _refined(_lines(width, [h[0] for h in self.holes] + [h[2] for h in self.holes]), cell)
        t = _refined(_lines(height, [h[1] for h in self.holes] + [h[3] for h in self.holes]), cell)
        i, j = (index.ravel() for index in np.meshgrid(np.arange(len(s) - 1), np.arange(len(t) - 1), indexing="ij"))
        spans = np.stack([s[i], t[j], s[i + 1], t[j + 1]], axis=1)
        middle = (spans[:, :2] + spans[:, 2:]) / 2
        for s0, t0, s1, t1 in self.holes:
            solid = (middle[:, 0] < s0) | (middle[:, 0] > s1) | (middle[:, 1] < t0) | (middle[:, 1] > t1)
            spans, middle = spans[solid], middle[solid]
        return self._corners(spans)

    def _corners(self, spans: np.ndarray) -> np.ndarray:
        width, height = self.size
        u, v = self.along / width, self.across / height
        s = spans[:, [0, 2, 2, 0], None]
        t = spans[:, [1, 1, 3, 3], None]
        return self.origin + s * u + t * v


@dataclass(frozen=True)
class Piece:
    """One object of one room. A picture from behind a ``shell`` piece (wall, ceiling) is taken as if it were not there."""

    name: str
    room: int
    panels: tuple[Panel, ...]
    shell: bool = False


@dataclass(frozen=True)
class Opening:
    """A portal: (n, 3) corners whose normal runs from ``rooms[0]`` to ``rooms[1]``; -1 is the outside."""

    name: str
    corners: np.ndarray
    rooms: tuple[int, int]


@dataclass
class Model:
    """A whole building."""

    name: str
    rooms: tuple[str, ...]
    pieces: list[Piece] = field(default_factory=list)
    openings: list[Opening] = field(default_factory=list)

    def panels(self) -> Iterator[tuple[int, Piece, Panel]]:
        """Every panel with its piece and the index of the piece."""
        for index, piece in enumerate(self.pieces):
            for panel in piece.panels:
                yield index, piece, panel


def to_scene(model: Model) -> Scene:
    """The model as the solver takes it: its panels cut into few rectangles, its openings as portals."""
    corners, reflectance, emission, room, owner = [], [], [], [], []
    for index, piece, panel in model.panels():
        rectangles = panel.rectangles()
        corners.append(rectangles)
        reflectance += [panel.material.reflectance] * len(rectangles)
        emission += [panel.material.emission] * len(rectangles)
        room += [piece.room] * len(rectangles)
        owner += [index] * len(rectangles)
    points = np.concatenate(corners).reshape(-1, 3)
    vertices, corner_vertex = weld(points)
    count = len(room)
    openings = model.openings
    sizes = [len(o.corners) for o in openings]
    portals = Portals(
        vertices=np.concatenate([o.corners for o in openings]) if openings else np.zeros((0, 3)),
        start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        rooms=np.array([o.rooms for o in openings], np.int32).reshape(-1, 2),
        names=tuple(o.name for o in openings),
    )
    return Scene(
        name=model.name,
        vertices=vertices,
        corner_vertex=corner_vertex.astype(np.int32),
        loop_start=np.arange(count + 1, dtype=np.int64) * 4,
        polygon_start=np.arange(count + 1, dtype=np.int64),
        reflectance=np.array(reflectance, float),
        emission=np.array(emission, float),
        room=np.array(room, np.int32),
        object=np.array(owner, np.int32),
        room_names=model.rooms,
        object_names=tuple(piece.name for piece in model.pieces),
        portals=portals,
    )


def weld(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) distinct points and (n,) the one of each of (n, 3) points; a micrometre apart is the same point."""
    grid = np.round(points * 1e6).astype(np.int64)
    order = np.lexsort(grid.T[::-1])
    new = np.ones(len(order), bool)
    new[1:] = (grid[order[1:]] != grid[order[:-1]]).any(axis=1)
    index = np.empty(len(order), np.int64)
    index[order] = np.cumsum(new) - 1
    return points[order[new]], index


def _lines(length: float, cuts: list[float]) -> np.ndarray:
    inside = np.unique(np.round([c for c in cuts if 1e-6 < c < length - 1e-6], 9))
    return np.concatenate([[0.0], inside, [length]])


def _refined(lines: np.ndarray, cell: float) -> np.ndarray:
    parts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / cell - 1e-9))) + 1)[:-1] for a, b in itertools.pairwise(lines)]
    return np.concatenate([*parts, lines[-1:]])
