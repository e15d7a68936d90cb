"""Luminous intensity of a luminaire over all directions: interpolation, total flux, radiant intensity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .photometry import LUMINOUS_EFFICACY

POLE_DOWN = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Axes of half-planes that turn about the plumb line: C-planes of the CIE, Type C of IES LM-63."""
POLE_DOWN.setflags(write=False)

SLACK = 1e-6
"""Degrees by which a direction may miss the outermost angle and still have its intensity: the rounding of a rotation."""


@dataclass(frozen=True)
class Distribution:
    """Luminous intensity on a grid of polar angles, bilinear in the angles in between, dark outside of the grid.

    In the frame of the luminaire z is up: it hangs as it was measured, a downlight shines along -z.

    azimuth : (H,) float64, degrees, rising, 2 or more; when they span 360 the last half-plane is the first once more
    colatitude : (V,) float64, degrees from the pole, 0..180, rising, 2 or more
    candela : (H, V) float64, cd, symmetric parts written out
    axes : (3, 3) float64, rows are unit vectors in the frame of the luminaire: the pole (colatitude 0), and where
        azimuth is 0 and 90 on the equator
    """

    azimuth: np.ndarray
    colatitude: np.ndarray
    candela: np.ndarray
    axes: np.ndarray

    def intensity(self, directions: np.ndarray) -> np.ndarray:
        """(n,) float64 cd towards (n, 3) directions from the luminaire, in its frame, of any length above 0."""
        along = np.asarray(directions, np.float64) @ self.axes.T
        colatitude = np.degrees(np.arctan2(np.hypot(along[:, 1], along[:, 2]), along[:, 0]))
        azimuth = np.degrees(np.arctan2(along[:, 2], along[:, 1]))
        azimuth = self.azimuth[0] + np.mod(azimuth - self.azimuth[0] + SLACK, 360.0) - SLACK
        i, s, inside = _cell(self.azimuth, azimuth)
        j, t, lit = _cell(self.colatitude, colatitude)
        low = (1 - t) * self.candela[i, j] + t * self.candela[i, j + 1]
        high = (1 - t) * self.candela[i + 1, j] + t * self.candela[i + 1, j + 1]
        return np.where(inside & lit, (1 - s) * low + s * high, 0.0)

    def radiant_intensity(self, directions: np.ndarray, efficacy: float = LUMINOUS_EFFICACY) -> np.ndarray:
        """(n,) float64 W/sr towards (n, 3) directions: cd over the luminous ``efficacy`` of the light, lm/W."""
        return self.intensity(directions) / efficacy

    def flux(self) -> float:
        """Total luminous flux, lm: the exact integral over all directions of what :meth:`intensity` interpolates."""
        return float(_azimuth_weights(self.azimuth) @ self.candela @ _colatitude_weights(self.colatitude))


def mirrored(angle: np.ndarray, candela: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-planes and their images in the last of them: (2 H - 1,) rising angles and (2 H - 1, V) intensities.

    angle : (H,) degrees, rising;  candela : (H, V)
    """
    return np.concatenate((angle, 2 * angle[-1] - angle[-2::-1])), np.concatenate((candela, candela[-2::-1]))


def closed(angle: np.ndarray, candela: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-planes over a whole turn from 0, of which the last is the first once more, whether or not it is given.

    angle : (H,) degrees, rising from 0 to at most 360;  candela : (H, V)
    """
    if angle[-1] < 360:
        return np.append(angle, 360.0), np.concatenate((candela, candela[:1]))
    return angle, np.concatenate((candela[:-1], candela[:1]))


def _cell(knots: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Interval of every value, where in it (0..1), and whether the knots reach that far."""
    at = np.clip(np.searchsorted(knots, value, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((value - knots[at]) / (knots[at + 1] - knots[at]), 0.0, 1.0)
    return at, share, (value >= knots[0] - SLACK) & (value <= knots[-1] + SLACK)


def _azimuth_weights(azimuth: np.ndarray) -> np.ndarray:
    """(H,) integrals of the hat functions of the azimuths, rad."""
    half = np.radians(np.diff(azimuth)) / 2
    return np.concatenate((half, [0.0])) + np.concatenate(([0.0], half))


def _colatitude_weights(colatitude: np.ndarray) -> np.ndarray:
    """(V,) integrals of the hat functions of the colatitudes times their sine.

    On an interval of centre m and half width d the rising half of a hat gives cos m (sinc d - cos d) + sin m sin d, the
    falling half the same with the first term negated.
    """
    angle = np.radians(colatitude)
    centre, half = (angle[1:] + angle[:-1]) / 2, np.diff(angle) / 2
    even, odd = np.sin(centre) * np.sin(half), np.cos(centre) * (np.sinc(half / np.pi) - np.cos(half))
    return np.concatenate((even - odd, [0.0])) + np.concatenate(([0.0], even + odd))
