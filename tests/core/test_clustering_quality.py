"""Figures of clusters against worked examples."""

import json

import numpy as np
import pytest
from cluster_scenes import scene_of
from enfilade.core import visibility_graph
from enfilade.core.clustering import Clusters, cluster_items, cluster_items_of
from enfilade.core.clustering.items import partition
from enfilade.core.clustering.quality import HISTOGRAM_EDGES, as_report, histogram, quality_of, void_volume
from enfilade.core.scene import Portals


def grouped(polygons, key, room=None):
    """Items, and the clusters that ``key`` makes of them."""
    scene = scene_of([np.array(p, float) for p in polygons], room)
    items = cluster_items_of(scene)
    rooms = scene.room_count
    return items, partition(items, np.array(key), np.zeros(rooms, np.int32), np.zeros(rooms, bool))


def floor(x0, x1, y0, y1, z):
    return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]


def test_figures_by_hand():
    """Bottom and top of a box of 2 x 3 x 8, and a floor alone, in two rooms without a door."""
    items, clusters = grouped([floor(0, 2, 0, 3, 0), floor(0, 2, 0, 3, 8), floor(0, 1, 0, 1, 0)], [0, 0, 1], [0, 0, 1])
    nowhere = Portals(np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros((0, 2), np.int32))
    graph, _ = visibility_graph.build(clusters, nowhere, ("a", "b"))
    found = quality_of(items, clusters, graph)
    assert (found.clusters, found.polygons_mean, found.polygons_max) == (2, 1.5, 2)
    assert found.box_volume == pytest.approx(48)
    assert found.box_area == pytest.approx(2 * (6 + 16 + 24) + 2)
    assert found.void_share == pytest.approx(6 / 8)  # two of eight layers are met
    assert (found.pvs_mean, found.pvs_max) == (1.5, 2)
    assert found.histogram[:3].tolist() == [1, 1, 0]
    report = as_report(found)
    assert json.loads(json.dumps(report)) == report
    assert (report["clusters"], report["box_area"], report["histogram"]["1"], report["histogram"]["2"]) == (2, found.box_area, 1, 1)


def test_a_slanted_polygon_meets_the_cells_that_its_plane_meets():
    """The diagonal of a cube of eight cells an edge goes through the eight on the diagonal and touches those beside it at an edge."""
    slanted = [[0, 0, 0], [8, 8, 0], [8, 8, 8], [0, 0, 8]]
    items, clusters = grouped([slanted], [0])
    empty = void_volume(items, clusters)[0] / 512
    assert 1 - 22 / 64 <= empty + 1e-12 <= 1 - 8 / 64 + 2e-12


def test_void_is_none_where_polygons_are_everywhere_and_counts_for_nothing_without_volume():
    layers = [floor(0, 8, 0, 8, z) for z in np.arange(0.5, 8)] + [floor(0, 8, 0, 8, 0), floor(0, 8, 0, 8, 8)]
    items, clusters = grouped(layers, [0] * 10)
    assert void_volume(items, clusters).tolist() == [0]
    items, clusters = grouped([floor(0, 1, 0, 1, 0), floor(4, 5, 0, 1, 0)], [0, 0])
    assert void_volume(items, clusters).tolist() == [0]


def test_void_of_many_clusters_is_the_sum_of_each(monkeypatch):
    from enfilade.core.clustering import quality

    rng = np.random.default_rng(0)
    polygons = [rng.random(3) * 9 + rng.normal(size=(4, 3)) * 0.3 for _ in range(400)]
    items = cluster_items_of(scene_of(polygons))
    clusters = cluster_items(items, 1, average=8, rng=rng)
    whole = void_volume(items, clusters)
    monkeypatch.setattr(quality, "_BLOCK_CELLS", 1024)
    np.testing.assert_array_equal(void_volume(items, clusters), whole)
    assert (whole > 0).any()
    assert (whole < np.prod(clusters.box_max - clusters.box_min, axis=1)).any()


def test_histogram_bins_begin_at_their_edges():
    polygons = np.array([e + d for e in HISTOGRAM_EDGES for d in (0, 1) if e + d not in HISTOGRAM_EDGES or d == 0])
    found = histogram(polygons)
    expected = [sum(low <= p < high for p in polygons) for low, high in zip(HISTOGRAM_EDGES, [*HISTOGRAM_EDGES[1:], np.inf], strict=True)]
    assert found.tolist() == expected
    assert histogram(np.zeros(0, np.int64)).sum() == 0


def test_no_clusters_have_figures():
    items, clusters = grouped([floor(0, 1, 0, 1, 0)], [0])
    none = Clusters(**{k: v[:1] if k == "start" else v[:0] for k, v in vars(clusters).items()})
    nowhere = Portals(np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros((0, 2), np.int32))
    graph, _ = visibility_graph.build(none, nowhere, ())
    found = quality_of(items, none, graph)
    assert (found.clusters, found.box_volume, found.void_share, found.pvs_max) == (0, 0, 0, 0)
