"""The forest of elements: areas, nodes, push and pull on rectangles and on what covers them in part."""

import numpy as np
import pytest
from enfilade.core import basis
from enfilade.core.elements import SQUARISH, Forest, Subtrees
from enfilade.core.regions import merge
from scenery import box, rectangle, rotation, scene_of, shoelace

L = np.array([(0, 0), (3, 0), (3, 1), (1.2, 1), (1.2, 2), (0, 2)])
TRIANGLE = np.array([(0, 0), (4, 0.5), (1, 3)])
WALL = np.array([(0, 0), (1, 0), (1, 2), (2, 2), (2, 0), (6, 0), (6, 3), (0, 3)])
WINDOW = np.array([(3.1, 1), (3.1, 2.2), (4.7, 2.2), (4.7, 1)])
PLAIN = np.array([(0, 0), (5, 0), (5, 2), (0, 2)])
SHAPES = {"plain": [PLAIN], "triangle": [TRIANGLE], "L": [L], "wall": [WALL, WINDOW]}
shapes = pytest.mark.parametrize("shape", SHAPES)
orders = pytest.mark.parametrize("order", [1, 2, 3])


def forest_of(shape, order, turn=None, rounds=0, seed=0, share=0.6):
    """A forest of one region, split at random."""
    turn = np.eye(3) if turn is None else turn
    loops = [np.column_stack([loop, np.zeros(len(loop))]) @ turn.T + [1.0, -2, 0.5] for loop in SHAPES[shape]]
    forest = Forest(merge(scene_of([loops])), order)
    split_at_random(forest, rounds, seed, share)
    return forest


def split_at_random(forest, rounds, seed=0, share=0.6):
    rng = np.random.default_rng(seed)
    for _ in range(rounds):
        leaf = np.flatnonzero(forest.leaf)
        forest.split(leaf[rng.random(len(leaf)) < share])


def exact_area(shape):
    return sum(shoelace(loop) for loop in SHAPES[shape])


def winding(points, loops):
    """(n,) bool, inside by the even-odd rule."""
    odd = np.zeros(len(points), bool)
    for a in loops:
        b = np.roll(a, -1, 0)
        x, y = points[:, :1], points[:, 1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            hit = ((a[:, 1] > y) != (b[:, 1] > y)) & (x < a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
        odd ^= (hit.sum(1) % 2).astype(bool)
    return odd


def linear(points):
    """(n, 1) some linear function of places (n, 3)."""
    return points @ np.array([[0.7], [-0.4], [0.3]]) + 2


def linear_coefficients(forest, elements):
    """(n, m, 1) float64 coefficients of :func:`linear`, from its values at the corners of the boxes."""
    box, region = forest.box[elements], forest.region[elements]
    at = lambda x, y: linear(forest.regions.world(region, box[:, :2] + box[:, 2:] * [x, y]))  # noqa: E731
    out = np.zeros((len(elements), forest.functions, 1))
    out[:, 0] = at(0.5, 0.5)
    out[:, forest.order] = (at(1, 0.5) - at(0, 0.5)) / (2 * np.sqrt(3))
    out[:, 1] = (at(0.5, 1) - at(0.5, 0)) / (2 * np.sqrt(3))
    return out


def told_by_nodes(forest):
    """(E,) bool: something of every part of the element is covered, so that its nodes tell every function of the basis."""
    return forest.node_weights.min(1) > 0.1 * forest.area / forest.node_count


@shapes
@orders
@pytest.mark.parametrize("seed", range(3))
def test_leaves_share_the_area_of_the_region(shape, order, seed):
    forest = forest_of(shape, order, rotation(seed), rounds=5, seed=seed)
    assert len(forest) > 30
    assert forest.area[forest.leaf].sum() == pytest.approx(exact_area(shape), rel=1e-9)
    parents = np.flatnonzero(~forest.leaf)
    children = forest.children[parents]
    below = np.where(children >= 0, forest.area[np.maximum(children, 0)], 0).sum(1)
    assert below == pytest.approx(forest.area[parents], rel=1e-6)
    np.testing.assert_allclose(forest.node_weights.sum(1), forest.area, rtol=1e-6)
    assert (forest.node_weights >= 0).all()


@shapes
def test_trees_are_consistent(shape):
    forest = forest_of(shape, 2, rounds=5)
    child = np.flatnonzero(forest.parent >= 0)
    parent = forest.parent[child]
    assert (parent < child).all()
    np.testing.assert_array_equal(forest.level[child], forest.level[parent] + 1)
    np.testing.assert_array_equal(forest.region[child], forest.region[parent])
    assert (forest.children[parent] == child[:, None]).any(1).all()
    place = basis.SLOTS[forest.slot[child]]
    np.testing.assert_allclose(forest.box[child, :2], forest.box[parent, :2] + place[:, :2] * forest.box[parent, 2:], atol=1e-12)
    np.testing.assert_allclose(forest.box[child, 2:], place[:, 2:] * forest.box[parent, 2:], atol=1e-12)
    assert np.flatnonzero(forest.parent < 0).tolist() == [0]


@shapes
def test_nothing_exists_where_nothing_is_covered(shape):
    forest = forest_of(shape, 2, rounds=5, share=1.0)
    rng = np.random.default_rng(0)
    leaf = np.flatnonzero(forest.leaf)
    box = forest.box[leaf]
    uv = box[:, None, :2] + rng.random((len(leaf), 400, 2)) * box[:, None, 2:]
    region = np.repeat(forest.region[leaf], 400)
    place = forest.regions.world(region, uv.reshape(-1, 2)) + forest.regions.centre - [1.0, -2, 0.5]
    share = winding(place[:, :2], SHAPES[shape]).reshape(len(leaf), 400).mean(1)
    np.testing.assert_allclose(forest.area[leaf] / box[:, 2:].prod(1), share, atol=0.12)
    assert (share > 0).mean() > 0.97


def test_elements_far_from_the_origin_are_the_same():
    near, far = (Forest(merge(scene_of([np.column_stack([TRIANGLE, np.zeros(3)]) + x])), 2) for x in (0, 2.0**20))
    for forest in (near, far):
        split_at_random(forest, 4)
    assert len(near) == len(far)
    np.testing.assert_allclose(far.nodes, near.nodes, atol=2e-6)
    np.testing.assert_allclose(far.area, near.area, atol=1e-8)


@orders
@pytest.mark.parametrize("shape", ["plain", "triangle"])
def test_nodes_lie_on_the_surface(shape, order):
    turn = rotation(3)
    forest = forest_of(shape, order, turn, rounds=4)
    local = (forest.nodes.astype(float) + forest.regions.centre - [1.0, -2, 0.5]) @ turn
    flat = local.reshape(-1, 3)[forest.node_weights.reshape(-1) > 0]
    assert np.abs(flat[:, 2]).max() < 2e-6
    corners = SHAPES[shape][0]
    # Convex shapes: inside of every edge, but for rounding.
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        assert ((b - a)[0] * (flat[:, 1] - a[1]) - (b - a)[1] * (flat[:, 0] - a[0])).min() > -1e-5


@orders
def test_nodes_and_weights_integrate_linear_functions_over_any_cover(order):
    # The weighted mean of the nodes is the centre of gravity, so a linear function is integrated exactly.
    for shape in SHAPES:
        forest = forest_of(shape, order, rounds=3)
        total = np.einsum("nq,nqk->nk", forest.node_weights.astype(float), forest.nodes.astype(float))
        leaf = forest.leaf
        assert total[leaf].sum(0) == pytest.approx(total[0], abs=1e-4)
        centre = forest.regions.centroid[0] * exact_area(shape)
        assert total[0] == pytest.approx(centre, abs=1e-4)
        np.testing.assert_allclose(forest.centroids(np.arange(1))[0], forest.regions.centroid[0], atol=1e-5)


@orders
@shapes
def test_pull_keeps_the_light_of_the_leaves(shape, order):
    forest = forest_of(shape, order, rounds=5)
    rng = np.random.default_rng(1)
    leaf = np.flatnonzero(forest.leaf)
    coefficients = np.zeros((len(forest), forest.functions, 3))
    coefficients[leaf] = rng.normal(size=(len(leaf), forest.functions, 3))
    total = forest.pull(coefficients)
    power = (forest.mean(leaf, coefficients[leaf]) * forest.area[leaf, None]).sum(0)
    assert forest.mean(np.arange(1), total[:1])[0] * forest.area[0] == pytest.approx(power, abs=1e-9)
    np.testing.assert_array_equal(total[leaf], coefficients[leaf])
    # In single precision as well, to its rounding.
    single = forest.pull(coefficients.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, total, atol=1e-4)


@orders
@shapes
def test_push_is_exact_and_pull_takes_it_back(shape, order):
    forest = forest_of(shape, order, rounds=4)
    rng = np.random.default_rng(2)
    own = np.zeros((len(forest), forest.functions, 2))
    own[0] = rng.normal(size=(forest.functions, 2))
    total = forest.push(own)
    # The same function on every element: equal values at the nodes, whichever element they are computed from.
    box, root = forest.box, forest.box[0]
    uv = rng.random((len(forest), 2))
    at = (box[:, :2] + uv * box[:, 2:] - root[:2]) / root[2:]
    values = np.einsum("nm,nmc->nc", basis.evaluate(order, uv), total)
    np.testing.assert_allclose(values, basis.evaluate(order, at) @ own[0], atol=1e-12)
    if shape == "plain":
        leaves_only = np.where(forest.leaf[:, None, None], total, 0)
        np.testing.assert_allclose(forest.pull(leaves_only), total, atol=1e-12)


def test_push_adds_what_every_ancestor_holds():
    forest = forest_of("plain", 1, rounds=4)
    own = np.random.default_rng(0).normal(size=(len(forest), 1, 1))
    total = forest.push(own)
    for e in range(len(forest)):
        chain, k = own[e, 0, 0], e
        while forest.parent[k] >= 0:
            k = forest.parent[k]
            chain += own[k, 0, 0]
        assert total[e, 0, 0] == pytest.approx(chain)


def test_push_and_pull_of_some_trees_alone():
    forest = Forest(merge(scene_of([f @ rotation(1).T for f in box(high=(1, 2, 3))])), 2)
    split_at_random(forest, 4)
    rng = np.random.default_rng(0)
    own = rng.normal(size=(len(forest), 4, 1))
    chosen = np.flatnonzero(np.isin(forest.region, [1, 4]))
    chosen = chosen[np.lexsort((rng.random(len(chosen)), forest.level[chosen]))]
    place = np.zeros(len(forest), int)
    place[chosen] = np.arange(len(chosen))
    trees = Subtrees(forest, chosen, place)
    np.testing.assert_array_equal(trees.push(own[chosen]), forest.push(own)[chosen])
    np.testing.assert_array_equal(trees.pull(own[chosen]), forest.pull(own)[chosen])


@pytest.mark.parametrize("order", [2, 3])
@shapes
def test_linear_light_is_held_by_every_element(shape, order):
    forest = forest_of(shape, order, rotation(5), rounds=4)
    elements = np.flatnonzero(told_by_nodes(forest))
    nodes = forest.nodes[elements].astype(float)
    values = linear(nodes.reshape(-1, 3)).reshape(len(elements), -1, 1)
    found = forest.from_nodes(elements, values)
    np.testing.assert_allclose(forest.at_nodes(elements, found), values, atol=1e-5)
    np.testing.assert_allclose(found, linear_coefficients(forest, elements), atol=2e-4)
    assert len(elements) > 0.4 * len(forest)


@pytest.mark.parametrize("order", [2, 3])
@shapes
def test_linear_light_on_the_leaves_is_linear_above(shape, order):
    forest = forest_of(shape, order, rotation(6), rounds=4)
    everything = np.arange(len(forest))
    expected = linear_coefficients(forest, everything)
    total = forest.pull(np.where(forest.leaf[:, None, None], expected, 0))
    wide = told_by_nodes(forest) | forest.leaf
    for e in np.flatnonzero(~forest.leaf)[::-1]:  # what a child has lost its parents do not get
        wide[e] &= wide[forest.children[e][forest.children[e] >= 0]].all()
    assert wide.sum() > forest.leaf.sum()
    np.testing.assert_allclose(total[wide], expected[wide], atol=2e-4)
    # The mean over the cover is right on slivers too, but where their leaves are extended beyond what they cover.
    np.testing.assert_allclose(
        forest.mean(everything, total), linear(forest.centroids(everything).astype(float)), atol=1e-2 if order == 3 else 2e-4
    )


@orders
def test_from_nodes_keeps_the_mean_of_any_values(order):
    for shape in SHAPES:
        forest = forest_of(shape, order, rounds=4)
        everything = np.arange(len(forest))
        values = np.random.default_rng(0).normal(size=(len(forest), forest.node_count, 2))
        mean = np.einsum("nq,nqc->nc", forest.node_weights, values) / forest.area[:, None]
        np.testing.assert_allclose(forest.mean(everything, forest.from_nodes(everything, values)), mean, atol=1e-5)


@shapes
def test_contours_run_around_the_element(shape):
    turn = rotation(7)
    forest = forest_of(shape, 2, turn, rounds=4)
    elements = np.random.default_rng(0).permutation(len(forest))
    row, start, end = forest.contours(elements)
    assert (np.diff(row) >= 0).all()
    # Counter-clockwise from the front, the triangles from any one point to the edges make up the area.
    centre, radius = forest.spheres(elements)
    area = 0.5 * np.cross(start - centre[row], end - centre[row]) @ turn[:, 2]
    np.testing.assert_allclose(np.bincount(row, area, minlength=len(elements)), forest.area[elements], rtol=1e-6)
    # Closed: of every corner as many edges leave as arrive.
    out, into = (sorted(map(tuple, np.column_stack([row, x]).tolist())) for x in (start, end))
    assert out == into
    # What is around an element is around its contour.
    assert (np.linalg.norm(start - centre[row], axis=1) <= radius[row] + 1e-5).all()
    frame = forest.corners(elements)
    np.testing.assert_allclose(frame.mean(1), centre, atol=1e-5)
    half = np.abs(frame - centre[:, None]).max(1)
    assert (np.abs(start - centre[row]) <= half[row] + 1e-5).all()


@pytest.mark.parametrize("size", [(10, 1), (1, 7.3), (1, 1), (100, 3), (1, 1.6)])
def test_elements_become_squarish(size):
    forest = Forest(merge(scene_of([rectangle((0, 0, 0), (size[0], 0, 0), (0, size[1], 0))])), 2)
    split_at_random(forest, 8, share=0.75)
    width, height = forest.box[:, 2], forest.box[:, 3]
    longer = np.maximum(width, height) / np.minimum(width, height)
    deep = forest.level >= np.log2(max(size) / min(size)) + 1
    assert deep.any()
    assert longer[deep].max() <= SQUARISH + 1e-9
    assert longer.max() == pytest.approx(max(size) / min(size))  # never worse than the surface itself


def test_split_gives_children_once():
    forest = forest_of("plain", 2)
    forest.split(np.array([0, 0]))
    count = len(forest)
    before = forest.children[0].copy()
    forest.split(np.array([0]))
    assert len(forest) == count
    np.testing.assert_array_equal(forest.children[0], before)
    forest.split(np.zeros(0, int))
    assert len(forest) == count


def test_the_smallest_size_is_that_of_the_longer_edge():
    forest = forest_of("plain", 2)  # 5 m long
    assert forest.can_split(np.array([0]), 2.5).tolist() == [True]
    assert forest.can_split(np.array([0]), 2.51).tolist() == [False]
    forest.split(np.array([0]))
    assert forest.can_split(np.array([0]), 2.51).tolist() == [True]  # it has children already


@pytest.mark.parametrize("order", [1, 2])
def test_faces_that_lie_upon_each_other_count_once(order):
    sheet = np.column_stack([PLAIN, np.zeros(4)])
    forest = Forest(merge(scene_of([sheet, sheet[[0, 1, 2]], sheet])), order)
    split_at_random(forest, 3)
    assert forest.area[forest.leaf].sum() == pytest.approx(10)


def test_faces_that_overlap_in_part_count_once():
    # Three cells of an L, and a triangle over half of one of them.
    cells = [rectangle((x, y, 0), (1, 0, 0), (0, 1, 0)) for x, y in ((0, 0), (1, 0), (0, 1))]
    forest = Forest(merge(scene_of([*cells, np.array([(0, 0, 0), (1, 0, 0), (0.5, 1, 0)])])), 2)
    assert forest.area.tolist() == pytest.approx([3])
    split_at_random(forest, 1, share=1.0)
    assert forest.area[forest.leaf].sum() == pytest.approx(3)
