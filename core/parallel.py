"""A crew of worker processes for blocks of work, with results in the order of the blocks.

Processes, not threads: the blocks are many small NumPy calls, which would wait for one another's interpreter lock, and in Blender
for that of its window. The blocks do not depend on the number of workers and their results are combined in a fixed order, so
the same input gives the same bits on any number of them.
"""

from __future__ import annotations

import os
import queue
import subprocess
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import chain
from typing import Any

from .child import start
from .wire import Shared, receive, send

PATIENCE = 0.3
"""Seconds of work that a crew does by itself before it calls workers: a small scene is done by then."""

_LOST = "a worker process ended by itself, most likely for want of memory; set the option threads to a lower number"


class WorkerLost(MemoryError):
    """A worker process ended by itself; most often the system had no memory left for it."""


def worker_count(threads: int) -> int:
    """Workers to use when the user asks for ``threads`` (0: every core that this process may use)."""
    if threads:
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Crew:
    """Up to ``workers`` processes, started when there is work for them, gone with this object or this process.

    Where processes cannot be started the work is done here, one block after another.
    """

    def __init__(self, workers: int):
        self.workers = workers
        self._spent = 0.0
        self._able = workers > 1
        self._processes: list[subprocess.Popen] = []
        self._idle: queue.SimpleQueue[subprocess.Popen] = queue.SimpleQueue()
        self._end = weakref.finalize(self, _dismiss, self._processes)

    def map(self, function: Callable[..., Any], common: tuple, blocks: Iterable[Any]) -> Iterator[Any]:
        """``function(*common, block)`` of every block, in order, at most a few blocks ahead of the consumer.

        The function belongs to a module of the core; ``common``, the blocks and the results can be pickled, and the function
        changes none of ``common``. Closing the iterator (a cancelled run) stops the workers at once. Raises what the function
        raises, and :class:`WorkerLost`.
        """
        pending = iter(blocks)
        for block in pending:
            if self._ready():
                yield from self._spread(function, common, chain([block], pending))
                return
            begin = time.perf_counter()
            result = function(*common, block)
            self._spent += time.perf_counter() - begin
            yield result

    def summon(self) -> None:
        """Start the workers now and wait for them."""
        if self._able and not self._processes:
            self._start()
        while self._able and self._idle.qsize() < len(self._processes):
            time.sleep(0.005)

    def close(self) -> None:
        """End the workers; new work would start new ones."""
        _dismiss(self._processes)
        self._idle = queue.SimpleQueue()

    def _ready(self) -> bool:
        if self._able and not self._processes and self._spent > PATIENCE:
            self._start()
        return self._able and bool(self._processes) and self._idle.qsize() == len(self._processes)

    def _start(self) -> None:
        # One thread of linear algebra each: more would only get in one another's way.
        environment = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        try:
            for _ in range(self.workers):
                self._processes.append(start("worker_process", environment))
        except OSError:
            self._give_up()
            return
        for process in self._processes:
            threading.Thread(target=self._greet, args=(process, self._idle), daemon=True).start()

    def _greet(self, process: subprocess.Popen, idle: queue.SimpleQueue) -> None:
        """Wait for a worker's first word; a crew of which one cannot work does without workers."""
        shared, heard = Shared(("hello",)), None
        try:
            receive(process.stdout)
            _attach([process], shared.ticket)
            send(process.stdin, (max, ""))
            heard = receive(process.stdout)
        except (OSError, EOFError, ValueError):
            pass
        finally:
            shared.close()
        if heard == (True, "hello"):
            idle.put(process)
        elif idle is self._idle:
            self._give_up()

    def _give_up(self) -> None:
        self._able = False
        self.close()

    def _spread(self, function: Callable[..., Any], common: tuple, blocks: Iterator[Any]) -> Iterator[Any]:
        shared, idle = Shared(common), self._idle
        try:
            try:
                _attach(self._processes, shared.ticket)
            except (OSError, EOFError) as error:
                raise WorkerLost(_LOST) from error

            def ask(block: Any) -> Any:
                process = idle.get()
                try:
                    send(process.stdin, (function, block))
                    good, answer = receive(process.stdout)
                except (OSError, EOFError, ValueError) as error:
                    raise WorkerLost(_LOST) from error
                finally:
                    idle.put(process)
                if not good:
                    raise answer
                return answer

            with ThreadPoolExecutor(len(self._processes)) as askers:
                waiting: deque = deque()
                try:
                    for block in blocks:
                        waiting.append(askers.submit(ask, block))
                        if len(waiting) > 2 * self.workers:
                            yield waiting.popleft().result()
                    while waiting:
                        yield waiting.popleft().result()
                except (GeneratorExit, WorkerLost):
                    self.close()
                    raise
                finally:
                    for future in waiting:
                        future.cancel()
            _attach(self._processes, None)
        finally:
            shared.close()


def _attach(processes: list[subprocess.Popen], ticket: tuple | None) -> None:
    """Have all workers take what their next blocks have in common, in place of what they had."""
    for process in processes:
        send(process.stdin, (None, ticket))
    for process in processes:
        receive(process.stdout)


def _dismiss(processes: list[subprocess.Popen]) -> None:
    for process in processes:
        process.kill()
    for process in processes:
        process.wait()
        process.stdout.close()
        with suppress(OSError):  # what it has not read is of no use to it any more
            process.stdin.close()
    processes.clear()
