"""Scene files: what is written loads back equal, what is damaged is named in one sentence."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.lamps import AreaLamps, Lamps, PointLamps, Suns
from enfilade.core.scene import EvaluationPoints, Portals, Scene, SceneError
from enfilade.core.scene_files import load_scene, save_scene

DATA = Path(__file__).resolve().parents[1] / "data" / "scenes"


def neutral_arrays():
    """One quad, one triangle, two rooms, one door, one point."""
    return {
        "verts": np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.3, 0.1, 2]], np.float32),
        "polys": np.array([[0, 1, 2, 3], [4, 1, 2, -1]], np.int32),
        "rho": np.full((2, 3), 0.5, np.float32),
        "emit": np.array([[0, 0, 0], [1, 2, 3]], np.float32),
        "room": np.array([0, 1], np.int32),
        "portals": np.arange(12, dtype=np.float32).reshape(1, 4, 3),
        "portal_rooms": np.array([[0, 1]], np.int32),
        "pts": np.array([[0.5, 0.5, 0]], np.float32),
        "pts_n": np.array([[0, 0, 1]], np.float32),
        "pts_poly": np.array([0], np.int32),
        "pts_area": np.array([1], np.float32),
        "meta": np.array('{"name": "two faces"}'),
    }


def write(path, **changes):
    arrays = {**neutral_arrays(), **changes}
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def general_scene():
    """A pentagon with a triangular hole, a triangle, two rooms and a triangular portal; nothing is exact in float32."""
    rng = np.random.default_rng(3)
    return Scene(
        name="Kafé ü",
        vertices=rng.random((9, 3)),
        corner_vertex=np.array([0, 1, 2, 3, 4, 5, 6, 7, 1, 8, 2], np.int32),
        loop_start=np.array([0, 5, 8, 11], np.int64),
        polygon_start=np.array([0, 2, 3], np.int64),
        reflectance=rng.random((2, 3)),
        emission=rng.random((2, 3)),
        room=np.array([0, 1], np.int32),
        object=np.array([1, 0], np.int32),
        room_names=("Küche", "hall"),
        object_names=("table", "wall"),
        portals=Portals(rng.random((3, 3)), np.array([0, 3], np.int64), np.array([[0, -1]], np.int32), ("hatch",)),
        points=EvaluationPoints(rng.random((4, 3)), rng.random((4, 3)), np.array([0, 0, 1, 1], np.int32)),
    )


def assert_equal(a, b):
    for name, value in vars(a).items():
        other = getattr(b, name)
        if isinstance(value, np.ndarray):
            assert value.dtype == other.dtype, name
            np.testing.assert_array_equal(value, other, err_msg=name)
        elif isinstance(value, Portals | EvaluationPoints | Lamps | AreaLamps | PointLamps | Suns):
            assert_equal(value, other)
        else:
            assert value == other, name


def test_neutral_npz_gives_loops_rooms_portals_and_points(tmp_path):
    scene = load_scene(write(tmp_path / "s.npz"))
    assert scene.name == "two faces"
    assert scene.corner_vertex.tolist() == [0, 1, 2, 3, 4, 1, 2]
    assert scene.loop_start.tolist() == [0, 4, 7]
    assert scene.polygon_start.tolist() == [0, 1, 2]
    assert scene.room_names == ("room 0", "room 1")
    assert scene.portals.rooms.tolist() == [[0, 1]]
    np.testing.assert_array_equal(scene.portals.polygon(0), np.arange(12).reshape(4, 3))
    assert scene.points.polygon.tolist() == [0]
    assert scene.emission[1].tolist() == [1, 2, 3]
    assert (scene.vertices.dtype, scene.room.dtype, scene.loop_start.dtype) == (np.float64, np.int32, np.int64)


def test_saved_quads_keep_the_neutral_keys_and_dtypes(tmp_path):
    scene = load_scene(write(tmp_path / "s.npz"))
    save_scene(scene, tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz", allow_pickle=False) as saved:
        for key, value in neutral_arrays().items():
            if key not in ("meta", "pts_area"):
                assert saved[key].dtype == value.dtype, key
                np.testing.assert_array_equal(saved[key], value, err_msg=key)
    assert_equal(scene, load_scene(tmp_path / "t.npz"))


def test_polygons_with_holes_and_any_portal_load_back_equal(tmp_path):
    scene = general_scene()
    save_scene(scene, tmp_path / "s.npz")
    assert_equal(scene, load_scene(tmp_path / "s.npz"))
    assert os.listdir(tmp_path) == ["s.npz"]


def test_portals_and_points_may_be_left_out(tmp_path):
    left_out = dict.fromkeys(("portals", "portal_rooms", "pts", "pts_n", "pts_poly", "pts_area", "meta"))
    scene = load_scene(write(tmp_path / "bare.npz", **left_out))
    assert (len(scene.portals), scene.points, scene.name) == (0, None, "bare")


def test_building_json():
    scene = load_scene(DATA / "fzk-haus.json")
    assert (scene.name, scene.polygon_count, scene.room_count, len(scene.portals)) == ("fzk-haus", 247, 7, 20)
    assert scene.room_names[0] == "4 Schlafzimmer"
    assert (scene.portals.rooms == -1).any(axis=1).sum() == 13
    assert scene.points is None
    assert scene.object_names[scene.object[0]] == "floor of 4 Schlafzimmer"
    # The area that the file's own notes give for the building: 673 m2 (Newell's formula over every loop).
    here = scene.vertices[scene.corner_vertex]
    following = np.arange(1, len(here) + 1)
    following[scene.loop_start[1:] - 1] = scene.loop_start[:-1]
    area = np.linalg.norm(np.add.reduceat(np.cross(here, here[following]), scene.loop_start[:-1]), axis=1) / 2
    assert area.sum() == pytest.approx(673, abs=1)


def test_probes_of_a_building_become_points_on_their_polygons():
    scene = load_scene(DATA / "cie171-5.3.json")
    probes = json.loads((DATA / "cie171-5.3.json").read_text())["probes"]
    assert len(scene.points.polygon) == len(probes) == 14
    for point, normal, polygon in zip(scene.points.position, scene.points.normal, scene.points.polygon, strict=True):
        loop = scene.corner_vertex[scene.loop_start[polygon] : scene.loop_start[polygon + 1]]
        corners = scene.vertices[loop]
        axis = int(np.argmax(np.abs(normal)))
        assert np.allclose(corners[:, axis], point[axis])
        assert (corners.min(axis=0) <= point + 1e-9).all()
        assert (corners.max(axis=0) >= point - 1e-9).all()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"room": None}, "the array 'room' is missing"),
        ({"polys": None}, "the array 'polys' is missing"),
        ({"verts": np.zeros((4, 2), np.float32)}, "the array 'verts' has shape (4, 2) where (any, 3) is due"),
        ({"rho": np.full((2, 3), "red")}, "the array 'rho' holds <U3 where numbers are due"),
        ({"polys": np.zeros((2, 4), np.float32)}, "the array 'polys' holds float32 where whole numbers are due"),
        ({"room": np.array([0, 1 << 40])}, "the array 'room' holds a number that is no index"),
        ({"room": np.zeros(3, np.int32)}, "the array 'room' has shape (3,) where (2) is due"),
        ({"portals": np.zeros((2, 4, 3))}, "the array 'portals' has shape (2, 4, 3) where (1, 4, 3) is due"),
        ({"rho": np.array([[{}]], dtype=object)}, "the array 'rho' holds object where numbers or texts are due"),
        ({"portal_names": np.array(["a", "b"])}, "portal_names has 2 texts for 1 portals"),
    ],
)
def test_a_wrong_array_is_named(tmp_path, changes, says):
    path = write(tmp_path / "bad.npz", **changes)
    with pytest.raises(SceneError) as error:
        load_scene(path)
    assert says in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("key", "value"), [("loop_start", [0, 9, 8, 11]), ("loop_start", [0, 5, 8, 12]), ("polygon_start", [1, 2, 3]), ("portal_start", [0, 2])]
)
def test_broken_offsets_are_named(tmp_path, key, value):
    save_scene(general_scene(), tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as saved:
        arrays = dict(saved)
    np.savez(tmp_path / "s.npz", **{**arrays, key: np.array(value)})
    with pytest.raises(SceneError, match=f"'{key}' must rise from 0"):
        load_scene(tmp_path / "s.npz")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_truncated_npz(tmp_path, share):
    path = write(tmp_path / "cut.npz")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(SceneError, match=r"cut\.npz: the file is damaged or not an \.npz archive"):
        load_scene(path)


def test_every_flipped_byte_gives_a_scene_or_a_scene_error(tmp_path):
    path = write(tmp_path / "flip.npz")
    content = path.read_bytes()
    refused = []
    for at in np.random.default_rng(5).choice(len(content), 150, replace=False):
        path.write_bytes(content[:at] + bytes([content[at] ^ 0x55]) + content[at + 1 :])
        try:
            load_scene(path)
        except SceneError as error:
            refused.append(str(error))
    assert len(refused) > 50
    assert not any("\n" in message for message in refused)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.npz", b"no archive at all", "damaged or not an .npz archive"),
        ("a.json", b'{"format": "rooms-portals-scene", "version": 1', "damaged or not JSON"),
        ("a.json", b"\xff\xfe\x00", "cannot be read"),
        ("a.json", b"[]", "does not say that it is"),
        ("a.json", b'{"format": "rooms-portals-scene", "version": 2}', "version 2 of the format is not known"),
        ("a.json", b'{"format": "rooms-portals-scene", "version": 1}', "the entry 'polygons' is missing"),
        ("a.obj", b"", "ends in .npz or .json"),
    ],
)
def test_files_that_are_no_scene(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / name)
    assert says in str(error.value)
    assert name in str(error.value)


def test_bare_array_file_under_the_wrong_name(tmp_path):
    with (tmp_path / "a.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    with pytest.raises(SceneError, match="damaged or not an"):
        load_scene(tmp_path / "a.npz")


def test_missing_file_and_folder(tmp_path):
    for path in (tmp_path / "none.npz", tmp_path):
        with pytest.raises(SceneError, match="there is no such file"):
            load_scene(path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["polygons"][3].update(mat=99), "polygon 3 has material 99"),
        (lambda d: d["polygons"][5].update(v=[]), "polygon 5 has no corners"),
        (lambda d: d["polygons"][5].update(v=[0, 1, 2**31]), "a number is too large for an index"),
        (lambda d: d["polygons"][5].update(room=2**40), "a number is too large for an index"),
        (lambda d: d["vertices"].__setitem__(7, [0, float("inf"), 0]), "the position of vertex 7 is no finite number"),
        (lambda d: d["vertices"].__setitem__(7, [0, 1e300, 0]), "the position of vertex 7 is no finite number"),
        (lambda d: d["polygons"][5].update(v=[0, 1, 2.5]), "a vertex index is not a whole number"),
        (lambda d: d["polygons"][5].pop("room"), "the entry 'room' is missing"),
        (lambda d: d["portals"][7]["v"].append(10**6), "portal 7 has vertex 1000000"),
        (lambda d: d["vertices"].append([0, "x", 0]), "an entry has a wrong form"),
        (lambda d: d["vertices"].append([0, 1]), "an entry has a wrong form"),
        (lambda d: d.update(rooms=3), "an entry has a wrong form"),
    ],
)
def test_wrong_entries_of_a_building_are_named(tmp_path, change, says):
    document = json.loads((DATA / "fzk-haus.json").read_text())
    change(document)
    (tmp_path / "house.json").write_text(json.dumps(document))
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / "house.json")
    assert says in str(error.value)


def test_probe_in_mid_air_is_named(tmp_path):
    document = json.loads((DATA / "cie171-5.3.json").read_text())
    document["probes"][2]["point"] = [2, 1, 1]
    (tmp_path / "room.json").write_text(json.dumps(document))
    with pytest.raises(SceneError, match=r"probe 'C' at \[2, 1, 1\] lies on no polygon"):
        load_scene(tmp_path / "room.json")


def test_unwritable_output_leaves_nothing(tmp_path):
    scene = general_scene()
    with pytest.raises(SceneError, match="cannot be written"):
        save_scene(scene, tmp_path / "no folder" / "s.npz")
    (tmp_path / "s.npz").mkdir()
    with pytest.raises(SceneError, match="cannot be written"):
        save_scene(scene, tmp_path / "s.npz")
    with pytest.raises(SceneError, match=r"ends in \.npz"):
        save_scene(scene, tmp_path / "s.txt")
    assert os.listdir(tmp_path) == ["s.npz"]
