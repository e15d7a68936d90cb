"""Where barycenters begin: different polygons of the right room, and far from one another where that is asked for."""

import numpy as np
import pytest
from cluster_scenes import scene_of, squares
from enfilade.core.clustering import SEEDINGS, cluster_items, cluster_items_of, random_seeds, spread_seeds
from enfilade.core.options import SEEDINGS as CHOICES


def test_every_seeding_of_the_options_exists():
    assert set(CHOICES) == set(SEEDINGS)


def test_spread_seeds_make_tighter_boxes_than_random_ones():
    rng = np.random.default_rng(12)
    heaps = np.repeat(rng.random((40, 3)) * 20, 10, axis=0)
    items = cluster_items_of(scene_of(squares(heaps + rng.random((400, 3)), 0.1)))
    volume = {}
    for seeding in (spread_seeds, random_seeds):
        runs = [cluster_items(items, 1, average=10, seeding=seeding, split_merge=0, rng=np.random.default_rng(seed)) for seed in range(5)]
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
