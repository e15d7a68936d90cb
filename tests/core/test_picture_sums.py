"""Means of pictures over parts of them, beside exact integrals and dense sampling."""

import numpy as np
import pytest
from enfilade.core.picture_sums import PictureSums

UNIT = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])


def rectangle(low, high):
    low, high = np.asarray(low, float), np.asarray(high, float)
    return low + UNIT * (high - low)


def noise(height, width, channels=3):
    return np.random.default_rng(1).random((height, width, channels))


def looked_up(pixels, at, extension):
    """Pixels as squares, by looking."""
    height, width = pixels.shape[:2]
    x, y = np.floor(at[:, 0] * width).astype(int), np.floor(at[:, 1] * height).astype(int)
    if extension == "REPEAT":
        return pixels[y % height, x % width]
    if extension == "MIRROR":
        fold = lambda i, n: np.where(i % (2 * n) < n, i % (2 * n), 2 * n - 1 - i % (2 * n))  # noqa: E731
        return pixels[fold(y, height), fold(x, width)]
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    found = pixels[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return found if extension == "EXTEND" else found * inside[:, None]


def test_whole_pixels_are_exact():
    pixels = noise(12, 20)
    sums = PictureSums(pixels, "REPEAT", False)
    assert sums.mean == pytest.approx(pixels.mean((0, 1)), rel=1e-12)
    part = rectangle((5 / 20, 2 / 12), (9 / 20, 11 / 12))
    assert sums.means(part).mean(0) == pytest.approx(pixels[2:11, 5:9].mean((0, 1)), rel=1e-9)


def test_halves_of_a_picture():
    pixels = np.zeros((4, 4, 1))
    pixels[:, 2:] = 1.0
    sums = PictureSums(pixels, "EXTEND", False)
    assert sums.means(rectangle((0, 0), (0.5, 1)))[:, 0] == pytest.approx([0, 0], abs=1e-12)
    assert sums.means(rectangle((0.5, 0), (1, 1)))[:, 0] == pytest.approx([1, 1], rel=1e-12)
    # A triangle that leans to the bright side: an eighth of its half is dark.
    assert sums.means(np.array([[[0, 0], [1, 0], [1, 1.0]]]))[0, 0] == pytest.approx(0.75, rel=2e-3)


@pytest.mark.parametrize("extension", ["REPEAT", "MIRROR", "EXTEND", "CLIP"])
@pytest.mark.parametrize("shape", [(9, 16), (1500, 7)])
def test_any_triangle_as_by_dense_sampling(extension, shape):
    pixels = noise(*shape)
    sums = PictureSums(pixels, extension, False)
    triangles = np.random.default_rng(2).uniform(-1.5, 2.5, (40, 3, 2))
    edge = triangles[:, 1:] - triangles[:, :1]
    triangles = triangles[np.abs(np.linalg.det(edge)) > 2.5]  # of slivers through noise no two ways give the same
    assert len(triangles) >= 10
    n = 400
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n)))
    s, t = (i + 0.5) / n, (j + 0.5) / n
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    for triangle, mean in zip(triangles, sums.means(triangles), strict=True):
        at = triangle[0] + s[:, None] * (triangle[1] - triangle[0]) + t[:, None] * (triangle[2] - triangle[0])
        assert mean == pytest.approx(looked_up(pixels, at, extension).mean(0), abs=0.012)


def test_a_picture_repeats_itself_far_away():
    sums = PictureSums(noise(8, 8), "REPEAT", True)
    near = rectangle((0.1, 0.2), (0.7, 0.6))
    for shift in ([3, 0], [0, -5], [-1000, 1000]):
        assert sums.means(near + shift) == pytest.approx(sums.means(near), rel=1e-6)


def test_between_two_pixels_the_picture_is_interpolated():
    pixels = np.array([[[0.0], [1.0]]])
    smooth = PictureSums(pixels, "EXTEND", True)
    assert smooth.mean == pytest.approx([0.5])
    # From the middle of the left pixel to that of the right one it rises evenly.
    assert smooth.means(rectangle((0.25, 0), (0.5, 1)))[:, 0].mean() == pytest.approx(0.25, rel=1e-9)
    assert smooth.means(rectangle((0.0, 0), (0.5, 1)))[:, 0].mean() == pytest.approx(0.125, rel=1e-9)
    around = PictureSums(pixels, "REPEAT", True)
    assert around.means(rectangle((0.0, 0), (0.5, 1)))[:, 0].mean() == pytest.approx(0.25, rel=1e-9)


def test_parts_of_no_area_are_looked_at_where_they_are():
    ramp = np.broadcast_to((np.arange(64)[None, :, None] + 0.5) / 64, (64, 64, 1))
    sums = PictureSums(ramp, "EXTEND", True)
    point = np.full((1, 3, 2), 0.4)
    upright = np.array([[[0.3, 0.1], [0.3, 0.9], [0.3, 0.5]]])
    level = np.array([[[0.2, 0.5], [0.6, 0.5], [0.3, 0.5]]])
    assert sums.means(np.concatenate([point, upright, level]))[:, 0] == pytest.approx([0.4, 0.3, 0.4], abs=1e-3)
