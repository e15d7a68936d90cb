"""The front door: a scene goes in, a solution comes out, stage after stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from . import (
    clustering,
    direct,
    escape,
    footprints,
    illumination,
    links,
    occlusion,
    ordering,
    quality,
    refinement,
    regions,
    visibility_graph,
)
from .building import Building, doors_of
from .elements import Forest
from .options import Options
from .parallel import worker_count
from .scene import Scene
from .shooting import Shooter, Shot
from .solution import Solution


@dataclass(frozen=True)
class Progress:
    """Where a solve is: the stage, the share of the whole run that is done (0..1), and a line for people."""

    stage: str
    fraction: float
    message: str


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
    """Solve a scene step by step; closing the generator cancels the run and leaves nothing behind."""
    clock = _Clock()
    workers = worker_count(options.threads)
    rng = np.random.default_rng(options.seed)

    yield Progress("merge", 0.0, "Merging coplanar polygons")
    surfaces = regions.merge(scene)
    blockers = occlusion.blockers_of(surfaces)
    surfaces = footprints.uncover(surfaces, blockers)
    clock.lap("merge")

    yield Progress("cluster", 0.02, f"Clustering {len(surfaces)} surfaces")
    items = items_of(surfaces)
    clusters = clustering.cluster_items(
        items,
        scene.room_count,
        average=options.average,
        distance=clustering.DISTANCE_FUNCTIONS[options.distance],
        large_polygon=options.large_polygon,
        rng=rng,
    )
    clock.lap("cluster")

    yield Progress("graph", 0.04, f"Visibility of {len(clusters)} clusters")
    graph, _findings = visibility_graph.build(clusters, scene.portals, scene.room_names)
    building = Building(surfaces, blockers, clusters, graph, doors_of(scene.portals, surfaces.centre), scene.room_count)
    clock.lap("graph")

    limits = quality.tolerances(options, surfaces)
    forest = Forest(surfaces, options.order)
    tests = 0
    lamps = direct.luminaires_of(surfaces)
    for step in illumination.illuminate(building, forest, lamps, limits.direct, limits.min_size, workers):
        if isinstance(step, float):
            yield Progress("solve", 0.06 + 0.14 * step, "Light of the luminaires")
        else:
            light, room, tests = step
    estimate = refinement.Estimate(
        *illumination.exitance_estimate(forest, light, room),
        (limits.exchange * room.max(1) * np.sqrt(np.bincount(surfaces.room, surfaces.area, minlength=len(room))))[surfaces.room],
    )
    for step in refinement.link(building, forest, estimate, limits.min_size, workers):
        if isinstance(step, float):
            yield Progress("solve", 0.2 + 0.5 * step, f"Linking {len(forest)} elements")
        else:
            linking = step
    tests += linking.segment_tests
    first = _extended(forest, light)
    emitted = (surfaces.emission * (surfaces.area * ~surfaces.buried)[:, None]).sum(0)
    unit_of_region = clusters.cluster_of if options.emitters == "clusters" else surfaces.room
    units = len(clusters) if options.emitters == "clusters" else scene.room_count
    lost = escape.lost_share(building, forest, workers)
    closed = lost <= escape.LEAK
    gain = links.closing_gain(forest, linking.links, closed[surfaces.room[forest.region]])
    shooter = Shooter(forest, linking.links, unit_of_region[forest.region], units, first, gain, float(emitted.sum()))
    for step in shooter.run(ordering.STRATEGIES[options.ordering], rng, limits.unshot, options.max_iterations):
        if isinstance(step, Shot):
            yield Progress(
                "solve", 0.7 + 0.3 * _share(step, limits.unshot), f"Iteration {step.iteration + 1}: {step.unshot_fraction:.2%} unshot"
            )
        else:
            radiosity = step
    clock.lap("solve")
    roots = np.arange(len(surfaces))
    absorbed = ((1 - surfaces.reflectance) * surfaces.area[:, None] * forest.mean(roots, first[roots] + radiosity.irradiance[roots])).sum(0)
    escaped = escape.escaped_power(building, forest, first + radiosity.irradiance, lost, workers)
    weight = surfaces.reflectance.max(initial=0.0)
    report = {
        "rooms": scene.room_count,
        "rooms_closed": int(closed.sum()),
        "polygons": scene.polygon_count,
        "clusters": len(clusters),
        "portals": len(scene.portals),
        "pvs_polygons_max": int(graph.pvs_polygons.max(initial=0)),
        "pvs_polygons_mean": float(graph.pvs_polygons.mean()),
        "elements": len(forest),
        "links": int(sum(len(s) for s in linking.links)),
        "iterations": radiosity.iterations,
        "unshot_fraction": float(radiosity.unshot.sum() / max(emitted.sum(), 1e-300)),
        "residual_bound": float(weight / (1 - weight) * radiosity.unshot_exitance) if weight < 1 else float("inf"),
        "dropped_bound": linking.dropped,
        "energy": {"emitted": float(emitted.sum()), "absorbed": float(absorbed.sum()), "escaped": escaped},
        "segment_tests": tests,
        "seconds": clock.seconds,
    }
    return Solution(scene, building, forest, lamps, first, radiosity.irradiance, workers, report)


def items_of(surfaces: regions.Regions) -> clustering.ClusterItems:
    """Regions as things to be clustered, by the corners of their rectangles and the polygons that each stands for."""
    places = [(0, 0), (1, 0), (1, 1), (0, 1)]
    origin = surfaces.origin + surfaces.centre
    corners = np.stack([origin + x * surfaces.size[:, :1] * surfaces.u + y * surfaces.size[:, 1:] * surfaces.v for x, y in places], axis=1)
    count = len(surfaces)
    used = surfaces.polygon_region[surfaces.polygon_region >= 0]
    return clustering.ClusterItems(
        barycenter=surfaces.centroid + surfaces.centre,
        normal=surfaces.normal,
        box_min=surfaces.box_min + surfaces.centre,
        box_max=surfaces.box_max + surfaces.centre,
        smaller_edge=surfaces.size.min(1),
        room=surfaces.room,
        weight=np.bincount(used, minlength=count).astype(np.int64),
        vertices=corners.reshape(-1, 3),
        vertex_start=4 * np.arange(count + 1),
    )


def _extended(forest: Forest, light: np.ndarray) -> np.ndarray:
    """Coefficients of all elements (E, m, 3) from those of the first ones: a younger element is a part of its parent."""
    own = np.zeros((len(forest), *light.shape[1:]), np.float32)
    own[: len(light)] = light
    total = forest.push(_differences(forest, own, len(light)))
    return forest.pull(np.where(forest.leaf[:, None, None], total, 0))


def _differences(forest: Forest, own: np.ndarray, known: int) -> np.ndarray:
    """Coefficients such that a push from them gives ``own`` at the leaves among the first ``known`` elements."""
    out = np.zeros_like(own)
    was_leaf = (forest.children[:known] >= known).any(1) | (forest.children[:known] < 0).all(1)
    out[:known][was_leaf] = own[:known][was_leaf]
    return out


def _share(shot: Shot, tolerance: float) -> float:
    """How much of the shooting is done, from the fall of the unshot part to its tolerance."""
    if shot.unshot_fraction <= tolerance:
        return 1.0
    return float(np.clip(np.log(max(shot.unshot_fraction, 1e-12)) / np.log(tolerance), 0, 1)) if shot.unshot_fraction < 1 else 0.0


class _Clock:
    """Wall seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now
