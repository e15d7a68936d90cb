"""Blender's own extension tool, as it ships in the bpy wheel: ``python extension_tool.py validate|build ...``.

It is plain Python, so bpy itself is not imported and any wheel that is installed can be used.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

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


def build(folder: Path, source: Path = ROOT) -> Path:
    """Build the zip into a folder, which is made where it is missing, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [*tool(), "build", *tags(), "--source-dir", str(source), "--output-dir", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    return max(folder.glob("*.zip"), key=lambda path: path.stat().st_mtime)


if __name__ == "__main__":
    verb, place = sys.argv[1], Path(sys.argv[2])
    if verb == "build":
        print(f"written: {build(place)}")
    else:
        checked = validate(place)
        print(checked.stdout + checked.stderr, end="")
        sys.exit(checked.returncode)
