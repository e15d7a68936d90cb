"""Direct light on elements, and the rough estimates that steer the oracle."""

import numpy as np
import pytest
from enfilade.core import illumination
from enfilade.core.elements import Forest
from enfilade.core.illumination import exitance_estimate, extended, illuminate, room_irradiance
from enfilade.core.transport import lambert
from scenery import box, building_of, crew, light_kinds, portals_of, rectangle, scene_of

LAMP = rectangle((1.2, 1.1, 2.4), (0, 0.5, 0), (0.8, 0, 0))


def lit(polygons, emission, order=2, tolerance=3e-3, min_size=0.03, workers=1, **more):
    """The forest and the result of illuminating a scene."""
    building = building_of(scene_of(polygons, emission=emission, **more))
    forest = Forest(building.regions, order)
    *shares, result = illuminate(building, forest, light_kinds(building), tolerance, min_size, crew(workers))
    assert all(isinstance(s, float) and 0 <= s <= 1 for s in shares)
    return building, forest, result


def lamp_in_a_room(furniture=()):
    polygons = [*box(high=(4, 3, 2.5)), LAMP, *furniture]
    emission = np.zeros((len(polygons), 3))
    emission[6] = (50, 100, 20)
    return polygons, emission


@pytest.mark.parametrize("order", [1, 2, 3])
def test_direct_light_of_a_free_lamp_is_its_form_factor(order):
    polygons, emission = lamp_in_a_room()
    building, forest, (light, _, _) = lit(polygons, emission, order)
    of = building.regions.polygon_region
    leaf = np.flatnonzero(forest.leaf)
    nodes = forest.nodes[leaf].astype(float)
    places = nodes.reshape(-1, 3) + building.regions.centre
    normal = np.repeat(building.regions.normal[forest.region[leaf]], forest.node_count, 0)
    exact = lambert(places, normal, np.repeat(LAMP[None], len(places), 0))
    exact = np.where(places[:, 2] < 2.4, exact, 0).reshape(len(leaf), -1)[..., None] * emission[6]
    exact[forest.region[leaf] == of[6]] = 0
    found = forest.at_nodes(leaf, light[leaf])
    weight = forest.node_weights[leaf][..., None]
    error = np.sqrt((weight * (found - exact) ** 2).sum((0, 1)) / (weight * exact**2).sum((0, 1)))
    assert error.max() < {1: 0.06, 2: 1e-5, 3: 1e-5}[order]  # a constant cannot be right at all four nodes
    # What leaves the lamp arrives on the walls: all of it.
    arrived = (forest.mean(leaf, light[leaf]) * forest.area[leaf, None]).sum(0)
    np.testing.assert_allclose(arrived, emission[6] * 0.4, rtol=5e-3)


def test_elements_are_small_where_shadows_end_and_large_elsewhere():
    shelf = rectangle((1, 1, 1.5), (1, 0, 0), (0, 1, 0))
    polygons, emission = lamp_in_a_room([shelf, shelf[::-1]])
    _, plain, _ = lit(*lamp_in_a_room(), tolerance=1e-3, min_size=0.01)
    building, forest, (light, _, tests) = lit(polygons, emission, object=[0] * 6 + [1, 2, 2], tolerance=1e-3, min_size=0.01)
    assert tests > 0
    assert len(forest) > 1.3 * len(plain)
    floor = building.regions.polygon_region[4]
    leaf = np.flatnonzero(forest.leaf & (forest.region == floor))
    level = forest.level[leaf]
    # Points of the floor that see the lamp in part, by its corners, against those that see all of it or nothing.
    places = forest.centroids(leaf) + building.regions.centre
    d = LAMP[None] - places[:, None]
    at = places[:, None] + d * ((1.5 - places[:, None, 2]) / d[..., 2])[..., None]
    hidden = ((at[..., :2] > 1) & (at[..., :2] < 2)).all(2)
    part = hidden.any(1) & ~hidden.all(1)
    assert part.sum() > 10
    assert level[part].mean() > level[~part].mean() + 0.5
    values = forest.mean(leaf, light[leaf])[:, 1]
    assert values[hidden.all(1)].max(initial=0) < 0.05 * values.max()


@pytest.mark.parametrize("size", [1, 7, 100])
def test_the_light_is_the_same_however_many_elements_are_worked_on_at_once(monkeypatch, size):
    shelf = rectangle((1, 1, 1.5), (1, 0, 0), (0, 1, 0))
    polygons, emission = lamp_in_a_room([shelf, shelf[::-1]])
    _, forest, (light, room, _) = lit(polygons, emission, object=[0] * 6 + [1, 2, 2], tolerance=1e-2)
    monkeypatch.setattr(illumination, "_BLOCK", size)
    _, other, (same, rooms, _) = lit(polygons, emission, object=[0] * 6 + [1, 2, 2], tolerance=1e-2)
    assert len(forest) > 200
    np.testing.assert_array_equal(forest.box, other.box)
    np.testing.assert_allclose(light, same, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(room, rooms, rtol=1e-6)


@pytest.mark.parametrize("tolerance", [3e-2, 3e-3])
def test_a_smaller_tolerance_makes_smaller_elements(tolerance):
    coarse, fine = (lit(*lamp_in_a_room(), tolerance=t)[1] for t in (tolerance, tolerance / 10))
    assert len(fine) > 1.5 * len(coarse)
    limited = lit(*lamp_in_a_room(), tolerance=tolerance / 10, min_size=0.5)[1]
    assert limited.box[:, 2:].max(1).min() >= 0.5 * (1 - 1e-12) or len(limited) == 7


def test_no_lamps_give_no_light():
    _, forest, (light, room, tests) = lit(box(), 0.0)
    assert light.shape == (6, 4, 3)
    assert not light.any()
    assert (room > 0).all()  # a scale that divisions survive
    assert tests == 0
    assert len(forest) == 6


def test_the_same_on_any_number_of_threads():
    polygons, emission = lamp_in_a_room([rectangle((1, 1, 1.5), (1, 0, 0), (0, 1, 0))])
    one, four = (lit(polygons, emission, object=[0] * 6 + [1, 2], workers=w)[2] for w in (1, 4))
    for a, b in zip(one, four, strict=True):
        np.testing.assert_array_equal(a, b)


# ----------------------------------------------------------------------------------------------- estimates


def test_a_room_as_an_integrating_sphere():
    # All walls reflect one half and receive 1 directly: 1 / (1 - 1/2) in all.
    building = building_of(scene_of(box(high=(4, 3, 2)), reflectance=(0.5, 0.5, 0.25)))
    found = room_irradiance(building, np.ones((6, 3)))
    np.testing.assert_allclose(found, [[2, 2, 4 / 3]], rtol=5e-3)


def test_rooms_trade_light_through_their_doors():
    # Two cubes without the wall between them, the light in the first alone: by symmetry the sum is that of one room.
    rooms = [*box(leave_out="x+"), *box(low=(1, 0, 0), high=(2, 1, 1), leave_out="x-")]
    opening = rectangle((1, 0, 0), (0, 1, 0), (0, 0, 1))
    room = np.repeat([0, 1], 5)
    building = building_of(scene_of(rooms, room=room, portals=portals_of([opening], [[0, 1]])))
    direct = np.where(building.regions.room[:, None] == 0, 1.0, 0.0) * np.ones(3)
    found = room_irradiance(building, direct)[:, 0]
    # Exchange of two spheres with areas 5 and a door of 1: reflected e = (5 b + b') / 6, b = direct part / 2 + e / 2.
    b = np.linalg.solve(np.eye(2) - 0.5 * np.array([[5, 1], [1, 5]]) / 6, [0.5, 0])
    np.testing.assert_allclose(found, [1, 0] + np.array([[5, 1], [1, 5]]) @ b / 6, rtol=5e-3)
    closed = building_of(scene_of(rooms, room=room))
    alone = room_irradiance(closed, direct)[:, 0]
    assert alone[0] > found[0] > found[1] > alone[1] > 0


def test_a_window_takes_light_away():
    walls, window = box(leave_out="x+"), rectangle((1, 0, 0), (0, 1, 0), (0, 0, 1))
    dark, bright = (
        room_irradiance(building_of(scene_of(walls, portals=p)), np.ones((5, 3)))[0, 0] for p in (portals_of([window], [[0, -1]]), None)
    )
    e = (5 * 0.5 / 6) / (1 - 5 * 0.5 / 6)
    assert dark == pytest.approx(1 + e, rel=5e-3)
    assert bright == pytest.approx(2, rel=5e-3)


def test_the_estimate_of_exitance():
    polygons, emission = lamp_in_a_room()
    _, forest, (light, room, _) = lit(polygons, emission, reflectance=0.5)
    mean, slope = exitance_estimate(forest, light, room)
    expected = 0.5 * (np.maximum(forest.mean(np.arange(len(forest)), light), 0) + room[0]).max(1)
    np.testing.assert_allclose(mean, expected, rtol=1e-6)
    assert slope.shape == mean.shape
    assert (slope >= 0).all()
    flat = light.copy()
    flat[:, 1:] = 0
    assert not exitance_estimate(forest, flat, room)[1].any()


@pytest.mark.parametrize("order", [1, 2])
def test_light_on_younger_elements_is_that_of_their_ancestors(order):
    _, forest, (light, _, _) = lit(*lamp_in_a_room(), order)
    known = len(forest)
    rng = np.random.default_rng(0)
    for _ in range(2):
        leaf = np.flatnonzero(forest.leaf)
        forest.split(leaf[rng.random(len(leaf)) < 0.4])
    found = extended(forest, light)
    assert found.shape == (len(forest), forest.functions, 3)
    np.testing.assert_allclose(found[:known], light, atol=2e-5 * np.abs(light).max())
    # An element's children are its own function in parts.
    young = np.arange(known, len(forest))
    ancestor = young.copy()
    while (ancestor >= known).any():
        ancestor = np.where(ancestor >= known, forest.parent[ancestor], ancestor)
    own = np.zeros_like(found)
    own[ancestor] = light[ancestor]
    np.testing.assert_allclose(found[young], forest.push(own)[young], atol=2e-5 * np.abs(light).max())
