"""``python -m enfilade`` in a process of its own."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
FURNACE = ROOT / "tests" / "data" / "bench" / "furnace.npz"


def test_help_names_the_commands(enfilade):
    done = enfilade("--help")
    assert done.returncode == 0
    assert "solve SCENE" in done.stdout
    assert "bake FILE.blend" in done.stdout
    assert "light FILE" in done.stdout


def test_version_is_the_manifests(enfilade):
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert enfilade("--version").stdout == f"enfilade {manifest['version']}\n"


@pytest.mark.parametrize("arguments", [["polish"], []])
def test_no_such_command(enfilade, arguments):
    done = enfilade(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "solve" in done.stderr


def test_solve_helps_itself(enfilade):
    done = enfilade("solve", "--help")
    assert done.returncode == 0
    assert "--quality" in done.stdout


def test_bake_without_blender_says_what_is_missing(enfilade):
    # -S hides the packages of the environment, bpy among them.
    done = enfilade("bake", "scene.blend", "--out", "baked.blend", before=["-S"])
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "pip install bpy" in done.stderr


def test_furnace_is_solved_to_its_closed_form(enfilade, tmp_path):
    """Every wall emits M and reflects one half, so E = M / (1 - 1/2)."""
    done = enfilade("solve", FURNACE, "--out", tmp_path / "r.npz", "--report", tmp_path / "r.json")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "r.npz") as result:
        np.testing.assert_allclose(result["E"], np.broadcast_to([2.0, 1.0, 4.0], result["E"].shape), rtol=0.005)
