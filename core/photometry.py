"""Photometric quantities of linear RGB light."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

LUMINOUS_EFFICACY = 179.0
"""Lumens per watt of equal-energy white light over the visible range, the convention of lighting simulation (Radiance)."""

REC709_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Share of linear red, green and blue in the luminance (ITU-R BT.709)."""

QUANTITIES = ("radiosity", "lighting", "lux")

PARTS = {"lux": "coloured_lux"}
"""What is stored of a light group where that differs from what is stored of all light; see :func:`recombined`."""


def luminance(rgb: np.ndarray) -> np.ndarray:
    """(...,) luminance of (..., 3) linear RGB, in the unit of its argument."""
    return np.asarray(rgb) @ np.asarray(REC709_LUMINANCE, dtype=np.asarray(rgb).dtype)


def stored_quantity(quantity: str, irradiance: np.ndarray, reflectance: np.ndarray, emission: np.ndarray) -> np.ndarray:
    """What a bake stores of the irradiance E, for N points.

    quantity : ``"radiosity"`` B/pi with B = emission + reflectance * E, the radiance of the lit surface, equal to an
        emission shader of strength 1; ``"lighting"`` E/pi, the same of a white surface; ``"lux"`` the illuminance;
        ``"coloured_lux"`` that of each channel as if it were all three, whose luminance is the illuminance
    irradiance, reflectance, emission : (N, 3), W/m2, 0..1 and W/m2

    Returns (N, 3) float32: W/(m2 sr) for the first two, lux for the last, in all three channels the same for ``"lux"``. Raises ValueError
    when the quantity is none of these.
    """
    if quantity == "radiosity":
        out = (emission + reflectance * irradiance) / math.pi
    elif quantity == "lighting":
        out = irradiance / math.pi
    elif quantity == "lux":
        lux = LUMINOUS_EFFICACY * luminance(np.asarray(irradiance, np.float64))
        out = np.repeat(lux[:, None], 3, axis=1)
    elif quantity == "coloured_lux":
        out = LUMINOUS_EFFICACY * irradiance
    else:
        raise ValueError(f"quantity {quantity!r} is not one of {', '.join(QUANTITIES)}")
    return np.asarray(out, np.float32)


def recombined(quantity: str, parts: Iterable[np.ndarray], factors: Iterable[np.ndarray]) -> np.ndarray:
    """What a bake stores of several light groups together, from what it stores of each (as ``PARTS`` says).

    parts : (..., 3 or more) float32 each, what follows the three channels is left as in the first;  factors : (3,) each, strength
    times colour. Returns an array of the same shape. Light is linear: so no group needs to be solved again.
    """
    out = None
    for part, factor in zip(parts, factors, strict=True):
        if out is None:
            out = part.copy()
            out[..., :3] *= np.asarray(factor, np.float32)
        else:
            out[..., :3] += part[..., :3] * np.asarray(factor, np.float32)
    if out is None:
        raise ValueError("there is no light group to be recombined")
    if quantity == "lux":
        out[..., :3] = luminance(out[..., :3])[..., None]
    return out
