"""Light straight from luminaires: exact irradiance in penumbrae, through doors and beside contact shadows."""

import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.direct import direct_light
from enfilade.core.patches import PATCH, patch_blocks, patches_of
from enfilade.core.transport import lambert
from scenery import box, building_of, crew, light_kinds, portals_of, rectangle, rotation, scene_of

CASES = json.loads((Path(__file__).resolve().parents[1] / "data" / "penumbrae.json").read_text(encoding="utf-8"))["cases"]


def patch(at, normal, size=20.0):
    """A wide square around a point with the given normal."""
    normal = np.asarray(normal, float)
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    return rectangle(np.asarray(at) - 0.5 * size * (u + v), size * u, size * v)


def light_at(building, points, region, workers=1):
    """(n, 3) irradiance at points (n, 3) of the world, from blocks in whatever order they come."""
    out = np.full((len(points), 3), np.nan)
    local = (points - building.regions.centre).astype(np.float32)
    for part in direct_light(building, light_kinds(building), local, region, crew(workers)):
        out[part.index] = part.irradiance
    return out


@pytest.mark.parametrize("turned", [False, True], ids=["as it is", "turned"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_penumbrae_are_exact(case, turned):
    turn, offset = (rotation(11), np.array([2.0, -3, 1])) if turned else (np.eye(3), np.zeros(3))
    lamp, blockers = np.array(case["lamp"], float), [np.array(b, float) for b in case["blockers"]]
    # One small surface for each point, one scene for each: no point's surface stands before another point.
    for point in case["points"]:
        surface = patch(point["at"], point["normal"], 1e-3)
        polygons = [p @ turn.T + offset for p in (lamp, surface, *blockers)]
        emission = np.zeros((len(polygons), 3))
        emission[0] = case["exitance"]
        building = building_of(scene_of(polygons, reflectance=0.0, emission=emission, object=np.arange(len(polygons))))
        at = np.array([point["at"]], float) @ turn.T + offset
        found = light_at(building, at, building.regions.polygon_region[1:2].astype(int))
        # Places are single precision: within a penumbra that is worth a millionth of the whole lamp.
        assert found[0] == pytest.approx([point["irradiance"]] * 3, rel=2e-6, abs=5e-5)


def test_a_lamp_in_an_empty_room():
    lamp = rectangle((1, 1, 2.9), (0, 0.5, 0), (0.5, 0, 0))
    faces = box(high=(4, 3, 3))
    emission = np.zeros((7, 3))
    emission[6] = (10, 20, 30)
    building = building_of(scene_of([*faces, lamp], emission=emission, object=[0] * 6 + [1]))
    regions = building.regions
    rng = np.random.default_rng(0)
    polygon = rng.integers(0, 6, 3000)
    region = regions.polygon_region[polygon].astype(int)
    points = regions.world(region, rng.uniform(0.01, 0.99, (3000, 2)) * regions.size[region]) + regions.centre
    expected = lambert(points, regions.normal[region], np.repeat(lamp[None], 3000, 0))
    expected = np.where((points[:, 2] < 2.9)[:, None], expected[:, None] * [10, 20, 30], 0)
    found = light_at(building, points, region)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-4)
    np.testing.assert_array_equal(light_at(building, points, region, workers=3), found)


def test_lamps_shine_from_their_front_and_none_into_itself():
    lamp = rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0))  # faces up
    sheets = [patch((0, 0, z), n, 3) for z, n in ((1, (0, 0, -1)), (-1, (0, 0, 1)))]
    emission = np.array([[1.0] * 3, [0] * 3, [0] * 3])
    building = building_of(scene_of([lamp, *sheets], emission=emission, object=[0, 1, 2]))
    region = building.regions.polygon_region.astype(int)
    points = np.array([(0.1, 0.1, 0), (0.1, 0.1, 1), (0.1, 0.1, -1)])
    found = light_at(building, points, region)[:, 0]
    assert found[[0, 2]].tolist() == [0, 0]
    assert found[1] == pytest.approx(lambert(points[1:2], np.array([[0, 0, -1.0]]), lamp[None])[0], rel=1e-6)


def test_a_lamp_with_a_hole_and_a_lamp_in_two_colours():
    outer, hole = rectangle((-1, -1, 2), (0, 2, 0), (2, 0, 0)), rectangle((-0.5, -0.5, 2), (1, 0, 0), (0, 1, 0))
    red = rectangle((3, -1, 2), (0, 2, 0), (2, 0, 0))
    floor = patch((0, 0, 0), (0, 0, 1))
    emission = np.array([[4.0, 4, 4], [7, 0, 0], [0, 0, 0]])
    building = building_of(scene_of([[outer, hole], red, floor], emission=emission, object=[0, 1, 2]))
    points = np.array([(0, 0, 0), (0.7, -0.3, 0), (5, 1, 0.0)])
    up = np.tile([0, 0, 1.0], (3, 1))
    factor = [lambert(points, up, np.repeat(p[None], 3, 0)) for p in (outer, hole, red)]
    expected = (factor[0] - factor[1])[:, None] * emission[0] + factor[2][:, None] * emission[1]
    found = light_at(building, points, np.full(3, building.regions.polygon_region[2]))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_light_through_a_door_and_none_through_the_wall():
    # Two rooms share a wall with a door; the lamp is a part of the ceiling of the first.
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x-")]
    door = rectangle((4, 1, 0), (0, 1, 0), (0, 0, 2))
    wall = [
        rectangle((4, 0, 0), (0, 0, 3), (0, 1, 0)),
        rectangle((4, 2, 0), (0, 0, 3), (0, 1, 0)),
        rectangle((4, 1, 2), (0, 0, 1), (0, 1, 0)),
    ]
    lamp = rectangle((1, 1, 2.99), (0, 1, 0), (1, 0, 0))
    polygons = [*rooms, *wall, *[w[::-1] for w in wall], lamp]
    room = [0] * 5 + [1] * 5 + [0] * 3 + [1] * 3 + [0]
    emission = np.zeros((17, 3))
    emission[16] = 100
    scene = scene_of(polygons, emission=emission, room=room, object=[0] * 16 + [1], portals=portals_of([door], [[0, 1]]))
    building = building_of(scene)
    floor = building.regions.polygon_region[9 if polygons[9][:, 2].max() == 0 else 8]
    points = np.column_stack([np.random.default_rng(0).uniform((4.05, 0.05), (7.95, 2.95), (500, 2)), np.zeros(500)])
    found = light_at(building, points, np.full(500, floor))[:, 0]
    # The lamp in small parts, each seen through the door or not.
    s = (np.arange(60) + 0.5) / 60
    parts = np.array([(1 + x, 1 + y, 2.99) for x in s for y in s])
    d = parts[None] - points[:, None]
    t = (4 - points[:, None, 0]) / d[..., 0]
    y, z = points[:, None, 1] + t * d[..., 1], t * d[..., 2]
    through = (y > 1) & (y < 2) & (z < 2)
    expected = (through * d[..., 2] ** 2 / (np.pi * (d**2).sum(2) ** 2)).sum(1) * 100 / 3600
    assert (expected > 0).mean() > 0.2
    np.testing.assert_allclose(found, expected, atol=0.01 * expected.max())
    assert (found[expected == 0] < 1e-3 * expected.max()).all()


def test_patches_hold_every_point_once_and_neighbours_on_one_region():
    building = building_of(scene_of([f + [10 * k, 0, 0] for k in range(3) for f in box()], room=np.repeat([0, 1, 2], 6)))
    region = np.random.default_rng(0).integers(0, 18, 1000)
    uv = np.random.default_rng(1).random((1000, 2))
    points = building.regions.world(region, uv).astype(np.float32)
    patches = patches_of(building.regions, points, region)
    assert sorted(patches.order.tolist()) == list(range(1000))
    size = np.diff(patches.start)
    assert set(size.tolist()) <= set(range(1, PATCH + 1))
    assert PATCH in size
    owner = np.repeat(np.arange(len(size)), size)
    np.testing.assert_array_equal(region[patches.order], patches.region[owner])
    # Every point lies in the rectangle of its patch, and the rectangles are small.
    offset = points[patches.order] - patches.bodies.centre[owner]
    for half in (patches.bodies.half_u, patches.bodies.half_v):
        reach = np.linalg.norm(half, axis=1)[owner]
        along = np.abs(np.einsum("ij,ij->i", offset, half[owner] / np.maximum(reach, 1e-9)[:, None]))
        assert (along <= reach + 1e-5).all()
    assert np.median(np.linalg.norm(patches.bodies.half_u, axis=1)) < 0.35
    assert (np.abs(np.einsum("ij,ij->i", offset, patches.bodies.normal[owner])) < 1e-5).all()


def test_blocks_hold_every_patch_once_and_neighbours_together():
    building = building_of(scene_of([f * [1, 9, 1] + [10 * k, 0, 0] for k in range(3) for f in box()], room=np.repeat([0, 1, 2], 6)))
    region = np.random.default_rng(0).integers(0, 18, 4000)
    points = building.regions.world(region, np.random.default_rng(1).random((4000, 2)) * building.regions.size[region]).astype(np.float32)
    patches = patches_of(building.regions, points, region)
    blocks = patch_blocks(building, patches, 128)
    assert sorted(np.concatenate(blocks).tolist()) == list(range(len(patches.region)))
    for block in blocks:
        assert np.diff(patches.start)[block].sum() <= 128
        assert len(set(building.regions.room[patches.region[block]])) == 1
        assert np.ptp(patches.bodies.centre[block, 1]) < 2  # along the longest side of the room
    # Small rooms share a block.
    assert len(patch_blocks(building, patches, 10000)) == 1


def test_no_lamps_and_no_points():
    building = building_of(scene_of(box()))
    assert list(direct_light(building, light_kinds(building), np.zeros((5, 3), np.float32), np.zeros(5, int), crew(1))) == []
    lit = building_of(scene_of(box(), emission=1.0))
    assert list(direct_light(lit, light_kinds(lit), np.zeros((0, 3), np.float32), np.zeros(0, int), crew(1))) == []
