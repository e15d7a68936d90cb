# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the rooms of a scene and sorts its objects into collections for them."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

import bmesh
import bpy
import numpy as np

from ..core.face_checks import islands
from ..core.room_finding import FoundRooms, find_rooms, rooms_of_objects
from ..core.scene import OUTSIDE, SceneError
from .extract import Built, Opening, Part, assemble, fan, parts_of, portal_faces
from .membership import Membership, everything_evaluated, own_objects, rendered_objects
from .roles import ROOMS, chosen_collections, home_of, portal_objects, roles

MOSTLY = 0.6
"""Part of the surface of a room that must lie in a collection for the collection to be that room."""


@dataclass(frozen=True)
class Survey:
    """All surfaces of a scene and the rooms found between them.

    triangle : (T, 3, 3), metres;  polygon : (T,) polygon of each;  owner : (P,) object of each polygon, index into ``things``
    spread : (N, R) m2 of every object that look into each room;  rooms_of : (N, R) bool, the rooms that it belongs to
    """

    parts: tuple[Part, ...]
    built: Built
    openings: tuple[Opening, ...]
    triangle: np.ndarray
    polygon: np.ndarray
    things: tuple[bpy.types.Object, ...]
    owner: np.ndarray
    rooms: FoundRooms
    spread: np.ndarray
    rooms_of: np.ndarray
    metres_per_unit: float


def survey(context: bpy.types.Context) -> Survey:
    """Look at all that takes part in a bake, whatever its room. Changes nothing. Raises SceneError where there is no surface."""
    scene, view_layer = context.scene, context.view_layer
    scale = scene.unit_settings.scale_length
    portals = portal_objects(scene)
    solid = [o for o in rendered_objects(view_layer) if o not in set(portals)]
    whole = Membership((scene.name,), {o: (0,) for o in solid}, portals, (), ())
    with everything_evaluated(scene, view_layer):
        depsgraph = context.evaluated_depsgraph_get()
        parts = parts_of(depsgraph, whole, scale, [])
        openings = portal_faces(depsgraph, whole, scale)
    if not parts:
        raise SceneError("the scene has no mesh that is visible in renders: there are no rooms to find")
    built = assemble(parts)
    triangle, polygon = fan(built.corner_vertex, built.loop_start, built.vertices)
    fans = [np.stack([np.broadcast_to(c[0], (len(c) - 2, 3)), c[1:-1], c[2:]], axis=1) for c in (o.corners for o in openings)]
    portal = np.repeat(np.arange(len(fans)), [len(f) for f in fans])
    found = find_rooms(triangle, polygon, np.concatenate([np.zeros((0, 3, 3)), *fans]), portal)
    things = tuple(dict.fromkeys(part.owner for part in parts))
    number = {thing: k for k, thing in enumerate(things)}
    owner = np.array([number[part.owner] for part in parts])[built.object]
    spread = np.zeros((len(things), len(found)))
    np.add.at(spread, owner, found.spread)
    rooms_of = rooms_of_objects(spread)
    rooms_of |= _nearest_rooms(found, rooms_of, triangle, owner[polygon], np.bincount(owner, found.front == OUTSIDE, len(things)) > 0)
    return Survey(tuple(parts), built, tuple(openings), triangle, polygon, things, owner, found, spread, rooms_of, scale)


@dataclass(frozen=True)
class Sorted:
    """What was done: the room collections, how many objects lie in them, those cut apart, those in several rooms, those in none."""

    rooms: tuple[bpy.types.Collection, ...]
    objects: int
    cut: tuple[str, ...]
    shared: tuple[str, ...]
    elsewhere: tuple[str, ...]


def sort_into_rooms(context: bpy.types.Context, seen: Survey, cut: bool) -> Sorted:
    """Make a collection for every room that was found, or take those that are there, and put the objects into them.

    cut : objects with faces in several rooms are cut apart where that is possible; otherwise they are linked into all these rooms
    """
    scene = context.scene
    homes = _homes(scene, seen)
    placing = _Placing(scene, homes)
    severed, shared, elsewhere, count = [], [], [], 0
    for k, thing in enumerate(seen.things):
        own = np.flatnonzero(seen.rooms_of[k])
        own = own[np.argsort(-seen.spread[k, own], kind="stable")]
        if len(own) == 0:
            elsewhere.append(thing.name)
            continue
        count += 1
        if len(own) > 1 and cut and _can_be_cut(seen, thing):
            for r, piece in _cut_apart(seen, thing, own, homes).items():
                placing.place(piece, [r])
            severed.append(thing.name)
            continue
        if len(own) > 1:
            shared.append(thing.name)
        placing.place(thing, list(own))
    placing.place_lamps(context, seen)
    return Sorted(tuple(homes), count, tuple(severed), tuple(shared), tuple(elsewhere))


def rooms_of_polygons(seen: Survey) -> np.ndarray:
    """(P,) the room that each polygon is sorted into, negative for none; what looks out of an object in several rooms has none."""
    number = {thing: k for k, thing in enumerate(seen.things)}
    room = np.where(seen.rooms_of.any(axis=1), seen.rooms_of.argmax(axis=1), OUTSIDE)[seen.owner]
    for k, part in enumerate(seen.parts):
        own = np.flatnonzero(seen.rooms_of[number[part.owner]])
        if len(own) > 1:
            mine = seen.built.object == k
            room[mine] = np.where(seen.rooms.front[mine] == OUTSIDE, OUTSIDE, _rooms_of_faces(seen, k, own)[part.faces.face])
    return room


def _nearest_rooms(found: FoundRooms, rooms_of: np.ndarray, triangle: np.ndarray, owner: np.ndarray, looks_out: np.ndarray) -> np.ndarray:
    """(N, R) bool: what no cell fits in front of, such as a book in a shelf, is in the room that is nearest to it."""
    out = np.zeros_like(rooms_of)
    lost = np.flatnonzero(~rooms_of.any(axis=1) & ~looks_out) if len(found) else np.zeros(0, int)
    if len(lost):
        middle = triangle.mean(axis=1)
        near = found.near(np.array([middle[owner == k].mean(axis=0) for k in lost]))
        out[lost[near >= 0], near[near >= 0]] = True
    return out


def _homes(scene: bpy.types.Scene, seen: Survey) -> list[bpy.types.Collection]:
    """The collection of every room: one that is this room already, one that holds little else, or a new one."""
    kinds, count, spread = roles(scene), len(seen.rooms), seen.spread
    number = {thing: k for k, thing in enumerate(seen.things)}
    root = chosen_collections(scene)[0]
    homes: list[bpy.types.Collection | None] = [None] * count
    total = spread.sum(axis=0)
    candidates = []
    for collection in scene.collection.children_recursive:
        kind = kinds.get(collection, "")
        if kind not in ("", "ROOM") or (collection == root and count > 1) or (collection == root and kind != "ROOM"):
            continue
        members = [number[o] for o in own_objects(collection, kinds) if o in number]
        held = spread[members].sum(axis=0)
        # A collection of the user's own is only taken where it holds nothing of another room.
        if held.any() and (kind == "ROOM" or seen.rooms_of[members].any(axis=0).sum() == 1):
            candidates.append((held.max() / total[held.argmax()], int(held.argmax()), kind, collection))
    for share, room, kind, collection in sorted(candidates, key=lambda c: (c[2] != "ROOM", -c[0])):
        if homes[room] is None and share >= (MOSTLY if kind == "" else 0.3):
            homes[room] = collection
            if kind == "":
                collection.enfilade.role = "ROOM"
    for room in range(count):
        if homes[room] is None:
            home = bpy.data.collections.new(_name(seen, room))
            parent = home_of(scene, ROOMS, "ROOM")
            parent.children.link(home)
            if parent.enfilade.role == "ROOM":
                home.enfilade.role = "ROOM"
            homes[room] = home
    return homes


def _name(seen: Survey, room: int) -> str:
    """The words that most names of a room's objects begin with, such as "Living room" of "Living room sofa"; else a number."""
    names = [seen.things[k].name for k in np.flatnonzero(seen.rooms_of[:, room] & (seen.rooms_of.sum(axis=1) == 1))]
    words = [re.sub(r"\.\d{3,}$", "", name).replace("_", " ").split() for name in names]
    starts = Counter(" ".join(w[:n]) for w in words for n in range(1, len(w)))
    common = [start for start, number in starts.items() if number >= 3 and number >= 0.7 * len(names)]
    return max(common, key=len) if common else f"Room {room + 1}"


class _Placing:
    """Puts objects into the collections of their rooms."""

    def __init__(self, scene: bpy.types.Scene, homes: list[bpy.types.Collection]) -> None:
        kinds = roles(scene)
        self._homes = homes
        self._inside = {home: set(own_objects(home, kinds)) for home in homes}
        rooms = {c for c, kind in kinds.items() if kind == "ROOM"}
        self._leave = {*rooms, scene.collection, chosen_collections(scene)[0]}

    def place(self, thing: bpy.types.Object, rooms: list[int]) -> None:
        """Link an object into the collections of ``rooms``, and out of those of other rooms and of the scene itself."""
        into = [self._homes[r] for r in rooms]
        for home in into:
            if thing not in self._inside[home]:
                home.objects.link(thing)
        for collection in thing.users_collection:
            if collection in self._leave and collection not in into:
                collection.objects.unlink(thing)

    def place_lamps(self, context: bpy.types.Context, seen: Survey) -> None:
        """Lamps go with the room that they hang in."""
        lamps = [o for o in rendered_objects(context.view_layer) if o.type == "LIGHT"]
        if not lamps or not self._homes:
            return
        at = np.array([o.matrix_world.translation for o in lamps], float) * seen.metres_per_unit
        for thing, room in zip(lamps, seen.rooms.near(at), strict=True):
            if room >= 0:
                self.place(thing, [room])


def _can_be_cut(seen: Survey, thing: bpy.types.Object) -> bool:
    part = next(p for p in seen.parts if p.owner == thing)
    own = part.thing == thing and part.in_place and not thing.modifiers
    return own and thing.library is None and thing.data.library is None and thing.data.users == 1


def _cut_apart(seen: Survey, thing: bpy.types.Object, own: np.ndarray, homes: list[bpy.types.Collection]) -> dict[int, bpy.types.Object]:
    """The object, left with the faces of its main room, and a new one for every other room."""
    room = _rooms_of_faces(seen, next(k for k, part in enumerate(seen.parts) if part.owner == thing), own)
    pieces = {int(own[0]): thing}
    for r in own[1:]:
        if (room == r).any():
            piece = thing.copy()
            piece.data = thing.data.copy()
            piece.name = piece.data.name = f"{thing.name} {homes[r].name}"
            thing.users_collection[0].objects.link(piece)
            _keep_faces(piece.data, room == r)
            pieces[int(r)] = piece
    _keep_faces(thing.data, np.isin(room, [r for r in own if int(r) not in pieces or r == own[0]]))
    return pieces


def _rooms_of_faces(seen: Survey, k: int, own: np.ndarray) -> np.ndarray:
    """(F,) the room, one of ``own``, of each face of part ``k``."""
    part = seen.parts[k]
    votes = np.zeros((len(part.mesh.face_start) - 1, len(own)))
    np.add.at(votes, part.faces.face, seen.rooms.spread[seen.built.object == k][:, own])
    return own[_decided(seen, part, votes, own)]


def _decided(seen: Survey, part: Part, votes: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(F,) the column of ``votes`` (F, n), m2, that each face goes to.

    A face that looks into no room goes with what it hangs together with, and where that does not help into the nearest room.
    """
    mesh = part.mesh
    island = islands(mesh.corner_vertex, mesh.face_start)
    together = np.zeros((int(island.max(initial=-1)) + 1, votes.shape[1]))
    np.add.at(together, island, votes)
    votes = np.where(votes.any(axis=1, keepdims=True), votes, together[island])
    lost = np.flatnonzero(~votes.any(axis=1))
    if len(lost):
        corners = [mesh.position[mesh.corner_vertex[a:b]] for a, b in zip(mesh.face_start[lost], mesh.face_start[lost + 1], strict=True)]
        near = seen.rooms.near(np.array([at.mean(axis=0) for at in corners]))
        votes[lost] = near[:, None] == own
    return votes.argmax(axis=1)


def _keep_faces(mesh: bpy.types.Mesh, keep: np.ndarray) -> None:
    """Delete all faces of a mesh but those of ``keep`` (F,) bool."""
    work = bmesh.new()
    work.from_mesh(mesh)
    bmesh.ops.delete(work, geom=[face for face, stays in zip(work.faces, keep, strict=True) if not stays], context="FACES")
    work.to_mesh(mesh)
    work.free()
    mesh.update()
