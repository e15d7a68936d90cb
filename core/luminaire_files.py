"""Files of luminaire photometry: IES LM-63 (.ies) and EULUMDAT (.ldt)."""

from __future__ import annotations

from pathlib import Path

from .eulumdat_files import parse_eulumdat
from .ies_files import parse_ies
from .luminaires import Luminaire
from .scene import SceneError

LARGEST_FILE = 8 << 20
"""Bytes; a file of 0.5 degree steps over the whole sphere has under 2 million."""

READERS = {".ies": parse_ies, ".ldt": parse_eulumdat}


def read_luminaire(path: str | Path) -> Luminaire:
    """The luminaire of an ``.ies`` or ``.ldt`` file.

    Raises SceneError with one sentence that names the file, the line where one is at fault, and the remedy.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SceneError(f"{path}: luminaire photometry comes in files that end in .ies or .ldt, choose one of these")
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise SceneError(f"{path}: there is no such file, choose the luminaire file again") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: the file cannot be read ({reason}), choose the luminaire file again") from error
    if len(content) > LARGEST_FILE:
        raise SceneError(f"{path}: the file has more than {LARGEST_FILE >> 20} MB, so it is no luminaire photometry, choose another")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Numbers are ASCII in any case; only names of makers are written in the code pages of the time.
        text = content.decode("latin-1")
    # Not splitlines: it also breaks lines at characters that names may have in the code pages of the time.
    lines = text.rstrip("\0\x1a \t\r\n").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return reader(str(path), lines)
