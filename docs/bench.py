"""The bench scenes of tests/data/bench: a scene, reference light at points of it, and how far a result is off."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.scene import Scene
from ..core.scene_files import load_scene

FOLDER = Path(__file__).resolve().parent.parent / "tests" / "data" / "bench"
NAMES = ("cornell", "two_rooms", "office", "building", "furnace", "hard")
"""In the order of the tables."""


class Bench:
    """A bench scene with N points.

    light, noise : (N, 3) float64 W/m2, the reference and its standard error;  area : (N,) m2 that each point stands for
    dark : (N,) bool, points of rooms without a lit lamp that no lamp shines on straight
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.scene: Scene = load_scene(FOLDER / f"{name}.npz")
        with np.load(FOLDER / f"{name}.npz") as data, np.load(FOLDER / f"{name}.ref.npz") as reference:
            self.light, self.noise = reference["E"].astype(float), reference["se"].astype(float)
            self.area = data["pts_area"].astype(float)
            unlit = reference["Edir"].sum(1) <= 1e-3 * self.light.sum(1)
            self.dark = np.isin(data["room"][data["pts_poly"]], data["indirect_rooms"]) & unlit

    def score(self, found: np.ndarray) -> dict[str, float | None]:
        """Errors of irradiance ``found`` (N, 3), all channels together, every point weighed by its area.

        rmse : root mean square over the mean irradiance;  p95 : 95th percentile of the error of a value over that value, or over
        1 % of the mean where it is less than that;  bias : mean over the reference's mean, less 1;  noise : the rmse that a
        perfect answer would have;  dark_rmse, dark_p95, dark_noise : the same in rooms with no lamp (None without such rooms)
        """
        everywhere = np.ones(len(self.area), bool)
        out = {
            "rmse": self._rmse(found - self.light, everywhere),
            "p95": self._p95(found, everywhere),
            "bias": float(self.area @ found.sum(1) / (self.area @ self.light.sum(1)) - 1),
            "noise": self._rmse(self.noise, everywhere),
            "dark_rmse": None,
            "dark_p95": None,
            "dark_noise": None,
        }
        if self.dark.any():
            out["dark_rmse"] = self._rmse(found - self.light, self.dark)
            out["dark_p95"] = self._p95(found, self.dark)
            out["dark_noise"] = self._rmse(self.noise, self.dark)
        return out

    def _mean(self, where: np.ndarray) -> np.ndarray:
        """(3,) mean reference irradiance, W/m2."""
        return self.area[where] @ self.light[where] / self.area[where].sum()

    def _rmse(self, error: np.ndarray, where: np.ndarray) -> float:
        weight = self.area[where, None] / self.area[where].sum()
        return float(np.sqrt((weight * error[where] ** 2).sum(0).mean()) / self._mean(where).mean())

    def _p95(self, found: np.ndarray, where: np.ndarray) -> float:
        error = np.abs(found - self.light)[where] / np.maximum(self.light[where], 0.01 * self._mean(where))
        order = np.argsort(error, axis=None)
        share = np.cumsum(np.repeat(self.area[where], 3)[order])
        return float(error.reshape(-1)[order][np.searchsorted(share, 0.95 * share[-1])])
