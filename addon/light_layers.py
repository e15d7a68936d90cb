# SPDX-License-Identifier: GPL-3.0-or-later
"""The light on the elements as coloured triangles: as it looks, in false colours with a scale in lux, by its estimated error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.element_mesh import ElementMesh
from ..core.photometry import LUMINOUS_EFFICACY, luminance
from .bake_texture import display_encoded
from .overlay_layers import Content, Layer, Scale

SPECTRUM = np.array(
    [
        (0.06, 0.03, 0.20),
        (0.13, 0.19, 0.62),
        (0.10, 0.47, 0.87),
        (0.08, 0.72, 0.70),
        (0.30, 0.80, 0.32),
        (0.80, 0.86, 0.20),
        (0.99, 0.70, 0.13),
        (0.94, 0.36, 0.10),
        (0.72, 0.08, 0.12),
    ]
)
"""False colours from little light to much; display colours."""

DOUBT = np.array([(0.16, 0.42, 0.30), (0.45, 0.68, 0.35), (0.94, 0.82, 0.30), (0.93, 0.46, 0.15), (0.75, 0.10, 0.15)])
"""From a small estimated error to a large one; display colours."""

UNKNOWN = (0.45, 0.45, 0.48)
LINE = 0.045
"""Width of the lines around elements, as a part of the way to the middle of the element."""
LIFT = 2e-3
"""Such lines lie this far before their surface, metres."""
DECADES = 3
"""Span of a logarithmic scale."""
STEEP = 1 / 16
"""Triangles over which the colour runs through more of its scale than this are divided before they are drawn."""
MOST_ERROR = 0.10
"""The scale of the error ends here."""


@dataclass(frozen=True)
class SolvedLight:
    """The light of a scene's last bake, kept for as long as the file is open; see :class:`ElementMesh`."""

    mesh: ElementMesh
    metres_per_unit: float


def light_content(light: SolvedLight, title: str) -> Content:
    """The elements as bright as they are: what a bake of radiosity looks like."""
    return Content(title, (_triangles(light, light.mesh.corner, _display(light.mesh.exitance), smooth=True),))


def elements_content(light: SolvedLight) -> Content:
    """The elements with lines around them."""
    mesh = light.mesh
    shown = "" if len(mesh.error) == mesh.leaves else f", drawn as {len(mesh.error):,} coarser ones"
    title = f"{mesh.leaves:,} elements{shown}"
    return Content(title, (_triangles(light, mesh.corner, _display(mesh.exitance), smooth=True), _rims(light)))


def lux_content(light: SolvedLight, top: float = 0.0, logarithmic: bool = False) -> Content:
    """The illuminance in false colours; ``top`` lux is the upper end of the scale, 0: just above what nearly all surfaces receive."""
    mesh = light.mesh
    lux = LUMINOUS_EFFICACY * luminance(mesh.irradiance.astype(np.float64))
    area = np.linalg.norm(np.cross(mesh.corner[:, 1] - mesh.corner[:, 0], mesh.corner[:, 2] - mesh.corner[:, 0]), axis=1)
    top = top or _round_up(_weighted_quantile(lux.mean(axis=1), area, 0.98))
    scaled = _scaled(lux, top, logarithmic)
    corner, scaled = _divided(mesh.corner, scaled)
    bar = np.linspace(0.0, 1.0, 96)
    scale = Scale(_mapped(bar, SPECTRUM), _lux_ticks(top, logarithmic), "lux")
    mean = float(np.average(lux.mean(axis=1), weights=area))
    title = f"Illuminance: mean {_number(mean)} lux, largest {_number(float(lux.max(initial=0.0)))} lux"
    return Content(title, (_triangles(light, corner, _mapped(scaled, SPECTRUM), smooth=True),), scale=scale)


def error_content(light: SolvedLight) -> Content:
    """The estimated error of every element: half the steps of the light to its neighbours."""
    mesh = light.mesh
    known = np.isfinite(mesh.error)
    scaled = np.clip(np.where(known, mesh.error, 0.0) / MOST_ERROR, 0.0, 1.0)
    color = np.where(known[:, None], _mapped(scaled, DOUBT), UNKNOWN)[mesh.element]
    area = np.linalg.norm(np.cross(mesh.corner[:, 1] - mesh.corner[:, 0], mesh.corner[:, 2] - mesh.corner[:, 0]), axis=1)
    weight = np.bincount(mesh.element, area, len(mesh.error))
    half, most = (100 * _weighted_quantile(mesh.error[known], weight[known], share) for share in (0.5, 0.9))
    ticks = tuple((k / 5, f"{100 * MOST_ERROR * k / 5:.0f} %{' and more' if k == 5 else ''}") for k in range(6))
    return Content(
        f"Estimated error: half of the surface within {half:.2g} % of the mean light of its room, nine tenths within {most:.2g} %",
        (_triangles(light, mesh.corner, np.repeat(color[:, None], 3, axis=1)), _rims(light)),
        ((UNKNOWN, "surfaces of one element: nothing to compare"),) if not known.all() else (),
        Scale(_mapped(np.linspace(0.0, 1.0, 96), DOUBT), ticks, "%"),
    )


def _display(exitance: np.ndarray) -> np.ndarray:
    """Display colours of surfaces that send out ``exitance`` (.., 3), W/m2."""
    return display_encoded(exitance / math.pi)


def _scaled(lux: np.ndarray, top: float, logarithmic: bool) -> np.ndarray:
    """Places 0..1 on the scale."""
    if logarithmic:
        return np.clip(1.0 + np.log10(np.maximum(lux / top, 1e-30)) / DECADES, 0.0, 1.0)
    return np.clip(lux / top, 0.0, 1.0)


def _lux_ticks(top: float, logarithmic: bool) -> tuple[tuple[float, str], ...]:
    if logarithmic:
        values = [top * factor * 10.0**-k for k in range(DECADES) for factor in (1.0, 0.3)] + [top * 10.0**-DECADES]
        return tuple((float(_scaled(np.array(v), top, True)), f"{_number(v)}{' lux' if v == top else ''}") for v in reversed(values))
    return tuple((k / 5, f"{_number(top * k / 5)}{' lux' if k == 5 else ''}") for k in range(6))


def _number(value: float) -> str:
    """A number with two or three figures that count."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _round_up(value: float) -> float:
    """The next of 1, 2, 3, 5, 8 times a power of ten."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 3.0, 5.0, 8.0, 10.0) if step * power >= value * (1 - 1e-9))


def _weighted_quantile(value: np.ndarray, weight: np.ndarray, share: float) -> float:
    if len(value) == 0:
        return 0.0
    order = np.argsort(value, kind="stable")
    total = np.cumsum(weight[order])
    return float(value[order][min(int(np.searchsorted(total, share * total[-1])), len(value) - 1)])


def _mapped(place: np.ndarray, table: np.ndarray) -> np.ndarray:
    """(.., 3) colours at places 0..1 along a table."""
    at = np.linspace(0.0, 1.0, len(table))
    return np.stack([np.interp(place, at, table[:, k]) for k in range(3)], axis=-1)


def _divided(corner: np.ndarray, scaled: np.ndarray, rounds: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, 3, 3) with values (T, 3), those of steep values cut into four, so that mixed colours stay on the scale."""
    for _ in range(rounds):
        steep = np.ptp(scaled, axis=1) > STEEP
        if not steep.any() or len(corner) + 3 * steep.sum() > 600_000:
            break
        parts = []
        for values in (corner[steep], scaled[steep]):
            a, b, c = values[:, 0], values[:, 1], values[:, 2]
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            parts.append(np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]))
        corner, scaled = np.concatenate([corner[~steep], parts[0]]), np.concatenate([scaled[~steep], parts[1]])
    return corner, scaled


def _triangles(light: SolvedLight, corner: np.ndarray, color: np.ndarray, smooth: bool = False) -> Layer:
    rgba = np.ones((corner.shape[0] * 3, 4), np.float32)
    rgba[:, :3] = color.reshape(-1, 3)
    return Layer("light", False, (corner.reshape(-1, 3) / light.metres_per_unit).astype(np.float32), rgba, smooth=smooth)


def _rims(light: SolvedLight) -> Layer:
    """Thin strips along the sides of elements; strips and not lines, since they go with the fronts of their surfaces."""
    a, b, middle = light.mesh.outline[:, 0], light.mesh.outline[:, 1], light.mesh.outline[:, 2]
    normal = np.cross(b - a, middle - a)
    lift = LIFT * normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    inner_a, inner_b = a + LINE * (middle - a), b + LINE * (middle - b)
    corner = np.stack([a, b, inner_b, a, inner_b, inner_a], axis=1) + lift[:, None]
    color = np.broadcast_to(np.array([0.02, 0.02, 0.03]), corner.shape)
    return _triangles(light, corner.reshape(-1, 3, 3), color.reshape(-1, 3, 3))
