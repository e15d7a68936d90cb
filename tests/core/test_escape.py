"""Light that leaves through openings, against form factors that are known."""

import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.elements import Forest
from enfilade.core.escape import LEAK, escaped_power, lost_share
from scenery import box, building_of, crew, portals_of, rectangle, rotation, scene_of

DATA = json.loads((Path(__file__).resolve().parents[1] / "data" / "form_factors.json").read_text(encoding="utf-8"))


def forest_of(building, rounds=2):
    forest = Forest(building.regions, 2)
    for _ in range(rounds):
        forest.split(np.flatnonzero(forest.leaf))
    return forest


def solved(polygons, emission=1.0, irradiance=0.0, **more):
    """Share of lost rays per room and power lost (W), of surfaces that receive a constant irradiance."""
    building = building_of(scene_of(polygons, emission=emission, **more))
    forest = forest_of(building)
    light = np.zeros((len(forest), 4, 3), np.float32)
    light[:, 0] = irradiance
    share = lost_share(building, forest, crew(1))
    return building, share, escaped_power(building, forest, light, share, crew(1))


@pytest.mark.parametrize("turn", [np.eye(3), rotation(2)], ids=["upright", "turned"])
def test_a_closed_room_loses_nothing(turn):
    _, share, power = solved([f @ turn.T + 7 for f in box(high=(4, 3, 2.5))])
    assert share.tolist() == [0]
    assert power == 0


def test_a_closed_room_with_furniture_loses_next_to_nothing():
    table = [box((1, 1, 0), (2, 2, 0.8), inward=False), box((1.2, 1.2, 0.8), (1.5, 1.5, 1.1), inward=False)]
    polygons = [f for part in (box(high=(4, 3, 2.5)), *table) for f in part]
    _, share, power = solved(polygons, object=np.repeat([0, 1, 2], 6))
    assert share[0] < 1e-3
    assert power < 1e-3 * 3 * 60


@pytest.mark.parametrize("size", [(4, 3, 2.5), (1, 1, 1), (6, 1, 1)])
def test_uniform_light_leaves_an_open_box_by_the_area_of_its_opening(size):
    # All walls shine alike: what passes the opening is what its area would receive, M times the area.
    _, share, power = solved(box(high=size, leave_out="z+"), emission=(1.0, 2, 3))
    opening = size[0] * size[1]
    wall = 2 * (size[0] + size[1]) * size[2] + opening
    assert share[0] == pytest.approx(opening / wall, rel=0.01)
    assert power == pytest.approx(6 * opening, rel=0.01)


def test_light_of_one_wall_leaves_by_its_form_factor():
    factors = {case["name"]: case["factor"] for case in DATA["pairs"]}
    opposed = factors["opposed rectangles a=1,b=1,c=1"]
    beside = factors["perpendicular rectangles with a common edge w=1,h=1,l=1"]
    walls = box(leave_out="z+")
    for k, expected in enumerate([beside] * 4 + [opposed]):
        emission = np.zeros((5, 3))
        emission[k] = (0, 6, 0)
        _, _, power = solved(walls, emission=emission)
        assert power == pytest.approx(6 * expected, rel=0.02)


def test_reflected_light_leaves_as_emitted_light_does():
    walls = box(leave_out="z+")
    _, _, emitted = solved(walls, emission=(1.0, 1, 1))
    _, _, both = solved(walls, emission=(0.5, 0.5, 0.5), irradiance=2.0, reflectance=(0.25, 0.25, 0.25))
    assert both == pytest.approx(emitted, rel=1e-6)


def test_light_that_strikes_backs_is_lost():
    # A box turned inside out has no fronts to receive its light; one in a room gives it to the room.
    _, share, power = solved(box(inward=False))
    assert share[0] == 1
    assert power == pytest.approx(3 * 6, rel=1e-6)
    # Half of a sheet's world is backs: parallel squares that face the same way.
    stack = [rectangle((0, 0, z), (1, 0, 0), (0, 1, 0)) for z in (0.0, 1e-2)]
    _, share, _ = solved(stack)
    assert share[0] == 1


def test_a_wall_without_thickness_loses_nothing():
    partition = [rectangle((2, 0, 0), (0, 2, 0), (0, 0, 2)), rectangle((2, 2, 0), (0, -2, 0), (0, 0, 2))]
    _, share, power = solved([*box(high=(4, 3, 2.5)), *partition], object=[0] * 6 + [1, 2])
    assert share[0] < 1e-3
    assert power < 1e-3 * 3 * 67


def test_what_is_buried_sends_nothing_out():
    # The underside of a box on the floor shines: it sees nothing but the floor that it lies on.
    polygons = [*box(high=(4, 3, 2.5), leave_out="z+"), *box((1, 1, 0), (2, 2, 1), inward=False)]
    emission = np.zeros((11, 3))
    emission[9] = 1
    building, share, power = solved(polygons, emission=emission, object=[0] * 5 + [1] * 6)
    assert np.flatnonzero(building.regions.buried).tolist() == [building.regions.polygon_region[9]]
    assert share[0] > LEAK
    assert power == 0


def test_doors_between_rooms_lose_nothing_and_windows_do():
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x- z+")]
    opening = rectangle((4, 0, 0), (0, 3, 0), (0, 0, 3))
    _, share, power = solved(rooms, room=[0] * 5 + [1] * 4, portals=portals_of([opening], [[0, 1]]))
    wall = 4 * 12 + 9 + 3 * 12 + 9
    assert share[1] > share[0] > LEAK
    assert power == pytest.approx(3 * 12, rel=0.02)
    assert (share * [57, 45]).sum() == pytest.approx(12, rel=0.02)
    assert wall == 57 + 45


def test_the_same_on_any_number_of_threads():
    building = building_of(scene_of([f + [6 * k, 0, 0] for k in range(4) for f in box(leave_out="z+")], room=np.repeat(range(4), 5)))
    forest = forest_of(building)
    light = np.random.default_rng(0).random((len(forest), 4, 3)).astype(np.float32)
    one, four = lost_share(building, forest, crew(1)), lost_share(building, forest, crew(4))
    np.testing.assert_array_equal(one, four)
    assert escaped_power(building, forest, light, one, crew(1)) == escaped_power(building, forest, light, one, crew(4))


def test_no_ray_starts_under_what_stands_on_a_surface():
    # A foot in the middle of the floor, unsplit: the middle of what is left of its element lies under the foot.
    polygons = [*box(high=(4, 3, 2.5)), *box((1.9, 1.4, 0), (2.1, 1.6, 2), inward=False)]
    building = building_of(scene_of(polygons, emission=1.0, object=[0] * 6 + [1] * 6))
    for order in (1, 2, 3):
        forest = Forest(building.regions, order)
        assert lost_share(building, forest, crew(1))[0] < 1e-3
