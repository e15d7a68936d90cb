"""What a measure gives: a table of its own, and its lines in the table of all measures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """title, text : of the part of the page;  head, rows : its table, texts

    lines : rows of the table of all measures: what is measured, what is asked, what was found, whether that is met
    """

    title: str
    text: str
    head: list[str]
    rows: list[list[str]]
    lines: list[list[str]]


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows])


def error(x: float) -> str:
    """A small number with two digits."""
    return f"{x:.1e}"


def met(good: bool) -> str:
    """Whether a measure is met, in a word."""
    return "yes" if good else "no"
