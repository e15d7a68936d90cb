"""Clusters of whole rooms: what stands alone, how many there are, and a valid partition whatever comes in."""

import numpy as np
import pytest
from cluster_scenes import assert_partition, random_scene, scene_of, squares
from enfilade.core.clustering import (
    DISTANCE_FUNCTIONS,
    SEEDINGS,
    ClusterItems,
    Clusters,
    cells,
    cluster_as_chosen,
    cluster_items,
    cluster_items_of,
    weighted_sum,
)
from enfilade.core.clustering.isodata import MAX_STEPS
from enfilade.core.options import DISTANCES, Options
from enfilade.core.stage_files import StageError, load_stage, save_stage


def cluster(scene, **choices):
    """Clusters of the polygons of a scene."""
    return cluster_items(cluster_items_of(scene), scene.room_count, **choices)


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


def test_average_sets_the_number_of_clusters():
    items = cluster_items_of(scene_of(squares(np.random.default_rng(1).random((1000, 3)) * 50, 0.1)))
    for average, expected in ((1, 1000), (10, 100), (333, 3), (1000, 1), (100_000, 1)):
        assert len(cluster_items(items, 1, average=average, rng=np.random.default_rng(0))) == pytest.approx(expected, rel=0.02)


def test_weights_count_as_polygons():
    items = cluster_items_of(scene_of(squares(np.random.default_rng(1).random((40, 3)) * 50, 0.1)))
    heavy = ClusterItems(**{**vars(items), "weight": np.full(40, 10)})
    assert len(cluster_items(heavy, 1, average=50, rng=np.random.default_rng(0))) == 8
    assert cluster_items(heavy, 1, average=50, rng=np.random.default_rng(0)).polygons.sum() == 400


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
    ways = ({"split_merge": 0}, {"seeding": "random"}, {"huge_room": 0}, {"huge_room": 0, "hierarchy_children": 2, "split_merge": 5})
    for choices in ways:
        options = Options(average=average, distance=distance, **choices)
        clusters = cluster_as_chosen(items, scene.room_count, options, np.random.default_rng(0))
        assert_partition(clusters, items)
        assert (clusters.iterations <= MAX_STEPS).all()


@pytest.mark.parametrize("huge_room", [4000, 0])
def test_an_offset_changes_nothing(huge_room):
    rng = np.random.default_rng(9)
    centres = rng.integers(0, 4096, (500, 3)) / 512  # exact also after the shift
    near, far = (scene_of(squares(centres + shift, 0.125)) for shift in (0.0, 2.0**20))
    a, b = (cluster(s, average=10, huge_room=huge_room, rng=np.random.default_rng(3)) for s in (near, far))
    np.testing.assert_array_equal(a.cluster_of, b.cluster_of)


def test_the_same_generator_gives_the_same_clusters():
    scene = random_scene(5)
    a, b, c = (cluster(scene, average=4, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.cluster_of, b.cluster_of)
    assert not np.array_equal(a.cluster_of, c.cluster_of)


def test_choices_of_a_user_arrive():
    """Each choice makes what the same argument makes, and other clusters than the default."""
    rng = np.random.default_rng(11)
    polygons = squares(rng.random((300, 3)) * [8, 6, 3], 0.2)
    items = cluster_items_of(scene_of([p[::-1] if turned else p for p, turned in zip(polygons, rng.random(300) < 0.5, strict=True)]))
    items = ClusterItems(**{**vars(items), "reflectance": rng.random((300, 3)), "emission": rng.random((300, 3)) * 9})

    def labels(**choices):
        return cluster_as_chosen(items, 1, Options(average=10, **choices), np.random.default_rng(2)).cluster_of.tolist()

    near = (1.0, DISTANCE_FUNCTIONS["barycenter"])
    red, shining, turned = (DISTANCE_FUNCTIONS[name] for name in ("reflectance", "emission", "orientation"))
    seen = [labels()]
    for choices, arguments in [
        ({"distance": "closest_vertex"}, {"distance": DISTANCE_FUNCTIONS["closest_vertex"]}),
        ({"reflectance_weight": 2.0}, {"distance": weighted_sum(near, (2.0, red))}),
        ({"emission_weight": 0.5}, {"distance": weighted_sum(near, (0.5, shining))}),
        (
            {"distance": "closest_vertex", "orientation_weight": 3.0},
            {"distance": weighted_sum((1.0, DISTANCE_FUNCTIONS["closest_vertex"]), (3.0, turned))},
        ),
        ({"seeding": "random"}, {"seeding": SEEDINGS["random"]}),
        ({"huge_room": 200, "hierarchy_children": 3}, {"huge_room": 200, "children": (3,)}),
        ({"split_merge": 0}, {"split_merge": 0}),
        ({"large_polygon": 0.1}, {"large_polygon": 0.1}),
    ]:
        found = labels(**choices)
        assert found == cluster_items(items, 1, average=10, rng=np.random.default_rng(2), **arguments).cluster_of.tolist()
        assert found not in seen
        seen.append(found)


def test_cells_are_rooms():
    scene = random_scene(2)
    items = cluster_items_of(scene)
    rooms = cells(items, scene.room_count)
    assert_partition(rooms, items)
    assert rooms.room.tolist() == np.unique(scene.room).tolist()


def test_clusters_on_disk(tmp_path):
    clusters = cluster(random_scene(3), average=5, rng=np.random.default_rng(0))
    save_stage(clusters, tmp_path / "clusters.npz")
    loaded = load_stage(Clusters, tmp_path / "clusters.npz")
    for name, value in vars(clusters).items():
        assert value.dtype == getattr(loaded, name).dtype
        np.testing.assert_array_equal(value, getattr(loaded, name))
    with pytest.raises(StageError, match=r"not a saved ClusterItems; delete it"):
        load_stage(ClusterItems, tmp_path / "clusters.npz")
    (tmp_path / "clusters.npz").write_bytes((tmp_path / "clusters.npz").read_bytes()[:200])
    for path in (tmp_path / "clusters.npz", tmp_path / "none.npz"):
        with pytest.raises(StageError, match="cannot be read"):
            load_stage(Clusters, path)
