"""What a change does to speed, size and error: a benchmark to run before and after it.

    python -m enfilade.docs.benchmark RESULT.json [--scenes NAME ...] [--qualities NAME ...] [--runs N] [--threads N]
    python -m enfilade.docs.benchmark --compare BEFORE.json AFTER.json

Every run is a process of its own; of several runs the file keeps the median of each figure. CPU seconds hardly feel what else the
machine does, seconds do. The comparison shows every figure of both, their ratio where that matters, and marks what became worse.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from statistics import median

from .bench import NAMES
from .measures.tables import markdown
from .processes import RunError, machine, run_module
from .report.results import code_version

FIGURES = ("seconds", "cpu_seconds", "elements", "links", "segment_tests", "peak_bytes")
ERRORS = ("rmse", "p95", "dark_rmse", "dark_p95")
WORSE = {"cpu_seconds": 1.05, "elements": 1.02, "links": 1.02, "segment_tests": 1.02, "peak_bytes": 1.05} | dict.fromkeys(ERRORS, 1.02)
"""Ratios, after over before, above which a figure is marked as worse; seconds are not judged."""


def main(arguments: list[str]) -> int:
    """Measure, or compare. Returns the exit status: of a comparison 1 when something became worse."""
    parser = argparse.ArgumentParser(prog="python -m enfilade.docs.benchmark", description=__doc__.splitlines()[0])
    parser.add_argument("result", nargs="?", type=Path, metavar="RESULT.json", help="file that receives the figures")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE.json", "AFTER.json"), help="compare two such files")
    parser.add_argument("--scenes", nargs="+", choices=NAMES, default=("cornell", "two_rooms", "office"), metavar="NAME")
    parser.add_argument("--qualities", nargs="+", choices=("draft", "good", "fine"), default=("draft", "good"), metavar="NAME")
    parser.add_argument("--runs", type=int, default=3, metavar="N", help="runs of each (3)")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="threads (every core)")
    given = parser.parse_args(arguments)
    if (given.result is None) == (given.compare is None):
        parser.error("name either a file for the result or two files to --compare")
    try:
        if given.compare:
            before, after = (json.loads(path.read_text(encoding="utf-8")) for path in given.compare)
            return compare(before, after)
        measured = measure(given.scenes, given.qualities, given.runs, given.threads)
        given.result.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")
    except (OSError, ValueError, RunError) as error:
        print(f"benchmark: {error}", file=sys.stderr)
        return 2
    return 0


def measure(scenes: list[str], qualities: list[str], count: int, threads: int) -> dict:
    """Medians of the figures of every scene at every quality."""
    runs = {}
    for scene in scenes:
        for quality in qualities:
            found = [run_module("enfilade.docs.report.enfilade_run", scene, quality, threads) for _ in range(count)]
            runs[f"{scene} {quality}"] = middle = summed_up(found)
            print(f"{scene} {quality}: {middle['seconds']:.2f} s, {middle['rmse']:.2%}", file=sys.stderr, flush=True)
    return {"machine": machine() | {"threads": str(threads or "all")}, "code": code_version(), "runs": runs}


def summed_up(found: list[dict]) -> dict[str, float]:
    """The figures of several runs as medians, seconds of stages as ``stage NAME``."""
    flat = [
        {name: r[name] for name in FIGURES}
        | {name: r["score"][name] for name in ERRORS if r["score"][name] is not None}
        | {f"stage {name}": seconds for name, seconds in r["stages"].items()}
        for r in found
    ]
    return {name: median(r.get(name, 0.0) for r in flat) for name in flat[0]}


def compare(before: dict, after: dict) -> int:
    """Print both; returns 1 when something became worse, else 0."""
    if before["machine"] != after["machine"]:
        print("The results come from two machines or settings: only errors and counts can be compared.\n")
    rows, worse = compared(before["runs"], after["runs"])
    print(markdown(["run", "figure", "before", "after", "ratio", ""], rows))
    return int(worse > 0)


def compared(before: dict, after: dict) -> tuple[list[list[str]], int]:
    """Rows of the comparison, and how many of them are worse."""
    rows, worse = [], 0
    for run in [r for r in before if r in after]:
        for name, old in before[run].items():
            new = after[run].get(name)
            if new is None or not (old or new):
                continue
            ratio = new / old if old else float("inf")
            bad = ratio > WORSE.get(name, float("inf"))
            worse += bad
            rows.append([run, name, _text(name, old), _text(name, new), f"{ratio:.3f}", "worse" if bad else ""])
    return rows, worse


def _text(name: str, value: float) -> str:
    if name in ERRORS:
        return f"{value:.3%}"
    return f"{value:.3f} s" if name.startswith("stage") or "seconds" in name else f"{value:,.0f}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
