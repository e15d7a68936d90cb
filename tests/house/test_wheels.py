"""The package in the other Blenders that are supported, where ``make wheels`` has set them up."""

import subprocess
from pathlib import Path

import extension_tool
import pytest
import wheels


@pytest.mark.parametrize("blender", wheels.WHEELS)
def test_package_in_another_blender(blender, tmp_path):
    """Built and checked by that Blender's own tool, installed into a clean profile, and its operator run."""
    python = wheels.existing(blender)
    if python is None:
        pytest.skip(
            f"Blender {blender} is not set up here: make wheels does that, given a Python {'.'.join(map(str, wheels.WHEELS[blender]))}"
        )
    tool = Path(extension_tool.__file__)
    built = subprocess.run([python, tool, "build", tmp_path / "dist"], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    package = next((tmp_path / "dist").glob("enfilade-*.zip"))
    for what in (package, extension_tool.ROOT):
        checked = subprocess.run([python, tool, "validate", what], capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stdout + checked.stderr
    baked = extension_tool.install_and_bake(package, tmp_path / "profile", str(python))
    assert baked["blender"].startswith(blender + ".")
    extension_tool.check_baked(baked)
