# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture as boxes. Every function gives panels about the origin, standing on z = 0, its front towards -y."""

from __future__ import annotations

import itertools

import numpy as np

from .model import Material, Panel
from .shapes import BOTTOM, box, turned


def at(panels: list[Panel], x: float, y: float, degrees: float = 0.0, z: float = 0.0) -> list[Panel]:
    """The panels turned about the vertical and put in their place."""
    shift = np.array([x, y, z])
    return [Panel(p.origin + shift, p.along, p.across, p.material, p.holes) for p in turned(panels, degrees, (0, 0))]


def table(width: float, depth: float, height: float, top: Material, legs: Material, leg: float = 0.06) -> list[Panel]:
    """A slab on four legs."""
    w, d, slab = width / 2, depth / 2, 0.04
    panels = box((-w, -d, height - slab), (w, d, height), top)
    for x in (-w + 0.04, w - 0.04 - leg):
        for y in (-d + 0.04, d - 0.04 - leg):
            panels += box((x, y, 0), (x + leg, y + leg, height - slab), legs, (*BOTTOM, "top"))
    return panels


def chair(seat: Material, legs: Material) -> list[Panel]:
    """A chair with an upright back."""
    panels = table(0.44, 0.44, 0.46, seat, legs, 0.04)
    return panels + box((-0.22, 0.18, 0.46), (0.22, 0.22, 0.88), seat, BOTTOM)


def sofa(width: float, body: Material, cushion: Material) -> list[Panel]:
    """Base, back and two arms, with seat cushions of their own colour."""
    w = width / 2
    panels = box((-w, -0.42, 0), (w, 0.45, 0.24), body, BOTTOM)
    panels += box((-w, 0.22, 0.24), (w, 0.45, 0.8), body, BOTTOM)
    for x in (-w, w - 0.18):
        panels += box((x, -0.42, 0.24), (x + 0.18, 0.22, 0.6), body, (*BOTTOM, "north"))
    seats = max(1, round((width - 0.36) / 0.7))
    edges = np.linspace(-w + 0.2, w - 0.2, seats + 1)
    for a, b in itertools.pairwise(edges):
        panels += box((a + 0.01, -0.44, 0.24), (b - 0.01, 0.2, 0.42), cushion, BOTTOM)
    return panels


def bed(width: float, frame: Material, sheet: Material, blanket: Material, pillow: Material) -> list[Panel]:
    """A bed with its head towards +y, 2.05 m long."""
    w = width / 2
    panels = box((-w, -1.0, 0), (w, 1.0, 0.28), frame, BOTTOM)
    panels += box((-w - 0.04, 1.0, 0), (w + 0.04, 1.06, 1.0), frame, BOTTOM)
    panels += box((-w + 0.03, -0.97, 0.28), (w - 0.03, 0.99, 0.46), sheet, BOTTOM)
    panels += box((-w + 0.01, -0.99, 0.46), (w - 0.01, 0.4, 0.52), blanket)
    half = (2 * w - 0.3) / 2
    for x in (-w + 0.1, 0.05):
        panels += box((x, 0.52, 0.46), (x + half, 0.9, 0.58), pillow, BOTTOM)
    return panels


def cupboard(width: float, depth: float, height: float, body: Material, top: Material | None = None) -> list[Panel]:
    """A closed box that stands on the floor."""
    return box((-width / 2, -depth / 2, 0), (width / 2, depth / 2, height), body, BOTTOM, top)


def bookshelf(
    width: float, height: float, board: Material, books: list[Material], rng: np.random.Generator, levels: int = 5
) -> list[Panel]:
    """An open shelf with rows of books whose widths, heights and colours come from ``rng``."""
    w, thick = width / 2, 0.03
    panels = box((-w, 0.12, 0), (w, 0.15, height), board, BOTTOM)
    for x in (-w, w - thick):
        panels += box((x, -0.15, 0), (x + thick, 0.12, height), board, (*BOTTOM, "north"))
    step = (height - thick) / levels
    for z in np.arange(levels + 1) * step:
        panels += box((-w + thick, -0.15, z), (w - thick, 0.12, z + thick), board, ("north", "east", "west"))
    for level in range(levels):
        x = -w + thick + 0.02
        while x < w - thick - 0.3:
            run, rise = rng.uniform(0.12, 0.28), rng.uniform(0.55, 0.85) * (step - thick)
            if rng.random() < 0.85:
                z = level * step + thick
                panels += box((x, -0.1, z), (x + run, 0.1, z + rise), books[rng.integers(len(books))], BOTTOM)
            x += run + 0.01
    return panels


def pendant(width: float, depth: float, thickness: float, bottom: float, lamp: Material) -> list[Panel]:
    """A hanging lamp: a box that shines on all sides, its lower face ``bottom`` above the floor."""
    return box((-width / 2, -depth / 2, bottom), (width / 2, depth / 2, bottom + thickness), lamp)


def floor_lamp(lamp: Material, pole: Material) -> list[Panel]:
    """A pole on a foot with a shining shade."""
    panels = box((-0.14, -0.14, 0), (0.14, 0.14, 0.03), pole, BOTTOM)
    panels += box((-0.02, -0.02, 0.03), (0.02, 0.02, 1.3), pole, (*BOTTOM, "top"))
    return panels + box((-0.17, -0.17, 1.3), (0.17, 0.17, 1.6), lamp)


def plant(pot: Material, leaf: Material, rng: np.random.Generator) -> list[Panel]:
    """A pot with a few crossing boxes of leaves."""
    panels = box((-0.16, -0.16, 0), (0.16, 0.16, 0.36), pot, BOTTOM)
    for _ in range(4):
        size, z = rng.uniform(0.16, 0.28, 2), rng.uniform(0.45, 0.95)
        leaves = box((-size[0], -size[1], z), (size[0], size[1], z + 0.12), leaf)
        panels += turned(leaves, float(rng.uniform(0, 90)), (0, 0))
    return panels + box((-0.02, -0.02, 0.36), (0.02, 0.02, 0.95), leaf, (*BOTTOM, "top"))
