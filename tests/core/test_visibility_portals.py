"""Portals of every kind: bent, lying, oblique, in one plane, framed as in the paper; and the sight of one cluster."""

from pathlib import Path

import numpy as np
import pytest
from enfilade.core.clustering import cells, cluster_items, cluster_items_of
from enfilade.core.options import Options
from enfilade.core.portal_world import PortalWorld
from enfilade.core.scene import Portals
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene, save_scene
from enfilade.core.sight import sight
from enfilade.core.stage_files import load_stage, save_stage
from enfilade.core.visibility_graph import VisibilityGraph, build, build_as_chosen
from enfilade.docs import sightlines
from portal_worlds import WORLDS, box_clusters, world_of
from scenery import box, portals_of, rectangle, rotation, scene_of

DATA = Path(__file__).resolve().parents[1] / "data"


def graph_of(clusters, portals, volumes="windows"):
    graph, findings = build(clusters, portals, [""] * (int(clusters.room.max()) + 1), volumes)
    assert findings == ()
    return graph


def pairs(graph):
    return np.unpackbits(graph.bits, axis=1, count=len(graph)).astype(bool)


def outline(opening):
    """Triangles that span a closed outline, and its corners."""
    middle = np.mean(opening, axis=0)
    return [np.array([middle, a, b]) for a, b in zip(opening, np.roll(opening, -1, axis=0), strict=True)]


def passes(p, q, triangle):
    """(n,) bool: segments p-q (n, 3) cross a triangle."""
    volume = lambda a, b, c, d: np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)  # noqa: E731
    a, b, c = (np.broadcast_to(x, p.shape) for x in triangle)
    sides = np.stack([volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)])
    ends = volume(a, b, c, p) * volume(a, b, c, q) < 0
    return ends & ((sides > 0).all(axis=0) | (sides < 0).all(axis=0))


# ------------------------------------------------------------------------------------------------ kinds of portals


@pytest.mark.parametrize("volumes", ["windows", "boxes"])
@pytest.mark.parametrize("seed", range(6))
def test_no_line_through_a_bent_portal_is_missed(seed, volumes):
    """Boxes before, behind and beside a crooked opening; ``check`` says how deep it is."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 7))
    turn = rotation(seed)
    opening = np.stack([rng.uniform(-0.6, 0.6, 7), np.cos(angle), np.sin(angle)], axis=1) @ turn.T
    low = np.concatenate([rng.uniform((-4, -3, -3), (-0.8, 3, 3), (40, 3)), rng.uniform((0.8, -3, -3), (4, 3, 3), (40, 3))])
    corners = np.stack([low, low + rng.uniform(0, 0.4, (80, 3))], axis=1) @ turn.T
    low, high = corners.min(axis=1), corners.max(axis=1)
    room = np.repeat([0, 1], 40)
    scene = scene_of(
        [rectangle(p, (0.01, 0, 0), (0, 0.01, 0)) for p in low], room=room, emission=1.0, portals=portals_of([opening], [(0, 1)])
    )
    checked, findings = check(scene)
    assert "portal_hull" in [finding.kind for finding in findings]
    assert checked.portals.depth[0] > 0.05
    graph = graph_of(box_clusters(low, high, room), checked.portals, volumes)
    a, b = rng.integers(0, 40, 40_000), rng.integers(40, 80, 40_000)
    p, q = (low[k] + rng.random((len(k), 3)) * (high - low)[k] for k in (a, b))
    seen = np.zeros(len(a), bool)
    for triangle in outline(opening):
        seen |= passes(p, q, triangle)
    assert seen.sum() > 100
    assert graph.sees(a[seen], b[seen]).all()
    assert not pairs(graph)[:40, 40:].all()  # and it is a test still


def test_the_depth_of_portals_is_saved(tmp_path):
    scene = scene_of(
        box(), portals=Portals(rectangle((1, 0, 0), (0, 1, 0), (0, 0, 1)), np.array([0, 4]), np.array([[0, -1]]), ("p",), np.array([0.25]))
    )
    save_scene(scene, tmp_path / "scene.npz")
    assert load_scene(tmp_path / "scene.npz").portals.depth.tolist() == [0.25]


@pytest.mark.parametrize("volumes", ["windows", "boxes"])
def test_a_stair_well_and_a_roof_light(volumes):
    # Rooms over one another, openings of 2 x 2 m: straight up through both, and 45 degrees at most through the first.
    wells = [rectangle((1, 1, z), (2, 0, 0), (0, 2, 0)) for z in (3.0, 6.0)]
    low = np.array([(2, 2, 0), (2, 2, 7), (0.1, 2, 4), (2, 2, 5.9), (0.2, 2, 7)], float)
    graph = graph_of(box_clusters(low, low + 0.1, [0, 2, 1, 1, 2]), portals_of(wells, [(0, 1), (1, 2)]), volumes)
    assert graph.neighbours(0).tolist() == [0, 1, 3]
    assert graph.sees(1, 4)
    assert not graph.sees(0, 4)  # from 2.1 over the edge x = 1 at z = 3, at most to x = 1 at z = 6 again


def test_doors_of_one_wall_do_not_look_through_each_other():
    # Two rooms on one side of a corridor; walls, ceilings and floors reach the plane of their doors.
    doors = [rectangle((x, 4, 0), (0, 0, 2), (1, 0, 0)) for x in (1.0, 6.0)]
    low = np.array([(0, 0, 3), (0, 0, 0), (5, 0, 3), (5, 0, 0), (0, 6, 0)], float)
    high = np.array([(4, 4, 3), (0, 4, 3), (9, 4, 3), (9, 4, 0), (9, 6, 3)], float)
    for turn in (np.eye(3), rotation(2)):
        corners = np.stack([low, high], axis=1)
        if turn is not None and not np.allclose(turn, np.eye(3)):
            corners = np.stack([np.where([(s >> k) & 1 for k in range(3)], high, low) for s in range(8)], axis=1) @ turn.T
        clusters = box_clusters(corners.min(axis=1), corners.max(axis=1), [0, 0, 1, 1, 2])
        graph = graph_of(clusters, portals_of([d @ turn.T for d in doors], [(0, 2), (1, 2)]))
        if np.allclose(turn, np.eye(3)):
            assert not pairs(graph)[:2, 2:4].any()
        assert graph.sees(1, 4)
        assert graph.sees(3, 4)


def test_the_wall_around_a_door_is_known_by_its_items():
    """The box of a wall with a door holds the door; its pieces lie beside it."""
    door = rectangle((1, 4, 0), (0, 0, 2), (1, 0, 0))
    pieces = [
        rectangle((0, 4, 0), (1, 0, 0), (0, 0, 3)),
        rectangle((2, 4, 0), (2, 0, 0), (0, 0, 3)),
        rectangle((1, 4, 2), (1, 0, 0), (0, 0, 1)),
    ]
    leaf = rectangle((1.2, 4, 0), (0.6, 0, 0), (0, 0, 2))
    target = rectangle((0, 8, 0), (0, 0, 3), (4, 0, 0))
    for extra, sees in (([], False), ([leaf], True)):
        scene = scene_of([*pieces, *extra, target], room=[0] * (3 + len(extra)) + [1], portals=portals_of([door], [(0, 1)]))
        items = cluster_items_of(scene)
        clusters = cluster_items(items, 2, average=50, large_polygon=10.0, rng=np.random.default_rng(0))
        assert len(clusters) == 2
        assert build(clusters, scene.portals, ["", ""], items=items)[0].sees(0, 1) == sees
        assert build(clusters, scene.portals, ["", ""])[0].sees(0, 1)  # the boxes alone cannot tell


def test_upright_rectangles_are_their_own_frames_and_others_their_boxes():
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    door = rectangle((1, 0, 0), (0, 2, 0), (0, 0, 2)) @ turn.T
    triangle = np.array([(5, 0, 0), (5, 2, 0), (5, 1, 2)], float)
    slope = rectangle((8, 0, 0), (0, 2, 0), (1, 0, 2))
    world = PortalWorld(box_clusters([(0, 0, 0)], [(9, 3, 3)], [1]), portals_of([door, triangle, slope], [(0, 1)] * 3), 2, True, None)
    given = {k: d for d, k in enumerate(world.portal) if world.source[d] == 0}
    corners = world.window + world.middle
    same = np.linalg.norm(corners[given[0]][:, None] - door, axis=2).min(axis=0)
    np.testing.assert_allclose(same, 0, atol=1e-12)
    np.testing.assert_allclose([corners[given[1]].min(0), corners[given[1]].max(0)], [(5, 0, 0), (5, 2, 2)])
    assert world.depth[[given[0], given[1], given[2]]].tolist() == [0, 0, 0.5]
    np.testing.assert_allclose(np.abs(world.normal[given[2]]), (1, 0, 0))
    np.testing.assert_allclose([corners[given[2]].min(0), corners[given[2]].max(0)], [(8.5, 0, 0), (8.5, 2, 2)])


@pytest.mark.parametrize("case", WORLDS, ids=lambda case: case["title"])
def test_the_volumes_of_the_paper_miss_nothing(case):
    low, high, room, polygons, rooms = world_of(case)
    graph = graph_of(box_clusters(low, high, room), portals_of(polygons, rooms), "boxes")
    for i, j in case["visible_pairs"]:
        assert graph.sees(i, j)


# ------------------------------------------------------------------------------------------------ choices and figures


def test_cells_see_as_cells_where_they_shoot():
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=10, rng=np.random.default_rng(0))
    by_room, _ = build(cells(items, scene.room_count), scene.portals, scene.room_names, items=items)
    graph, _ = build_as_chosen(clusters, items, scene.portals, scene.room_names, Options(emitters="cells"))
    a, b = np.divmod(np.arange(len(clusters) ** 2), len(clusters))
    np.testing.assert_array_equal(graph.sees(a, b), by_room.sees(clusters.room[a], clusters.room[b]))
    np.testing.assert_array_equal(graph.pvs_polygons, by_room.pvs_polygons[clusters.room])
    framed, _ = build_as_chosen(clusters, items, scene.portals, scene.room_names, Options(volumes="boxes"))
    np.testing.assert_array_equal(framed.bits, build(clusters, scene.portals, scene.room_names, "boxes", items)[0].bits)


def test_degrees_count_the_others(tmp_path):
    rng = np.random.default_rng(1)
    matrix = rng.random((21, 21)) < 0.4
    matrix |= matrix.T | np.eye(21, dtype=bool)
    graph = VisibilityGraph(np.packbits(matrix, axis=1), np.zeros(21, np.int64))
    assert graph.degrees.tolist() == (matrix.sum(axis=1) - 1).tolist()
    save_stage(graph, tmp_path / "graph.npz")
    assert load_stage(VisibilityGraph, tmp_path / "graph.npz").degrees.tolist() == graph.degrees.tolist()


# ------------------------------------------------------------------------------------------------ the sight of one cluster


def enfilade(rooms):
    """Rooms of 4 x 4 x 3 m in a row, doors in line, a cube in the middle of each; and a way round from the first to the third."""
    doors = [rectangle((4.0 * (i + 1), 1.5, 0), (0, 1, 0), (0, 0, 2)) for i in range(rooms - 1)]
    low = np.array([(4.0 * i + 1.9, 1.9, 0.9) for i in range(rooms)])
    return box_clusters(low, low + 0.2, list(range(rooms))), portals_of(doors, [(i, i + 1) for i in range(rooms - 1)])


@pytest.mark.parametrize("volumes", ["windows", "boxes"])
def test_the_chain_of_portals_of_every_edge(volumes):
    clusters, portals = enfilade(10)
    graph = graph_of(clusters, portals, volumes)
    for start in (0, 4, 9):
        seen = sight(clusters, portals, 10, start, graph, volumes)
        assert seen.crossed.tolist() == [abs(c - start) for c in range(10)]
        for c in range(10):
            expected = range(start, c) if c > start else range(start - 1, c - 1, -1)
            assert seen.chain(c).tolist() == list(expected)


def test_the_shortest_chain_is_told_and_what_is_not_seen():
    # Rooms 0 - 1 - 2 in a row, and a long portal from 0 to 2 that passes beside room 1.
    clusters, portals = enfilade(3)
    wide = rectangle((6, -3, 0), (0, 3, 0), (0, 0, 3))
    low = np.concatenate([clusters.box_min, [(0.1, 3.8, 0.1), (11, -2.5, 1)]])
    more = box_clusters(low, low + 0.1, [0, 1, 2, 0, 2])
    both = portals_of([*(portals.polygon(k) for k in range(2)), wide], [(0, 1), (1, 2), (0, 2)])
    graph = graph_of(more, both)
    seen = sight(more, both, 3, 0, graph)
    assert seen.chain(4).tolist() == [2]
    assert seen.crossed.tolist() == [0, 1, 2, 0, 1]
    other = sight(more, both, 3, 3, graph)
    assert other.crossed[2] == -1
    assert other.chain(2).tolist() == []
    assert other.window_of[2] == -1


def test_every_edge_of_a_house_has_a_chain_from_room_to_room():
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=10, rng=np.random.default_rng(0))
    graph, _ = build(clusters, scene.portals, scene.room_names, items=items)
    longest = 0
    for start in range(0, len(clusters), 5):
        seen = sight(clusters, scene.portals, scene.room_count, start, graph, items=items)
        np.testing.assert_array_equal(seen.crossed >= 0, graph.sees(start, np.arange(len(clusters))))
        for c in np.flatnonzero(seen.crossed >= 0):
            room, chain = clusters.room[start], seen.chain(c)
            assert len(chain) == seen.crossed[c]
            longest = max(longest, len(chain))
            for k in chain:
                ends = scene.portals.rooms[k]
                assert room in ends
                room = ends.sum() - room
            assert room == clusters.room[c]
    assert longest >= 2


def test_the_volume_behind_a_door_is_the_known_pyramid():
    # A point-like cube 2 m before a door of 1 x 2 m: at 2 m behind it the view is 2 m wide, cut by the room of 4 x 4 x 3 m.
    low = np.array([(2, 2, 1), (4, 0, 0), (7.9, 3.9, 2.9)])
    clusters = box_clusters(low, low + [(1e-6,) * 3, (0.1,) * 3, (0.1,) * 3], [0, 1, 1])
    portals = portals_of([rectangle((4, 1.5, 0), (0, 1, 0), (0, 0, 2))], [(0, 1)])
    seen = sight(clusters, portals, 2, 0, graph_of(clusters, portals))
    assert len(seen.portal) == 1
    np.testing.assert_allclose(seen.polygon(0), portals.polygon(0), atol=1e-9)
    faces = seen.volume(0)
    assert all(len(face) >= 3 for face in faces)
    points = np.concatenate(faces)
    # y widens from 1.5..2.5 by 0.25 each metre, z from 0..2 by 0.5: up to 3 and down to 0, where the room ends.
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [(4, 0.5, 0), (8, 3.5, 3)], atol=1e-4)
    volume = sum(np.cross(f[i] - f[0], f[i + 1] - f[0]) @ f[0] for f in faces for i in range(1, len(f) - 1)) / 6
    # Its section is (1 + x/2) (2 + x/2) up to x = 2 m, then (1 + x/2) 3: 23/3 and 15 m3.
    assert volume == pytest.approx(23 / 3 + 15, rel=1e-4)


def test_clusters_that_are_seen_reach_into_their_volumes():
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=10, rng=np.random.default_rng(0))
    graph, _ = build(clusters, scene.portals, scene.room_names, items=items)
    start = int(graph.degrees.argmax())
    seen = sight(clusters, scene.portals, scene.room_count, start, graph, items=items)
    for c in np.flatnonzero(seen.crossed > 0):
        for w in seen.windows_to(c):
            window = seen.polygon(w)[None]
            assert (window @ seen.planes[w, :-1, :3].T <= seen.planes[w, :-1, 3] + 1e-4).all()  # the window is in its own volume
        planes = seen.planes[seen.window_of[c]]
        centre, half = 0.5 * (clusters.box_min[c] + clusters.box_max[c]), 0.5 * (clusters.box_max[c] - clusters.box_min[c])
        assert (planes[:, :3] @ centre - np.abs(planes[:, :3]) @ half <= planes[:, 3] + 1e-9).all()


# ------------------------------------------------------------------------------------------------ brute force


@pytest.mark.parametrize("volumes", ["windows", "boxes"])
@pytest.mark.parametrize("name", ["bench/two_rooms.npz", "bench/office.npz"])
def test_no_pair_that_rays_join_is_missed(name, volumes):
    scene = load_scene(DATA / name)
    items = cluster_items_of(scene)
    clusters = cluster_items(items, scene.room_count, average=20, rng=np.random.default_rng(0))
    graph, _ = build(clusters, scene.portals, scene.room_names, volumes, items)
    a, b = sightlines.pairs_met(scene, clusters.cluster_of, 5000, 3)
    assert len(a) > 20
    assert (clusters.room[a] != clusters.room[b]).all()
    assert graph.sees(a, b).all()
