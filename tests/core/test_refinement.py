"""The oracle and its links: form factors, closure, reciprocity, and no light through walls."""

import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import links, pair_visibility, refinement
from enfilade.core.elements import Forest
from enfilade.core.links import LIMIT, LinkCollector, LinkSet, blocks, closing_gains, directions, joined, received
from enfilade.core.transport import lambert
from scenery import box, building_of, linked, portals_of, received_from, rectangle, region_means, rotation, scene_of, visible_form_factors

DATA = json.loads((Path(__file__).resolve().parents[1] / "data" / "form_factors.json").read_text(encoding="utf-8"))
OPPOSED, BESIDE = DATA["pairs"][0]["factor"], DATA["pairs"][3]["factor"]  # faces of a unit cube
orders = pytest.mark.parametrize("order", [1, 2, 3])


def factors(building, forest, linking):
    """(G, G) mean irradiance at region i from exitance 1 on region j."""
    count = len(building.regions)
    return np.stack([region_means(forest, received_from(forest, linking, [j])) for j in range(count)], 1)


def node_totals(forest, linking):
    """What the links give every node of every leaf from exitance 1 all around, and the node's weight."""
    everything = np.arange(len(forest.regions))
    leaf = np.flatnonzero(forest.leaf)
    light = forest.at_nodes(np.arange(len(forest)), received_from(forest, linking, everything)[..., None])[..., 0]
    return light[leaf], forest.node_weights[leaf]


def mean_form_factor(surface, polygon, count=24):
    """Mean over a rectangle of what its points receive from a polygon of exitance 1."""
    x, w = np.polynomial.legendre.leggauss(count)
    x, w = (x + 1) / 2, w / 2
    s, t = (z.ravel() for z in np.meshgrid(x, x))
    a, b = surface[1] - surface[0], surface[3] - surface[0]
    points = surface[0] + s[:, None] * a + t[:, None] * b
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    return np.outer(w, w).ravel() @ lambert(points, np.repeat(normal[None], len(points), 0), np.repeat(polygon[None], len(points), 0))


# -------------------------------------------------------------------------------------------- form factors


@orders
@pytest.mark.parametrize("turned", [False, True])
def test_links_between_the_faces_of_a_cube_add_up_to_their_form_factors(order, turned):
    turn = rotation(1) if turned else np.eye(3)
    building = building_of(scene_of([f @ turn.T + 3 for f in box()]))
    forest, linking = linked(building, order, exchange=5e-4)
    found = factors(building, forest, linking)
    of = building.regions.polygon_region
    found = found[np.ix_(of, of)]
    expected = np.full((6, 6), BESIDE)
    expected[np.arange(6), np.arange(6)] = 0
    expected[np.arange(6), np.arange(6) ^ 1] = OPPOSED
    np.testing.assert_allclose(found, expected, rtol=0.003)
    np.testing.assert_allclose(found, found.T, atol=1e-3)


@pytest.mark.parametrize("case", [c for c in DATA["pairs"] if "wedge" in c["name"]], ids=lambda case: case["name"])
def test_links_of_a_wedge(case):
    a, b = np.array(case["a"], float), np.array(case["b"], float)
    if np.cross(a[1] - a[0], a[3] - a[0]) @ (b.mean(0) - a[0]) < 0:
        a, b = a[::-1], b[::-1]
    building = building_of(scene_of([a, b], object=[0, 1]))
    forest, linking = linked(building, 2, exchange=5e-4, min_size=5e-3)
    of = building.regions.polygon_region
    found = factors(building, forest, linking)[np.ix_(of, of)]
    area = building.regions.area[of]
    assert found[1, 0] * area[1] / area[0] == pytest.approx(case["factor"], rel=0.01, abs=5e-4)
    assert found[0, 1] == pytest.approx(case["factor"], rel=0.01, abs=5e-4)


@pytest.mark.parametrize("order", [2, 3])
def test_every_point_of_a_closed_room_receives_from_all_sides(order):
    building = building_of(scene_of(box(high=(4, 3, 2.5))))
    error = []
    for exchange in (4e-3, 5e-4, 1e-4):
        forest, linking = linked(building, order, exchange, min_size=0.02)
        total, weight = node_totals(forest, linking)
        error.append(np.sqrt((weight * (total - 1) ** 2).sum() / weight.sum()))
    assert error[1] < 0.03
    assert error[2] < 0.01
    assert error[0] > error[1] > error[2]


@pytest.mark.parametrize("kept", [1.0, 0.98])
def test_the_gain_closes_rooms_that_are_closed_and_no_others(kept):
    building = building_of(scene_of(box(high=(4, 3, 2.5))))
    forest, linking = linked(building, 2, 5e-4)
    leaf = np.flatnonzero(forest.leaf)
    gains = closing_gains(forest, linking.links, np.full(len(forest), np.float32(kept)))
    # What is sent evenly arrives evenly, and all that is sent arrives.
    sent = forest.pull(np.where(forest.leaf[:, None, None], forest.from_nodes(np.arange(len(forest)), gains.sent[..., None]), 0))
    arrived = forest.at_nodes(leaf, received(forest, linking.links, sent)[leaf])[..., 0] * gains.received[leaf]
    np.testing.assert_allclose(arrived, kept, atol=1e-5)
    light = np.random.default_rng(0).uniform(0, 1, (len(leaf), forest.node_count, 1)).astype(np.float32)
    start = np.zeros((len(forest), forest.functions, 1), np.float32)
    start[leaf] = forest.from_nodes(leaf, light * gains.sent[leaf, :, None])
    arrived = forest.at_nodes(leaf, received(forest, linking.links, forest.pull(start))[leaf])[..., 0]
    weight = forest.node_weights[leaf]
    np.testing.assert_allclose((arrived * gains.received[leaf] * weight).sum(), kept * (light[..., 0] * weight).sum(), rtol=1e-4)
    raw = (forest.at_nodes(leaf, received(forest, linking.links, forest.pull(start))[leaf])[..., 0] * weight).sum()
    assert abs(raw / (light[..., 0] * weight).sum() / kept - 1) > 1e-3
    for gain in (gains.received, gains.sent):
        assert (gain[~forest.leaf] == 1).all()
    half = forest.region < 3
    for gain in vars(closing_gains(forest, linking.links, half.astype(np.float32))).values():
        assert (gain[~half] == 1).all()
        assert (gain[half & forest.leaf] != 1).any(1).all()


def test_a_gain_stays_below_what_would_let_light_grow():
    building = building_of(scene_of(box(high=(4, 3, 2.5))))
    forest, linking = linked(building, 2, 5e-4)
    few = [links.part(slice(None, None, 4)) for links in linking.links]
    gains = closing_gains(forest, few, np.ones(len(forest), np.float32))
    for gain in (gains.received, gains.sent):
        assert gain.max() <= LIMIT
        assert gain.min() >= np.float32(1 / LIMIT)
    assert gains.received.max() == LIMIT


# ------------------------------------------------------------------------------------------- the structure


@orders
def test_exchanges_are_reciprocal(order):
    # Power from region i to region j per exitance is the same number both ways.
    building = building_of(scene_of(box(high=(4, 3, 2.5))))
    forest, linking = linked(building, order, 1e-3, min_size=0.05)
    power = factors(building, forest, linking) * building.regions.area[:, None]
    assert power.max() > 0.5
    np.testing.assert_allclose(power, power.T, atol=2e-6 * power.max())


def test_links_stand_where_elements_face_each_other():
    building = building_of(scene_of(box(high=(2, 2, 2))))
    forest, linking = linked(building, 2, 1e-3)
    normal = building.regions.normal
    for group in linking.links:
        assert (forest.region[group.a] != forest.region[group.b]).all()
        assert (group.exchange >= 0).all()
        assert np.isfinite(group.exchange).all()
        d = forest.centroids(group.b) - forest.centroids(group.a)
        assert (np.einsum("nd,nd->n", d, normal[forest.region[group.a]]) > -1e-5).all()
        assert (np.einsum("nd,nd->n", -d, normal[forest.region[group.b]]) > -1e-5).all()


def test_each_pair_of_places_is_linked_once():
    # For random leaves of two regions exactly one link joins the one or an ancestor with the other or an ancestor.
    building = building_of(scene_of(box(high=(2, 3, 2))))
    forest, linking = linked(building, 2, 1e-3)
    pairs = np.concatenate([np.stack([g.a, g.b], 1) for g in linking.links])
    links = set()
    count: dict[tuple[int, int], int] = {}
    for a, b in np.sort(pairs, axis=1).tolist():
        links.add((a, b))
        count[a, b] = count.get((a, b), 0) + 1
    assert set(count.values()) == {1}
    rng = np.random.default_rng(0)
    leaf = np.flatnonzero(forest.leaf)

    def chain(e):
        out = [e]
        while forest.parent[out[-1]] >= 0:
            out.append(int(forest.parent[out[-1]]))
        return out

    for a, b in rng.choice(leaf, (300, 2)).tolist():
        if forest.region[a] != forest.region[b]:
            assert sum(tuple(sorted((x, y))) in links for x in chain(a) for y in chain(b)) == 1


def test_a_smaller_tolerance_makes_more_links_and_drops_less():
    building = building_of(scene_of(box(high=(6, 4, 3))))
    coarse, fine = (linked(building, 2, exchange, min_size=0.02)[1] for exchange in (4e-3, 2e-4))
    assert sum(map(len, fine.links)) > 3 * sum(map(len, coarse.links))
    assert 0 <= fine.dropped <= coarse.dropped


def test_elements_are_not_split_below_the_smallest_size():
    building = building_of(scene_of(box(high=(2, 2, 2))))
    forest, _ = linked(building, 2, 1e-5, min_size=0.3)
    longer = forest.box[:, 2:].max(1)
    assert longer.min() >= 0.3
    assert longer.min() < 0.6


@orders
def test_the_same_links_on_any_number_of_threads(order):
    faces = [*box(high=(4, 3, 2.5)), *box((1, 1, 0), (2, 1.5, 1), inward=False, leave_out="z-")]
    building = building_of(scene_of(faces, object=[0] * 6 + [1] * 5), average=2, large_polygon=1e9)
    one, four = (linked(building, order, 2e-3, min_size=0.05, workers=w) for w in (1, 4))
    assert len(one[0]) == len(four[0])
    for a, b in zip(one[1].links, four[1].links, strict=True):
        for name in ("a", "b", "exchange"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert one[1].dropped == four[1].dropped


def test_clusters_do_not_change_what_is_linked():
    faces = [*box(high=(4, 3, 2.5)), *box((1, 1, 0), (2, 1.5, 1), inward=False, leave_out="z-")]
    scene = scene_of(faces, object=[0] * 6 + [1] * 5)
    found = []
    for average, large in ((1, 0.0), (3, 1e9), (50, 1e9)):
        building = building_of(scene, average=average, large_polygon=large)
        forest, linking = linked(building, 2, 1e-3, min_size=0.05)
        found.append(factors(building, forest, linking))
    # Of two elements alike the one of the lesser cluster is split, so that trees differ, but light by less than the tolerance.
    np.testing.assert_allclose(found[1], found[0], atol=2e-3)
    np.testing.assert_allclose(found[2], found[0], atol=2e-3)


def crowded_room():
    """A room with thirty crates of all sizes, and a screen across half of it."""
    rng = np.random.default_rng(4)
    faces, owner = [*box(high=(6, 5, 3))], [0] * 6
    for k in range(30):
        turn = rotation(k)
        size, place = rng.uniform(0.1, 0.7, 3), rng.uniform([0.5, 0.5, 0.6], [5.3, 4.3, 2.2])
        faces += [place + f @ turn.T for f in box(high=size, inward=False)]
        owner += [1 + k] * 6
    faces += box((2.9, 0.3, 0), (3.0, 3.5, 2.6), inward=False, leave_out="z-")
    return building_of(scene_of(faces, object=owner + [31] * 5), average=12)


def in_order(linking):
    """Every link as (a, b) with its exchange, sorted by both."""
    found = {(int(a), int(b)): x for s in linking.links for a, b, x in zip(s.a, s.b, s.exchange, strict=True)}
    return [(pair, found[pair]) for pair in sorted(found)]


@pytest.mark.parametrize("largest", [(12, 13), (3, 40), (150, 151)])
def test_which_blockers_are_asked_first_changes_no_link(monkeypatch, largest):
    building = crowded_room()
    before = linked(building, 2, 4e-3, min_size=0.2)
    monkeypatch.setattr(pair_visibility, "MANY", 0)
    monkeypatch.setattr(pair_visibility, "LARGEST", largest)
    after = linked(building, 2, 4e-3, min_size=0.2)
    assert len(before[0]) == len(after[0]) > 400
    assert after[1].segment_tests < before[1].segment_tests
    for (pair, one), (same, other) in zip(in_order(before[1]), in_order(after[1]), strict=True):
        assert pair == same
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("pairs", [50, 1000])
def test_sifting_the_first_pairs_changes_no_link(monkeypatch, pairs):
    building = crowded_room()
    before = linked(building, 2, 2e-2, min_size=0.2)
    assert before[1].dropped > 0
    monkeypatch.setattr(refinement, "BLOCK_PAIRS", pairs)
    after = linked(building, 2, 2e-2, min_size=0.2)
    assert len(before[0]) == len(after[0])
    assert after[1].dropped == pytest.approx(before[1].dropped, rel=1e-9)
    for (pair, one), (same, other) in zip(in_order(before[1]), in_order(after[1]), strict=True):
        assert pair == same
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-9)


# ---------------------------------------------------------------------------------------------- hard pairs


@pytest.mark.parametrize("offset", [(0.0, 0.0), (1.4, 1.3), (-1.5, 0.2)])
def test_a_narrow_gap_between_large_plates_is_refined(offset):
    # Their centres lie far off to the side of each other, yet nearly all that the small one sees is the large one.
    wall = rectangle((0, -2, -2), (0, 4, 0), (0, 0, 4))
    shelf = rectangle((0.02, -0.5, -0.5), (0, 0, 1), (0, 1, 0)) + [0, *offset]
    building = building_of(scene_of([wall, shelf], object=[0, 1]))
    forest, linking = linked(building, 2, 2e-4, min_size=0.01)
    of = building.regions.polygon_region
    to_shelf = region_means(forest, received_from(forest, linking, [of[0]]))[of[1]]
    assert to_shelf == pytest.approx(mean_form_factor(shelf, wall), rel=0.01)
    to_wall = region_means(forest, received_from(forest, linking, [of[1]]))[of[0]]
    assert to_wall == pytest.approx(mean_form_factor(shelf, wall) / 16, rel=0.01)


def test_places_behind_a_surface_get_none_of_its_light():
    # A sheet stands across the floor: elements of the floor reach to both sides of it.
    floor, sheet = rectangle((0, 0, 0), (4, 0, 0), (0, 4, 0)), rectangle((1.7, 0, 0), (0, 4, 0), (0, 0, 2))
    building = building_of(scene_of([floor, sheet], object=[0, 1]))
    forest, linking = linked(building, 2, 1e-2, min_size=0.5)
    behind = before = 0
    for group in linking.links:
        for source, receiver, exchange in directions(group):
            rows = np.flatnonzero(forest.region[source] == building.regions.polygon_region[1])
            x = forest.nodes[receiver[rows], :, 0] + building.regions.centre[0]
            if exchange.shape[1] > 1:
                assert not exchange[rows][x < 1.7].any()
                behind += (x < 1.7).sum()
                before += (exchange[rows][x > 1.7] > 0).sum()
    assert behind > 0
    assert before > 0


def test_a_blocker_between_two_squares():
    lower, upper = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0))
    plate = rectangle((0.21, 0.27, 0.43), (0.5, 0.03, 0), (-0.02, 0.47, 0.05))
    building = building_of(scene_of([lower, upper, plate], object=[0, 1, 2]))
    # The exact visible part of the upper square, from many points of the lower.
    x = (np.arange(60) + 0.5) / 60
    points = np.column_stack([np.repeat(x, 60), np.tile(x, 60), np.zeros(3600)]) - building.regions.centre
    every, normals = np.arange(3600), np.tile([0, 0, 1.0], (3600, 1))
    blockers = building.blockers.take(np.flatnonzero(building.blockers.region == building.regions.polygon_region[2]))
    lamp = np.repeat(upper[None] - building.regions.centre, 3600, 0)
    exact = visible_form_factors(points.astype(np.float32), normals, every, lamp, blockers, every, np.zeros(3600, int))[0].mean()
    of = building.regions.polygon_region
    error = []
    for exchange in (1e-3, 2e-4, 2e-5):
        forest, linking = linked(building, 2, exchange, min_size=0.01)
        error.append(abs(region_means(forest, received_from(forest, linking, [of[1]]))[of[0]] / exact - 1))
    assert error[0] < 0.03
    assert error[1] < 0.01
    assert error[2] < 0.003


def two_rooms():
    """Two rooms with a door 1 m wide in the wall between them at x = 4, everything black."""
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x-")]
    wall = [
        rectangle((4, 0, 0), (0, 0, 3), (0, 1, 0)),
        rectangle((4, 2, 0), (0, 0, 3), (0, 1, 0)),
        rectangle((4, 1, 2), (0, 0, 1), (0, 1, 0)),
    ]
    room = [0] * 5 + [1] * 5 + [0] * 3 + [1] * 3
    door = rectangle((4, 1, 0), (0, 1, 0), (0, 0, 2))
    return scene_of([*rooms, *wall, *[w[::-1] for w in wall]], room=room, portals=portals_of([door], [[0, 1]]))


def test_links_between_rooms_pass_the_door():
    building = building_of(two_rooms())
    forest, linking = linked(building, 2, 5e-4, min_size=0.05)
    room = building.regions.room
    through = 0
    for group in linking.links:
        apart = np.flatnonzero(room[forest.region[group.a]] != room[forest.region[group.b]])
        nodes = []
        for side, count in ((group.a, group.exchange.shape[1]), (group.b, group.exchange.shape[2])):
            ids = side[apart]
            nodes.append((forest.centroids(ids)[:, None] if count == 1 else forest.nodes[ids]).astype(float) + building.regions.centre)
        n, i, j = np.nonzero(group.exchange[apart])
        a, b = nodes[0][n, i], nodes[1][n, j]
        t = (4 - a[:, 0]) / (b[:, 0] - a[:, 0])
        at = a + t[:, None] * (b - a)
        eps = 1e-4
        assert ((at[:, 1] > 1 - eps) & (at[:, 1] < 2 + eps) & (at[:, 2] < 2 + eps)).all()
        through += len(n)
    assert through > 1000


def test_the_light_that_passes_a_door_is_that_of_its_area():
    # All of room 0 shines with exitance 1: whatever its shape, the door passes what its own area would receive.
    building = building_of(two_rooms())
    forest, linking = linked(building, 2, 5e-5, min_size=0.05)
    room = building.regions.room
    light = region_means(forest, received_from(forest, linking, np.flatnonzero(room == 0)))
    assert (light * building.regions.area)[room == 1].sum() == pytest.approx(2.0, rel=0.01)
    back = region_means(forest, received_from(forest, linking, np.flatnonzero(room == 1)))
    assert (back * building.regions.area)[room == 0].sum() == pytest.approx(2.0, rel=0.01)


# ------------------------------------------------------------------------------------------------ link sets


def some_links(seed, n, shape, elements):
    rng = np.random.default_rng(seed)
    a, b = rng.integers(0, elements, (2, n)).astype(np.int32)
    return LinkSet.of(a, b, rng.random((n, *shape)).astype(np.float32))


def plain_received(forest, sets, exitance):
    """The same sums link by link, in double precision."""
    gathered = np.zeros((len(forest), forest.node_count))
    for group in sets:
        for source, receiver, exchange in directions(group):
            for s, r, k in zip(source, receiver, exchange.astype(float), strict=True):
                power = forest.at_nodes(np.array([s]), exitance[s][None].astype(float))[0, :, 0] * forest.node_weights[s]
                light = k @ (power if k.shape[1] > 1 else power.sum(keepdims=True))
                gathered[r] += light if len(light) > 1 else light[0]
    return forest.push(forest.from_nodes(np.arange(len(forest)), gathered[..., None]))


def test_light_over_links_is_the_sum_of_all_of_them():
    forest = Forest(building_of(scene_of(box(high=(1, 2, 3)))).regions, 2)
    forest.split(np.arange(3))
    sets = [some_links(k, 40, shape, len(forest)) for k, shape in enumerate([(4, 4), (1, 4), (4, 1), (1, 1), (4, 4)])]
    exitance = np.random.default_rng(9).random((len(forest), 4, 1)).astype(np.float32)
    found = received(forest, sets, exitance)
    expected = plain_received(forest, sets, exitance)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    again = joined([some_links(7, 0, (4, 4), 9), *sets[::-1], *sets])
    assert len(again) == 4
    np.testing.assert_allclose(received(forest, again, exitance), 2 * found, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_a_collector_gives_back_what_it_took_in_its_order(monkeypatch):
    monkeypatch.setattr(links, "_CHUNKS", (8, 16))
    shapes = [(4, 4), (1, 1), (1, 4), (4, 4)]
    sets = [some_links(k, 40 - k, shape, 30) for k, shape in enumerate(shapes)]
    for allocate in (None, np.zeros):
        collector = LinkCollector(allocate)
        for one in sets:
            collector.add([one])
        found, expected = joined(collector.links()), joined(sets)
        assert len(found) == 3
        for a, b in zip(found, expected, strict=True):
            assert a.shape == b.shape
            for name in ("a", "b", "exchange"):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert collector.links() == []


def test_blocks_of_links_end_at_the_same_places_however_they_stand_in_sets(monkeypatch):
    monkeypatch.setattr(links, "BLOCK", 7)
    sets = [some_links(k, n, (1, 4), 30) for k, n in enumerate([3, 20, 1, 8])]
    parts = list(blocks(sets))
    assert [len(p) for p in parts] == [7, 7, 7, 7, 4]
    for a, b in zip(parts, blocks(joined(sets)), strict=True):
        np.testing.assert_array_equal(a.exchange, b.exchange)
