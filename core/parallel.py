"""A pool of threads over blocks of work, with results in the order of the blocks.

NumPy releases the interpreter lock inside its large operations. The blocks do not depend on the number of threads and
their results are combined in a fixed order, so the same input gives the same bits on any number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Block = TypeVar("Block")
Result = TypeVar("Result")


def worker_count(threads: int) -> int:
    """Threads to use when the user asks for ``threads`` (0: every core that this process may use)."""
    if threads:
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def ordered_map(function: Callable[[Block], Result], blocks: Iterable[Block], workers: int) -> Iterator[Result]:
    """``function`` of every block, in order, at most a few blocks ahead of the consumer.

    Closing the iterator (a cancelled run) waits for the blocks under way and starts no more.
    """
    if workers <= 1:
        yield from map(function, blocks)
        return
    with ThreadPoolExecutor(workers) as pool:
        pending: deque = deque()
        try:
            for block in blocks:
                pending.append(pool.submit(function, block))
                if len(pending) > 2 * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
