"""Clustering: known Lloyd steps, distances by hand, and a valid partition whatever comes in."""

import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import clustering
from enfilade.core.clustering import (
    DISTANCE_FUNCTIONS,
    cells,
    cluster,
    cluster_items,
    cluster_items_of,
    lloyd,
    random_seeds,
    spread_seeds,
)
from enfilade.core.options import DISTANCES
from enfilade.core.scene import Scene
from enfilade.core.stage_files import StageError, load_stage, save_stage

DATA = Path(__file__).resolve().parents[1] / "data"


def scene_of(polygons, room=None):
    """A scene from a list of (n, 3) corner arrays."""
    counts = [len(p) for p in polygons]
    count = len(polygons)
    room = np.zeros(count, np.int32) if room is None else np.asarray(room, np.int32)
    return Scene(
        name="test",
        vertices=np.concatenate(polygons).astype(float) if count else np.zeros((0, 3)),
        corner_vertex=np.arange(sum(counts), dtype=np.int32),
        loop_start=np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
        polygon_start=np.arange(count + 1, dtype=np.int64),
        reflectance=np.full((count, 3), 0.5),
        emission=np.zeros((count, 3)),
        room=room,
        object=np.zeros(count, np.int32),
        room_names=tuple(f"r{i}" for i in range(int(room.max(initial=-1)) + 1)),
        object_names=("o",),
    )


def squares(centres, size):
    """Horizontal squares around (n, 3) centres."""
    return list(np.asarray(centres)[:, None] + size * np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]))


def random_scene(seed, rooms=7, most=40):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, most, rooms)
    room = rng.permutation(np.repeat(np.arange(rooms), counts))
    return scene_of(squares(rng.random((len(room), 3)) * [6, 5, 3] + room[:, None] * [10, 0, 0], 0.2), room)


def assert_partition(clusters, items):
    """Each item in exactly one cluster, of its own room, inside its box; no cluster empty."""
    np.testing.assert_array_equal(np.sort(clusters.members), np.arange(len(items)))
    owner = np.repeat(np.arange(len(clusters)), np.diff(clusters.start))
    np.testing.assert_array_equal(clusters.cluster_of[clusters.members], owner)
    assert (np.diff(clusters.start) > 0).all()
    np.testing.assert_array_equal(clusters.room[clusters.cluster_of], items.room)
    np.testing.assert_array_equal(clusters.polygons, np.bincount(clusters.cluster_of, items.weight, minlength=len(clusters)))
    for c in range(len(clusters)):
        members = clusters.members[clusters.start[c] : clusters.start[c + 1]]
        np.testing.assert_array_equal(clusters.box_min[c], items.box_min[members].min(axis=0))
        np.testing.assert_array_equal(clusters.box_max[c], items.box_max[members].max(axis=0))


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


def test_every_distance_of_the_options_exists():
    assert set(DISTANCES) == set(DISTANCE_FUNCTIONS)


def test_known_assignments_from_a_given_start():
    case = json.loads((DATA / "lloyd_furniture.json").read_text())
    items = cluster_items_of(scene_of([np.array(p) for p in case["polygons"]]))
    count, number = len(items), len(case["initial_barycenters"])
    start = (items, np.arange(count), np.array([0, count]), np.array([number]), np.array(case["initial_barycenters"]))
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
    monkeypatch.setattr(clustering, "BLOCK_PAIRS", block_pairs)
    items = cluster_items_of(random_scene(seed))
    rows = np.argsort(items.room, kind="stable")
    start = np.searchsorted(items.room[rows], np.arange(8))
    number = np.minimum(np.random.default_rng(seed).integers(1, 9, 7), np.diff(start))
    seeds = rows[random_seeds(items.barycenter[rows], start, number, np.random.default_rng(seed))]
    label, steps, _ = lloyd(items, rows, start, number, items.barycenter[seeds], DISTANCE_FUNCTIONS["barycenter"])
    first = np.cumsum(number) - number
    for r in range(7):
        members = rows[start[r] : start[r + 1]]
        if number[r] < 2:
            assert (label[start[r] : start[r + 1]] == first[r]).all()
            continue
        expected, taken = plain_lloyd(items.barycenter[members], items.barycenter[seeds[first[r] : first[r] + number[r]]], 10)
        np.testing.assert_array_equal(label[start[r] : start[r + 1]] - first[r], expected)
        assert steps[r] == taken


HAND = [  # polygon, barycenter of the cluster, distances worked out by hand
    ([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [1, 1, 3], {"barycenter": 3, "closest_vertex": 11**0.5, "orthogonal": 3}),
    ([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [5, 2, 4], {"barycenter": 33**0.5, "closest_vertex": 5, "orthogonal": 4}),
    ([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [3, 3, 0], {"barycenter": 8**0.5, "closest_vertex": 3, "orthogonal": 0}),
    ([[1, 1, 1], [1, 1, 1], [1, 1, 1]], [1, 1, 6], {"barycenter": 5, "closest_vertex": 5, "orthogonal": 5}),  # no area, no plane
]


@pytest.mark.parametrize("name", DISTANCES)
def test_distances_by_hand_in_both_block_forms(name):
    items = cluster_items_of(scene_of([np.array(p, float) for p, _, _ in HAND]))
    centres = np.array([c for _, c, _ in HAND], float)
    expected = np.array([d[name] for _, _, d in HAND], float)
    rows = np.arange(len(HAND))
    shared = DISTANCE_FUNCTIONS[name](items, rows, centres[None])
    np.testing.assert_allclose(np.diag(shared), expected, rtol=1e-12, atol=1e-7)
    own = DISTANCE_FUNCTIONS[name](items, rows, centres[:, None])
    np.testing.assert_allclose(own[:, 0], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(shared, DISTANCE_FUNCTIONS[name](items, rows, np.tile(centres, (len(rows), 1, 1))), atol=1e-7)


def test_items_of_a_scene():
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    rectangle = np.array([[0, 0, 0], [3, 0, 0], [3, 0.5, 0], [1, 0.5, 0], [0, 0.5, 0]]) @ turn.T + 7  # with a corner inside an edge
    triangle = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]])
    items = cluster_items_of(scene_of([rectangle, triangle, np.zeros((3, 3))]))
    np.testing.assert_allclose(items.smaller_edge, [0.5, 2.4, 0], atol=1e-12)  # the altitude of 3-4-5 on its hypotenuse
    np.testing.assert_allclose(items.barycenter[1], [1, 4 / 3, 0])
    np.testing.assert_allclose(items.normal, [turn[:, 2] * np.linalg.det(turn), [0, 0, 1], [0, 0, 0]], atol=1e-12)
    np.testing.assert_array_equal(items.box_max[1], [3, 4, 0])


def test_large_polygons_stand_alone():
    polygons = squares([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]], 0.5) + squares([[0, 0, 1], [0, 0, 2]], 1.5)
    slab = [np.array([[0, 0, 0], [9, 0, 0], [9, 0.9, 0], [0, 0.9, 0]])]  # long but narrow: not large
    clusters = cluster(scene_of(polygons + slab), average=50, rng=np.random.default_rng(0))
    assert [clusters.members[clusters.start[c] : clusters.start[c + 1]].tolist() for c in range(len(clusters))] == [
        [0, 1, 2, 3, 6],
        [4],
        [5],
    ]
    assert len(cluster(scene_of(polygons), average=50, large_polygon=2.0, rng=np.random.default_rng(0))) == 1
    assert len(cluster(scene_of(polygons), average=50, large_polygon=0.0, rng=np.random.default_rng(0))) == 6


def test_separate_heaps_become_clusters():
    rng = np.random.default_rng(4)
    heap = np.repeat(np.arange(6), 20)
    centres = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0], [0, 0, 9], [9, 9, 9]])[heap] + rng.random((120, 3))
    clusters = cluster(scene_of(squares(centres, 0.1)), average=20, rng=rng)
    assert len(np.unique(np.stack([heap, clusters.cluster_of]), axis=1).T) == 6
    assert clusters.polygons.tolist() == [20] * 6


def test_spread_seeds_make_tighter_boxes_than_random_ones():
    rng = np.random.default_rng(12)
    heaps = np.repeat(rng.random((40, 3)) * 20, 10, axis=0)
    items = cluster_items_of(scene_of(squares(heaps + rng.random((400, 3)), 0.1)))
    volume = {}
    for seeding in (spread_seeds, random_seeds):
        runs = [cluster_items(items, 1, average=10, seeding=seeding, rng=np.random.default_rng(seed)) for seed in range(5)]
        volume[seeding] = sum(np.prod(c.box_max - c.box_min, axis=1).sum() for c in runs)
    assert volume[spread_seeds] < 0.5 * volume[random_seeds]


@pytest.mark.parametrize("seeding", [random_seeds, spread_seeds])
def test_seeds_are_different_rows_of_their_rooms(seeding):
    rng = np.random.default_rng(6)
    size = np.array([5, 0, 1, 30, 12])
    number = np.array([5, 0, 1, 7, 3])
    start = np.concatenate([[0], np.cumsum(size)])
    seeds = seeding(rng.random((48, 3)), start, number, rng)
    room = np.repeat(np.arange(5), number)
    assert len(np.unique(seeds)) == len(seeds) == 16
    assert ((seeds >= start[room]) & (seeds < start[room + 1])).all()


def test_average_sets_the_number_of_clusters():
    items = cluster_items_of(scene_of(squares(np.random.default_rng(1).random((1000, 3)) * 50, 0.1)))
    for average, expected in ((1, 1000), (10, 100), (333, 3), (1000, 1), (100_000, 1)):
        assert len(cluster_items(items, 1, average=average, rng=np.random.default_rng(0))) == pytest.approx(expected, rel=0.02)


def test_weights_count_as_polygons():
    items = cluster_items_of(scene_of(squares(np.random.default_rng(1).random((40, 3)) * 50, 0.1)))
    heavy = clustering.ClusterItems(**{**vars(items), "weight": np.full(40, 10)})
    assert len(cluster_items(heavy, 1, average=50, rng=np.random.default_rng(0))) == 8
    assert cluster_items(heavy, 1, average=50, rng=np.random.default_rng(0)).polygons.sum() == 400


def test_oscillation_is_recognised_and_stops():
    items = cluster_items_of(scene_of(squares([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], 0.1)))
    calls = []

    def restless(items, rows, barycenters):
        """Sends everything to the first and to the second barycenter in turn."""
        calls.append(1)
        return np.tile([1.0, 2.0] if len(calls) % 2 else [2.0, 1.0], (len(rows), 1))

    _, steps, oscillated = lloyd(items, np.arange(4), np.array([0, 4]), np.array([2]), items.barycenter[:2], restless)
    assert (steps.tolist(), oscillated.tolist()) == ([3], [True])


def degenerate_scenes():
    rng = np.random.default_rng(8)
    point = squares(np.tile([[1.0, 2, 3]], (1500, 1)), 0.2)
    plane = squares(np.c_[rng.random((300, 2)) * 9, np.zeros(300)], 0.1)
    yield "coincident", scene_of(point)
    yield "one plane", scene_of(plane)
    yield "one polygon", scene_of(plane[:1])
    yield "no area", scene_of([p * [1, 0, 0] for p in plane] + [np.zeros((3, 3))] * 5)
    yield "far off", scene_of([p + 1e6 for p in plane])
    yield "none", scene_of([])
    yield "a room without polygons", scene_of(plane, np.repeat([0, 2, 5], 100))


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("average", [1, 7, 10_000])
@pytest.mark.parametrize(("name", "scene"), list(degenerate_scenes()))
def test_any_scene_gives_a_partition(name, scene, average, distance):
    items = cluster_items_of(scene)
    for seeding in (spread_seeds, random_seeds):
        clusters = cluster_items(
            items, scene.room_count, average=average, distance=DISTANCE_FUNCTIONS[distance], seeding=seeding, rng=np.random.default_rng(0)
        )
        assert_partition(clusters, items)
        assert (clusters.iterations <= clustering.MAX_STEPS).all()


def test_an_offset_changes_nothing():
    rng = np.random.default_rng(9)
    centres = rng.integers(0, 4096, (500, 3)) / 512  # exact also after the shift
    near, far = (scene_of(squares(centres + shift, 0.125)) for shift in (0.0, 2.0**20))
    a, b = (cluster(s, average=10, rng=np.random.default_rng(3)) for s in (near, far))
    np.testing.assert_array_equal(a.cluster_of, b.cluster_of)


def test_the_same_generator_gives_the_same_clusters():
    scene = random_scene(5)
    a, b, c = (cluster(scene, average=4, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.cluster_of, b.cluster_of)
    assert not np.array_equal(a.cluster_of, c.cluster_of)


def test_cells_are_rooms():
    scene = random_scene(2)
    items = cluster_items_of(scene)
    rooms = cells(items, scene.room_count)
    assert_partition(rooms, items)
    assert rooms.room.tolist() == np.unique(scene.room).tolist()


def test_clusters_on_disk(tmp_path):
    clusters = cluster(random_scene(3), average=5, rng=np.random.default_rng(0))
    save_stage(clusters, tmp_path / "clusters.npz")
    loaded = load_stage(clustering.Clusters, tmp_path / "clusters.npz")
    for name, value in vars(clusters).items():
        assert value.dtype == getattr(loaded, name).dtype
        np.testing.assert_array_equal(value, getattr(loaded, name))
    with pytest.raises(StageError, match=r"not a saved ClusterItems; delete it"):
        load_stage(clustering.ClusterItems, tmp_path / "clusters.npz")
    (tmp_path / "clusters.npz").write_bytes((tmp_path / "clusters.npz").read_bytes()[:200])
    for path in (tmp_path / "clusters.npz", tmp_path / "none.npz"):
        with pytest.raises(StageError, match="cannot be read"):
            load_stage(clustering.Clusters, path)
