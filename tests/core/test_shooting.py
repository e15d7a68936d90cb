"""Shooting against a dense linear solve of the same links, assembled link by link."""

import functools

import numpy as np
import pytest
from enfilade.core.emitters import emitters_of
from enfilade.core.links import Gains
from enfilade.core.ordering import STRATEGIES, visible_sets
from enfilade.core.ordering.candidates import max_energy
from enfilade.core.routes import RoutesInMemory, RoutesOnDisk
from enfilade.core.shooting import Radiosity, Shooter, Shot
from enfilade.core.store import Space
from scenery import building_of, linked, scene_of

SIDE = np.array([(0, 0), (3, 0), (3, 1), (1.2, 1), (1.2, 2), (0, 2)], float)


def l_room():
    """An L-shaped room: floor and ceiling are covered in part, and one end does not see the other."""
    floor = np.column_stack([SIDE, np.zeros(6)])
    walls = [np.array([a, b, [*b[:2], 1.5], [*a[:2], 1.5]]) for a, b in zip(floor, np.roll(floor, -1, 0), strict=True)]
    return [floor, floor[::-1] + [0, 0, 1.5], *(w[::-1] for w in walls)]


class Crammed(Space):
    """A budget in which nothing fits: every array is in a file, and its pages are given back whenever it is asked."""

    def __init__(self, folder):
        super().__init__(1, 0, folder)

    def fits(self, size):
        return size == 0


class Case:
    """Links of the room, light of made-up luminaires, and the dense operator of one reflection."""

    def __init__(self, order, seed=0, gain=True):
        rng = np.random.default_rng(seed)
        reflectance = rng.uniform(0.2, 0.8, (8, 3))
        reflectance[3] = 0
        building = building_of(scene_of(l_room(), reflectance=reflectance), large_polygon=0.5)
        # Coarse on purpose, so that the dense system is small; links of all shapes occur.
        self.forest, linking = linked(building, order, exchange=6e-3, min_size=0.35 if order < 3 else 0.6)
        self.building, self.links = building, linking.links
        forest = self.forest
        self.leaf = np.flatnonzero(forest.leaf)
        start = np.zeros((len(forest), forest.functions, 3))
        start[self.leaf] = 0.1 * rng.normal(size=(len(self.leaf), forest.functions, 3))
        start[self.leaf, 0] += rng.uniform(0.5, 2, (len(self.leaf), 3))
        self.direct = forest.pull(start).astype(np.float32)
        self.gains = Gains(*np.ones((2, len(forest), forest.node_count), np.float32))
        if gain:
            for factor in vars(self.gains).values():
                factor[self.leaf] = rng.uniform(0.9, 1.1, (len(self.leaf), forest.node_count))
        self.emitted = 100.0

    def shooter(self, unit=None, direct=None, space=None):
        unit = self.building.clusters.cluster_of[self.forest.region] if unit is None else unit
        direct = self.direct if direct is None else direct
        emitters = emitters_of(self.forest, unit, int(unit.max()) + 1)
        routes = RoutesInMemory(self.links, emitters) if space is None else RoutesOnDisk(self.links, emitters, space.zeros)
        return Shooter(self.forest, routes, emitters, np.zeros(len(emitters), int), direct, self.gains, self.emitted, space)

    def run(self, tolerance=1e-7, ordering="max_energy", iterations=1000, **more):
        return self.steps(ordering, 1, tolerance, iterations, **more)[-1]

    def steps(self, ordering, seed, tolerance, iterations=1000, **more):
        clusters = self.building.clusters
        sets = visible_sets(self.building.graph, clusters.polygons, np.arange(len(clusters)), len(clusters))
        *shots, light = self.shooter(**more).run(STRATEGIES[ordering](sets), np.random.default_rng(seed), tolerance, iterations)
        assert all(isinstance(s, Shot) for s in shots)
        assert isinstance(light, Radiosity)
        return [*shots, light]

    def operator(self):
        """(n * m, n * m): irradiance of leaves by reflection from exitance of leaves."""
        forest, leaf = self.forest, self.leaf
        count, m, q = len(forest), forest.functions, forest.node_count
        everything = np.arange(count)
        columns = np.zeros((count, m, len(leaf) * m))
        sent = forest.at_nodes(leaf, np.eye(len(leaf) * m).reshape(len(leaf), m, -1)) * self.gains.sent[leaf][..., None]
        columns[leaf] = forest.from_nodes(leaf, sent)
        power = forest.at_nodes(everything, forest.pull(columns)) * forest.node_weights[..., None].astype(float)
        gathered = np.zeros((count, q, len(leaf) * m))
        for group in self.links:
            for a, b, k in zip(group.a, group.b, group.exchange.astype(float), strict=True):
                for source, receiver, exchange in ((b, a, k), (a, b, k.T)):
                    sent = power[source] if exchange.shape[1] > 1 else power[source].sum(0, keepdims=True)
                    gathered[receiver] += exchange @ sent  # one receiving node: the same light for all nodes
        light = forest.push(forest.from_nodes(everything, gathered))[leaf]
        return forest.from_nodes(leaf, forest.at_nodes(leaf, light) * self.gains.received[leaf][..., None]).reshape(len(leaf) * m, -1)

    @functools.cached_property
    def exact(self):
        """(n, m, 3) irradiance by reflection on the leaves, from the dense solve."""
        once = self.operator()
        direct = self.direct[self.leaf].astype(float)
        out = np.zeros_like(direct)
        for channel in range(3):
            rho = np.repeat(self.building.regions.reflectance[self.forest.region[self.leaf], channel], self.forest.functions)
            total = np.linalg.solve(np.eye(len(once)) - once * rho, direct[..., channel].ravel())
            out[..., channel] = total.reshape(direct.shape[:2]) - direct[..., channel]
        return out


CASES = {order: Case(order) for order in (1, 2, 3)}
orders = pytest.mark.parametrize("order", [1, 2, 3])


@orders
def test_the_cases_hold_links_of_many_shapes(order):
    case = CASES[order]
    shapes = {group.shape for group in case.links}
    assert len(shapes) > 1
    assert len(case.leaf) < len(case.forest)
    linked_parents = np.isin(np.concatenate([g.a for g in case.links]), np.flatnonzero(~case.forest.leaf))
    assert linked_parents.any()
    assert (~case.building.regions.full).any()


@orders
@pytest.mark.parametrize("ordering", sorted(STRATEGIES))
def test_shooting_solves_the_linear_system(order, ordering):
    case = CASES[order]
    exact = case.exact
    light = case.run(ordering=ordering)
    # Single precision in some hundred sums; nothing of the method is left in the difference.
    np.testing.assert_allclose(light.irradiance[case.leaf], exact, atol=2e-5 * np.abs(exact).max())


@orders
def test_the_unit_of_shooting_does_not_matter(order):
    case = CASES[order]
    count = len(case.forest)
    alone = case.run(unit=np.zeros(count, int))
    by_region = case.run(unit=case.forest.region.astype(int))
    by_cluster = case.run()
    scale = np.abs(by_cluster.irradiance).max()
    np.testing.assert_allclose(alone.irradiance, by_cluster.irradiance, atol=2e-5 * scale)
    np.testing.assert_allclose(by_region.irradiance, by_cluster.irradiance, atol=2e-5 * scale)
    # One unit shoots all at once, as Jacobi does; many units use what has just arrived and need fewer rounds.
    assert by_region.iterations < alone.iterations


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_the_error_is_within_the_unshot_light(tolerance):
    case = CASES[2]
    exact = case.exact
    light = case.run(tolerance=tolerance)
    assert light.unshot.sum() <= tolerance * case.emitted
    left = np.abs(case.forest.mean(case.leaf, light.irradiance[case.leaf] - exact)).max()
    rho = case.building.regions.reflectance.max()
    # Rows of the operator add up to one in a closed room, give or take the error of its links.
    assert left <= 1.2 * light.unshot_exitance / (1 - rho) + 1e-5
    assert left > 1e-3 * tolerance


@orders
def test_inner_elements_hold_the_mean_of_their_leaves(order):
    case = CASES[order]
    forest, light = case.forest, case.run()
    np.testing.assert_allclose(light.irradiance, forest.pull(np.where(forest.leaf[:, None, None], light.irradiance, 0)), atol=1e-6)


@orders
def test_power_is_neither_lost_nor_made(order):
    case = Case(order, seed=3, gain=False)
    forest, leaf = case.forest, case.leaf
    light = case.run(tolerance=1e-6)
    arrived = np.einsum("nc,n->c", forest.mean(leaf, light.irradiance[leaf]), forest.area[leaf])
    # The nodes of partly covered elements integrate linear functions exactly, quadratic ones nearly.
    rtol = 1e-4 if order < 3 else 3e-3
    np.testing.assert_allclose(light.received.sum(0), arrived, rtol=rtol)
    # What each unit has received and been lit by, times its reflectance, has been shot or is left.
    reflectance = case.building.regions.reflectance[forest.region[leaf]]
    first = np.einsum("nc,n,nc->c", forest.mean(leaf, case.direct[leaf]), forest.area[leaf], reflectance)
    again = np.einsum("nc,n,nc->c", forest.mean(leaf, light.irradiance[leaf]), forest.area[leaf], reflectance)
    np.testing.assert_allclose(light.shot.sum(0) + light.unshot, first + again, rtol=rtol)


def test_light_doubles_with_the_light_that_comes_in():
    case = CASES[2]
    once, twice = case.run(), case.run(direct=2 * case.direct, tolerance=2e-7)
    np.testing.assert_allclose(twice.irradiance, 2 * once.irradiance, rtol=1e-4, atol=1e-5)


def test_no_light_no_shots():
    case = CASES[2]
    steps = list(case.shooter(direct=0 * case.direct).run(max_energy, np.random.default_rng(0), 1e-3, 10))
    assert len(steps) == 1
    assert not steps[0].irradiance.any()
    assert (steps[0].iterations, steps[0].unshot_exitance) == (0, 0.0)


def test_shots_tell_how_far_they_are_and_iterations_end():
    case = CASES[2]
    *shots, light = case.shooter().run(max_energy, np.random.default_rng(0), 1e-12, 3)
    assert light.iterations == 3
    assert sorted({s.iteration for s in shots}) == [0, 1, 2]
    assert all(s.unshot_fraction > 1e-12 for s in shots)
    assert shots[-1].unshot_fraction < shots[0].unshot_fraction
    assert light.unshot.sum() / case.emitted == pytest.approx(shots[-1].unshot_fraction)
    exact = case.exact
    assert 1e-4 < np.abs(light.irradiance[case.leaf] - exact).max() / np.abs(exact).max() < 0.3


def largest_part_that_comes_back(case):
    """Spectral radius of one reflection: light converges where it is below 1."""
    reflectance = case.building.regions.reflectance[case.forest.region[case.leaf]]
    once = case.operator()
    return max(np.abs(np.linalg.eigvals(once * np.repeat(rho, case.forest.functions))).max() for rho in reflectance.T)


def test_light_that_grows_is_given_up():
    case = Case(2)
    case.gains.sent[case.leaf] *= 1.1 / largest_part_that_comes_back(case)
    light = case.run()
    assert light.iterations < 100
    assert light.growing == 0
    assert np.isfinite(light.irradiance).all()


def test_slow_light_is_waited_for():
    case = Case(2)
    case.gains.sent[case.leaf] *= 0.95 / largest_part_that_comes_back(case)
    light = case.run(tolerance=1e-6)
    assert light.growing == -1
    assert light.unshot.sum() <= 1e-6 * case.emitted
    exact = case.exact
    assert np.abs(light.irradiance[case.leaf] - exact).max() < 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("ordering", sorted(STRATEGIES))
def test_in_core_and_out_of_core_are_the_same_bits(ordering, tmp_path):
    case = CASES[2]
    expected = case.steps(ordering, 5, 1e-3)
    found = case.steps(ordering, 5, 1e-3, space=Crammed(tmp_path))
    assert found[:-1] == expected[:-1]
    for name in ("irradiance", "unshot", "received", "shot"):
        np.testing.assert_array_equal(getattr(found[-1], name), getattr(expected[-1], name))


@pytest.mark.parametrize("ordering", sorted(STRATEGIES))
def test_each_emitter_shoots_once_in_every_iteration(ordering):
    case = CASES[2]
    *shots, light = case.steps(ordering, 5, 1e-3)
    lit = np.unique(case.building.clusters.cluster_of[case.building.regions.reflectance.any(1)])
    for iteration in range(light.iterations):
        assert sorted(s.emitter for s in shots if s.iteration == iteration) == lit.tolist()
    assert [s.iteration for s in shots] == sorted(s.iteration for s in shots)


@pytest.mark.parametrize("ordering", sorted(STRATEGIES))
def test_the_same_seed_gives_the_same_bits(ordering):
    once, again = (CASES[2].steps(ordering, 5, 1e-3) for _ in range(2))
    assert once[:-1] == again[:-1]
    np.testing.assert_array_equal(once[-1].irradiance, again[-1].irradiance)
