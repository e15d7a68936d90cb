"""Distances between polygons and clusters: by hand, in both forms of a block, summed, and a user's own."""

import numpy as np
import pytest
from cluster_scenes import scene_of, squares
from enfilade.core.clustering import DISTANCE_FUNCTIONS, Candidates, ClusterItems, cluster_items, cluster_items_of, weighted_sum
from enfilade.core.clustering.distances import Groups
from enfilade.core.options import DISTANCES


def point_clusters(positions):
    """Candidates at given barycenters, each seen by all items: a form with no items of its own."""
    count = len(positions)
    items = cluster_items_of(scene_of([np.tile(p, (3, 1)) for p in np.asarray(positions, float)]))
    return Candidates(Groups(items, np.arange(count)), np.arange(count)[None])


def joined(groups, label, index=None):
    """Candidates of items (polygons) that are in the clusters ``label`` already."""
    items = cluster_items_of(scene_of([np.array(p, float) for p in groups]))
    label = np.array(label)
    state = Groups(items, np.array([np.flatnonzero(label == k)[0] for k in range(label.max() + 1)]))
    state.move(np.arange(len(items)), label)
    return Candidates(state, np.arange(label.max() + 1)[None] if index is None else index)


def test_every_distance_of_the_options_exists():
    assert set(DISTANCES) == set(DISTANCE_FUNCTIONS)


HAND = [  # polygon, barycenter of the cluster, distances worked out by hand
    ([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [1, 1, 3], {"barycenter": 3, "closest_vertex": 11**0.5, "orthogonal": 3}),
    ([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [5, 2, 4], {"barycenter": 33**0.5, "closest_vertex": 5, "orthogonal": 4}),
    ([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [3, 3, 0], {"barycenter": 8**0.5, "closest_vertex": 3, "orthogonal": 0}),
    ([[1, 1, 1], [1, 1, 1], [1, 1, 1]], [1, 1, 6], {"barycenter": 5, "closest_vertex": 5, "orthogonal": 5}),  # no area, no plane
]


@pytest.mark.parametrize("name", ["barycenter", "closest_vertex", "orthogonal"])
def test_distances_to_a_barycenter_by_hand(name):
    items = cluster_items_of(scene_of([np.array(p, float) for p, _, _ in HAND]))
    found = DISTANCE_FUNCTIONS[name](items, np.arange(len(HAND)), point_clusters([c for _, c, _ in HAND]))
    np.testing.assert_allclose(np.diag(found), [d[name] for _, _, d in HAND], rtol=1e-12, atol=1e-7)


UNIT_CUBE = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]]]  # its bottom and its top
INSERTED = [
    [[2, 0, 0], [3, 0, 0], [3, 1, 0], [2, 1, 0]],  # the box becomes 3 x 1 x 1
    [[0.2, 0.2, 0.5], [0.8, 0.2, 0.5], [0.8, 0.8, 0.5], [0.2, 0.8, 0.5]],  # lies within
    [[0, 0, 2], [1, 0, 2], [1, 1, 2], [0, 1, 2]],  # 1 x 1 x 2
]


@pytest.mark.parametrize(("name", "expected"), [("volume_increase", [2, 0, 1]), ("area_increase", [8, 0, 4])])
def test_increases_of_a_box_by_hand(name, expected):
    items = cluster_items_of(scene_of([np.array(p, float) for p in INSERTED]))
    found = DISTANCE_FUNCTIONS[name](items, np.arange(3), joined(UNIT_CUBE, [0, 0]))
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-12, atol=0)


def test_a_flat_box_grows_in_its_plane_without_volume_but_not_without_surface():
    wall = joined(UNIT_CUBE[:1], [0])
    far = cluster_items_of(scene_of([np.array([[9.0, 0, 0], [10, 0, 0], [10, 1, 0], [9, 1, 0]])]))
    assert DISTANCE_FUNCTIONS["volume_increase"](far, np.arange(1), wall)[0, 0] == 0
    assert DISTANCE_FUNCTIONS["area_increase"](far, np.arange(1), wall)[0, 0] == pytest.approx(18)


def coloured(polygons, reflectance, emission):
    items = cluster_items_of(scene_of([np.array(p, float) for p in polygons]))
    return ClusterItems(**{**vars(items), "reflectance": np.array(reflectance, float), "emission": np.array(emission, float)})


def test_photometric_distances_by_hand():
    floor, wall = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]]
    ceiling = [[0, 0, 2], [0, 1, 2], [1, 1, 2], [1, 0, 2]]
    items = coloured([floor, wall, ceiling], [[0.2, 0.5, 0.5], [0.8, 0.5, 0.5], [0.5, 0.9, 0.5]], [[0, 0, 0], [4, 0, 0], [5, 0, 0]])
    groups = Groups(items, np.array([0, 2]))
    groups.move(np.arange(3), np.array([0, 0, 1]))  # floor and wall, and the ceiling
    candidates = Candidates(groups, np.array([[0, 1]]))
    rows = np.array([2, 0])
    expected = {
        "reflectance": [[0.4, 0], [0.3, 0.5]],  # mean of the first: (0.5, 0.5, 0.5)
        "emission": [[3, 0], [2, 5]],
        "orientation": [[(1.5**2 + 0.5**2) ** 0.5, 0], [0.5**0.5, 2]],  # mean normal (0, 1, 1) / 2 for normals (0, 0, 1) and (0, 1, 0)
    }
    for name, values in expected.items():
        np.testing.assert_allclose(DISTANCE_FUNCTIONS[name](items, rows, candidates), values, atol=1e-12, err_msg=name)
    total = weighted_sum((2.0, DISTANCE_FUNCTIONS["emission"]), (10.0, DISTANCE_FUNCTIONS["reflectance"]))
    np.testing.assert_allclose(total(items, rows, candidates), [[10, 0], [7, 15]], atol=1e-12)


@pytest.mark.parametrize("terms", [(), ((-1.0, DISTANCE_FUNCTIONS["barycenter"]),), ((float("nan"), DISTANCE_FUNCTIONS["barycenter"]),)])
def test_weighted_sums_that_make_no_sense_are_refused(terms):
    with pytest.raises(ValueError, match="weighted sum"):
        weighted_sum(*terms)


@pytest.mark.parametrize("name", DISTANCES)
def test_shared_and_own_candidates_agree(name):
    rng = np.random.default_rng(5)
    tilted = [p + rng.normal(size=(4, 3)) * 0.05 for p in squares(rng.random((30, 3)) * 4, 0.3)]
    items = coloured(tilted, rng.random((30, 3)), rng.random((30, 3)) * 10)
    groups = Groups(items, np.arange(6))
    groups.move(np.arange(30), np.arange(30) % 6)
    rows = rng.permutation(30)[:11]
    shared = DISTANCE_FUNCTIONS[name](items, rows, Candidates(groups, np.arange(6)[None]))
    own = DISTANCE_FUNCTIONS[name](items, rows, Candidates(groups, np.tile(np.arange(6), (11, 1))))
    assert shared.shape == own.shape == (11, 6)
    np.testing.assert_allclose(shared, own, atol=1e-7)
    picked = np.stack([rng.permutation(6)[:2] for _ in rows])
    some = DISTANCE_FUNCTIONS[name](items, rows, Candidates(groups, picked))
    np.testing.assert_allclose(some, np.take_along_axis(own, picked, axis=1), atol=1e-12)


def test_a_cluster_without_items_stays_as_it_was():
    items = cluster_items_of(scene_of(squares([[0, 0, 0], [1, 0, 0], [5, 0, 0]], 1.0)))
    groups = Groups(items, np.array([0, 2]))
    assert groups.of("box_max")[:, 0].tolist() == [0.5, 5.5]
    groups.move(np.arange(3), np.zeros(3, int))
    assert groups.of("barycenter")[:, 0].tolist() == [2.0, 5.0]
    assert groups.of("box_max")[:, 0].tolist() == [5.5, 5.5]
    assert groups.of("box_min")[:, 0].tolist() == [-0.5, 4.5]


def test_a_distance_of_the_users_own():
    """Height alone: clusters are storeys, however far their polygons lie apart."""
    rng = np.random.default_rng(3)
    storey = np.repeat(np.arange(4), 25)
    items = cluster_items_of(scene_of(squares(np.c_[rng.random((100, 2)) * 50, 3.0 * storey + rng.random(100) * 0.1], 0.1)))

    def height(items, rows, candidates):
        return np.abs(items.barycenter[rows, 2][:, None] - candidates.barycenter[..., 2])

    def far_seeds(position, start, number, rng):
        return np.arange(0, 100, 25)

    clusters = cluster_items(items, 1, average=25, distance=height, seeding=far_seeds, split_merge=0, rng=rng)
    np.testing.assert_array_equal(clusters.cluster_of, storey)


def test_a_weight_on_reflectance_parts_colours_that_lie_together():
    rng = np.random.default_rng(9)
    red = rng.random(60) < 0.5
    reflectance = np.where(red[:, None], [0.8, 0.1, 0.1], [0.1, 0.1, 0.8])
    items = coloured(squares(rng.random((60, 3)), 0.05), reflectance, np.zeros((60, 3)))
    distance = weighted_sum((1.0, DISTANCE_FUNCTIONS["barycenter"]), (100.0, DISTANCE_FUNCTIONS["reflectance"]))

    def one_of_each(position, start, number, rng):
        return np.array([np.flatnonzero(red)[0], np.flatnonzero(~red)[0]])

    clusters = cluster_items(items, 1, average=30, distance=distance, seeding=one_of_each, split_merge=0, rng=rng)
    assert len(clusters) == 2
    assert len(np.unique(red[clusters.cluster_of == 0])) == 1
