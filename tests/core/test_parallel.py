"""Blocks of work on threads: order, errors and an early end."""

import threading
import time

import pytest
from enfilade.core.parallel import ordered_map, worker_count


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_results_come_in_the_order_of_the_blocks(workers):
    def slow_first(k):
        time.sleep(0.02 if k % 3 == 0 else 0)
        return k * k

    assert list(ordered_map(slow_first, range(20), workers)) == [k * k for k in range(20)]
    assert list(ordered_map(slow_first, [], workers)) == []


def test_blocks_run_side_by_side():
    both = threading.Barrier(2, timeout=10)
    assert list(ordered_map(lambda _: both.wait() >= 0, range(2), 2)) == [True, True]


@pytest.mark.parametrize("workers", [1, 3])
def test_an_error_in_a_block_reaches_the_caller(workers):
    def fail(k):
        if k == 4:
            raise KeyError("block four")
        return k

    found = []
    with pytest.raises(KeyError, match="block four"):
        found.extend(ordered_map(fail, range(1000), workers))
    assert found == list(range(len(found)))
    assert len(found) <= 4


@pytest.mark.parametrize("workers", [1, 2])
def test_blocks_are_taken_a_few_ahead_and_none_after_the_end(workers):
    taken, done = [], []

    def blocks():
        for k in range(1000):
            taken.append(k)
            yield k

    results = ordered_map(lambda k: done.append(k) or k, blocks(), workers)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert len(taken) <= 3 + 2 * workers + 1
    results.close()
    count = len(done)
    time.sleep(0.05)
    assert len(done) == count <= len(taken) < 20


def test_the_number_of_workers():
    assert worker_count(3) == 3
    assert worker_count(0) >= 1
