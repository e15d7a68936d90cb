"""How far the light is off on the bench scenes in tests/data/bench, as a table: ``python -m enfilade.docs.measure [QUALITY ...]``."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from ..core.options import Options
from ..core.pipeline import solve
from ..core.scene_files import load_scene

BENCH = Path(__file__).resolve().parent.parent / "tests" / "data" / "bench"
HEAD = "| scene | quality | elements | relative RMSE | in rooms with no lamp | noise of the reference | energy accounted for | seconds |"


def errors(scene: str, light: np.ndarray) -> tuple[float, float, float]:
    """Root mean square error over mean irradiance, by area: at all points, in rooms with no lamp, and of the reference itself."""
    data, reference = np.load(BENCH / f"{scene}.npz"), np.load(BENCH / f"{scene}.ref.npz")
    exact, noise, area = reference["E"].astype(float), reference["se"].astype(float), data["pts_area"].astype(float)
    unlit = reference["Edir"].sum(1) <= 1e-3 * exact.sum(1)
    dark = np.isin(data["room"][data["pts_poly"]], data["indirect_rooms"]) & unlit

    def relative(difference: np.ndarray, where: np.ndarray) -> float:
        weight = area[where, None] / area[where].sum()
        return float(np.sqrt((weight * difference[where] ** 2).sum(0).mean()) / (weight * exact[where]).sum(0).mean())

    everywhere = np.ones(len(area), bool)
    return relative(light - exact, everywhere), relative(light - exact, dark) if dark.any() else float("nan"), relative(noise, everywhere)


def row(name: str, quality: str) -> str:
    """One line of the table."""
    scene = load_scene(BENCH / f"{name}.npz")
    started = time.perf_counter()
    solution = solve(scene, Options(quality=quality))
    light = solution.irradiance(scene.points.position, scene.points.polygon)
    seconds = time.perf_counter() - started
    all_, dark, noise = errors(name, light)
    energy = solution.report["energy"]
    balance = (energy["absorbed"] + energy["escaped"]) / energy["emitted"]
    cells = [name, quality, f"{solution.report['elements']:,}", f"{all_:.2%}", "" if np.isnan(dark) else f"{dark:.2%}", f"{noise:.2%}"]
    return "| " + " | ".join([*cells, f"{balance:.2%}", f"{seconds:.1f}"]) + " |"


def main(qualities: list[str]) -> None:
    print(HEAD + "\n" + "|---" * HEAD.count(" | ") + "|---|")
    for quality in qualities:
        for path in sorted(BENCH.glob("*.ref.npz")):
            print(row(path.name.removesuffix(".ref.npz"), quality), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["good"])
