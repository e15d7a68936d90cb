"""Speed against error beside Cycles, as a page with pictures: ``make report``.

    python -m enfilade.docs.report [--quick] [--runs N] [--scenes NAME ...] [--tools NAME ...] [--fresh] [--page-only]

Every result is kept at once (out/report.json): stop it with Ctrl-C and start it again, it goes on where it was. All settings run once
before any runs twice. The page and its pictures go to docs/, those of a quick report to out/report/.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tomllib
from pathlib import Path

from ...core.parallel import worker_count
from ..processes import RunError, machine
from . import page as pages
from .curves import curves
from .plan import Setting, settings
from .results import Results, run

ROOT = Path(__file__).resolve().parents[2]


def main(arguments: list[str]) -> int:
    """Run what is missing, then write the page. Returns the exit status."""
    parser = argparse.ArgumentParser(prog="make report", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few settings of two scenes, once, into out/report/")
    parser.add_argument("--runs", type=int, default=0, metavar="N", help="runs of every setting (3; quick: 1)")
    parser.add_argument("--scenes", nargs="+", default=(), metavar="NAME", help="only these scenes")
    parser.add_argument("--tools", nargs="+", default=(), choices=("enfilade", "cycles"), metavar="NAME", help="only enfilade or cycles")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="threads of both (every core)")
    parser.add_argument("--fresh", action="store_true", help="forget the results that are there")
    parser.add_argument("--page-only", action="store_true", help="run nothing, write the page from the results that are there")
    given = parser.parse_args(arguments)
    plan = settings(given.quick, given.scenes, given.tools)
    if not plan:
        parser.error(f"no setting has all of scenes {', '.join(given.scenes)} and tools {', '.join(given.tools) or 'of any name'}")
    needed = ("matplotlib", *(("bpy",) if any(s.tool == "cycles" for s in plan) and not given.page_only else ()))
    if missing := [name for name in needed if importlib.util.find_spec(name) is None]:
        print(f"report: the Python package {missing[0]} is missing; install it, or let make report do so", file=sys.stderr)
        return 2
    threads = worker_count(given.threads)
    store = ROOT / "out" / ("report-quick.json" if given.quick else "report.json")
    if given.fresh:
        store.unlink(missing_ok=True)
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    try:
        results = Results(store, machine() | {"threads": str(threads), "enfilade": version})
    except ValueError as error:
        print(f"report: {error}", file=sys.stderr)
        return 2
    failed = [] if given.page_only else _run_all(results, plan, given.runs or (1 if given.quick else 3), threads)
    whole = settings(given.quick)
    if any(results.of(s) for s in whole):
        _write(results, whole, ROOT / "out" / "report" if given.quick else ROOT / "docs")
    return 1 if failed else 0


def _run_all(results: Results, plan: list[Setting], count: int, threads: int) -> list[Setting]:
    """Run every setting ``count`` times, less what is there already; returns those that failed."""
    failed: list[Setting] = []
    for turn in range(count):
        for k, setting in enumerate(plan):
            if len(results.of(setting)) > turn or setting in failed:
                continue
            print(f"run {turn + 1} of {count}, {k + 1} of {len(plan)}: {setting.key}", end=" ", flush=True)
            try:
                result = run(setting, threads)
            except RunError as error:
                failed.append(setting)
                print(f"failed: {error}", flush=True)
                continue
            results.add(setting, result)
            print(f"{result['seconds']:.1f} s, {result['score']['rmse']:.2%}", flush=True)
    return failed


def _write(results: Results, plan: list[Setting], folder: Path) -> None:
    """The page ``speed.md`` and its pictures."""
    from . import plots

    images = {}
    for scene in dict.fromkeys(s.scene for s in plan):
        if lines := curves(results, plan, scene):
            images[scene] = f"images/speed-{scene}.png"
            plots.draw(scene, lines, folder / images[scene])
    (folder / "speed.md").write_text(pages.page(results, plan, images), encoding="utf-8")
    print(f"written: {folder / 'speed.md'}")


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("\nreport: stopped; start it again to go on", file=sys.stderr)
        sys.exit(130)
