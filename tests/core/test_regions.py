"""Merging of coplanar polygons, and the rectangles around what was merged."""

import numpy as np
import pytest
from enfilade.core.polygons import areas_and_centroids
from enfilade.core.regions import merge
from scenery import box, rectangle, rotation, scene_of


def wall_with_a_door(turn=None, offset=(0, 0, 0), cells=(6, 4), triangles=False):
    """A wall 6 x 4 m in cells, without the two cells of a door; corners of neighbours are shared by place alone."""
    turn = np.eye(3) if turn is None else turn
    faces = []
    dx, dy = 6 / cells[0], 4 / cells[1]
    for i in range(cells[0]):
        for j in range(cells[1]):
            if 2 <= i * dx < 3 and j * dy < 2:
                continue
            cell = rectangle((i * dx, j * dy, 0), (dx, 0, 0), (0, dy, 0))
            faces += [cell[[0, 1, 2]], cell[[0, 2, 3]]] if triangles else [cell]
    return [f @ turn.T + offset for f in faces]


def corners_of_frame(regions, g):
    w, h = regions.size[g]
    u, v = w * regions.u[g], h * regions.v[g]
    return regions.centre + regions.origin[g] + np.array([0 * u, u, u + v, v])


def assert_frames(regions):
    frame = np.stack([regions.u, regions.v, regions.normal], 1)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.tile(np.eye(3), (len(regions), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frame), 1, atol=1e-12)


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, -1e6, 2e5)], ids=["near", "far"])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("triangles", [False, True])
def test_a_wall_in_cells_is_one_region(triangles, turned, offset):
    turn = rotation(4) if turned else np.eye(3)
    regions = merge(scene_of(wall_with_a_door(turn, offset, triangles=triangles)))
    assert len(regions) == 1
    assert_frames(regions)
    assert regions.area[0] == pytest.approx(22, rel=1e-7)
    assert not regions.full[0]
    assert sorted(regions.size[0]) == pytest.approx([4, 6], rel=1e-7)
    assert regions.normal[0] == pytest.approx(turn[:, 2], abs=1e-9)
    low = corners_of_frame(regions, 0)
    expected = np.array([[0, 0, 0], [6, 0, 0], [6, 4, 0], [0, 4, 0]]) @ turn.T + offset
    distance = np.linalg.norm(low[:, None] - expected[None], axis=2)
    assert distance.min(1).max() < 1e-8 + 1e-9 * np.abs(offset).max()
    centroid = (24 * np.array([3, 2, 0]) - 2 * np.array([2.5, 1, 0])) / 22
    assert regions.centroid[0] + regions.centre == pytest.approx(centroid @ turn.T + offset, abs=1e-8)


def test_a_full_wall_is_a_single_piece():
    # What fills the door has the same corners as the cells around it, so that they have edges in common.
    door = [rectangle((2 + 0.5 * i, 0.5 * j, 0), (0.5, 0, 0), (0, 0.5, 0)) for i in range(2) for j in range(4)]
    regions = merge(scene_of(wall_with_a_door(cells=(12, 8), triangles=True) + door))
    assert len(regions) == 1
    assert regions.full[0]
    assert np.diff(regions.piece_start).tolist() == [1]
    assert regions.area[0] == pytest.approx(24)


@pytest.mark.parametrize("triangles", [False, True])
def test_pieces_cover_what_the_polygons_cover(triangles):
    turn, offset = rotation(8), np.array([3.0, -2, 1])
    regions = merge(scene_of(wall_with_a_door(turn, offset, triangles=triangles)))
    rng = np.random.default_rng(0)
    flat = rng.uniform((0, 0), (6, 4), (2000, 2))
    wall = ~((flat[:, 0] > 2) & (flat[:, 0] < 3) & (flat[:, 1] < 2))
    uv = regions.local(np.zeros(2000, int), np.column_stack([flat, np.zeros(2000)]) @ turn.T + offset)
    held = np.zeros(2000, int)
    for p, a, b, triangle in zip(regions.piece_origin, regions.piece_a, regions.piece_b, regions.piece_triangle, strict=True):
        s, t = np.linalg.solve(np.stack([a, b], 1), (uv - p).T)
        held += (s >= 0) & (t >= 0) & (s + t <= 1 if triangle else (s <= 1) & (t <= 1))
    np.testing.assert_array_equal(held, wall)
    if not triangles:
        assert len(regions.piece_origin) < 6


def test_local_and_world_are_inverse():
    regions = merge(scene_of([f @ rotation(2).T + 50 for f in box(high=(2, 3, 4))]))
    rng = np.random.default_rng(1)
    region = rng.integers(0, 6, 100)
    uv = rng.uniform(0, 1, (100, 2)) * regions.size[region]
    world = regions.world(region, uv) + regions.centre
    np.testing.assert_allclose(regions.local(region, world), uv, atol=1e-12)
    np.testing.assert_allclose(regions.local(region, world + 0.3 * regions.normal[region]), uv, atol=1e-12)


@pytest.mark.parametrize("angle", np.linspace(0, np.pi, 9)[:-1])
def test_the_rectangle_around_a_turned_rectangle_is_the_rectangle(angle):
    flat = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    corners = rectangle((0, 0, 0), (5, 0, 0), (0, 2, 0)) @ flat.T
    fan = [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    for polygons in ([corners], fan, [corners[::-1]]):
        regions = merge(scene_of(polygons))
        assert len(regions) == 1
        assert regions.full[0]
        assert sorted(regions.size[0]) == pytest.approx([2, 5], rel=1e-6)
        assert_frames(regions)


def test_the_rectangle_around_other_shapes_is_the_smallest_along_an_edge():
    rng = np.random.default_rng(5)
    for seed in range(20):
        points = rng.normal(size=(3, 2)) @ np.diag([3, 1])
        edges = np.roll(points, -1, 0) - points
        best = np.inf
        for e in edges / np.linalg.norm(edges, axis=1, keepdims=True):
            turned = points @ np.array([[e[0], -e[1]], [e[1], e[0]]])
            best = min(best, np.ptp(turned, axis=0).prod())
        regions = merge(scene_of([np.column_stack([points, np.zeros(3)]) @ rotation(seed).T]))
        assert regions.size[0].prod() == pytest.approx(best, rel=1e-5)


ADJACENT = [rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((1, 0, 0), (1, 0, 0), (0, 1, 0))]


def test_neighbours_merge_only_when_all_is_alike():
    assert merge(scene_of(ADJACENT)).polygon_region.tolist() == [0, 0]
    grey, dark = np.array([0.5, 0.5, 0.5]), np.array([0.5, 0.5, 0.4])
    assert merge(scene_of(ADJACENT, reflectance=np.stack([grey, dark]))).polygon_region.tolist() == [0, 1]
    assert merge(scene_of(ADJACENT, emission=np.stack([0 * grey, dark]))).polygon_region.tolist() == [0, 1]
    assert merge(scene_of(ADJACENT, room=[0, 1])).polygon_region.tolist() == [0, 1]
    assert merge(scene_of(ADJACENT, room=[1, 0])).polygon_region.tolist() == [1, 0]
    assert merge(scene_of(ADJACENT, object=[0, 1])).polygon_region.tolist() == [0, 1]


def test_neighbours_that_turn_away_or_lie_apart_do_not_merge():
    first = ADJACENT[0]
    for other in (
        ADJACENT[1][::-1],  # faces the other way
        rectangle((1, 0, 0), (1, 0, 0.01), (0, 1, 0)),  # bent by half a degree
        rectangle((1, 0, 2e-3), (1, 0, 0), (0, 1, 0)),  # a step of 2 mm
        rectangle((1.01, 0, 0), (1, 0, 0), (0, 1, 0)),  # a gap of 1 cm
        rectangle((1, 1, 0), (1, 0, 0), (0, 1, 0)),  # a common corner alone
    ):
        assert len(merge(scene_of([first, other]))) == 2


def test_corners_that_agree_but_for_rounding_are_the_same():
    other = ADJACENT[1] + [[1e-7, -1e-7, 0], [0, 0, 0], [0, 0, 0], [-1e-7, 1e-7, 1e-8]]
    assert len(merge(scene_of([ADJACENT[0], other]))) == 1


def test_four_walls_of_a_cross_merge_through_their_common_edge():
    # A floor crossed by a wall: the edge belongs to four faces, of which two and two lie in one plane.
    floor = [rectangle((-1, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))]
    wall = [rectangle((0, 0, -1), (0, 1, 0), (0, 0, 1)), rectangle((0, 0, 0), (0, 1, 0), (0, 0, 1))]
    regions = merge(scene_of([floor[0], wall[0], floor[1], wall[1]]))
    assert regions.polygon_region.tolist() == [0, 1, 0, 1]
    assert regions.area == pytest.approx([2, 2])


def test_faces_that_lie_upon_each_other_count_once():
    sheet = rectangle((0, 0, 0), (3, 0, 0), (0, 2, 0))
    regions = merge(scene_of([sheet, sheet, sheet[[0, 1, 2]]]))
    assert len(regions) == 1
    assert regions.area[0] == pytest.approx(6)
    assert regions.full[0]


@pytest.mark.parametrize("twice", [1, 3, 22])
def test_a_face_that_is_there_twice_fills_no_door(twice):
    wall = wall_with_a_door()
    assert len(wall) == 22
    regions = merge(scene_of(wall + wall[:twice]))
    assert len(regions) == 1
    assert not regions.full[0]
    assert regions.area[0] == pytest.approx(22)


def test_polygons_without_area_belong_to_no_region():
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    point = np.ones((4, 3))
    there_and_back = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 0, 0]])
    regions = merge(scene_of([line, *ADJACENT, point, there_and_back]))
    assert regions.polygon_region.tolist() == [-1, 0, 0, -1, -1]
    assert regions.area == pytest.approx([2])


def test_regions_are_ordered_by_room_and_keep_what_they_are_made_of():
    faces = [*box(), *box(low=(5, 0, 0), high=(7, 2, 2))]
    rng = np.random.default_rng(0)
    reflectance, emission = rng.random((12, 3)), rng.random((12, 3))
    room = rng.permutation(np.repeat([0, 1], 6))
    regions = merge(scene_of(faces, reflectance=reflectance, emission=emission, room=room))
    assert len(regions) == 12
    assert (np.diff(regions.room) >= 0).all()
    of = regions.polygon_region
    np.testing.assert_array_equal(regions.room[of], room)
    np.testing.assert_array_equal(regions.reflectance[of], reflectance)
    np.testing.assert_array_equal(regions.emission[of], emission)
    assert regions.area[of] == pytest.approx(np.repeat([1, 4], 6))
    assert_frames(regions)
    for g in range(12):
        corners = corners_of_frame(regions, g) - regions.centre
        np.testing.assert_allclose(regions.box_min[g], corners.min(0), atol=1e-12)
        np.testing.assert_allclose(regions.box_max[g], corners.max(0), atol=1e-12)


def test_a_polygon_with_a_hole_is_framed_by_its_outline():
    outer = rectangle((0, 0, 0), (4, 0, 0), (0, 3, 0))
    hole = rectangle((1, 1, 0), (1, 0, 0), (0, 1, 0))[::-1]
    regions = merge(scene_of([[outer, hole]]))
    assert regions.area[0] == pytest.approx(11)
    assert sorted(regions.size[0]) == pytest.approx([3, 4])
    assert not regions.full[0]
    cross = lambda a, b: np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])  # noqa: E731
    covered = cross(regions.piece_a, regions.piece_b) * np.where(regions.piece_triangle, 0.5, 1)
    assert covered.sum() == pytest.approx(11)


@pytest.mark.parametrize("turn", [np.eye(3), rotation(8)], ids=["upright", "turned"])
@pytest.mark.parametrize("third", [False, True])
def test_parts_that_lie_upon_each_other_count_once(turn, third):
    # Two strips that cross at one end share an edge, so that they are one region; a third lies upon both.
    strips = [
        rectangle((0, 0, 0), (1, 0, 0), (0, 3, 0)),
        rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)),
        rectangle((1, 0, 0), (2, 0, 0), (0, 1, 0)),
    ]
    union = 3 + 2
    if third:
        strips.append(np.array([(0, 3, 0), (0, 2, 0), (2, 0, 0), (2.0, 1, 0)]))
        strips.append(np.array([(0, 3, 0), (0, 2, 0), (1, 3, 0.0)]))
        union += 0.5  # the corner at (1, 2), (1, 1), (2, 1): beyond the strips, under the slant
    surfaces = merge(scene_of([s @ turn.T + 5 for s in strips]))
    assert len(surfaces) == 1
    assert surfaces.area[0] == pytest.approx(union, rel=1e-9)
    assert areas_and_centroids(surfaces.cover)[0].sum() == pytest.approx(union, rel=1e-9)
    assert not surfaces.full[0]


def test_triangles_upon_a_rectangle_leave_it_full():
    floor = rectangle((0, 0, 0), (4, 0, 0), (0, 3, 0))
    surfaces = merge(scene_of([floor, np.array([(0, 0, 0), (4, 0, 0), (2, 2, 0.0)]), np.array([(4, 0, 0), (4, 3, 0), (1, 1, 0.0)])]))
    assert len(surfaces) == 1
    assert surfaces.area[0] == pytest.approx(12)
    assert surfaces.full[0]
    assert len(surfaces.cover) == 1


def test_faces_in_one_place_are_one_surface():
    # Of other objects, materials and first corners, some of it a mesh in triangles: each shows the light of the one that counts.
    floor = rectangle((0, 0, 0), (4, 0, 0), (0, 3, 0))
    copies = [floor, np.roll(floor, 1, 0), np.roll(floor, 2, 0), floor[::-1]]
    other = rectangle((0, 0, 0), (4, 0, 0), (0, 0, 3))
    emission = np.zeros((6, 3))
    emission[1] = 7
    scene = scene_of(
        [*copies, other, floor], reflectance=np.linspace(0.1, 0.6, 6), emission=emission, object=np.arange(6), room=[0, 0, 0, 0, 0, 1]
    )
    surfaces = merge(scene)
    assert surfaces.polygon_region[[0, 2]].tolist() == [surfaces.polygon_region[1]] * 2
    assert len(surfaces) == 4
    lamp = surfaces.polygon_region[1]
    assert (surfaces.area[lamp], surfaces.emission[lamp, 0], surfaces.reflectance[lamp, 0]) == (pytest.approx(12), 7, pytest.approx(0.2))
    assert surfaces.normal[lamp].tolist() == [0, 0, 1]
    assert surfaces.normal[surfaces.polygon_region[3]].tolist() == [0, 0, -1]
    assert (surfaces.room[surfaces.polygon_region[5]], surfaces.area[surfaces.polygon_region[5]]) == (1, pytest.approx(12))
    assert len(surfaces.piece_origin) == 4
