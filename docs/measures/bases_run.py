"""One solve with a given basis at a quality between draft and fine, as a program of its own: prints a JSON object.

    python -m enfilade.docs.measures.bases_run SCENE ORDER STEP

STEP is 0 for draft, 1 for good, 2 for fine, anything between for tolerances between.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import fields, replace

from ...core import quality
from ...core.options import Options
from ...core.quality import Tolerances
from ...core.regions import Regions
from ..bench import Bench
from ..processes import cpu_seconds
from .witness import WAYS, light_of, solve_and_keep, tolerances

QUALITIES = ("draft", "good", "fine")


def between(step: float) -> Callable[[Tolerances, Regions], Tolerances]:
    """Tolerances at ``step``, from those of the qualities on either side."""

    def change(usual: Tolerances, regions: Regions) -> Tolerances:
        low = min(int(step), len(QUALITIES) - 2)
        sides = [_usual(Options(quality=QUALITIES[low + k]), regions) for k in (0, 1)]
        share = step - low
        values = {f.name: getattr(sides[0], f.name) ** (1 - share) * getattr(sides[1], f.name) ** share for f in fields(Tolerances)}
        return replace(usual, **values | {"rays": round(values["rays"])})

    return change


_usual = quality.tolerances


def main(name: str, order: int, step: float) -> dict:
    """CPU seconds of the solve with each way to the light at the points, memory of elements and links, and errors of each way."""
    bench = Bench(name)
    started = cpu_seconds()
    with tolerances(between(step)):
        solved = solve_and_keep(bench.scene, Options(order=order, reflected="gathered", threads=1))
    seconds, ways = cpu_seconds() - started, {}
    for way in WAYS:
        started = cpu_seconds()
        light = light_of(solved.solution, bench.scene.points, way)
        ways[way] = {"cpu_seconds": seconds + cpu_seconds() - started, "score": bench.score(light)}
    links = sum(group.nbytes for group in solved.links)
    # What every element holds of light: its coefficients, direct and reflected, and while it is shot what its nodes and all of it have
    # received, in three channels of float32.
    forest = solved.forest
    each = 12 * (3 * forest.functions + forest.node_count + 1)
    return {
        "light_bytes": links + each * len(forest),
        "elements": len(forest),
        "ways": ways,
    }


if __name__ == "__main__":
    scene, order, step = sys.argv[1:]
    print(json.dumps(main(scene, int(order), float(step))), flush=True)
