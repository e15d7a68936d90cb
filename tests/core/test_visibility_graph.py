"""The cluster visibility graph: it never lacks a pair that a line of sight joins, and lacks most of the others."""

from pathlib import Path

import numpy as np
import pytest
from enfilade.core import visibility_graph
from enfilade.core.clustering import cells, cluster_items, cluster_items_of
from enfilade.core.scene import Portals, no_portals
from enfilade.core.scene_files import load_scene
from enfilade.core.stage_files import load_stage, save_stage
from enfilade.core.visibility_graph import VisibilityGraph, build
from portal_worlds import WORLDS, box_clusters, world_of

DATA = Path(__file__).resolve().parents[1] / "data"
SIGNS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def portals_of(polygons, rooms):
    start = np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64)
    vertices = np.concatenate(polygons).astype(float) if polygons else np.zeros((0, 3))
    return Portals(vertices, start, np.array(rooms, np.int32).reshape(-1, 2))


def graph_of(low, high, room, polygons, portal_rooms, rooms, turn=None, shift=0.0):
    """The graph of boxes and portals, turned by a rotation and shifted: the boxes become those around the turned ones."""
    turn = np.eye(3) if turn is None else turn
    corners = np.where(SIGNS[:, None], high, low) @ turn.T + shift
    clusters = box_clusters(corners.min(axis=0), corners.max(axis=0), room, rooms)
    graph, findings = build(clusters, portals_of([np.asarray(p, float) @ turn.T + shift for p in polygons], portal_rooms), [""] * rooms)
    assert findings == ()
    return graph


def rotation(seed):
    if seed == 0:
        return np.eye(3)
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


def pairs(graph):
    """Set of pairs i < j that the graph holds; on the way it must be symmetric and reflexive."""
    matrix = np.unpackbits(graph.bits, axis=1, count=len(graph)).astype(bool)
    assert (matrix == matrix.T).all()
    assert matrix.diagonal().all()
    return set(zip(*np.nonzero(np.triu(matrix, 1)), strict=True))


def rectangle(axis, at, low, high):
    """Corners of a rectangle across ``axis``, its normal along +axis; ``low``, ``high`` on the other two axes in rising order."""
    u, v = (k for k in range(3) if k != axis)
    corners = np.zeros((4, 3))
    corners[:, axis] = at
    corners[:, u] = [low[0], high[0], high[0], low[0]]
    corners[:, v] = [low[1], low[1], high[1], high[1]]
    return corners[::-1] if axis == 1 else corners


# ------------------------------------------------------------------------------------------------ random worlds


class World:
    """A grid of rooms with rectangular openings in some of the walls, and boxes in the rooms."""

    def __init__(self, seed, shape, boxes=3, chance=0.8, span=(0.15, 0.9)):
        rng = np.random.default_rng(seed)
        self.cuts = [np.concatenate([[0.0], np.cumsum(rng.uniform(2.5, 5.0, n))]) for n in shape]
        self.rooms = int(np.prod(shape))
        index = np.arange(self.rooms).reshape(shape)
        self.openings, self.portals, self.portal_rooms = [], [], []
        for axis in range(3):
            for cell in np.ndindex(*shape):
                if cell[axis] + 1 == shape[axis] or rng.random() > chance:
                    continue
                u, v = (k for k in range(3) if k != axis)
                wall_low = np.array([self.cuts[u][cell[u]], self.cuts[v][cell[v]]])
                wall = np.array([self.cuts[u][cell[u] + 1], self.cuts[v][cell[v] + 1]]) - wall_low
                size = wall * rng.uniform(*span, 2)
                low = wall_low + rng.random(2) * (wall - size)
                at = self.cuts[axis][cell[axis] + 1]
                beyond = tuple(c + (k == axis) for k, c in enumerate(cell))
                self.openings.append((axis, at, low, low + size))
                polygon, ends = rectangle(axis, at, low, low + size), (index[cell], index[beyond])
                turned = rng.random() < 0.5  # portals that run the other way must do as well
                self.portals.append(polygon[::-1] if turned else polygon)
                self.portal_rooms.append(ends[::-1] if turned else ends)
        low, high, self.room = [], [], []
        for cell in np.ndindex(*shape):
            corner = np.array([self.cuts[k][c] for k, c in enumerate(cell)])
            extent = np.array([self.cuts[k][c + 1] for k, c in enumerate(cell)]) - corner
            for _ in range(boxes):
                size = extent * rng.uniform(0.0, 0.5, 3) * (rng.random(3) < 0.8)  # some are flat
                start = rng.random(3)
                start[rng.random(3) < 0.2] = 0.0  # some touch a wall or a portal
                low.append(corner + start * (extent - size))
                high.append(low[-1] + size)
                self.room.append(index[cell])
        self.low, self.high = np.array(low), np.array(high)

    def visible(self, rays, seed):
        """Pairs i < j of boxes joined by a segment that crosses every wall strictly inside an opening."""
        rng = np.random.default_rng(seed)
        source = rng.integers(len(self.low), size=rays)
        p = self.low[source] + rng.random((rays, 3)) * (self.high - self.low)[source]
        polygon = np.array(self.portals)[rng.integers(len(self.portals), size=rays)]
        s, t = rng.random((2, rays, 1))
        d = polygon[:, 0] + s * (polygon[:, 1] - polygon[:, 0]) + t * (polygon[:, 3] - polygon[:, 0]) - p
        free = np.full(rays, np.inf)  # where the ray ends
        with np.errstate(divide="ignore", invalid="ignore"):
            for axis in range(3):
                u, v = (k for k in range(3) if k != axis)
                for at in self.cuts[axis]:
                    way = (at - p[:, axis]) / d[:, axis]
                    x = p + way[:, None] * d
                    passes = np.zeros(rays, bool)
                    for opening_axis, opening_at, low, high in self.openings:
                        if (opening_axis, opening_at) == (axis, at):
                            passes |= (x[:, u] > low[0]) & (x[:, u] < high[0]) & (x[:, v] > low[1]) & (x[:, v] < high[1])
                    # A ray that starts on a wall (boxes touch the lower walls of their rooms) leaves the room backwards only,
                    # and one that slides along a wall goes nowhere.
                    outward = (way > 0) & np.isfinite(way) | (p[:, axis] == at) & (d[:, axis] < 0)
                    free = np.where(outward & ~passes, np.minimum(free, np.maximum(way, 0)), free)
                    free[(p[:, axis] == at) & (d[:, axis] == 0)] = 0
            a, b = ((bound - p[:, None]) / d[:, None] for bound in (self.low, self.high))
        enter, leave = np.fmin(a, b).max(axis=2), np.fmax(a, b).min(axis=2)
        ray, target = np.nonzero((enter <= leave) & (np.maximum(enter, 0) < free[:, None]) & (leave > 0))
        first, second = np.minimum(source[ray], target), np.maximum(source[ray], target)
        return {(i, j) for i, j in zip(first.tolist(), second.tolist(), strict=True) if i != j}


@pytest.mark.parametrize("turn", [0, 1, 2])
@pytest.mark.parametrize(
    ("seed", "shape", "span"),
    [
        (1, (5, 1, 1), (0.15, 0.9)),
        (2, (3, 3, 1), (0.15, 0.9)),
        (3, (3, 2, 2), (0.15, 0.9)),
        (4, (2, 2, 3), (0.5, 1.0)),
        (5, (4, 3, 1), (0.05, 0.15)),
        (6, (6, 2, 1), (0.9, 1.0)),
        (7, (3, 3, 2), (1.0, 1.0)),  # whole walls are open
    ],
)
def test_no_line_of_sight_is_missed(seed, shape, span, turn):
    world = World(seed, shape, span=span)
    graph = graph_of(world.low, world.high, world.room, world.portals, world.portal_rooms, world.rooms, rotation(turn), shift=100.0 * turn)
    visible = world.visible(30_000, seed)
    across = {pair for pair in visible if world.room[pair[0]] != world.room[pair[1]]}
    assert len(across) > 10
    assert not visible - pairs(graph)


def test_few_pairs_are_kept_without_need():
    kept = seen = 0
    for seed in range(10, 16):
        world = World(seed, (4, 3, 1), boxes=2, span=(0.15, 0.4))
        graph = graph_of(world.low, world.high, world.room, world.portals, world.portal_rooms, world.rooms)
        across = lambda found: sum(world.room[i] != world.room[j] for i, j in found)  # noqa: B023, E731
        kept += across(pairs(graph))
        seen += across(world.visible(100_000, seed))
    assert seen <= kept < 1.15 * seen


@pytest.mark.parametrize("turn", [0, 1, 2])
@pytest.mark.parametrize("case", WORLDS, ids=lambda case: case["title"])
def test_worlds_with_proven_pairs(case, turn):
    low, high, room, polygons, rooms = world_of(case)
    graph = graph_of(low, high, room, polygons, rooms, case["rooms"], rotation(turn))
    proven = {tuple(sorted(pair)) for pair in case["visible_pairs"]}
    assert not proven - pairs(graph)
    if turn == 0:
        assert len(pairs(graph)) <= 1.2 * len(proven)
        if case["exact"]:
            assert pairs(graph) == proven


# -------------------------------------------------------------------------------------------------- rows, by hand


def row(doors, boxes):
    """Rooms of 4 x 4 x 3 m along x with doors of 1 x 2 m; doors: y of their middles, boxes: (x, y, z) of 0.2 m cubes."""
    polygons = [rectangle(0, 4.0 * (i + 1), (y - 0.5, 0), (y + 0.5, 2)) for i, y in enumerate(doors)]
    ends = [(i, i + 1) for i in range(len(doors))]
    boxes = np.array(boxes, float)
    return graph_of(boxes - 0.1, boxes + 0.1, (boxes[:, 0] // 4).astype(int), polygons, ends, len(doors) + 1)


def test_doors_in_line_through_ten_rooms():
    graph = row([2.0] * 9, [(2, 2, 1), (38, 2, 1), (38, 3.5, 1), (2, 3.5, 1), (6, 3.5, 1)])
    assert graph.neighbours(0).tolist() == [0, 1, 3]  # along the line, and box 3 of its own room
    assert graph.neighbours(1).tolist() == [0, 1, 2]
    assert graph.neighbours(3).tolist() == [0, 3]  # beside the line: through one door at most
    assert graph.neighbours(4).tolist() == [4]  # from (2.1, 1.9) over the edge (4, 2.5) to y = 3.16 at most at x = 6.1


def test_a_door_out_of_line_hides_what_is_behind():
    assert row([0.5, 3.5], [(0.5, 0.5, 1), (9, 0.5, 1)]).neighbours(0).tolist() == [0]
    # From (0.6, 0.4) over the edge (4, 1) to y = 1 + 3.6 * 0.6 / 3.4 = 1.635 at x = 7.6.
    assert row([0.5], [(0.5, 0.5, 1), (7.5, 1.73, 1), (7.5, 1.74, 1)]).neighbours(0).tolist() == [0, 1]


def test_limits_of_the_view_are_exact():
    """A cube before a door: the half-angle of the view is known to the millimetre."""
    # Corner (1.1, 1.9) over the door's edge (4, 2.5): at x = 6.9 (near face of the target) y = 1.9 + 0.6 * 5.8 / 2.9 = 3.1.
    for y, sees in ((3.199, True), (3.201, False)):
        graph = row([2.0], [(1, 2, 1), (6.8, y, 1)])
        assert graph.sees(0, 1) == sees


def test_islands_outside_and_portals_without_area():
    box = np.array([[1, 1, 1], [5, 1, 1]], float)
    door = rectangle(0, 4.0, (0, 0), (2, 2))
    sliver = rectangle(0, 4.0, (1, 0), (1, 2))
    args = (box, box + 0.5, [0, 1])
    assert graph_of(*args, [], [], 2).neighbours(0).tolist() == [0]
    assert graph_of(*args, [door, door], [(0, -1), (-1, 1)], 2).neighbours(0).tolist() == [0]
    assert graph_of(*args, [sliver], [(0, 1)], 2).neighbours(0).tolist() == [0]
    assert graph_of(*args, [door], [(0, 1)], 2).neighbours(0).tolist() == [0, 1]


def test_a_box_through_the_portal_sees_all_of_the_next_room():
    door = rectangle(0, 4.0, (1, 0), (2, 2))
    through = ([3.5, 1.2, 0.5], [4.5, 1.8, 1])
    corners = [([4, 0, 0], [4.1, 0.1, 0.1]), ([4, 3.9, 2.9], [4.1, 4, 3]), ([7, 0, 2], [8, 1, 3])]
    low, high = (np.array(x, float) for x in zip(through, *corners, strict=True))
    assert graph_of(low, high, [0, 1, 1, 1], [door], [(0, 1)], 2).neighbours(0).tolist() == [0, 1, 2, 3]


def test_walls_in_the_plane_of_the_portal_do_not_see_through_it():
    door = rectangle(0, 4.0, (1, 0), (2, 2))
    low = np.array([[4, 2.5, 0], [4, 2.5, 0], [7, 2, 0], [0, 2, 0]], float)
    high = np.array([[4, 4, 3], [4, 4, 3], [8, 4, 3], [1, 4, 3]], float)
    graph = graph_of(low, high, [0, 1, 1, 0], [door], [(0, 1)], 2)
    assert not graph.sees(0, 2)
    assert not graph.sees(1, 3)
    assert graph.sees(2, 3)


def test_several_portals_and_cycles_unite():
    # Four rooms around a pillar: each sees the two beside it, and the opposite one by neither way.
    doors = [
        (rectangle(0, 4, (3, 0), (3.5, 2)), (0, 1)),
        (rectangle(1, 4, (4.5, 0), (5, 2)), (1, 3)),
        (rectangle(0, 4, (4.5, 0), (5, 2)), (2, 3)),
        (rectangle(1, 4, (3, 0), (3.5, 2)), (0, 2)),
    ]
    centre = np.array([[1, 1, 1], [7, 1, 1], [1, 7, 1], [7, 7, 1]], float)
    graph = graph_of(centre - 0.1, centre + 0.1, range(4), [d[0] for d in doors], [d[1] for d in doors], 4)
    # (1, 1) to (4, 3.2) goes on to (7, 5.4): into the wall of room 1, so only large boxes near the doors would be seen.
    assert graph.neighbours(0).tolist() == [0]
    two = [rectangle(0, 4, (0, 0), (0.5, 2)), rectangle(0, 4, (3.5, 0), (4, 2))]
    low = np.array([[1, 0.1, 1], [7, 0.1, 1], [7, 3.5, 1], [7, 1.8, 1]], float)
    graph = graph_of(low, low + 0.2, [0, 1, 1, 1], two, [(0, 1), (0, 1)], 2)
    assert graph.neighbours(0).tolist() == [0, 1]
    # From (1, 0.2) the second door at y = 3.5 to 4, x = 4 leads to y above 6.7 at x = 7: beyond the room.


def test_round_portals_are_framed_by_tangents():
    """A window of 200 corners keeps all lines through the disc and few more."""
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    disc = np.stack([np.full(200, 4.0), 2 + 0.5 * np.cos(angle), 1 + 0.5 * np.sin(angle)], axis=1)
    eye = np.array([3.0, 2, 1])
    for turn in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        for radius, expected in ((0.999, True), (1.08, False)):
            target = eye + np.array([2, radius * np.cos(turn), radius * np.sin(turn)])
            graph = graph_of(np.array([eye, target]), np.array([eye, target]), [0, 1], [disc], [(0, 1)], 2)
            assert graph.sees(0, 1) == expected


def test_chains_longer_than_the_longest_are_kept_and_told(monkeypatch):
    monkeypatch.setattr(visibility_graph, "MAX_PORTALS", 3)
    boxes = np.array([(2 + 4 * i, 2, 1) for i in range(8)], float)
    doors = portals_of([rectangle(0, 4.0 * (i + 1), (1.5, 0), (2.5, 2)) for i in range(7)], [(i, i + 1) for i in range(7)])
    graph, findings = build(box_clusters(boxes - 0.1, boxes + 0.1, range(8), 8), doors, [f"r{i}" for i in range(8)])
    assert len(pairs(graph)) == 28
    assert findings == (
        "a line of sight through more than 3 portals is not followed further, all that is connected counts as visible: r0 > r1 > r2 > r3",
    )


def test_large_and_small_blocks_give_the_same_graph(monkeypatch):
    world = World(21, (3, 3, 2), boxes=4)
    args = (world.low, world.high, world.room, world.portals, world.portal_rooms, world.rooms)
    whole = graph_of(*args)
    monkeypatch.setattr(visibility_graph, "_BLOCK", 7)
    monkeypatch.setattr(visibility_graph, "_BLOCK_BYTES", 500)
    pieces = graph_of(*args)
    np.testing.assert_array_equal(whole.bits, pieces.bits)
    for a, b in zip(whole.lists(), pieces.lists(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_mutual_pairs_of_a_large_graph():
    """More clusters than one block of the transposition holds."""
    rng = np.random.default_rng(0)
    matrix = rng.random((2100, 2100)) < 0.3
    bits = np.packbits(matrix, axis=1)
    visibility_graph._keep_mutual(bits, 2100)
    np.testing.assert_array_equal(np.unpackbits(bits, axis=1, count=2100).astype(bool), matrix & matrix.T)


def test_sets_are_weighed_listed_and_saved(tmp_path):
    door = rectangle(0, 4.0, (0, 0), (2, 2))
    low = np.array([[1, 0.5, 1], [6, 0.5, 1], [1, 9, 1]], float)
    clusters = box_clusters(low, low + 0.1, [0, 1, 2], 3, polygons=[5, 7, 11])
    graph, _ = build(clusters, portals_of([door], [(0, 1)]), ["a", "b", "c"])
    assert graph.pvs_polygons.tolist() == [12, 12, 11]
    start, members = graph.lists()
    assert (start.tolist(), members.tolist()) == ([0, 2, 4, 5], [0, 1, 0, 1, 2])
    np.testing.assert_array_equal(graph.sees([0, 0, 2], [1, 2, 2]), [True, False, True])
    save_stage(graph, tmp_path / "graph.npz")
    loaded = load_stage(VisibilityGraph, tmp_path / "graph.npz")
    np.testing.assert_array_equal(loaded.bits, graph.bits)
    np.testing.assert_array_equal(loaded.pvs_polygons, graph.pvs_polygons)


def test_no_clusters_and_no_portals():
    graph, findings = build(box_clusters([], [], [], 0), no_portals(), [])
    assert (len(graph), findings) == (0, ())
    assert graph.lists()[0].tolist() == [0]


# ------------------------------------------------------------------------------------------------ a real building


def walk_rays(scene, rays, seed):
    """Pairs (polygon, polygon) met by rays that start on a polygon and go from room to room through portals.

    Walls stop a ray, furniture and lamps do not, so every pair is one that walls do not hide.
    """
    rng = np.random.default_rng(seed)
    corners = [scene.vertices[scene.corner_vertex[scene.loop_start[p] : scene.loop_start[p + 1]]] for p in range(scene.polygon_count)]
    polygons = corners + [scene.portals.polygon(k) for k in range(len(scene.portals))]
    normals = np.array([np.cross(c - c[0], np.roll(c, -1, axis=0) - c[0]).sum(axis=0) for c in polygons])
    area = np.linalg.norm(normals, axis=1)
    normals /= area[:, None]
    solid = np.array([not scene.object_names[o].startswith(("furniture", "emitter")) for o in scene.object])
    source = rng.choice(scene.polygon_count, rays, p=area[: scene.polygon_count] / area[: scene.polygon_count].sum())
    weights = rng.random((rays, max(map(len, polygons))))
    p = np.zeros((rays, 3))
    for k in np.unique(source):
        w = weights[source == k][:, : len(corners[k])] ** 4  # towards the corners, where the long views begin
        p[source == k] = w / w.sum(axis=1, keepdims=True) @ corners[k]
    d = rng.normal(size=(rays, 3))
    d *= np.sign(np.einsum("ij,ij->i", d, normals[source]))[:, None]
    p += 1e-6 * normals[source]
    room, from_t, alive, found = scene.room[source].copy(), np.zeros(rays), np.ones(rays, bool), []
    for _ in range(12):
        wall_t, portal_t, portal = np.full(rays, np.inf), np.full(rays, np.inf), np.full(rays, -1)
        hits = []
        for r in range(scene.room_count):
            at = np.flatnonzero(alive & (room == r))
            here = np.flatnonzero(scene.room == r)
            gates = np.flatnonzero((scene.portals.rooms == r).any(axis=1))
            for k in np.concatenate([here, scene.polygon_count + gates]):
                c, n = polygons[k], normals[k]
                with np.errstate(divide="ignore", invalid="ignore"):
                    t = (c[0] - p[at]) @ n / (d[at] @ n)
                x = p[at] + t[:, None] * d[at]
                inside = np.isfinite(t) & (t > from_t[at] + 1e-9)
                for a, b in zip(c, np.roll(c, -1, axis=0), strict=True):
                    inside &= (x - a) @ np.cross(n, b - a) >= 0
                ray = at[inside]
                if k < scene.polygon_count:
                    hits.append((ray, np.full(len(ray), k), t[inside]))
                    if solid[k]:
                        wall_t[ray] = np.minimum(wall_t[ray], t[inside])
                else:
                    nearer = t[inside] < portal_t[ray]
                    portal_t[ray[nearer]], portal[ray[nearer]] = t[inside][nearer], k - scene.polygon_count
        ray, polygon, t = (np.concatenate(column) for column in zip(*hits, strict=True))
        met = t <= np.minimum(wall_t, portal_t)[ray] + 1e-9
        found.append(np.stack([source[ray[met]], polygon[met]], axis=1))
        alive &= portal_t < wall_t - 1e-6
        ends = scene.portals.rooms[portal]
        room = np.where(alive, ends.sum(axis=1) - room, room)
        alive &= room >= 0
        from_t = np.where(alive, portal_t, from_t)
    return np.concatenate(found)


@pytest.mark.parametrize("average", [1, 20])
def test_no_ray_through_a_house_is_missed(average):
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=average, rng=np.random.default_rng(0))
    graph, findings = build(clusters, scene.portals, scene.room_names)
    assert findings == ()
    met = clusters.cluster_of[walk_rays(scene, 20_000, 1)]
    assert (clusters.room[met[:, 0]] != clusters.room[met[:, 1]]).sum() > 1000
    assert graph.sees(met[:, 0], met[:, 1]).all()


def test_cells_see_no_less_than_their_clusters():
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=10, rng=np.random.default_rng(0))
    rooms = cells(items, scene.room_count)
    fine, coarse = (build(c, scene.portals, scene.room_names)[0] for c in (clusters, rooms))
    a, b = np.nonzero(np.unpackbits(fine.bits, axis=1, count=len(fine)))
    assert coarse.sees(clusters.room[a], clusters.room[b]).all()
    assert (fine.pvs_polygons <= coarse.pvs_polygons[clusters.room]).all()
    assert fine.pvs_polygons.mean() < coarse.pvs_polygons.mean()
