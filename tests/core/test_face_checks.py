"""Bent faces, and faces that look the other way than their neighbours."""

import numpy as np
import pytest
from enfilade.core.face_checks import bent_faces, islands, turned_faces

CUBE = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
PLACES = np.array([[x, y, z] for x in (0.0, 1) for y in (0, 1) for z in (0, 1)])


def mesh(faces):
    return np.concatenate([np.array(f) for f in faces]), np.cumsum([0] + [len(f) for f in faces])


def test_a_cube_is_in_order():
    assert turned_faces(*mesh(CUBE)).tolist() == []
    assert turned_faces(*mesh([f[::-1] for f in CUBE])).tolist() == []
    assert bent_faces(PLACES, *mesh(CUBE)).tolist() == []
    assert set(islands(*mesh(CUBE))) == {0}


@pytest.mark.parametrize("turned", [[0], [3], [1, 4], [0, 5]])
def test_the_fewer_are_turned(turned):
    faces = [f[::-1] if k in turned else f for k, f in enumerate(CUBE)]
    assert turned_faces(*mesh(faces)).tolist() == turned
    others = [f[::-1] for f in faces]
    assert turned_faces(*mesh(others)).tolist() == turned


def test_every_part_is_asked_by_itself():
    second = [tuple(v + 8 for v in f) for f in CUBE]
    second[2] = second[2][::-1]
    assert turned_faces(*mesh(CUBE + second)).tolist() == [8]
    assert islands(*mesh(CUBE + second)).tolist() == [0] * 6 + [1] * 6
    # Parts that look different ways as a whole are both in order.
    assert turned_faces(*mesh(CUBE + [f[::-1] for f in [tuple(v + 8 for v in f) for f in CUBE]])).tolist() == []


def test_a_strip_with_one_side_is_left_alone():
    ring = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(4)] + [(8, 9, 0, 1)]  # closed with half a turn
    assert turned_faces(*mesh(ring)).tolist() == []


def test_bent_faces():
    places = PLACES.copy()
    places[7] += [0.01, 0, 0]  # a corner of three faces, moved out of the planes of two
    assert bent_faces(places, *mesh(CUBE)).tolist() == [1]
    places[7] += [0, 0.01, 0.01]
    assert bent_faces(places, *mesh(CUBE)).tolist() == [1, 3, 5]
    assert bent_faces(1000 * places, *mesh(CUBE)).tolist() == [1, 3, 5]
    assert bent_faces(places, *mesh([(0, 1, 7), (0, 7, 3)])).tolist() == []


def test_a_face_without_area_is_not_bent():
    assert bent_faces(np.zeros((4, 3)), *mesh([(0, 1, 2, 3)])).tolist() == []
