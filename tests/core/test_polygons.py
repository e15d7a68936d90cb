"""Area vectors, decomposition and clipping of polygons against exact areas and point-by-point membership."""

import numpy as np
import pytest
from enfilade.core.polygons import area_vectors, areas_and_centroids, clip_half, clip_to_boxes, decompose
from scenery import rectangle, rotation, scene_of, shoelace


def star(rng, corners, smallest, largest, centre=(0.0, 0.0)):
    """(n, 2) corners of a star-shaped polygon, counter-clockwise, mostly concave."""
    angle = (np.arange(corners) + rng.uniform(-0.4, 0.4, corners)) * 2 * np.pi / corners
    radius = rng.uniform(smallest, largest, corners)
    return np.stack([np.cos(angle), np.sin(angle)], 1) * radius[:, None] + centre


def lifted(flat, turn, offset):
    """(n, 3) places of the points (n, 2) of the plane z = 0, turned and moved."""
    return np.column_stack([flat, np.zeros(len(flat))]) @ turn.T + offset


def inside(points, *loops):
    """(n,) bool, by the even-odd rule over all loops."""
    odd = np.zeros(len(points), bool)
    for loop in loops:
        a, b = loop, np.roll(loop, -1, 0)
        x, y = points[:, :1], points[:, 1:]
        across = (a[:, 1] > y) != (b[:, 1] > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            where = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        odd ^= (np.sum(across & (x < where), axis=1) % 2).astype(bool)
    return odd


def pieces_at(pieces, points):
    """(n,) how many pieces hold each of the points (n, 3) of their plane."""
    count = np.zeros(len(points), int)
    for o, a, b, triangle in zip(pieces.origin, pieces.a, pieces.b, pieces.triangle, strict=True):
        s, t = np.linalg.lstsq(np.stack([a, b], 1), (points - o).T, rcond=None)[0]
        count += (s >= 0) & (t >= 0) & (s + t <= 1 if triangle else (s <= 1) & (t <= 1))
    return count


SPIRAL = np.array(
    [(0, 0), (7, 0), (7, 7), (1, 7), (1, 2), (5, 2), (5, 5), (3, 5), (3, 4), (4, 4), (4, 3), (2, 3), (2, 6), (6, 6), (6, 1), (0, 1)],
    float,
)
COMB = np.array(
    [(0, 0), (9, 0), (9, 5), (8, 5), (8, 1), (7, 1), (7, 5), (6, 5), (6, 1), (5, 1), (5, 5), (4, 5), (4, 1), (1, 1), (1, 5), (0, 5)],
    float,
)


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, -2e6, 3e5)])
def test_area_vectors_are_normal_times_area_less_the_holes(offset):
    turn = rotation(1)
    outer, hole = np.array([[0, 0], [4, 0], [4, 3], [0, 3]]), np.array([[1, 1], [1, 2], [3, 2], [3, 1]])
    scene = scene_of([[lifted(outer, turn, offset), lifted(hole, turn, offset)], lifted(outer[::-1], turn, offset)])
    vectors = area_vectors(scene)
    assert vectors[0] == pytest.approx(10 * turn[:, 2], abs=2e-8)
    assert vectors[1] == pytest.approx(-12 * turn[:, 2], abs=2e-8)


def check_cover(loops, seed=0):
    rng = np.random.default_rng(seed)
    turn, offset = rotation(seed), rng.normal(size=3)
    pieces = decompose(scene_of([[lifted(loop, turn, offset) for loop in loops]]))
    area = sum(shoelace(loop) for loop in loops)
    assert pieces.area.sum() == pytest.approx(area, rel=1e-9)
    corners = np.concatenate(loops)
    points = rng.uniform(corners.min(0) - 0.1, corners.max(0) + 0.1, (3000, 2))
    # With the right total and none inside missed, no piece reaches out of the polygon or over another.
    np.testing.assert_array_equal(pieces_at(pieces, lifted(points, turn, offset)), inside(points, *loops))
    normal = np.cross(pieces.a, pieces.b)
    assert (normal @ turn[:, 2] > 0).all()


@pytest.mark.parametrize("seed", range(12))
def test_concave_polygons_are_covered_once_and_nothing_else_is(seed):
    rng = np.random.default_rng(seed)
    check_cover([star(rng, int(rng.integers(5, 24)), 0.3, 2.0)], seed)


@pytest.mark.parametrize("seed", range(12))
def test_holes_are_left_out(seed):
    rng = np.random.default_rng(100 + seed)
    outer = star(rng, int(rng.integers(7, 16)), 2.0, 3.0)
    holes = [star(rng, int(rng.integers(3, 9)), 0.1, 0.22, c)[::-1] for c in ((0.0, 0.0), (0.3, 0.35), (-0.4, 0.2), (0.1, -0.45))]
    check_cover([outer, *holes[: 1 + seed % 4]], seed)


REPEATED = np.array([(0, 0), (1, 0), (1, 0), (2, 0), (4, 0), (4, 1), (2, 1), (2, 1), (1, 1), (1, 2), (1, 4), (0, 4), (0, 4), (0, 2)], float)


@pytest.mark.parametrize("outline", [SPIRAL, COMB, REPEATED], ids=["spiral", "comb", "repeated corners"])
def test_windings_that_no_point_sees_whole(outline):
    check_cover([outline])


def outlines(cells):
    """Outlines (n, 2) of a set of unit cells (i, j), outer ones counter-clockwise and first; None where they touch themselves."""
    following = {}
    for i, j in cells:
        around = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for k, beside in enumerate([(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)]):
            if beside not in cells:
                following.setdefault(around[k], []).append(around[(k + 1) % 4])
    if max(map(len, following.values())) > 1:
        return None
    loops = []
    while following:
        loop = [min(following)]
        while loop[-1] in following:
            loop.append(following.pop(loop[-1])[0])
        loops.append(np.array(loop[:-1], float))
    return sorted(loops, key=lambda x: -shoelace(x))


def test_a_symmetric_l():
    check_cover([np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)])


def test_rooms_on_a_grid():
    # Corners of rooms on a grid lie on many a diagonal of others.
    rng = np.random.default_rng(0)
    for turn in range(80):
        cells = {(0, 0)}
        while len(cells) < 4 + turn % 12:
            i, j = sorted(cells)[rng.integers(len(cells))]
            cells.add([(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)][rng.integers(4)])
        loops = outlines(cells)
        if loops:
            if turn % 2:
                loops = [x[(np.roll(x, 1, 0) - np.roll(x, -1, 0)).all(1)] for x in loops]  # the corners where they turn alone
            check_cover(loops, turn)


def test_a_wall_with_a_row_of_windows_and_a_door():
    outer = np.array([[0, 0], [2, 0], [2, 2.1], [3, 2.1], [3, 0], [9, 0], [9, 3], [0, 3]], float)
    windows = [np.array([[x, 1], [x, 2], [x + 0.8, 2], [x + 0.8, 1]], float) for x in (0.5, 3.5, 5.0, 6.5, 8.0)]
    check_cover([outer, *windows])


def test_simple_shapes_take_few_pieces():
    trapezoid = np.array([[0, 0, 0], [4, 0, 0], [3, 1, 0], [1, 1, 0]])
    pentagon = np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [1, 2, 0], [-1, 1, 0]])
    collinear = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
    slanted = rectangle((0, 0, 5), (2, 1, 0), (0.5, 3, 1))
    nothing = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2]])
    pieces = decompose(scene_of([slanted, trapezoid, nothing, pentagon, collinear]))
    assert np.bincount(pieces.polygon, minlength=5).tolist()[:4] == [1, 2, 0, 3]
    assert pieces.triangle[pieces.polygon == 0].tolist() == [False]
    area = np.bincount(pieces.polygon, pieces.area, minlength=5)
    assert area == pytest.approx([np.linalg.norm(np.cross((2, 1, 0), (0.5, 3, 1))), 3, 0, 5, 2])
    assert (np.diff(pieces.polygon) >= 0).all()


def overlap(polygon, low, high):
    """Area of a convex polygon within a box, from the corners that the two have in common (independent of clipping)."""
    x0, y0, x1, y1 = *low, *high
    found = [p for p in polygon if x0 <= p[0] <= x1 and y0 <= p[1] <= y1]
    edges = list(zip(polygon, np.roll(polygon, -1, 0), strict=True))
    for q in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
        if all((b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]) >= 0 for a, b in edges):
            found.append(np.array(q))
    for a, b in edges:
        for axis, bounds in ((0, (x0, x1)), (1, (y0, y1))):
            for bound in bounds:
                if (a[axis] - bound) * (b[axis] - bound) < 0:
                    p = a + (bound - a[axis]) / (b[axis] - a[axis]) * (b - a)
                    if low[1 - axis] <= p[1 - axis] <= high[1 - axis]:
                        found.append(p)
    if len(found) < 3:
        return 0.0
    found = np.array(found)
    around = found - found.mean(0)
    return shoelace(found[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])


def convex(rng, count, corners):
    """(n, k, 2) convex polygons, counter-clockwise."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, (count, corners)), axis=1)
    axes = rng.uniform(0.2, 2, (count, 1, 2))
    return rng.normal(size=(count, 1, 2)) + axes * np.stack([np.cos(angle), np.sin(angle)], 2)


@pytest.mark.parametrize("corners", [3, 4, 7])
def test_clipped_areas_are_those_of_the_common_part(corners):
    rng = np.random.default_rng(corners)
    polygons = convex(rng, 400, corners)
    low = rng.normal(size=(400, 2))
    high = low + rng.uniform(0.1, 2, (400, 2))
    clipped = clip_to_boxes(polygons, low, high)
    assert clipped.shape == (400, corners + 4, 2)
    area, _ = areas_and_centroids(clipped)
    expected = [overlap(p, a, b) for p, a, b in zip(polygons, low, high, strict=True)]
    assert np.mean(np.array(expected) > 0) > 0.2
    np.testing.assert_allclose(area, expected, atol=1e-13)
    some = area > 0
    assert (clipped[some].min(1) >= low[some] - 1e-12).all()
    assert (clipped[some].max(1) <= high[some] + 1e-12).all()


def test_the_cells_of_a_grid_share_a_polygon_out():
    rng = np.random.default_rng(3)
    polygons = convex(rng, 20, 6)
    edge = np.linspace(-6, 6, 14)
    x, y = (z.ravel() for z in np.meshgrid(edge[:-1], edge[:-1]))
    low = np.tile(np.stack([x, y], 1), (20, 1))
    clipped = clip_to_boxes(np.repeat(polygons, len(x), 0), low, low + (edge[1] - edge[0]))
    area, moment = areas_and_centroids(clipped)
    whole, whole_moment = areas_and_centroids(polygons)
    assert area.reshape(20, -1).sum(1) == pytest.approx(whole, rel=1e-12)
    np.testing.assert_allclose(moment.reshape(20, -1, 2).sum(1), whole_moment, atol=1e-12)


def test_half_spaces_of_space():
    square = rectangle((0, 0, 0), (1, 0, 1), (0, 1, 0))[None]
    height = square[:, :, 2] - 0.25
    upper, lower = clip_half(square, height), clip_half(square, -height)
    assert upper.shape == (1, 5, 3)
    area = [np.linalg.norm(sum(np.cross(a, b) for a, b in zip(p[0], np.roll(p[0], -1, 0), strict=True))) / 2 for p in (upper, lower)]
    assert area == pytest.approx([0.75 * np.sqrt(2), 0.25 * np.sqrt(2)])
    assert upper[0, :, 2].min() == 0.25
    nothing = clip_half(square, height - 5)
    assert (nothing == nothing[:, :1]).all()
    np.testing.assert_array_equal(clip_half(square, height + 5)[:, :4], square)


def test_areas_and_centroids_of_known_shapes():
    triangle = np.array([[0, 0], [3, 0], [0, 6], [0, 6]], float)
    rectangle_ = np.array([[1, 1], [5, 1], [5, 3], [1, 3]], float)
    shapes = np.stack([triangle, rectangle_, rectangle_[::-1], np.full((4, 2), 7.0)])
    area, moment = areas_and_centroids(shapes)
    assert area == pytest.approx([9, 8, -8, 0])
    assert moment[:3] / area[:3, None] == pytest.approx(np.array([[1, 2], [3, 2], [3, 2]]))
    far, _ = areas_and_centroids(shapes + 1e7)
    assert far == pytest.approx(area, abs=1e-7)
