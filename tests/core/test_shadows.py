"""What is seen of a lamp past blockers, against exact cases and against lamps in very many small parts."""

import numpy as np
import pytest
from enfilade.core.basis import gauss
from enfilade.core.occlusion import flat_blockers
from enfilade.core.transport import lambert
from scenery import rectangle, rotation, visible_form_factors

UP = np.array([0.0, 0.0, 1.0])
LAMP = rectangle((-1, -1, 4), (0, 2, 0), (2, 0, 0))


def blockers_of(polygons):
    """Blockers from corners of parallelograms (4) and triangles (3)."""
    origin, a, b = (np.array([p[k] for p in polygons], float).reshape(-1, 3) for k in (0, 1, -1))
    a, b = a - origin, b - origin
    normal = np.cross(a, b)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return flat_blockers(origin, a, b, np.array([len(p) == 3 for p in polygons], bool), normal, np.arange(len(polygons)))


def seen(points, polygons, lamp=LAMP, normals=None, rows=None):
    """(n,) form factor and (n,) veil from points to a lamp, every blocker asked for each of them."""
    points = np.atleast_2d(np.asarray(points, float)).astype(np.float32)
    normals = np.tile(UP, (len(points), 1)) if normals is None else np.asarray(normals, float)
    outlines = np.repeat(np.asarray(lamp, float)[None], len(points), 0)
    blockers = blockers_of(polygons)
    pair, blocker = rows or (np.repeat(np.arange(len(points)), len(blockers)), np.tile(np.arange(len(blockers)), len(points)))
    return visible_form_factors(points, normals, np.arange(len(points)), outlines, blockers, pair, blocker)


def form(points, polygon, normals=None):
    points = np.atleast_2d(np.asarray(points, float))
    normals = np.tile(UP, (len(points), 1)) if normals is None else normals
    return lambert(points, normals, np.repeat(np.asarray(polygon, float)[None], len(points), 0))


def test_a_half_plane_hides_half_of_a_lamp_from_a_point_below_its_edge():
    half = rectangle((0, -50, 2), (50, 0, 0), (0, 100, 0))
    for tilt in (0, 1, -1):
        plate = half + np.outer([0, 1, 1, 0], [0, 0, tilt])
        factor, veil = seen((0, 0, 0), [plate])
        assert factor == pytest.approx(form((0, 0, 0), LAMP) / 2, rel=1e-6)
        assert veil.tolist() == [-1]


def test_a_blocker_within_the_cone_of_the_lamp_takes_just_its_own_form_factor_away():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1.5, 1.5, (200, 2)), np.zeros(200)])
    # A parallelogram or triangle whose corners lie on lines of sight to the lamp, at any height and tilt.
    for k in range(20):
        corners = points[k] + rng.uniform(0.1, 0.9, (3, 1)) * (
            LAMP[0] + rng.uniform(0.02, 0.98, (3, 2)) @ [[0, 2, 0], [2, 0, 0]] - points[k]
        )
        if np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) < 0.05:
            continue
        factor, _ = seen(points[k], [corners])
        assert factor == pytest.approx(form(points[k], LAMP) - form(points[k], corners), rel=3e-6)


def test_disjoint_shadows_add_up():
    small = [rectangle((x, y, 2), (0.2, 0, 0), (0, 0.2, 0.05)) for x in (-0.4, 0.1) for y in (-0.4, -0.1, 0.2)]
    expected = form((0, 0, 0), LAMP) - sum(form((0, 0, 0), s) for s in small)
    assert seen((0, 0, 0), small)[0] == pytest.approx(expected, rel=1e-6)


def test_shadows_upon_each_other_count_once():
    plate = rectangle((-0.3, -0.3, 2), (0.6, 0, 0), (0, 0.6, 0))
    alone = seen((0, 0, 0), [plate])[0]
    within = rectangle((-0.05, -0.1, 1), (0.1, 0, 0.1), (0, 0.15, 0.2))
    beyond = rectangle((-0.2, -0.2, 3), (0.4, 0, 0), (0, 0.3, 0.3))
    for others in ([plate], [within], [beyond], [within, beyond, plate, within]):
        for order in ([plate, *others], [*others, plate]):
            assert seen((0, 0, 0), order)[0] == pytest.approx(alone, rel=1e-6)
    # Two plates that overlap by half, seen from where their union is one wider plate.
    wider = rectangle((-0.3, -0.3, 2), (0.9, 0, 0), (0, 0.6, 0))
    overlap = [plate, plate + [0.3, 0, 0]]
    assert seen((0, 0, 0), overlap)[0] == pytest.approx(seen((0, 0, 0), [wider])[0], rel=1e-6)
    # The same, one of them nearer and as much smaller.
    assert seen((0, 0, 0), [plate, 0.5 * overlap[1]])[0] == pytest.approx(seen((0, 0, 0), [wider])[0], rel=1e-6)


def test_a_plate_in_tiles_casts_the_shadow_of_the_plate():
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-2, 2, (40, 2)), np.zeros(40)])
    turn = rotation(3)
    middle = np.array([0.1, -0.2, 2])
    plate = rectangle(-np.ones(3) * [0.6, 0.5, 0], (1.2, 0, 0), (0, 1, 0)) @ turn.T + middle
    a, b = (plate[1] - plate[0]) / 3, (plate[3] - plate[0]) / 4
    tiles = [rectangle(plate[0] + i * a + j * b, a, b) for i in range(3) for j in range(4)]
    halves = [plate[[0, 1, 2]], plate[[0, 2, 3]]]
    whole = seen(points, [plate])[0]
    assert np.mean(whole < form(points, LAMP) - 1e-9) > 0.2
    scale = form(points, LAMP).max()
    np.testing.assert_allclose(seen(points, tiles)[0], whole, atol=3e-6 * scale)
    np.testing.assert_allclose(seen(points, halves)[0], whole, atol=3e-6 * scale)


def test_what_stands_elsewhere_hides_nothing():
    free = form((0, 0, 0), LAMP)
    for plate in (
        rectangle((-5, -5, 5), (10, 0, 0), (0, 10, 0)),  # behind the lamp
        rectangle((-5, -5, -1), (10, 0, 0), (0, 10, 0)),  # behind the point
        rectangle((3, -5, 2), (9, 0, 0), (0, 10, 0)),  # beside the shaft
        rectangle((-5, -5, 4), (10, 0, 0), (0, 10, 0)),  # in the lamp's own plane
        rectangle((1, -5, 0), (0, 10, 0), (0, 0, 3.99)),  # touches the shaft from outside
    ):
        factor, veil = seen((0, 0, 0), [plate])
        assert factor == pytest.approx(free, rel=1e-6)
        assert veil.tolist() == [-1]


@pytest.mark.parametrize(
    "plate",
    [
        rectangle((-5, -5, 0), (10, 0, 0), (0, 10, 0)),  # around the point
        rectangle((0, -5, 0), (0, 10, 0), (0, 0, 3)),  # seen edge on, its plane cuts the lamp in two
        rectangle((0, 5, 1), (0, 10, 0), (0, 0, 1))[:3],  # the same, far off to the side
    ],
)
def test_a_plate_seen_edge_on_hides_nothing(plate):
    factor, veil = seen((0, 0, 0), [plate])
    assert factor == pytest.approx(form((0, 0, 0), LAMP), rel=1e-6)
    assert veil.tolist() == [-1]


def test_plates_that_cross_the_lamp_or_the_horizon():
    # Half in front of the lamp, half behind: only the front half hides. Below the horizon nothing was to be hidden.
    point = np.array([[-3.0, 0, 0]])
    upright = rectangle((0, -0.3, 3), (0, 0.6, 0), (0, 0, 2))
    inside = rectangle((0, -0.3, 3), (0, 0.6, 0), (0, 0, 1))
    assert seen(point, [upright])[0] == pytest.approx(seen(point, [inside])[0], rel=1e-6)
    assert seen(point, [inside])[0] < 0.95 * form(point, LAMP)
    sunk = rectangle((-2, -0.3, -3), (0, 0.6, 0), (0, 0, 4))
    above = rectangle((-2, -0.3, 0), (0, 0.6, 0), (0, 0, 1))
    wall_lamp = rectangle((1, -1, -2), (0, 2, 0), (0, 0, 5))
    assert seen(point, [sunk], wall_lamp)[0] == pytest.approx(seen(point, [above], wall_lamp)[0], rel=1e-6)
    assert seen(point, [above], wall_lamp)[0] < 0.95 * form(point, wall_lamp)


def test_a_plate_that_touches_point_or_lamp():
    # A wall stands on the floor beside the point, another hangs from the lamp's middle.
    wall = rectangle((-1e-3, -9, 0), (0, 18, 0), (0, 0, 3.9))
    lamp_right = rectangle((0, -1, 4), (0, 2, 0), (1, 0, 0))
    visible = seen((0, 0, 0), [wall])[0]
    assert form((0, 0, 0), lamp_right) < visible < 1.01 * form((0, 0, 0), lamp_right)
    hanging = rectangle((0, -9, 3.0), (0, 18, 0), (0, 0, 1.0))
    expected = form((3, 0, 0), rectangle((0, -1, 4), (0, 2, 0), (1, 0, 0)))
    assert seen((3, 0, 0), [hanging])[0] == pytest.approx(expected, rel=2e-5)  # a blocker begins a hair behind its plane


def test_the_veil_is_the_blocker_that_hides_all():
    plate = rectangle((-2, -2, 2), (4, 0, 0), (0, 4, 0))
    half = rectangle((-2, -2, 1), (2, 0, 0), (0, 4, 0))
    factor, veil = seen([(0, 0, 0), (9, 0, 0)], [half, plate])
    assert factor[0] == 0
    assert factor[1] == pytest.approx(form((9, 0, 0), LAMP)[0], rel=1e-6)
    assert veil.tolist() == [1, -1]
    factor, veil = seen((0, 0, 0), [half, half + [2, 0, 0]])  # both together, neither alone
    assert factor[0] == pytest.approx(0, abs=1e-8)
    assert veil.tolist() == [-1]
    # Numbers are those of the building, not places in a selection.
    blockers = blockers_of([half, half, half, plate]).take(np.array([3, 0]))
    _, veil = visible_form_factors(
        np.zeros((1, 3), np.float32), UP[None], np.array([0]), LAMP[None], blockers, np.array([0, 0]), np.array([0, 1])
    )
    assert veil.tolist() == [3]


def test_only_the_rows_that_are_asked_for_count():
    plate = rectangle((-0.3, -0.3, 2), (0.6, 0, 0), (0, 0.6, 0))
    points = [(0, 0, 0), (0.1, 0, 0), (0.2, 0, 0)]
    factor, _ = seen(points, [plate, plate + [0.3, 0, 0]], rows=(np.array([0, 2]), np.array([0, 1])))
    assert factor[0] == pytest.approx(seen(points[0], [plate])[0][0], rel=1e-9)
    assert factor[1] == pytest.approx(form(points[1], LAMP)[0], rel=1e-9)
    assert factor[2] == pytest.approx(seen(points[2], [plate + [0.3, 0, 0]])[0][0], rel=1e-9)


def test_lamps_of_several_pieces():
    pieces = np.array([LAMP, LAMP + [3, 0, 0], LAMP + [0, 3, 1]])
    plate = rectangle((-0.3, -0.3, 2), (1.6, 0, 0), (0, 0.6, 0.5))
    points = np.array([(0, 0, 0), (1, 1, 0)], np.float32)
    owner = np.array([0, 0, 1])
    rows = np.array([0, 1]), np.array([0, 0])
    factor, _ = visible_form_factors(points, np.tile(UP, (2, 1)), owner, pieces, blockers_of([plate]), *rows)
    expected = [seen(points[i], [plate], lamp)[0][0] for i, lamp in zip(owner, pieces, strict=True)]
    assert factor == pytest.approx(np.bincount(owner, expected), rel=1e-9)


def test_the_form_factor_of_two_squares_with_a_square_between():
    # Unit squares 1 m apart, a square of half the size halfway: kinks of the shadow lie on the middle lines alone.
    x, w = gauss(14)
    x, w = np.concatenate([0.5 * x, 0.5 + 0.5 * x]), np.concatenate([0.5 * w, 0.5 * w])
    points = np.column_stack([np.repeat(x, 28), np.tile(x, 28), np.zeros(784)])
    factor, _ = seen(points, [rectangle((0.25, 0.25, 0.5), (0.5, 0, 0), (0, 0.5, 0))], rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0)))
    assert np.outer(w, w).ravel() @ factor == pytest.approx(0.0995062945989848, rel=1e-6)


@pytest.mark.parametrize(("seed", "number", "size"), [*((k, 8, 0.8) for k in range(6)), (6, 40, 0.35)])
def test_any_blockers_against_a_lamp_in_parts(seed, number, size):
    rng = np.random.default_rng(seed)
    turn = rotation(50 + seed)
    points = (np.column_stack([rng.uniform(-2, 2, (12, 2)), rng.uniform(-0.2, 0.2, 12)])).astype(np.float32)
    normals = UP + rng.normal(size=(12, 3)) * 0.4
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    polygons = []
    for k in range(number):
        origin, a, b = rng.uniform((-1.5, -1.5, 0.3), (1.5, 1.5, 3.8)), *rng.normal(size=(2, 3)) * size
        polygons.append(np.array([origin, origin + a, origin + b]) if k % 3 == 0 else rectangle(origin, a, b))
    blockers = blockers_of([p @ turn.T for p in polygons])
    lamp = LAMP @ turn.T
    pair, blocker = np.repeat(np.arange(12), number), np.tile(np.arange(number), 12)
    turned = (points.astype(float) @ turn.T).astype(np.float32)
    factor, _ = visible_form_factors(turned, normals @ turn.T, np.arange(12), np.repeat(lamp[None], 12, 0), blockers, pair, blocker)
    count = 150
    s, t = (x.ravel() for x in np.meshgrid(*[(np.arange(count) + 0.5) / count] * 2))
    places = LAMP[0] + s[:, None] * [0, 2, 0] + t[:, None] * [2, 0, 0]
    for k in range(12):
        d = places - points[k]
        r2 = (d**2).sum(1)
        light = np.maximum(d @ normals[k], 0) * d[:, 2] / (np.pi * r2**2) * (4 / count**2)
        hidden = np.zeros(len(places), bool)
        for polygon in polygons:
            o, a, b = polygon[0], polygon[1] - polygon[0], polygon[-1] - polygon[0]
            n = np.cross(a, b)
            with np.errstate(divide="ignore"):
                h = ((o - points[k]) @ n) / (d @ n)
            x = points[k] + h[:, None] * d - o
            u, v = (np.linalg.inv([[a @ a, a @ b], [a @ b, b @ b]]) @ [a, b]) @ x.T
            hidden |= (h > 0) & (h < 1) & (u >= 0) & (v >= 0) & (u + v <= 1 if len(polygon) == 3 else (u <= 1) & (v <= 1))
        # The edges of the shadows run through some hundreds of the 22 500 parts, either way.
        assert factor[k] == pytest.approx(light[~hidden].sum(), abs=6e-3 * light.sum())
        assert 0 <= factor[k] <= light.sum() * 1.0001
