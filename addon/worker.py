# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a generator that needs no Blender data in a thread, so that the window stays alive."""

from __future__ import annotations

import threading
from collections.abc import Generator
from typing import Any


class Worker:
    """Drains a generator in a daemon thread; the latest value it yielded is ``latest``.

    When ``done`` is true the outcome is known: ``result``, or ``error``, or neither where it was cancelled.
    """

    def __init__(self, generator: Generator[Any, None, Any]) -> None:
        self.latest: Any = None
        self.result: Any = None
        self.error: BaseException | None = None
        self._cancelled = threading.Event()
        self._generator = generator
        self._thread = threading.Thread(target=self._run, name="enfilade bake", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            while not self._cancelled.is_set():
                self.latest = next(self._generator)
            self._generator.close()
        except StopIteration as end:
            self.result = end.value
        except BaseException as error:  # handed to the thread that asks, whatever it is
            self.error = error

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def cancel(self) -> None:
        """Ask the thread to stop at its next step; its result will not be looked at."""
        self._cancelled.set()

    def join(self, seconds: float) -> None:
        """Wait for the thread, at most so long."""
        self._thread.join(seconds)
