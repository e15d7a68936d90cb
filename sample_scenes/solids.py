# SPDX-License-Identifier: GPL-3.0-or-later
"""Solid bodies as arrays: the furniture of buildings of a hundred thousand polygons, made in seconds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .model import Material, Panel

SIDES = {
    "west": (2, 0, 4, 6),
    "east": (1, 3, 7, 5),
    "south": (0, 1, 5, 4),
    "north": (3, 2, 6, 7),
    "bottom": (0, 2, 3, 1),
    "top": (4, 5, 7, 6),
}
"""Corners of the faces of a box, counter-clockwise from outside; bits 0, 1, 2 of a corner are its x, y, z."""


@dataclass(frozen=True)
class Solid:
    """n flat faces. corners : (n, 4, 3) float64, metres, a corner of a triangle doubled;
    look : (n, 6) float64, reflectance and emitted exitance (W/m2), linear RGB."""

    corners: np.ndarray
    look: np.ndarray

    def __len__(self) -> int:
        return len(self.look)

    def at(self, x: float, y: float, z: float = 0.0, degrees: float = 0.0) -> Solid:
        """The solid turned about the vertical (counter-clockwise from above) and put in its place."""
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Solid(self.corners @ turn.T + np.array([x, y, z]), self.look)


def look(material: Material) -> np.ndarray:
    """(6,) reflectance and emission."""
    return np.array([*material.reflectance, *material.emission])


def join(solids: Iterable[Solid]) -> Solid:
    """All faces in one."""
    solids = list(solids)
    return Solid(np.concatenate([s.corners for s in solids]), np.concatenate([s.look for s in solids]))


def faces(corners: np.ndarray, material: Material) -> Solid:
    """(n, 4, 3) faces of one material."""
    corners = np.asarray(corners, float).reshape(-1, 4, 3)
    return Solid(corners, np.broadcast_to(look(material), (len(corners), 6)))


def of_panels(panels: Iterable[Panel]) -> Solid:
    """Panels, each cut into rectangles around its holes."""
    return join(faces(p.rectangles(), p.material) for p in panels)


def boxes(low: np.ndarray, high: np.ndarray, looks: np.ndarray, without: tuple[str, ...] = ()) -> Solid:
    """Axis-aligned boxes (n, 3) .. (n, 3) with (n, 6) or (6,) ``looks``; ``without`` names faces that are left out."""
    low, high = np.atleast_2d(low), np.atleast_2d(high)
    bits = np.arange(8)[:, None] >> np.arange(3) & 1
    corner = np.where(bits, high[:, None], low[:, None])
    order = np.array([SIDES[side] for side in SIDES if side not in without])
    looks = np.broadcast_to(looks, (len(low), 6))
    return Solid(corner[:, order].reshape(-1, 4, 3), np.repeat(looks, len(order), axis=0))


def revolution(profile: list[tuple[float, float]], sides: int, material: Material) -> Solid:
    """The outside of a body of revolution about z: ``profile`` lists (radius, height), its outside to the right of the way.

    Radius 0 closes it with triangles. Faces between two rings: ``sides``.
    """
    radius, height = np.array(profile, float).T
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)), np.repeat(height[:, None], sides, 1)], axis=-1)
    after = np.roll(ring, -1, axis=1)
    quads = np.stack([ring[:-1], after[:-1], after[1:], ring[1:]], axis=2)
    return faces(quads, material)


def leaves(root: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray, length: np.ndarray, four: int, material: Material) -> Solid:
    """Closed leaves of a plant (n of them): the first ``four`` with four triangles each, the others with five faces.

    root : (n, 3), metres; azimuth, elevation : (n,) radians; length : (n,) metres
    """
    ahead = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
    aside = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    over = np.cross(ahead, aside)
    size = length[:, None]
    end, wide, thick = root + size * ahead, 0.12 * size * aside, 0.04 * size * over
    a, left, right, ridge = root[:four], (end + wide)[:four], (end - wide)[:four], (root + 0.6 * size * ahead + thick)[:four]
    three = np.stack([_triangle(a, left, right), _triangle(a, right, ridge), _triangle(right, left, ridge), _triangle(left, a, ridge)], 1)
    middle = root + 0.5 * size * ahead
    a, tip, left, right, ridge = (x[four:] for x in (root, end, middle + wide, middle - wide, middle + thick))
    kite = np.stack([a, left, tip, right], axis=1)
    roof = [_triangle(a, right, ridge), _triangle(right, tip, ridge), _triangle(tip, left, ridge), _triangle(left, a, ridge)]
    return join([faces(three, material), faces(np.stack([kite, *roof], axis=1), material)])


def _triangle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.stack([a, b, c, c], axis=1)
