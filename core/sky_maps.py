"""Images of the sky made fit for diffuse light: as few texels as it needs, and what is as bright as a sun as suns of its own."""

from __future__ import annotations

import numpy as np

from .lamps import Sky, Suns, no_suns

HEIGHT = 64
"""Rows of a sky, under three degrees each; twice as many columns."""
FINE = 4
"""Rows that the image is first reduced to, for each row of the sky."""
BRIGHT = 30.0
"""What is this many times as bright as the mean is a sun."""
SUN_REACH = np.radians(4.0)
"""What is within this of the brightest place belongs to the same sun."""
MOST_SUNS = 16


def sky_of_image(name: str, radiance: np.ndarray, turn: np.ndarray) -> tuple[Sky, Suns]:
    """A sky from an equirectangular image (h, w, 3), W/(m2 sr), as :class:`Sky` has it, and the suns in it.

    turn : (3, 3) rotation from directions of the world to those of the image
    The flux of the image is kept: a sun has what its texels have beyond the brightness around it.
    """
    image = _reduced(np.maximum(radiance, 0), FINE * HEIGHT)
    rows, columns = image.shape[:2]
    direction, solid = _texels(rows, columns)
    light = image.reshape(-1, 3)
    limit = BRIGHT * float((light.mean(1) * solid).sum() / solid.sum())
    light, suns = _without_suns(name, light, direction, solid, limit, turn)
    height = min(HEIGHT, rows)
    places, _ = _texels(FINE * height, 2 * FINE * height)
    seen = _nearest(light.reshape(rows, columns, 3), places @ turn.T)
    sky = seen.reshape(height, FINE, 2 * height, FINE, 3).mean((1, 3))
    return Sky(name, sky.astype(np.float32)), suns


def cie_overcast(zenith: float, ground: float, name: str = "CIE overcast sky") -> Sky:
    """The CIE standard overcast sky (type 1 of ISO 15469 in the form of Moon and Spencer): L = Lz (1 + 2 sin h) / 3.

    zenith : W/(m2 sr) at the zenith;  ground : reflectance of the ground, which shines as a diffuse plane under this sky
    """
    sine = np.sin(np.pi * ((np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5))
    below = ground * overcast_irradiance(zenith) / np.pi
    rows = np.where(sine > 0, zenith * (1 + 2 * sine) / 3, below)
    return Sky(name, np.repeat(rows[:, None, None], 3, axis=2).astype(np.float32))


def overcast_irradiance(zenith: float) -> float:
    """W/m2 on open level ground under the CIE overcast sky of radiance ``zenith`` at the zenith: 7 pi / 9 of it."""
    return 7 * np.pi / 9 * zenith


def _texels(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (rows * columns, 3) of the middles of equirectangular texels, and their solid angles, sr."""
    turn = 2 * np.pi * (0.5 - (np.arange(columns) + 0.5) / columns)
    tilt = np.pi * ((np.arange(rows) + 0.5) / rows - 0.5)
    edges = np.sin(np.pi * (np.arange(rows + 1) / rows - 0.5))
    flat = np.cos(tilt)[:, None]
    direction = np.stack([flat * np.cos(turn), flat * np.sin(turn), np.repeat(np.sin(tilt)[:, None], columns, 1)], axis=2)
    return direction.reshape(-1, 3), np.repeat(np.diff(edges) * 2 * np.pi / columns, columns)


def _reduced(image: np.ndarray, rows: int) -> np.ndarray:
    """The image averaged over whole blocks to at most ``rows`` rows and twice as many columns."""
    for axis, most in ((0, rows), (1, 2 * rows)):
        step = -(-image.shape[axis] // most)
        if step > 1:
            starts = np.arange(0, image.shape[axis], step)
            count = np.diff(np.append(starts, image.shape[axis]))
            image = np.add.reduceat(image, starts, axis) / (count[:, None, None] if axis == 0 else count[:, None])
    return image


def _nearest(image: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 3) texels of an image in directions (n, 3)."""
    rows, columns = image.shape[:2]
    x, y, z = directions.T
    column = np.floor((0.5 - np.arctan2(y, x) / (2 * np.pi)) * columns).astype(np.int64) % columns
    row = np.floor((0.5 + np.arctan2(z, np.hypot(x, y)) / np.pi) * rows).astype(np.int64)
    return image[np.clip(row, 0, rows - 1), column]


def _without_suns(name, light, direction, solid, limit, turn) -> tuple[np.ndarray, Suns]:
    """Light (n, 3) of texels cut to ``limit``, and as many suns as hold what was cut off."""
    mean = light.mean(1)
    excess = light * (1 - limit / np.maximum(mean, max(limit, 1e-300)))[:, None]
    if not limit > 0 or not excess.any():
        return light, no_suns()
    rest = light - excess
    flux = excess * solid[:, None]
    left = flux.mean(1)
    toward, irradiance, angle = [], [], []
    for _ in range(MOST_SUNS):
        if left.max() <= 1e-3 * flux.mean(1).sum():
            break
        middle = direction[left.argmax()]
        near = np.flatnonzero((direction @ middle > np.cos(SUN_REACH)) & (left > 0))
        mean = left[near] @ direction[near]
        toward.append(turn.T @ mean / np.linalg.norm(mean))
        irradiance.append(flux[near].sum(0))
        # A sun of even brightness would be as large as the texels that hold most of its light.
        angle.append(2 * np.sqrt(solid[near].sum() * (left[near].sum() ** 2 / (left[near] ** 2).sum() / len(near)) / np.pi))
        left[near] = 0
    names = tuple(f"{name}, sun {k + 1}" for k in range(len(toward)))
    # What is left over beyond the last sun stays in the sky.
    rest += np.where((left > 0)[:, None], excess, 0)
    return rest, Suns(names, np.array(toward).reshape(-1, 3), np.array(irradiance).reshape(-1, 3), np.array(angle))
