"""Array idioms against plain Python."""

import numpy as np
import pytest
from enfilade.core.grouping import GrowingArray, components, gathered, morton, ragged, runs, starts_of
from hypothesis import given, settings
from hypothesis import strategies as st

ranges = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 6)), max_size=12)


@given(ranges)
@settings(max_examples=60, deadline=None)
def test_ragged_is_a_chain_of_ranges(pairs):
    starts, counts = [np.array([p[k] for p in pairs], int) for k in (0, 1)]
    members, owner = ragged(starts, counts)
    assert members.tolist() == [s + k for s, n in pairs for k in range(n)]
    assert owner.tolist() == [i for i, (_, n) in enumerate(pairs) for _ in range(n)]


@given(st.lists(st.integers(0, 9)), st.integers(0, 3))
@settings(max_examples=60, deadline=None)
def test_starts_of_sorted_keys(keys, more):
    keys = np.sort(np.array(keys, int))
    count = 10 + more
    start = starts_of(keys, count)
    assert np.diff(start).tolist() == [int((keys == k).sum()) for k in range(count)]
    assert (start[0], start[-1]) == (0, len(keys))


def labels_by_search(count, a, b):
    neighbours = {i: set() for i in range(count)}
    for i, j in zip(a, b, strict=True):
        neighbours[i].add(j)
        neighbours[j].add(i)
    label, fresh = [-1] * count, 0
    for first in range(count):
        if label[first] < 0:
            stack = [first]
            while stack:
                i = stack.pop()
                if label[i] < 0:
                    label[i] = fresh
                    stack += neighbours[i]
            fresh += 1
    return label


@given(st.integers(1, 30), st.data())
@settings(max_examples=100, deadline=None)
def test_components_are_those_of_a_search(count, data):
    node = st.integers(0, count - 1)
    edges = data.draw(st.lists(st.tuples(node, node), max_size=40))
    a, b = [np.array([e[k] for e in edges], int) for k in (0, 1)]
    assert components(count, a, b).tolist() == labels_by_search(count, a.tolist(), b.tolist())


def test_components_of_a_long_chain_in_random_order():
    rng = np.random.default_rng(0)
    order = rng.permutation(5000)
    keep = np.arange(4999) % 1000 != 999
    label = components(5000, order[:-1][keep], order[1:][keep])
    assert label.max() == 4
    assert (np.diff(label[order].reshape(5, 1000), axis=1) == 0).all()


@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
def test_a_growing_array_holds_what_was_put_in(shape):
    rng = np.random.default_rng(0)
    array, expected = GrowingArray(shape, np.float32), np.zeros((0, *shape), np.float32)
    for count in (0, 1, 15, 1, 0, 100, 7, 1000):
        rows = rng.random((count, *shape)).astype(np.float32)
        array.extend(rows)
        expected = np.concatenate([expected, rows])
        assert len(array) == len(expected)
        np.testing.assert_array_equal(array.view(), expected)
    array.view()[3] = 7
    assert (array.view()[3] == 7).all()


def test_a_morton_curve_visits_the_eighths_of_a_cube_one_after_another():
    place = np.random.default_rng(0).random((2000, 3)) * 7 - 3
    order = np.argsort(morton(place), kind="stable")
    middle = 0.5 * (place.min(0) + place.min(0) + np.ptp(place, axis=0).max())
    eighth = ((place > middle) * [1, 2, 4]).sum(1)[order]
    assert eighth.tolist() == sorted(eighth.tolist())
    assert morton(np.zeros((0, 3))).tolist() == []
    assert morton(np.full((4, 3), 5.0)).tolist() == [0] * 4  # all in one place


@given(st.lists(st.integers(1, 9), max_size=20), st.integers(1, 15))
@settings(max_examples=60, deadline=None)
def test_gathered_blocks_hold_every_member_once_within_the_size(weights, size):
    parts = list(np.split(np.arange(sum(weights)), np.cumsum(weights)[:-1])) if weights else []
    place = np.random.default_rng(1).random((len(weights), 3))
    blocks = gathered(parts, place, np.array(weights), size)
    assert sorted(k for block in blocks for k in block.tolist()) == list(range(sum(weights)))
    single = {tuple(p.tolist()) for p in parts}
    assert all(len(block) <= size or tuple(block.tolist()) in single for block in blocks)


@pytest.mark.parametrize("keys", [[], [3], [1, 1, 1], [1, 2, 2, 5, 5, 5, 6]])
def test_runs_begin_where_a_key_differs_from_the_one_before(keys):
    expected = [k for k in range(len(keys)) if k == 0 or keys[k] != keys[k - 1]]
    assert runs(np.array(keys, int)).tolist() == expected
