# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture of the large buildings as solids: each about the origin, standing on z = 0, its back towards +y."""

from __future__ import annotations

from functools import cache

import numpy as np

from . import furniture as make
from .model import Material
from .shapes import BOTTOM, box
from .solids import Solid, boxes, faces, join, leaves, look, of_panels, revolution

OAK = Material("Oak", (0.46, 0.29, 0.16))
WALNUT = Material("Walnut", (0.26, 0.14, 0.08))
BIRCH = Material("Birch", (0.6, 0.44, 0.28))
WHITE = Material("White lacquer", (0.78, 0.78, 0.76))
STEEL = Material("Steel", (0.3, 0.3, 0.32))
STONE = Material("Stone", (0.5, 0.49, 0.47))
LINEN = Material("Linen", (0.74, 0.7, 0.62))
CLAY = Material("Clay", (0.5, 0.25, 0.15))
LEAF = Material("Leaf", (0.1, 0.32, 0.06))
CLOTHS = tuple(
    Material(name, colour)
    for name, colour in (
        ("Grey cloth", (0.27, 0.29, 0.33)),
        ("Blue cloth", (0.08, 0.16, 0.42)),
        ("Red cloth", (0.62, 0.06, 0.06)),
        ("Mustard cloth", (0.75, 0.46, 0.05)),
        ("Green cloth", (0.12, 0.34, 0.16)),
    )
)
WOODS = (OAK, WALNUT, BIRCH)
BOOKS = np.array([(0.55, 0.08, 0.07), (0.09, 0.18, 0.45), (0.1, 0.32, 0.15), (0.7, 0.64, 0.5), (0.06, 0.06, 0.07), (0.75, 0.3, 0.05)])
LAMPS = tuple(
    Material(name, (0.6, 0.6, 0.6), light)
    for name, light in (("Lamp warm", (120.0, 96.0, 64.0)), ("Lamp neutral", (104.0, 96.0, 82.0)), ("Lamp cool", (88.0, 96.0, 102.0)))
)
SHELF = (1.2, 0.34, 2.14)
"""Width, depth and height (m) of a shelf."""
SHELF_FRAME = 31
"""Faces of a shelf without books."""
POT = 12
"""Faces of a plant without leaves."""


@cache
def desk(wood: Material) -> Solid:
    """A table of 1.4 x 0.7 m."""
    return of_panels(make.table(1.4, 0.7, 0.74, wood, STEEL))


@cache
def seat(cloth: Material) -> Solid:
    """A chair."""
    return of_panels(make.chair(cloth, STEEL))


@cache
def desk_with_chair(wood: Material, cloth: Material) -> Solid:
    """A desk and a chair in front of it, in 1.4 x 1.6 m."""
    return join([desk(wood).at(0, 0.3), seat(cloth).at(0, -0.4, degrees=170)])


@cache
def dining(wood: Material, cloth: Material, chairs: int = 4) -> Solid:
    """A table with up to four chairs, in 1.4 x 2 m."""
    places = ((-0.32, 0.68, 4), (0.32, -0.68, 184), (0.32, 0.68, -5), (-0.32, -0.68, 175))
    return join([desk(wood), *(seat(cloth).at(x, y, degrees=turn) for x, y, turn in places[:chairs])])


@cache
def bench(wood: Material) -> Solid:
    """A bench of 0.9 m."""
    return of_panels(make.table(0.9, 0.36, 0.45, wood, STEEL))


@cache
def cupboard(wood: Material, width: float = 1.0, height: float = 1.2) -> Solid:
    """A closed box on the floor, as deep as a shelf."""
    return of_panels(make.cupboard(width, SHELF[1], height, wood))


@cache
def sofa(cloth: Material) -> Solid:
    """A sofa of 1.8 m."""
    return of_panels(make.sofa(1.8, cloth, cloth))


@cache
def bed(wood: Material, cloth: Material) -> Solid:
    """A bed of 1.4 m by 2.1 m."""
    panels = box((-0.7, -1.04, 0), (0.7, 1.0, 0.28), wood, (*BOTTOM, "north")) + box((-0.72, 1.0, 0), (0.72, 1.06, 0.9), wood, BOTTOM)
    panels += box((-0.67, -1.01, 0.28), (0.67, 0.97, 0.46), cloth, BOTTOM)
    for x in (-0.6, 0.06):
        panels += box((x, 0.5, 0.46), (x + 0.54, 0.9, 0.56), LINEN, BOTTOM)
    return of_panels(panels)


@cache
def vase(clay: Material, sides: int = 12) -> Solid:
    """A vase 0.4 m high, closed at its mouth."""
    profile = [(0.07, 0), (0.1, 0.05), (0.13, 0.12), (0.12, 0.2), (0.07, 0.28), (0.05, 0.34), (0.07, 0.4), (0.0, 0.4)]
    return revolution(profile, sides, clay)


@cache
def column(height: float, sides: int = 16) -> Solid:
    """A round column with base and capital, from floor to ceiling, 0.8 m wide."""
    h = height
    profile = [(0.4, 0), (0.4, 0.25), (0.3, 0.35), (0.28, 0.4), (0.25, h - 0.6), (0.3, h - 0.5), (0.4, h - 0.2), (0.4, h)]
    return revolution(profile, sides, STONE)


def balusters(outline: np.ndarray, wood: Material, spacing: float = 0.3) -> Solid:
    """A rail on turned posts along a closed outline (n, 2), 1 m high."""
    after = np.roll(outline, -1, axis=0)
    count = np.maximum(np.ceil(np.linalg.norm(after - outline, axis=1) / spacing).astype(int), 1)
    spots = np.concatenate([a + (b - a) * (np.arange(k) / k)[:, None] for a, b, k in zip(outline, after, count, strict=True)])
    post = revolution([(0.05, 0), (0.05, 0.12), (0.025, 0.2), (0.045, 0.5), (0.02, 0.8), (0.04, 0.95)], 8, wood)
    posts = faces(post.corners + np.column_stack([spots, np.zeros(len(spots))])[:, None, None], wood)
    middle, rail = outline.mean(axis=0), []
    inner, outer = (middle + (outline - middle) * (1 + side * 0.07 / np.linalg.norm(outline - middle, axis=1)[:, None]) for side in (-1, 1))
    rings = [np.column_stack([line, np.full(len(line), z)]) for line, z in ((outer, 0.95), (outer, 1.02), (inner, 1.02), (inner, 0.95))]
    for a, b in zip(rings, [*rings[1:], rings[0]], strict=True):
        rail.append(np.stack([a, np.roll(a, -1, axis=0), np.roll(b, -1, axis=0), b], axis=1))
    return join([posts, faces(np.concatenate(rail), wood)])


def ceiling_lamp(width: float, depth: float, lamp: Material) -> Solid:
    """A flat lamp with its middle at the origin, 0.06 m thick, that shines downwards only."""
    half = np.array([width / 2, depth / 2, 0.03])
    return join([boxes(-half, half, look(WHITE), BOTTOM), boxes(-half, half, look(lamp), ("west", "east", "south", "north", "top"))])


def steps(count: int, rise: float, tread: float, width: float, material: Material) -> Solid:
    """A flight of stairs that climbs towards +x from the origin, closed at its back, its width about y = 0."""
    climb = np.arange(count)
    low = np.column_stack([climb * tread, np.full(count, -width / 2), np.zeros(count)])
    high = np.column_stack([(climb + 1) * tread, np.full(count, width / 2), (climb + 1) * rise])
    flanks = boxes(low, high, look(material), ("west", "east", "bottom"))
    fronts = low * [1, 1, 0] + np.column_stack([np.zeros((count, 2)), climb * rise])
    risers = boxes(fronts, np.column_stack([low[:, 0], high[:, 1:]]), look(material), ("east", "south", "north", "bottom", "top"))
    back = boxes(low[-1:], high[-1:], look(material), ("west", "south", "north", "bottom", "top"))
    return join([flanks, risers, back])


def shelf(wood: Material, rng: np.random.Generator, most: int) -> Solid:
    """A shelf with books of many widths, heights and colours, no more than ``most``: ``SHELF_FRAME`` faces and five for each book."""
    (w, d, h), thick, levels = (SHELF[0] / 2, SHELF[1] / 2, SHELF[2]), 0.03, 6
    panels = box((-w, d - thick, 0), (w, d, h), wood, BOTTOM)
    for x in (-w, w - thick):
        panels += box((x, -d, 0), (x + thick, d - thick, h), wood, (*BOTTOM, "north"))
    step = (h - 0.13) / (levels - 1)
    height = 0.1 + step * np.arange(levels)
    boards = [box((-w + thick, -d, z - thick), (w - thick, d - thick, z), wood, ("west", "east", "north")) for z in height.tolist()]
    frame = of_panels([*panels, *(p for board in boards for p in board)])

    rows, most_in_row = levels - 1, 40
    wide = rng.uniform(0.024, 0.056, (rows, most_in_row))
    end = -w + thick + 0.01 + np.cumsum(wide + 0.006, axis=1)
    # A row is not always full to its end.
    kept = end < w - thick - 0.01 - rng.uniform(0, 0.35, (rows, 1)) * rng.integers(0, 2, (rows, 1))
    tall, deep = rng.uniform(0.5, 0.86, kept.shape) * (step - thick), rng.uniform(0.16, 0.24, kept.shape)
    colour = BOOKS[rng.integers(len(BOOKS), size=kept.shape)] * rng.choice((0.7, 1.0, 1.2), (*kept.shape, 1))
    row, column = (index[:most] for index in np.nonzero(kept))
    x1, x0, z = end[row, column], (end - wide)[row, column], height[row]
    front = np.full(len(row), -d + 0.03)
    low = np.stack([x0, front, z], axis=1)
    high = np.stack([x1, front + deep[row, column], z + tall[row, column]], axis=1)
    looks = np.concatenate([colour[row, column], np.zeros((len(row), 3))], axis=1)
    return join([frame, boxes(low, high, looks, BOTTOM)])


def plant(rng: np.random.Generator, four: int, five: int) -> Solid:
    """A pot with ``four`` leaves of four faces and ``five`` leaves of five, within 0.34 m of its axis."""
    count = four + five
    azimuth = np.arange(count) * 2.39996 + rng.uniform(0, 6.28)
    elevation, length = rng.uniform(0.5, 1.4, count), rng.uniform(0.3, 0.8, count)
    length = np.minimum(length, 0.3 / np.cos(elevation))
    reach = rng.uniform(0.01, 0.03, count)
    root = np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), rng.uniform(0.31, 0.36 + 0.004 * count, count)], axis=1)
    pot = revolution([(0.1, 0), (0.15, 0.3), (0, 0.3)], POT // 2, CLAY)
    return join([pot, leaves(root, azimuth, elevation, length, four, LEAF)])
