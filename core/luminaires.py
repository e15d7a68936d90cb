"""A luminaire as its photometric file describes it, and its light as that of a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .luminous_intensity import Distribution


@dataclass(frozen=True)
class Luminaire:
    """What a photometric file says of a luminaire.

    name : what the file calls it, may be empty
    distribution : luminous intensity with all factors of the file applied, except that of tilting
    size : (3,) float64, extent in metres of the luminous opening along x, y and z of the luminaire; zeros for a point
    watts : input power of lamps and gear, W; 0 when the file does not say
    tilt_angle, tilt_factor : (T,) float64, degrees and factors by which lamps change their light when the luminaire is
        tilted out of the position in which it was measured; empty when they do not
    """

    name: str
    distribution: Distribution
    size: np.ndarray
    watts: float
    tilt_angle: np.ndarray
    tilt_factor: np.ndarray

    def factor_when_tilted(self, degrees: float) -> float:
        """Factor of all intensities when the luminaire is tilted by an angle, linear between those of the file."""
        return float(np.interp(degrees, self.tilt_angle, self.tilt_factor)) if len(self.tilt_angle) else 1.0


def illuminance(
    distribution: Distribution, position: np.ndarray, rotation: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Illuminance of unobstructed points by a point luminaire, lx: E = I cos / d2, 0 behind and within a micrometre.

    position : (3,) metres;  rotation : (3, 3), columns are the axes of the luminaire in the frame of the points
    points : (n, 3) metres;  normals : (n, 3) unit

    Returns (n,) float64.
    """
    away = np.asarray(points, np.float64) - position
    square = np.einsum("ij,ij->i", away, away)
    facing = np.maximum(-np.einsum("ij,ij->i", away, normals), 0.0)
    near = square < 1e-12
    apart = np.where(near, 1.0, square)
    # cos / d2 is facing / d3; rows times a matrix of column vectors are coordinates along these.
    return np.where(near, 0.0, distribution.intensity(away @ rotation) * facing / (apart * np.sqrt(apart)))
