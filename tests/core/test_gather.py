"""Light gathered by rays against form factors known exactly."""

import numpy as np
import pytest
from enfilade.core import basis, gather, transport
from enfilade.core.elements import Forest
from enfilade.core.exitance_map import MOST, ExitanceMap, exitance_map
from enfilade.core.regions import merge
from scenery import box, building_of, crew, portals_of, rectangle, rotation, scene_of


def painted(building, bright) -> ExitanceMap:
    """Exitance 1 W/m2 on the regions ``bright``, none elsewhere."""
    count = len(building.regions.piece_region)
    ones = np.ones(count, np.int32)
    light = np.isin(building.regions.piece_region, bright).astype(np.float32)
    light = np.repeat(light[:, None], 3, 1)
    return ExitanceMap.of(np.arange(count), ones, ones, light, light, 0 * light, 0.0)


def gathered(building, exitance, points, region, rays=1024, workers=1):
    local = (points - building.regions.centre).astype(np.float32)
    out = np.full((len(points), 3), np.nan, np.float32)
    for part in gather.gather(building, exitance, local, region, rays, crew(workers)):
        out[part.index] = part.irradiance
    return out


def on_regions(building, count, seed=0, regions=None):
    """Random points on rectangular regions."""
    rng = np.random.default_rng(seed)
    region = rng.choice(np.arange(len(building.regions)) if regions is None else regions, count)
    uv = rng.uniform(0.02, 0.98, (count, 2)) * building.regions.size[region]
    return building.regions.world(region, uv) + building.regions.centre, region


def two_rooms(turn=None, door=((0.3, 0.1), (0.7, 0.8))):
    """Two cubes of 1 m side by side along x, and a door between them; the walls around the door are in either room."""
    (y0, z0), (y1, z1) = door
    turn = np.eye(3) if turn is None else turn
    polygons, room = [], []
    for k, (leave, flip) in enumerate((("x+", True), ("x-", False))):
        faces = [f + [k, 0, 0] for f in box(leave_out=leave)]
        parts = [
            rectangle((1, 0, 0), (0, y0, 0), (0, 0, 1)),
            rectangle((1, y1, 0), (0, 1 - y1, 0), (0, 0, 1)),
            rectangle((1, y0, 0), (0, y1 - y0, 0), (0, 0, z0)),
            rectangle((1, y0, z1), (0, y1 - y0, 0), (0, 0, 1 - z1)),
        ]
        faces += [p[::-1] if flip else p for p in parts]
        polygons += faces
        room += [k] * len(faces)
    portal = rectangle((1, y0, z0), (0, y1 - y0, 0), (0, 0, z1 - z0))
    return scene_of([p @ turn.T for p in polygons], room=room, portals=portals_of([portal @ turn.T], [(0, 1)]))


def test_everything_bright_is_one():
    polygons = [f @ rotation(1).T for f in (*box(high=(4, 3, 2.5)), *box((1, 1, 0), (2, 2.2, 0.7), inward=False, leave_out="z-"))]
    building = building_of(scene_of(polygons))
    everything = painted(building, np.arange(len(building.regions)))
    points, region = on_regions(building, 500)
    inside = ((points @ rotation(1) > [1.001, 1.001, -1]) & (points @ rotation(1) < [1.999, 2.199, 0.69])).all(1)  # the floor in the box
    found = gathered(building, everything, points, region, 256)
    np.testing.assert_allclose(found[~inside], 1, atol=1e-5)


def test_one_wall_is_its_form_factor():
    building = building_of(scene_of(box(high=(4, 3, 2.5))))
    points, region = on_regions(building, 400, regions=np.arange(1, 6))
    wall = building.regions
    corners = np.stack(
        [wall.origin[0] + s * wall.size[0, 0] * wall.u[0] + t * wall.size[0, 1] * wall.v[0] for s, t in ((0, 0), (1, 0), (1, 1), (0, 1))]
    )
    exact = transport.lambert(points - wall.centre, wall.normal[region], np.broadcast_to(corners, (400, 4, 3)))
    errors = [np.sqrt(((gathered(building, painted(building, [0]), points, region, n)[:, 0] - exact) ** 2).mean()) for n in (64, 1024)]
    assert errors[1] < 0.005
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize("seed", [None, 3])
@pytest.mark.parametrize("lit", [0, 1])
def test_a_wall_seen_through_a_door_is_what_the_door_shows_of_it(seed, lit):
    # Exact: the door, projected from the point onto the far wall, is the part of it that lights the point.
    turn = np.eye(3) if seed is None else rotation(seed)
    (y0, z0), (y1, z1) = (0.3, 0.1), (0.7, 0.8)
    building = building_of(two_rooms(turn))
    regions = building.regions
    normal = regions.normal @ turn
    x = (regions.centroid + regions.centre) @ turn
    far = np.flatnonzero((regions.room == lit) & (np.abs(normal[:, 0]) > 0.9) & (np.abs(x[:, 0] - 2 * lit) < 1e-6))
    assert len(far) == 1
    points, region = on_regions(building, 300, regions=np.flatnonzero(regions.room != lit))
    p = points @ turn
    keep = np.abs(p[:, 0] - 1) > 0.02
    points, region, p = points[keep], region[keep], p[keep]
    scale = (2 * lit - p[:, 0]) / (1 - p[:, 0])
    corners = []
    for y, z in ((y0, z0), (y1, z0), (y1, z1), (y0, z1)):
        q = p + scale[:, None] * (np.array([1, y, z]) - p)
        corners.append(np.clip(q, [-9, 0, 0], [9, 1, 1]))
    exact = transport.lambert(p, normal[region], np.stack(corners, 1))
    found = gathered(building, painted(building, far), points, region)[:, 0]
    assert np.sqrt(((found - exact) ** 2).mean()) < 0.004
    assert abs(found.mean() / exact.mean() - 1) < 0.01
    # Both ways to look through the door are taken.
    door = transport.lambert(p, normal[region], np.broadcast_to([(1, y0, z0), (1, y1, z0), (1, y1, z1), (1, y0, z1)], (len(p), 4, 3)))
    assert 0.02 < (door > gather.NEAR).mean() < 0.9


def test_both_rooms_bright_is_one():
    building = building_of(two_rooms())
    points, region = on_regions(building, 600)
    found = gathered(building, painted(building, np.arange(len(building.regions))), points, region)
    # What the rays of the hemisphere miss in the door the rays to the door find.
    assert abs(found.mean() - 1) < 1e-3
    assert np.abs(found - 1).max() < 0.04


def test_a_ring_of_rooms_sees_around_the_corner_and_a_room_apart_sees_itself():
    # Four cubes in a square, each with a wide door to the next, and a fifth far away: all bright is one everywhere.
    polygons, room, doors, pairs = [], [], [], []
    cells = [(0, 0), (1, 0), (1, 1), (0, 1), (5, 5)]
    for k, (i, j) in enumerate(cells):
        open_ = [] if k == 4 else ["x+" if i == 0 else "x-", "y+" if j == 0 else "y-"]
        faces = [f + [i, j, 0] for f in box(leave_out=" ".join(open_))]
        polygons += faces
        room += [k] * len(faces)
    for a, b in ((0, 1), (3, 2)):
        doors.append(rectangle((1, cells[a][1], 0), (0, 1, 0), (0, 0, 1)))
        pairs.append((a, b))
    for a, b in ((0, 3), (1, 2)):
        doors.append(rectangle((cells[a][0], 1, 0), (0, 0, 1), (1, 0, 0)))
        pairs.append((a, b))
    building = building_of(scene_of(polygons, room=room, portals=portals_of(doors, pairs)))
    points, region = on_regions(building, 500)
    found = gathered(building, painted(building, np.arange(len(building.regions))), points, region)
    assert abs(found.mean() - 1) < 2e-3
    assert np.abs(found - 1).max() < 0.06


def test_backs_are_black():
    floor, plate = rectangle((0, 0, 0), (2, 0, 0), (0, 2, 0)), rectangle((0, 0, 1), (2, 0, 0), (0, 2, 0))
    building = building_of(scene_of([floor, plate]))
    points, region = on_regions(building, 20, regions=[0])
    assert not gathered(building, painted(building, [0, 1]), points, region, 64).any()


def test_the_same_bits_on_any_number_of_threads():
    building = building_of(two_rooms())
    points, region = on_regions(building, 3000)
    bright = painted(building, [0, 8])
    np.testing.assert_array_equal(gathered(building, bright, points, region, 64), gathered(building, bright, points, region, 64, workers=3))


def test_nobody_and_nothing():
    building = building_of(scene_of([rectangle((0, 0, 0), (2, 0, 0), (0, 2, 0))]))
    assert gathered(building, painted(building, []), np.zeros((0, 3)), np.zeros(0, int)).shape == (0, 3)
    points, region = on_regions(building, 5)
    assert not gathered(building, painted(building, [0]), points, region, 64).any()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_map_holds_the_function_of_the_elements(order):
    triangle = np.array([(0, 0, 0), (2, 0, 0), (0, 1, 0.0)])
    regions = merge(scene_of([rectangle((0, 0, 0), (3, 0, 0), (0, 2, 0)), triangle + [5, 0, 1]]))
    forest = Forest(regions, order)
    for _ in range(3):
        forest.split(np.flatnonzero(forest.leaf))
    light = np.random.default_rng(0).uniform(0.5, 1, (len(forest), forest.functions, 3)).astype(np.float32)
    light[:, 1:] *= 0.1
    half = forest.pull(np.where(forest.leaf[:, None, None], 0.5 * light, 0))
    light = forest.pull(np.where(forest.leaf[:, None, None], light, 0))
    found = exitance_map(regions, forest, half, light - half, 0.05)
    rng = np.random.default_rng(1)
    piece, s, t = rng.integers(0, len(found.start), 400), *rng.random((2, 400))
    inside = ~regions.piece_triangle[piece] | (s + t < 0.9)
    piece, s, t = piece[inside], s[inside], t[inside]
    texel = found.texel(piece, s, t)
    # The middle of the texel is where the function is taken.
    middle = [(np.minimum(np.floor(x * n), n - 1) + 0.5) / n for x, n in ((s, found.width[piece]), (t, found.height[piece]))]
    uv = regions.piece_origin[piece] + middle[0][:, None] * regions.piece_a[piece] + middle[1][:, None] * regions.piece_b[piece]
    element, local = forest.locate(regions.piece_region[piece], uv)
    reflectance = regions.reflectance[regions.piece_region[piece]]
    exact = np.einsum("nm,nmc->nc", basis.evaluate(order, local), light[element]) * reflectance
    np.testing.assert_allclose(found.all_of(texel), exact, rtol=2**-11 + 1e-5)
    np.testing.assert_allclose(found.direct_of(texel), 0.5 * exact, rtol=2**-11 + 2e-5)
    np.testing.assert_allclose(found.reflectance[piece], reflectance, atol=1e-6)
    assert max(found.width.max(), found.height.max()) <= MOST


def narrow(reflectance, wrong):
    """A closed slit of 2 cm whose surfaces each make 0.5 of the light of luminaires, and a map in which all else is ``wrong``."""
    building = building_of(scene_of(box(high=(2, 2, 0.02)), reflectance=reflectance))
    count = len(building.regions.piece_region)
    ones, light = np.ones(count, np.int32), np.full((count, 3), np.float32(0.5))
    return building, ExitanceMap.of(
        np.arange(count), ones, ones, 0 * light + np.float32(wrong), light, 0 * light + np.float32(reflectance), 1.0
    )


def test_paths_in_a_slit_do_not_believe_the_map():
    building, exitance = narrow(0.5, 3.0)
    rng = np.random.default_rng(3)
    floor = np.flatnonzero(building.regions.normal[:, 2] > 0.9)
    points = np.column_stack([rng.uniform(0.5, 1.5, (50, 2)), np.zeros(50)])
    found = gathered(building, exitance, points, np.repeat(floor, 50), 256)
    # Five surfaces with 0.5 of their own light, each half of what the next sends, and the map at the sixth; a path that
    # meets one of the four narrow sides believes the map there.
    exact = 0.5 * sum(0.5**k for k in range(5)) + 0.5**5 * 3.0
    np.testing.assert_allclose(found.mean(), exact, rtol=0.04)
    assert found.mean() > exact


def test_paths_change_nothing_where_the_map_is_right():
    building, exitance = narrow(0.5, 1.0)  # B = 0.5 + 0.5 B
    floor = np.flatnonzero(building.regions.normal[:, 2] > 0.9)
    points = np.column_stack([np.linspace(0.01, 1.99, 40), np.linspace(0.3, 1.2, 40), np.zeros(40)])
    np.testing.assert_allclose(gathered(building, exitance, points, np.repeat(floor, 40), 256), 1.0, rtol=2e-3)


def test_paths_leave_a_slit_through_a_portal():
    """Two halves of the slit: the light is the same as without the portal between them."""
    parts = [*box(high=(1, 2, 0.02)), *box(low=(1, 0, 0), high=(2, 2, 0.02))]
    walls = [p for p in parts if not np.allclose(p[:, 0], 1)]
    room = [int(p[:, 0].mean() > 1) for p in walls]
    door = rectangle((1, 0, 0), (0, 2, 0), (0, 0, 0.02))
    building = building_of(scene_of(walls, reflectance=0.5, room=room, portals=portals_of([door], [(0, 1)])))
    count = len(building.regions.piece_region)
    ones, light = np.ones(count, np.int32), np.full((count, 3), np.float32(0.5))
    exitance = ExitanceMap.of(np.arange(count), ones, ones, 2 * light, light, light, 1.0)
    points = np.column_stack([np.linspace(0.01, 0.99, 40), np.linspace(0.3, 1.2, 40), np.zeros(40)])
    region = np.flatnonzero((building.regions.normal[:, 2] > 0.9) & (building.regions.room == 0))
    # Of the 256 rays a portal stops a whole number, not just its form factor of them: up to one in a hundred near it.
    np.testing.assert_allclose(gathered(building, exitance, points, np.repeat(region, 40), 256), 1.0, rtol=1e-2)
