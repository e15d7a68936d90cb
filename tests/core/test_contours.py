"""What lies around shapes that polygons make up: closed, as long as the true border, and with the same area and the same light."""

import numpy as np
import pytest
from enfilade.core.contours import contours
from enfilade.core.plane_cuts import cut_along
from enfilade.core.transport import contour_form_factors, lambert
from scenery import rotation

SIDE = 6


def square(x, y, size=1.0):
    return np.array([[x, y], [x + size, y], [x + size, y + size], [x, y + size]], float)


def turned(polygons, angle, offset=(0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    return polygons @ np.array([[c, s], [-s, c]]) + offset


def cells_of(present):
    return np.array([square(*cell) for cell in np.argwhere(present)])


def cut_up(row, polygons, rng, number):
    """The polygons of each row cut along random segments: where one cut ends, others have a corner on an edge."""
    low, high = polygons.min((0, 1)), polygons.max((0, 1))
    start, end = rng.uniform(low, high, (2, number, 2))
    end = start + 0.4 * (end - start)
    shapes = np.unique(row)
    return cut_along(row, polygons, np.repeat(shapes, number), *(np.tile(x, (len(shapes), 1)) for x in (start, end)), 1e-6)


def border(present):
    """Length of the border between cells that there are and cells that there are not."""
    padded = np.pad(present, 1).astype(int)
    return np.abs(np.diff(padded, axis=0)).sum() + np.abs(np.diff(padded, axis=1)).sum()


def length(row, start, end, count):
    return np.bincount(row, np.hypot(*(end - start).T), minlength=count)


def area(row, start, end, count):
    return 0.5 * np.bincount(row, start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0], minlength=count)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1e-5, np.pi / 2 - 1e-9, 2.9])
@pytest.mark.parametrize("cuts", [0, 40])
def test_only_what_lies_around_a_shape_is_left(angle, cuts):
    rng = np.random.default_rng(5)
    present = rng.random((4, SIDE, SIDE)) < np.array([0.2, 0.5, 0.8, 1.0])[:, None, None]
    row = np.repeat(np.arange(4), present.sum((1, 2)))
    cells = turned(np.concatenate([cells_of(p) for p in present]), angle, (37.1, -11.3))
    if cuts:
        row, cells = cut_up(row, cells, rng, cuts)
        assert len(cells) > 300
    found = contours(row, cells)
    assert (np.diff(found[0]) >= 0).all()
    np.testing.assert_allclose(length(*found, 4), [border(p) for p in present], rtol=1e-6)
    np.testing.assert_allclose(area(*found, 4), present.sum((1, 2)), rtol=1e-9)
    # The whole square is four edges, however it was cut.
    assert np.bincount(found[0])[3] == 4


@pytest.mark.parametrize("seed", range(8))
def test_chains_are_closed_to_the_bit(seed):
    rng = np.random.default_rng(seed)
    cells = turned(cells_of(rng.random((SIDE, SIDE)) < 0.6), rng.uniform(0, 7), rng.uniform(-50, 50, 2))
    row, cells = cut_up(np.zeros(len(cells), int), cells, rng, 60)
    _, start, end = contours(row, cells)
    assert sorted(map(tuple, start.tolist())) == sorted(map(tuple, end.tolist()))


def test_a_fine_circle_is_not_taken_for_a_line():
    angle = np.linspace(0, 2 * np.pi, 200_001)[:-1]
    rim = np.stack([np.cos(angle), np.sin(angle)], 1)
    fan = np.stack([np.zeros_like(rim), rim, np.roll(rim, -1, 0)], 1)
    row, start, end = contours(np.zeros(len(fan), int), fan)
    assert area(row, start, end, 1)[0] == pytest.approx(np.pi, rel=1e-9)


def test_what_lies_on_one_another_counts_twice():
    one, half = square(0, 0, 2.0), square(1, 0, 1.0)
    row, start, end = contours(np.zeros(2, int), np.stack([one, half]))
    assert area(row, start, end, 1)[0] == pytest.approx(5)


def test_nothing_has_no_contour():
    for x in contours(np.zeros(0, int), np.zeros((0, 4, 2))):
        assert len(x) == 0
    row, start, _ = contours(np.array([0, 1]), np.stack([np.zeros((4, 2)), square(0, 0)]))
    assert row.tolist() == [1] * 4
    assert len(start) == 4


@pytest.mark.parametrize("seed", range(6))
def test_the_light_of_a_contour_is_that_of_its_parts(seed):
    """Points before, beside and close to the shape, with horizons that cut it, see what all its convex parts sum to."""
    rng = np.random.default_rng(seed)
    row, cells = cut_up(*(np.zeros(20, int), cells_of(rng.permutation(36).reshape(6, 6) < 20)), rng, 15)
    frame = rotation(seed)
    u, v, facing = frame.T
    place = lambda uv: uv[..., :1] * u + uv[..., 1:] * v  # noqa: E731
    height = 10 ** rng.uniform(-6, 1, 300)
    points = place(rng.uniform(-3, 9, (300, 2))) + height[:, None] * facing
    normals = rng.normal(size=(300, 3))
    normals[:100] = -facing + 0.2 * normals[:100]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    _, start, end = contours(row, cells)
    edges = len(start)
    found = contour_form_factors(
        points, normals, np.tile(facing, (300, 1)), np.repeat(np.arange(300), edges), *(np.tile(place(x), (300, 1)) for x in (start, end))
    )
    corners = place(cells)
    parts = lambert(np.repeat(points, len(cells), 0), np.repeat(normals, len(cells), 0), np.tile(corners, (300, 1, 1)))
    np.testing.assert_allclose(found, parts.reshape(300, -1).sum(1), atol=1e-9)
    assert found.max() > 0.3
    assert (found < 1e-9).any()


def test_a_frame_shines_as_its_outside_less_its_hole():
    points, normals = np.array([[0.2, 0.1, 0.7], [2.0, 0, 0.3]]), np.array([[0, 0, -1.0], [-0.8, 0, -0.6]])
    outer, inner = square(-1, -1, 2.0), square(-0.5, -0.5, 1.0)
    parts = [np.array([[-1, -1], [1, -1], [0.5, -0.5], [-0.5, -0.5]])]
    quarter = np.array([[0, -1], [1, 0]])
    for _ in range(3):
        parts.append(parts[-1] @ quarter)
    flat = lambda x: np.concatenate([x, np.zeros((*x.shape[:-1], 1))], -1)  # noqa: E731
    _, start, end = contours(np.zeros(4, int), np.stack(parts))
    assert len(start) == 8
    found = contour_form_factors(
        points, normals, np.tile([0, 0, 1.0], (2, 1)), np.repeat([0, 1], 8), *(np.tile(flat(x), (2, 1)) for x in (start, end))
    )
    whole, hole = (lambert(points, normals, np.tile(flat(x), (2, 1, 1))) for x in (outer, inner))
    np.testing.assert_allclose(found, whole - hole, atol=1e-12)
