"""Photometric quantities of linear RGB light."""

from __future__ import annotations

import math

import numpy as np

LUMINOUS_EFFICACY = 179.0
"""Lumens per watt of equal-energy white light over the visible range, the convention of lighting simulation (Radiance)."""

REC709_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Share of linear red, green and blue in the luminance (ITU-R BT.709)."""

QUANTITIES = ("radiosity", "lighting", "lux")


def luminance(rgb: np.ndarray) -> np.ndarray:
    """(...,) luminance of (..., 3) linear RGB, in the unit of its argument."""
    return np.asarray(rgb) @ np.asarray(REC709_LUMINANCE, dtype=np.asarray(rgb).dtype)


def stored_quantity(quantity: str, irradiance: np.ndarray, reflectance: np.ndarray, emission: np.ndarray) -> np.ndarray:
    """What a bake stores of the irradiance E, for N points.

    quantity : ``"radiosity"`` B/pi with B = emission + reflectance * E, the radiance of the lit surface, equal to an
        emission shader of strength 1; ``"lighting"`` E/pi, the same of a white surface; ``"lux"`` the illuminance
    irradiance, reflectance, emission : (N, 3), W/m2, 0..1 and W/m2

    Returns (N, 3) float32: W/(m2 sr) for the first two, lux in all three channels for the last. Raises ValueError
    when the quantity is none of these.
    """
    if quantity == "radiosity":
        out = (emission + reflectance * irradiance) / math.pi
    elif quantity == "lighting":
        out = irradiance / math.pi
    elif quantity == "lux":
        lux = LUMINOUS_EFFICACY * luminance(np.asarray(irradiance, np.float64))
        out = np.repeat(lux[:, None], 3, axis=1)
    else:
        raise ValueError(f"quantity {quantity!r} is not one of {', '.join(QUANTITIES)}")
    return np.asarray(out, np.float32)
