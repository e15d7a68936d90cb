# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: ``python -m enfilade bake ...`` and ``blender --background --command enfilade ...``, tables of light too."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import bpy

from ..core.arguments import Parser, add_options, options_from
from ..core.command_outputs import OutputError, check_outputs, run_command
from ..core.console import ProgressLine, summary
from ..core.light_command import Opened, light_main
from ..core.options import BakeOptions, Options
from ..core.scene import SceneError
from . import job, picture
from .export_gltf import export
from .extract import extract

COMMAND = "enfilade"

DESCRIPTION = """\
Bake the light of a .blend file.

The collections Rooms and Portals of the file are taken, or those that --rooms and --portals name. Options that are not
given are those saved in the file. FILE.blend itself is only changed when --out names it."""


def bake_main(argv: Sequence[str], out: TextIO | None = None, err: TextIO | None = None) -> int:
    """Bake with these arguments and return the exit code: 0, 2 after one sentence of what is wrong, 130 when interrupted.

    Nothing is written unless the bake succeeds. ``out`` (standard output) receives the summary, ``err`` (standard error)
    warnings and progress.
    """
    out, err = out or sys.stdout, err or sys.stderr
    line = ProgressLine(err)

    def work() -> int:
        given = _parser().parse_args(list(argv))
        _check_files(given)
        return _bake(given, line, out, err)

    return run_command(work, line, err)


def open_blend(path: Path) -> Opened:
    """What :func:`light_main` needs of a .blend file."""
    if not path.exists():
        raise OutputError(f"{path}: there is no such file")
    _open(path)
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    options, _ = job.settings(bpy.context.scene)
    extraction = extract(bpy.context)
    return extraction.scene, options, extraction.warnings


def blender_main(argv: Sequence[str]) -> int:
    """The command of Blender's own command line: a bake, or with ``light`` as its first word the table of the light of every room."""
    return light_main(argv[1:], open_blend=open_blend) if list(argv[:1]) == ["light"] else bake_main(argv)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="enfilade bake", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", metavar="FILE.blend", type=Path, help="file to bake")
    parser.add_argument("--out", metavar="BAKED.blend", type=Path, help="file that receives the baked scene")
    parser.add_argument("--picture", metavar="OUT.png", type=Path, help="picture of the bake, by the scene's camera or from above")
    parser.add_argument("--gltf", metavar="OUT.glb", type=Path, help="file that receives the baked meshes for web viewers")
    parser.add_argument(
        "--exposure", metavar="STOPS", type=float, default=0.0, help="with --gltf: stops by which the light is made brighter"
    )
    parser.add_argument("--report", metavar="REPORT.json", type=Path, help="file that receives the figures of the run")
    parser.add_argument("--rooms", metavar="NAME", help="collection whose children are the rooms [that of the file, or Rooms]")
    parser.add_argument("--portals", metavar="NAME", help="collection of the portals [that of the file, or Portals]")
    parser.add_argument(
        "--only", metavar="ROOM", action="append", default=[], help="give new light to this room alone, lit by all; may be given again"
    )
    add_options(parser, Options, "how the scene is solved")
    add_options(parser, BakeOptions, "where the light goes")
    return parser


def _check_files(given: argparse.Namespace) -> None:
    """Raise OutputError before any work is done for what cannot be read or written."""
    source: Path = given.file
    if not source.exists():
        raise OutputError(f"{source}: there is no such file")
    if source.is_dir() or source.suffix.lower() != ".blend":
        raise OutputError(f"{source}: this is not a .blend file")
    if given.out is None and given.picture is None and given.gltf is None:
        raise OutputError("nothing would be written: give --out BAKED.blend, --picture OUT.png, --gltf OUT.glb or several of them")
    suffixes = (("out", ".blend"), ("picture", ".png"), ("gltf", ".glb"), ("report", ""))
    check_outputs([(getattr(given, name), f"--{name}", suffix) for name, suffix in suffixes])


def _bake(given: argparse.Namespace, line: ProgressLine, out: TextIO, err: TextIO) -> int:
    started = time.perf_counter()
    _open(given.file)
    context = bpy.context
    scene = context.scene
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for which in ("rooms", "portals"):
        name = getattr(given, which)
        if name is not None:
            setattr(scene.enfilade, which, _collection(scene, which, name))
    options, bake = job.settings(scene)
    options, bake = options_from(given, Options, options), options_from(given, BakeOptions, bake)
    line.show("read", 0.0, given.file.name)
    reading = job.read(context, options, bake, given.only)
    loaded = time.perf_counter() - started
    line.close()
    for warning in reading.warnings:
        err.write(f"warning: {warning}\n")

    baked = job.solve_all(reading, lambda step: line.show(step.stage, step.fraction, step.message))
    line.close()
    for warning in baked.warnings:
        err.write(f"warning: {warning}\n")
    written = job.write(context, reading, baked)
    figures = {**baked.report, "seconds": {"load": loaded, **baked.report["seconds"]}}
    figures["seconds"]["total"] += loaded
    job.remember(scene, reading, baked, written)
    files = []
    if given.out is not None:
        _save(given.out)
        files.append(given.out)
    if given.picture is not None:
        with _quiet():
            picture.render(context, reading, baked, written, given.picture.resolve())
        files.append(given.picture)
    if given.gltf is not None:
        for warning in export(context, given.gltf, given.exposure).warnings:
            err.write(f"warning: {warning}\n")
        files.append(given.gltf)
    if given.report is not None:
        given.report.write_text(json.dumps(figures, indent=2, default=float) + "\n", encoding="utf-8")
        files.append(given.report)
    what = f"{len(written.objects)} objects carry the light" if bake.target == "vertex" else f"{len(written.images)} lightmaps"
    out.write("\n".join([*summary(figures), what, *(f"written: {path}" for path in files)]) + "\n")
    out.flush()
    return 0


def _open(path: Path) -> None:
    """Open a file without running its scripts. Raises OutputError when Blender cannot read it."""
    if not hasattr(bpy.types.Scene, "enfilade"):
        from . import register

        register()
    try:
        with _quiet():
            bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        reason = str(error).strip().removeprefix("Error: ").splitlines()[0]
        raise OutputError(f"{path}: Blender {bpy.app.version_string} cannot open this file ({reason})") from error


def _collection(scene: bpy.types.Scene, which: str, name: str) -> bpy.types.Collection:
    found = next((c for c in scene.collection.children_recursive if c.name == name), None)
    if found is None:
        raise SceneError(f"the file has no collection '{name}' to take as {which}: see the names in its outliner")
    return found


def _save(path: Path) -> None:
    """Save the open file beside its place and move it there: a failure leaves what was there before."""
    part = path.resolve().with_name(f".{path.stem}.{os.getpid()}.blend")
    try:
        with _quiet():
            bpy.ops.wm.save_as_mainfile(filepath=str(part), compress=True, copy=True, relative_remap=True)
        os.replace(part, path)
    except RuntimeError as error:
        raise OutputError(f"{path}: the file could not be saved ({str(error).strip().splitlines()[0]})") from error
    finally:
        part.unlink(missing_ok=True)


class _quiet:
    """Within, what Blender itself says on standard output is thrown away; errors still come as exceptions."""

    def __enter__(self) -> None:
        sys.stdout.flush()
        self._kept = os.dup(1)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)

    def __exit__(self, *_: object) -> None:
        os.dup2(self._kept, 1)
        os.close(self._kept)


_handle = None


def register() -> None:
    """Make ``blender --background --command enfilade`` known."""
    global _handle
    _handle = bpy.utils.register_cli_command(COMMAND, blender_main)


def unregister() -> None:
    global _handle
    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None
