"""Corner and texel values under light that is known everywhere."""

import math
from dataclasses import replace

import numpy as np
import pytest
from enfilade.core import bake_values
from enfilade.core.bake_values import Carrier, CornerItem, PageItem, evaluate, evaluate_groups, plan_page, refined
from enfilade.core.scene import Scene, SceneError

QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


class Ramp:
    """Irradiance that is a linear function of the place, with a step from polygon to polygon."""

    def __init__(self, step=0.0):
        self.step, self.asked = step, 0

    def shows(self, points, polygon):
        return np.ones(len(points), bool)

    def irradiance(self, points, polygon):
        self.asked += len(points)
        at = points @ np.array([0.3, 0.5, 0.7])
        return np.stack([at, 2 * at, 3 * at], axis=1) + self.step * polygon[:, None] + 1.0


def box(size=(2.0, 3.0, 1.0), first=0):
    position = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * np.array(size)
    start = np.arange(0, 25, 4)
    triangle = np.concatenate([[[s, s + 1, s + 2], [s, s + 2, s + 3]] for s in start[:-1]])
    return Carrier(position, QUADS.ravel(), start, np.zeros(24, bool), triangle, np.repeat(np.arange(6), 2) + first)


def scene(count, reflectance=0.5, emission=0.0):
    zero = np.zeros(count, np.int32)
    return Scene(
        "s", np.zeros((1, 3)), zero, zero, zero, np.full((count, 3), reflectance), np.full((count, 3), emission), zero, zero, ("r",), ("o",)
    )


def run(items, light, where):
    return drained(evaluate(items, light, where))


def drained(generator):
    steps = []
    try:
        while True:
            steps.append(next(generator))
    except StopIteration as end:
        return end.value, steps


def ramp(points, polygon, step=0.0):
    return Ramp(step).irradiance(points, polygon)


@pytest.mark.parametrize("quantity", ["radiosity", "lighting", "lux"])
def test_a_box_keeps_its_corners_apart(quantity):
    mesh = box()
    (color,), _ = run([CornerItem(mesh, quantity, "corner")], Ramp(10.0), scene(6, 0.5, math.pi))
    light = ramp(mesh.corner_position, np.repeat(np.arange(6), 4), 10.0)
    expected = {
        "radiosity": 1.0 + 0.5 * light / math.pi,
        "lighting": light / math.pi,
        "lux": np.repeat(179 * light @ np.array([[0.2126], [0.7152], [0.0722]]), 3, 1),
    }[quantity]
    assert color.dtype == np.float32
    assert color[:, :3] == pytest.approx(expected, rel=1e-6)
    assert (color[:, 3] == 1).all()


def test_values_per_vertex_are_means():
    mesh = box()
    (color,), _ = run([CornerItem(mesh, "lighting", "point")], Ramp(10.0), scene(6))
    corners = ramp(mesh.corner_position, np.repeat(np.arange(6), 4), 10.0) / math.pi
    expected = [corners[QUADS.ravel() == v].mean(0) for v in range(8)]
    assert color[:, :3] == pytest.approx(np.array(expected), rel=1e-6)


def test_materials_do_not_bleed_over_a_smooth_border():
    position = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.1], [0, 1, 0], [1, 1, 0], [2, 1, 0.1]], float)
    mesh = Carrier(
        position, np.array([0, 1, 4, 3, 1, 2, 5, 4]), np.array([0, 4, 8]), np.zeros(8, bool),
        np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]), np.array([0, 0, 1, 1]),
    )  # fmt: skip
    where = scene(2)
    where.reflectance[1] = 0.25
    (color,), _ = run([CornerItem(mesh, "radiosity", "corner")], Ramp(1.0), where)
    light = ramp(position, np.zeros(6, int))
    shared = light[1] + 0.5  # the mean of both sides
    assert color[1, :3] == pytest.approx(0.5 * shared / math.pi)
    assert color[4, :3] == pytest.approx(0.25 * shared / math.pi)
    assert color[0, :3] == pytest.approx(0.5 * light[0] / math.pi)


def test_faces_that_are_in_no_polygon_take_the_light_of_their_neighbours():
    mesh = box()
    mesh.triangle_polygon[:2] = -1
    (color,), _ = run([CornerItem(mesh, "lighting", "corner")], Ramp(), scene(6))
    assert not color[:4, :3].any()
    assert color[4:, :3].all()


def test_coplanar_faces_ask_once_at_each_vertex():
    n = 10
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    v = lambda a, b: a * (n + 1) + b  # noqa: E731
    quads = np.stack([v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)], 1)
    first = np.arange(0, 4 * n * n, 4)[:, None]
    triangle = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    position = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    grid = Carrier(
        position, quads.ravel(), np.arange(0, 4 * n * n + 1, 4), np.zeros(4 * n * n, bool), triangle, np.tile(np.arange(n * n), 2)
    )
    light = Ramp()
    (color,), _ = run([CornerItem(grid, "lighting", "corner")], light, scene(n * n))
    assert light.asked == (n + 1) ** 2
    assert color[:, :3] == pytest.approx(ramp(grid.corner_position, np.zeros(4 * n * n, int)) / math.pi, rel=1e-6)


def test_a_bent_face_takes_the_mean_of_its_triangles():
    position = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.3], [0, 1, 0]], float)
    face = np.array([[0, 1, 2], [0, 2, 3]])
    bent = Carrier(position, np.arange(4), np.array([0, 4]), np.zeros(4, bool), face, np.array([0, 1]))
    (color,), _ = run([CornerItem(bent, "lighting", "corner")], Ramp(1.0), scene(2))
    light = ramp(position, np.zeros(4, int)) + np.array([[0.5], [0.0], [0.5], [1.0]])
    assert color[:, :3] == pytest.approx(light / math.pi, rel=1e-6)


def test_many_items_are_asked_for_together_and_in_blocks(monkeypatch):
    monkeypatch.setattr(bake_values, "BLOCK", 50)
    items = [CornerItem(box(first=6 * k), "lighting", "corner") for k in range(7)]
    light = Ramp(1.0)
    values, steps = run(items, light, scene(42))
    assert light.asked == 7 * 24
    assert steps == sorted(steps)
    assert steps[-1] == pytest.approx(1.0)
    for k, color in enumerate(values):
        expected = ramp(items[k].carrier.corner_position, np.repeat(np.arange(6), 4) + 6 * k, 1.0) / math.pi
        assert color[:, :3] == pytest.approx(expected, rel=1e-6)
    assert run([], light, scene(1)) == ([], [])


def test_a_refined_carrier_lies_in_the_coarse_one():
    mesh = box()
    fine = refined(mesh, 0.3)
    at = fine.carrier.corner_position
    assert at == pytest.approx(np.einsum("ci,cij->cj", fine.weight, mesh.corner_position[mesh.triangle[np.repeat(fine.parent, 3)]]))
    edges = np.linalg.norm(at.reshape(-1, 3, 3) - np.roll(at.reshape(-1, 3, 3), 1, axis=1), axis=2)
    assert edges.max() <= 0.3
    assert refined(replace(mesh, texel_scale=2.0), 0.3).carrier.texel_scale == 2.0
    (color,), _ = run([CornerItem(fine.carrier, "lighting", "corner")], Ramp(10.0), scene(6))
    expected = ramp(at, np.repeat(fine.carrier.triangle_polygon, 3), 10.0) / math.pi
    assert color[:, :3] == pytest.approx(expected, rel=1e-5)


def test_marked_edges_stay_hard_when_refined():
    position = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]], float)
    sharp = np.zeros(8, bool)
    sharp[[1, 7]] = True  # the border between the two squares
    mesh = Carrier(
        position, np.array([0, 1, 4, 3, 1, 2, 5, 4]), np.array([0, 4, 8]), sharp,
        np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]), np.array([0, 0, 1, 1]),
    )  # fmt: skip
    fine = refined(mesh, 0.3).carrier
    (color,), _ = run([CornerItem(fine, "lighting", "corner")], Ramp(1.0), scene(2))
    expected = ramp(fine.corner_position, np.repeat(fine.triangle_polygon, 3), 1.0) / math.pi
    assert color[:, :3] == pytest.approx(expected, rel=1e-6)
    border = fine.corner_position[:, 0] == 1.0
    assert np.ptp(expected[border & (fine.corner_position[:, 1] == 0.5), 0]) == pytest.approx(1 / math.pi)


def texture(carriers, density=8.0, margin=2, limit=512, quantity="lighting", step=0.0):
    page = plan_page(carriers, range(len(carriers)), density, margin, limit, "page")
    (image,), _ = run([PageItem(carriers, page, quantity, margin)], Ramp(step), scene(6 * len(carriers), 0.5, math.pi))
    return page, image


def lookup(image, uv):
    """Bilinear values of an image at texel coordinates."""
    x, y = np.floor(uv).astype(int).T
    fx, fy = (uv % 1).T[..., None]
    y1, x1 = np.minimum(y + 1, image.shape[0] - 1), np.minimum(x + 1, image.shape[1] - 1)
    return (image[y, x] * (1 - fx) + image[y, x1] * fx) * (1 - fy) + (image[y1, x] * (1 - fx) + image[y1, x1] * fx) * fy


@pytest.mark.parametrize("quantity", ["radiosity", "lighting"])
def test_a_texture_shows_linear_light_exactly(quantity):
    carriers = [box(), box((1.0, 0.7, 2.2), first=6)]
    page, image = texture(carriers, quantity=quantity, step=10.0)
    assert image.shape == (page.height, page.width, 4)
    assert (image[:, :, 3] == 1).all()
    weight = np.random.default_rng(0).dirichlet([1, 1, 1], 50)
    for carrier, uv in zip(carriers, page.uv, strict=True):
        for t, polygon in zip(carrier.triangle, carrier.triangle_polygon, strict=True):
            light = ramp(weight @ carrier.corner_position[t], np.full(50, polygon), 10.0)
            expected = 1.0 + 0.5 * light / math.pi if quantity == "radiosity" else light / math.pi
            assert lookup(image[:, :, :3].astype(float), weight @ uv[t]) == pytest.approx(expected, rel=1e-5)


def test_margins_are_filled_and_what_lies_beyond_is_black():
    page, image = texture([box()], density=8.0, margin=3)
    lit = image[:, :, 0] > 0
    low = np.floor(min(uv.min() for uv in page.uv)).astype(int)
    assert low == 3
    assert lit[0, 0]
    wide, blank = texture([box((1, 1, 1))], density=20.0, margin=1)
    assert 0 < (blank[:, :, 0] > 0).mean() <= 1
    assert wide.width >= 21


def test_a_texture_that_is_too_small_gets_coarser_texels():
    page, image = texture([box()], density=64.0, limit=128, margin=1)
    assert max(page.width, page.height) <= 128
    assert page.density < 64
    assert image.max() < 1e3
    with pytest.raises(SceneError, match="'page' does not fit into 16 x 16"):
        texture([box()], density=64.0, limit=16, margin=8)


class UnderRug:
    """One where the floor is open, nothing under a rug that covers x < 0.5."""

    def shows(self, points, polygon):
        return points[:, 0] >= 0.5

    def irradiance(self, points, polygon):
        return np.repeat(self.shows(points, polygon)[:, None].astype(float), 3, axis=1)


def test_the_dark_under_a_rug_does_not_creep_out():
    """A floor of three by one squares of 1 m: the first square reaches from under the rug into the open."""
    position = np.array([(x, y, 0.0) for y in (0, 1) for x in (-1, 0, 1, 2)])
    corner = np.array([0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6])
    triangle = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [8, 9, 10], [8, 10, 11]])
    carrier = Carrier(position, corner, np.array([0, 4, 8, 12]), np.zeros(12, bool), triangle, np.repeat([0, 1, 2], 2))
    (color,), _ = run([CornerItem(carrier, "lighting", "corner")], UnderRug(), scene(3))
    lit = color[:, 0] > 0
    # Only the face that lies under the rug with all of itself has dark corners, and those that it has to itself.
    assert lit.tolist() == [False, True, True, False] + [True] * 8


def test_light_groups_are_evaluated_side_by_side():
    class Two(Ramp):
        def irradiance_of_groups(self, points, polygon):
            whole = self.irradiance(points, polygon)
            return np.stack([0.25 * whole, 0.75 * whole], axis=1)

    where = [scene(6, emission=0.0), scene(6, emission=math.pi)]
    items = [CornerItem(box(), "radiosity", "corner"), PageItem([box()], plan_page([box()], [0], 8, 2, 64, "box"), "radiosity", 2)]
    parts, _ = drained(evaluate_groups(items, Two(), where))
    (corners, texels), _ = run(items, Two(), where[1])
    for (one, other), whole in zip(parts, (corners, texels), strict=True):
        assert one.shape == other.shape == whole.shape
        assert (one + other)[..., :3] == pytest.approx(whole[..., :3], rel=1e-5)
        assert one[..., :3].mean() < other[..., :3].mean()
