# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the clustering and write docs/clustering.md: ``python -m enfilade.docs.measure_clustering`` (some minutes)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..core import visibility_graph
from ..core.clustering import (
    DISTANCE_FUNCTIONS,
    HUGE_ROOM,
    SEEDINGS,
    ClusterItems,
    Clusters,
    cells,
    cluster_items,
    cluster_items_of,
)
from ..core.clustering.goldsmith_salmon import bounding_volume_clusters
from ..core.clustering.quality import HISTOGRAM_EDGES, histogram, quality_of
from ..core.grouping import ragged
from ..core.scene import Scene, no_portals
from ..core.scene_files import load_scene
from ..sample_scenes import labyrinth, octogon, test_scene

PAGE = Path(__file__).resolve().with_name("clustering.md")
OFFICE = Path(__file__).resolve().parents[1] / "tests" / "data" / "bench" / "office.npz"
AVERAGES = (5, 10, 50, 150)
NEVER = 10**9
"""As the size of a huge room: all rooms are clustered by the flat algorithm."""
PAPER = {"Test scene": ("15 s", "4,759"), "Labyrinth": ("69 s", "16,610"), "Octogon": ("120 min 21 s", "3,690")}

HEAD = """\
# Clusters

Written by `docs/measure_clustering.py`, which measures what the tables say.

Polygons that lie close together in a room form a cluster, and clusters are the unit of all later work: what one cluster may see
is decided by its box. So boxes should be small, and making them should take no time. `core/clustering/` follows section 4 of the
paper and goes beyond it where that measured better:

| file | job |
|---|---|
| `items.py` | what is clustered, and the partition that comes out |
| `distances.py` | how far a polygon is from a cluster: by geometry, by photometry, sums, your own |
| `seeds.py` | where clusters begin |
| `isodata.py` | Lloyd's iteration, all rooms at once |
| `hierarchy.py`, `neighbours.py` | trees of clusters, and the clusters of huge rooms |
| `split_merge.py` | exchanges that make boxes smaller |
| `by_room.py` | all of it, for a scene |
| `goldsmith_salmon.py` | the baseline that the paper compares with |
| `quality.py` | the figures below |

`--split-merge 0 --seeding random --huge-room 1000000000` is the paper's algorithm to the letter. A distance of your own is a
function `distance(items, rows, candidates)` that returns one row of numbers per polygon, one number per cluster that it may join;
`candidates` has the clusters' barycenters, boxes, and mean normals, reflectances and emissions.
Splits and merges go by boxes whatever the distance: to cluster by photometry alone, add `--split-merge 0`.

    from enfilade.core.clustering import cluster_items, cluster_items_of, weighted_sum, DISTANCE_FUNCTIONS

    def height(items, rows, candidates):
        return abs(items.barycenter[rows, 2][:, None] - candidates.barycenter[..., 2])

    near = DISTANCE_FUNCTIONS["barycenter"]
    clusters = cluster_items(cluster_items_of(scene), scene.room_count, average=50,
                             distance=weighted_sum((1.0, near), (3.0, height)), rng=numpy.random.default_rng(0))

`hierarchy_of` gathers the clusters of each room in a tree (section 4.5), with any number of children at each level.

Words of the tables: *void* is the share of the summed box volume that no polygon reaches into (each box cut into 8 x 8 x 8 cells);
*PVS* is how many polygons are in the clusters that a cluster may see. Seconds are processor time of one run.
"""

WAYS = """\
## Time and quality at 50 polygons a cluster

The paper's columns are its figure 9, of 2003, for scenes of these numbers of polygons and rooms. *Flat* is Lloyd's iteration in
every room, *default* is what a bake does. *Goldsmith and Salmon* cuts the trees of their bounding volume hierarchies (1987) to as
many clusters; it inserts one polygon at a time, in a loop of plain Python.
"""
ONE_ROOM = f"""\
## One room

A room of shelves, the more of them the more polygons. A room of more than {HUGE_ROOM:,} polygons is divided by a hierarchy: every
level parts the polygons of a node among 16 clusters, shared out by their scatter, and in the end polygons move between
neighbouring clusters. At this size the flat algorithm takes half as long again and more, and its time grows with the square.
"""
HUGE = f"""\
## Huge rooms, both ways

All rooms of the Octogon with more than {HUGE_ROOM:,} small polygons, without and with two rounds of splits and merges.
"""
DISTANCES = """\
## Distances

The office of the tests: 3,963 polygons in 9 rooms; no splits and merges, which would hide what a distance does. A cell is a whole
room. As the paper says, the distance to the plane of a polygon gathers what is far apart, and the distances to vertices and
barycenters do not. Volume increase loses clusters: the flat box of a wall takes in all that lies in its plane for nothing. The
increase of surface, which is what Goldsmith and Salmon use, does so less. Photometric distances alone spread clusters
over the room; as weights beside a geometric one (`--reflectance-weight` and its sisters) they are of use.
"""
HISTOGRAM = """\
## Polygons in a cluster

Clusters of the test scene by the polygons in them. Large walls stand alone, hence the many clusters of one.
"""
SEEDS = """\
## Seeds

The office, mean of five runs, no splits and merges.
"""
EXCHANGES = """\
## Splits and merges

The office, mean of five runs. A cluster is split where that saves more surface of boxes than merging two others of the room costs,
so that their number stays. Two rounds bring most of it and are the default. Ball and Hall's own measures, spread and
distance of barycenters instead of boxes, were tried as well: on the flat clusters of rooms of 4,000 and 16,000 polygons they took
3 to 4 % off the volume where boxes take 10 to 15 %, so they were not kept.
"""
CHILDREN = """\
## Children of a node

The largest hall of the Octogon, mean of three runs, no splits and merges.
"""

PICTURES = """\
## Pictures

Clusters with their boxes at four sizes, and the levels of a hierarchy: [overlays.md](overlays.md#clusters).
"""


def page() -> str:
    """The whole page as Markdown."""
    scenes = {"Test scene": test_scene.scene(), "Labyrinth": labyrinth.scene(), "Octogon": octogon.scene()}
    office = load_scene(OFFICE)
    largest = _room(scenes["Octogon"], None)
    parts = [
        (HEAD, ""),
        (WAYS, _ways(scenes)),
        (ONE_ROOM, _one_room()),
        (HUGE, _huge(scenes["Octogon"])),
        (DISTANCES, _distances(office)),
        (HISTOGRAM, _histograms(scenes["Test scene"])),
        (SEEDS, _seeds(office)),
        (EXCHANGES, _split_merge(office)),
        (CHILDREN, _children(largest)),
        (PICTURES, ""),
    ]
    return "\n\n".join(text.rstrip() for part in parts for text in part if text) + "\n"


def _ways(scenes: dict[str, Scene]) -> str:
    rows = []
    for name, scene in scenes.items():
        items = cluster_items_of(scene)
        for way, build, choices in (
            ("flat", cluster_items, {"huge_room": NEVER, "split_merge": 0}),
            ("default", cluster_items, {}),
            ("Goldsmith and Salmon", bounding_volume_clusters, {}),
        ):
            seconds, clusters = _timed(build, items, scene.room_count, average=50, rng=_rng(), **choices)
            first = [name, f"{len(items):,} / {scene.room_count}", way, *PAPER[name]] if way == "flat" else ["", "", way, "", ""]
            rows.append([*first, f"{seconds:.2f} s", *_figures(items, clusters, scene)])
    return _table(["scene", "polygons / rooms", "way", "paper", "its clusters", "time", *_FIGURES], rows)


def _one_room() -> str:
    rows, times = [], []
    for polygons in (1000 * 2**k for k in range(9)):
        items = cluster_items_of(crowded_room(polygons))
        runs = [_timed(cluster_items, items, 1, average=50, rng=_rng()) for _ in range(3)]
        seconds, clusters = min(runs, key=lambda run: run[0])
        times.append((polygons, seconds))
        row = [f"{polygons:,}", f"{seconds:.3f} s", *_boxes(items, clusters)]
        if polygons <= 32_000:
            seconds, clusters = _timed(cluster_items, items, 1, average=50, huge_room=NEVER, rng=_rng())
            row += [f"{seconds:.3f} s", *_boxes(items, clusters)]
        rows.append(row + [""] * (9 - len(row)))
    exponent = np.polyfit(*np.log(times).T, 1)[0]
    table = _table(["polygons", "time", "clusters", "volume, m3", "void", "flat: time", "clusters", "volume, m3", "void"], rows)
    return f"{table}\n\nTime grows with the number of polygons to the power {exponent:.2f} (least squares over all rows)."


def _huge(scene: Scene) -> str:
    count = np.bincount(scene.room, minlength=scene.room_count)
    rows = []
    for rounds in (0, 2):
        found: dict[str, list] = {}
        for r in np.argsort(-count):
            own = _room(scene, r)
            if len(own) > HUGE_ROOM:
                name = scene.room_names[r] if len(own) > 10_000 else "the others"
                runs = [
                    _timed(cluster_items, own, scene.room_count, average=50, huge_room=huge, split_merge=rounds, rng=_rng())
                    for huge in (NEVER, HUGE_ROOM)
                ]
                found.setdefault(name, []).append((len(own), [(s, quality_of(own, c, _no_graph(c))) for s, c in runs]))
        for name, rooms in found.items():
            row, share = [name, str(len(rooms)), f"{sum(size for size, _ in rooms):,}", str(rounds)], []
            for way in (0, 1):
                seconds = sum(runs[way][0] for _, runs in rooms)
                volume = sum(runs[way][1].box_volume for _, runs in rooms)
                share.append(sum(runs[way][1].box_volume * runs[way][1].void_share for _, runs in rooms) / volume)
                row += [f"{seconds:.2f} s", f"{volume:.1f}", f"{share[way]:.3f}"]
            worst = max(runs[1][1].void_share / runs[0][1].void_share for _, runs in rooms)
            rows.append([*row, f"{share[1] / share[0]:.3f}", f"{worst:.3f}"])
    ways = ("flat: time", "volume, m3", "void", "hierarchy: time", "volume, m3", "void")
    return _table(["room", "rooms", "small polygons", "rounds", *ways, "ratio of void", "in the worst room"], rows)


def _distances(scene: Scene) -> str:
    items = cluster_items_of(scene)
    rows = [["cells", "", *_figures(items, cells(items, scene.room_count), scene)]]
    for name, distance in DISTANCE_FUNCTIONS.items():
        for average in AVERAGES:
            clusters = cluster_items(items, scene.room_count, average=average, distance=distance, split_merge=0, rng=_rng())
            rows.append([name if average == AVERAGES[0] else "", str(average), *_figures(items, clusters, scene)])
    return _table(["distance", "N_ave", *_FIGURES], rows)


def _histograms(scene: Scene) -> str:
    items = cluster_items_of(scene)
    ends = [f"{low}" if high == low + 1 else f"{low} to {high - 1}" for low, high in pairwise(HISTOGRAM_EDGES)]
    rows = []
    for average in AVERAGES:
        polygons = cluster_items(items, scene.room_count, average=average, rng=_rng()).polygons
        counts = (f"{n:,}" for n in histogram(polygons))
        rows.append([str(average), f"{len(polygons):,}", f"{polygons.mean():.1f}", f"{polygons.max():,}", *counts])
    return _table(["N_ave", "clusters", "mean", "most", *ends, f"{HISTOGRAM_EDGES[-1]} and more"], rows)


def _seeds(scene: Scene) -> str:
    items = cluster_items_of(scene)
    rows = []
    for average in AVERAGES:
        row = [str(average)]
        for name in ("random", "spread"):
            row += _mean(items, scene, 5, average=average, seeding=SEEDINGS[name], split_merge=0)[1:-1]
        rows.append(row)
    figures = ["volume, m3", "surface, m2", "void"]
    return _table(["N_ave", *(f"random (paper): {f}" for f in figures), *(f"spread: {f}" for f in figures)], rows)


def _split_merge(scene: Scene) -> str:
    items = cluster_items_of(scene)
    rows = []
    for average in (10, 50):
        for rounds in (0, 1, 2, 4, 8):
            rows.append([str(average), str(rounds), *_mean(items, scene, 5, average=average, split_merge=rounds)])
    return _table(["N_ave", "rounds", "time", "volume, m3", "surface, m2", "void", "mean PVS"], rows)


def _children(items: ClusterItems) -> str:
    alone = dataclasses.replace(items, room=np.zeros(len(items), np.int32))
    rows = [[str(n), *_mean(alone, None, 3, average=50, children=(n,), split_merge=0)[:-1]] for n in (2, 4, 8, 16, 32)]
    return _table(["children", "time", "volume, m3", "surface, m2", "void"], rows)


def crowded_room(polygons: int, seed: int = 3) -> Scene:
    """One room of shelves of books, boxes of six polygons, as wide as they need: 16,000 polygons in 30 x 30 x 6 m."""
    rng = np.random.default_rng(seed)
    size = np.array([30.0, 30.0, 6.0]) * (polygons / 16_000) ** (1 / 3)
    books = -(-polygons // 6)
    shelf = np.sort(rng.integers(0, max(1, books // 30), books))
    place = rng.random((shelf[-1] + 1, 3)) * size
    rank = np.arange(books) - np.searchsorted(shelf, shelf)
    low = place[shelf] + rank[:, None] * [0.045, 0.0, 0.0]
    high = low + rng.uniform([0.02, 0.12, 0.18], [0.04, 0.22, 0.32], (books, 3))
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = low[:, None] + corner * (high - low)[:, None]
    faces = corners[:, [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]].reshape(-1, 4, 3)[:polygons]
    return Scene(
        name="shelves",
        vertices=faces.reshape(-1, 3),
        corner_vertex=np.arange(4 * polygons, dtype=np.int32),
        loop_start=4 * np.arange(polygons + 1),
        polygon_start=np.arange(polygons + 1),
        reflectance=np.full((polygons, 3), 0.5),
        emission=np.zeros((polygons, 3)),
        room=np.zeros(polygons, np.int32),
        object=np.zeros(polygons, np.int32),
        room_names=("room",),
        object_names=("books",),
    )


_FIGURES = ("clusters", "volume, m3", "surface, m2", "void", "mean PVS", "largest PVS")


def _figures(items: ClusterItems, clusters: Clusters, scene: Scene) -> list[str]:
    found = quality_of(items, clusters, visibility_graph.build(clusters, scene.portals, scene.room_names)[0])
    boxes = [f"{found.clusters:,}", f"{found.box_volume:,.1f}", f"{found.box_area:,.0f}", f"{found.void_share:.3f}"]
    return [*boxes, f"{found.pvs_mean:,.0f}", f"{found.pvs_max:,}"]


def _boxes(items: ClusterItems, clusters: Clusters) -> list[str]:
    found = quality_of(items, clusters, _no_graph(clusters))
    return [f"{found.clusters:,}", f"{found.box_volume:.1f}", f"{found.void_share:.3f}"]


def _mean(items: ClusterItems, scene: Scene | None, runs: int, **choices: Any) -> list[str]:
    """Time, volume, surface, void and mean PVS of several runs, in the rooms of a scene or in one room."""
    seconds, found = 0.0, []
    for seed in range(runs):
        spent, clusters = _timed(cluster_items, items, scene.room_count if scene else 1, rng=_rng(seed), **choices)
        graph = visibility_graph.build(clusters, scene.portals, scene.room_names)[0] if scene else _no_graph(clusters)
        seconds += spent
        found.append(quality_of(items, clusters, graph))
    volume, area, void, pvs = (np.mean([getattr(q, f) for q in found]) for f in ("box_volume", "box_area", "void_share", "pvs_mean"))
    return [f"{seconds / runs:.3f} s", f"{volume:.1f}", f"{area:,.0f}", f"{void:.3f}", f"{pvs:,.0f}"]


def _no_graph(clusters: Clusters) -> visibility_graph.VisibilityGraph:
    """The graph of rooms without doors."""
    names = tuple(map(str, range(len(clusters.iterations))))
    return visibility_graph.build(clusters, no_portals(), names)[0]


def _room(scene: Scene, room: int | None) -> ClusterItems:
    """The small polygons of a room, of the one with most polygons where none is given."""
    items = cluster_items_of(scene)
    room = np.argmax(np.bincount(scene.room)) if room is None else room
    rows = np.flatnonzero((items.room == room) & (items.smaller_edge <= 1.0))
    count = np.diff(items.vertex_start)[rows]
    vertices = items.vertices[ragged(items.vertex_start[:-1][rows], count)[0]]
    start = np.concatenate([np.zeros(1, np.int64), np.cumsum(count)])
    fields = {k: v[rows] for k, v in vars(items).items() if k not in ("vertices", "vertex_start")}
    return ClusterItems(**fields, vertices=vertices, vertex_start=start)


def _timed(build: Callable[..., Clusters], *arguments: Any, **choices: Any) -> tuple[float, Clusters]:
    started = time.process_time()
    clusters = build(*arguments, **choices)
    return time.process_time() - started, clusters


def _rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
