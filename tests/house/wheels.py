"""Run the tests of the package and of the add-on in the Blenders that ``make test`` does not have, one environment for each.

``python wheels.py [--tests FOLDER ...] [VERSION ...]`` makes .venv-VERSION beside the checkout's own .venv where it is missing.
A version whose Python is not on this machine is skipped, and said so. What is set up here is found by test_wheels.py.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WHEELS = {"4.2": (3, 11), "4.5": (3, 11), "5.2": (3, 13)}
TESTS = ("tests/house/test_package.py", "tests/addon")


def interpreter(version: tuple[int, int]) -> str | None:
    """A Python of this version: this one, one on the path, or one that pyenv keeps; None where there is none."""
    name = f"python{version[0]}.{version[1]}"
    kept = sorted(Path.home().glob(f".pyenv/versions/{version[0]}.{version[1]}.*/bin/{name}"))
    for candidate in (sys.executable, name, *map(str, kept)):
        question = f"import sys, venv, ensurepip; sys.exit(sys.version_info[:2] != {version})"
        try:
            if subprocess.run([candidate, "-c", question], capture_output=True, check=False).returncode == 0:
                return candidate
        except OSError:
            continue
    return None


def existing(blender: str) -> Path | None:
    """The Python of the environment of a Blender version where it is ready."""
    folder = ROOT / f".venv-{blender}"
    return folder / "bin" / "python" if (folder / ".ready").exists() else None


def environment(blender: str) -> Path | None:
    """The Python of the environment of a Blender version, installed where it is missing; None where it cannot be."""
    found = existing(blender)
    if found is not None:
        return found
    folder = ROOT / f".venv-{blender}"
    python = folder / "bin" / "python"
    maker = interpreter(WHEELS[blender])
    if maker is None:
        return None
    subprocess.run([maker, "-m", "venv", str(folder)], check=True)
    needs = [f"bpy=={blender}.*", "pytest>=8", "hypothesis>=6"]
    subprocess.run([str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "install", *needs], check=True)
    (folder / ".ready").touch()
    return python


def main() -> int:
    """Run all and end with a line for each; the exit code is 1 when one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tests", nargs="+", default=TESTS, help="what pytest runs in each")
    parser.add_argument("versions", nargs="*", metavar="VERSION", help=f"of {', '.join(WHEELS)} [all]")
    given = parser.parse_args()
    unknown = [v for v in given.versions if v not in WHEELS]
    if unknown:
        parser.error(f"{unknown[0]} is not one of {', '.join(WHEELS)}")
    lines, failed = [], False
    for blender in given.versions or WHEELS:
        started = time.monotonic()
        python = environment(blender)
        if python is None:
            major, minor = WHEELS[blender]
            lines.append(f"Blender {blender}: skipped, there is no Python {major}.{minor} on this machine")
            continue
        set_up = time.monotonic()
        tests = [t for t in given.tests if (ROOT / t).exists()]
        code = subprocess.run([str(python), "-m", "pytest", "-q", *tests], cwd=ROOT, check=False).returncode
        failed |= code != 0
        tested = time.monotonic()
        outcome = "failed" if code else "passed"
        lines.append(f"Blender {blender}: {outcome} ({set_up - started:.0f} s to set up, {tested - set_up:.0f} s of tests)")
    print("\n".join(lines), flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
