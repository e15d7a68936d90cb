# SPDX-License-Identifier: GPL-3.0-or-later
"""What a command line shows of a run: a line of progress, and the figures of the report as text."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from typing import Any, TextIO

import numpy as np

from .progress import TimeLeft, words

REWRITE_SECONDS = 0.1
"""A terminal line is rewritten no more often than this."""


class ProgressLine:
    """Progress on a stream: one line that rewrites itself on a terminal, a line for every step elsewhere.

    A step is a new stage, or another tenth of the whole run.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._step: tuple[str, int] | None = None
        self._written = -1.0
        self._open = False
        self._left = TimeLeft()

    def show(self, stage: str, fraction: float, message: str = "") -> None:
        """Show that ``fraction`` (0..1) of the run is done and what it is about, and how long it may still take."""
        remaining = self._left.after(fraction)
        text = f"{100 * fraction:3.0f} %  {stage}" + (f": {message}" if message else "")
        text += f", {words(remaining)}" if remaining is not None and fraction < 1 else ""
        step = (stage, int(10 * fraction))
        if self._terminal:
            now = time.monotonic()
            if step == self._step and now - self._written < REWRITE_SECONDS:
                return
            width = max(20, shutil.get_terminal_size().columns - 1)
            self._stream.write("\r" + text[:width].ljust(width))
            self._written, self._open = now, True
        elif step == self._step:
            return
        else:
            self._stream.write(text + "\n")
        self._step = step
        self._stream.flush()

    def close(self) -> None:
        """End the line of a terminal, so that what follows starts on its own."""
        if self._open:
            self._stream.write("\n")
            self._stream.flush()
            self._open = False


def summary(report: Mapping[str, Any]) -> list[str]:
    """The lines that end a run: the figures of a solution's report that it holds, in its order of stages."""
    lines = []
    counts = [("rooms", "rooms"), ("polygons", "polygons"), ("clusters", "clusters"), ("portals", "portals")]
    _join(lines, [f"{_count(report[key])} {name}" for key, name in counts if key in report])
    work = [("elements", "elements"), ("iterations", "iterations"), ("segment_tests", "segment tests")]
    _join(lines, [f"{_count(report[key])} {name}" for key, name in work if key in report])
    if "energy" in report:
        energy = {key: float(np.sum(value)) for key, value in report["energy"].items()}
        whole = energy.get("emitted", 0.0)
        parts = [
            f"{key} {value:.5g} W" + (f" ({100 * value / whole:.2f} %)" if whole and key != "emitted" else "")
            for key, value in energy.items()
        ]
        _join(lines, ["energy: " + parts[0], *parts[1:]] if parts else [])
    limits = []
    if "unshot_fraction" in report:
        limits.append(f"unshot {100 * float(report['unshot_fraction']):.3g} %")
    for key, name in (("residual_bound", "residual bound"), ("dropped_bound", "dropped bound")):
        if key in report:
            limits.append(f"{name} {float(np.max(report[key])):.3g} W/m2")
    _join(lines, limits)
    if "seconds" in report:
        _join(lines, ["seconds: " + ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in report["seconds"].items())])
    if "peak_bytes" in report:
        lines.append(f"peak memory {report['peak_bytes'] / 2**20:.0f} MB")
    return lines


def _join(lines: list[str], parts: list[str]) -> None:
    if parts:
        lines.append(", ".join(parts))


def _count(value: float) -> str:
    """A count with thin groups of thousands, in millions where it is large."""
    return f"{value / 1e6:,.1f} million" if value >= 1e7 else f"{int(value):,}"
