"""Leaks: lines from room to room that pass no portal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import leaks
from enfilade.core.leaks import find_leaks
from enfilade.core.occlusion import blockers_of
from enfilade.core.regions import merge
from enfilade.core.scene import no_portals
from enfilade.core.scene_files import load_scene
from scenery import box, portals_of, rectangle, rotation, scene_of

DATA = Path(__file__).resolve().parents[1] / "data"


def leaks_of(scene, **more):
    regions = merge(scene)
    return find_leaks(regions, blockers_of(regions), scene.portals, scene.room_count, **more)


def rooms(hole, portals=None, turn=None):
    """Two rooms of 4 x 4 x 3 m with a wall 0.2 m thick between them, and a rectangular hole (y0, y1, z0, z1) through it."""
    y0, y1, z0, z1 = hole
    polygons, room = [], []
    for k, (x, end) in enumerate(((0.0, 4.0), (8.2, 4.2))):
        faces = box((min(x, end), 0, 0), (max(x, end), 4, 3), leave_out="x+" if k == 0 else "x-")
        around = [((0, y0), (0, 3)), ((y1, 4), (0, 3)), ((y0, y1), (0, z0)), ((y0, y1), (z1, 3))]
        for (a, b), (c, d) in around:
            if b > a and d > c:
                wall = rectangle((end, a, c), (0, b - a, 0), (0, 0, d - c))
                faces.append(wall[::-1] if k == 0 else wall)
        polygons += faces
        room += [k] * len(faces)
    for k, (low, high) in enumerate(((4.0, 4.1), (4.1, 4.2))):  # each room has its half of the sides of the hole
        sides = box((low, y0, z0), (high, y1, z1), leave_out="x- x+")
        polygons += sides
        room += [k] * len(sides)
    turn = np.eye(3) if turn is None else turn
    return scene_of([p @ turn.T for p in polygons], room=room, portals=portals)


HOLE = (1.0, 2.0, 0.5, 1.5)
DOOR = rectangle((4.1, 1, 0.5), (0, 1, 0), (0, 0, 1))


@pytest.mark.parametrize("turn", [np.eye(3), rotation(3)], ids=["straight", "turned"])
def test_a_hole_leaks_until_it_has_a_portal(turn):
    leaks = leaks_of(rooms(HOLE, turn=turn), rays=4000)
    assert [(leak.room, leak.other) for leak in leaks] == [(0, 1), (1, 0)]
    for leak in leaks:
        assert leak.lines > 5
        start, end = leak.start @ turn, leak.end @ turn
        at = start + (4.1 - start[0]) / (end[0] - start[0]) * (end - start)
        assert np.abs(at[1:] - (1.5, 1.0)).max() < 0.5  # the line goes through the hole
    assert leaks_of(rooms(HOLE, portals_of([DOOR @ turn.T], [(0, 1)]), turn), rays=4000) == ()


def test_a_portal_that_is_too_small_leaks_around():
    small = rectangle((4.1, 1, 0.5), (0, 0.8, 0), (0, 0, 1))
    leaks = leaks_of(rooms(HOLE, portals_of([small], [(0, 1)])), rays=20_000)
    assert [(leak.room, leak.other) for leak in leaks] == [(0, 1), (1, 0)]


def test_a_portal_in_three_corners_is_not_its_rectangle():
    half = DOOR[:3]
    leaks = leaks_of(rooms(HOLE, portals_of([half], [(0, 1)])), rays=8000)
    assert leaks
    for leak in leaks:
        at = leak.start + (4.1 - leak.start[0]) / (leak.end[0] - leak.start[0]) * (leak.end - leak.start)
        assert at[2] - 0.5 > at[1] - 1.0  # above the diagonal


def test_a_slit_narrower_than_what_counts_is_no_leak():
    assert leaks_of(rooms((1.0, 1.003, 0.5, 2.5)), rays=40_000) == ()
    assert leaks_of(rooms((1.0, 1.08, 0.5, 2.5)), rays=40_000) != ()


def test_thin_walls_and_backs_are_no_leaks():
    # One sheet with a face to either side; and a wall that only room 0 has, which room 1 sees from behind.
    left, right = box((0, 0, 0), (4, 4, 3)), box((4, 0, 0), (8, 4, 3))
    assert leaks_of(scene_of(left + right, room=[0] * 6 + [1] * 6), rays=4000) == ()
    open_side = box((4, 0, 0), (8, 4, 3), leave_out="x-")
    assert leaks_of(scene_of(left + open_side, room=[0] * 6 + [1] * 5), rays=4000) == ()


def test_things_that_belong_next_door_are_found():
    # A cube in room 0 whose faces are said to belong to room 1.
    scene = rooms(HOLE, portals_of([DOOR], [(0, 1)]))
    cube = box((1, 1, 1), (2, 2, 2), inward=False)
    moved = scene_of(
        [scene.vertices[4 * p : 4 * p + 4] for p in range(scene.polygon_count)] + cube,
        room=[*scene.room, *[1] * 6],
        portals=scene.portals,
    )
    found = {(leak.room, leak.other) for leak in leaks_of(moved, rays=8000)}
    assert (0, 1) in found


def test_a_portal_to_the_outside_ends_the_search():
    left, right = box((0, 0, 0), (4, 4, 3), leave_out="x+"), box((6, 0, 0), (9, 4, 3), leave_out="x-")
    scene = scene_of(left + right, room=[0] * 5 + [1] * 5)
    assert {(leak.room, leak.other) for leak in leaks_of(scene, rays=4000)} == {(0, 1), (1, 0)}
    windows = portals_of([rectangle((x, 0, 0), (0, 4, 0), (0, 0, 3)) for x in (4, 6)], [(0, -1), (-1, 1)])
    assert leaks_of(replace(scene, portals=windows), rays=4000) == ()


def test_a_house_leaks_where_a_door_has_lost_its_portal():
    house = load_scene(DATA / "scenes" / "fzk-haus.json")
    assert leaks_of(house, rays=8000) == ()
    inner = (house.portals.rooms >= 0).all(axis=1)
    a, b = house.portals.rooms[np.flatnonzero(inner)[0]]
    kept = np.flatnonzero(~((house.portals.rooms == (a, b)).all(axis=1) | (house.portals.rooms == (b, a)).all(axis=1)))
    portals = portals_of([house.portals.polygon(k) for k in kept], house.portals.rooms[kept])
    found = {(leak.room, leak.other) for leak in leaks_of(replace(house, portals=portals), rays=8000)}
    assert {(a, b), (b, a)} <= found


def test_no_portals_and_one_room():
    assert leaks_of(scene_of(box(), portals=no_portals()), rays=500) == ()


@pytest.mark.parametrize("turn", [np.eye(3), rotation(3)], ids=["straight", "turned"])
def test_no_line_starts_in_an_opening(turn):
    # From within rounding of a portal's plane a line passes it at no distance, which is not passing it.
    scene = rooms(HOLE, portals_of([DOOR @ turn.T], [[0, 1]]), turn)
    regions = merge(scene)
    blockers = blockers_of(regions)
    places = leaks._Places(regions, blockers, scene.portals, 2)
    x = np.array([4.1, 4.1 - 1e-5, 4.1 + 1e-5, 4.1 - 1e-3, 4.1, 4.1, 4.1])
    y, room = np.array([1.5, 1.0, 1.2, 1.5, 3.9, 1.5, 1.5]), np.array([0, 0, 1, 0, 0, 1, 0])
    origin = (np.column_stack([x, y, np.full(7, 0.5)]) @ turn.T - regions.centre).astype(np.float32)
    assert leaks._in_a_door(places, origin, room).tolist() == [True, True, True, False, False, True, True]
    assert leaks_of(scene, rays=4000) == ()
