"""A bake between reading and writing: from a scene and the meshes that carry its light to the values that are written onto them."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .bake_values import Carrier, CornerItem, FineCarrier, Page, PageItem, evaluate, evaluate_groups, plan_page, refined
from .element_mesh import ElementMesh, element_mesh
from .lightings import lit_by
from .options import BakeOptions, Options
from .photometry import PARTS, recombined
from .progress import Progress, TimeLeft, words
from .scene import Scene
from .solution import Solution

SOLVE_SHARE = {"vertex": 0.75, "texture": 0.15}
"""Part of the progress that the solver takes; the rest is for asking it at corners or at the many texels."""

MOST_SKETCHED = 40_000
"""Finer elements are not shown while the solver works."""
SKETCH_SHARE = 0.05
"""Largest part of the solver's time that goes into showing the light so far."""
SKETCH_PAUSE = 0.5
"""Shortest time between two such sketches, seconds."""


@dataclass(frozen=True)
class Task:
    """What is to be baked. Carrier k is called ``names[k]`` and lies mostly in room ``rooms[k]``."""

    scene: Scene
    options: Options
    bake: BakeOptions
    carriers: tuple[Carrier, ...]
    names: tuple[str, ...]
    rooms: tuple[int, ...]


@dataclass(frozen=True)
class Step:
    """Progress of a bake: ``fraction`` 0..1 of the whole; ``remaining`` seconds that it may still take, None where that cannot be told.

    sketch : the light so far on the elements, None where there is none that is new
    """

    stage: str
    fraction: float
    message: str
    remaining: float | None = field(default=None, compare=False)
    sketch: ElementMesh | None = field(default=None, compare=False, repr=False)

    @property
    def time_left(self) -> str:
        """The time left in words, empty where it cannot be told."""
        return "" if self.remaining is None or self.fraction >= 1 else words(self.remaining)


@dataclass(frozen=True)
class Baked:
    """What was computed. Carrier k has ``colors[k]``, or in the pages that have it as a member its texture.

    report : the figures of the solver;  fine : subdivided carriers, or None for each;  colors : (C, 4) or (V, 4) float32
    pages, page_names, images : textures, (H, W, 4) float32;  elements : the light on them, None where the solver has none
    groups : names of the light groups;  parts : for each of ``colors`` or ``images`` what it is by each of them alone
    """

    report: dict[str, Any]
    fine: tuple[FineCarrier | None, ...]
    colors: tuple[np.ndarray, ...] = ()
    pages: tuple[Page, ...] = ()
    page_names: tuple[str, ...] = ()
    images: tuple[np.ndarray, ...] = ()
    warnings: tuple[str, ...] = ()
    elements: ElementMesh | None = None
    groups: tuple[str, ...] = ()
    parts: tuple[tuple[np.ndarray, ...], ...] = ()


def bake(task: Task, run: Callable[[Scene, Options], Generator] | None = None, sketches: bool = False) -> Generator[Step, None, Baked]:
    """Solve and evaluate. ``run`` is the solver, :func:`enfilade.core.pipeline.run` unless told otherwise.

    sketches : whether somebody looks at the light so far

    Raises SceneError for what only the solver finds; closing the generator cancels.
    """
    if run is None:
        from .pipeline import run
    scene, wanted = task.scene, task.bake
    fine = tuple(refined(c, wanted.subdivide) if wanted.subdivide > 0.0 else None for c in task.carriers)
    carriers = [c if f is None else f.carrier for c, f in zip(task.carriers, fine, strict=True)]
    pages, names, warnings = _plan(task, carriers) if wanted.target == "texture" else ((), (), ())

    share, left, sketched = SOLVE_SHARE[wanted.target], TimeLeft(), _Sketches()
    solver = run(scene, task.options)
    try:
        while True:
            progress = next(solver)
            done = share * progress.fraction
            yield Step(progress.stage, done, progress.message, left.after(done), sketched.look(progress) if sketches else None)
    except StopIteration as end:
        solution = end.value
    finally:
        solver.close()

    groups = scene.groups.names if scene.groups is not None else ()
    quantity = PARTS.get(wanted.quantity, wanted.quantity) if groups else wanted.quantity
    if pages:
        items = [PageItem(carriers, page, quantity, wanted.margin) for page in pages]
    else:
        items = [CornerItem(carrier, quantity, wanted.domain) for carrier in carriers]
    place = "texels" if pages else "corners"
    started = time.perf_counter()
    by_group = [lit_by(scene, k) for k in range(len(groups))]
    evaluation = evaluate_groups(items, solution, by_group) if groups else evaluate(items, solution, scene)
    try:
        while True:
            done = share + (1.0 - share) * next(evaluation)
            yield Step("bake", done, f"Light at the {place}", left.after(done))
    except StopIteration as end:
        values = tuple(end.value)
    seconds = {**solution.report.get("seconds", {})}
    seconds["evaluate"] = time.perf_counter() - started
    seconds["total"] = sum(v for name, v in seconds.items() if name != "total")
    report = {**solution.report, "seconds": seconds}
    elements = element_mesh(solution) if isinstance(solution, Solution) else None
    parts: tuple[tuple[np.ndarray, ...], ...] = ((),) * len(values)
    if groups:
        parts, values = values, tuple(recombined(wanted.quantity, part, np.ones((len(groups), 3))) for part in values)
    if pages:
        return Baked(report, fine, (), pages, names, values, warnings, elements, groups, parts)
    return Baked(report, fine, colors=values, elements=elements, groups=groups, parts=parts)


def _plan(task: Task, carriers: list[Carrier]) -> tuple[tuple[Page, ...], tuple[str, ...], tuple[str, ...]]:
    """The textures, their names, and warnings of those that are coarser than was asked for."""
    wanted = task.bake
    if wanted.atlas == "room":
        groups = [(task.scene.room_names[r], [k for k, room in enumerate(task.rooms) if room == r]) for r in sorted(set(task.rooms))]
    else:
        groups = [(name, [k]) for k, name in enumerate(task.names)]
    pages = tuple(
        plan_page(carriers, members, wanted.texel_density, wanted.margin, wanted.max_resolution, name) for name, members in groups
    )
    warnings = tuple(
        f"the lightmap of '{name}' takes {page.density:.3g} texels per metre to fit into {wanted.max_resolution} x {wanted.max_resolution}"
        for (name, _), page in zip(groups, pages, strict=True)
        if page.density < wanted.texel_density
    )
    return pages, tuple(f"{wanted.name} {name}" for name, _ in groups), warnings


class _Sketches:
    """Makes sketches of the light so far, seldom enough."""

    def __init__(self) -> None:
        self._next = 0.0

    def look(self, progress: Progress) -> ElementMesh | None:
        """A sketch, unless it is too early for another or there is nothing to see yet."""
        started = time.perf_counter()
        if progress.so_far is None or started < self._next:
            return None
        mesh = element_mesh(progress.so_far(), MOST_SKETCHED)
        took = time.perf_counter() - started
        self._next = started + took + max(SKETCH_PAUSE, took / SKETCH_SHARE)
        return replace(mesh, outline=mesh.outline[:0])  # lines are not drawn meanwhile
