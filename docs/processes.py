"""Runs of a command in a process of its own, with what it took: seconds, CPU seconds, memory."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import IO

from ..core.memory import peak_bytes

PERIOD = 0.05
"""Seconds between two looks at the memory of a run, more where a look takes long."""
LONGEST = 0.3


class RunError(RuntimeError):
    """A run that did not end as it should; the message holds the last lines that it wrote."""


def run_module(module: str, *arguments: object, err: IO | None = None) -> dict:
    """Run a module of the package as a program and return the JSON object on the last line of its output.

    ``peak_bytes`` in it is the most memory that the process and its children held at one time, or what the run itself says where
    that is more. What it says on standard error goes to ``err``, if somebody is there to read it. Raises :class:`RunError`.
    """
    command = [sys.executable, "-m", module, *map(str, arguments)]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(command, stdout=out, stderr=err or errors)
        watch = _Watch(process.pid)
        try:
            code = process.wait()
        except BaseException:
            process.terminate()
            process.wait()
            raise
        finally:
            peak = watch.stop()
        out.seek(0)
        errors.seek(0)
        lines = [line for line in out.read().decode(errors="replace").splitlines() if line.startswith("{")]
        if code or not lines:
            last = errors.read().decode(errors="replace").strip().splitlines()[-5:]
            raise RunError(f"{module} {' '.join(map(str, arguments))} ended with {code}: " + " / ".join(last))
    result = json.loads(lines[-1])
    return result | {"peak_bytes": max(peak, result.get("peak_bytes", 0))}


class _Watch(threading.Thread):
    """Looks at the memory of a process and its descendants until it is stopped."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self._pid, self._peak, self._over = pid, 0, threading.Event()
        self.start()

    def run(self) -> None:
        while not self._over.wait(PERIOD):
            started = time.perf_counter()
            self._peak = max(self._peak, sum(map(_resident, _family(self._pid))))
            # A look takes the longer the more memory there is: it shall not take part in what it measures.
            self._over.wait(min(20 * (time.perf_counter() - started), LONGEST))

    def stop(self) -> int:
        self._over.set()
        self.join()
        return self._peak


def _family(pid: int) -> list[int]:
    """A process and all its descendants."""
    found = [pid]
    for one in found:
        for path in Path(f"/proc/{one}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                found += map(int, path.read_text().split())
    return found


def _resident(pid: int) -> int:
    """Bytes of memory of a process, what it shares with others divided among them; 0 where the system does not tell."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0
    return sum(1024 * int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:"))


def own_peak_bytes() -> int:
    """Most memory that this process has held, in bytes; not, as the system also counts it, what its parent held when it began."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return peak_bytes()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


def cpu_seconds() -> float:
    """CPU seconds of this process and of its children, those that have ended and those at work."""
    return sum(os.times()[:4]) + sum(map(_cpu_of, _family(os.getpid())[1:]))


def _cpu_of(pid: int) -> float:
    try:
        # After the name in brackets, which may hold anything: from the 12th field on user and system time, also of ended children.
        ticks = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15]
    except OSError:
        return 0.0
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def machine() -> dict[str, str]:
    """The machine and what matters of its software."""
    import numpy as np

    return {
        "processor": _processor(),
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
