# SPDX-License-Identifier: GPL-3.0-or-later
"""The rooms that were found, in colours, and the gaps through which they leak."""

from __future__ import annotations

import colorsys

import numpy as np

from .overlay_layers import LEAK, Content, Layer
from .room_sorting import Survey, rooms_of_polygons

MOST_NAMED = 12
"""Rooms that the legend lists."""
_SUN = np.array([0.32, 0.48, 0.82])


def rooms_content(seen: Survey, names: tuple[str, ...]) -> Content:
    """Every surface in the colour of its room, with a cross at each gap; ``names`` are those of the rooms."""
    found = seen.rooms
    # The golden section keeps the hues of rooms that follow each other apart.
    hues = np.array([colorsys.hsv_to_rgb(k * 0.61803398875 % 1.0, 0.55, 0.85) for k in range(len(found))]).reshape(-1, 3)
    room = rooms_of_polygons(seen)[seen.polygon]
    corners = seen.triangle[room >= 0]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    shade = 0.6 + 0.4 * (0.5 + 0.5 * normal @ _SUN)
    color = np.column_stack([hues[room[room >= 0]] * shade[:, None], np.ones(len(corners))])
    layers = [_layer(seen, False, corners.reshape(-1, 3), np.repeat(color, 3, axis=0))]
    legend = [(tuple(hues[r]), names[r]) for r in range(len(found))]
    if len(legend) > MOST_NAMED:
        legend = [*legend[:MOST_NAMED], (None, f"and {len(legend) - MOST_NAMED} more")]
    if found.gaps:
        arm = 0.3 * np.concatenate([np.eye(3), -np.eye(3)]).reshape(2, 3, 3).swapaxes(0, 1).reshape(-1, 3)
        cross = (np.array([gap.place for gap in found.gaps])[:, None] + arm).reshape(-1, 3)
        layers.append(_layer(seen, True, cross, np.broadcast_to([*LEAK, 1.0], (len(cross), 4)), 4.0))
        legend += [(LEAK, f"a gap of about {gap.width:.1f} m leads out of {names[gap.room]}") for gap in found.gaps[:MOST_NAMED]]
    return Content(f"{len(found)} room{'s' * (len(found) != 1)}", tuple(layers), tuple(legend))


def _layer(seen: Survey, lines: bool, metres: np.ndarray, color: np.ndarray, width: float = 1.0) -> Layer:
    part = "leaks" if lines else "surfaces"
    return Layer(part, lines, (metres / seen.metres_per_unit).astype(np.float32), np.ascontiguousarray(color, np.float32), width)
