"""The large buildings: exact counts, closed and lit rooms, portals that join what they say, furniture that stands free."""

import numpy as np
import pytest
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene, save_scene
from enfilade.sample_scenes import labyrinth, octogon, test_scene
from enfilade.sample_scenes.filling import share

MAKERS = {"test_scene": test_scene.scene, "labyrinth": labyrinth.scene, "octogon": octogon.scene}
COUNTS = {"test_scene": (648, 58_608), "labyrinth": (182, 146_266), "octogon": (28, 277_942)}
SHELL = ("floor", "ceiling", "wall", "frame")


@pytest.fixture(scope="module", params=MAKERS)
def whole(request):
    return request.param, MAKERS[request.param]()


@pytest.fixture(scope="module", params=MAKERS)
def small(request):
    return MAKERS[request.param](1 / 27)


def quads(scene):
    """(P, 4, 3) corners; the last of a triangle is repeated."""
    start, last = scene.loop_start[:-1], scene.loop_start[1:] - 1
    return scene.vertices[scene.corner_vertex[np.minimum(start[:, None] + np.arange(4), last[:, None])]]


def area_vectors(corners):
    return 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])


def bounds(scene):
    """(n, 4, 3) shells of all rooms and (n,) their rooms; portals, as they are seen from both their rooms, in fans."""
    of_shell = np.array([name.startswith(SHELL) for name in scene.object_names])[scene.object]
    corners, room = [quads(scene)[of_shell]], [scene.room[of_shell]]
    for k, (a, b) in enumerate(scene.portals.rooms):
        p = scene.portals.polygon(k)
        fan = np.array([[p[0], p[i], p[i + 1], p[i + 2]] for i in range(1, len(p) - 1, 2)])
        corners += [fan, fan[:, ::-1]]
        room += [np.full(len(fan), b), np.full(len(fan), a)]
    return np.concatenate(corners), np.concatenate(room)


def test_the_counts_of_the_paper(whole):
    name, scene = whole
    assert (scene.room_count, scene.polygon_count) == COUNTS[name]
    assert check(scene)[1] == ()
    if name == "octogon":
        assert (np.bincount(scene.room) > 60_000).sum() == 2


def test_rooms_are_closed_and_stand_apart(whole):
    """Area vectors of a closed surface cancel, and its flux of x/3 is a volume: of convex rooms, with doorways between, all of it."""
    _, scene = whole
    corners, room = bounds(scene)
    vectors = area_vectors(corners)
    for axis in range(3):
        assert np.abs(np.bincount(room, vectors[:, axis])).max() < 1e-9
    fans = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    volume = -np.bincount(np.tile(room, 2), np.linalg.det(fans) / 6)
    walls = np.array([name.startswith("wall") for name in scene.object_names])[scene.object]
    high, low = (np.full(scene.room_count, sign * np.inf) for sign in (-1, 1))
    points = quads(scene)[walls]
    np.maximum.at(high, scene.room[walls], points[..., 2].max(axis=1))
    np.minimum.at(low, scene.room[walls], points[..., 2].min(axis=1))
    outline = [points[scene.room[walls] == r].reshape(-1, 3)[:, :2] for r in range(scene.room_count)]
    prism = (high - low) * [hull_area(o) for o in outline]
    assert (volume > prism - 1e-6).all()
    assert (volume < 1.02 * prism + 4).all()


def hull_area(points):
    """Area of the convex hull of points (n, 2) by its widest sides: Andrew's monotone chain."""
    points = np.unique(np.round(points, 6), axis=0)
    hull = []
    for chain in (points, points[::-1]):
        side = []
        for p in chain:
            while len(side) > 1 and np.linalg.det([side[-1] - side[-2], p - side[-2]]) <= 0:
                side.pop()
            side.append(p)
        hull += side[:-1]
    x, y = np.array(hull).T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_no_ray_leaves_a_room_but_through_portals(whole):
    """From the middle of each room every ray meets the front of its shell or a portal."""
    _, scene = whole
    corners, room = bounds(scene)
    direction = np.random.default_rng(3).normal(size=(64, 3))
    for r in range(scene.room_count):
        here = corners[room == r]
        triangles = np.concatenate([here[:, [0, 1, 2]], here[:, [0, 2, 3]]])
        floor = here.reshape(-1, 3)
        middle = 0.5 * (floor.min(axis=0) + floor.max(axis=0)) + (0.013, 0.017, 0.011)
        a, e, f = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        h = np.cross(direction[:, None], f)
        det = (h * e).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (h * (middle - a)).sum(-1) / det
            q = np.cross(middle - a, e)
            v = (direction @ q.T) / det
            t = (f * q).sum(-1) / det
        t[~((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0))] = np.inf
        first = t.argmin(axis=1)
        assert np.isfinite(t.min(axis=1)).all(), scene.room_names[r]
        assert (det[np.arange(64), first] > 0).all(), scene.room_names[r]


def test_portals_part_their_rooms(whole):
    """All of the first room lies behind the portal, all of the second in front, and both have corners at its corners."""
    _, scene = whole
    corners = quads(scene)
    order = np.argsort(scene.room, kind="stable")
    start = np.searchsorted(scene.room[order], np.arange(scene.room_count + 1))
    for k, (a, b) in enumerate(scene.portals.rooms):
        portal = scene.portals.polygon(k)
        normal = np.cross(portal[1] - portal[0], portal[2] - portal[0])
        normal /= np.linalg.norm(normal)
        for room, sign in ((a, -1), (b, 1)):
            points = corners[order[start[room] : start[room + 1]]].reshape(-1, 3)
            height = sign * ((points - portal[0]) @ normal)
            assert height.min() > -1e-9, scene.portals.names[k]
            near = points[height < 1e-9]
            assert (np.linalg.norm(near[:, None] - portal, axis=2).min(axis=0) < 1e-9).all(), scene.portals.names[k]


def test_every_room_can_be_reached(whole):
    _, scene = whole
    reached = np.arange(scene.room_count) == 0
    for _ in range(scene.room_count):
        pairs = scene.portals.rooms[reached[scene.portals.rooms].any(axis=1)]
        if reached[pairs].all():
            break
        reached[pairs] = True
    assert reached.all()


def test_some_rooms_have_lamps_and_some_have_none(whole):
    _, scene = whole
    lit = np.unique(scene.room[scene.emission.any(axis=1)])
    assert 0 in lit
    assert 0.02 < 1 - len(lit) / scene.room_count < 0.25


def test_furniture_stays_in_its_room(whole):
    _, scene = whole
    corners, room = bounds(scene)
    low, high = np.full((scene.room_count, 3), np.inf), np.full((scene.room_count, 3), -np.inf)
    np.minimum.at(low, room, corners.min(axis=1))
    np.maximum.at(high, room, corners.max(axis=1))
    thing = quads(scene)
    assert (thing.min(axis=1) >= low[scene.room] - 1e-9).all()
    assert (thing.max(axis=1) <= high[scene.room] + 1e-9).all()


def test_no_face_lies_on_another(small):
    """Coplanar faces of one room, seen from either side, never share more than an edge."""
    corners = quads(small)
    normal = area_vectors(corners)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    leading = np.take_along_axis(normal, np.argmax(np.abs(normal) > 1e-6, axis=1)[:, None], axis=1)
    offset = np.einsum("ij,ij->i", normal * np.sign(leading), corners[:, 0]) + 1e3 * small.room
    # Faces of one room whose planes are equally far from the origin, each pair once.
    order = np.argsort(offset, kind="stable")
    reach = np.searchsorted(offset[order], offset[order] + 1e-6, side="right") - np.arange(len(order)) - 1
    first = np.repeat(np.arange(len(order)), reach)
    after = np.arange(len(first)) - np.repeat(np.cumsum(reach) - reach, reach)
    a, b = order[first], order[first + 1 + after]
    low, high = corners.min(axis=1) - 1e-6, corners.max(axis=1) + 1e-6
    near = (np.abs(np.einsum("ij,ij->i", normal[a], normal[b])) > 1 - 1e-9) & (low[a] <= high[b]).all(1) & (high[a] >= low[b]).all(1)
    a, b = a[near], b[near]
    assert len(a) > 100  # neighbours that share an edge
    wrong = overlap(corners[a], corners[b], normal[a])
    assert not wrong.any(), [small.object_names[small.object[p[wrong][0]]] for p in (a, b)]


def overlap(a, b, normal):
    """(n,) bool: convex polygons (n, 4, 3) of one plane share an area; no edge of either parts them."""
    apart = np.zeros(len(a), bool)
    for polygon in (a, b):
        for edge in np.roll(polygon, -1, axis=1).swapaxes(0, 1) - polygon.swapaxes(0, 1):
            across = np.cross(edge, normal)
            across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
            first, second = (np.einsum("nij,nj->ni", p, across) for p in (a, b))
            shared = np.minimum(first.max(1), second.max(1)) - np.maximum(first.min(1), second.min(1))
            apart |= (shared < 1e-6) & (np.abs(edge) > 1e-9).any(axis=1)
    return ~apart


def test_overlap_tells_a_shared_edge_from_a_shared_area():
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    up = np.array([[0.0, 0, 1]])
    assert overlap(square, square + [0.5, 0.5, 0], up)
    assert overlap(square, square, up)
    assert not overlap(square, square + [1, 0, 0], up)


@pytest.mark.parametrize("name", MAKERS)
def test_smaller_siblings(name):
    rooms, polygons = COUNTS[name]
    for scale in (1 / 27, 1 / 8, 1 / 2):
        scene = MAKERS[name](scale)
        assert (scene.room_count, scene.polygon_count) == (round(rooms * scale), round(polygons * scale))


def test_the_seed_decides(small):
    maker = next(m for m in MAKERS.values() if m(1 / 27).name == small.name)
    again, other = maker(1 / 27), maker(1 / 27, seed=2)
    assert np.array_equal(small.vertices, again.vertices)
    assert np.array_equal(small.corner_vertex, again.corner_vertex)
    assert len(other.vertices) != len(small.vertices) or not np.array_equal(small.vertices, other.vertices)


def test_files_hold_the_scene(small, tmp_path):
    save_scene(small, tmp_path / "building.npz")
    loaded = load_scene(tmp_path / "building.npz")
    assert np.array_equal(loaded.vertices, small.vertices)
    assert np.array_equal(loaded.portals.vertices, small.portals.vertices)
    assert loaded.object_names == small.object_names


def test_shares_are_exact_and_no_less_than_the_least():
    least = np.array([5, 7, 11])
    shares = share(100, least, np.array([1.0, 2.0, 4.0]))
    assert shares.sum() == 100
    assert (shares >= least).all()
    assert np.abs(shares - least - 77 * np.array([1, 2, 4]) / 7).max() < 1
    with pytest.raises(ValueError, match="too few"):
        share(22, least, np.ones(3))
