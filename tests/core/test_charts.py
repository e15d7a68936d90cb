"""Charts, packing, texel points and margins against brute force and plane geometry."""

import math

import numpy as np
import pytest
from enfilade.core import charts
from enfilade.core.charts import cover_texels, fill_margin, make_charts, pack


def box(size):
    position = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * size
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return position, quads.ravel(), np.arange(0, 25, 4)


def turned(position, seed):
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return position @ (q * np.linalg.det(q)).T + 7.0


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_a_box_has_six_charts_snapped_to_texels(seed):
    position, vertex, start = box([2.0, 3.05, 1.0])
    made = make_charts(position if seed is None else turned(position, seed), vertex, start, 10.0)
    assert sorted(map(tuple, made.size)) == sorted([(32, 11), (32, 11), (21, 11), (21, 11), (32, 21), (32, 21)])
    for f in range(6):
        w, h = made.size[made.chart[f]] - 1
        local = made.local[start[f] : start[f + 1]]
        assert sorted(map(tuple, np.round(local, 6))) == [(0, 0), (0, h), (w, 0), (w, h)]
        # Charts keep the turn of their face: no mirror image.
        x, y = local.T
        assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2 == pytest.approx(w * h)


def test_coplanar_neighbours_share_a_chart_and_strangers_do_not():
    # An L of three squares, and a fourth square in the same plane that touches none of them.
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    position = np.array([[x, y, 0] for y in range(3) for x in range(3)], float)
    position = np.concatenate([position, square + np.array([5, 0, 0])])
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [9, 10, 11, 12]])
    made = make_charts(position, quads.ravel(), np.arange(0, 17, 4), 8.0)
    assert len(set(made.chart[:3])) == 1
    assert made.chart[3] != made.chart[0]
    assert sorted(map(tuple, made.size)) == [(9, 9), (17, 17)]


def test_a_gently_bent_strip_falls_into_single_faces():
    n = 200
    turn = np.linspace(0, 0.1, n + 1)  # neighbours differ by half a thousandth, the whole by 0.1
    rim = np.stack([np.sin(turn), 0 * turn, 1 - np.cos(turn)], 1) * 100
    position = np.concatenate([rim, rim + np.array([0, 1, 0])])
    i = np.arange(n)
    vertex, start = np.stack([i, i + 1, i + n + 2, i + n + 1], 1).ravel(), np.arange(0, 4 * n + 1, 4)
    assert len(make_charts(position, vertex, start, 16.0).size) == n
    assert len(make_charts(position * [1, 1, 1e-4], vertex, start, 16.0).size) == 1


def test_faces_without_area_have_no_chart():
    position = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], float)
    made = make_charts(position, np.array([0, 1, 2, 0, 1, 3]), np.array([0, 3, 6]), 4.0)
    assert made.chart.tolist() == [-1, 0]
    assert np.isfinite(made.local).all()


@pytest.mark.parametrize("margin", [1, 4])
def test_packed_charts_keep_their_margins(margin):
    rng = np.random.default_rng(margin)
    size = np.sort(rng.integers(2, 60, (300, 2)), axis=1)[:, ::-1]
    layout = pack(size, margin, 4096)
    hits = np.zeros((layout.height, layout.width), int)
    for (x, y), (w, h) in zip(layout.offset, size, strict=True):
        assert margin <= x
        assert margin <= y
        assert x + w + margin <= layout.width
        assert y + h + margin <= layout.height
        hits[y - margin : y + h + margin, x - margin : x + w + margin] += 1
    assert hits.max() == 1
    assert hits.mean() > 0.75


def test_packing_knows_its_limit():
    assert pack(np.array([[100, 5]]), 1, 64) is None
    assert pack(np.full((50, 2), 30), 1, 128) is None
    assert pack(np.full((16, 2), 30), 1, 128) is not None
    layout = pack(np.array([[62, 5]]), 1, 64)
    assert (layout.width, layout.height) == (64, 8)


def distances(point, triangle):
    """Independent nearest distance: dense samples of the triangle."""
    s, t = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
    keep = s + t <= 1 + 1e-12
    samples = triangle[0] + s[keep][:, None] * (triangle[1] - triangle[0]) + t[keep][:, None] * (triangle[2] - triangle[0])
    return np.sqrt(((point[:, None] - samples[None]) ** 2).sum(2)).min(1)


@pytest.mark.parametrize("block", [1, 1 << 19])
def test_texels_get_the_nearest_point_of_the_nearest_triangle(block, monkeypatch):
    monkeypatch.setattr(charts, "_BLOCK", block)
    triangles = np.array([[[2, 2], [9.5, 3], [4, 8.2]], [[9.5, 3], [11, 9], [4, 8.2]], [[14, 3], [14, 9], [12.5, 3]]], float)
    width, height = 18, 12
    found = cover_texels(triangles, width, height)
    centre = np.stack([found.index % width, found.index // width], 1).astype(float)
    everyone = np.stack(np.divmod(np.arange(width * height), width)[::-1], 1).astype(float)
    exact = np.stack([distances(everyone, t) for t in triangles])
    near = exact.min(0)
    assert set(np.flatnonzero(near < charts.REACH - 0.05)) <= set(found.index) <= set(np.flatnonzero(near < charts.REACH + 0.05))
    assert found.weight.min() >= 0
    assert found.weight.sum(1) == pytest.approx(1)
    point = np.einsum("ni,nij->nj", found.weight, triangles[found.triangle])
    assert np.hypot(*(point - centre).T) == pytest.approx(near[found.index], abs=0.03)
    inside = near[found.index] < 1e-9
    assert inside.any()
    assert point[inside] == pytest.approx(centre[inside])


def test_every_texel_of_a_bilinear_lookup_has_a_point():
    rng = np.random.default_rng(5)
    for _ in range(20):
        triangle = rng.random((1, 3, 2)) * 12 + 2
        if abs(np.linalg.det(triangle[0, 1:] - triangle[0, 0])) < 0.5:
            continue
        found = set(cover_texels(triangle, 16, 16).index)
        w = rng.dirichlet([0.5, 0.5, 0.5], 200)
        x, y = np.floor(w @ triangle[0]).astype(int).T
        for i in (0, 1):
            for j in (0, 1):
                assert set((y + j) * 16 + x + i) <= found


def test_a_linear_function_is_read_back_exactly_from_a_wall():
    position, vertex, start = box([2.0, 3.0, 1.3])
    position = turned(position, 3)
    made = make_charts(position, vertex, start, 7.0)
    layout = pack(made.size, 2, 512)
    face = np.repeat(np.arange(6), 4)
    uv = made.local + layout.offset[made.chart[face]]
    corners = np.array([[4 * f + i for i in t] for f in range(6) for t in ((0, 1, 2), (0, 2, 3))])
    found = cover_texels(uv[corners], layout.width, layout.height)
    point = np.einsum("ni,nij->nj", found.weight, position[vertex[corners[found.triangle]]])
    slope = np.array([0.3, -1.2, 0.7])
    image = np.zeros((layout.height * layout.width, 1))
    image[found.index, 0] = point @ slope
    w = np.random.default_rng(6).dirichlet([1, 1, 1], len(corners) * 40)
    t = np.repeat(np.arange(len(corners)), 40)
    where = np.einsum("ni,nij->nj", w, uv[corners[t]])
    (x, y), (fx, fy) = np.floor(where).astype(int).T, (where % 1).T
    read = sum(image[(y + j) * layout.width + x + i, 0] * (fx if i else 1 - fx) * (fy if j else 1 - fy) for i in (0, 1) for j in (0, 1))
    exact = np.einsum("ni,nij->nj", w, position[vertex[corners[t]]]) @ slope
    assert read == pytest.approx(exact, abs=1e-9)


def test_margin_grows_ring_by_ring():
    image = np.zeros((9, 9, 2), np.float32)
    filled = np.zeros((9, 9), bool)
    filled[4, 4] = True
    image[4, 4] = 3, 5
    mask = fill_margin(image, filled, 2)
    i, j = np.indices((9, 9))
    ring = np.maximum(abs(i - 4), abs(j - 4))
    assert np.array_equal(mask, ring <= 2)
    assert np.array_equal(image[mask], np.broadcast_to(np.float32([3, 5]), (25, 2)))
    assert not image[~mask].any()
    assert filled.sum() == 1


def test_margin_takes_the_mean_of_its_neighbours_and_stops_when_full():
    image = np.zeros((1, 3, 1), np.float32)
    image[0, [0, 2], 0] = 1, 4
    mask = fill_margin(image, np.array([[True, False, True]]), 10**9)
    assert mask.all()
    assert image[0, 1, 0] == pytest.approx(2.5)


def test_a_large_texture_is_quick():
    n = 40
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    position = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    v = lambda a, b: a * (n + 1) + b  # noqa: E731
    quads = np.stack([v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)], 1)
    made = make_charts(position, quads.ravel(), np.arange(0, 4 * n * n + 1, 4), 12.5)
    assert made.size.tolist() == [[501, 501]]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    local = np.zeros((len(position), 2))
    local[quads.ravel()] = made.local
    found = cover_texels(local[triangles] + 4, 509, 509)
    point = np.einsum("ni,nij->nj", found.weight, position[triangles[found.triangle]])
    # Rows of the texture run along the plane of the grid: texel distances are metres times 12.5.
    assert len(found.index) == 503 * 503
    assert math.isclose(np.ptp(point[:, 0]), n, abs_tol=1e-9)
