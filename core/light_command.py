# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m enfilade light``: the table of the light of every room, from a scene file or a .blend file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

from .arguments import Parser, add_options, options_from
from .command_outputs import OutputError, check_outputs, run_command, write_text
from .console import ProgressLine
from .options import Options
from .scene import Scene

DESCRIPTION = """\
Write the light of every room as a table of comma-separated values.

FILE is a scene (.npz or .json) or, with Blender's Python module, a .blend file, whose own options hold where none are
given. The table has average, minimum, maximum and uniformity in lux on floor, walls, ceiling, other surfaces and a work
plane of every room, or with --daylight the daylight factor in per cent under the CIE overcast sky, without lamps."""

Opened = tuple[Scene, Options, Sequence[str]]
"""A scene, the options that hold where none are given, and warnings."""


def light_main(
    argv: Sequence[str], out: TextIO | None = None, err: TextIO | None = None, open_blend: Callable[[Path], Opened] | None = None
) -> int:
    """Run ``light`` with its arguments and return the exit code: 0, 2 after one sentence of what is wrong, 130 when interrupted.

    Nothing is written unless all is. ``open_blend`` reads a .blend file, None where Blender is not there.
    """
    out, err = out or sys.stdout, err or sys.stderr
    line = ProgressLine(err)
    return run_command(lambda: _run(argv, line, out, err, open_blend), line, err)


def _run(argv: Sequence[str], line: ProgressLine, out: TextIO, err: TextIO, open_blend: Callable[[Path], Opened] | None) -> int:
    given = _parser().parse_args(list(argv))
    for name in ("work_plane", "border"):
        value = getattr(given, name)
        if not 0 <= value <= 100:
            raise OutputError(f"--{name.replace('_', '-')} is {value:g}: give metres between 0 and 100")
    check_outputs([(given.out, "--out", ".csv")], given.file)
    scene, saved, warnings = _open(given.file, open_blend)
    for warning in warnings:
        err.write(f"warning: {warning}\n")
    text, rows = _table(scene, options_from(given, Options, saved), given, line)
    line.close()
    write_text(given.out, text)
    out.write(f"{rows} rows for {scene.room_count} rooms\nwritten: {given.out}\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="enfilade light", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", metavar="FILE", type=Path, help="scene, .npz or .json, or .blend")
    parser.add_argument("--out", metavar="LIGHT.csv", type=Path, required=True, help="file that receives the table")
    parser.add_argument("--daylight", action="store_true", help="daylight factors instead of lux")
    parser.add_argument("--work-plane", metavar="METRES", type=float, default=0.8, help="height of the work plane over the floor [0.8]")
    parser.add_argument("--border", metavar="METRES", type=float, default=0.5, help="strip along the walls that it leaves out [0.5]")
    add_options(parser, Options, "how the scene is solved")
    return parser


def _open(path: Path, open_blend: Callable[[Path], Opened] | None) -> Opened:
    if path.suffix.lower() == ".blend":
        if open_blend is None:
            raise OutputError(f"{path}: this needs Blender's Python module, which is not installed here: pip install bpy")
        return open_blend(path)
    from .scene_checks import check
    from .scene_files import load_scene

    scene, findings = check(load_scene(path))
    return scene, Options(), [finding.message for finding in findings]


def _table(scene: Scene, options: Options, given: argparse.Namespace, line: ProgressLine) -> tuple[str, int]:
    """The table as text, and its rows."""
    from .light_report import as_csv
    from .light_tables import daylight, illuminance

    steps = (daylight if given.daylight else illuminance)(scene, options, given.work_plane, given.border)
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            return as_csv(end.value, "%" if given.daylight else "lx"), len(end.value)
        line.show(step.stage, step.fraction, step.message)
