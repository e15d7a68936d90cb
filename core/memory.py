"""The most memory that this process has held."""

from __future__ import annotations

import ctypes
import sys


def peak_bytes() -> int:
    """Peak resident size of this process in bytes, 0 where the system does not tell."""
    if sys.platform == "win32":
        return _windows_peak()
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) if sys.platform == "darwin" else int(peak) * 1024


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of the Windows API."""

    _fields_ = [("size", ctypes.c_ulong), ("faults", ctypes.c_ulong)] + [(f"bytes{k}", ctypes.c_size_t) for k in range(8)]


def _windows_peak() -> int:
    counters = _Counters()
    counters.size = ctypes.sizeof(counters)
    kernel = ctypes.WinDLL("kernel32")
    kernel.GetCurrentProcess.restype = ctypes.c_void_p
    ask = kernel.K32GetProcessMemoryInfo
    ask.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ulong]
    found = ask(kernel.GetCurrentProcess(), ctypes.byref(counters), counters.size)
    return int(counters.bytes0) if found else 0
