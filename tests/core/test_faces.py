"""Faces of a mesh as planar polygons: every bit of area once."""

import numpy as np
import pytest
from enfilade.core.corners import face_area_vectors
from enfilade.core.faces import planar_faces


def planar(position, faces):
    """The polygons of faces, triangulated as fans (the first corner of the concave ones here sees all others)."""
    position = np.asarray(position, float)
    vertex = np.concatenate([np.asarray(f) for f in faces])
    start = np.cumsum([0] + [len(f) for f in faces])
    triangle = np.array([(start[f], start[f] + k, start[f] + k + 1) for f in range(len(faces)) for k in range(1, len(faces[f]) - 1)])
    owner = np.array([f for f in range(len(faces)) for _ in range(len(faces[f]) - 2)])
    out = planar_faces(position, vertex, start, triangle, owner)
    loops = [out.corner[a:b].tolist() for a, b in zip(out.start[:-1], out.start[1:], strict=True)]
    area = face_area_vectors(position, vertex[out.corner], out.start)
    return out, loops, area


SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_planar_convex_faces_stay_whole():
    out, loops, _ = planar([*SQUARE, [0.5, 0, 0]], [[0, 4, 1, 2, 3], [0, 3, 2]])
    assert loops == [[0, 1, 2, 3, 4], [5, 6, 7]]
    assert out.face.tolist() == [0, 1]
    assert out.triangle_polygon.tolist() == [0, 0, 0, 1]


def test_concave_and_bent_faces_become_triangles():
    dart = [[0, 0, 0], [3, 1, 0], [1, 1, 0], [1, 3, 0]]
    bent = [[5, 0, 0], [6, 0, 0], [6, 1, 0.1], [5, 1, 0]]
    out, loops, area = planar(dart + bent + [[x + 9, y, z] for x, y, z in SQUARE], [[0, 1, 2, 3], [8, 9, 10, 11], [4, 5, 6, 7]])
    assert out.face.tolist() == [0, 0, 1, 2, 2]
    assert [len(loop) for loop in loops] == [3, 3, 4, 3, 3]
    assert out.triangle_polygon.tolist() == [0, 1, 2, 2, 3, 4]
    assert area[:2].sum(0) == pytest.approx([0, 0, 2])
    assert area[3:].sum(0)[2] == pytest.approx(1)


def test_what_has_no_area_is_left_out():
    out, loops, _ = planar([*SQUARE, [2, 0, 0]], [[0, 1, 4], [0, 1, 2, 3]])
    assert loops == [[3, 4, 5, 6]]
    assert out.face.tolist() == [1]
    assert out.triangle_polygon.tolist() == [-1, 0, 0]


def test_a_star_is_not_taken_for_a_convex_polygon():
    turn = 2 * np.pi * np.arange(5) * 2 / 5
    _, loops, _ = planar(np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1), [range(5)])
    assert all(len(loop) == 3 for loop in loops)


def test_the_size_and_place_of_a_face_do_not_matter():
    for scale in (1e-3, 1.0, 1e3):
        bent = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.5e-4], [0, 1, 0]]) * scale + [1e4, -1e4, 7]
        assert len(planar(bent, [range(4)])[1]) == 1
        bent = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 5e-3], [0, 1, 0]]) * scale + [1e4, -1e4, 7]
        assert len(planar(bent, [range(4)])[1]) == 2


def test_no_faces():
    none = np.zeros(0, np.int64)
    out = planar_faces(np.zeros((0, 3)), none, np.zeros(1, np.int64), np.zeros((0, 3), np.int64), none)
    assert (len(out.face), len(out.corner), out.start.tolist()) == (0, 0, [0])
