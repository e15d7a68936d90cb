"""``python -m enfilade.docs.scaling``: time and memory over smaller siblings of a scene, and the exponents fitted to them.

Every solve runs in a process of its own. What is finished is kept in the folder, and ``scaling.md`` is written anew after every solve.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arguments import parse_size
from .processes import machine, run_module
from .tables import SCENES, cells, kept, write_whole

STAGES = ("merge", "cluster", "graph", "light", "link", "shoot")
MEASURES: dict[str, Callable[[dict[str, Any]], float]] = {
    "elements": lambda r: r["report"]["elements"],
    "links": lambda r: r["report"]["links"],
    **{f"{name}, s": lambda r, name=name: (r["report"]["seconds"] | r["report"]["solve_seconds"])[name] for name in STAGES},
    "in all, s": lambda r: sum(r["report"]["seconds"].values()),
    "peak, MB": lambda r: (r["peak_bytes"] - r["base_bytes"]) / 1e6,
}
"""What is measured of a solve. The peak is that of the process and its workers together, above the interpreter."""


def fitted(size: Sequence[float], value: Sequence[float]) -> float:
    """The exponent k of value = c * size**k, least squares of the logarithms; not a number for fewer than two sizes or a value of 0."""
    if len(set(size)) < 2 or min(value) <= 0:
        return float("nan")
    x, y = np.log(np.asarray(size, float)), np.log(np.asarray(value, float))
    return float(((x - x.mean()) * (y - y.mean())).sum() / ((x - x.mean()) ** 2).sum())


def main(argv: Sequence[str]) -> int:
    """Solve the siblings, smallest first, and write the table."""
    parser = argparse.ArgumentParser(prog="enfilade.docs.scaling", description=__doc__)
    parser.add_argument("--out", metavar="FOLDER", type=Path, required=True, help="folder for scaling.md and all figures")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=["test_scene"], help="scenes to solve [test_scene]")
    scales = [Fraction(1, 27), Fraction(1, 8), Fraction(1, 2), Fraction(1)]
    parser.add_argument("--scales", nargs="+", type=Fraction, default=scales, help="parts of the rooms and polygons [1/27 1/8 1/2 1]")
    parser.add_argument("--quality", choices=("draft", "good", "fine"), default="good", help="target error of the light [good]")
    parser.add_argument("--memory", type=parse_size, default=0, help="budget; what does not fit goes to a store in the folder [none]")
    parser.add_argument("--threads", type=int, default=0, help="workers; 0 uses every core [0]")
    parser.add_argument("--seed", type=int, default=1, help="seed of the scenes [1]")
    given = parser.parse_args(argv)
    given.out.mkdir(parents=True, exist_ok=True)
    results: dict[str, dict[Fraction, dict[str, Any]]] = {scene: {} for scene in given.scenes}
    for scale in sorted(given.scales):
        for scene in given.scenes:
            results[scene][scale] = _solved(given, scene, scale)
            write_whole(given.out / "scaling.md", "\n".join(_markdown(results, given)) + "\n")
    return 0


def _solved(given: Any, scene: str, scale: Fraction) -> dict[str, Any]:
    name = f"scaling-{scene}-{str(scale).replace('/', '-')}"
    settings = {key: getattr(given, key) for key in ("quality", "threads", "seed", "memory")}
    result = kept(given.out / f"{name}.json", settings)
    if result is None:
        options = {"quality": given.quality, "threads": given.threads, "memory": given.memory}
        if given.memory:
            options["store"] = str(given.out / f"store-{name}")
        found = run_module("enfilade.docs.tables_row", scene, float(scale), given.seed, json.dumps(options), err=sys.stderr)
        result = found | {"settings": settings}
        write_whole(given.out / f"{name}.json", json.dumps(result, indent=1))
    return result


def _markdown(results: dict[str, dict[Fraction, dict[str, Any]]], given: Any) -> Iterator[str]:
    here = machine()
    budget = f", budget {given.memory / 1e6:.0f} MB" if given.memory else ""
    yield f"Quality {given.quality}{budget}; {here['cores']} cores of {here['processor']}."
    for scene, rows in results.items():
        yield f"\n## {SCENES[scene]}\n"
        yield cells("scale", "polygons", *MEASURES)
        yield "|---" * (2 + len(MEASURES)) + "|"
        polygons = [result["report"]["polygons"] for result in rows.values()]
        for (scale, result), number in zip(rows.items(), polygons, strict=True):
            yield cells(str(scale), f"{number:,}", *(_figure(pick(result)) for pick in MEASURES.values()))
        exponents = [fitted(polygons, [pick(result) for result in rows.values()]) for pick in MEASURES.values()]
        yield cells("exponent", "", *("" if np.isnan(k) else f"{k:.2f}" for k in exponents))


def _figure(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
