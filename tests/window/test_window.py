"""The whole way of a user in a real Blender window; needs one, see drive.py, and is skipped where there is none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHELL = "ENFILADE_BLENDER_SHELL"


@pytest.mark.skipif(SHELL not in os.environ, reason=f"{SHELL} names no Blender with a window")
def test_from_a_plain_model_to_a_saved_bake(tmp_path):
    subprocess.run([sys.executable, ROOT / "tests" / "house" / "extension_tool.py", "build", tmp_path], check=True)
    (package,) = tmp_path.glob("*.zip")
    folder = tmp_path / "window"
    command = [sys.executable, ROOT / "tests" / "window" / "drive.py", package, ROOT / "sample_scenes" / "apartment.blend", folder]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list(folder.glob("*.png"))) == 10
