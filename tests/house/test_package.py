"""The extension as it ships: built and checked by Blender's own tool, installed into a clean profile, and run there."""

import subprocess
import tomllib
import zipfile
from pathlib import Path

import extension_tool
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    pytest.importorskip("bpy", reason="Blender's Python module is not installed")
    return extension_tool.build(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def baked(package, tmp_path_factory):
    return extension_tool.install_and_bake(package, tmp_path_factory.mktemp("profile"))


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
        assert "warning" not in (checked.stdout + checked.stderr).lower()


@pytest.mark.skipif(not extension_tool.whole_blender(), reason="there is no Blender here but its Python module")
def test_a_whole_blender_finds_the_zip_valid(package):
    command = [*extension_tool.whole_blender(), "--background", "--command", "extension", "validate", package.name]
    checked = subprocess.run(command, capture_output=True, text=True, cwd=package.parent, timeout=120, check=False)
    said = checked.stdout + checked.stderr
    assert checked.returncode == 0, said
    assert f'Success parsing TOML in "{package.name}"' in said
    assert not [line for line in said.splitlines() if "enfilade" in line and "warning" in line.lower()]


def test_zip_holds_the_code_and_nothing_else(package, manifest):
    assert package.name == f"enfilade-{manifest['version']}.zip"
    with zipfile.ZipFile(package) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
    code = {path.relative_to(ROOT).as_posix() for top in ("addon", "core") for path in (ROOT / top).rglob("*.py")}
    assert names == code | {"__init__.py", "__main__.py", "blender_manifest.toml", "LICENSE", "README.md", "CHANGELOG.md"}


def test_bakes_where_it_is_installed(baked):
    """The clean profile holds the extension, its operator ran, and the box came out lit."""
    extension_tool.check_baked(baked)
