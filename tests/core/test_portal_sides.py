"""Portals with a normal that runs the wrong way are found and turned."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.portal_sides import reversed_portals
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene
from scenery import box, portals_of, rectangle, rotation, scene_of

DATA = Path(__file__).resolve().parents[1] / "data"


def swapped(scene, which=slice(None)):
    rooms = scene.portals.rooms.copy()
    rooms[which] = rooms[which, ::-1]
    return replace(scene, portals=replace(scene.portals, rooms=rooms))


@pytest.mark.parametrize("name", ["scenes/fzk-haus.json", "bench/office.npz", "bench/two_rooms.npz"])
def test_the_side_of_every_portal_is_found(name):
    scene = load_scene(DATA / name)
    assert not reversed_portals(scene).any()
    assert reversed_portals(swapped(scene)).all()


def test_rooms_turned_inside_out_have_the_same_sides():
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    corner = scene.corner_vertex.copy()
    for start, end in zip(scene.loop_start, scene.loop_start[1:], strict=False):
        corner[start:end] = corner[start:end][::-1]
    inside_out = replace(scene, corner_vertex=corner)
    assert not reversed_portals(inside_out).any()
    assert reversed_portals(swapped(inside_out)).all()


def horseshoe(turn):
    """Room 0 is a U around room 1; their door leads from the middle of the U down into room 1, away from most of room 0."""
    u = [(0, 0), (9, 0), (9, 6), (6, 6), (6, 3), (3, 3), (3, 6), (0, 6)]
    walls = [[(*a, 0), (*b, 0), (*b, 3), (*a, 3)] for b, a in zip(u, u[1:] + u[:1], strict=True)]
    # The wall that the door fills stays: a door leaf in the plane of the portal tells nothing of sides.
    flat = [[(*p, 0) for p in u], [(*p, 3) for p in u[::-1]]]
    inner = box((3, 3, 0), (6, 6, 3), leave_out="y-")
    polygons = [np.array(p, float) @ turn.T for p in walls + flat] + [p @ turn.T for p in inner]
    door = rectangle((3, 3, 0), (0, 0, 3), (3, 0, 0)) @ turn.T  # normal +y, into room 1
    return scene_of(polygons, room=[0] * 10 + [1] * 5, portals=portals_of([door], [(0, 1)]))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_room_that_turns_round_the_other_one(seed):
    scene = horseshoe(rotation(seed) if seed else np.eye(3))
    assert reversed_portals(scene).tolist() == [False]
    assert reversed_portals(swapped(scene)).tolist() == [True]


def test_portals_to_the_outside_go_by_their_one_room():
    room = box((0, 0, 0), (4, 4, 3), leave_out="x+")
    window = rectangle((4, 0, 0), (0, 4, 0), (0, 0, 3))
    for rooms, wrong in (((0, -1), False), ((-1, 0), True)):
        scene = scene_of(room, portals=portals_of([window], [rooms]))
        assert reversed_portals(scene).tolist() == [wrong]


def test_portals_with_nothing_around_stay_as_they_are():
    lone = [rectangle((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)), rectangle((9, 0, 0), (0.1, 0, 0), (0, 0.1, 0))]
    scene = scene_of(lone, room=[0, 1], portals=portals_of([rectangle((4, -1, 0), (0, 2, 0), (0, 0, 2))], [(1, 0)]))
    assert reversed_portals(scene).tolist() == [False]


def test_turned_portals_are_set_right_and_told():
    scene = load_scene(DATA / "bench" / "office.npz")
    mended, findings = check(swapped(scene, [2, 5]))
    np.testing.assert_array_equal(mended.portals.rooms, scene.portals.rooms)
    (finding,) = findings
    assert finding.kind == "portal_turned"
    assert finding.portals == (2, 5)
    assert finding.message == (
        "2 portals have a normal that runs from the second to the first of its rooms, "
        "which are taken the other way round: portal 2, portal 5"
    )
