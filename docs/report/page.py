"""The report as a page of Markdown."""

from __future__ import annotations

from collections.abc import Iterable

from .curves import Point, best_of, curves, time_to
from .plan import LEVELS, Setting
from .results import Results

HEAD = """\
# Speed against error, beside Cycles

`make report` makes this page on your machine, with nothing but what the repository holds and PyPI has. Enfilade at its qualities
and the bake of Cycles, which a user of Blender would take instead, run on the scenes of `tests/data/bench`, one after another,
each in a process of its own, on the processor alone and with the same number of threads. The light is compared at the same points
of the surfaces with long path-traced references.

{machine}

* *Error*: root mean square over the points, weighed by the area that each stands for, over the mean irradiance. *No lamp*: in
  rooms without a lamp of their own, where no lamp shines straight, over the mean there.
* *Seconds* of Enfilade run from the scene in memory to the light at the points, all stages; those of Cycles are the bake alone.
* *Memory* is the most that the processes of a run held. A process with Blender loaded and nothing in it holds some 280 MB; Enfilade ran
  without Blender.
* Figures are medians of {runs}. In the pictures the dotted line is the noise of the reference.

## How Cycles was set

The processor alone, 64 diffuse bounces, no clamping, no adaptive sampling, the light tree, lamps sampled from their front. Path
guiding was tried and left more noise in the same time. Three ways:

* *Irradiance at the points*: a tiny white face over every point has a texel of its own. No user bakes like that, but no texture or mesh
  stands between the samples and the points: for the time that it takes it is the most exact that Cycles can do.
* *Vertex colours* of the scene cut into triangles with edges of at most 0.35 m, read between their corners.
* *Light map*: coplanar faces in charts, read between texels; also through OpenImageDenoise, which Blender has as a node of
  its compositor, its time added.
"""

RATIOS = """\
## Time to an error

Seconds to come down to an error, between two settings on a straight line of logarithms. `<`: the fastest setting is better
already. `~`: Cycles at the points beyond its largest number of samples, where noise falls with the root of the time. A dash: not
reached by any setting, nor by more samples where the error of the last ones was no longer mostly noise. Of Cycles the way that is
first. The reference is itself a sampled one: an error of less than its noise cannot be measured, on `building` {noise}.
"""

STAGES = """\
## Where the time goes

Seconds by stage, one run. *Evaluate* is the light at the points of the table above, with the final gathering.
"""


def page(results: Results, plan: list[Setting], images: dict[str, str]) -> str:
    """The whole page; ``images`` names the picture of each scene."""
    scenes = list(dict.fromkeys(s.scene for s in plan))
    found = {scene: lines for scene in scenes if (lines := curves(results, plan, scene))}
    runs = {p.runs for lines in found.values() for points in lines.values() for p in points}
    count = f"{min(runs)} runs" if len(runs) == 1 and min(runs) > 1 else "one run" if runs == {1} else f"{min(runs)} to {max(runs)} runs"
    noise = next((f"{p[0].score['noise']:.1%} over all and {p[0].score['dark_noise']:.1%} without lamps"
                  for p in found.get("building", {}).values()), "it was not run")  # fmt: skip
    parts = [HEAD.format(machine=_machine(results, found), runs=count)]
    parts += [RATIOS.format(noise=noise), _ratios(found, "rmse", "over all points")]
    if dark := {scene: lines for scene, lines in found.items() if _first(lines).score["dark_rmse"] is not None}:
        parts.append(_ratios(dark, "dark_rmse", "in rooms with no lamp"))
    for scene, lines in found.items():
        parts.append(f"## {scene}\n")
        if scene in images:
            parts.append(f"![time against error on {scene}]({images[scene]})\n")
        parts.append(_runs(lines))
    if any("Enfilade" in lines for lines in found.values()):
        parts += [STAGES, _stages(found)]
    return "\n".join(parts).rstrip() + "\n"


def _first(lines: dict[str, list[Point]]) -> Point:
    return next(iter(lines.values()))[0]


def _machine(results: Results, found: dict) -> str:
    m = results.machine
    blender = {p.last["blender"] for lines in found.values() for points in lines.values() for p in points if "blender" in p.last}
    with_blender = f", Blender {', '.join(sorted(blender))}" if blender else ""
    machine = f"Machine: {m['processor']}, {m['cores']} cores, {m['system']}; {m['threads']} threads"
    return f"{machine}; Python {m['python']}, NumPy {m['numpy']}{with_blender}; Enfilade {m['enfilade']}."


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    head = list(head)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows]) + "\n"


def _ratios(found: dict[str, dict[str, list[Point]]], error: str, where: str) -> str:
    rows = []
    for scene, lines in found.items():
        for level in LEVELS:
            own = time_to(lines["Enfilade"], level, error, noisy=False) if "Enfilade" in lines else None
            other = best_of(lines, level, error)
            cells = [_sign(own), _sign(other[1]) if other else "-", other[0].removeprefix("Cycles, ") if other else ""]
            ratio = f"{_number(other[1].seconds / own.seconds)} times" if own and other else "-"
            rows.append([scene, f"{level:.0%}", *cells, ratio])
    return table([where, "error", "Enfilade, s", "Cycles, s", "its way", "Enfilade is faster"], rows)


def _sign(reached) -> str:
    if reached is None:
        return "-"
    return {"within": "< ", "between": "", "beyond": "~ "}[reached.how] + _number(reached.seconds)


def _number(x: float) -> str:
    """Two digits at least, no more decimals than that takes."""
    return f"{x:,.0f}" if x >= 10 else f"{x:.1f}" if x >= 1 else f"{x:.2f}"


def _percent(x: float | None) -> str:
    return "" if x is None else f"{x:.2%}" if x < 0.1 else f"{x:.0%}"


def _runs(lines: dict[str, list[Point]]) -> str:
    rows = []
    for name, points in lines.items():
        for p in points:
            size = p.last.get("size", f"{p.last['elements']:,} elements" if "elements" in p.last else "")
            score = [_percent(p.score[k]) for k in ("rmse", "p95", "dark_rmse", "dark_p95")]
            took = [_number(p.seconds), _number(p.cpu_seconds), f"{p.peak_bytes / 1e6:,.0f} MB", str(p.runs)]
            rows.append([name, p.label, size, *score, *took])
    head = [
        "",
        "setting",
        "size",
        "error",
        "95th percentile",
        "no lamp: error",
        "95th percentile",
        "seconds",
        "CPU seconds",
        "memory",
        "runs",
    ]
    return table(head, rows)


def _stages(found: dict[str, dict[str, list[Point]]]) -> str:
    points = [(scene, p) for scene, lines in found.items() for p in lines.get("Enfilade", [])]
    names = list(dict.fromkeys(name for _, p in points for name in p.last["stages"]))
    rows = []
    for scene, p in points:
        last = p.last
        seconds = [_number(last["stages"].get(name, 0.0)) for name in names]
        rows.append([scene, p.label, f"{last['elements']:,}", f"{last['links']:,}", _number(last["segment_tests"] / 1e6), *seconds])
    return table(["scene", "quality", "elements", "links", "segment tests, million", *names], rows)
