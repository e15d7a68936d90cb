# SPDX-License-Identifier: GPL-3.0-or-later
"""Write every .blend file of this folder again: ``python -m enfilade.sample_scenes.make_all --out FOLDER``."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def main() -> None:
    """Run each generator in a process of its own, so that none inherits the other's Blender data."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the .blend files [this folder]")
    folder = parser.parse_args().out
    for name in ("cornell", "two_rooms", "apartment"):
        _run(name, "--out", str(folder / f"{name}.blend"))
    for building in sorted(HERE.glob("*.json")):
        _run("import_building", str(building), "--out", str(folder / f"{building.stem}.blend"))


def _run(module: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-m", f"{__package__}.{module}", *arguments], check=True)


if __name__ == "__main__":
    main()
