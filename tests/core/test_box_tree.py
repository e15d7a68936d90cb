"""Boxes that meet boxes and rays, against the test of all pairs."""

import numpy as np
import pytest
from enfilade.core.box_tree import BoxTree


def boxes(rng, count, dimensions=3, groups=3):
    middle, half = rng.uniform(-5, 5, (count, dimensions)), rng.exponential(0.3, (count, dimensions))
    return middle - half, middle + half, rng.integers(0, groups, count)


def pairs(blocks):
    return sorted((int(a), int(b)) for first, second in blocks for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("count", [0, 1, 7, 9, 300])
def test_all_pairs_of_boxes_that_touch(dimensions, count):
    rng = np.random.default_rng(count)
    low, high, group = boxes(rng, count, dimensions)
    other_low, other_high, other_group = boxes(rng, 200, dimensions)
    meets = (low[:, None] <= other_high).all(2) & (high[:, None] >= other_low).all(2) & (group[:, None] == other_group)
    assert pairs(BoxTree(low, high, group).overlaps(other_low, other_high, other_group)) == sorted(zip(*np.nonzero(meets), strict=True))


def test_flat_boxes_that_share_a_face_touch():
    low, high = np.array([[0.0, 0, 0], [0, 0, 1]]), np.array([[1.0, 1, 0], [1, 1, 1]])
    found = pairs(BoxTree(low, high, np.zeros(2, int)).overlaps(np.array([[1.0, 1, 0]]), np.array([[2.0, 2, 2]]), np.zeros(1, int)))
    assert found == [(0, 0), (1, 0)]


@pytest.mark.parametrize("reach", [0.5, 3.0, np.inf])
def test_all_boxes_that_rays_touch(reach):
    rng = np.random.default_rng(1)
    low, high, group = boxes(rng, 400)
    origin, direction, ray_group = rng.uniform(-5, 5, (60, 3)), rng.normal(size=(60, 3)), rng.integers(0, 3, 60)
    direction[:6] = np.concatenate([np.eye(3), -np.eye(3)])  # along the axes
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found = set(pairs(BoxTree(low, high, group).along(origin, direction, ray_group, reach)))
    # Every box that holds one of many places along the ray is named, and none that all of them stay clear of.
    way = np.linspace(0, min(reach, 15), 300)
    for ray in range(60):
        place = (origin[ray] + way[:, None] * direction[ray])[:, None]
        outside = np.maximum(low - place, place - high).max(2).min(0)
        own = group == ray_group[ray]
        named = {box for box, r in found if r == ray}
        assert set(np.flatnonzero((outside <= 0) & own)) <= named <= set(np.flatnonzero((outside < 0.05) & own))


def test_the_work_grows_with_what_is_met():
    # 2 x 20,000 little boxes on a line: each meets three, and not a hundredth of all pairs is looked at.
    x = np.arange(20_000.0)[:, None] * [1, 0, 0]
    looked = 0

    class Counting(BoxTree):
        def _walk(self, count, meets):
            def counted(nodes, node, question):
                nonlocal looked
                looked += len(node)
                return meets(nodes, node, question)

            return super()._walk(count, counted)

    group = np.zeros(len(x), int)
    found = sum(len(a) for a, _ in Counting(x, x + 1, group).overlaps(x, x + 1, group))
    assert found == 3 * 20_000 - 2
    assert looked < 100 * 20_000
