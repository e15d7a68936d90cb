# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake of the open scene would meet with: everything that is wrong or odd, each with what is to blame. Nothing is changed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.corners import face_area_vectors
from ..core.estimate import estimate, in_words
from ..core.face_checks import bent_faces, islands, turned_faces
from ..core.grouping import components
from ..core.leaks import Leak
from ..core.parallel import worker_count
from ..core.room_finding import rooms_of_objects
from ..core.scene import OUTSIDE, Scene, SceneError
from .extract import Extraction, extract
from .guards import capital
from .inspection import leaks_in
from .job import settings
from .membership import membership
from .mesh_arrays import MeshArrays
from .room_sorting import Survey, survey

ERROR, WARNING, NOTE = "ERROR", "WARNING", "NOTE"
_QUOTED = re.compile(r"'([^']+)'")
_MOST = 40
"""Findings of one kind that are listed one by one."""


@dataclass(frozen=True)
class Finding:
    """Something to know before a bake.

    level : ``"ERROR"`` (nothing can be baked), ``"WARNING"`` (the light will be wrong somewhere) or ``"NOTE"``
    title : a few words;  message : what it is, and what can be done about it
    objects : names of those to blame;  faces : of the first of them, those meant;  place : in the world, where there is one
    """

    level: str
    title: str
    message: str
    objects: tuple[str, ...] = ()
    faces: tuple[int, ...] = ()
    place: tuple[float, float, float] | None = None


def check(context: bpy.types.Context) -> list[Finding]:
    """All findings, the worst first."""
    found: list[Finding] = []
    portals: list[str] = []
    extraction = None
    try:
        extraction = extract(context, portals.append)
    except SceneError as error:
        found.append(_named(ERROR, str(error)))
    found += [_named(ERROR, message) for message in portals]
    try:
        seen = survey(context)
    except SceneError:
        return found
    if extraction is not None:
        found += [_named(WARNING, message) for message in extraction.warnings]
        found += _leaks(extraction)
        found += _dark_rooms(extraction.scene)
        found += _open_rooms(context, seen)
    found += _wrong_sides(seen)
    found += _bent(seen)
    found += _shared_meshes(context)
    rank = {ERROR: 0, WARNING: 1, NOTE: 2}
    return sorted(found, key=lambda f: rank[f.level])


def _named(level: str, message: str) -> Finding:
    """A message of the reader: the objects, collections and materials that it names in quotes are to blame."""
    names: dict[str, None] = {}
    for name in _QUOTED.findall(message):
        if name in bpy.data.objects:
            names[name] = None
        elif name.split(", face ")[0] in bpy.data.objects:
            names[name.split(", face ")[0]] = None
        elif name in bpy.data.materials:
            users = (o for o in bpy.data.objects if any(s.material == bpy.data.materials[name] for s in o.material_slots))
            names.update(dict.fromkeys(o.name for o in users))
        elif name in bpy.data.collections and not names:
            names.update(dict.fromkeys(bpy.data.collections[name].all_objects.keys()))
    face = re.search(r", face (\d+)'", message)
    title = re.sub(r"^(object|portal|room|material|the mesh)s? (?=')", "", re.split(r", |: ", message)[0], flags=re.IGNORECASE)
    return Finding(level, capital(title.replace("'", "")), capital(message), tuple(names), (int(face[1]),) if face else ())


def _leaks(extraction: Extraction) -> Iterator[Finding]:
    """Straight ways from room to room that pass no portal."""
    found = leaks_in(extraction)
    names, done = found.scene.room_names, set()
    for leak in found.leaks:
        pair = frozenset((leak.room, leak.other))
        if pair not in done:
            done.add(pair)
            title = f"{names[leak.room]} leaks into {names[leak.other]}"
            rooms = f"'{names[leak.room]}' into '{names[leak.other]}'"
            text = f"Light gets from room {rooms} past the portals: close the gap, or put a portal into it"
            yield Finding(WARNING, title, text, _near_end(found.scene, leak), (), _world(leak.end, extraction.metres_per_unit))


def _near_end(scene: Scene, leak: Leak) -> tuple[str, ...]:
    """The object that a leaking line ends on: the one with a corner nearest to its end, of the other room."""
    size = np.diff(scene.loop_start)
    polygon = np.repeat(np.repeat(np.arange(scene.polygon_count), np.diff(scene.polygon_start)), size)
    corners = np.flatnonzero(scene.room[polygon] == leak.other)
    near = corners[np.linalg.norm(scene.vertices[scene.corner_vertex[corners]] - leak.end, axis=1).argmin()]
    return _existing([scene.object_names[scene.object[polygon[near]]]])


def _open_rooms(context: bpy.types.Context, seen: Survey) -> Iterator[Finding]:
    """Rooms that are not closed: with a gap to the outside, without a ceiling, or without a wall."""
    found = membership(context.scene, context.view_layer)
    member = np.array([found.rooms.get(thing, ()) == (r,) for r in range(len(found.room_names)) for thing in seen.things])
    held = member.reshape(len(found.room_names), -1).astype(float) @ seen.spread
    if len(found.room_names) == 1:
        held = seen.spread.sum(axis=0)[None]
    for gap in seen.rooms.gaps:
        name = found.room_names[int(held[:, gap.room].argmax())]
        text = f"Room '{name}' has a gap of about {gap.width:.1f} m to the outside: close it, or put a portal into it"
        yield Finding(WARNING, f"{name} has a gap", text, (), (), _world(gap.place, seen.metres_per_unit))
    closed = rooms_of_objects(held).any(axis=1) & (held.max(axis=1, initial=0) > 0) & (not seen.rooms.lid)
    for r in np.flatnonzero(~closed):
        text = f"Room '{found.room_names[r]}' is open: a wall or the ceiling is missing, and light gets lost there"
        things = tuple(thing.name for thing in seen.things if r in found.rooms.get(thing, ()))
        yield Finding(NOTE, f"{found.room_names[r]} is open", text, things)


def _dark_rooms(scene: Scene) -> Iterator[Finding]:
    """Rooms that no light can get into."""
    lit = np.bincount(scene.room, (scene.emission > 0).any(axis=1), scene.room_count) > 0
    lamps = scene.lamps
    if len(lamps.suns) or lamps.sky is not None:
        lit[scene.portals.rooms[(scene.portals.rooms == OUTSIDE).any(axis=1)].max(axis=1)] = True
    for kind in (lamps.area, lamps.points):
        lit[kind.room[kind.room >= 0]] = True
    inner = scene.portals.rooms[(scene.portals.rooms != OUTSIDE).all(axis=1)]
    part = components(scene.room_count, inner[:, 0], inner[:, 1])
    dark = np.flatnonzero(~np.isin(part, part[lit]))
    if not lit.any():
        return  # the reader says that there is no light at all
    for r in dark[:_MOST]:
        things = tuple(scene.object_names[k] for k in np.unique(scene.object[scene.room == r]))
        text = f"Room '{scene.room_names[r]}' stays black: it has no lamp, and no portals lead from a lamp to it"
        yield Finding(WARNING, f"{scene.room_names[r]} stays black", text, _existing(things))


def _wrong_sides(seen: Survey) -> Iterator[Finding]:
    """Parts of meshes whose backs look into a room and whose fronts do not, and faces that are turned against their neighbours."""
    built = seen.built
    area = np.linalg.norm(face_area_vectors(built.vertices, built.corner_vertex, built.loop_start), axis=1)
    for k, part in enumerate(seen.parts):
        if part.thing != part.owner or part.thing.type != "MESH":
            continue
        own = np.flatnonzero(built.object == k)
        mesh = part.mesh
        island = islands(mesh.corner_vertex, mesh.face_start)[part.faces.face]
        away = (seen.rooms.back[own] >= 0) & (seen.rooms.front[own] < 0)
        front = np.bincount(island, area[own] * (seen.rooms.front[own] >= 0))
        back = np.bincount(island, area[own] * away)
        wrong = back > 2 * front + 0.05
        if wrong.any():
            faces = np.unique(part.faces.face[wrong[island]])
            text = f"'{part.name}': {_faces(len(faces))} {_look(len(faces))} away from the room and will be dark inside: flip the normals"
            yield Finding(WARNING, f"{part.name} looks away", text, (part.thing.name,), tuple(faces.tolist()))
        # Boxes that were welded where they touch have such neighbours too, but mostly look the right way.
        turned = turned_faces(mesh.corner_vertex, mesh.face_start)
        meant = np.isin(part.faces.face, turned) & ~wrong[island]
        if area[own[meant & away]].sum() <= 0.5 * area[own[meant]].sum():
            turned = turned[:0]
        if len(turned):
            text = f"'{part.name}': {_faces(len(turned))} {_look(len(turned))} the other way than the neighbours: recalculate the normals"
            yield Finding(WARNING, f"{part.name} has turned faces", text, (part.thing.name,), tuple(turned.tolist()))


def _bent(seen: Survey) -> Iterator[Finding]:
    """Faces that do not lie in one plane."""
    for part in seen.parts:
        if part.thing != part.owner or part.thing.type != "MESH":
            continue
        faces = bent_faces(part.mesh.position, part.mesh.corner_vertex, part.mesh.face_start)
        if len(faces):
            text = f"'{part.name}': {_faces(len(faces))} {'is' if len(faces) == 1 else 'are'} not flat and taken as triangles"
            yield Finding(NOTE, f"{part.name} is not flat", text, (part.thing.name,), tuple(faces.tolist()))


def _shared_meshes(context: bpy.types.Context) -> Iterator[Finding]:
    """Meshes that several objects use: none can carry two bakes."""
    users: dict[bpy.types.Mesh, list[str]] = {}
    for thing in context.scene.objects:
        if thing.type == "MESH" and thing.library is None and not thing.enfilade.left_out:
            users.setdefault(thing.data, []).append(thing.name)
    for mesh, names in users.items():
        if len(names) > 1:
            text = f"The mesh '{mesh.name}' is shared by {len(names)} objects: the bake gives each a copy of its own"
            yield Finding(NOTE, f"{mesh.name} is shared", text, tuple(names))


def _existing(names) -> tuple[str, ...]:
    return tuple(name for name in names if name in bpy.data.objects)


def _faces(count: int) -> str:
    return f"{count} face{'s' * (count != 1)}"


def _look(count: int) -> str:
    return "looks" if count == 1 else "look"


def _world(metres: np.ndarray, metres_per_unit: float) -> tuple[float, float, float]:
    return tuple(float(x) for x in metres / metres_per_unit)


def cost(context: bpy.types.Context) -> tuple[str, str]:
    """What a bake of the scene should take, and what that rests on. Raises as a bake would."""
    options, bake = settings(context.scene)
    extraction = extract(context, lambda message: None)
    faces = [receiver.mesh for receiver in extraction.receivers]
    if bake.target == "vertex":
        values = sum(len(mesh.corner_vertex) for mesh in faces)
    else:
        values = int(bake.texel_density**2 * sum(_area(mesh) for mesh in faces))
    if bake.subdivide > 0.0:
        values = max(values, int(3 * 2 * sum(_area(mesh) for mesh in faces) / bake.subdivide**2))
    found = estimate(extraction.scene, options, values, worker_count(options.threads))
    low, high = (in_words(seconds) for seconds in found.seconds)
    size = f"{found.megabytes:.0f} MB" if found.megabytes < 1000 else f"{found.megabytes / 1000:.1f} GB"
    return f"{low} to {high}, about {size}", found.basis


def _area(mesh: MeshArrays) -> float:
    return float(np.linalg.norm(face_area_vectors(mesh.position, mesh.corner_vertex, mesh.face_start), axis=1).sum())
