"""The extension as it ships: built and checked by Blender's own tool, installed into a clean profile, and run there."""

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import extension_tool
import numpy as np
import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    pytest.importorskip("bpy", reason="Blender's Python module is not installed")
    return extension_tool.build(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def baked(package, tmp_path_factory):
    """What a fresh Blender says after it installed the zip and baked a small lit box."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    environment["BLENDER_USER_RESOURCES"] = str(tmp_path_factory.mktemp("profile"))
    command = [sys.executable, str(HERE / "install_and_bake.py"), str(package)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return {
        **json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{"))),
        "profile": environment["BLENDER_USER_RESOURCES"],
    }


@pytest.fixture(scope="module")
def manifest():
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text())


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_versions_and_licence_agree(manifest, project):
    assert manifest["version"] == project["project"]["version"]
    assert manifest["license"] == ["SPDX:" + project["project"]["license"]]
    assert f"## {manifest['version']}" in (ROOT / "CHANGELOG.md").read_text()


def test_every_folder_of_code_is_a_listed_package(project):
    settings = project["tool"]["setuptools"]
    folders = {path.parent.relative_to(ROOT).as_posix() for top in ("addon", "core") for path in (ROOT / top).rglob("*.py")}
    assert settings["package-dir"] == {"enfilade": ".", **{"enfilade." + f.replace("/", "."): f for f in folders}}
    assert set(settings["packages"]) == set(settings["package-dir"])


def test_source_and_zip_are_valid(package):
    for what in (ROOT, package):
        checked = extension_tool.validate(what)
        assert checked.returncode == 0, checked.stdout + checked.stderr


def test_zip_holds_the_code_and_nothing_else(package, manifest):
    assert package.name == f"enfilade-{manifest['version']}.zip"
    with zipfile.ZipFile(package) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
    code = {path.relative_to(ROOT).as_posix() for top in ("addon", "core") for path in (ROOT / top).rglob("*.py")}
    assert names == code | {"__init__.py", "__main__.py", "blender_manifest.toml", "LICENSE", "README.md", "CHANGELOG.md"}


def test_bakes_where_it_is_installed(baked):
    assert baked["installed"]
    assert Path(baked["profile"]) in Path(baked["from"]).parents
    assert baked["result"] == ["FINISHED"]
    assert (baked["name"], baked["type"], baked["domain"]) == ("Enfilade", "FLOAT_COLOR", "CORNER")


def test_installed_bake_lights_the_box(baked):
    """Every corner is lit, the lamp most, the floor below it less than the lamp and more than nothing."""
    colors = np.array(baked["colors"])[:, :3]
    assert np.isfinite(colors).all()
    assert (colors > 0).all()
    floor, lamp = (colors[baked["loops"][face]].mean() for face in (baked["normals_z"].index(1), baked["normals_z"].index(-1)))
    assert 0.05 < floor < lamp
    assert lamp > 3.0
