# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m enfilade``: solve scene files without Blender, or bake .blend files with its Python module."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence

HELP = """\
usage: enfilade solve SCENE --out RESULT.npz [--report REPORT.json] [options]
       enfilade bake FILE.blend --out BAKED.blend [--picture OUT.png] [options]
       enfilade light FILE --out LIGHT.csv [--daylight] [options]
       enfilade tables --out FOLDER [--scale 1/8]

Diffuse global illumination for buildings of rooms and portals.

  solve      the light at the points of a scene file (.npz or .json); needs NumPy only
  bake       the light of a .blend file, as vertex colours or textures; needs Blender's Python module
  light      the table of the light of every room of a scene file or a .blend file, in lux or as daylight factors
  tables     the tables of the paper that the method comes from, for scenes of the same size; needs the sources

enfilade solve --help, enfilade bake --help and enfilade light --help list the options; enfilade --version says which version this is.
"""

NO_BPY = "enfilade: bake needs Blender's Python module, which is not installed here: pip install bpy (Python 3.11 for Blender 4.2 to 5.0)"

NO_SOURCES = "enfilade: tables solves scenes that come with the sources only: run it in a checkout of the repository"


def main(argv: Sequence[str]) -> int:
    """Run a command and return its exit code; 2 after one sentence of what is wrong."""
    command = argv[0] if argv else ""
    if command == "solve":
        from .core.command_line import solve_main

        return solve_main(argv[1:])
    if command == "bake":
        if importlib.util.find_spec("bpy") is None:
            sys.stderr.write(NO_BPY + "\n")
            return 2
        from .addon.command_line import bake_main

        return bake_main(list(argv[1:]))
    if command == "light":
        from .core.light_command import light_main

        if importlib.util.find_spec("bpy") is None:
            return light_main(argv[1:])
        # Blender is slow to import, and only a .blend file needs it.
        addon = f"{__package__}.addon.command_line"
        return light_main(argv[1:], open_blend=lambda path: importlib.import_module(addon).open_blend(path))
    if command == "tables":
        if importlib.util.find_spec("enfilade.docs.tables") is None:
            sys.stderr.write(NO_SOURCES + "\n")
            return 2
        from .docs.tables import tables_main

        return tables_main(argv[1:])
    if command in ("-h", "--help"):
        sys.stdout.write(HELP)
        return 0
    if command == "--version":
        sys.stdout.write(f"enfilade {version()}\n")
        return 0
    sys.stderr.write(f"enfilade: {command!r} is not a command, the commands are solve, bake, light and tables\n" if command else HELP)
    return 2


def version() -> str:
    """The version, which stands in the manifest."""
    import tomllib
    from pathlib import Path

    return tomllib.loads((Path(__file__).resolve().parent / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]


def console() -> None:
    """Entry point of the ``enfilade`` command."""
    sys.exit(main(sys.argv[1:]))


if __name__ == "__main__":
    console()
