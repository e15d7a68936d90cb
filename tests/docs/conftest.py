"""Modules of the package as programs of their own, as the measuring commands run them."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """A folder for modules that a program can be started from; the package is there."""
    folder = tmp_path / "programs"
    folder.mkdir()
    (folder / "enfilade").symlink_to(ROOT, target_is_directory=True)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    return folder
