"""Splitting and merging: what pays is done, what does not is left, and boxes come out smaller."""

import json
from pathlib import Path

import numpy as np
import pytest
from cluster_scenes import assert_partition, random_scene, scene_of, squares
from enfilade.core.clustering import DISTANCE_FUNCTIONS, ClusterItems, cluster_items, cluster_items_of, random_seeds, spread_seeds
from enfilade.core.clustering.split_merge import split_and_merge
from enfilade.core.scene_files import load_scene

DATA = Path(__file__).resolve().parents[1] / "data"


def rearranged(items, label, rounds=10, rows=None, start=None):
    """Labels of the items of one room, or of those that are given, after split and merge."""
    rows = np.arange(len(items)) if rows is None else rows
    start = np.array([0, len(rows)]) if start is None else start
    choices = {"distance": DISTANCE_FUNCTIONS["barycenter"], "seeding": spread_seeds, "rng": np.random.default_rng(0)}
    return split_and_merge(items, rows, start, np.asarray(label), rounds, **choices)


def parts(label):
    """The partition that labels make, whatever their numbers."""
    return [int(np.flatnonzero(label == k)[0]) for k in label]


def half_area(items, label):
    total = 0.0
    for k in np.unique(label):
        edge = items.box_max[label == k].max(axis=0) - items.box_min[label == k].min(axis=0)
        total += float(edge[0] * edge[1] + edge[1] * edge[2] + edge[2] * edge[0])
    return total


def test_a_cluster_that_serves_two_heaps_gets_one_of_two_that_share_a_heap():
    """Lloyd's iteration cannot leave this state: every polygon is nearest to its own cluster."""
    rng = np.random.default_rng(1)
    heap = np.repeat([0, 1, 2], 20)
    items = cluster_items_of(scene_of(squares(np.array([[0, 0, 0], [50, 0, 0], [0, 50, 0]])[heap] + rng.random((60, 3)), 0.1)))
    left = items.barycenter[:, 0] < 0.5
    label = np.where(heap == 0, np.where(left, 0, 1), 2)
    assert parts(rearranged(items, label)) == parts(heap)
    assert parts(rearranged(items, label, rounds=0)) == parts(label)


def test_what_is_good_stays():
    heap = np.repeat([0, 1, 2, 3], 10)
    centres = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0]])[heap] + np.random.default_rng(2).random((40, 3))
    items = cluster_items_of(scene_of(squares(centres, 0.1)))
    assert parts(rearranged(items, heap)) == parts(heap)


def test_two_clusters_cannot_be_better_than_two():
    """A split needs a merge of two others, so that the number of clusters stays."""
    items = cluster_items_of(scene_of(squares(np.c_[[0.0, 1, 40, 41], np.zeros((4, 2))], 0.1)))
    assert parts(rearranged(items, [0, 0, 0, 1])) == parts(np.array([0, 0, 0, 1]))


def test_rooms_do_not_touch_one_another():
    """A room that gains and one that does not, together as each alone."""
    rng = np.random.default_rng(3)
    heap = np.repeat([0, 1, 2], 20)
    bad = np.array([[0, 0, 0], [50, 0, 0], [0, 50, 0]])[heap] + rng.random((60, 3))
    good = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0]])[heap] + rng.random((60, 3))
    items = cluster_items_of(scene_of(squares(np.concatenate([good, bad]), 0.1), np.repeat([0, 1], 60)))
    label = np.concatenate([heap, np.where(heap == 0, np.where(bad[:, 0] < 0.5, 0, 1), 2)])  # numbers that both rooms use
    both = rearranged(items, label, rows=np.arange(120), start=np.array([0, 60, 120]))
    assert parts(both[:60]) == parts(heap)
    assert parts(both[60:]) == parts(heap)


@pytest.mark.parametrize("seed", range(4))
def test_boxes_become_smaller_and_clusters_no_more(seed):
    rng = np.random.default_rng(seed)
    heap = rng.choice(30, 900, p=(w := rng.random(30) ** 2) / w.sum())
    centres = (rng.random((30, 3)) * [20, 20, 4])[heap] + rng.random((900, 3)) * [1.5, 0.3, 0.3]
    items = cluster_items_of(scene_of(squares(centres, 0.1)))
    before, after = (cluster_items(items, 1, average=30, split_merge=n, rng=np.random.default_rng(seed)) for n in (0, 6))
    assert_partition(after, items)
    assert len(after) <= len(before)
    assert half_area(items, after.cluster_of) < 0.95 * half_area(items, before.cluster_of)


def test_furnished_rooms_get_tighter_boxes():
    """Nine furnished rooms: a third less volume than Lloyd's iteration alone leaves."""
    scene = load_scene(DATA / "bench" / "office.npz")
    items = cluster_items_of(scene)
    volume = {}
    for rounds in (0, 2):
        runs = [cluster_items(items, scene.room_count, average=50, split_merge=rounds, rng=np.random.default_rng(s)) for s in range(3)]
        volume[rounds] = sum(np.prod(c.box_max - c.box_min, axis=1).sum() for c in runs)
    assert volume[2] < 0.67 * volume[0]


def test_a_user_who_clusters_by_colour_keeps_a_valid_partition():
    items = cluster_items_of(random_scene(3, rooms=4, most=80))
    items = ClusterItems(**{**vars(items), "reflectance": np.random.default_rng(0).random((len(items), 3))})
    for name in ("reflectance", "orientation", "volume_increase"):
        clusters = cluster_items(items, 4, average=4, distance=DISTANCE_FUNCTIONS[name], split_merge=5, rng=np.random.default_rng(0))
        assert_partition(clusters, items)


def test_three_groups_from_random_starts():
    """Well separated groups: Lloyd's iteration finds them from some starts, and with splits and merges from nearly all."""
    case = json.loads((DATA / "three_groups.json").read_text())
    items = cluster_items_of(scene_of([np.tile(p, (3, 1)) + 1e-3 * np.eye(3) for p in case["points"]]))

    def found(rounds):
        choices = {"average": 20, "seeding": random_seeds, "split_merge": rounds}
        runs = [cluster_items(items, 1, rng=np.random.default_rng(seed), **choices).cluster_of for seed in range(30)]
        return sum(parts(label) == parts(np.array(case["partition"])) for label in runs)

    assert found(0) < 25
    assert found(10) >= 27
