"""Multi-wavelet bases: orthonormal, nested from scale to scale, and fitted to nodes without a loss of the mean."""

import numpy as np
import pytest
from enfilade.core.basis import SLOTS, evaluate, fit, gauss, gauss_square, nodes_per_axis, two_scale

ORDERS = (1, 2, 3)
COVERS = ([0, 1, 2, 3], [4, 5], [6, 7])
orders = pytest.mark.parametrize("order", ORDERS)


def rule(count=9):
    """A tensor rule of its own, far finer than the bases need."""
    x, w = np.polynomial.legendre.leggauss(count)
    x, w = (x + 1) / 2, w / 2
    return np.stack([a.ravel() for a in np.meshgrid(x, x)], 1), np.outer(w, w).ravel()


@orders
def test_functions_are_orthonormal(order):
    x, w = rule()
    values = evaluate(order, x)
    np.testing.assert_allclose(values.T @ (w[:, None] * values), np.eye(order**2), atol=1e-13)


@orders
def test_the_constant_comes_first_and_u_runs_slowest(order):
    x, _ = rule()
    values = evaluate(order, x)
    assert (values[:, 0] == 1).all()
    for i in range(order):
        for j in range(order):
            u_alone, v_alone = values[:, i * order], values[:, j]
            np.testing.assert_allclose(values[:, i * order + j], u_alone * v_alone, atol=1e-14)
    if order > 1:
        np.testing.assert_allclose(values[:, order], np.sqrt(3) * (2 * x[:, 0] - 1), atol=1e-14)
        np.testing.assert_allclose(values[:, 1], np.sqrt(3) * (2 * x[:, 1] - 1), atol=1e-14)


@orders
def test_values_take_any_shape_of_points(order):
    x, _ = rule(4)
    np.testing.assert_array_equal(evaluate(order, x.reshape(2, 8, 2)), evaluate(order, x).reshape(2, 8, order**2))


@pytest.mark.parametrize("count", range(1, 6))
def test_gauss_rules_are_exact_to_their_degree(count):
    x, w = gauss(count)
    for degree in range(2 * count):
        assert w @ x**degree == pytest.approx(1 / (degree + 1), rel=1e-13)
    assert w @ x ** (2 * count) != pytest.approx(1 / (2 * count + 1), rel=1e-9)
    xy, weight = gauss_square(count)
    np.testing.assert_allclose(xy, [(a, b) for a in x for b in x])
    np.testing.assert_allclose(weight, [a * b for a in w for b in w])


@orders
def test_nodes_integrate_products_of_two_functions(order):
    x, w = gauss_square(nodes_per_axis(order))
    values = evaluate(order, x)
    np.testing.assert_allclose(values.T @ (w[:, None] * values), np.eye(order**2), atol=1e-13)


@orders
@pytest.mark.parametrize("slot", range(8))
def test_push_gives_the_same_function_on_the_child(order, slot):
    rng = np.random.default_rng(slot)
    parent = rng.normal(size=order**2)
    local = rng.random((50, 2))
    at = SLOTS[slot, :2] + local * SLOTS[slot, 2:]
    child = parent @ two_scale(order)[slot]
    np.testing.assert_allclose(evaluate(order, local) @ child, evaluate(order, at) @ parent, atol=1e-13)


@orders
@pytest.mark.parametrize("slots", COVERS)
def test_push_then_pull_changes_nothing_and_energy_is_kept(order, slots):
    filters, share = two_scale(order)[slots], SLOTS[slots, 2:].prod(1)
    parent = np.random.default_rng(0).normal(size=order**2)
    children = np.einsum("i,sij->sj", parent, filters)
    back = np.einsum("s,sij,sj->i", share, filters, children)
    np.testing.assert_allclose(back, parent, atol=1e-14)
    assert share @ (children**2).sum(1) == pytest.approx((parent**2).sum(), rel=1e-14)  # Parseval


@orders
@pytest.mark.parametrize("slots", COVERS)
def test_pull_is_the_best_approximation(order, slots):
    filters, share = two_scale(order)[slots], SLOTS[slots, 2:].prod(1)
    children = np.random.default_rng(1).normal(size=(len(slots), order**2))
    parent = np.einsum("s,sij,sj->i", share, filters, children)
    assert parent[0] == pytest.approx(share @ children[:, 0])
    detail = children - np.einsum("i,sij->sj", parent, filters)
    # What is lost is orthogonal to every function of the parent.
    np.testing.assert_allclose(np.einsum("s,sij,sj->i", share, filters, detail), 0, atol=1e-14)
    assert share @ (children**2).sum(1) == pytest.approx((parent**2).sum() + share @ (detail**2).sum(1))


@orders
def test_a_fit_at_gauss_nodes_inverts_the_basis(order):
    x, w = gauss_square(nodes_per_axis(order))
    values = evaluate(order, x)
    matrix = fit(values[None], w[None])[0]
    np.testing.assert_allclose(matrix @ values, np.eye(order**2), atol=1e-13)


def scattered(order, count, seed):
    """Nodes somewhere in each part of the square, and weights of all sizes."""
    rng = np.random.default_rng(seed)
    q = nodes_per_axis(order)
    x, _ = gauss_square(q)
    x = x + rng.uniform(-0.12, 0.12, (count, q * q, 2)) / q
    return evaluate(order, x), rng.uniform(0.2, 1.0, (count, q * q))


@orders
def test_a_fit_keeps_the_weighted_mean_of_any_values(order):
    values, weights = scattered(order, 30, 0)
    rng = np.random.default_rng(1)
    weights[::3, 0] = 0
    values[::5] = values[::5, :1]  # all nodes in one place
    at_nodes = rng.normal(size=(30, values.shape[1]))
    found = np.einsum("nmq,nq->nm", fit(values, weights), at_nodes)
    share = weights / weights.sum(1, keepdims=True)
    mean_of_fit = np.einsum("nq,nqm,nm->n", share, values, found)
    np.testing.assert_allclose(mean_of_fit, (share * at_nodes).sum(1), atol=1e-12)


@orders
def test_a_fit_reproduces_what_the_basis_holds(order):
    values, weights = scattered(order, 30, 2)
    coefficients = np.random.default_rng(3).normal(size=(30, order**2))
    at_nodes = np.einsum("nqm,nm->nq", values, coefficients)
    np.testing.assert_allclose(np.einsum("nmq,nq->nm", fit(values, weights), at_nodes), coefficients, atol=1e-10)


@pytest.mark.parametrize("order", [2, 3])
def test_nodes_in_a_sliver_give_a_constant(order):
    q = nodes_per_axis(order)
    x, _ = gauss_square(q)
    sliver = evaluate(order, 0.5 + 1e-3 * (x - 0.5))
    weights = np.random.default_rng(0).uniform(0.1, 1, (1, q * q))
    light = np.random.default_rng(1).normal(size=q * q)
    found = fit(sliver[None], weights)[0] @ light
    assert np.abs(found[1:]).max() == 0
    assert found[0] == pytest.approx(weights[0] @ light / weights.sum())


@pytest.mark.parametrize("order", [2, 3])
def test_a_fit_never_has_more_energy_than_its_values(order):
    # Nodes and weights of every kind, down to slivers: what is left out of a fit may only make it smaller.
    rng = np.random.default_rng(5)
    q = nodes_per_axis(order)
    x = rng.random((500, q * q, 2)) * rng.uniform(0.01, 1, (500, 1, 2))
    weights = rng.uniform(0, 1, (500, q * q)) ** 4
    share = weights / weights.sum(1, keepdims=True)
    values, light = evaluate(order, x), rng.uniform(-1, 1, (500, q * q))
    fitted = np.einsum("nqm,nmr,nr->nq", values, fit(values, weights), light)
    assert ((share * fitted**2).sum(1) <= (share * light**2).sum(1) + 1e-12).all()
