"""Command-line arguments made from the options dataclasses, so that every command speaks of them alike."""

from __future__ import annotations

import argparse
import dataclasses
import re
from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

from .options import OptionError, OptionInfo, describe

_Options = TypeVar("_Options")

_SIZE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([kmgt]?)(?:i?b)?", re.IGNORECASE)
_FACTOR = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}


class Parser(argparse.ArgumentParser):
    """An argument parser that raises :class:`OptionError` with one sentence where argparse prints usage and exits."""

    def error(self, message: str) -> NoReturn:
        raise OptionError(message)


def parse_size(text: str) -> int:
    """Bytes of a size such as ``500M``, ``1.5G`` or ``4096``; K, M, G and T count in steps of 1024.

    Raises :class:`OptionError` when the text is no such size.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise OptionError(f"{text!r} is not a size such as 500M or 2G")
    return round(float(match[1]) * _FACTOR[match[2].lower()])


def format_size(count: int) -> str:
    """A size in bytes as short text that :func:`parse_size` reads back: 2**31 becomes ``2G``; 1500 stays ``1500``."""
    for unit in "TGMK":
        factor = _FACTOR[unit.lower()]
        if count >= factor and count % factor == 0:
            return f"{count // factor}{unit}"
    return str(count)


def _converter(info: OptionInfo) -> Callable[[str], Any]:
    def convert(text: str) -> Any:
        try:
            if info.kind == "size":
                return parse_size(text)
            return {"int": int, "float": float}.get(info.kind, str)(text)
        except ValueError as error:  # OptionError is one of them
            kind = {"int": "a whole number", "float": "a number"}.get(info.kind, "a size such as 500M or 2G")
            raise argparse.ArgumentTypeError(f"{text!r} is not {kind}") from error

    return convert


def _help(info: OptionInfo) -> str:
    unit = f" ({info.unit})" if info.unit else ""
    default = format_size(info.default) if info.kind == "size" else info.default
    shown = "" if info.default == "" else f" [{'yes' if default is True else 'no' if default is False else default}]"
    return (info.help + unit + shown).replace("%", "%%")


def add_options(parser: argparse.ArgumentParser, cls: type, title: str | None = None) -> None:
    """Add one flag for every field of an options dataclass, in a group of its own when it is given a title.

    Flags that are not given leave no trace in the namespace, so that :func:`options_from` can start from other
    values than the defaults, such as those that are saved in a file.
    """
    group = parser.add_argument_group(title) if title else parser
    for info in describe(cls):
        details: dict[str, Any] = {"dest": info.name, "default": argparse.SUPPRESS, "help": _help(info)}
        if info.kind == "bool":
            details["action"] = argparse.BooleanOptionalAction
        elif info.kind == "choice":
            details["choices"] = info.choices
        else:
            details["type"] = _converter(info)
            details["metavar"] = {"int": "N", "float": "X", "size": "SIZE", "path": "FOLDER", "name": "NAME"}[info.kind]
        group.add_argument(info.flag, **details)


def options_from(namespace: argparse.Namespace, cls: type[_Options], base: _Options | None = None) -> _Options:
    """The options that the flags of ``namespace`` say, over those of ``base`` (the defaults when there is none).

    Raises :class:`OptionError` when a value is out of its range.
    """
    given = {info.name: getattr(namespace, info.name) for info in describe(cls) if hasattr(namespace, info.name)}
    return cls(**given) if base is None else dataclasses.replace(base, **given)
