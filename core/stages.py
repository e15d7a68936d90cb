"""The stages of a solve, each taken from the store if it was finished before, else done and kept there."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import clustering, escape, exchanges, footprints, illumination, occlusion, ordering, refinement, regions, visibility_graph
from .building import Building, doors_of, items_of
from .clustering import Clusters
from .elements import Forest
from .emitters import Emitters
from .links import ARRAYS, LinkCollector, LinkSet, by_shape
from .memory import give_back_free
from .options import Options
from .progress import Progress
from .quality import Tolerances
from .regions import Regions
from .routes import Routes, RoutesInMemory, RoutesOnDisk
from .saved_forest import arrays_of, forest_of, kept_by
from .scene import Scene
from .shooting import Radiosity, Shooter, Shot
from .solution import Solution
from .store import Space
from .visibility_graph import VisibilityGraph
from .workspace import Workspace

CHECKPOINT_SECONDS = 5.0
"""Shortest time between two states of the shooting that are kept."""
CHECKPOINT_SHARE = 0.05
"""Largest part of the time that goes into keeping them."""


@dataclass(frozen=True)
class Lit:
    """The forest as refined for the light of the luminaires.

    light : (E, m, 3) irradiance by them;  room : (R, 3) mean irradiance of rooms;  tests : pairs of lamp and blocker weighed
    """

    forest: Forest
    light: np.ndarray
    room: np.ndarray
    tests: int


@dataclass(frozen=True)
class Linked:
    """A forest with all its links.

    count : of the links;  light : (E, m, 3) irradiance by luminaires;  lit : elements that there were when it was computed
    lost : (R,) share of the rays of a room that no surface receives
    dropped : W, bounds the light of exchanges left out;  segment_tests, shadow_tests : how often visibility was asked
    """

    forest: Forest
    links: list[LinkSet]
    count: int
    light: np.ndarray
    lit: int
    lost: np.ndarray
    dropped: float
    segment_tests: int
    shadow_tests: int


@dataclass(frozen=True)
class Turn:
    """The lighting ``number`` of ``count`` is lit and shot; ``name`` of its light group, "" for all light at once."""

    number: int
    count: int
    name: str

    @property
    def title(self) -> str:
        """What messages begin with."""
        return f"{self.name}: " if self.name else ""

    def stage(self, name: str) -> str:
        """The name of a stage in the store."""
        return f"{name}-g{self.number}" if self.name else name

    def at(self, share: float) -> float:
        """The fraction of the whole run that is done with this ``share`` of the turn."""
        return 0.7 + 0.3 * (self.number + share) / self.count


def build(
    scene: Scene, options: Options, rng: np.random.Generator, desk: Workspace
) -> Generator[Progress, None, tuple[Building, list[str]]]:
    """Regions, clusters and their visibility graph, and the warnings of the graph; ``rng`` is left as the clustering leaves it."""
    store, clock = desk.store, desk.clock
    yield Progress("merge", 0.0, "Merging coplanar polygons")
    if saved := store.recall("regions"):
        surfaces = saved.result(Regions)
        blockers = occlusion.blockers_of(surfaces)
    else:
        surfaces = regions.merge(scene)
        desk.space.breathe()
        blockers = occlusion.blockers_of(surfaces)
        for step in footprints.uncovering(surfaces, blockers):
            if isinstance(step, Regions):
                surfaces = step
            else:
                yield Progress("merge", 0.02 * step, "Looking for covered surfaces")
                desk.space.breathe()
    seconds = clock.lap("merge", saved.facts["seconds"] if saved else 0.0)
    if not saved:
        store.keep("regions", surfaces, {"seconds": seconds})

    yield Progress("cluster", 0.02, f"Clustering {len(surfaces):,} surfaces")
    items = items_of(surfaces)
    if saved := store.recall("clusters"):
        clusters = saved.result(Clusters)
        rng.bit_generator.state = saved.facts["rng"]
    else:
        clusters = clustering.cluster_as_chosen(items, scene.room_count, options, rng)
    seconds = clock.lap("cluster", saved.facts["seconds"] if saved else 0.0)
    if not saved:
        store.keep("clusters", clusters, {"seconds": seconds, "rng": rng.bit_generator.state})

    yield Progress("graph", 0.04, f"Visibility of {len(clusters):,} clusters")
    if saved := store.recall("graph"):
        graph, findings = saved.result(VisibilityGraph), saved.facts["findings"]
    else:
        graph, found = visibility_graph.build_as_chosen(clusters, items, scene.portals, scene.room_names, options)
        findings = list(found)
    seconds = clock.lap("graph", saved.facts["seconds"] if saved else 0.0)
    if not saved:
        store.keep("graph", graph, {"seconds": seconds, "findings": findings})
    return Building(surfaces, blockers, clusters, graph, doors_of(scene.portals, surfaces.centre), scene.room_count), findings


def illuminate(building: Building, lamps: Any, limits: Tolerances, options: Options, desk: Workspace) -> Generator[Progress, None, Lit]:
    """The light of the luminaires, on elements that follow its shadows."""
    space = desk.space
    if saved := desk.store.recall("lamps"):
        arrays = saved.arrays()
        forest = forest_of(building.regions, options.order, arrays, space.zeros, space.breathe)
        desk.clock.lap("light", saved.facts["seconds"])
        return Lit(forest, arrays["light"], arrays["room"], saved.facts["tests"])
    forest = kept_by(Forest(building.regions, options.order), space.zeros)
    steps = illumination.illuminate(building, forest, lamps, limits.direct, limits.min_size, desk.crew, space.zeros)
    light, room, tests = yield from _follow(steps, 0.06, 0.2, lambda: "Light of the luminaires")
    give_back_free()
    seconds = desk.clock.lap("light")
    desk.store.keep_arrays("lamps", arrays_of(forest) | {"light": light, "room": room}, {"tests": int(tests), "seconds": seconds})
    return Lit(forest, light, room, int(tests))


def linked_before(building: Building, options: Options, desk: Workspace) -> Linked | None:
    """The forest and its links, if the store has them."""
    saved = desk.store.recall("links")
    if not saved:
        return None
    arrays, facts, space = saved.arrays(), saved.facts, desk.space
    forest = forest_of(building.regions, options.order, arrays, space.zeros, space.breathe)
    sets = [LinkSet(*(arrays[f"{name}-{k}"] for name in ARRAYS)) for k in range(facts["sets"])]
    desk.clock.lap("light", facts["light_seconds"])
    desk.clock.lap("link", facts["seconds"])
    counts = facts["dropped"], facts["segment_tests"], facts["shadow_tests"]
    return Linked(forest, sets, sum(map(len, sets)), arrays["light"], facts["lit"], arrays["lost"], *counts)


def link(building: Building, lit: Lit, limits: Tolerances, desk: Workspace) -> Generator[Progress, None, Linked]:
    """Link the elements of a building, which splits more of them."""
    forest, space, clock = lit.forest, desk.space, desk.clock
    wall = np.bincount(building.regions.room, building.regions.area, minlength=len(lit.room))
    limit = limits.exchange * lit.room.max(1) * np.sqrt(wall)
    estimate = exchanges.Estimate(*illumination.exitance_estimate(forest, lit.light, lit.room), limit[building.regions.room])
    collector = LinkCollector(space.zeros if space.limited else None)
    steps = refinement.link(building, forest, estimate, limits.link_size, desk.crew, collector)
    made = yield from _follow(steps, 0.2, 0.7, lambda: f"Linking {len(forest):,} elements")
    light = illumination.extended(forest, lit.light, space.zeros, space.breathe)
    lost = escape.lost_share(building, forest, desk.crew)
    give_back_free()  # blocks of work leave holes between what stays
    seconds = clock.lap("link")
    groups = by_shape(made.links)
    sets = {f"{name}-{k}": [getattr(s, name) for s in group] for k, group in enumerate(groups) for name in ARRAYS}
    facts = {
        "sets": len(groups), "dropped": made.dropped, "segment_tests": int(made.segment_tests),
        "shadow_tests": lit.tests, "lit": len(lit.light), "seconds": seconds, "light_seconds": clock.seconds["light"],
    }  # fmt: skip
    desk.store.keep_arrays("links", arrays_of(forest) | sets | {"light": light, "lost": lost}, facts)
    desk.store.drop("lamps")
    return Linked(
        forest, made.links, sum(map(len, made.links)), light, len(lit.light), lost, made.dropped, facts["segment_tests"], lit.tests
    )


def light_of_group(building: Building, linked: Linked, kinds: Any, turn: Turn, desk: Workspace) -> Generator[Progress, None, np.ndarray]:
    """(E, m, 3) irradiance by some of the luminaires, on the elements as all of them have made them."""
    stage = turn.stage("group")
    if saved := desk.store.recall(stage):
        desk.clock.lap("light", desk.clock.seconds["light"] + saved.facts["seconds"])
        return saved.arrays()["light"]
    steps = illumination.light_on(building, linked.forest, linked.lit, kinds, desk.crew, desk.space.zeros)
    light = yield from _follow(steps, turn.at(0.0), turn.at(0.5), lambda: f"{turn.title}Light of the luminaires")
    before = desk.clock.seconds["light"]
    seconds = desk.clock.lap("light", before) - before
    desk.store.keep_arrays(stage, {"light": light}, {"seconds": seconds})
    return light


def routes_of(links: list[LinkSet], emitters: Emitters, space: Space) -> Routes:
    """The links by emitter, in memory if they fit."""
    if space.fits(sum(group.nbytes for group in links)):
        return RoutesInMemory(links, emitters)
    return RoutesOnDisk(links, emitters, space.zeros, space.breathe)


def shoot(
    shooter: Shooter,
    strategy: ordering.Strategy,
    rng: np.random.Generator,
    tolerance: float,
    options: Options,
    desk: Workspace,
    so_far: Callable[[], Solution],
    turn: Turn,
) -> Generator[Progress, None, Radiosity]:
    """Shoot to the end; the state is kept from time to time, and where the store has one the shooting goes on from it."""
    before, stage = 0.0, turn.stage("shooting")
    if saved := desk.store.recall(stage, options.ordering):
        shooter.restore(saved.arrays())
        rng.bit_generator.state, before = saved.facts["rng"], saved.facts["seconds"]

    def keep() -> float:
        start = time.perf_counter()
        facts = {"rng": rng.bit_generator.state, "seconds": before + desk.clock.running()}
        desk.store.keep_arrays(stage, shooter.state(), facts, options.ordering)
        return time.perf_counter() - start

    give_back_free()  # what closing the rooms and sorting the links took
    due = time.perf_counter() + CHECKPOINT_SECONDS
    for step in shooter.run(strategy, rng, tolerance, options.max_iterations):
        if isinstance(step, Radiosity):
            keep()
            desk.clock.lap("shoot", before + desk.clock.seconds.get("shoot", 0.0))
            return step
        if time.perf_counter() > due:
            took = keep()
            due = time.perf_counter() + max(CHECKPOINT_SECONDS, took / CHECKPOINT_SHARE)
        share = _share(step, tolerance)
        message = f"{turn.title}Iteration {step.iteration + 1}: {step.unshot_fraction:.2%} unshot"
        yield Progress("solve", turn.at(0.5 + 0.5 * share if turn.name else share), message, so_far)
    raise RuntimeError("the shooting ended without a result")


def _follow(steps: Iterator, start: float, end: float, message: Callable[[], str]):
    """Progress from ``start`` to ``end`` while a stage yields shares of its work; returns the result that it yields last."""
    for step in steps:
        if not isinstance(step, float):
            return step
        yield Progress("solve", start + (end - start) * step, message())
    raise RuntimeError("a stage ended without a result")


def _share(shot: Shot, tolerance: float) -> float:
    """How much of the shooting is done, from the fall of the unshot part to its tolerance."""
    if shot.unshot_fraction <= tolerance:
        return 1.0
    return float(np.clip(np.log(max(shot.unshot_fraction, 1e-12)) / np.log(tolerance), 0, 1)) if shot.unshot_fraction < 1 else 0.0
