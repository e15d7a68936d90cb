"""The seven strategies against their definitions, read off sets of emitters one by one."""

import itertools

import numpy as np
import pytest
from enfilade.core.options import ORDERINGS
from enfilade.core.ordering import STRATEGIES, Candidates, VisibleSets, visible_sets
from enfilade.core.ordering.backtrack import backtrack
from enfilade.core.ordering.reads import Reads
from enfilade.core.ordering.salesman import shortest_tour
from enfilade.core.visibility_graph import VisibilityGraph


class Sets:
    """Emitters on a square floor that see what is near; the same as Python sets."""

    def __init__(self, count, radius=0.3, seed=0):
        rng = np.random.default_rng(seed)
        place = rng.random((count, 2))
        self.sees = np.abs(place[:, None] - place).max(2) < radius
        self.polygons = rng.integers(1, 60, count)
        self.sets = VisibleSets(np.packbits(self.sees, axis=1), self.polygons)
        self.members = [set(np.flatnonzero(row).tolist()) for row in self.sees]
        self.unshot = rng.integers(1, 4, count).astype(float)  # many equals

    def candidates(self, waiting, last, seed=0):
        return Candidates(np.asarray(waiting), self.unshot, last, np.random.default_rng(seed))

    def read(self, emitter, last, kind):
        """What has to be read for an emitter after the last."""
        new = self.members[emitter] - (self.members[last] if last >= 0 else set())
        return len(new) if kind == "c" else int(self.polygons[sorted(new)].sum())

    def path(self, path, last, kind):
        return sum(self.read(b, a, kind) for a, b in itertools.pairwise([last, *path]))

    def best(self, cost, waiting):
        """The one of least cost; of equals, the strongest, then the first."""
        return min(waiting, key=lambda e: (cost[e], -self.unshot[e], e))

    def choices(self, name):
        """(waiting, last, choice) through two iterations."""
        strategy, rng, last = STRATEGIES[name](self.sets), np.random.default_rng(3), -1
        for _ in range(2):
            waiting = list(range(len(self.members)))
            while waiting:
                chosen = strategy(Candidates(np.array(waiting), self.unshot, last, rng))
                assert type(chosen) is int
                yield list(waiting), last, chosen
                waiting.remove(chosen)
                last = chosen


SMALL, LARGE = Sets(24), Sets(150, 0.15)
kinds = pytest.mark.parametrize("kind", ["s", "c"])


def test_all_names_can_be_chosen():
    assert set(STRATEGIES) == set(ORDERINGS)
    assert len(ORDERINGS) == 7


def test_the_strongest_shoots_first_and_the_first_of_equals():
    choose, unshot = STRATEGIES["max_energy"](SMALL.sets), np.array([1.0, 5, 2, 5, 9])
    pick = lambda waiting: choose(Candidates(np.array(waiting), unshot, -1, None))  # noqa: E731
    assert [pick([0, 1, 2, 3, 4]), pick([0, 1, 2, 3]), pick([0, 2, 3]), pick([0])] == [4, 1, 3, 0]


def test_random_takes_any_that_waits_and_repeats_with_its_seed():
    waiting, random = np.array([2, 5, 7]), STRATEGIES["random"](SMALL.sets)
    draws = [[random(Candidates(waiting, np.zeros(9), -1, rng)) for _ in range(300)] for rng in map(np.random.default_rng, (0, 0, 1))]
    assert draws[0] == draws[1] != draws[2]
    assert min(draws[0].count(k) for k in waiting) > 60
    assert set(draws[0]) == {2, 5, 7}


@kinds
def test_greedy_reads_least(kind):
    for waiting, last, chosen in LARGE.choices(f"greedy_{kind}"):
        assert chosen == LARGE.best({e: LARGE.read(e, last, kind) for e in waiting}, waiting)


@kinds
def test_backtrack_finds_the_best_of_all_paths_when_its_tree_is_complete(kind):
    sets = Sets(7, 0.5)
    for waiting, last, chosen in sets.choices(f"backtrack_{kind}"):
        paths = list(itertools.permutations(waiting, min(5, len(waiting))))
        cost = {e: min(sets.path(p, last, kind) for p in paths if p[0] == e) for e in waiting}
        assert chosen == sets.best(cost, waiting)


def test_backtrack_looks_at_the_nearest_alone():
    reads, waiting = Reads(LARGE.sets, LARGE.polygons), [k for k in range(150) if k % 3]
    near = sorted(waiting, key=lambda e: (LARGE.read(e, 0, "s"), -LARGE.unshot[e], e))[:6]
    cost = {e: min(LARGE.path(p, 0, "s") for p in itertools.permutations(near, 3) if p[0] == e) for e in near}
    assert backtrack(reads, depth=3, breadth=6)(LARGE.candidates(waiting, 0)) == LARGE.best(cost, near)


@kinds
def test_backtrack_sees_what_greedy_does_not(kind):
    # 1..5 see one more each, at a cost of 2 every time; 6..10 see one another, at a cost of 5 once.
    sees = np.eye(16, dtype=bool)
    sees[range(1, 6), range(11, 16)] = sees[range(11, 16), range(1, 6)] = True
    sees[6:11, 6:11] = True
    sets = VisibleSets(np.packbits(sees, axis=1), np.full(16, 3))
    at = Candidates(np.arange(1, 11), np.ones(16), 0, None)
    assert STRATEGIES[f"greedy_{kind}"](sets)(at) == 1
    assert STRATEGIES[f"backtrack_{kind}"](sets)(at) == 6


def tour_cost(sets, tour):
    return sum(sets.read(b, a, "s") for a, b in zip(np.roll(tour, 1), tour, strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_the_tour_is_nearly_the_shortest(seed):
    sets = Sets(8, 0.4, seed)
    tour = shortest_tour(sets.sets)
    assert sorted(tour) == list(range(8))
    least = min(tour_cost(sets, (0, *p)) for p in itertools.permutations(range(1, 8)))
    assert tour_cost(sets, tour) <= 1.1 * least


def test_the_tour_goes_round_a_ring():
    # Each sees its two neighbours on either side of a ring: the shortest tour is the ring itself.
    count = 60
    ring = np.random.default_rng(0).permutation(count)
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    sees = np.minimum(apart, count - apart) <= 2
    tour = shortest_tour(VisibleSets(np.packbits(sees[ring][:, ring], axis=1), np.ones(count, int)))
    steps = np.diff(ring[np.r_[tour, tour[0]]]) % count
    assert (steps == 1).all() or (steps == count - 1).all()


def test_the_tour_reads_less_than_greedy_choices():
    greedy = sum(LARGE.read(chosen, last, "s") for _, last, chosen in LARGE.choices("greedy_s"))
    toured = sum(LARGE.read(chosen, last, "s") for _, last, chosen in LARGE.choices("traveling_salesman"))
    assert toured < greedy


def test_the_salesman_begins_at_the_strongest_and_passes_over_who_does_not_wait():
    tour, choose = shortest_tour(LARGE.sets).tolist(), STRATEGIES["traveling_salesman"](LARGE.sets)
    assert choose(LARGE.candidates(range(150), -1)) == LARGE.best(np.zeros(150), range(150))
    waiting = sorted([tour[3], tour[40], tour[90]])
    assert [choose(LARGE.candidates(waiting, tour[k])) for k in (0, 10, 60, 100)] == [tour[k] for k in (3, 40, 90, 3)]


@pytest.mark.parametrize("name", ORDERINGS)
def test_every_emitter_is_chosen_once_and_a_choice_does_not_depend_on_those_before(name):
    for waiting, last, chosen in SMALL.choices(name):
        assert chosen in waiting
        if name != "random" and len(waiting) % 4 == 0:
            assert STRATEGIES[name](SMALL.sets)(SMALL.candidates(waiting, last)) == chosen


@pytest.mark.parametrize("name", ORDERINGS)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_emitters(name, count):
    sets = Sets(count)
    assert sorted(chosen for *_, chosen in sets.choices(name)) == sorted([*range(count)] * 2)


def test_emitters_see_each_other_if_any_of_their_clusters_do():
    unit = np.array([2, 0, 2, 4, 0, 4, 4, 1, 0, 1])  # emitter 3 has no clusters
    graph = Sets(10, 0.25, 5)
    found = visible_sets(VisibilityGraph(graph.sets.bits, graph.polygons), graph.polygons, unit, 5)
    expected = np.zeros((5, 5), bool)
    for a, b in np.argwhere(graph.sees):
        expected[unit[a], unit[b]] = True
    np.testing.assert_array_equal(np.unpackbits(found.bits, axis=1, count=5), expected)
    np.testing.assert_array_equal(found.polygons, [graph.polygons[unit == k].sum() for k in range(5)])
    assert 5 < expected.sum() < 16
