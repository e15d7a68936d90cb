"""Scenes for the tests of clustering, and what holds of every set of clusters."""

import numpy as np
from enfilade.core.scene import Scene


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
