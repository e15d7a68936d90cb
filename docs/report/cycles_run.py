"""One bake by Cycles, as a program of its own: prints a JSON object.

    python -m enfilade.docs.report.cycles_run SCENE points|vertices|texels SAMPLES FINENESS THREADS

FINENESS is the longest edge in metres for ``vertices``, texels per metre for ``texels``. The seconds are those of the bake alone:
building the scene in Blender and reading the result back are not counted.
"""

from __future__ import annotations

import json
import sys
import time

import bpy

from ..bench import Bench
from ..processes import cpu_seconds, own_peak_bytes
from . import cycles_scene


def main(name: str, way: str, samples: int, fineness: float, threads: int) -> dict:
    """Seconds and errors of one bake, and of the denoised one where there is an image."""
    bench = Bench(name)
    cycles_scene.prepare(samples, threads)
    if way == "points":
        cycles_scene.add_building(bench.scene)
        receiver = cycles_scene.at_points(bench.scene)
    else:
        receiver = {"vertices": cycles_scene.in_vertex_colours, "texels": cycles_scene.in_light_map}[way](bench.scene, fineness)
    bpy.context.view_layer.objects.active = receiver.object
    receiver.object.select_set(True)
    started, cpu = time.perf_counter(), cpu_seconds()
    bpy.ops.object.bake(
        type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, target=receiver.target, margin=receiver.margin, margin_type="EXTEND"
    )
    out = {
        "seconds": time.perf_counter() - started,
        "cpu_seconds": cpu_seconds() - cpu,
        "size": receiver.size,
        "score": bench.score(receiver.read()),
        "blender": bpy.app.version_string,
        "peak_bytes": own_peak_bytes(),
    }
    if receiver.smoothed:
        started, cpu = time.perf_counter(), cpu_seconds()
        light = receiver.smoothed()
        out["denoised"] = {
            "seconds": out["seconds"] + time.perf_counter() - started,
            "cpu_seconds": out["cpu_seconds"] + cpu_seconds() - cpu,
            "score": bench.score(light),
        }
    return out


if __name__ == "__main__":
    scene, way, samples, fineness, threads = sys.argv[1:]
    print(json.dumps(main(scene, way, int(samples), float(fineness), int(threads))), flush=True)
