"""Which pairs of surfaces are asked about at all: all that the graph allows and that face each other, each once, and none through a
wall without a door.
"""

import numpy as np
import pytest
from enfilade.core import sightlines
from enfilade.core.occlusion import Bodies
from enfilade.core.passages import Passages
from scenery import box, building_of, portals_of, rectangle, rotation, scene_of


def row_of_rooms(count=4, leave=(0.4, 0.6)):
    """Rooms of 1 m in a row along x with a door from each to the next, and a crate in every room."""
    low, high = leave
    polygons, room = [], []
    for k in range(count):
        frame = [f + [k, 0, 0] for f in box(leave_out=("x- " if k else "") + ("x+" if k < count - 1 else ""))]
        crate = [f + [k, 0, 0] for f in box((0.2, 0.7, 0), (0.4, 0.9, 0.3), inward=False, leave_out="z-")]
        polygons += frame + crate
        room += [k] * (len(frame) + len(crate))
        if k:  # the wall between two rooms, around the door, seen from both sides
            for side, flip in ((k - 1, True), (k, False)):
                parts = [rectangle((k, 0, 0), (0, low, 0), (0, 0, 1)), rectangle((k, high, 0), (0, 1 - high, 0), (0, 0, 1))]
                parts.append(rectangle((k, low, 0.8), (0, high - low, 0), (0, 0, 0.2)))
                polygons += [p[::-1] if flip else p for p in parts]
                room += [side] * 3
    doors = [rectangle((k, low, 0), (0, high - low, 0), (0, 0, 0.8)) for k in range(1, count)]
    return scene_of(polygons, room=room, portals=portals_of(doors, [(k - 1, k) for k in range(1, count)]))


def tiles_of(building):
    """Every tile with its pairs."""
    tiles = (tile for scope in sightlines.scopes(building) for tile in sightlines.tiles(building, scope))
    return [(tile, a, b) for tile in tiles for a, b in sightlines.pairs_of(building, tile)]


def some_before(building):
    """(G, C) bool: some corner of a region of the cluster lies in front of the plane of the region. All sides lie along the axes."""
    regions, clusters = building.regions, building.clusters
    corners = np.stack([regions.world(np.arange(len(regions)), regions.size * part) for part in ((0, 0), (0, 1), (1, 0), (1, 1))], 1)
    height = np.einsum("ik,jck->ijc", regions.normal, corners).max(2) - np.einsum("ik,ik->i", regions.normal, corners[:, 0])[:, None]
    of = clusters.cluster_of
    return np.stack([(height[:, of == k] > 1e-4).any(1) for k in range(len(clusters))], 1)


@pytest.mark.parametrize("cells", [1, 50, 1 << 17])
@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("average", [1, 4])
def test_every_pair_that_the_graph_allows_comes_once_but_those_behind_a_cluster(monkeypatch, cells, size, average):
    monkeypatch.setattr(sightlines, "CELLS", cells)
    monkeypatch.setattr(sightlines, "WITHIN", size)
    monkeypatch.setattr(sightlines, "BETWEEN", size)
    building = building_of(row_of_rooms(), average=average)
    found = np.concatenate([np.sort(np.stack([a, b], 1), 1) for _, a, b in tiles_of(building)])
    cluster = building.clusters.cluster_of
    i, j = np.triu_indices(len(building.regions), 1)
    before = some_before(building)
    mutual = before[i, cluster[j]] & before[j, cluster[i]]
    expected = np.stack([i, j], 1)[building.graph.sees(cluster[i], cluster[j]) & mutual]
    assert len(np.unique(found, axis=0)) == len(found)
    assert {tuple(p) for p in found.tolist()} == {tuple(p) for p in expected.tolist()}


@pytest.mark.parametrize("seed", [0, 1])
def test_every_pair_that_faces_each_other_comes_once(seed):
    rng = np.random.default_rng(seed)
    polygons = list(box(high=(6, 5, 3)))
    for _ in range(60):
        size, place, turn = rng.uniform(0.1, 0.6, 3), rng.uniform([1, 1, 0.8], [5, 4, 2.2]), rotation(int(rng.integers(100)))
        polygons += [place + face @ turn.T for face in box(high=size, inward=False)]
    building = building_of(scene_of(polygons, object=np.repeat(np.arange(61), 6).tolist()))
    regions = building.regions
    of = regions.polygon_region
    order = np.argsort(of[: len(polygons)])
    corners, normals = np.asarray(polygons, float)[order], regions.normal
    assert len(corners) == len(regions)
    found = []
    for _, a, b in tiles_of(building):
        found += [tuple(sorted(pair)) for pair in zip(a.tolist(), b.tolist(), strict=True)]
    assert len(found) == len(set(found))
    ahead = np.einsum("ik,jck->ijc", normals, corners).max(2) - np.einsum("ik,ik->i", normals, corners[:, 0])[:, None] > 1e-3
    i, j = np.nonzero(np.triu(ahead & ahead.T, 1))
    assert set(zip(i.tolist(), j.tolist(), strict=True)) <= set(found)
    # Where all of a cluster lies behind a face, its pairs with that face are not asked for at all.
    assert len(found) < 0.8 * len(regions) * (len(regions) - 1) / 2


def test_tiles_hold_all_blockers_between_their_pairs():
    building = building_of(row_of_rooms(), average=4)
    regions = building.regions
    for tile, a, b in tiles_of(building):
        ends = np.unique(np.concatenate([a, b]))
        low, high = regions.box_min[ends].min(0), regions.box_max[ends].max(0)
        rooms = np.unique(regions.room[ends])
        inside = (regions.box_min <= high).all(1) & (regions.box_max >= low).all(1) & np.isin(regions.room, rooms)
        assert set(np.flatnonzero(inside).tolist()) <= set(building.blockers_between(tile.nearby, low, high).region.tolist())


def test_what_lies_beside_the_doors_is_closed_and_what_lies_behind_them_is_open():
    building = building_of(row_of_rooms())
    centre = building.regions.centre
    #         beyond two doors in line  |  beside the door, in the corner  |  a neighbour through the door  |  in one room
    pairs = [((0.5, 0.5, 0.5), (2.5, 0.5, 0.5)), ((0.9, 0.05, 0.5), (1.1, 0.05, 0.5)), ((0.5, 0.3, 0.5), (1.5, 0.7, 0.5)),
             ((0.1, 0.1, 0.5), (0.9, 0.9, 0.5)), ((0.9, 0.9, 0.9), (3.5, 0.1, 0.1))]  # fmt: skip
    points = np.array([p for pair in pairs for p in pair]) - centre
    zero = np.zeros_like(points, np.float32)
    normal = np.repeat(np.array([[1.0, 0, 0], [-1, 0, 0]], np.float32)[None], len(pairs), 0).reshape(-1, 3)
    bodies = Bodies(points.astype(np.float32), zero, zero, normal)
    room = np.floor(points[:, 0] + centre[0]).astype(int)
    a = 2 * np.arange(len(pairs))
    for way in ((a, a + 1), (a + 1, a)):
        assert Passages(building.doors, room).open(bodies, room, *way).tolist() == [True, False, True, True, False]
    nobody = np.zeros(0, int)
    assert len(Passages(building.doors, room).open(bodies, room, nobody, nobody)) == 0


def test_rooms_without_portals_are_closed():
    rooms = [f + [3 * k, 0, 0] for k in range(2) for f in box()]
    building = building_of(scene_of(rooms, room=[0] * 6 + [1] * 6))
    zero = np.zeros((2, 3), np.float32)
    bodies = Bodies(np.array([[0.5, 0.5, 0.5], [3.5, 0.5, 0.5]], np.float32), zero, zero, np.array([[1, 0, 0], [-1, 0, 0]], np.float32))
    passages = Passages(building.doors, np.array([0, 1]))
    assert passages.open(bodies, np.array([0, 1]), np.array([0]), np.array([1])).tolist() == [False]
    assert passages.open(bodies, np.array([0, 0]), np.array([0]), np.array([1])).tolist() == [True]
