"""Scenes on disk: the neutral ``.npz`` (read and written) and the building ``.json`` (read).

``.npz`` keys, all plain arrays:

=================  ==========  ==================================================================================
``verts``          (V, 3)      vertex positions, metres
``polys``          (P, 4)      vertex indices, counter-clockwise from the front; triangles have -1 in column 3
``rho``            (P, 3)      diffuse reflectance, linear RGB
``emit``           (P, 3)      emitted radiant exitance of the front, W/m2
``room``           (P,)        room index
``portals``        (K, 4, 3)   corners of rectangular portals, metres
``portal_rooms``   (K, 2)      the two rooms of each portal, -1 is the outside
``pts, pts_n``     (N, 3)      evaluation points and unit normals; ``pts_poly`` (N,) their polygons (all three optional)
``meta``           text        JSON object, ``name`` is the scene's name (optional)
=================  ==========  ==================================================================================

What these keys cannot hold has keys of its own, written only where a scene needs them: polygons with more than
four corners or with holes put ``corner_vertex``, ``loop_start`` and ``polygon_start`` (as in :class:`Scene`) in the
place of ``polys``, so that a reader of the plain form stops instead of showing a wrong scene; portals other than
four-sided ones put ``portal_vertices`` and ``portal_start`` in the place of ``portals``; ``portal_depth`` (K,) holds how
far bent openings lie from the planes of their polygons, metres; ``portal_transmittance`` (K,) what their
glass lets through; ``object``, ``object_names``, ``room_names`` and ``portal_names`` hold what the names say; lamps, sun and
sky have the keys of :mod:`lamp_files`, light groups those of :mod:`light_group_files`. Numbers are written as float32 where
that loses nothing and as float64 otherwise, so a saved scene loads back equal.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .lamp_files import lamp_arrays, read_lamps
from .light_group_files import group_arrays, read_groups
from .npz_files import DamagedFile, read_arrays, write_arrays
from .scene import EvaluationPoints, Portals, Scene, SceneError
from .scene_checks import FARTHEST

PROBE_TOLERANCE = 1e-3
"""A probe of a building file belongs to a polygon no farther away than this, metres."""

MOST_EMPTY_ROOMS = 100_000
"""Rooms without polygons and portals that the numbers of rooms in a file may leave between them."""


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a ``.npz`` or ``.json`` file.

    Only the form of the file is checked here; what the numbers mean (indices, NaN, portals) is the work of
    ``scene_checks.check``. Raises :class:`SceneError` with one sentence that names the file and what is wrong with it.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f"{path}: there is no such file")
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _load_npz(path)
    if suffix == ".json":
        return _load_json(path)
    raise SceneError(f"{path}: a scene file ends in .npz or .json")


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene to a ``.npz`` file; the file appears whole or not at all.

    Raises :class:`SceneError` when the name does not end in ``.npz`` or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise SceneError(f"{path}: a scene is saved to a file that ends in .npz")
    arrays = _npz_arrays(scene)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            with part.open("wb") as stream:
                write_arrays(stream, arrays)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise SceneError(f"{path}: cannot be written ({error.strerror})") from error


# ---------------------------------------------------------------------------------------------------------- npz


def _load_npz(path: Path) -> Scene:
    try:
        arrays = read_arrays(path)
    except DamagedFile as error:
        raise SceneError(f"{path}: the file is damaged or not an .npz archive ({error})") from error
    reader = _Arrays(path, arrays)

    if "polys" in arrays:
        polys = reader.integers("polys", (None, 4))
        used = np.ones(polys.shape, bool)
        used[:, 3] = polys[:, 3] != -1
        corner_vertex = polys[used]
        loop_start = _offsets(used.sum(axis=1))
        polygon_start = np.arange(len(polys) + 1)
    else:
        corner_vertex = reader.integers("corner_vertex", (None,), instead_of="polys")
        loop_start = reader.starts("loop_start", len(corner_vertex))
        polygon_start = reader.starts("polygon_start", len(loop_start) - 1)
    count = len(polygon_start) - 1

    room = reader.integers("room", (count,))
    portal_rooms = reader.integers("portal_rooms", (None, 2), optional=True)
    if "portal_vertices" in arrays:
        portal_vertices = reader.numbers("portal_vertices", (None, 3))
        portal_start = reader.starts("portal_start", len(portal_vertices), len(portal_rooms))
    else:
        corners = reader.numbers("portals", (len(portal_rooms), 4, 3), optional=len(portal_rooms) == 0)
        portal_vertices = corners.reshape(-1, 3)
        portal_start = 4 * np.arange(len(portal_rooms) + 1)

    rooms = 1 + max(int(room.max(initial=-1)), int(portal_rooms.max(initial=-1)))
    if rooms > len(room) + portal_rooms.size + MOST_EMPTY_ROOMS:
        raise SceneError(f"{path}: the array 'room' or 'portal_rooms' holds the room {rooms - 1}, far more than there are polygons")
    room_names = reader.texts("room_names", default=[f"room {r}" for r in range(max(rooms, 0))])
    object_names = reader.texts("object_names", default=["scene"])
    object_index = reader.integers("object", (count,)) if "object" in arrays else np.zeros(count, np.int32)
    portal_names = reader.texts("portal_names", default=[f"portal {k}" for k in range(len(portal_rooms))])
    if len(portal_names) != len(portal_rooms):
        raise SceneError(f"{path}: portal_names has {len(portal_names)} texts for {len(portal_rooms)} portals")

    portal_depth, transmittance = (
        reader.numbers(f"portal_{name}", (len(portal_rooms),)) if f"portal_{name}" in arrays else None
        for name in ("depth", "transmittance")
    )
    points = None
    if "pts" in arrays:
        position = reader.numbers("pts", (None, 3))
        points = EvaluationPoints(position, reader.numbers("pts_n", position.shape), reader.integers("pts_poly", (len(position),)))
    return Scene(
        name=reader.name(),
        vertices=reader.numbers("verts", (None, 3)),
        corner_vertex=corner_vertex,
        loop_start=np.asarray(loop_start, np.int64),
        polygon_start=np.asarray(polygon_start, np.int64),
        reflectance=reader.numbers("rho", (count, 3)),
        emission=reader.numbers("emit", (count, 3)),
        room=room,
        object=object_index,
        room_names=room_names,
        object_names=object_names,
        portals=Portals(portal_vertices, np.asarray(portal_start, np.int64), portal_rooms, portal_names, portal_depth, transmittance),
        points=points,
        lamps=read_lamps(reader, str(path)),
        groups=read_groups(reader),
    )


class _Arrays:
    """The arrays of an ``.npz`` file, taken out by name with their kind and shape checked."""

    def __init__(self, path: Path, arrays: Mapping[str, np.ndarray]) -> None:
        self.path = path
        self.arrays = arrays

    def _get(self, key: str, shape: tuple[int | None, ...], kinds: str, what: str, instead_of: str = "") -> np.ndarray:
        if key not in self.arrays:
            raise SceneError(f"{self.path}: the array {instead_of or key!r} is missing")
        array = self.arrays[key]
        if array.dtype.kind not in kinds:
            raise SceneError(f"{self.path}: the array {key!r} holds {array.dtype} where {what} are due")
        if array.ndim != len(shape) or any(want is not None and have != want for have, want in zip(array.shape, shape, strict=True)):
            due = "(" + ", ".join("any" if want is None else str(want) for want in shape) + ")"
            raise SceneError(f"{self.path}: the array {key!r} has shape {array.shape} where {due} is due")
        return array

    def numbers(self, key: str, shape: tuple[int | None, ...], optional: bool = False) -> np.ndarray:
        if optional and key not in self.arrays:
            return np.zeros([n or 0 for n in shape])
        return self._get(key, shape, "fiu", "numbers").astype(np.float64)

    def integers(self, key: str, shape: tuple[int | None, ...], optional: bool = False, instead_of: str = "") -> np.ndarray:
        if optional and key not in self.arrays:
            return np.zeros([n or 0 for n in shape], np.int32)
        array = self._get(key, shape, "iu", "whole numbers", instead_of)
        limits = np.iinfo(np.int32)
        if array.size and (array.min() < limits.min or array.max() > limits.max):
            raise SceneError(f"{self.path}: the array {key!r} holds a number that is no index")
        return array.astype(np.int32)

    def starts(self, key: str, total: int, count: int | None = None) -> np.ndarray:
        """Offsets of consecutive ranges: from 0 to ``total``, never falling."""
        array = self._get(key, (None if count is None else count + 1,), "iu", "whole numbers").astype(np.int64)
        if len(array) == 0 or array[0] != 0 or array[-1] != total or (np.diff(array) < 0).any():
            raise SceneError(f"{self.path}: the array {key!r} must rise from 0 to {total}")
        return array

    def texts(self, key: str, default: list[str]) -> tuple[str, ...]:
        if key not in self.arrays:
            return tuple(default)
        return tuple(str(text) for text in self._get(key, (None,), "U", "texts"))

    def name(self) -> str:
        """The scene's name: from ``meta`` where that is readable, else from the file."""
        try:
            return str(json.loads(str(self.arrays["meta"]))["name"])
        except (KeyError, TypeError, ValueError):
            return self.path.stem


def _npz_arrays(scene: Scene) -> dict[str, np.ndarray]:
    portals = scene.portals
    arrays = {
        "verts": _compact(scene.vertices),
        "rho": _compact(scene.reflectance),
        "emit": _compact(scene.emission),
        "room": scene.room.astype(np.int32),
        "portal_rooms": portals.rooms.astype(np.int32),
        "meta": np.array(json.dumps({"name": scene.name, "units": "m"})),
    }
    corners = np.diff(scene.loop_start)
    if (np.diff(scene.polygon_start) == 1).all() and ((corners == 3) | (corners == 4)).all():
        polys = np.full((scene.polygon_count, 4), -1, np.int32)
        used = np.arange(4) < corners[:, None]
        polys[used] = scene.corner_vertex
        arrays["polys"] = polys
    else:
        arrays["corner_vertex"] = scene.corner_vertex.astype(np.int32)
        arrays["loop_start"] = scene.loop_start.astype(np.int64)
        arrays["polygon_start"] = scene.polygon_start.astype(np.int64)
    if (np.diff(portals.start) == 4).all():
        arrays["portals"] = _compact(portals.vertices).reshape(-1, 4, 3)
    else:
        arrays["portal_vertices"] = _compact(portals.vertices)
        arrays["portal_start"] = portals.start.astype(np.int64)
    if portals.depth is not None:
        arrays["portal_depth"] = _compact(portals.depth)
    if portals.transmittance is not None:
        arrays["portal_transmittance"] = _compact(portals.transmittance)
    if len(scene.object_names) != 1 or scene.object_names[0] != "scene":
        arrays["object"] = scene.object.astype(np.int32)
        arrays["object_names"] = np.array(scene.object_names, dtype=str)
    arrays["room_names"] = np.array(scene.room_names, dtype=str)
    if len(portals.names) == len(portals):
        arrays["portal_names"] = np.array(portals.names, dtype=str)
    if scene.points is not None:
        arrays["pts"] = _compact(scene.points.position)
        arrays["pts_n"] = _compact(scene.points.normal)
        arrays["pts_poly"] = scene.points.polygon.astype(np.int32)
    return arrays | lamp_arrays(scene.lamps, _compact) | group_arrays(scene.groups)


def _compact(values: np.ndarray) -> np.ndarray:
    """float32 where that loses nothing, else float64."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    return single if np.array_equal(single, values, equal_nan=True) else values.astype(np.float64)


# --------------------------------------------------------------------------------------------------------- json


def _load_json(path: Path) -> Scene:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: the file cannot be read ({_first_line(error)})") from error
    except json.JSONDecodeError as error:
        raise SceneError(f"{path}: the file is damaged or not JSON ({error.msg}, line {error.lineno})") from error
    except (ValueError, MemoryError) as error:
        raise SceneError(f"{path}: the file is damaged ({_first_line(error)})") from error
    if not isinstance(document, dict) or document.get("format") != "rooms-portals-scene":
        raise SceneError(f"{path}: the file does not say that it is a 'rooms-portals-scene'")
    if document.get("version") != 1:
        raise SceneError(f"{path}: version {document.get('version')!r} of the format is not known, only version 1 is")
    try:
        return _scene_of_building(path, document)
    except SceneError:
        raise
    except KeyError as error:
        raise SceneError(f"{path}: the entry {error} is missing") from error
    except (TypeError, ValueError, AttributeError, OverflowError, IndexError, MemoryError, RecursionError) as error:
        raise SceneError(f"{path}: an entry has a wrong form ({_first_line(error)})") from error


def _scene_of_building(path: Path, document: Mapping[str, Any]) -> Scene:
    polygons, rooms = document["polygons"], document["rooms"]
    vertices = np.asarray(document["vertices"], np.float64).reshape(-1, 3)
    wrong = np.flatnonzero(~(np.abs(vertices) <= FARTHEST).all(axis=1))
    if len(wrong):
        raise SceneError(f"{path}: the position of vertex {wrong[0]} is no finite number, or more than {FARTHEST:g} m away from the origin")
    corner_vertex, loop_start = _ragged([polygon["v"] for polygon in polygons])
    room = _indices([polygon["room"] for polygon in polygons])
    room_names = tuple(str(entry["name"]) for entry in rooms)

    empty = np.flatnonzero(np.diff(loop_start) < 1)
    if len(empty):
        raise SceneError(f"{path}: polygon {empty[0]} has no corners")
    material = np.asarray([polygon["mat"] for polygon in polygons], np.int64)
    wrong = np.flatnonzero((material < 0) | (material >= len(document["materials"])))
    if len(wrong):
        raise SceneError(f"{path}: polygon {wrong[0]} has material {material[wrong[0]]}, which the file does not define")
    reflectance = np.asarray([entry["reflectance"] for entry in document["materials"]], np.float64).reshape(-1, 3)
    emission = np.asarray([entry["emission"] for entry in document["materials"]], np.float64).reshape(-1, 3)

    # One object per room and kind: a wall never merges with a cupboard that touches it.
    kinds = [(polygon["room"], str(polygon["kind"])) for polygon in polygons]
    groups = {key: index for index, key in enumerate(dict.fromkeys(kinds))}
    object_names = tuple(f"{kind} of {room_names[r] if 0 <= r < len(room_names) else f'room {r}'}" for r, kind in groups)

    portal_corner, portal_start = _ragged([portal["v"] for portal in document["portals"]])
    wrong = np.flatnonzero((portal_corner < 0) | (portal_corner >= len(vertices)))
    if len(wrong):
        owner = np.searchsorted(portal_start, wrong[0], side="right") - 1
        raise SceneError(f"{path}: portal {owner} has vertex {portal_corner[wrong[0]]}, which the file does not define")
    portals = Portals(
        vertices[portal_corner],
        portal_start,
        _indices([room for portal in document["portals"] for room in portal["rooms"]]).reshape(-1, 2),
        tuple(f"{portal.get('kind', 'portal')} {k}" for k, portal in enumerate(document["portals"])),
    )
    scene = Scene(
        name=str(document.get("name") or path.stem),
        vertices=vertices,
        corner_vertex=corner_vertex,
        loop_start=loop_start,
        polygon_start=np.arange(len(polygons) + 1, dtype=np.int64),
        reflectance=reflectance[material],
        emission=emission[material],
        room=room,
        object=np.asarray([groups[key] for key in kinds], np.int32),
        room_names=room_names,
        object_names=object_names,
        portals=portals,
    )
    probes = document.get("probes") or []
    if not probes:
        return scene
    position = np.asarray([probe["point"] for probe in probes], np.float64).reshape(-1, 3)
    normal = np.asarray([probe["normal"] for probe in probes], np.float64).reshape(-1, 3)
    polygon = _polygon_under(scene, position, normal)
    if (polygon < 0).any():
        probe = probes[int(np.argmax(polygon < 0))]
        raise SceneError(f"{path}: the probe {str(probe.get('label', ''))!r} at {probe['point']} lies on no polygon of the scene")
    return Scene(**{**vars(scene), "points": EvaluationPoints(position, normal, polygon)})


def _polygon_under(scene: Scene, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(N,) int32: the polygon on whose front each point lies, -1 where there is none. Polygons must be convex without holes."""
    here = scene.vertices[scene.corner_vertex]
    following = np.arange(1, len(here) + 1)
    following[scene.loop_start[1:] - 1] = scene.loop_start[:-1]
    edge = here[following] - here
    start = scene.loop_start[:-1]
    area_vector = np.add.reduceat(np.cross(here - np.repeat(here[start], np.diff(scene.loop_start), axis=0), edge), start)
    unit = area_vector / np.maximum(np.linalg.norm(area_vector, axis=1, keepdims=True), 1e-300)
    inward = np.cross(np.repeat(unit, np.diff(scene.loop_start), axis=0), edge)
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-300)
    result = np.full(len(position), -1, np.int32)
    for i, (point, direction) in enumerate(zip(position, normal, strict=True)):  # a handful of probes
        outside = np.maximum.reduceat(-np.einsum("ij,ij->i", point - here, inward), start)
        height = np.abs(np.einsum("ij,ij->i", point - here[start], unit))
        miss = np.where(unit @ direction > 0.999, np.maximum(outside, height), np.inf)
        if miss.min(initial=np.inf) < PROBE_TOLERANCE:
            result[i] = int(np.argmin(miss))
    return result


def _ragged(lists: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Lists of indices one after another: (all indices int32, (n + 1,) int64 offsets)."""
    flat = [index for indices in lists for index in indices]
    if any(isinstance(index, bool) or not isinstance(index, int) for index in flat):
        raise ValueError("a vertex index is not a whole number")
    return _indices(flat), _offsets(np.asarray([len(indices) for indices in lists], np.int64))


def _indices(numbers: list[int]) -> np.ndarray:
    """(n,) int32. Raises ValueError when one is too large for an index."""
    array = np.asarray(numbers, np.int64)
    if array.size and (array.min() < -(2**31) or array.max() >= 2**31):
        raise ValueError("a number is too large for an index")
    return array.astype(np.int32)


def _offsets(counts: np.ndarray) -> np.ndarray:
    """(n + 1,) int64 offsets of n consecutive ranges."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])


def _first_line(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return (text[0] if text else type(error).__name__).rstrip(".")
