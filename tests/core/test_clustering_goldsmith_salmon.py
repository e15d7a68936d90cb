"""Goldsmith and Salmon's baseline: insertions that can be followed by hand, and a valid partition."""

import numpy as np
import pytest
from cluster_scenes import assert_partition, random_scene, scene_of, squares
from enfilade.core.clustering import cluster_items_of
from enfilade.core.clustering.goldsmith_salmon import bounding_volume_clusters, bounding_volume_tree


def tree(boxes):
    boxes = np.array(boxes, float)
    return bounding_volume_tree(boxes[:, 0], boxes[:, 1]).tolist()


def cube(x, size=1.0):
    return [[x, 0, 0], [x + size, size, size]]


def test_two_pairs_far_apart_become_two_nodes():
    # 0 and 1 pair as node 4. A third child there would cost box 2, far away, more than a new root (5) over node 4 and itself.
    # Box 3 goes down to box 2 and pairs with it as node 6.
    assert tree([cube(0), cube(1), cube(100), cube(101)]) == [4, 4, 6, 6, 5, -1, 5]


def test_a_box_within_another_costs_a_child_there_and_no_more():
    # Half surfaces: 3 for the unit cube. Box 2 equals the first two: one more child costs 3, a pair anywhere 6.
    assert tree([cube(0), cube(0), cube(0)]) == [3, 3, 3, -1]


def test_one_box():
    assert tree([cube(0)]) == [-1]


@pytest.mark.parametrize("seed", range(3))
def test_a_tree_holds_every_box_once_with_two_children_at_least(seed):
    rng = np.random.default_rng(seed)
    low = rng.random((200, 3)) * 10
    parent = bounding_volume_tree(low, low + rng.random((200, 3)))
    inner = np.arange(len(parent)) >= 200
    assert (parent == -1).sum() == 1
    assert not np.isin(np.arange(200), parent).any()  # boxes have no children
    assert (np.bincount(parent[parent >= 0], minlength=len(parent))[inner] >= 2).all()
    node = np.arange(200)
    for _ in range(200):
        node = np.where(parent[node] >= 0, parent[node], node)
    assert len(np.unique(node)) == 1


@pytest.mark.parametrize("average", [1, 5, 1000])
def test_clusters_are_a_partition_of_about_the_number_asked_for(average):
    scene = random_scene(3)
    items = cluster_items_of(scene)
    clusters = bounding_volume_clusters(items, scene.room_count, average=average, rng=np.random.default_rng(0))
    assert_partition(clusters, items)
    size = np.bincount(scene.room, minlength=scene.room_count)
    number = np.maximum(np.floor(size / average + 0.5), size > 0).sum()
    assert 0.6 * number <= len(clusters) <= 1.6 * number


def test_heaps_become_clusters_and_large_polygons_stand_alone():
    rng = np.random.default_rng(4)
    heap = np.repeat(np.arange(6), 20)
    places = np.array([[0, 0, 0], [90, 0, 0], [0, 90, 0], [90, 90, 0], [0, 0, 90], [90, 90, 90]])
    scene = scene_of(squares(places[heap] + rng.random((120, 3)), 0.1) + squares([[0, 0, 1]], 2.0))
    clusters = bounding_volume_clusters(cluster_items_of(scene), 1, average=20, rng=rng)
    pairs = np.unique(np.stack([heap, clusters.cluster_of[:120]]), axis=1)
    assert 6 <= pairs.shape[1] <= 8
    assert (np.bincount(pairs[1]) > 1).sum() <= 1  # hardly a cluster has polygons of two heaps
    assert (clusters.cluster_of == clusters.cluster_of[120]).sum() == 1


@pytest.mark.parametrize("polygons", [[], squares(np.tile([[1.0, 2, 3]], (1500, 1)), 0.2), [np.zeros((3, 3))] * 1500])
def test_nothing_and_heaps_of_one_place(polygons):
    scene = scene_of(polygons)
    items = cluster_items_of(scene)
    assert_partition(bounding_volume_clusters(items, scene.room_count, average=50, rng=np.random.default_rng(0)), items)
