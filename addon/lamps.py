# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's lamps as Cycles understands them: power, colour, shape, cone, nodes and photometric files.

Facts of Cycles, by measurement: a point of P watts has the intensity P / (4 pi), a sun's strength is the irradiance across
its light, a rectangle of P watts has the exitance P over its area. Cycles knows no unit of length: all of it is in Blender's.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core.lamps import AreaLamps, Lamps, PointLamps, Suns, no_area_lamps, no_point_lamps, no_suns
from ..core.luminaire_files import read_luminaire
from ..core.luminous_intensity import Distribution
from ..core.scene import SceneError
from .membership import Membership, rendered_objects
from .pictures import source_of

IES_EFFICACY = 177.83
"""Lumens per watt by which Cycles takes the candela of a photometric file, measured."""

IES_AXES = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Axes of a luminaire in Cycles: the half-plane 0 lies along -y of the lamp, and they turn clockwise."""

ROUND_CORNERS = 24
"""Corners of the polygon that stands for a disc or an ellipse, of the same area."""


@dataclass(frozen=True)
class ReadLamps:
    """Lamps without their rooms, and where and which way each stands that needs a room: area lamps first, then points.

    lamps : rooms are -1;  owners : of its area lamps, points and suns, what makes an instance or the lamp itself
    place : (n, 3) metres;  facing : (n, 3) unit;  home : (n,) rooms of their collections, -1 for none or many
    """

    lamps: Lamps
    owners: tuple[tuple[bpy.types.Object, ...], tuple[bpy.types.Object, ...], tuple[bpy.types.Object, ...]]
    place: np.ndarray
    facing: np.ndarray
    home: np.ndarray


def read_lamps(
    depsgraph: bpy.types.Depsgraph, view_layer: bpy.types.ViewLayer, found: Membership, scale: float, warnings: list[str]
) -> ReadLamps:
    """All lamps that are visible in renders, instances too. Raises SceneError for a photometric file that cannot be read."""
    shown = set(rendered_objects(view_layer))
    areas: list[tuple] = []
    points: list[tuple] = []
    suns: list[tuple] = []
    distributions: list[Distribution] = []
    for item in depsgraph.object_instances:
        if item.object.type != "LIGHT":
            continue
        thing = item.object.original
        owner = item.parent.original if item.is_instance else thing
        if owner not in shown or (item.is_instance and thing.hide_render):
            continue
        light, name = item.object.data, f"{thing.name} in {owner.name}" if item.is_instance else thing.name
        if light.type == "AREA" and light.cycles.is_portal:
            continue  # it only helps Cycles to find a window
        power, luminaire = _power(light, name, warnings)
        if not power.any():
            continue
        matrix = np.array(item.matrix_world)
        rooms = found.rooms.get(owner, ())
        home = rooms[0] if len(rooms) == 1 else -1
        if luminaire is not None and light.type in ("AREA", "SUN"):
            warnings.append(f"lamp '{name}' is no point or spot: its photometric file is left out")
        if light.type == "SUN":
            suns.append((name, owner, *_sun(light, matrix, power)))
        elif light.type == "AREA":
            areas.append((name, owner, home, *_area(light, name, matrix, power, scale)))
        else:
            index = -1
            if luminaire is not None:
                index = len(distributions)
                distributions.append(luminaire)
            points.append((name, owner, home, index, *_point(light, matrix, power, scale, luminaire is not None)))
    return _gathered(areas, points, suns, tuple(distributions))


def placed(read: ReadLamps, room_of: Callable[[np.ndarray, np.ndarray], np.ndarray], warnings: list[str]) -> Lamps:
    """The lamps with their rooms. ``room_of`` finds the rooms around points (n, 3) that look one way (n, 3), -1 for none."""
    lamps = read.lamps
    if not len(read.place):
        return lamps
    room = room_of(read.place, read.facing)
    lost = np.flatnonzero(room < 0)
    if len(lost):
        room[lost] = room_of(read.place[lost], -read.facing[lost])
    room = np.where(room < 0, read.home, room).astype(np.int32)
    names = lamps.area.names + lamps.points.names
    for k in np.flatnonzero(room < 0):
        warnings.append(f"lamp '{names[k]}' stands in no room: it is taken as outside, and shines in through portals alone")
    count = len(lamps.area)
    return replace(lamps, area=replace(lamps.area, room=room[:count]), points=replace(lamps.points, room=room[count:]))


def _power(light: bpy.types.Light, name: str, warnings: list[str]) -> tuple[np.ndarray, Distribution | None]:
    """(3,) colour times power, and the distribution of the lamp's photometric file if it has one."""
    power = float(light.energy) * np.array(light.color[:], float)
    if getattr(light, "use_temperature", False):
        power *= np.array(light.temperature_color[:], float)
    power *= 2.0 ** getattr(light, "exposure", 0.0)
    tree = light.node_tree
    if not light.use_nodes or tree is None:
        return power, None
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    node = source_of(output.inputs["Surface"]) if output is not None else None
    if node is None or node.mute:
        return np.zeros(3), None
    if node.type != "EMISSION":
        warnings.append(f"lamp '{name}' has a {node.bl_label} node where Emission is due: its nodes are left out")
        return power, None
    color, strength = node.inputs["Color"], node.inputs["Strength"]
    if source_of(color) is not None and source_of(color).type != "RGB":
        warnings.append(f"lamp '{name}' has nodes at the input 'Color' that cannot be read: the colour of the input itself is taken")
    rgb = source_of(color).outputs[0] if source_of(color) is not None and source_of(color).type == "RGB" else color
    power *= np.array(rgb.default_value[:3], float)
    source = source_of(strength)
    if source is None:
        return power * float(strength.default_value), None
    if source.type == "VALUE":
        return power * float(source.outputs[0].default_value), None
    if source.type == "TEX_IES":
        return power * float(source.inputs["Strength"].default_value), _distribution(source, name)
    warnings.append(f"lamp '{name}' has nodes at the input 'Strength' that cannot be read: {strength.default_value:g} is taken")
    return power * float(strength.default_value), None


def _distribution(node: bpy.types.Node, name: str) -> Distribution:
    """The distribution that an IES node shows, turned as Cycles turns it."""
    if node.mode == "INTERNAL":
        if node.ies is None:
            raise SceneError(f"lamp '{name}' has an IES node without a text: choose one")
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "text.ies")
            with open(path, "w", encoding="utf-8") as file:
                file.write(node.ies.as_string())
            try:
                luminaire = read_luminaire(path)
            except SceneError as error:
                raise SceneError(f"lamp '{name}', text '{node.ies.name}': {str(error).replace(path, 'the text')}") from error
    else:
        if not node.filepath:
            raise SceneError(f"lamp '{name}' has an IES node without a file: choose one")
        try:
            luminaire = read_luminaire(bpy.path.abspath(node.filepath))
        except SceneError as error:
            raise SceneError(f"lamp '{name}': {error}") from error
    distribution = luminaire.distribution
    return replace(distribution, axes=distribution.axes @ IES_AXES)


def _normalized(light: bpy.types.Light) -> bool:
    return getattr(light, "normalize", True)


def _sun(light, matrix: np.ndarray, power: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    toward = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    angle = min(float(light.angle), math.pi)
    if not _normalized(light) and angle > 0:
        power = power * math.pi * math.sin(0.5 * angle) ** 2
    return toward, power, angle


def _area(light, name: str, matrix: np.ndarray, power: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Corners (n, 3) in metres, exitance (3,) and spread of an area lamp."""
    x = float(light.size)
    y = float(light.size_y) if light.shape in ("RECTANGLE", "ELLIPSE") else x
    if light.shape in ("DISK", "ELLIPSE"):
        turn = 2 * math.pi * (np.arange(ROUND_CORNERS) + 0.5) / ROUND_CORNERS
        reach = math.sqrt(2 * math.pi / (ROUND_CORNERS * math.sin(2 * math.pi / ROUND_CORNERS)))
        flat = 0.5 * reach * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    else:
        flat = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    flat = flat * [x, y]
    corners = matrix[:3, 3] + flat[:, :1] * matrix[:3, 0] + flat[:, 1:] * matrix[:3, 1]
    local = corners - corners[0]
    vector = 0.5 * np.cross(local, np.roll(local, -1, 0)).sum(0)
    if not np.linalg.norm(vector) > 0:
        raise SceneError(f"lamp '{name}' has no area: give it a size and a scale above 0")
    # It shines along its -z, whatever way its scale turns the corners.
    if vector @ matrix[:3, 2] > 0:
        corners = corners[::-1]
    exitance = power / np.linalg.norm(vector) if _normalized(light) else power
    return corners * scale, exitance, float(light.spread)


def _point(light, matrix: np.ndarray, power: np.ndarray, scale: float, photometric: bool):
    """Position, radius, ball, intensity, frame, cone and blend of a point or spot."""
    radius = float(light.shadow_soft_size)
    intensity = power / IES_EFFICACY if photometric else power / (4 * math.pi)
    if not _normalized(light):
        intensity = intensity * (4 * math.pi * radius**2 if radius > 0 else 4.0)
    spot = light.type == "SPOT"
    frame = np.linalg.inv(matrix[:3, :3]) if np.linalg.det(matrix[:3, :3]) != 0 else np.eye(3)
    cone = 0.5 * float(light.spot_size) if spot else math.pi
    blend = float(light.spot_blend) if spot else 0.0
    # Distances in the square of Blender's unit: the same picture, whatever the unit is called.
    return matrix[:3, 3] * scale, radius * scale, not light.use_soft_falloff, intensity * scale**2, frame, cone, blend


def _gathered(areas: list[tuple], points: list[tuple], suns: list[tuple], distributions: tuple[Distribution, ...]) -> ReadLamps:
    """The arrays of lists of lamps."""
    area, point, sun = no_area_lamps(), no_point_lamps(), no_suns()
    place, facing, home = [], [], []
    owners = tuple(tuple(lamp[1] for lamp in kind) for kind in (areas, points, suns))
    if areas:
        names, _, homes, corners, exitance, spread = zip(*areas, strict=True)
        start = np.cumsum([0] + [len(c) for c in corners]).astype(np.int64)
        area = AreaLamps(names, np.full(len(names), -1, np.int32), np.concatenate(corners), start, np.array(exitance), np.array(spread))
        for outline in corners:
            local = outline - outline[0]
            vector = np.cross(local, np.roll(local, -1, 0)).sum(0)
            place.append(outline.mean(0))
            facing.append(vector / np.linalg.norm(vector))
        home += homes
    if points:
        names, _, homes, index, *columns = zip(*points, strict=True)
        position, radius, ball, intensity, frame, cone, blend = (np.array(column) for column in columns)
        lone = np.full(len(names), -1, np.int32)
        index = np.array(index, np.int32)
        point = PointLamps(names, lone, position, radius, ball, intensity, frame, cone, blend, index, distributions)
        place += list(position)
        facing += [-np.array(f)[2] / np.linalg.norm(np.array(f)[2]) for f in frame]
        home += homes
    if suns:
        names, _, toward, irradiance, angle = zip(*suns, strict=True)
        sun = Suns(names, np.array(toward), np.array(irradiance), np.array(angle))
    where = (np.array(v, float).reshape(-1, 3) for v in (place, facing))
    return ReadLamps(Lamps(area, point, sun), owners, *where, np.array(home, np.int64))
