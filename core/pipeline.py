"""The front door: a scene goes in, a solution comes out, stage after stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import clustering, escape, footprints, illumination, links, occlusion, ordering, quality, refinement, regions, visibility_graph
from .building import Building, doors_of, items_of
from .elements import Forest
from .light_sources import light_sources
from .options import OptionError, Options
from .parallel import Crew, worker_count
from .report import emitted_power, report_of
from .scene import Scene
from .shooting import Radiosity, Shooter, Shot
from .solution import Solution
from .stage_files import save_stage


@dataclass(frozen=True)
class Progress:
    """Where a solve is: the stage, the share of the whole run that is done (0..1), and a line for people.

    so_far : makes a solution of the light as it is, of the elements alone; to be called before the next step, None where there is none
    """

    stage: str
    fraction: float
    message: str
    so_far: Callable[[], Solution] | None = field(default=None, compare=False, repr=False)


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


def run(scene: Scene, options: Options) -> Generator[Progress, None, Solution]:
    """Solve a scene step by step; closing the generator cancels the run and leaves nothing behind.

    Raises :class:`OptionError` when the memory budget is exceeded and there is no store, OSError when the store cannot be written.
    """
    clock, store = _Clock(), _Store(options.store)
    crew, rng = Crew(worker_count(options.threads)), np.random.default_rng(options.seed)

    building, findings = yield from _build(scene, options, rng, clock, store)
    surfaces = building.regions
    limits = quality.tolerances(options, surfaces)
    forest, lamps = Forest(surfaces, options.order), light_sources(building, scene.lamps, scene.portals)
    first_shots = illumination.illuminate(building, forest, lamps, limits.direct, limits.min_size, crew)
    light, room, shadow_tests = yield from _follow(first_shots, 0.06, 0.2, lambda: "Light of the luminaires")

    def so_far(reflected: np.ndarray) -> Solution:
        return Solution(scene, building, forest, lamps, light, reflected, 0, limits.min_size / 2, crew, {})

    yield Progress("solve", 0.2, "Light of the luminaires", lambda: so_far(np.zeros_like(light)))
    estimate = _estimate(building, forest, light, room, limits.exchange)
    oracle = refinement.link(building, forest, estimate, limits.min_size, crew)
    linking = yield from _follow(oracle, 0.2, 0.7, lambda: f"Linking {len(forest):,} elements")
    exchanges = _within(options, linking.links, store)
    light = illumination.extended(forest, light)

    lost = escape.lost_share(building, forest, crew)
    closed = lost <= escape.LEAK
    gain = links.closing_gain(forest, exchanges, closed[surfaces.room[forest.region]])
    clusters, by_cluster = building.clusters, options.emitters == "clusters"
    unit, units = (np.arange(len(clusters)), len(clusters)) if by_cluster else (clusters.room, scene.room_count)
    of_element = unit[clusters.cluster_of[forest.region]]
    shooter = Shooter(forest, exchanges, of_element, units, light, gain, emitted_power(building))
    yield Progress("solve", 0.7, f"Ordering {units:,} emitters")
    sets = ordering.visible_sets(building.graph, clusters.polygons, unit, units)
    strategy = ordering.STRATEGIES[options.ordering](sets)
    radiosity = yield from _shoot(
        shooter.run(strategy, rng, limits.unshot, options.max_iterations), limits.unshot, lambda: so_far(shooter.so_far())
    )
    clock.lap("solve")

    irradiance = light + radiosity.irradiance
    escaped = escape.escaped_power(building, forest, irradiance, lost, crew)
    report = report_of(scene.polygon_count, building, forest, linking, radiosity, irradiance, lost, closed, escaped)
    report |= {"shadow_tests": shadow_tests, "warnings": list(findings), "seconds": clock.seconds}
    rays = 0 if options.reflected == "elements" else limits.rays
    solution = Solution(scene, building, forest, lamps, light, radiosity.irradiance, rays, limits.min_size / 2, crew, report)
    store.keep("light", solution.light)
    return solution


def _build(scene: Scene, options: Options, rng: np.random.Generator, clock: _Clock, store: _Store):
    """Regions, clusters and their visibility graph, and the warnings of the graph."""
    yield Progress("merge", 0.0, "Merging coplanar polygons")
    surfaces = regions.merge(scene)
    blockers = occlusion.blockers_of(surfaces)
    surfaces = footprints.uncover(surfaces, blockers)
    store.keep("regions", surfaces)
    clock.lap("merge")

    yield Progress("cluster", 0.02, f"Clustering {len(surfaces):,} surfaces")
    items = items_of(surfaces)
    clusters = clustering.cluster_as_chosen(items, scene.room_count, options, rng)
    store.keep("clusters", clusters)
    clock.lap("cluster")

    yield Progress("graph", 0.04, f"Visibility of {len(clusters):,} clusters")
    graph, findings = visibility_graph.build_as_chosen(clusters, items, scene.portals, scene.room_names, options)
    store.keep("graph", graph)
    clock.lap("graph")
    return Building(surfaces, blockers, clusters, graph, doors_of(scene.portals, surfaces.centre), scene.room_count), findings


def _follow(steps: Iterator, start: float, end: float, message: Callable[[], str]):
    """Progress from ``start`` to ``end`` while a stage yields shares of its work; returns the result that it yields last."""
    for step in steps:
        if not isinstance(step, float):
            return step
        yield Progress("solve", start + (end - start) * step, message())
    raise RuntimeError("a stage ended without a result")


def _shoot(steps: Iterator[Shot | Radiosity], tolerance: float, so_far: Callable[[], Solution]):
    for step in steps:
        if isinstance(step, Radiosity):
            return step
        message = f"Iteration {step.iteration + 1}: {step.unshot_fraction:.2%} unshot"
        yield Progress("solve", 0.7 + 0.3 * _share(step, tolerance), message, so_far)
    raise RuntimeError("the shooting ended without a result")


def _within(options: Options, exchanges: list[links.LinkSet], store: _Store) -> list[links.LinkSet]:
    """The links with as many exchanges in memory as the budget allows."""
    size = sum(group.exchange.nbytes for group in exchanges)
    if not options.memory or size <= options.memory:
        return exchanges
    if not options.store:
        raise OptionError(
            f"option memory: the exchanges take {size / 1e6:.1f} MB, more than the {options.memory / 1e6:.1f} MB allowed; "
            "name a folder for the rest with the option store"
        )
    return links.spill(exchanges, options.memory, store.folder)


def _estimate(building: Building, forest: Forest, light: np.ndarray, room: np.ndarray, exchange: float) -> refinement.Estimate:
    """What the oracle goes by: ``light`` (E, m, 3) of the luminaires, and the mean irradiance of each ``room`` (R, 3)."""
    wall = np.bincount(building.regions.room, building.regions.area, minlength=len(room))
    limit = exchange * room.max(1) * np.sqrt(wall)
    return refinement.Estimate(*illumination.exitance_estimate(forest, light, room), limit[building.regions.room])


def _share(shot: Shot, tolerance: float) -> float:
    """How much of the shooting is done, from the fall of the unshot part to its tolerance."""
    if shot.unshot_fraction <= tolerance:
        return 1.0
    return float(np.clip(np.log(max(shot.unshot_fraction, 1e-12)) / np.log(tolerance), 0, 1)) if shot.unshot_fraction < 1 else 0.0


class _Store:
    """The folder that receives the result of every stage, if the user named one."""

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)
        self._wanted = bool(folder)
        if folder:
            self.folder.mkdir(parents=True, exist_ok=True)

    def keep(self, stage: str, result: object) -> None:
        if self._wanted:
            save_stage(result, self.folder / f"{stage}.npz")


class _Clock:
    """Wall seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now
