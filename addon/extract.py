# SPDX-License-Identifier: GPL-3.0-or-later
"""From the open Blender scene to the arrays of a core scene, and the way back to its meshes.

A face belongs to the room that its object is linked into. Where that is several, rays from the middle of the face
decide which of them it looks into (a face that looks into none goes to the nearest); a face is never cut, so one
floor under two rooms belongs to the room above its middle, with a warning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core.corners import corner_faces, face_area_vectors
from ..core.enclosure import UNDECIDED, Walls, enclosing_room
from ..core.face_grids import FaceGrids, cut
from ..core.faces import PlanarFaces, planar_faces
from ..core.grouping import ragged
from ..core.lamps import joined_suns
from ..core.scene import OUTSIDE, Portals, Scene, SceneError, no_portals
from ..core.scene_checks import check
from .lamps import placed, read_lamps
from .light_groups import light_groups
from .membership import Membership, everything_evaluated, membership
from .mesh_arrays import MeshArrays, read_mesh, same_topology
from .palette import Palette
from .screens import CELLS, SMALL, Screens, cell_emission, cells_of
from .world import read_world

STEP = 1e-3
"""Rays that look for a room start this far in front of a face, metres."""

ROOM_MARGIN = 0.6
"""Rooms reach this far beyond their own objects, metres: a portal may stand at the far side of a thick wall."""


@dataclass(frozen=True)
class Receiver:
    """A mesh object that can carry light (its F faces, C corners and T triangles as in ``mesh``).

    name : of the object;  mesh : its evaluated mesh, metres
    triangle_polygon : (T,) int64, polygon of the scene that each triangle lies in, -1 for none; of a grid the first cell
    grids : the polygons of the scene that were cut into grids
    room : the room of most of its area;  in_place : its own mesh has the same faces as the evaluated one
    modified_by : names of the modifiers
    """

    name: str
    mesh: MeshArrays
    triangle_polygon: np.ndarray
    grids: FaceGrids | None
    room: int
    in_place: bool
    modified_by: str


@dataclass(frozen=True)
class Extraction:
    """A scene for the solver, the meshes that can take its light back, and what the user should know."""

    scene: Scene
    receivers: tuple[Receiver, ...]
    warnings: tuple[str, ...]
    metres_per_unit: float


@dataclass
class Part:
    """One object or instance: its faces as P planar polygons. ``owner`` is what makes the instance, or the object itself.

    reflectance : (P, 3);  emission : (P, 3), W/m2;  screens : those of them that shine by an image, where any do
    """

    name: str
    thing: bpy.types.Object
    owner: bpy.types.Object
    rooms: tuple[int, ...]
    mesh: MeshArrays
    faces: PlanarFaces
    reflectance: np.ndarray
    emission: np.ndarray
    screens: Screens | None
    receiver: bool
    in_place: bool


def refuse_at_once(message: str) -> None:
    """Raise the :class:`SceneError` of a portal that is of no use."""
    raise SceneError(message)


def extract(context: bpy.types.Context, refuse: Callable[[str], None] = refuse_at_once, groups: str = "none") -> Extraction:
    """Read the scene of a context. Nothing in the file is changed.

    Raises :class:`SceneError` with one sentence for what cannot be baked. ``refuse`` is told so of each portal that is of no
    use; where it returns, the portal is passed over. ``groups`` are the light groups that are wanted, as in ``BakeOptions``.
    """
    scene, view_layer = context.scene, context.view_layer
    scale = scene.unit_settings.scale_length
    found = membership(scene, view_layer)
    with everything_evaluated(scene, view_layer):
        depsgraph = context.evaluated_depsgraph_get()
        warnings: list[str] = []
        parts = parts_of(depsgraph, found, scale, warnings)
        openings = portal_faces(depsgraph, found, scale, refuse) if found.collections else []
        standing = read_lamps(depsgraph, view_layer, found, scale, warnings)
    if not parts:
        raise SceneError("the scene has no face that is visible in renders: there is nothing to bake")
    if found.left_out:
        warnings.append(f"{_listed('object', found.left_out)} in no room and out of the bake")
    built = assemble(parts)
    room = _rooms_of_polygons(built, parts, found, openings, warnings)
    portals = _portals(built, room, openings, found, refuse)
    sky, suns = read_world(scene.world, warnings)
    shining = np.bincount(built.object, (built.emission > 0).any(1), len(parts)) > 0
    owners = [part.owner for part in parts]
    lit = light_groups(scene, groups, owners, shining, standing.owners, len(suns), sky is not None)
    lamps = placed(standing, lambda at, facing: _rooms_around(built, room, openings, found, at, facing), warnings)
    lamps = replace(lamps, suns=joined_suns(lamps.suns, suns), sky=sky)
    starts = np.cumsum([0] + [len(part.faces.face) for part in parts])
    area = np.linalg.norm(face_area_vectors(built.vertices, built.corner_vertex, built.loop_start), axis=1)
    gridded, source, grids = _gridded(built, parts, starts)
    receivers = []
    for part, start, end in zip(parts, starts[:-1], starts[1:], strict=True):
        if part.receiver and end > start:
            share = np.bincount(room[start:end], area[start:end], len(found.room_names))
            polygon = np.where(part.faces.triangle_polygon >= 0, part.faces.triangle_polygon + start, -1)
            modifiers = ", ".join(m.name for m in part.thing.modifiers)
            receivers.append(Receiver(part.thing.name, part.mesh, polygon, grids, int(share.argmax()), part.in_place, modifiers))
    _warn_of_inverted_shells(built, parts, room, warnings)
    built, room = gridded, room[source]
    checked, findings = check(
        Scene(
            name=scene.name,
            vertices=built.vertices,
            corner_vertex=built.corner_vertex,
            loop_start=built.loop_start,
            polygon_start=np.arange(len(room) + 1),
            reflectance=built.reflectance,
            emission=built.emission,
            room=room,
            object=built.object,
            room_names=found.room_names,
            object_names=tuple(part.name for part in parts),
            portals=portals,
            lamps=lamps,
            groups=lit,
        )
    )
    warnings += [finding.message for finding in findings]
    return Extraction(checked, tuple(receivers), tuple(dict.fromkeys(warnings)), scale)


def parts_of(depsgraph: bpy.types.Depsgraph, found: Membership, scale: float, warnings: list[str]) -> list[Part]:
    """All surfaces: objects in the order of the collections, the instances of each after it."""
    order = {thing: k for k, thing in enumerate(found.rooms)}
    portals = set(found.portals)
    palette = Palette(warnings)
    parts: list[tuple[tuple[int, bool], Part]] = []
    instanced: dict[str, None] = {}
    for item in depsgraph.object_instances:
        thing = item.object.original
        owner = item.parent.original if item.is_instance else thing
        if owner not in order or thing in portals or (item.is_instance and thing.hide_render):
            continue
        if not item.is_instance and not _shows_itself(thing):
            continue
        if item.object.type not in ("MESH", "CURVE", "SURFACE", "META", "FONT"):
            continue
        name = f"{thing.name} in {owner.name}" if item.is_instance else thing.name
        part = _part(item.object, np.array(item.matrix_world), name, thing, owner, found.rooms[owner], scale, palette)
        if part is None:
            continue
        part.receiver = not item.is_instance and thing.type == "MESH" and thing.library is None and thing.override_library is None
        if not part.receiver:
            instanced.setdefault(thing.name)
        parts.append(((order[owner], item.is_instance), part))
    if instanced:
        warnings.append(f"instances, curves, texts and linked objects shape the light but cannot carry it: {_names(list(instanced))}")
    parts.sort(key=lambda pair: pair[0])
    return [part for _, part in parts]


def _shows_itself(thing: bpy.types.Object) -> bool:
    return thing.instance_type == "NONE" or thing.show_instancer_for_render or thing.type != "MESH"


def _part(evaluated, matrix, name, thing, owner, rooms, scale, palette) -> Part | None:
    mesh = evaluated.to_mesh()
    try:
        if mesh is None or len(mesh.polygons) == 0:
            return None
        slots = [slot.material for slot in evaluated.material_slots] or [None]
        surfaces = [palette.surface(material.original if material is not None else None) for material in slots]
        arrays = read_mesh(mesh, matrix, scale, {name for surface in surfaces for name in surface.uv_maps})
        if not np.isfinite(arrays.position).all():
            raise SceneError(f"object '{thing.name}' has vertices that are not numbers: repair the mesh or its transform")
        in_place = thing.type == "MESH" and thing.mode == "OBJECT" and same_topology(thing.data, mesh)
    finally:
        evaluated.to_mesh_clear()
    faces = planar_faces(arrays.position, arrays.corner_vertex, arrays.face_start, arrays.triangle, arrays.triangle_face)
    reflectance, emission = palette.colors(arrays, faces, surfaces)
    screens = palette.screens(arrays, faces, surfaces, emission)
    return Part(name, thing, owner, rooms, arrays, faces, reflectance, emission, screens, False, in_place)


@dataclass(frozen=True)
class Built:
    """The arrays of a scene before its rooms are known, and (P,) the part that each polygon comes from."""

    vertices: np.ndarray
    corner_vertex: np.ndarray
    loop_start: np.ndarray
    reflectance: np.ndarray
    emission: np.ndarray
    object: np.ndarray


def assemble(parts: list[Part]) -> Built:
    vertices, corner, size, reflectance, emission, owner = [], [], [], [], [], []
    base = 0
    for k, part in enumerate(parts):
        mesh, faces = part.mesh, part.faces
        loop = faces.corner
        if mesh.mirrored:
            polygon = corner_faces(faces.start)
            loop = loop[faces.start[polygon] + faces.start[polygon + 1] - 1 - np.arange(len(loop))]
        vertices.append(mesh.position)
        corner.append(mesh.corner_vertex[loop] + base)
        size.append(np.diff(faces.start))
        reflectance.append(part.reflectance)
        emission.append(part.emission)
        owner.append(np.full(len(faces.face), k, np.int32))
        base += len(mesh.position)
    return Built(
        np.concatenate(vertices),
        np.concatenate(corner).astype(np.int32),
        np.concatenate([[0], np.cumsum(np.concatenate(size))]).astype(np.int64),
        np.concatenate(reflectance),
        np.concatenate(emission),
        np.concatenate(owner),
    )


def _gridded(built: Built, parts: list[Part], starts: np.ndarray) -> tuple[Built, np.ndarray, FaceGrids | None]:
    """The polygons with those cut that shine unevenly, (P,) which one each was before, and the grids."""
    same = np.arange(len(built.object))
    lit = [(part, start) for part, start in zip(parts, starts, strict=False) if part.screens is not None]
    total = sum(part.screens.total for part, _ in lit)
    chosen, emission = [np.zeros(0, np.int64)], [np.zeros((0, CELLS, CELLS, 3))]
    for part, start in lit:
        bright = np.flatnonzero(part.screens.power > SMALL * total)
        chosen.append(start + part.screens.polygon[bright])
        # Loops that are read backwards begin at the other end of the second side.
        emission.append(part.screens.emission[bright, :, :: -1 if part.mesh.mirrored else 1])
    polygon, fine = np.concatenate(chosen), np.concatenate(emission)
    cells = cells_of(fine)
    polygon, fine, cells = polygon[cells > 1], fine[cells > 1], cells[cells > 1]
    if not len(polygon):
        return built, same, None
    corner = built.corner_vertex[built.loop_start[polygon][:, None] + np.arange(4)]
    grids, corners, number = cut(built.vertices[corner], polygon, cells, len(same))
    base, order = len(built.vertices), np.argsort(number, kind="stable")
    order = order[number[order] >= len(same)]
    corner_vertex = np.append(built.corner_vertex, np.zeros(4 * len(order), np.int32))
    loop_start = np.append(built.loop_start, built.loop_start[-1] + 4 * np.arange(1, len(order) + 1))
    corner_vertex[loop_start[number][:, None] + np.arange(4)] = base + np.arange(4 * len(number)).reshape(-1, 4)
    source = np.append(same, np.repeat(polygon, cells**2)[order])
    shining = built.emission[source]
    for n in np.unique(cells):
        shining[number[np.repeat(cells == n, cells**2)]] = cell_emission(fine[cells == n], int(n)).reshape(-1, 3)
    vertices = np.concatenate([built.vertices, corners.reshape(-1, 3)])
    return Built(vertices, corner_vertex, loop_start, built.reflectance[source], shining, built.object[source]), source, grids


@dataclass(frozen=True)
class Opening:
    """One portal: its name, (n, 3) corners in metres and the object that it is a face of."""

    name: str
    corners: np.ndarray
    thing: bpy.types.Object


def portal_faces(
    depsgraph: bpy.types.Depsgraph, found: Membership, scale: float, refuse: Callable[[str], None] = refuse_at_once
) -> list[Opening]:
    """The faces of all portals; ``refuse`` as in :func:`extract`."""
    openings = []
    for thing in found.portals:
        evaluated = thing.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        try:
            arrays = read_mesh(mesh, np.array(evaluated.matrix_world), scale)
        finally:
            evaluated.to_mesh_clear()
        if not np.isfinite(arrays.position).all():
            refuse(f"portal '{thing.name}' has vertices that are not numbers: repair the mesh or its transform")
            continue
        faces = planar_faces(arrays.position, arrays.corner_vertex, arrays.face_start, arrays.triangle, arrays.triangle_face)
        pieces = np.bincount(faces.face, minlength=len(arrays.face_start) - 1)
        count = len(pieces)
        for face in range(count):
            name = f"{thing.name}" if count == 1 else f"{thing.name}, face {face}"
            if pieces[face] != 1 or (face_corners := arrays.face_start[face + 1] - arrays.face_start[face]) < 3:
                refuse(f"portal '{name}' is not one flat convex face: cut it into such faces")
                continue
            loop = arrays.corner_vertex[arrays.face_start[face] : arrays.face_start[face] + face_corners]
            openings.append(Opening(name, arrays.position[loop[::-1] if arrays.mirrored else loop], thing))
    return openings


def fan(corner_vertex: np.ndarray, loop_start: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, 3, 3) of convex polygons and the polygon of each."""
    triangles = np.diff(loop_start) - 2
    polygon = np.repeat(np.arange(len(triangles)), triangles)
    first = loop_start[:-1][polygon]
    k = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return vertices[corner_vertex[np.stack([first, first + k + 1, first + k + 2], axis=1)]], polygon


def _middles(vertices, corner_vertex, loop_start) -> tuple[np.ndarray, np.ndarray]:
    """Centres (P, 3) and unit normals (P, 3) of convex polygons."""
    polygon = corner_faces(loop_start)
    centre = np.zeros((len(loop_start) - 1, 3))
    np.add.at(centre, polygon, vertices[corner_vertex])
    vector = face_area_vectors(vertices, corner_vertex, loop_start)
    return centre / np.diff(loop_start)[:, None], vector / np.maximum(np.linalg.norm(vector, axis=1), 1e-300)[:, None]


def _rooms_of_polygons(built: Built, parts: list[Part], found: Membership, openings: list[Opening], warnings: list[str]) -> np.ndarray:
    """(P,) int32: the room of every polygon."""
    only = np.array([part.rooms[0] if len(part.rooms) == 1 else UNDECIDED for part in parts], np.int32)
    room = only[built.object]
    open_cases = np.flatnonzero(room == UNDECIDED)
    if len(open_cases) == 0:
        return room
    count = len(found.room_names)
    allowed = np.zeros((len(parts), count), bool)
    for k, part in enumerate(parts):
        allowed[k, list(part.rooms)] = True
    walls, low, high = _walls(built, room, openings, count)
    centre, normal = _middles(built.vertices, built.corner_vertex, built.loop_start)
    may = allowed[built.object[open_cases]]
    where = centre[open_cases] + STEP * normal[open_cases]
    seen = enclosing_room(where, normal[open_cases], low - ROOM_MARGIN, high + ROOM_MARGIN, walls, may)
    lost = seen == OUTSIDE
    gap = np.maximum(np.maximum(low - where[lost][:, None], where[lost][:, None] - high), 0.0)
    distance = np.where(may[lost], np.linalg.norm(gap, axis=2), np.inf)
    seen[lost] = np.where(np.isfinite(distance).any(axis=1), distance.argmin(axis=1), may[lost].argmax(axis=1))
    room[open_cases] = seen
    _warn_of_spanning(built, parts, open_cases, may, low, high, found, warnings)
    return room


def _rooms_around(built: Built, room: np.ndarray, openings: list[Opening], found: Membership, at, facing) -> np.ndarray:
    """(n,) rooms around points (n, 3) that look one way (n, 3), -1 outside; a scene that is one room holds them all."""
    if not found.collections:
        return np.zeros(len(at), np.int64)
    walls, low, high = _walls(built, room, openings, len(found.room_names))
    return enclosing_room(at + STEP * facing, facing, low - ROOM_MARGIN, high + ROOM_MARGIN, walls).astype(np.int64)


def _walls(built: Built, room: np.ndarray, openings: list[Opening], count: int) -> tuple[Walls, np.ndarray, np.ndarray]:
    """What rays can meet, and the bounding boxes (R, 3) of the rooms' own surfaces."""
    triangles, polygon = fan(built.corner_vertex, built.loop_start, built.vertices)
    owner = room[polygon]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, owner[owner >= 0], triangles[owner >= 0].min(axis=1))
    np.maximum.at(high, owner[owner >= 0], triangles[owner >= 0].max(axis=1))
    if openings:
        corners = np.concatenate([o.corners for o in openings])
        start = np.cumsum([0] + [len(o.corners) for o in openings])
        closed, _ = fan(np.arange(len(corners)), start, corners)
        triangles = np.concatenate([triangles, closed])
        owner = np.concatenate([owner, np.full(len(closed), UNDECIDED)])
    return Walls(triangles, owner), low, high


def _warn_of_spanning(built, parts, open_cases, may, low, high, found, warnings) -> None:
    """Name the objects that have a face under, over or beside more than one room."""
    polygon = corner_faces(built.loop_start)
    at = built.vertices[built.corner_vertex]
    lowest, highest = np.full((len(built.object), 3), np.inf), np.full((len(built.object), 3), -np.inf)
    np.minimum.at(lowest, polygon, at)
    np.maximum.at(highest, polygon, at)
    slack = 0.05
    inside = (highest[open_cases, None] > low - slack) & (lowest[open_cases, None] < high + slack)
    overlap = np.minimum(highest[open_cases, None], high) - np.maximum(lowest[open_cases, None], low)
    touched = inside.all(axis=2) & may & ((overlap > 0.25).sum(axis=2) >= 2)
    wide = touched.sum(axis=1) > 1
    for k in np.unique(built.object[open_cases[wide]]):
        rooms = np.flatnonzero(touched[wide & (built.object[open_cases] == k)].any(axis=0))
        names = _names([found.room_names[r] for r in rooms])
        warnings.append(f"object '{parts[k].name}' has faces that reach over several rooms ({names}): cut them at the portals")


def _warn_of_inverted_shells(built: Built, parts: list[Part], room: np.ndarray, warnings: list[str]) -> None:
    """Name the objects that enclose all else in their room and turn their fronts away from it."""
    centre, _ = _middles(built.vertices, built.corner_vertex, built.loop_start)
    vector = face_area_vectors(built.vertices, built.corner_vertex, built.loop_start)
    at, owner = built.vertices[built.corner_vertex], built.object[corner_faces(built.loop_start)]
    low, high = np.full((len(parts), 3), np.inf), np.full((len(parts), 3), -np.inf)
    np.minimum.at(low, owner, at)
    np.maximum.at(high, owner, at)
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (low + high)
    outward = np.einsum("ij,ij->i", vector, centre - middle[built.object])
    area = np.linalg.norm(vector, axis=1)
    turned = np.bincount(built.object, area * (outward > 0), len(parts)) > 0.95 * np.bincount(built.object, area, len(parts))
    for r in np.unique(room):
        members = np.unique(built.object[room == r])
        slack = 1e-3 * np.linalg.norm(high[members].max(0) - low[members].min(0))
        around = (low[members] <= low[members].min(0) + slack).all(1) & (high[members] >= high[members].max(0) - slack).all(1)
        solid = (high[members] - low[members] > slack).all(1)
        for k in members[around & solid & turned[members]] if len(members) > 1 else ():
            warnings.append(
                f"object '{parts[k].name}' encloses its room but its faces look outward, where the light then falls: flip its normals"
            )


def _portals(built: Built, room: np.ndarray, openings: list[Opening], found: Membership, refuse: Callable[[str], None]) -> Portals:
    """The portals with their rooms; ``refuse`` is told of one that joins no rooms."""
    if not openings:
        return no_portals()
    walls, low, high = _walls(built, room, openings, len(found.room_names))
    corners = np.concatenate([o.corners for o in openings])
    start = np.cumsum([0] + [len(o.corners) for o in openings]).astype(np.int64)
    centre, normal = _middles(corners, np.arange(len(corners)), start)
    low, high = low - ROOM_MARGIN, high + ROOM_MARGIN
    behind = enclosing_room(centre - STEP * normal, -normal, low, high, walls)
    front = enclosing_room(centre + STEP * normal, normal, low, high, walls)
    rooms = np.stack([behind, front], axis=1).astype(np.int32)
    number = {collection: k for k, collection in enumerate(found.collections)}
    good = []
    for k, opening in enumerate(openings):
        tags = opening.thing.enfilade
        if tags.by_hand:
            for side, collection in enumerate((tags.behind, tags.in_front)):
                if collection is not None and collection not in number:
                    refuse(f"portal '{opening.name}' is set by hand to '{collection.name}', which is not a room: choose a room")
                rooms[k, side] = number.get(collection, OUTSIDE)
        if rooms[k, 0] == rooms[k, 1]:
            where = "outside of all rooms" if rooms[k, 0] == OUTSIDE else f"inside the room '{found.room_names[rooms[k, 0]]}'"
            refuse(
                f"portal '{opening.name}' joins no rooms, both of its sides are {where}: move it into an opening or set its rooms by hand"
            )
            continue
        good.append(k)
    if not good:
        return no_portals()
    corner, _ = ragged(start[good], np.diff(start)[good])
    ends = np.concatenate([[0], np.cumsum(np.diff(start)[good])]).astype(np.int64)
    # Properties are of single precision: 0.8 must not come back as 0.800000012.
    glass = np.round([openings[k].thing.enfilade.transmittance for k in good], 6)
    names = tuple(openings[k].name for k in good)
    return Portals(corners[corner], ends, rooms[good], names, transmittance=glass if (glass < 1).any() else None)


def _names(names: list[str] | tuple[str, ...], most: int = 5) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def _listed(kind: str, names: tuple[str, ...]) -> str:
    return f"{kind} {_names(names)} is" if len(names) == 1 else f"{kind}s {_names(names)} are"
