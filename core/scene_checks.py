"""Is a scene fit to be solved? What is wrong is named; what can be mended is mended and told, the rest is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .lamp_checks import checked_lamps, shines
from .light_group_checks import refuse_wrong_groups
from .polygons import area_vectors, loop_polygon
from .portal_sides import reversed_portals
from .scene import OUTSIDE, Portals, Scene, SceneError

MIN_AREA = 1e-14
"""Polygons and portals of no more than this (m2) count as without area."""
PLANARITY = 1e-4
"""A polygon or portal is planar when its corners are within this of its plane: metres, or of its size where that is more."""
FARTHEST = 1e12
"""Metres; a corner farther from the origin is no place in a building."""
MAX_REFLECTANCE = 0.999
"""What a reflectance of 1 or more is lowered to: such a surface would keep light for ever."""
_NAMED = 3


@dataclass(frozen=True)
class Finding:
    """Something odd in a scene, and what was done about it.

    kind : a short name of the rule, such as ``"no_area"``
    message : one sentence that names the first offenders
    polygons, portals, rooms : indices of all offenders
    """

    kind: str
    message: str
    polygons: tuple[int, ...] = ()
    portals: tuple[int, ...] = ()
    rooms: tuple[int, ...] = ()


def check(scene: Scene) -> tuple[Scene, tuple[Finding, ...]]:
    """The scene, mended where that is possible, and what was found.

    Polygons keep their indices: those without area stay in the scene, and every later stage passes over them. A portal
    that is concave or bent is replaced by the convex hull of its corners in the plane that fits them best, and keeps the
    distance of its corners from that plane as its depth: the graph may then hold needless pairs, and light is still
    stopped by the walls themselves. A portal whose normal runs against the order of its rooms gets them in the other order.

    Raises :class:`SceneError` with one sentence when the scene cannot be solved: nothing in it, corners that are no
    numbers, indices that point nowhere, or portals that do not join two rooms.
    """
    _refuse_broken_arrays(scene)
    scene = _three_corners(scene)
    _refuse_wrong_portals(scene)
    refuse_wrong_groups(scene)
    findings: list[Finding] = []
    vectors = area_vectors(scene)
    area = np.linalg.norm(vectors, axis=1)
    flat = np.flatnonzero(area <= MIN_AREA)
    if len(flat) == scene.polygon_count:
        raise SceneError("no polygon of the scene has an area; check that the meshes are not scaled to nothing")
    _add(findings, scene, "no_area", flat, "has no area and is passed over", "have no area and are passed over")
    bent = _bent_polygons(scene, vectors, area)
    _add(findings, scene, "not_planar", bent, "is not planar and is taken as triangles", "are not planar and are taken as triangles")

    reflectance, emission = scene.reflectance, scene.emission
    bright = np.flatnonzero((reflectance >= 1).any(axis=1))
    text = f"a reflectance of 1 or more, which is lowered to {MAX_REFLECTANCE}"
    _add(findings, scene, "reflectance_high", bright, f"has {text}", f"have {text}")
    below = np.flatnonzero((reflectance < 0).any(axis=1))
    _add(findings, scene, "reflectance_negative", below, "has a reflectance below 0, taken as 0", "have a reflectance below 0, taken as 0")
    dark = np.flatnonzero((emission < 0).any(axis=1))
    _add(findings, scene, "emission_negative", dark, "has an emission below 0, taken as 0", "have an emission below 0, taken as 0")
    if len(bright) or len(below):
        reflectance = np.clip(np.where(reflectance >= 1, MAX_REFLECTANCE, reflectance), 0, None)
    if len(dark):
        emission = np.clip(emission, 0, None)

    empty = np.setdiff1d(np.arange(scene.room_count), scene.room)
    if len(empty):
        names = _listed([repr(scene.room_names[r] or f"room {r}") for r in empty])
        findings.append(Finding("empty_room", f"{_count(len(empty), 'room has', 'rooms have')} no polygons: {names}", rooms=_ids(empty)))
    lamps, said = checked_lamps(scene.lamps, scene.room_count)
    findings += [Finding("lamp", sentence) for sentence in said]
    if not (emission[area > MIN_AREA] > 0).any() and not shines(lamps):
        findings.append(Finding("no_light", "nothing in the scene emits light, so the result is black"))
    portals = _turn_portals(scene, _mend_portals(scene.portals, findings), findings)
    return replace(scene, reflectance=reflectance, emission=emission, portals=portals, lamps=lamps), tuple(findings)


# ------------------------------------------------------------------------------------------------------ refusals


def _refuse_broken_arrays(scene: Scene) -> None:
    count = scene.polygon_count
    if count == 0:
        raise SceneError("the scene has no polygons; choose collections that contain meshes with faces")
    for name, values, length in (
        ("corner_vertex", scene.corner_vertex, int(scene.loop_start[-1])),
        ("polygon_start", scene.polygon_start, count + 1),
        ("loop_start", scene.loop_start, int(scene.polygon_start[-1]) + 1),
        ("reflectance", scene.reflectance, count),
        ("emission", scene.emission, count),
        ("object", scene.object, count),
    ):
        if len(values) != length:
            raise SceneError(f"the array {name} has {len(values)} entries where the other arrays ask for {length}")
    if scene.polygon_start[0] != 0 or scene.loop_start[0] != 0:
        raise SceneError("the first loop and the first polygon must start at 0")
    _refuse(scene, np.diff(scene.polygon_start) < 1, "has no outline")
    owner = loop_polygon(scene)
    _refuse_corners(scene, owner[np.diff(scene.loop_start) < 1], "has an outline without corners")
    corner_polygon = np.repeat(owner, np.diff(scene.loop_start))
    wrong = (scene.corner_vertex < 0) | (scene.corner_vertex >= len(scene.vertices))
    _refuse_corners(scene, corner_polygon[wrong], "has a corner at a vertex that does not exist")
    wrong = ~np.isfinite(scene.vertices[scene.corner_vertex]).all(axis=1)
    _refuse_corners(scene, corner_polygon[wrong], "has a corner whose position is not a finite number; repair or delete it")
    wrong = (np.abs(scene.vertices[scene.corner_vertex]) > FARTHEST).any(axis=1)
    _refuse_corners(scene, corner_polygon[wrong], f"has a corner more than {FARTHEST:g} m away from the origin; move or delete it")
    _refuse(scene, (scene.object < 0) | (scene.object >= len(scene.object_names)), "belongs to an object that does not exist", named=False)
    _refuse(scene, (scene.room < 0) | (scene.room >= scene.room_count), "lies in a room that does not exist")
    _refuse(scene, ~np.isfinite(scene.reflectance).all(axis=1), "has a reflectance that is not a finite number; set its material's colour")
    _refuse(scene, ~np.isfinite(scene.emission).all(axis=1), "has an emission that is not a finite number; set its material's emission")
    points = scene.points
    if points is not None and len(points.polygon):
        if (points.polygon < 0).any() or (points.polygon >= count).any():
            first = int(np.argmax((points.polygon < 0) | (points.polygon >= count)))
            raise SceneError(f"evaluation point {first} lies on polygon {points.polygon[first]}, which does not exist")
        finite = np.isfinite(points.position).all(axis=1) & np.isfinite(points.normal).all(axis=1)
        if not finite.all():
            raise SceneError(f"evaluation point {int(np.argmin(finite))} has a position or normal that is not a finite number")


def _refuse_wrong_portals(scene: Scene) -> None:
    portals = scene.portals
    name = lambda k: _portal(portals, k)  # noqa: E731
    if len(portals.start) != len(portals) + 1 or portals.start[-1] != len(portals.vertices):
        raise SceneError(f"the array of portal starts does not fit {len(portals)} portals of {len(portals.vertices)} corners")
    corners = np.diff(portals.start)
    for wrong, text in (
        (corners < 3, "has fewer than three corners"),
        (((portals.rooms < OUTSIDE) | (portals.rooms >= scene.room_count)).any(axis=1), "leads to a room that does not exist"),
        ((portals.rooms == OUTSIDE).all(axis=1), "joins no rooms; move it to where two rooms meet, or name its rooms"),
    ):
        if wrong.any():
            raise SceneError(f"{name(int(np.argmax(wrong)))} {text}")
    glass = portals.transmittance
    if glass is not None:
        if len(glass) != len(portals):
            raise SceneError(f"the array of transmittances has {len(glass)} entries for {len(portals)} portals")
        wrong = ~((glass >= 0) & (glass <= 1))
        if wrong.any():
            k = int(np.argmax(wrong))
            raise SceneError(f"{name(k)} has a transmittance of {glass[k]:g}; set it between 0 and 1")
    same = portals.rooms[:, 0] == portals.rooms[:, 1]
    if same.any():
        k = int(np.argmax(same))
        room = scene.room_names[portals.rooms[k, 0]] or f"room {portals.rooms[k, 0]}"
        raise SceneError(f"{name(k)} has the room {room!r} on both sides; move it to where two rooms meet, or name its rooms")
    owner = np.repeat(np.arange(len(portals)), corners)
    wrong = owner[~np.isfinite(portals.vertices).all(axis=1)]
    if len(wrong):
        raise SceneError(f"{name(int(wrong[0]))} has a corner whose position is not a finite number; repair or delete it")
    wrong = owner[(np.abs(portals.vertices) > FARTHEST).any(axis=1)]
    if len(wrong):
        raise SceneError(f"{name(int(wrong[0]))} has a corner more than {FARTHEST:g} m away from the origin; move or delete it")


def _refuse(scene: Scene, wrong: np.ndarray, text: str, named: bool = True) -> None:
    if wrong.any():
        p = int(np.argmax(wrong))
        raise SceneError(f"{_polygon(scene, p) if named else f'polygon {p}'} {text}")


def _refuse_corners(scene: Scene, polygons: np.ndarray, text: str) -> None:
    if len(polygons):
        p = int(polygons[0])
        known = 0 <= scene.object[p] < len(scene.object_names)
        raise SceneError(f"{_polygon(scene, p) if known else f'polygon {p}'} {text}")


# ------------------------------------------------------------------------------------------------------- mending


def _three_corners(scene: Scene) -> Scene:
    """The scene with the last corner of outlines of one or two corners repeated: points and edges are polygons of no area."""
    lacking = np.maximum(3 - np.diff(scene.loop_start), 0)
    if not lacking.any():
        return scene
    times = np.ones(len(scene.corner_vertex), np.int64)
    times[scene.loop_start[1:] - 1] += lacking
    return replace(
        scene,
        corner_vertex=np.repeat(scene.corner_vertex, times),
        loop_start=scene.loop_start + np.concatenate([np.zeros(1, np.int64), np.cumsum(lacking)]),
    )


def _bent_polygons(scene: Scene, vectors: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Polygons with a corner off the plane through the mean of their corners across their area vector."""
    polygon = np.repeat(loop_polygon(scene), np.diff(scene.loop_start))
    first = scene.vertices[scene.corner_vertex[scene.loop_start[scene.polygon_start[:-1]]]]
    local = scene.vertices[scene.corner_vertex] - first[polygon]
    height = np.einsum("ij,ij->i", local, (vectors / np.maximum(area, 1e-300)[:, None])[polygon])
    high, low = np.full(len(area), -np.inf), np.full(len(area), np.inf)
    np.maximum.at(high, polygon, height)
    np.minimum.at(low, polygon, height)
    size = np.sqrt(area)
    return np.flatnonzero((area > MIN_AREA) & (0.5 * (high - low) > PLANARITY * np.maximum(size, 1.0)))


def _mend_portals(portals: Portals, findings: list[Finding]) -> Portals:
    if not len(portals):
        return portals
    start = portals.start[:-1]
    counts = np.diff(portals.start)
    owner = np.repeat(np.arange(len(portals)), counts)
    local = portals.vertices - portals.vertices[start][owner]
    following = np.arange(1, len(local) + 1)
    following[portals.start[1:] - 1] = start
    vector = 0.5 * np.add.reduceat(np.cross(local, local[following]), start, axis=0)
    area = np.linalg.norm(vector, axis=1)
    extent = np.linalg.norm(np.maximum.reduceat(local, start, axis=0) - np.minimum.reduceat(local, start, axis=0), axis=1)
    normal = vector / np.maximum(area, 1e-300)[:, None]
    height = np.einsum("ij,ij->i", local, normal[owner])
    bend = 0.5 * (np.maximum.reduceat(height, start) - np.minimum.reduceat(height, start))
    bent = bend > PLANARITY * np.maximum(extent, 1.0)

    concave = _concave(local[following] - local, owner, normal, extent)

    # A bow tie has no area vector but corners that span a plane: only corners in one line let nothing pass.
    hulls = {int(k): _hull(portals.polygon(k), vector[k]) for k in np.flatnonzero(bent | concave)}
    nothing = [k for k in range(len(portals)) if (len(hulls[k]) < 3 if k in hulls else area[k] <= MIN_AREA)]
    mended = {k: hull for k, hull in hulls.items() if len(hull) >= 3}
    if nothing:
        text = f"{_count(len(nothing), 'portal has', 'portals have')} no area and let no light pass: "
        findings.append(Finding("portal_no_area", text + _listed([_portal(portals, k) for k in nothing]), portals=_ids(nothing)))
    if mended:
        text = f"{_count(len(mended), 'portal is', 'portals are')} bent or concave and taken as the convex hull of the corners: "
        findings.append(Finding("portal_hull", text + _listed([_portal(portals, k) for k in mended]), portals=_ids(mended)))
        polygons = [mended.get(k, portals.polygon(k)) for k in range(len(portals))]
        offsets = np.concatenate([np.zeros(1, np.int64), np.cumsum([len(p) for p in polygons])]).astype(np.int64)
        depth = np.zeros(len(portals)) if portals.depth is None else portals.depth.copy()
        for k in mended:
            if bent[k]:
                depth[k] += _distance_to_plane(portals.polygon(k), polygons[k])
        return replace(portals, vertices=np.concatenate(polygons), start=offsets, depth=depth if depth.any() else None)
    return portals


def _turn_portals(scene: Scene, portals: Portals, findings: list[Finding]) -> Portals:
    turned = np.flatnonzero(reversed_portals(replace(scene, portals=portals)))
    if not len(turned):
        return portals
    # The hull of a crossed outline has no sense that anyone gave it: turning it is nothing to tell.
    told = np.setdiff1d(turned, [k for finding in findings if finding.kind == "portal_hull" for k in finding.portals])
    if len(told):
        text = "normal that runs from the second to the first of its rooms, which are taken the other way round: "
        text = _count(len(told), f"portal has a {text}", f"portals have a {text}")
        findings.append(Finding("portal_turned", text + _listed([_portal(portals, k) for k in told]), portals=_ids(told)))
    rooms = portals.rooms.copy()
    rooms[turned] = rooms[turned, ::-1]
    return replace(portals, rooms=rooms)


def _concave(edge: np.ndarray, owner: np.ndarray, normal: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """(K,) bool: outlines that turn right somewhere or run around more than once; corners on a straight edge are no turn."""
    count = len(extent)
    kept = np.linalg.norm(edge, axis=1) > 1e-9 * extent[owner]  # of doubled corners one would hide the turn at the other
    edge, owner = edge[kept], owner[kept]
    first, end = np.searchsorted(owner, np.arange(count)), np.searchsorted(owner, np.arange(count), side="right")
    following = np.arange(1, len(owner) + 1)
    following[end[end > first] - 1] = first[end > first]
    sine = np.einsum("ij,ij->i", np.cross(edge, edge[following]), normal[owner])
    cosine = np.einsum("ij,ij->i", edge, edge[following])
    right = sine < -1e-7 * np.linalg.norm(edge, axis=1) * np.linalg.norm(edge[following], axis=1)
    around = np.bincount(owner, np.arctan2(sine, cosine), minlength=count)
    return (np.bincount(owner[right], minlength=count) > 0) | (np.abs(around - 2 * np.pi) > 0.1)


def _hull(corners: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """(n, 3) convex hull of points in the plane that fits them best, counter-clockwise about ``vector``; fewer than 3: in one line."""
    middle = corners.mean(axis=0)
    _, spread, axes = np.linalg.svd(corners - middle)
    if len(spread) < 2 or spread[1] <= 1e-9 * max(spread[0], 1e-300):
        return corners[:2]
    u, v = axes[0], axes[1]
    if np.cross(u, v) @ vector < 0:
        v = -v
    points = sorted(zip(((corners - middle) @ u).tolist(), ((corners - middle) @ v).tolist(), strict=True))
    hull: list[tuple[float, float]] = []
    for chain in (points, points[::-1]):  # Andrew's monotone chain: lower side, then upper
        side: list[tuple[float, float]] = []
        for x, y in chain:
            while len(side) > 1 and (side[-1][0] - side[-2][0]) * (y - side[-2][1]) <= (side[-1][1] - side[-2][1]) * (x - side[-2][0]):
                side.pop()
            side.append((x, y))
        hull += side[:-1]
    flat = np.array(hull)
    return middle + flat[:, :1] * u + flat[:, 1:] * v


def _distance_to_plane(points: np.ndarray, polygon: np.ndarray) -> float:
    """Largest distance of points (n, 3) from the plane of a planar polygon (m, 3)."""
    normal = np.cross(polygon - polygon[0], np.roll(polygon, -1, axis=0) - polygon[0]).sum(axis=0)
    return float(np.abs((points - polygon[0]) @ normal).max() / np.linalg.norm(normal))


# ---------------------------------------------------------------------------------------------------------- words


def _add(findings: list[Finding], scene: Scene, kind: str, polygons: np.ndarray, one: str, many: str) -> None:
    if len(polygons):
        names = _listed([_polygon(scene, p) for p in polygons[:_NAMED]], len(polygons))
        message = f"{names} {one}" if len(polygons) == 1 else f"{len(polygons)} polygons {many}: {names}"
        findings.append(Finding(kind, message, polygons=_ids(polygons)))


def _polygon(scene: Scene, p: int) -> str:
    return f"polygon {p} of {scene.object_names[scene.object[p]]!r}"


def _portal(portals: Portals, k: int) -> str:
    name = portals.names[k] if k < len(portals.names) else ""
    return f"portal {k} ({name!r})" if name and name != f"portal {k}" else f"portal {k}"


def _listed(names: Sequence[str], total: int | None = None) -> str:
    total = len(names) if total is None else total
    shown = ", ".join(names[:_NAMED])
    return shown if total <= _NAMED else f"{shown} and {total - _NAMED} more"


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _ids(indices: Sequence[int] | np.ndarray) -> tuple[int, ...]:
    return tuple(int(i) for i in indices)
