"""One solve by Enfilade, as a program of its own: prints a JSON object.

    python -m enfilade.docs.report.enfilade_run SCENE QUALITY THREADS

The seconds run from the scene in memory to the light at its points.
"""

from __future__ import annotations

import json
import sys
import time

from ...core.options import Options
from ...core.pipeline import solve
from ..bench import Bench
from ..processes import cpu_seconds, own_peak_bytes


def main(name: str, quality: str, threads: int) -> dict:
    """Seconds by stage, what was made, and errors; ``start_bytes`` is the memory before the solve, with the scene in it."""
    bench, start_bytes = Bench(name), own_peak_bytes()
    started, cpu = time.perf_counter(), cpu_seconds()
    solution = solve(bench.scene, Options(quality=quality, threads=threads))
    solved = time.perf_counter()
    light = solution.irradiance(bench.scene.points.position, bench.scene.points.polygon)
    done = time.perf_counter()
    report = solution.report
    return {
        "seconds": done - started,
        "cpu_seconds": cpu_seconds() - cpu,
        "stages": {**_stages(report), "evaluate": done - solved},
        "elements": report["elements"],
        "links": report["links"],
        "segment_tests": report["segment_tests"],
        "energy": report["energy"],
        "clamped_values": report["clamped_values"],
        "score": bench.score(light),
        "peak_bytes": own_peak_bytes(),
        "start_bytes": start_bytes,
    }


def _stages(report: dict) -> dict[str, float]:
    """Seconds by stage, the parts of solving in place of their sum."""
    return {k: v for k, v in report["seconds"].items() if k != "solve"} | report["solve_seconds"]


if __name__ == "__main__":
    scene, quality, threads = sys.argv[1:]
    print(json.dumps(main(scene, quality, int(threads))), flush=True)
