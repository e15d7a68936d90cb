"""Lloyd's iteration: known steps from a given start, all rooms at once, and oscillation."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from cluster_scenes import random_scene, scene_of, squares
from enfilade.core.clustering import DISTANCE_FUNCTIONS, ClusterItems, cluster_items_of, isodata, random_seeds, spread_seeds
from enfilade.core.clustering.isodata import lloyd
from enfilade.core.scene_files import load_scene

DATA = Path(__file__).resolve().parents[1] / "data"


def plain_lloyd(points, seeds, steps):
    """The textbook loop, one room: labels and steps taken."""
    seeds, label = seeds.copy(), None
    for step in range(1, steps + 1):
        new = np.linalg.norm(points[:, None] - seeds[None], axis=2).argmin(axis=1)
        if label is not None and (new == label).all():
            return label, step
        label = new
        for k in range(len(seeds)):
            if (label == k).any():
                seeds[k] = points[label == k].mean(axis=0)
    return label, steps


def test_known_assignments_from_a_given_start():
    case = json.loads((DATA / "lloyd_furniture.json").read_text())
    items = cluster_items_of(scene_of([np.array(p) for p in case["polygons"]]))
    count, number = len(items), len(case["initial_barycenters"])
    start = (items, np.arange(count), np.array([0, count]), np.array([number]), np.arange(number))
    np.testing.assert_allclose(items.barycenter[:number], case["initial_barycenters"], rtol=1e-12)
    label, steps, oscillated = lloyd(*start, DISTANCE_FUNCTIONS["barycenter"])
    assert label.tolist() == case["labels"]
    assert (steps.tolist(), oscillated.tolist()) == ([case["steps"] + 1], [False])  # one more sees that nothing changes
    assert lloyd(*start, DISTANCE_FUNCTIONS["barycenter"], steps=case["steps"])[0].tolist() == case["labels"]
    assert lloyd(*start, DISTANCE_FUNCTIONS["barycenter"], steps=case["steps"] - 1)[0].tolist() != case["labels"]
    means = [items.barycenter[label == k].mean(axis=0) for k in range(number)]
    np.testing.assert_allclose(means, case["barycenters"], rtol=1e-9)


@pytest.mark.parametrize("block_pairs", [40, 1 << 18])  # rooms in blocks of their own, rooms together
@pytest.mark.parametrize("seed", range(5))
def test_all_rooms_at_once_agree_with_the_plain_loop(monkeypatch, seed, block_pairs):
    monkeypatch.setattr(isodata, "BLOCK_PAIRS", block_pairs)
    items = cluster_items_of(random_scene(seed))
    rows = np.argsort(items.room, kind="stable")
    start = np.searchsorted(items.room[rows], np.arange(8))
    number = np.minimum(np.random.default_rng(seed).integers(1, 9, 7), np.diff(start))
    seeds = rows[random_seeds(items.barycenter[rows], start, number, np.random.default_rng(seed))]
    label, steps, _ = lloyd(items, rows, start, number, seeds, DISTANCE_FUNCTIONS["barycenter"])
    first = np.cumsum(number) - number
    for r in range(7):
        members = rows[start[r] : start[r + 1]]
        if number[r] < 2:
            assert (label[start[r] : start[r + 1]] == first[r]).all()
            continue
        expected, taken = plain_lloyd(items.barycenter[members], items.barycenter[seeds[first[r] : first[r] + number[r]]], 10)
        np.testing.assert_array_equal(label[start[r] : start[r + 1]] - first[r], expected)
        assert steps[r] == taken


def test_oscillation_is_recognised_and_stops():
    items = cluster_items_of(scene_of(squares([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], 0.1)))
    calls = []

    def restless(items, rows, candidates):
        """Sends everything to the first and to the second barycenter in turn."""
        calls.append(1)
        return np.tile([1.0, 2.0] if len(calls) % 2 else [2.0, 1.0], (len(rows), 1))

    _, steps, oscillated = lloyd(items, np.arange(4), np.array([0, 4]), np.array([2]), np.arange(2), restless)
    assert (steps.tolist(), oscillated.tolist()) == ([3], [True])


def polygons_of(name):
    """The polygons of a scene, each shaken by a millimetre: furniture on a raster has ties, and one tie changes all that follows."""
    scene = load_scene(DATA / "bench" / f"{name}.npz")
    items = cluster_items_of(scene)
    shaken = items.barycenter + 1e-3 * np.random.default_rng(1).random((len(items), 3))
    return ClusterItems(**{**vars(items), "barycenter": shaken}), scene.room_count


@pytest.mark.parametrize(("name", "average"), [("office", 5), ("office", 50), ("hard", 10), ("cornell", 3)])
def test_scikit_learn_makes_the_same_assignments_from_the_same_start(name, average):
    """In every room and after any number of steps."""
    k_means = pytest.importorskip("sklearn.cluster").KMeans
    items, rooms = polygons_of(name)
    rows = np.argsort(items.room, kind="stable")
    start = np.searchsorted(items.room[rows], np.arange(rooms + 1))
    number = np.maximum(np.diff(start) // average, np.minimum(np.diff(start), 1))
    # What scikit-learn does with a cluster that loses all its items is its own affair: seeds on different places lose none here.
    seeds = rows[spread_seeds(items.barycenter[rows], start, number, np.random.default_rng(7))]
    first = np.cumsum(number) - number
    for steps in (1, 2, 5, 10):
        label, _, _ = lloyd(items, rows, start, number, seeds, DISTANCE_FUNCTIONS["barycenter"], steps=steps)
        for r in np.flatnonzero(number > 1):
            own = slice(start[r], start[r + 1])
            points, begin = items.barycenter[rows[own]], items.barycenter[seeds[first[r] : first[r] + number[r]]]
            # One iteration there moves the centres before the labels are taken: n labels here are n - 1 iterations and a prediction.
            model = begin
            if steps > 1:
                settings = {"n_init": 1, "max_iter": steps - 1, "tol": 0, "algorithm": "lloyd"}
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # it says that it did not converge
                    model = k_means(number[r], init=begin, **settings).fit(points).cluster_centers_
            expected = np.linalg.norm(points[:, None] - model, axis=2).argmin(axis=1)
            np.testing.assert_array_equal(label[own] - first[r], expected)
