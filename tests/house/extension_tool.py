"""Blender's own extension tool, as it ships in the bpy wheel: ``python extension_tool.py validate|build ...``.

It is plain Python, so bpy itself is not imported and any wheel that is installed can be used.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def tool() -> list[str]:
    """The command that runs the tool, and nothing of its arguments."""
    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("bpy is not installed: pip install bpy")
    return [sys.executable, str(next(Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")))]


def tags() -> list[str]:
    """Arguments that let the tool check the manifest's tags."""
    return ["--valid-tags", str(Path(tool()[1]).parents[3] / "modules" / "_bpy_internal" / "extensions" / "tags.py")]


def validate(what: Path) -> subprocess.CompletedProcess:
    """Check a source folder or a zip."""
    return subprocess.run([*tool(), "validate", *tags(), str(what)], capture_output=True, text=True, check=False)


def whole_blender() -> list[str]:
    """The command of a Blender that is more than its Python module, empty where there is none.

    It is ``blender``, run by what ENFILADE_BLENDER_SHELL names (see tests/window/drive.py) or found on the path.
    """
    shell = shlex.split(os.environ.get("ENFILADE_BLENDER_SHELL", ""))
    return [*shell, "blender"] if shell or shutil.which("blender") else []


def build(folder: Path, source: Path = ROOT) -> Path:
    """Build the zip into a folder, which is made where it is missing, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [*tool(), "build", *tags(), "--source-dir", str(source), "--output-dir", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    return max(folder.glob("*.zip"), key=lambda path: path.stat().st_mtime)


def install_and_bake(package: Path, profile: Path, python: str = sys.executable) -> dict[str, Any]:
    """Install a zip into the empty folder ``profile`` with the Blender of an interpreter and bake a lit box there."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"BLENDER_USER_RESOURCES": str(profile)}
    command = [python, str(Path(__file__).with_name("install_and_bake.py")), str(package)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return {**json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{"))), "profile": str(profile)}


def check_baked(baked: dict[str, Any]) -> None:
    """What has to hold of a bake by the installed extension: every corner is lit, the lamp most, and the floor well."""
    assert baked["installed"]
    assert Path(baked["profile"]).resolve() in Path(baked["from"]).resolve().parents
    assert baked["result"] == ["FINISHED"]
    assert (baked["name"], baked["type"], baked["domain"]) == ("Enfilade", "FLOAT_COLOR", "CORNER")
    assert all(math.isfinite(c) and c > 0 for color in baked["colors"] for c in color[:3])
    floor, lamp = (
        [baked["colors"][corner][k] for corner in baked["loops"][baked["normals_z"].index(up)] for k in range(3)] for up in (1, -1)
    )
    assert min(floor) > 0.05
    assert max(floor) < min(lamp)
    assert min(lamp) > 3.0


if __name__ == "__main__":
    verb, place = sys.argv[1], Path(sys.argv[2])
    if verb == "build":
        print(f"written: {build(place)}", flush=True)
    else:
        checked = validate(place)
        print(checked.stdout + checked.stderr, end="")
        sys.exit(checked.returncode)
