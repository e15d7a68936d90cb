"""The memory that this process holds, and the most that it has held."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path


def peak_bytes() -> int:
    """Peak resident size of this process in bytes, 0 where the system does not tell."""
    if sys.platform == "win32":
        return _windows_counters()[0]
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) if sys.platform == "darwin" else int(peak) * 1024


def resident_bytes() -> int:
    """Resident size of this process in bytes; its peak where the system tells no more."""
    if sys.platform == "win32":
        return _windows_counters()[1]
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return peak_bytes()


def give_back_free() -> None:
    """Have the allocator return to the system what this process has freed; only that of the GNU C library needs to be asked."""
    if sys.platform != "linux":
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim:
        trim(ctypes.c_size_t(0))


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of the Windows API."""

    _fields_ = [("size", ctypes.c_ulong), ("faults", ctypes.c_ulong)] + [(f"bytes{k}", ctypes.c_size_t) for k in range(8)]


def _windows_counters() -> tuple[int, int]:
    """Peak and present working set, bytes."""
    counters = _Counters()
    counters.size = ctypes.sizeof(counters)
    kernel = ctypes.WinDLL("kernel32")
    kernel.GetCurrentProcess.restype = ctypes.c_void_p
    ask = kernel.K32GetProcessMemoryInfo
    ask.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ulong]
    found = ask(kernel.GetCurrentProcess(), ctypes.byref(counters), counters.size)
    return (int(counters.bytes0), int(counters.bytes1)) if found else (0, 0)
