"""Segments, rays and shafts against a plain double precision reference, one segment and one blocker at a time."""

import numpy as np
import pytest
from enfilade.core.occlusion import Bodies, ShaftIndex, Shafts, blockers_of, cut_segments, first_hits, flat_blockers, hemisphere
from enfilade.core.regions import merge
from scenery import box, rectangle, rotation, scene_of

NEAR = 1e-4
"""Segments this near (in units of a blocker's sides, or metres from its plane) to a decision are left out of comparisons."""


def met_first(blockers, origins, directions):
    hits = first_hits(blockers, origins, directions)
    return hits.blocker, hits.behind


class World:
    """Parallelograms and triangles as blockers, and the same in double precision for the reference."""

    def __init__(self, origin, a, b, triangle):
        self.origin, self.a, self.b, self.triangle = origin, a, b, triangle
        normal = np.cross(a, b)
        self.normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        self.blockers = flat_blockers(origin, a, b, triangle, self.normal, np.arange(len(origin)))

    def meet(self, p, q):
        """Where segments p-q (n, 3) meet every blocker: share of the way t (n, K), and the margin (n, K) of the decision.

        The margin is positive inside, negative outside, and says how far from either.
        """
        hp, hq = self._heights(p), self._heights(q)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = hp / (hp - hq)
        point = p[:, None] + np.nan_to_num(t)[..., None] * (q - p)[:, None] - self.origin
        s, r = self._coordinates(point)
        inside = np.minimum(s, r)
        far = np.where(self.triangle, 1 - s - r, np.minimum(1 - s, 1 - r))
        apart = np.where(hp * hq < 0, np.minimum(np.abs(hp), np.abs(hq)), -np.minimum(np.abs(hp), np.abs(hq)))
        return t, np.minimum(np.minimum(inside, far), apart)

    def _heights(self, p):
        return np.einsum("nkd,kd->nk", p[:, None] - self.origin, self.normal)

    def _coordinates(self, offset):
        aa, ab, bb = (np.einsum("kd,kd->k", x, y) for x, y in ((self.a, self.a), (self.a, self.b), (self.b, self.b)))
        pa, pb = (np.einsum("nkd,kd->nk", offset, x) for x in (self.a, self.b))
        det = aa * bb - ab * ab
        return (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det


def random_world(seed, count, size=1.0, spread=2.0, aligned=False):
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-spread, spread, (count, 3))
    a, b = rng.normal(size=(2, count, 3)) * size
    if aligned:
        axis = rng.integers(0, 3, count)
        a, b = np.zeros((2, count, 3))
        a[np.arange(count), axis] = rng.choice([-1, 1], count) * rng.uniform(0.3, 3 * size, count)
        b[np.arange(count), (axis + rng.integers(1, 3, count)) % 3] = rng.uniform(0.3, 3 * size, count)
        origin = np.round(origin * 4) / 4
    return World(origin, a, b, rng.random(count) < 0.4)


def everything(n, count):
    """Rows (pair, blocker): every pair against every blocker."""
    return np.repeat(np.arange(n), count), np.tile(np.arange(count), n)


# ------------------------------------------------------------------------------------------------- blockers


def test_coordinates_of_blockers():
    world = random_world(0, 40)
    b = world.blockers
    for k in range(40):
        o, u, v = (x[k].astype(float) for x in (world.origin, world.a, world.b))
        corners = [o, o + u, o + v] if world.triangle[k] else [o, o + u, o + u + v, o + v]
        at = np.array([[d @ p - b.offset[k, i] for i, d in enumerate((b.normal[k], b.dual_x[k], b.dual_y[k]))] for p in corners])
        expected = [[0, 0], [1, 0], [0, 1]] if world.triangle[k] else [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        np.testing.assert_allclose(at[:, 0], 0, atol=1e-5)
        np.testing.assert_allclose(at[:, 1:], expected, atol=3e-4)
        np.testing.assert_allclose(b.corners[k, : len(corners)], corners, atol=1e-6)
    assert b.take(np.array([7, 3])).id.tolist() == [7, 3]
    assert len(b.take(np.zeros(0, int))) == 0


def test_blockers_stand_for_the_pieces_of_regions():
    turn = rotation(1)
    door = [
        rectangle((0, 0, 0), (1, 0, 0), (0, 0, 2)),
        rectangle((1, 0, 1.5), (1, 0, 0), (0, 0, 0.5)),
        rectangle((2, 0, 0), (1, 0, 0), (0, 0, 2)),
    ]
    regions = merge(scene_of([p @ turn.T + 100 for p in [*door, np.array([(5, 0, 0), (6, 0, 0), (5, 1, 1)])]]))
    blockers = blockers_of(regions)
    size = np.linalg.norm(
        np.cross(blockers.corners[:, 1] - blockers.corners[:, 0], blockers.corners[:, 3] - blockers.corners[:, 0]), axis=1
    )
    area = np.bincount(blockers.region, size * np.where(blockers.triangle, 0.5, 1), minlength=len(regions))
    np.testing.assert_allclose(area, regions.area, rtol=1e-5)
    np.testing.assert_allclose(blockers.normal, regions.normal[blockers.region], atol=1e-6)
    np.testing.assert_allclose(size, blockers.size**2, rtol=1e-5)


# ------------------------------------------------------------------------------------------------- segments


@pytest.mark.parametrize("aligned", [False, True], ids=["any", "aligned"])
@pytest.mark.parametrize("shape", [(4, 4), (1, 1), (1, 9), (3, 2)])
def test_cut_segments_are_those_of_the_reference(shape, aligned):
    world = random_world(1, 25, aligned=aligned)
    rng = np.random.default_rng(2)
    n, (i, j) = 300, shape
    # Points of a pair lie close together, as the nodes of elements do, so that one blocker often cuts all segments.
    a, b = (rng.uniform(-3, 3, (n, 1, 3)) + rng.normal(size=(n, m, 3)) * rng.choice([0.05, 0.5], (n, 1, 1)) for m in (i, j))
    a, b = a.astype(np.float32), b.astype(np.float32)
    cuts = cut_segments(world.blockers, *everything(n, 25), a, b)
    p = np.repeat(a.astype(float), j, 1).reshape(-1, 3)
    q = np.tile(b.astype(float), (1, i, 1)).reshape(-1, 3)
    _, margin = world.meet(p, q)
    sure = (np.abs(margin) > NEAR).all(1) | (margin > NEAR).any(1)
    assert sure.mean() > 0.97
    hit = (margin > 0).any(1)
    assert 0.15 < hit.mean() < 0.9
    np.testing.assert_array_equal(cuts.hidden.ravel()[sure], hit[sure])
    by_one = (margin > 0).reshape(n, i * j, 25).all(1)
    clear = (np.abs(margin) > NEAR).all(1).reshape(n, i * j).all(1)
    assert by_one.any()
    np.testing.assert_array_equal(cuts.alone[clear] >= 0, by_one.any(1)[clear])
    named = np.flatnonzero(clear & (cuts.alone >= 0))
    assert by_one[named, cuts.alone[named]].all()


def test_only_the_rows_that_are_asked_for_count():
    world = random_world(3, 12)
    rng = np.random.default_rng(4)
    n = 400
    a, b = rng.uniform(-3, 3, (2, n, 1, 3)).astype(np.float32)
    wanted = rng.random((n, 12)) < 0.3
    pair, blocker = np.nonzero(wanted)
    cuts = cut_segments(world.blockers, pair, blocker, a, b)
    _, margin = world.meet(a[:, 0].astype(float), b[:, 0].astype(float))
    sure = (np.abs(margin) > NEAR).all(1)
    np.testing.assert_array_equal(cuts.hidden[sure, 0, 0], ((margin > 0) & wanted).any(1)[sure])
    assert not cut_segments(world.blockers, np.zeros(0, int), np.zeros(0, int), a, b).hidden.any()


def single(polygon):
    """A world of one parallelogram, or triangle, from its corners."""
    o, a, b = polygon[0], polygon[1] - polygon[0], polygon[-1] - polygon[0]
    return World(o[None], a[None], b[None], np.array([len(polygon) == 3]))


WALL = rectangle((0, -1, -1), (0, 2, 0), (0, 0, 2))


def cut(world, p, q):
    a, b = (np.array(x, np.float32).reshape(1, 1, 3) for x in (p, q))
    rows = everything(1, len(world.blockers))
    there, back = (cut_segments(world.blockers, *rows, *ends).hidden[0, 0, 0] for ends in ((a, b), (b, a)))
    assert there == back
    return bool(there)


@pytest.mark.parametrize("offset", [0.0, 50.0])
def test_segments_that_end_on_the_plane_are_not_cut(offset):
    world = single(WALL + offset)
    for end in ((0, 0, 0), (0, 0.3, -0.9), (0, 1, 1)):
        for start in ((1, 0, 0), (-2, 0.5, 0.5), (1e-3, 0, 0)):
            assert not cut(world, np.add(end, offset), np.add(start, offset))
    assert cut(world, np.add((1, 0, 0), offset), np.add((-1, 0.5, 0.5), offset))


def test_segments_from_a_turned_plane_are_not_cut():
    # In single precision points of a slanted plane lie a little to either side of it.
    for seed in range(5):
        turn, rng = rotation(seed), np.random.default_rng(seed)
        world = single(WALL @ turn.T + 5)
        a, b = (np.column_stack([x, rng.uniform(-1, 1, (500, 2))]) @ turn.T + 5 for x in (np.zeros(500), rng.choice([-1, 1], 500)))
        cuts = cut_segments(world.blockers, *everything(500, 1), a[:, None].astype(np.float32), b[:, None].astype(np.float32))
        assert not cuts.hidden.any()


def test_segments_within_the_plane_are_not_cut():
    world = single(WALL)
    assert not cut(world, (0, -3, 0), (0, 3, 0))
    assert not cut(world, (0, 0, 0), (0, 0.5, 0.5))


def test_the_sides_of_a_blocker():
    eps = 1e-3
    for polygon, middle in ((WALL, (0, 0, 0)), (WALL[:3], WALL[:3].mean(0))):
        world = single(polygon)
        for a, b in zip(polygon, np.roll(polygon, -1, 0), strict=True):
            out = 0.5 * (a + b) - middle
            for shift, expected in ((-eps, True), (eps, False)):
                at = 0.5 * (a + b) + shift * out
                assert cut(world, at + [1, 0, 0], at - [1, 0, 0]) == expected
                assert not cut(world, at + [1, 0, 0], at + [0.1, 0, 0])


def test_alone_means_one_blocker_for_all_segments():
    halves = World(np.array([(0, -1, -1), (0, 0, -1.0)]), np.tile([0, 1.0, 0], (2, 1)), np.tile([0, 0, 2.0], (2, 1)), np.zeros(2, bool))
    spread = np.array([(1, -0.2, 0), (1, 0.2, 0), (1, -0.1, 0.3)], np.float32)[None]
    for world, expected in ((halves, -1), (single(WALL), 0)):
        cuts = cut_segments(world.blockers, *everything(1, len(world.blockers)), spread, spread * np.float32([-1, 1, 1]))
        assert cuts.hidden.all()
        assert cuts.alone.tolist() == [expected]


def test_a_seam_between_two_blockers_lets_nothing_through():
    # Two triangles of one wall: what passes the seam is cut by the one or the other.
    world = World(WALL[[0, 0]], WALL[[1, 2]] - WALL[0], WALL[[2, 3]] - WALL[0], np.ones(2, bool))
    rng = np.random.default_rng(0)
    t = rng.uniform(-0.99, 0.99, 2000)
    seam = np.column_stack([0 * t, t, t])
    direction = np.column_stack([np.ones(2000), rng.normal(size=(2000, 2))])
    a, b = (seam + s * direction for s in (0.7, -1.3))
    cuts = cut_segments(world.blockers, *everything(2000, 2), a[:, None].astype(np.float32), b[:, None].astype(np.float32))
    assert cuts.hidden.mean() > 0.98


# ----------------------------------------------------------------------------------------------------- rays


@pytest.mark.parametrize("aligned", [False, True], ids=["any", "aligned"])
def test_first_hits_are_those_of_the_reference(aligned):
    world = random_world(5, 60, aligned=aligned)
    rng = np.random.default_rng(6)
    o, d = rng.uniform(-3, 3, (4000, 3)), rng.normal(size=(4000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o, d = o.astype(np.float32), d.astype(np.float32)
    hit, behind = met_first(world.blockers, o, d)
    far = 100.0
    t, margin = world.meet(o.astype(float), o.astype(float) + far * d.astype(float))
    sure = (np.abs(margin) > NEAR).all(1)
    assert sure.mean() > 0.97
    t = np.where(margin > 0, t, np.inf)
    nearest = t.argmin(1)
    met = np.isfinite(t.min(1))
    ordered = np.sort(t, axis=1)
    sure &= ~met | (ordered[:, 1] > ordered[:, 0] + 1e-6)
    assert 0.1 < met.mean() < 0.9
    np.testing.assert_array_equal(hit[sure], np.where(met, nearest, -1)[sure])
    slope = np.einsum("nd,nd->n", d, world.normal[nearest])
    np.testing.assert_array_equal(behind[sure], (met & (slope > 0))[sure])


def test_rays_from_a_wall_do_not_meet_it():
    world = single(WALL)
    for x in (0.0, 5e-7):
        hit, _ = met_first(world.blockers, np.array([[x, 0, 0]] * 2, np.float32), np.array([[1, 0, 0], [-1, 0, 0]], np.float32))
        assert hit.tolist() == [-1, -1]
    hit, behind = met_first(world.blockers, np.array([[1, 0, 0], [-1, 0, 0]], np.float32), np.array([[-1, 0, 0], [1, 0, 0]], np.float32))
    assert hit.tolist() == [0, 0]
    assert behind.tolist() == [False, True]
    hit, behind = met_first(world.blockers.take(np.zeros(0, int)), np.zeros((3, 3), np.float32), np.ones((3, 3), np.float32))
    assert hit.tolist() == [-1] * 3
    assert not behind.any()


def test_rays_in_a_closed_room_all_meet_a_front():
    regions = merge(scene_of([f @ rotation(9).T for f in box(high=(3, 4, 2))]))
    blockers = blockers_of(regions)
    rng = np.random.default_rng(0)
    region = rng.integers(0, 6, 5000)
    at = regions.world(region, rng.uniform(0.01, 0.99, (5000, 2)) * regions.size[region])
    local = hemisphere(5000)
    d = np.einsum("nk,nkd->nd", local, np.stack([regions.u, regions.v, regions.normal], 1)[region])
    hit, behind = met_first(blockers, at.astype(np.float32), d.astype(np.float32))
    assert (hit >= 0).all()
    assert not behind.any()
    assert (blockers.region[hit] != region).all()


@pytest.mark.parametrize("count", [8, 100, 4096])
def test_hemisphere_directions_are_cosine_distributed(count):
    d = hemisphere(count)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-12)
    assert d[:, 2].min() > 0
    assert d[:, 2].mean() == pytest.approx(2 / 3, abs=0.1 / count**0.5)
    assert (d[:, 2] ** 2).mean() == pytest.approx(1 / 2, abs=1e-9)
    assert d[:, :2].mean(0) == pytest.approx([0, 0], abs=0.6 / count**0.5)


# --------------------------------------------------------------------------------------------------- shafts


def random_bodies(seed, count, spread=2.0, aligned=False, points=False, size=0.5):
    rng = np.random.default_rng(seed)
    frame = np.stack([rotation(1000 * seed + k) for k in range(count)])
    if aligned:
        frame = np.eye(3)[np.stack([rng.permutation(3) for _ in range(count)])]
        frame[:, 2] = np.cross(frame[:, 0], frame[:, 1]) * rng.choice([-1, 1], (count, 1))
    half = rng.uniform(0.02, size, (count, 2)) * (0 if points else 1)
    centre = rng.uniform(-spread, spread, (count, 3))
    if aligned:
        centre = np.round(centre * 4) / 4
    arrays = centre, half[:, :1] * frame[:, 0], half[:, 1:] * frame[:, 1], frame[:, 2]
    return Bodies(*(x.astype(np.float32) for x in arrays))


def sampled(bodies, index, rng, count):
    """(n, count, 3) points of bodies, some of them at corners."""
    s, t = rng.uniform(-1, 1, (2, len(index), count, 1))
    corner = rng.random((len(index), count, 1)) < 0.3
    s, t = (np.where(corner, np.sign(x), x) for x in (s, t))
    flat = bodies.centre[index][:, None] + s * bodies.half_u[index][:, None] + t * bodies.half_v[index][:, None]
    if bodies.radius is None:
        return flat.astype(float)
    ball = rng.normal(size=(len(index), count, 3))
    ball /= np.linalg.norm(ball, axis=2, keepdims=True)
    return flat + bodies.radius[index, None, None] * ball


@pytest.mark.parametrize("kind", ["patches", "points and patches", "aligned", "balls and patches"])
@pytest.mark.parametrize("blockers", [1, 30, 64, 130])
def test_no_blocker_of_a_shaft_is_lost(kind, blockers):
    aligned = kind == "aligned"
    world = random_world(blockers, blockers, size=0.8 if blockers > 1 else 3.0, spread=2.0 if blockers > 1 else 0.3, aligned=aligned)
    bodies = random_bodies(7, 60, aligned=aligned)
    if kind == "points and patches":
        points = random_bodies(8, 30, points=True)
        bodies = points.joined(bodies.take(np.arange(30)))
    rng = np.random.default_rng(9)
    a, b = rng.integers(0, 60, (2, 800))
    if kind == "balls and patches":
        # A ball faces all ways, a widened patch its own; light between two balls is no case.
        balls = random_bodies(8, 30, points=True)
        radius = rng.uniform(0.1, 0.4, 30).astype(np.float32)
        bodies = Bodies(balls.centre, balls.half_u, balls.half_v, np.zeros_like(balls.normal), radius).joined(bodies.take(np.arange(30)))
        a %= 30
        b = 30 + b % 30
    shafts = Shafts(bodies, ShaftIndex(world.blockers))
    pair, blocker = shafts.candidates(a, b)
    assert (np.diff(pair) >= 0).all()
    listed = np.zeros((800, blockers), bool)
    listed[pair, blocker] = True
    assert listed.sum() == len(pair)
    p, q = (sampled(bodies, k, rng, 40) for k in (a, b))
    normal = bodies.normal.astype(float)
    # Light leaves the front of either body: segments that start behind one of them carry none.
    forth = (np.einsum("nsd,nd->ns", q - p, normal[a]) > 1e-5) | ~normal[a].any(1)[:, None]
    back = np.einsum("nsd,nd->ns", p - q, normal[b]) > 1e-5
    n, s = np.nonzero(forth & back)
    _, margin = world.meet(p[n, s], q[n, s])
    row, k = np.nonzero(margin > 2e-5)
    needed = np.zeros((800, blockers), bool)
    needed[n[row], k] = True
    assert needed.sum() > 2 * blockers
    assert not (needed & ~listed).any()
    # And most that are needless are left out.
    assert listed.sum() < 0.5 * listed.size


def test_shafts_of_a_room_are_empty():
    # Nothing stands between the walls of an empty room, nor within a wall.
    regions = merge(scene_of([f @ rotation(3).T for f in box(high=(4, 3, 2.5))]))
    half = 0.5 * regions.size
    centre = regions.world(np.arange(6), half)
    bodies = Bodies(*(x.astype(np.float32) for x in (centre, half[:, :1] * regions.u, half[:, 1:] * regions.v, regions.normal)))
    shafts = Shafts(bodies, ShaftIndex(blockers_of(regions)))
    a, b = (x.ravel() for x in np.meshgrid(np.arange(6), np.arange(6)))
    assert len(shafts.candidates(a, b)[0]) == 0


def test_a_blocker_between_two_patches_is_found_and_others_are_not():
    facing = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((0, 0, 2), (0, 1, 0), (1, 0, 0))
    middle = rectangle((0.4, 0.4, 1), (0.2, 0, 0), (0, 0.2, 0))
    others = [middle + x for x in ([2, 0, 0], [0, 0, 2], [0, 0, -2], [0, -3, 0], [0.9, 0.9, 0])]
    quads = np.array([middle, *others])
    world = World(quads[:, 0], quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0], np.zeros(len(quads), bool))
    centre = np.array([f.mean(0) for f in facing])
    half_u, half_v = (np.array([0.5 * (f[k] - f[0]) for f in facing]) for k in (1, 3))
    bodies = Bodies(*(x.astype(np.float32) for x in (centre, half_u, half_v, np.array([[0, 0, 1.0], [0, 0, -1]]))))
    index = ShaftIndex(world.blockers)
    pair, blocker = Shafts(bodies, index).candidates(np.array([0, 1]), np.array([1, 0]))
    assert (pair.tolist(), blocker.tolist()) == ([0, 1], [0, 0])
    # The same patches turned away from each other exchange nothing, so nothing blocks them.
    away = Bodies(bodies.centre, bodies.half_u, bodies.half_v, -bodies.normal)
    assert len(Shafts(away, index).candidates(np.array([0]), np.array([1]))[0]) == 0


def test_a_short_table_keeps_every_candidate(monkeypatch):
    world, bodies = random_world(3, 60), random_bodies(4, 40)
    a, b = np.triu_indices(40, 1)
    exact = set(zip(*Shafts(bodies, ShaftIndex(world.blockers)).candidates(a, b), strict=True))
    monkeypatch.setattr(ShaftIndex, "ROWS", 7)
    rough = set(zip(*Shafts(bodies, ShaftIndex(world.blockers)).candidates(a, b), strict=True))
    assert exact <= rough
    assert 0 < len(exact) < len(rough) < 60 * len(a)


def test_no_blockers_and_no_pairs():
    none = random_world(0, 3).blockers.take(np.zeros(0, int))
    bodies = random_bodies(1, 4)
    shafts = Shafts(bodies, ShaftIndex(none))
    assert len(shafts.candidates(np.array([0, 1]), np.array([2, 3]))[0]) == 0
    shafts = Shafts(bodies, ShaftIndex(random_world(0, 3).blockers))
    nobody = np.zeros(0, int)
    assert [len(x) for x in shafts.candidates(nobody, nobody)] == [0, 0]
