"""All measures of accuracy, in one table: ``python -m enfilade.docs.measure [--quick] [PART ...]``.

Writes the tables into docs/accuracy.md, between its two marks. What a part gave is kept in out/measures.json until the code changes,
so that a run that was interrupted goes on where it was. The page is written when all parts are there; some alone are printed, as is
what ``--quick`` finds, which takes minutes.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from dataclasses import asdict
from pathlib import Path

from .measures.tables import Table, markdown
from .processes import machine
from .report.results import code_version

PARTS = ("form_factors", "solutions", "convergence", "errors", "penumbrae", "energy", "bases", "segments")
"""Modules of ``measures``, in the order of the page."""

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "accuracy.md"
BEGIN, END = "<!-- begin of what python -m enfilade.docs.measure writes -->", "<!-- end -->"


def main(arguments: list[str]) -> int:
    """Measure what is missing, then write the page. Returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m enfilade.docs.measure", description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"only these: {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="small versions, in minutes; the page stays as it is")
    parser.add_argument("--fresh", action="store_true", help="measure again what was measured")
    given = parser.parse_args(arguments)
    if unknown := [p for p in given.parts if p not in PARTS]:
        parser.error(f"there is no part {unknown[0]}; there are {', '.join(PARTS)}")
    kept = Kept(ROOT / "out" / ("measures-quick.json" if given.quick else "measures.json"))
    for part in given.parts or PARTS:
        if given.fresh or kept.table(part) is None:
            print(f"measuring {part}", file=sys.stderr, flush=True)
            kept.keep(part, importlib.import_module(f".measures.{part}", __package__).measure(given.quick))
    tables = [table for part in PARTS if (table := kept.table(part))]
    if given.quick or len(tables) < len(PARTS):
        print(text_of(tables, machine()))
    else:
        write(PAGE, text_of(tables, machine()))
        print(f"written: {PAGE}")
    return 0


class Kept:
    """Tables in a JSON file; those of other code do not count."""

    def __init__(self, path: Path) -> None:
        self._path, self._code = path, code_version()
        self._data = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def table(self, part: str) -> Table | None:
        found = self._data.get(part)
        return Table(**found["table"]) if found and found["code"] == self._code else None

    def keep(self, part: str, table: Table) -> None:
        self._data[part] = {"code": self._code, "table": asdict(table)}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text(json.dumps(self._data, indent=1), encoding="utf-8")


def text_of(tables: list[Table], machine: dict[str, str]) -> str:
    """The table of all measures and then those of every part, as Markdown."""
    lines = [line for table in tables for line in table.lines]
    where = f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, NumPy {machine['numpy']}"
    parts = [f"## All measures\n\n{where}.\n", markdown(["measure", "asked", "found", "met"], lines) + "\n"]
    for table in tables:
        parts.append(f"## {table.title}\n\n{table.text}\n\n{markdown(table.head, table.rows)}\n")
    return "\n".join(parts)


def write(page: Path, text: str) -> None:
    """Put ``text`` between the marks of a page. Raises ValueError when it has none."""
    before, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page}: the marks {BEGIN} and {END} are missing, put them where the tables belong")
    page.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
