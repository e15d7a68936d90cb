"""The front door: a scene goes in, a solution comes out, stage after stage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import replace

import numpy as np

from . import escape, links, ordering, quality, stages
from .elements import Forest
from .emitters import emitters_of
from .glass import dimmed_rooms
from .lamp_power import entered_power, idle_lamps, lamp_power
from .light_sources import light_sources
from .lightings import lightings_of
from .options import Options
from .progress import Progress, TimeLeft
from .report import emitted_power, report_of
from .scene import Scene
from .shooting import RELAXATION, Radiosity, Shooter, summed
from .solution import Contribution, Solution
from .store import Space
from .workspace import Workspace, workspace

__all__ = ["Progress", "run", "solve"]

PARTS = ("light", "link", "shoot")
"""What the seconds of solving are made of."""


def solve(scene: Scene, options: Options, progress: Callable[[Progress], None] | None = None) -> Solution:
    """Solve a scene from start to end; ``progress`` is told of every step."""
    steps = run(scene, options)
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            return end.value
        if progress:
            progress(step)
        del step  # it holds the light of that moment


def run(scene: Scene, options: Options) -> Generator[Progress, None, Solution]:
    """Solve a scene step by step; closing the generator cancels the run, and leaves nothing behind but what is in the store.

    A run with the store of one that did not end, of the same scene and options, goes on where that was and ends with the same bits.
    Raises :class:`OptionError` when the memory budget is exceeded and there is no store, or the store cannot be used.
    """
    time_left = TimeLeft()
    with workspace(scene, options) as desk, closing(_steps(scene, options, desk)) as steps:
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                return end.value
            desk.space.breathe()
            yield replace(step, remaining=time_left.after(step.fraction))
            del step  # it holds the light of that moment


def _steps(scene: Scene, options: Options, desk: Workspace) -> Generator[Progress, None, Solution]:
    space, clock, rng = desk.space, desk.clock, np.random.default_rng(options.seed)
    building, findings = yield from stages.build(scene, options, rng, desk)
    surfaces = building.regions
    limits = quality.tolerances(options, surfaces)
    lamps = light_sources(building, scene.lamps, scene.portals)

    def so_far(forest: Forest, light: np.ndarray, reflected: np.ndarray) -> Solution:
        return Solution(scene, building, forest, lamps, light, reflected, 0, limits.min_size / 2, desk.crew, {})

    linked = stages.linked_before(building, options, desk)
    if linked is None:
        lit = yield from stages.illuminate(building, lamps, limits, options, desk)
        yield Progress("solve", 0.2, "Light of the luminaires", lambda: so_far(lit.forest, lit.light, np.zeros_like(lit.light)))
        linked = yield from stages.link(building, lit, limits, desk)
        del lit
    forest, light, lost = linked.forest, linked.light, linked.lost

    closed = (lost <= escape.LEAK) & ~dimmed_rooms(building)
    clusters, by_cluster = building.clusters, options.emitters == "clusters"
    unit, units = (np.arange(len(clusters)), len(clusters)) if by_cluster else (clusters.room, scene.room_count)
    emitters = emitters_of(forest, unit[clusters.cluster_of[forest.region]], units, space.zeros)
    kept = np.where(closed, 1 - lost, 0).astype(np.float32)[surfaces.room[forest.region]]
    gains = links.closing_gains(forest, linked.links, kept, emitters, space.zeros, space.breathe)
    yield Progress("solve", 0.7, f"Ordering {units:,} emitters")
    sets = ordering.visible_sets(building.graph, clusters.polygons, unit, units)
    routes = stages.routes_of(linked.links, emitters, space)
    linked = replace(linked, links=[])  # those that the routes do not need may go
    rooms = clusters.room if by_cluster else np.arange(units)
    parts, shots, emitted, disk = [], [], 0.0, Counter()
    lightings = lightings_of(scene, building, lamps)
    for k, one in enumerate(lightings):
        turn = stages.Turn(k, len(lightings), one.name)
        first = (yield from stages.light_of_group(building, linked, one.kinds, turn, desk)) if one.name else light
        power = emitted_power(one.building) + lamp_power(one.scene.lamps)
        power += entered_power(one.building, forest, one.kinds, first, desk.crew)
        strategy = ordering.STRATEGIES[options.ordering](sets)
        # A room lights itself: what it shoots too much comes back at once.
        most = RELAXATION if by_cluster else 1.0
        shooter = Shooter(forest, routes, emitters, rooms, first, gains, power, space, most)
        if one is lightings[-1]:
            del routes  # the shooter alone knows when they can go

        def preview(shooter: Shooter = shooter, before: tuple[Radiosity, ...] = tuple(shots)) -> Solution:
            return so_far(forest, light, sum((shot.irradiance for shot in before), shooter.so_far()))

        shots.append((yield from stages.shoot(shooter, strategy, rng, limits.unshot, options, desk, preview, turn)))
        parts.append(Contribution(one.kinds, first, shots[-1].irradiance))
        emitted += power
        disk.update(shooter.disk())
    del shooter, preview, gains, emitters  # what follows takes memory of its own
    radiosity = summed(shots)
    clock.seconds["solve"] = sum(clock.seconds[part] for part in PARTS)

    irradiance = _added(light, radiosity.irradiance, space)
    space.release()
    escaped = escape.escaped_power(building, forest, irradiance, lost, desk.crew)
    report = report_of(scene.polygon_count, building, forest, linked, radiosity, irradiance, closed, emitted, escaped)
    warnings = findings + idle_lamps(building, scene.lamps, lamps)
    if radiosity.growing >= 0:
        warnings.append(
            f"the light in room '{scene.room_names[radiosity.growing]}' grew from shot to shot, and the shooting was given up: "
            "look for surfaces that reflect nearly all light, or set a finer quality"
        )
    report |= {"shadow_tests": linked.shadow_tests, "warnings": warnings, "disk": dict(disk)}
    report["solve_seconds"] = {part: clock.seconds.pop(part) for part in PARTS}
    report["seconds"] = clock.seconds
    rays = 0 if options.reflected == "elements" else limits.rays
    groups = tuple(parts) if scene.groups is not None else ()
    solution = Solution(scene, building, forest, lamps, light, radiosity.irradiance, rays, limits.min_size / 2, desk.crew, report, groups)
    space.release()
    desk.store.keep("light", solution.light)
    return solution


def _added(light: np.ndarray, other: np.ndarray, space: Space) -> np.ndarray:
    """The sum of two arrays of one shape, where there is room for it."""
    out = space.zeros(light.shape, light.dtype)
    for low in range(0, len(out), links.BLOCK):
        here = slice(low, low + links.BLOCK)
        np.add(light[here], other[here], out=out[here])
        space.breathe()
    return out
