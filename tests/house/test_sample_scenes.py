"""The sample scenes: closed rooms, furniture in its place, and .blend files that hold what the generators say."""

import math
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.scene_files import load_scene
from enfilade.sample_scenes import apartment, cornell, two_rooms
from enfilade.sample_scenes.model import to_scene

SAMPLES = Path(__file__).resolve().parents[2] / "sample_scenes"
MODELS = {"cornell": cornell.model, "two_rooms": two_rooms.model, "apartment": apartment.model}
SHELL = ("floor", "ceiling", "wall south", "wall north", "wall west", "wall east", "door frames", "windows")


def area_vectors(corners):
    """(n, 3) area times normal of (n, 4, 3) rectangles."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])


def shell(model, room):
    """(n, 4, 3) rectangles of a room's own boundary and of its portals, all with normals into the room."""
    faces = [panel.rectangles() for _, p, panel in model.panels() if p.room == room and p.name.endswith(SHELL)]
    for opening in model.openings:
        if room in opening.rooms:
            faces.append(opening.corners[None] if opening.rooms[1] == room else opening.corners[None, ::-1])
    return np.concatenate(faces)


@pytest.mark.parametrize("name", MODELS)
def test_rooms_and_their_portals_are_closed(name):
    """The area vectors of a closed surface add up to nothing, and its flux of x/3 is its volume wherever the origin is."""
    model = MODELS[name](1)
    for room in range(len(model.rooms)):
        corners = shell(model, room)
        vectors = area_vectors(corners)
        assert np.abs(vectors.sum(axis=0)).max() < 1e-9, model.rooms[room]
        volume = -(corners.mean(axis=1) * vectors).sum() / 3
        floor = next(p for p in model.pieces if p.room == room and p.name.endswith("floor")).panels[0]
        height = next(p for p in model.pieces if p.room == room and p.name.endswith("wall south")).panels[0].size[1]
        tunnels = volume - floor.size[0] * floor.size[1] * height
        assert -1e-9 < tunnels < 2.0, model.rooms[room]


@pytest.mark.parametrize("name", MODELS)
def test_portals_look_from_the_first_room_into_the_second(name):
    model = MODELS[name](1)
    for opening in model.openings:
        a, b = (shell(model, room).reshape(-1, 3).mean(axis=0) for room in opening.rooms)
        assert np.dot(area_vectors(opening.corners[None])[0], b - a) > 0, opening.name


@pytest.mark.parametrize("name", MODELS)
def test_furniture_stands_inside_its_room(name):
    model = MODELS[name](1)
    for piece in (p for p in model.pieces if not p.name.endswith(SHELL)):
        floor = next(p for p in model.pieces if p.room == piece.room and p.name.endswith("floor")).panels[0]
        low, high = floor.origin, floor.origin + floor.along + floor.across
        corners = np.concatenate([panel.rectangles() for panel in piece.panels]).reshape(-1, 3)
        assert (corners[:, :2] > low[:2]).all(), piece.name
        assert (corners[:, :2] < high[:2]).all(), piece.name
        assert corners[:, 2].min() >= 0, piece.name


def test_grids_have_the_area_of_the_panels_and_no_long_edge():
    for _, _, panel in apartment.model(1).panels():
        cells = panel.cells(0.2)
        edges = np.linalg.norm(cells - np.roll(cells, 1, axis=1), axis=2)
        assert edges.max() < 0.2 + 1e-9
        assert np.linalg.norm(area_vectors(cells), axis=1).sum() == pytest.approx(
            np.linalg.norm(area_vectors(panel.rectangles()), axis=1).sum(), rel=1e-9
        )


def test_the_seed_moves_the_books():
    one, same, other = (to_scene(apartment.model(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one.vertices, same.vertices)
    assert one.vertices.shape != other.vertices.shape or not np.array_equal(one.vertices, other.vertices)


def test_the_study_has_no_lamp():
    scene = to_scene(apartment.model(1))
    lit = {scene.room_names[r] for r in scene.room[scene.emission.any(axis=1)]}
    assert lit == set(scene.room_names) - {"Study"}


def test_no_sample_is_large():
    assert all(path.stat().st_size < 2**20 for path in SAMPLES.iterdir() if path.is_file())


def scene_of(name):
    return to_scene(MODELS[name](1)) if name in MODELS else load_scene(SAMPLES / f"{name}.json")


def polygon_areas(scene):
    """(P,) areas of convex polygons without holes."""
    corners = np.split(scene.vertices[scene.corner_vertex], scene.loop_start[1:-1])
    return np.array([np.linalg.norm(np.cross(c[1:-1] - c[0], c[2:] - c[0]).sum(axis=0)) / 2 for c in corners])


@pytest.mark.parametrize("name", [*MODELS, "duplex"])
def test_blend_files_hold_what_their_generators_say(name):
    """Rooms, portals, area and emitted power of every room of the committed file."""
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / f"{name}.blend"), load_ui=False)
    scene = scene_of(name)
    rooms = bpy.data.collections["Rooms"].children
    assert {room.name for room in rooms} == set(scene.room_names)
    assert sum(len(o.data.polygons) for o in bpy.data.collections["Portals"].objects) == len(scene.portals)
    area, power = polygon_areas(scene), scene.emission.mean(axis=1)
    for number, room in enumerate(scene.room_names):
        meshes = [thing.data for thing in rooms[room].objects]
        here = scene.room == number
        assert sum(p.area for m in meshes for p in m.polygons) == pytest.approx(area[here].sum(), rel=1e-4), room
        emitted = sum(p.area * exitance(m.materials[p.material_index]) for m in meshes for p in m.polygons)
        assert emitted == pytest.approx((area * power)[here].sum(), rel=1e-4, abs=1e-9), room
    assert bpy.context.scene.camera is not None


def exitance(material):
    """Mean of the three channels, W/m2: pi times radiance."""
    node = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    return math.pi * node.inputs["Emission Strength"].default_value * sum(node.inputs["Emission Color"].default_value[:3]) / 3
