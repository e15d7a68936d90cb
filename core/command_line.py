# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m enfilade solve``: from a scene file to the light at its points, without Blender."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from .arguments import Parser, add_options, options_from
from .command_outputs import OutputError, check_outputs, run_command
from .console import ProgressLine, summary
from .npz_files import write_arrays
from .options import Options
from .scene import Scene

DESCRIPTION = """\
Solve the light of a scene file.

SCENE is a neutral .npz or a building .json. RESULT.npz receives E (N, 3), the irradiance in W/m2 at the scene's
points without what a surface emits itself; B (P, 3), the mean exitance of every polygon in W/m2; and seconds, the
wall time from the loaded scene to all values. REPORT.json receives the figures of the run."""


def solve_main(argv: Sequence[str], out: TextIO | None = None, err: TextIO | None = None) -> int:
    """Run ``solve`` with its arguments and return the exit code: 0, 2 after one sentence of what is wrong, 130 when interrupted.

    Nothing is written unless all is. ``out`` (standard output) receives the summary, ``err`` (standard error) the progress.
    """
    out, err = out or sys.stdout, err or sys.stderr
    line = ProgressLine(err)
    return run_command(lambda: _run(argv, line, out, err), line, err)


def _run(argv: Sequence[str], line: ProgressLine, out: TextIO, err: TextIO) -> int:
    given = _parser().parse_args(argv)
    options = options_from(given, Options)
    check_outputs([(given.out, "--out", ""), (given.report, "--report", "")], given.scene)
    if options.store and Path(options.store).exists() and not Path(options.store).is_dir():
        raise OutputError(f"{options.store}: --store names a file, give it a folder")
    scene, seconds = _load(given.scene, err)
    result, report = _solve(scene, options, line, seconds)
    line.close()
    _write(given.out, result, given.report, report)
    out.write("\n".join([*summary(report), *(f"written: {path}" for path in (given.out, given.report) if path)]) + "\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="enfilade solve", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", metavar="SCENE", type=Path, help="scene to solve, .npz or .json")
    parser.add_argument("--out", metavar="RESULT.npz", type=Path, required=True, help="file that receives the light")
    parser.add_argument("--report", metavar="REPORT.json", type=Path, help="file that receives the figures of the run")
    add_options(parser, Options, "options")
    return parser


def _load(path: Path, err: TextIO) -> tuple[Scene, float]:
    """The checked scene, its warnings said, and the seconds that this took."""
    from .scene_checks import check
    from .scene_files import load_scene

    started = time.perf_counter()
    scene, findings = check(load_scene(path))
    for finding in findings:
        err.write(f"warning: {finding.message}\n")
    return scene, time.perf_counter() - started


def _solve(scene: Scene, options: Options, line: ProgressLine, load: float) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays of RESULT.npz and the report, to which the seconds of loading and evaluation are added."""
    from .pipeline import Progress, solve

    def show(progress: Progress) -> None:
        line.show(progress.stage, progress.fraction, progress.message)

    started = time.perf_counter()
    solution = solve(scene, options, show)
    solved = time.perf_counter()
    arrays = {"E": _irradiance(scene, solution), "B": np.asarray(solution.polygon_exitance(), np.float32)}
    done = time.perf_counter()
    arrays["seconds"] = np.array(done - started)
    seconds = {**solution.report.get("seconds", {}), "load": load, "evaluate": done - solved}
    stages = ("load", "merge", "cluster", "graph", "solve", "evaluate")
    ordered = {name: seconds[name] for name in (*stages, *(s for s in seconds if s not in (*stages, "total"))) if name in seconds}
    return arrays, {**solution.report, "seconds": {**ordered, "total": load + done - started}}


def _irradiance(scene: Scene, solution: Any) -> np.ndarray:
    """(N, 3) float32 at the scene's points, (0, 3) where it has none."""
    if scene.points is None:
        return np.zeros((0, 3), np.float32)
    return np.asarray(solution.irradiance(scene.points.position, scene.points.polygon), np.float32)


def _write(result: Path, arrays: dict[str, np.ndarray], report: Path | None, figures: dict[str, Any]) -> None:
    """Write both files beside their places, then move both: a failure leaves what was there before."""
    parts: list[tuple[Path, Path]] = []
    try:
        with _part(result, parts).open("wb") as stream:
            write_arrays(stream, arrays)
        if report is not None:
            _part(report, parts).write_text(json.dumps(_plain(figures), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        for part, path in parts:
            os.replace(part, path)
    except OSError as error:
        raise OutputError(f"{error.filename or result}: cannot be written ({error.strerror})") from error
    finally:
        for part, _ in parts:
            part.unlink(missing_ok=True)


def _part(path: Path, parts: list[tuple[Path, Path]]) -> Path:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    parts.append((part, path))
    return part


def _plain(value: Any) -> Any:
    """Figures as JSON knows them: NumPy numbers and arrays as plain ones, null for what is not finite."""
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
