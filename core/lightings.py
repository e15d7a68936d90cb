"""What shines on a building in one solve: all of it, or one light group after another."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .building import Building
from .grouping import ragged
from .lamps import AreaLamps, Lamps, PointLamps, Suns
from .light_kinds import Kind
from .light_sources import light_sources
from .open_sky import OpenSky
from .scene import Scene


@dataclass(frozen=True)
class Lighting:
    """A scene and its building with what shines in one of its light groups alone, or with everything where it has no groups.

    name : of the group, "" without groups;  kinds : what shines
    """

    name: str
    scene: Scene
    building: Building
    kinds: tuple[Kind | OpenSky, ...]


def lightings_of(scene: Scene, building: Building, kinds: tuple[Kind | OpenSky, ...]) -> tuple[Lighting, ...]:
    """One lighting for each light group of a scene; ``kinds`` is all that shines, which is one lighting where there are no groups."""
    if scene.groups is None:
        return (Lighting("", scene, building, kinds),)
    group = _groups_of_regions(scene, building)
    out = []
    for k, name in enumerate(scene.groups.names):
        part, regions = lit_by(scene, k), building.regions
        emission = np.where((group == k)[:, None], regions.emission, 0.0)
        lit = replace(building, regions=replace(regions, emission=emission))
        out.append(Lighting(name, part, lit, light_sources(lit, part.lamps, scene.portals)))
    return tuple(out)


def lit_by(scene: Scene, k: int) -> Scene:
    """The scene with group ``k`` of its light groups as all that shines."""
    groups, lamps = scene.groups, scene.lamps
    emission = np.where((groups.object[scene.object] == k)[:, None], scene.emission, 0.0)
    area, points, suns = (np.flatnonzero(which == k) for which in (groups.area, groups.points, groups.suns))
    chosen = Lamps(_area(lamps.area, area), _points(lamps.points, points), _suns(lamps.suns, suns), lamps.sky if groups.sky == k else None)
    return replace(scene, emission=emission, lamps=chosen, groups=None)


def _groups_of_regions(scene: Scene, building: Building) -> np.ndarray:
    """(G,) light group of every region, -1 for those that do not shine.

    A region is of one object, but for polygons of other objects in the very place of its own; of those that shine the first counts.
    """
    region = building.regions.polygon_region
    shines = np.flatnonzero((region >= 0) & (scene.emission > 0).any(1))
    first = np.full(len(building.regions), scene.polygon_count)
    np.minimum.at(first, region[shines], shines)
    known = np.flatnonzero(first < scene.polygon_count)
    out = np.full(len(first), -1)
    out[known] = scene.groups.object[scene.object[first[known]]]
    return out


def _area(lamps: AreaLamps, rows: np.ndarray) -> AreaLamps:
    count = np.diff(lamps.start)[rows]
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    vertices = lamps.vertices[ragged(lamps.start[rows], count)[0]]
    return AreaLamps(_names(lamps.names, rows), lamps.room[rows], vertices, start, lamps.exitance[rows], lamps.spread[rows])


def _points(lamps: PointLamps, rows: np.ndarray) -> PointLamps:
    arrays = ("room", "position", "radius", "ball", "intensity", "frame", "cone", "blend", "distribution")
    return replace(lamps, names=_names(lamps.names, rows), **{name: getattr(lamps, name)[rows] for name in arrays})


def _suns(suns: Suns, rows: np.ndarray) -> Suns:
    return Suns(_names(suns.names, rows), suns.toward[rows], suns.irradiance[rows], suns.angle[rows])


def _names(names: tuple[str, ...], rows: np.ndarray) -> tuple[str, ...]:
    return tuple(names[k] for k in rows)
