"""Errors on the bench scenes at good and at fine, with what a run takes: each run in a process of its own."""

from __future__ import annotations

from ..processes import run_module
from .tables import Table, met

ASKED = {"good": (0.03, 0.05), "fine": (0.01, 0.02)}
"""Relative root mean square error: over all points, and in rooms with no lamp."""
JUDGED = ("cornell", "two_rooms", "office")
MEMORY, BYTES_EACH = 500e6, 2000
"""Bytes at most, of ``office`` at good: in all, and for each element."""


def measure(quick: bool) -> Table:
    """Every bench scene of the tests but the building, which takes long: that one is in the report of speed."""
    rows, lines = [], []
    for quality in ("draft", "good", "fine"):
        for name in ("cornell", "two_rooms") if quick else (*JUDGED, "furnace", "hard"):
            if quick and quality == "fine":
                continue
            found = run_module("enfilade.docs.report.enfilade_run", name, quality, 0)
            rows.append(row(name, quality, found))
            if quality in ASKED and name in JUDGED:
                lines += judged(name, quality, found)
    head = ["scene", "quality", "elements", "relative RMSE", "95th percentile", "with no lamp", "95th percentile", "noise of the reference"]
    text = (
        "Irradiance at fixed points against long path-traced references: root mean square error over the points, weighed by the "
        "area that each stands "
        "for, over the mean; the 95th percentile of the error of a value over that value (or over 1 % of the mean where it is "
        "less); the same in rooms "
        "that have no lamp, where no lamp shines. *Energy accounted for* is (absorbed + escaped) / emitted, where what escapes is"
        " measured by rays "
        "that know nothing of the solution. "
        "*Bytes an element*: peak memory, that of worker processes with it, less what the process held before the solve."
    )
    return Table(
        "Errors on the bench scenes", text, [*head, "energy accounted for", "seconds", "peak memory", "bytes an element"], rows, lines
    )


def row(name: str, quality: str, found: dict) -> list[str]:
    """One line of the table."""
    score, energy = found["score"], found["energy"]
    balance = (energy["absorbed"] + energy["escaped"]) / energy["emitted"]
    errors = [percent(score[k]) for k in ("rmse", "p95", "dark_rmse", "dark_p95", "noise")]
    took = [f"{found['seconds']:.1f}", f"{found['peak_bytes'] / 1e6:,.0f} MB", f"{_bytes_each(found):,.0f}"]
    return [name, quality, f"{found['elements']:,}", *errors, f"{balance:.2%}", *took]


def judged(name: str, quality: str, found: dict) -> list[list[str]]:
    """Lines of the table of all measures."""
    score, lines = found["score"], []
    for key, what, limit in (("rmse", "relative RMSE", ASKED[quality][0]), ("dark_rmse", "relative RMSE with no lamp", ASKED[quality][1])):
        if score[key] is not None:
            lines.append([f"{name} at {quality}, {what}", f"{limit:.0%}", percent(score[key]), met(score[key] <= limit)])
    if name == "office" and quality == "good":
        lines.append(["office at good, peak memory", "500 MB", f"{found['peak_bytes'] / 1e6:,.0f} MB", met(found["peak_bytes"] <= MEMORY)])
        each = _bytes_each(found)
        lines.append(["office at good, memory for each element", "2 KB", f"{each / 1e3:.2f} KB", met(each <= BYTES_EACH)])
    return lines


def percent(x: float | None) -> str:
    """In per cent with two digits after the point, nothing for None."""
    return "" if x is None else f"{x:.2%}"


def _bytes_each(found: dict) -> float:
    return (found["peak_bytes"] - found["start_bytes"]) / found["elements"]
