"""The whole way of a user in a real Blender window; needs one, see drive.py, and is skipped where there is none."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
APARTMENT = ROOT / "sample_scenes" / "apartment.blend"
SHELL = "ENFILADE_BLENDER_SHELL"
INSTALL = "blender --background --command extension install-file --repo user_default --enable enfilade.zip"
MEASURE = """
Xvfb :94 -screen 0 700x450x24 +extension GLX & screen=$!
sleep 1
DISPLAY=:94 blender --gpu-backend opengl --window-geometry 0 0 700 450 apartment.blend --python pauses.py
kill $screen
"""

pytestmark = pytest.mark.skipif(SHELL not in os.environ, reason=f"{SHELL} names no Blender with a window")


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run([sys.executable, ROOT / "tests" / "house" / "extension_tool.py", "build", folder], check=True)
    (built,) = folder.glob("*.zip")
    return built


def test_from_a_plain_model_to_a_saved_bake(package, tmp_path):
    folder = tmp_path / "window"
    command = [sys.executable, ROOT / "tests" / "window" / "drive.py", package, APARTMENT, folder]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list(folder.glob("*.png"))) == 13


def test_the_window_stays_alive_during_a_bake(package, tmp_path):
    """No pause above 0.1 s but for reading and writing; what merely drawing the window takes comes on top where a processor draws."""
    shutil.copy(package, tmp_path / "enfilade.zip")
    shutil.copy(APARTMENT, tmp_path)
    shutil.copy(ROOT / "tests" / "window" / "pauses.py", tmp_path)
    (tmp_path / "profile" / "config").mkdir(parents=True)
    script = f"export BLENDER_USER_RESOURCES=$PWD/profile; {INSTALL} || exit 1; {MEASURE}"
    command = [*shlex.split(os.environ[SHELL]), "bash", "-c", script]
    done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=1200)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    assert lines, done.stdout + done.stderr
    found = json.loads(lines[-1])
    assert found["summary"]
    pauses = found["pauses"]
    drawing = pauses.pop("drawing")
    pauses = {
        during: took
        for during, took in pauses.items()
        if not during.startswith(("idle to", "drawing to")) and not during.endswith("to idle")
    }
    assert "solve" in pauses
    assert max(pauses.values()) <= 0.1 + drawing, pauses
