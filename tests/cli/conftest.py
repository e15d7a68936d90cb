"""A fresh interpreter that finds the checkout as the package ``enfilade``, whatever its folder is called."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def enfilade(tmp_path):
    """Run ``python -m enfilade`` with arguments and return the finished process."""
    packages = tmp_path / "packages"
    packages.mkdir()
    (packages / "enfilade").symlink_to(ROOT, target_is_directory=True)

    def run(*arguments, before=()):
        environment = {**os.environ, "PYTHONPATH": str(packages), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, *before, "-m", "enfilade", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=300, check=False)

    return run
