"""Processes that run a part of the core, started by this one and spoken with over their standard input and output."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

_BOOT = """
import importlib, json, sys, types
sys.path[:], package, folder, module = json.loads(sys.argv[1])
parts = package.split(".")
for k in range(len(parts)):
    made = sys.modules[".".join(parts[: k + 1])] = types.ModuleType(".".join(parts[: k + 1]))
    made.__path__ = [folder] if k + 1 == len(parts) else []
importlib.import_module(package + ".core." + module).serve()
"""
"""Imports the core under the name that it has here, but nothing around it: in Blender that would want Blender."""


def start(module: str, environment: Mapping[str, str]) -> subprocess.Popen:
    """Start a process that runs ``serve()`` of a module of the core, with ``environment`` beside that of this process.

    Raises OSError where no process can be started.
    """
    package, folder = __package__.rpartition(".")[0], str(Path(__file__).parent.parent)
    what = json.dumps([[str(p) for p in sys.path], package, folder, module])
    quiet = {"creationflags": subprocess.CREATE_NO_WINDOW} if sys.platform == "win32" else {}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen([python(), "-c", _BOOT, what], env=os.environ | environment, **pipes, **quiet)


def python() -> str:
    """The interpreter that runs this, also where the running program is Blender. Raises FileNotFoundError where there is none."""
    if Path(sys.executable).name.startswith("python"):
        return sys.executable
    folder = Path(sys.prefix) / ("" if sys.platform == "win32" else "bin")
    found = shutil.which(f"python{sys.version_info.major}.{sys.version_info.minor}", path=folder) or shutil.which("python", path=folder)
    if not found:
        raise FileNotFoundError("no Python interpreter beside this program")
    return found
