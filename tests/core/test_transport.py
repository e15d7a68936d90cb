"""The kernel and Lambert's formula against form factors in closed form."""

import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.basis import gauss
from enfilade.core.transport import edge_sum, kernel, lambert
from scenery import rectangle, rotation

DATA = json.loads((Path(__file__).resolve().parents[1] / "data" / "form_factors.json").read_text(encoding="utf-8"))
UP = np.array([0.0, 0.0, 1.0])


def normal_of(polygon):
    vector = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(0)
    return vector / np.linalg.norm(vector)


def graded(polygon, count):
    """Points and weights, summing to one, on a convex polygon; denser towards its edges, where factors are not smooth."""
    x, w = gauss(count)
    w = w * 30 * x**2 * (1 - x) ** 2
    x = x**3 * (10 - 15 * x + 6 * x * x)
    s, t = (z.ravel() for z in np.meshgrid(x, x, indexing="ij"))
    weight = np.outer(w, w).ravel()
    points, weights = [], []
    middle = polygon.mean(0)
    for a, b in zip(polygon, np.roll(polygon, -1, 0), strict=True):
        points.append(middle + s[:, None] * ((a - middle) + t[:, None] * (b - a)))
        weights.append(weight * s * np.linalg.norm(np.cross(a - middle, b - middle)))
    points, weights = np.concatenate(points), np.concatenate(weights)
    return points, weights / weights.sum()


def point_to_rectangle(a, b, distance):
    """Closed form: a point facing a parallel rectangle a x b from below its corner."""
    p, q = a / distance, b / distance
    r, s = np.sqrt(1 + p * p), np.sqrt(1 + q * q)
    return (p / r * np.arctan(q / r) + q / s * np.arctan(p / s)) / (2 * np.pi)


def form(point, normal, polygon):
    return float(lambert(np.array([point], float), np.array([normal], float), np.array([polygon], float))[0])


# -------------------------------------------------------------------------------------------------- Lambert


@pytest.mark.parametrize("case", DATA["pairs"], ids=lambda case: case["name"])
def test_form_factors_between_polygons(case):
    a, b = np.array(case["a"], float), np.array(case["b"], float)
    points, weights = graded(a, 40)
    normals = np.repeat(normal_of(a)[None], len(points), 0)
    factor = weights @ lambert(points, normals, np.repeat(b[None], len(points), 0))
    assert factor == pytest.approx(case["factor"], rel=1e-6)


@pytest.mark.parametrize("case", DATA["points"])
def test_form_factors_from_points(case):
    assert form(case["point"], case["normal"], case["polygon"]) == pytest.approx(case["factor"], rel=1e-12)


@pytest.mark.parametrize("distance", [1e-3, 0.1, 1, 7, 1e3])
@pytest.mark.parametrize("size", [(1, 1), (0.2, 5)])
def test_a_point_below_the_corner_of_a_parallel_rectangle(size, distance):
    lamp = rectangle((0, 0, distance), (0, size[1], 0), (size[0], 0, 0))
    turn, offset = rotation(0), np.array([3.0, -1, 2])
    expected = point_to_rectangle(*size, distance)
    assert form((0, 0, 0), UP, lamp) == pytest.approx(expected, rel=1e-12)
    assert form(offset, turn @ UP, lamp @ turn.T + offset) == pytest.approx(expected, rel=1e-9)


def test_a_polygon_all_around_is_the_whole_sky():
    assert form((0, 0, 0), UP, rectangle((-1e6, -1e6, 1), (0, 2e6, 0), (2e6, 0, 0))) == pytest.approx(1, abs=2e-6)


@pytest.mark.parametrize("below", [0.01, 1.0, 50.0])
def test_what_lies_below_the_horizon_sends_nothing(below):
    upper = rectangle((2, -1, 0), (0, 2, 0), (0, 0, 1))
    whole = rectangle((2, -1, -below), (0, 2, 0), (0, 0, 1 + below))
    assert form((0, 0, 0), UP, whole) == pytest.approx(form((0, 0, 0), UP, upper), rel=1e-12)
    assert form((0, 0, 0), UP, whole - [0, 0, 1 + below]) == 0
    triangle = np.array([(2, -1, -below), (2, 1, -below), (2, 0, 3.0)])
    cut = np.array([(2, below / (3 + below) - 1, 0), (2, 1 - below / (3 + below), 0), (2, 0, 3.0)])
    assert form((0, 0, 0), UP, triangle) == pytest.approx(form((0, 0, 0), UP, cut), rel=1e-12)


def test_a_polygon_seen_edge_on_sends_nothing():
    for lamp in (
        rectangle((1, 0, 0), (1, 0, 0), (0, 0, 1)),  # its plane holds the point
        rectangle((1, 0, 0), (1, 0, 0), (0, 1, 0)),  # it lies in the point's horizon
        rectangle((1, 0, 1), (0, 0, 0), (0, 1, 0)),  # it has no area
    ):
        assert form((0, 0, 0), UP, lamp) == pytest.approx(0, abs=1e-15)


def test_repeated_corners_change_nothing():
    rng = np.random.default_rng(0)
    for _ in range(20):
        triangle = rng.normal((0, 0, 0.5), size=(3, 3))
        four = triangle[[0, 1, 1, 2]], triangle[[0, 1, 2, 2, 2, 2]]
        for other in four:
            assert form((0, 0, 0), UP, other) == pytest.approx(form((0, 0, 0), UP, triangle), rel=1e-12, abs=1e-15)


def test_parts_add_up_near_and_far():
    rng = np.random.default_rng(1)
    for scale in (1e-6, 1e-2, 1, 1e4):
        origin, a, b = rng.normal(size=(3, 3))
        a, b = scale * a, scale * b
        cells = [rectangle(origin + a * i / 7 + b * j / 7, a / 7, b / 7) for i in range(7) for j in range(7)]
        parts = lambert(np.zeros((49, 3)), np.tile(UP, (49, 1)), np.array(cells)).sum()
        assert parts == pytest.approx(form((0, 0, 0), UP, rectangle(origin, a, b)), rel=1e-9, abs=1e-15)


def test_small_and_far_polygons_follow_the_kernel():
    rng = np.random.default_rng(2)
    corners = 1e-3 * rng.normal(size=(50, 3, 3)) + rng.normal(size=(50, 1, 3)) * 20 + [0, 0, 30]
    middle = corners.mean(1)
    vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    distance = np.linalg.norm(middle, axis=1)
    expected = np.abs(np.einsum("ij,ij->i", middle, vector)) * np.maximum(middle[:, 2], 0) / (np.pi * distance**4)
    found = lambert(np.zeros((50, 3)), np.tile(UP, (50, 1)), corners)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-16)


def test_points_on_and_near_the_polygon():
    lamp = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
    for at in ((0.3, 0.4), (0.999, 0.001)):
        assert form((*at, -1e-9), UP, lamp) == pytest.approx(1, abs=1e-5)
    for at in ((0, 0), (1, 0.5), (0.5, 0.5)):  # a corner, an edge, the middle: finite, no more than the sky
        assert 0 <= form((*at, 0), UP, lamp) <= 1
    # Beside the common edge of two perpendicular squares half of the sky is wall.
    wall = rectangle((0, -1, 0), (0, 2, 0), (0, 0, 1))
    assert form((1e-7, 0, 0), UP, wall) == pytest.approx(0.5, abs=1e-6)


def test_edge_sum_is_for_what_is_in_front():
    lamp = rectangle((0, 0, 2), (0, 1, 0), (1, 0, 0))
    assert edge_sum(lamp[None], UP[None])[0] == pytest.approx(point_to_rectangle(1, 1, 2))
    assert edge_sum(lamp[None, ::-1], UP[None])[0] == pytest.approx(point_to_rectangle(1, 1, 2))


# --------------------------------------------------------------------------------------------------- kernel


def nodes(polygon, count):
    x, w = gauss(count)
    s, t = (z.ravel() for z in np.meshgrid(x, x))
    o, a, b = polygon[0], polygon[1] - polygon[0], polygon[3] - polygon[0]
    return (o + s[:, None] * a + t[:, None] * b).astype(np.float32), np.outer(w, w).ravel()


def gauss_factor(a, b, count):
    (pa, wa), (pb, wb) = nodes(a, count), nodes(b, count)
    k = kernel(pa[None], normal_of(a).astype(np.float32)[None], pb[None], normal_of(b).astype(np.float32)[None])[0]
    return wa @ k.astype(float) @ wb * np.linalg.norm(np.cross(b[1] - b[0], b[3] - b[0]))


@pytest.mark.parametrize("case", [c for c in DATA["pairs"] if "opposed" in c["name"] or "rectangles in parallel" in c["name"]])
def test_the_kernel_between_separate_rectangles(case):
    factor = gauss_factor(np.array(case["a"], float), np.array(case["b"], float), 24)
    assert factor == pytest.approx(case["factor"], rel=2e-6)


def test_the_kernel_is_right_between_touching_rectangles_in_the_limit():
    case = next(c for c in DATA["pairs"] if "common edge" in c["name"])
    a, b = np.array(case["a"], float), np.array(case["b"], float)
    error = [abs(gauss_factor(a, b, n) / case["factor"] - 1) for n in (2, 4, 8, 16, 32)]
    assert (np.diff(error) < 0).all()
    assert error[-1] < 0.125


def test_the_kernel_of_two_points_by_hand():
    a, b = np.zeros((1, 1, 3), np.float32), np.array([[[3, 0, 4]]], np.float32)
    to_b = np.array([[0.6, 0, 0.8]], np.float32)
    assert kernel(a, UP[None].astype(np.float32), b, -to_b)[0, 0, 0] == pytest.approx(0.8 / (25 * np.pi), rel=1e-6)
    assert kernel(a, to_b, b, -to_b)[0, 0, 0] == pytest.approx(1 / (25 * np.pi), rel=1e-6)
    assert kernel(a, -to_b, b, -to_b)[0, 0, 0] == 0
    assert kernel(a, to_b, b, to_b)[0, 0, 0] == 0
    assert kernel(a, -to_b, b, to_b)[0, 0, 0] == 0  # behind both: two minus signs make no plus
    assert kernel(a, to_b, a, to_b)[0, 0, 0] == 0


def test_the_kernel_is_symmetric_to_the_bit():
    rng = np.random.default_rng(0)
    frame = [np.stack([rotation(k) for k in range(60)]), np.stack([rotation(100 + k) for k in range(60)])]
    flat = rng.random((2, 60, 9, 2)) - 0.5
    a, b = (np.einsum("nij,nkj->nik", x, f[:, :, :2]).astype(np.float32) for x, f in zip(flat, frame, strict=True))
    b = b + rng.normal(size=(60, 1, 3)).astype(np.float32)
    na, nb = (f[:, :, 2].astype(np.float32) for f in frame)
    there, back = kernel(a, na, b, nb), kernel(b, nb, a, na)
    assert (there > 0).any()
    # r2 and both heights are the same numbers: reciprocity holds to the bit but for the order of a product.
    np.testing.assert_allclose(there, back.transpose(0, 2, 1), rtol=3e-7)


def test_the_kernel_of_flat_sets_is_that_of_every_pair_of_points():
    rng = np.random.default_rng(3)
    frame = rotation(1), rotation(2)
    a, b = ((np.column_stack([rng.random((6, 2)), np.zeros(6)]) @ f.T + x) for f, x in zip(frame, (0, 2.5), strict=True))
    na, nb = (f[:, 2] * s for f, s in zip(frame, (1, -1), strict=True))
    found = kernel(*(x.astype(np.float32)[None] for x in (a, na, b, nb)))[0]
    for i in range(6):
        for j in range(6):
            d = b[j] - a[i]
            r2 = d @ d
            expected = max(d @ na, 0) * max(-d @ nb, 0) / (np.pi * r2 * r2)
            assert found[i, j] == pytest.approx(expected, rel=1e-5, abs=1e-9)
