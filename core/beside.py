"""A generator of the core in a process of its own: whoever asks for its steps waits for them without the interpreter lock.

In Blender that keeps the window alive: the solver's many calls would hold the lock, in a thread of its own just as well, and its
arrays the memory. It runs at lower priority, and when it runs out of memory it does not take Blender with it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, suppress
from typing import Any

from .child import start
from .wire import can_travel, receive, send

PACE = 0.03
"""Steps that follow the last one sooner than this, seconds, and bring nothing of their own, are left out."""
GRACE = 3.0
"""Seconds that a cancelled generator has for the step that it is at."""
NICENESS = 5

_LOST = "the solver's process ended by itself, most likely for want of memory; set the option memory, or take a lower quality"


class SolverLost(MemoryError):
    """The process of a generator ended by itself; most often the system had no memory left for it."""


def beside(function: Callable[..., Generator], *arguments: Any) -> Generator:
    """The steps of the generator ``function(*arguments)``, run in a process of its own, and what it returns.

    The function belongs to a module of the core; arguments, steps and result can be pickled. Of steps in quick
    succession some are left out, but never the last one, nor one with a ``sketch``. Closing this generator closes that one
    at its next step, and ends its process. Raises what the function raises, and :class:`SolverLost`.
    Where no process can be started the generator runs here.
    """
    try:
        process = start("beside", {})
    except OSError:
        return (yield from function(*arguments))
    try:
        try:
            send(process.stdin, (function, arguments))
            while True:
                kind, value = receive(process.stdout)
                if kind == "result":
                    return value
                if kind == "error":
                    raise value
                yield value
        except (EOFError, BrokenPipeError) as error:
            raise SolverLost(_LOST) from error
    finally:
        _end(process)


def _end(process: subprocess.Popen) -> None:
    for stream in (process.stdin, process.stdout):  # it sees that nobody listens any more
        with suppress(OSError):
            stream.close()
    try:
        process.wait(2 * GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def serve() -> None:
    """What runs in the process: one generator, until it ends or nobody listens any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that started this one
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not end up among the answers
    with suppress(EOFError, OSError):
        function, arguments = receive(sys.stdin.buffer)
        alone = threading.Event()
        threading.Thread(target=_watch, args=(alone,), daemon=True).start()
        with closing(_answers(function(*arguments), alone)) as told:
            for answer in told:
                send(answers, answer)
    os._exit(0)  # an orderly end would try to write what is left to a pipe that nobody reads


def _watch(alone: threading.Event) -> None:
    """Wait until the process that started this one closes the pipe, or is gone; give the generator time to end in order."""
    while os.read(0, 1):
        pass
    alone.set()
    time.sleep(GRACE)
    os._exit(1)


def _answers(steps: Generator, alone: threading.Event) -> Iterator[tuple[str, Any]]:
    """What is to be told of a generator: ("step", step) and last ("result", what it returns) or ("error", what it raises)."""
    told, waiting = 0.0, None
    with closing(steps):
        try:
            while not alone.is_set():
                waiting = next(steps)
                if time.monotonic() - told > PACE or getattr(waiting, "sketch", None) is not None:
                    told = time.monotonic()
                    yield "step", waiting
                    waiting = None
        except StopIteration as end:
            if waiting is not None:
                yield "step", waiting
            yield "result", end.value
        except Exception as error:
            yield "error", error if can_travel(error) else RuntimeError("".join(traceback.format_exception(error)))
