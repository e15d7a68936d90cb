"""Trees of clusters, and the clusters of huge rooms that come of them."""

import numpy as np
import pytest
from cluster_scenes import assert_partition, random_scene, scene_of, squares
from enfilade.core.clustering import DISTANCE_FUNCTIONS, cluster_items, cluster_items_of, hierarchy_of
from enfilade.core.clustering.hierarchy import cluster_numbers
from enfilade.core.clustering.items import clusters_as_items
from enfilade.core.clustering.neighbours import nearest_clusters, settle
from enfilade.core.clustering.quality import void_volume
from enfilade.core.options import DISTANCES
from enfilade.core.stage_files import load_stage, save_stage


def heaps(count, polygons, seed=0, spread=30.0):
    """Small squares in heaps that lie far apart; the heap of every square."""
    rng = np.random.default_rng(seed)
    heap = rng.permutation(np.repeat(np.arange(count), polygons))
    places = np.stack(np.meshgrid(*[np.arange(int(np.ceil(count ** (1 / 3))))] * 3, indexing="ij"), -1).reshape(-1, 3)[:count] * spread
    return scene_of(squares(places[heap] + rng.random((len(heap), 3)), 0.1)), heap


def assert_trees(tree, clusters, children):
    """Every cluster at one leaf, in the tree of its room; parents before children, none with more than allowed; boxes that hold."""
    leaves = tree.child_count == 0
    np.testing.assert_array_equal(np.sort(tree.cluster[leaves]), np.arange(len(clusters)))
    assert (tree.cluster[~leaves] == -1).all()
    np.testing.assert_array_equal(clusters.room[tree.cluster[leaves]], tree.room[leaves])
    assert sorted(tree.room[tree.parent == -1]) == np.unique(clusters.room).tolist()
    most = np.array([children[min(level, len(children) - 1)] for level in tree.level])
    assert (tree.child_count <= most).all()
    assert (tree.child_count != 1).all()
    for node in range(len(tree)):
        for child in tree.children(node):
            assert child > node
            assert tree.parent[child] == node
            assert tree.level[child] == tree.level[node] + 1
        below = tree.clusters_below(node)
        np.testing.assert_array_equal(tree.box_min[node], clusters.box_min[below].min(axis=0))
        np.testing.assert_array_equal(tree.box_max[node], clusters.box_max[below].max(axis=0))
        if not leaves[node]:
            np.testing.assert_array_equal(np.sort(np.concatenate([tree.clusters_below(c) for c in tree.children(node)])), below)


@pytest.mark.parametrize("children", [(2,), (5,), (4, 3, 2)])
@pytest.mark.parametrize("distance", ["barycenter", "closest_vertex", "area_increase"])
def test_trees_of_all_rooms(children, distance):
    scene = random_scene(3, rooms=6, most=90)
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=2, rng=np.random.default_rng(0))
    tree = hierarchy_of(items, clusters, children=children, distance=DISTANCE_FUNCTIONS[distance], rng=np.random.default_rng(1))
    assert_trees(tree, clusters, children)


@pytest.mark.parametrize("distance", DISTANCES)
def test_clusters_that_coincide_have_leaves_of_their_own(distance):
    scene = scene_of(squares(np.tile([[1.0, 2, 3]], (37, 1)), 2.0))  # large polygons: each a cluster
    items = cluster_items_of(scene)
    clusters = cluster_items(items, 1, average=50, rng=np.random.default_rng(0))
    assert len(clusters) == 37
    tree = hierarchy_of(items, clusters, children=(3,), distance=DISTANCE_FUNCTIONS[distance], rng=np.random.default_rng(1))
    assert_trees(tree, clusters, (3,))
    assert tree.level.max() == 4  # 3 ** 3 < 37 <= 3 ** 4: evenly dealt


def test_one_cluster_and_none():
    for count in (0, 1):
        items = cluster_items_of(scene_of(squares(np.zeros((count, 3)), 0.1)))
        clusters = cluster_items(items, 1, average=50, rng=np.random.default_rng(0))
        tree = hierarchy_of(items, clusters, rng=np.random.default_rng(0))
        assert len(tree) == count
        assert_trees(tree, clusters, (2,))


def test_children_under_two_are_refused():
    items = cluster_items_of(random_scene(1))
    clusters = cluster_items(items, 7, average=5, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="two children"):
        hierarchy_of(items, clusters, children=(4, 1), rng=np.random.default_rng(0))


def test_a_tree_on_disk(tmp_path):
    items = cluster_items_of(random_scene(4))
    clusters = cluster_items(items, 7, average=2, rng=np.random.default_rng(0))
    tree = hierarchy_of(items, clusters, rng=np.random.default_rng(0))
    save_stage(tree, tmp_path / "hierarchy.npz")
    assert_trees(load_stage(type(tree), tmp_path / "hierarchy.npz"), clusters, (2,))


def test_a_tree_finds_wings_then_heaps():
    """Two wings of two heaps each: the binary tree parts the wings first."""
    rng = np.random.default_rng(2)
    centres = np.repeat([[0, 0, 0], [8, 0, 0], [200, 0, 0], [208, 0, 0]], 30, axis=0) + rng.random((120, 3))
    items = cluster_items_of(scene_of(squares(centres, 0.1)))
    clusters = cluster_items(items, 1, average=5, rng=rng)
    tree = hierarchy_of(items, clusters, rng=rng)
    wing = (0.5 * (clusters.box_min + clusters.box_max))[:, 0] > 100
    parts = [wing[tree.clusters_below(c)] for c in tree.children(0)]
    assert sorted(p.mean() for p in parts) == [0, 1]


def test_clusters_as_items_by_hand():
    scene = scene_of(squares([[0, 0, 0], [1, 0, 0], [50, 0, 0]], 0.5))
    items = cluster_items_of(scene)
    clusters = cluster_items(items, 1, average=2, rng=np.random.default_rng(1))
    gathered = clusters_as_items(items, clusters)
    np.testing.assert_allclose(gathered.barycenter, [[0.5, 0, 0], [50, 0, 0]])
    np.testing.assert_allclose(gathered.normal, [[0, 0, 1], [0, 0, 1]])
    np.testing.assert_allclose(gathered.reflectance, 0.5)
    assert gathered.vertex_start.tolist() == [0, 8, 12]
    np.testing.assert_allclose(gathered.vertices[8:], items.vertices[8:])


@pytest.mark.parametrize("children", [(2,), (16,), (3, 7)])
def test_a_huge_room_finds_the_heaps_that_it_is_made_of(children):
    scene, heap = heaps(27, 40)
    items = cluster_items_of(scene)
    clusters = cluster_items(items, 1, average=40, huge_room=1000, children=children, rng=np.random.default_rng(0))
    assert_partition(clusters, items)
    assert abs(len(clusters) - 27) <= 5
    pairs = np.unique(np.stack([heap, clusters.cluster_of]), axis=1)
    assert (np.bincount(pairs[1]) == 1).sum() >= len(clusters) - 5  # hardly a cluster with polygons of two heaps


def test_a_huge_room_gets_the_number_of_clusters_that_was_asked_for():
    items = cluster_items_of(scene_of(squares(np.random.default_rng(1).random((6000, 3)) * 50, 0.1)))
    for average in (5, 50, 150):
        clusters = cluster_items(items, 1, average=average, huge_room=4000, rng=np.random.default_rng(0))
        assert len(clusters) == pytest.approx(6000 / average, rel=0.02)


def test_only_huge_rooms_are_divided():
    small, large = heaps(8, 10)[0], heaps(8, 60)[0]
    polygons = [s.vertices.reshape(-1, 4, 3) for s in (small, large, small)]
    room = np.repeat([0, 1, 2], [80, 480, 80])
    items = cluster_items_of(scene_of(list(np.concatenate(polygons)), room))

    def labels(huge_room):
        clusters = cluster_items(items, 3, average=10, huge_room=huge_room, rng=np.random.default_rng(0))
        assert_partition(clusters, items)
        return clusters

    flat, mixed, at_limit = labels(1000), labels(100), labels(480)
    np.testing.assert_array_equal(flat.cluster_of, at_limit.cluster_of)
    np.testing.assert_array_equal(flat.cluster_of[:80], mixed.cluster_of[:80])
    assert not np.array_equal(flat.cluster_of[80:560], mixed.cluster_of[80:560])
    assert (mixed.iterations > 0).all()


def test_numbers_of_clusters_are_rounded():
    assert cluster_numbers(np.array([0, 1, 74, 75, 500]), 50).tolist() == [1, 1, 1, 2, 10]


def test_nearest_clusters_are_the_nearest():
    points = np.random.default_rng(3).random((300, 3))
    near = nearest_clusters(points, np.array([0, 300]))
    squared = ((points[:, None] - points[None]) ** 2).sum(-1)
    np.testing.assert_array_equal(near, np.argsort(squared, axis=1)[:, :8])


def test_nearest_clusters_are_of_the_same_room():
    rng = np.random.default_rng(8)
    size = np.array([1, 40, 0, 3, 500, 12])
    start = np.concatenate([[0], np.cumsum(size)])
    points = rng.random((size.sum(), 3)) * [9, 7, 3] + 1e5
    near = nearest_clusters(points, start)
    for r in range(len(size)):
        own = points[start[r] : start[r + 1]]
        squared = ((own[:, None] - own[None]) ** 2).sum(-1)
        expected = start[r] + np.argsort(squared, axis=1)[:, :8]
        np.testing.assert_array_equal(near[start[r] : start[r + 1], : expected.shape[1]], expected)
        missing = np.arange(start[r], start[r + 1])[:, None].repeat(8 - min(8, size[r]), axis=1)
        np.testing.assert_array_equal(near[start[r] : start[r + 1], expected.shape[1] :], missing)


def test_nearest_clusters_of_many_lie_along_the_longest_axis():
    """Beyond the window nothing is found, and in a row of clusters nothing is there."""
    points = np.random.default_rng(4).permutation(np.c_[np.arange(5000) * 2.0, np.zeros((5000, 2))])
    near = nearest_clusters(points, np.array([0, 5000]))
    reach = np.abs(points[near, 0] - points[:, None, 0])
    assert (near[:, 0] == np.arange(5000)).all()
    inner = (points[:, 0] > 10) & (points[:, 0] < 9980)
    np.testing.assert_array_equal(np.sort(reach[inner], axis=1)[:, 1:7], np.tile([2, 2, 4, 4, 6, 6], (inner.sum(), 1)))


def test_settling_moves_polygons_to_the_nearer_cluster_and_rests():
    """In two rooms at once, one of which is at rest from the start."""
    places = [[0, 0, 0], [1, 0, 0], [10, 0, 0], [11, 0, 0], [1.5, 0, 0], [0, 0, 0], [5, 0, 0]]
    items = cluster_items_of(scene_of(squares(places, 0.1), [0, 0, 0, 0, 0, 1, 1]))
    start, cluster_start = np.array([0, 5, 7]), np.array([0, 2, 4])
    label = np.array([0, 0, 1, 1, 1, 2, 3])
    label, steps, again = settle(items, np.arange(7), start, label, cluster_start, DISTANCE_FUNCTIONS["barycenter"])
    assert (label.tolist(), steps.tolist(), again.tolist()) == ([0, 0, 1, 1, 0, 2, 3], [2, 1], [False, False])


def test_settling_sees_that_it_swings():
    items = cluster_items_of(scene_of(squares(np.c_[np.arange(4), np.zeros((4, 2))], 0.1)))

    def restless(items, rows, candidates):
        """Every polygon prefers another cluster to its own."""
        return np.tile([2.0, 1.0] + [3.0] * 6, (len(rows), 1))

    _, steps, again = settle(items, np.arange(4), np.array([0, 4]), np.array([0, 0, 1, 1]), np.array([0, 2]), restless)
    assert (steps.tolist(), again.tolist()) == ([3], [True])


def shelves(polygons):
    """Long thin heaps of very different density in one room, whose size grows with their number."""
    rng = np.random.default_rng(6)
    count = polygons // 100
    places = rng.random((count, 3)) * np.array([30, 30, 6]) * (count / 60) ** (1 / 3)
    heap = rng.choice(count, polygons, p=(w := rng.random(count) ** 3) / w.sum())
    return cluster_items_of(scene_of(squares(places[heap] + rng.random((polygons, 3)) * [2.0, 0.3, 0.3], 0.1)))


def test_a_divided_room_is_as_good_as_one_clustered_flat():
    """Volume and void share at most a tenth more."""
    items = shelves(6000)

    def figures(huge_room):
        runs = [cluster_items(items, 1, average=50, huge_room=huge_room, rng=np.random.default_rng(seed)) for seed in range(3)]
        volume = sum(np.prod(c.box_max - c.box_min, axis=1).sum() for c in runs)
        return volume, sum(void_volume(items, c).sum() for c in runs) / volume

    (divided, void), (flat, flat_void) = figures(0), figures(100_000)
    assert void <= 1.1 * flat_void
    assert divided <= 1.1 * flat


def test_work_in_a_huge_room_grows_little_faster_than_its_polygons():
    """Distances that are evaluated, in all: sixteen times the polygons, at most 16 ** 1.2 times the work. The flat way takes 16 ** 2."""

    def work(polygons):
        evaluated = 0

        def counting(items, rows, candidates):
            nonlocal evaluated
            result = DISTANCE_FUNCTIONS["barycenter"](items, rows, candidates)
            evaluated += result.size
            return result

        cluster_items(shelves(polygons), 1, average=50, huge_room=1000, distance=counting, rng=np.random.default_rng(0))
        return evaluated

    assert work(32_000) <= 16**1.2 * work(2000)
