# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces that shine unevenly by an image: which of them are cut into grids, and how finely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.patch_means import patch_means

CELLS = 8
"""Most cells along a side of a face that is cut."""

UNEVEN = 0.1
"""A cell is as fine as it needs be when all in it differs by less from its mean, relative to the brightest place of the face."""

SMALL = 0.01
"""Faces that send out a smaller part of the light of all images are not cut: a hundred of them at most are."""

TOLERANCE = 0.02
"""Cells that differ by less, relative to the brightest one, shine alike."""


@dataclass(frozen=True)
class Screens:
    """k quads of an object that shine by an image.

    polygon : (k,) of the object's polygons, ascending;  power : (k,) W, all channels together;  total : W, of all that shine by images
    emission : (k, CELLS, CELLS, 3) exitance, W/m2, first along the side from the first corner to the second, then from it to the fourth
    """

    polygon: np.ndarray
    power: np.ndarray
    total: float
    emission: np.ndarray


def cells_of(emission: np.ndarray) -> np.ndarray:
    """(k,) the cells along the sides of screens of this ``emission`` (k, CELLS, CELLS, 3), 1 for those that stay whole."""
    out = np.full(len(emission), CELLS)
    brightest = emission.max(axis=(1, 2, 3))
    for n in (4, 2, 1):
        blocks = _blocks(emission, n)
        off = np.abs(blocks - blocks.mean(axis=(2, 4), keepdims=True)).max(axis=(1, 2, 3, 4, 5))
        out[off <= UNEVEN * brightest] = n
    return out


def cell_emission(emission: np.ndarray, n: int) -> np.ndarray:
    """(k, n * n, 3) the emission of the cells of screens that are cut into n x n."""
    value = _blocks(emission, n).mean(axis=(2, 4)).reshape(-1, 3)
    k, parts = len(emission), n * n
    screen = np.repeat(np.arange(k), parts)
    tolerance = TOLERANCE * np.maximum(emission.max(axis=(1, 2, 3)), 1e-300)
    alone = np.zeros((len(value), 3))
    alone[:, 0] = np.tile(np.arange(parts), k)
    return patch_means(value, np.ones(len(value)), screen, alone, parts, tolerance).reshape(k, parts, 3)


def _blocks(emission: np.ndarray, n: int) -> np.ndarray:
    size = CELLS // n
    return emission.reshape(-1, n, size, n, size, 3)
