"""The tables of visibility.md: ``python -m enfilade.docs.measure_visibility [SCENE ...]``.

Without scenes: those of tests/data and the three generated buildings of sample_scenes, and the time against the number of rooms.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np

from ..core import clustering, occlusion, regions
from ..core.clustering import Clusters
from ..core.options import Options
from ..core.scene import Scene
from ..core.scene_checks import check
from ..core.scene_files import load_scene
from ..core.visibility_graph import VisibilityGraph, build
from ..sample_scenes import labyrinth, octogon, test_scene
from . import sightlines

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
FILES = ("scenes/fzk-haus.json", "bench/two_rooms.npz", "bench/office.npz")
GENERATED = {"test_scene": test_scene.scene, "labyrinth": labyrinth.scene, "octogon": octogon.scene}
ROOMS = (27, 81, 216, 648, 1728)
RAYS = 100_000
PAIRS, SEGMENTS = 200, 10_000
MAX_PAIRS = 3_000_000
"""Pairs in the graphs that are asked for tighter tests."""


def main(paths: list[str]) -> None:
    scenes = {Path(p).stem: Path(p) for p in paths} or {Path(f).stem: DATA / f for f in FILES}
    loaded = {name: check(load_scene(path))[0] for name, path in scenes.items()}
    if not paths:
        loaded |= {name: make() for name, make in GENERATED.items()}
    built = {name: _Built(scene) for name, scene in loaded.items()}
    _table("scene|rooms|polygons|clusters|core seconds|memory|pairs|mean degree", built, _cost)
    _table("scene|largest PVS, clusters|cells|ratio|mean PVS, clusters|cells|ratio|pairs, volumes of the paper", built, _sets)
    _table(
        "scene|pairs met by rays|missed|pairs asked|seen past the portals|kept for each|seen past everything|kept for each", built, _truth
    )
    _table(
        "scene|pairs|looking away from each other|of the pairs of polygons|hidden by one large polygon|of the pairs of polygons",
        built,
        _tighter,
    )
    if not paths:
        _growth()


def _table(head: str, built: dict[str, _Built], row) -> None:
    print("\n| " + head.replace("|", " | ") + " |\n" + "|---" * (head.count("|") + 1) + "|")
    for name, each in built.items():
        print("| " + " | ".join([name, *row(each)]) + " |", flush=True)


class _Built:
    """A scene with its clusters and graph."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.items = clustering.cluster_items_of(scene)
        self.clusters = clustering.cluster_as_chosen(self.items, scene.room_count, Options(), np.random.default_rng(0))
        self.seconds = min(self.timed() for _ in range(2))
        self.graph = self.make(self.clusters)

    def make(self, clusters: Clusters, volumes: str = "windows") -> VisibilityGraph:
        return build(clusters, self.scene.portals, self.scene.room_names, volumes, self.items)[0]

    def timed(self) -> float:
        started = time.process_time()  # what else the machine does is not measured
        self.make(self.clusters)
        return time.process_time() - started


def _pairs(graph: VisibilityGraph) -> int:
    return int(graph.degrees.sum()) // 2


def _cost(built: _Built) -> list[str]:
    tracemalloc.start()
    built.make(built.clusters)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    scene, graph = built.scene, built.graph
    counts = [f"{n:,}" for n in (scene.room_count, scene.polygon_count, len(graph))]
    return [*counts, f"{built.seconds:.2f}", f"{peak / 1e6:.0f} MB", f"{_pairs(graph):,}", f"{graph.degrees.mean():.1f}"]


def _sets(built: _Built) -> list[str]:
    by_cell = built.make(clustering.cells(built.items, built.scene.room_count))
    fine, coarse = built.graph.pvs_polygons, by_cell.pvs_polygons[np.searchsorted(np.unique(built.clusters.room), built.clusters.room)]
    row = []
    for figure in (np.max, np.mean):
        a, b = figure(fine), figure(coarse)
        row += [f"{a:,.0f}", f"{b:,.0f}", f"{b / a:.2f}"]
    return [*row, f"{_pairs(built.make(built.clusters, 'boxes')):,}"]


def _truth(built: _Built) -> list[str]:
    """What rays and segments see, which know of walls and portals but nothing of planes, windows or graphs."""
    surfaces = regions.merge(built.scene)
    blockers = occlusion.blockers_of(surfaces)
    a, b = sightlines.pairs_met(built.scene, built.clusters.cluster_of, RAYS, 1)
    missed = int((~built.graph.sees(a, b)).sum())
    across = built.clusters.room[a] != built.clusters.room[b]
    rng = np.random.default_rng(2)
    start, members = built.graph.lists()
    own = np.repeat(np.arange(len(built.graph)), np.diff(start))
    other_room = np.flatnonzero((own < members) & (built.clusters.room[own] != built.clusters.room[members]))
    asked = rng.choice(other_room, min(PAIRS, len(other_room)), replace=False)
    seen = [sightlines.seen(built.scene, surfaces, blockers, built.clusters, own[k], members[k], SEGMENTS, rng) for k in asked]
    row = [f"{across.sum():,}", f"{missed}", f"{len(asked)}"]
    for found in np.array(seen, int).reshape(-1, 2).sum(axis=0):
        row += [f"{found}", f"{len(asked) / max(found, 1):.2f}"]
    return row


def _tighter(built: _Built) -> list[str]:
    """What two tighter tests would leave out of the graph."""
    pairs = _pairs(built.graph)
    if pairs > MAX_PAIRS:
        return [f"{pairs:,}", *["not asked"] * 4]
    count = len(built.graph)
    matrix = np.unpackbits(built.graph.bits, axis=1, count=count).astype(bool)
    size = np.diff(built.clusters.start).astype(float)
    total = size @ matrix @ size - (size**2).sum()
    row = [f"{pairs:,}"]
    for gone in (sightlines.looking_away(built.items, built.clusters, matrix), sightlines.hidden(built.items, built.clusters, matrix)):
        row += [f"{gone.sum() / (2 * pairs):.1%}", f"{size @ gone @ size / total:.1%}"]
    return row


def _growth() -> None:
    print("\n| rooms | clusters | core seconds |\n|---|---|---|")
    seconds = []
    for rooms in ROOMS:
        built = _Built(test_scene.scene(rooms / 648))
        seconds.append(built.seconds)
        print(f"| {built.scene.room_count:,} | {len(built.graph):,} | {built.seconds:.3f} |", flush=True)
    print(f"\nfitted exponent {np.polyfit(np.log(ROOMS), np.log(seconds), 1)[0]:.2f}")


if __name__ == "__main__":
    main(sys.argv[1:])
