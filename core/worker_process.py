"""What runs in a worker: blocks of work come in, results go out, until the pipe ends.

When the process that started it is gone, however it went, its pipe ends and so does the worker.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback

from .memory import give_back_free
from .wire import attached, can_travel, receive, send


def serve() -> None:
    """Answer messages from standard input until it ends.

    (None, ticket of a :class:`.wire.Shared` or None) names what all following blocks have in common; (function, block) asks for
    function(*common, block). The answer is (True, result) or (False, error).
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that started this one
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not end up among the answers
    common: tuple = ()
    try:
        send(answers, (True, None))
        while True:
            function, block = receive(requests)
            if function is None:
                common = attached(block) if block else ()
                give_back_free()  # a worker may wait for long until there is something for it again
                send(answers, (True, None))
            else:
                send(answers, _answer(function, common, block))
    except (EOFError, OSError):
        os._exit(0)  # nobody is there any more; an orderly end would try to write what is left, and complain


def _answer(function, common: tuple, block) -> tuple[bool, object]:
    try:
        return True, function(*common, block)
    except Exception as error:
        return False, error if can_travel(error) else RuntimeError("".join(traceback.format_exception(error)))
