"""Write the table of hard cases in docs/hard_cases.md: ``python -m enfilade.docs.make_hard_cases``."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE / "hard_cases.md"
BEGIN, END = "<!-- table -->\n", "<!-- end of the table -->\n"


def table() -> str:
    """All cases of ``tests/core/hard_cases.py``, solved for every basis, as a Markdown table."""
    sys.path.insert(0, str(HERE.parent / "tests" / "core"))
    from hard_cases import CASES  # the scenes of the tests are not part of the package

    lines = ["| case | property | tolerance | M1 | M2 | M3 | |", "|---|---|---|---|---|---|---|"]
    for case in CASES:
        figures = [case.figure(order) for order in (1, 2, 3)]
        verdict = "holds" if max(figures) <= case.limit else f"does not hold: {case.fault}"
        lines.append("| " + " | ".join([case.name, case.property, *map(_number, [case.limit, *figures]), verdict]) + " |")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return "0" if value == 0 else f"{value:.2g}"


def main() -> None:
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(before + BEGIN + table() + END + rest.partition(END)[2], encoding="utf-8")
    print(f"written: {PAGE}")


if __name__ == "__main__":
    main()
