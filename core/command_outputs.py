# SPDX-License-Identifier: GPL-3.0-or-later
"""What every command does alike: it refuses outputs before any work, writes all or nothing, and ends with one sentence and a code."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TextIO

from .console import ProgressLine
from .options import OptionError
from .scene import SceneError


class OutputError(ValueError):
    """A file that cannot be read or written; the message is one sentence that names it and the remedy."""


def run_command(work: Callable[[], int], line: ProgressLine, err: TextIO) -> int:
    """The exit code of ``work``: its own, 2 after one sentence of what is wrong, 130 when interrupted."""
    try:
        return work()
    except SystemExit as leave:  # --help
        return int(leave.code or 0)
    except KeyboardInterrupt:
        line.close()
        err.write("enfilade: interrupted, nothing was written\n")
        return 130
    except (SceneError, OptionError, OutputError, OSError, MemoryError) as error:
        line.close()
        err.write(f"enfilade: {_sentence(error)}\n")
        return 2


def check_outputs(outputs: Iterable[tuple[Path | None, str, str]], scene: Path | None = None) -> None:
    """Raise :class:`OutputError` where an output cannot be written or would replace another file of the run.

    outputs : a path or None, the option that names it, and the suffix that it must have or an empty text
    scene : a file that no output may replace
    """
    seen = {} if scene is None else {scene.resolve(): "the scene"}
    for path, what, suffix in outputs:
        if path is None:
            continue
        if suffix and path.suffix.lower() != suffix:
            raise OutputError(f"{path}: {what} must name a {suffix} file")
        if path.resolve() in seen:
            raise OutputError(f"{path}: {what} names the same file as {seen[path.resolve()]}, give it a name of its own")
        seen[path.resolve()] = what
        if path.is_dir():
            raise OutputError(f"{path}: {what} names a folder, add a file name")
        if not path.parent.is_dir():
            raise OutputError(f"{path}: the folder of {what} does not exist, create it first")
        if path.exists() and not os.access(path, os.W_OK):
            raise OutputError(f"{path}: {what} is write-protected, choose another name")
        try:
            with tempfile.TemporaryFile(dir=path.parent):
                pass
        except OSError as error:
            raise OutputError(f"{path}: {what} cannot be written ({error.strerror}), choose another folder") from error


def write_text(path: Path, text: str) -> None:
    """Write a file beside its place and move it there: a failure leaves what was there before. Raises :class:`OutputError`."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8", newline="")
        os.replace(part, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        part.unlink(missing_ok=True)


def _sentence(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "the machine has not enough memory for this scene: take a lower --quality or a --memory budget"
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)
