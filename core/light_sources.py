"""All that shines on a scene, as kinds of light source, each there only when the scene has some of it."""

from __future__ import annotations

import numpy as np

from .building import Building
from .daylight import sun_lights, window_sky
from .flat_lights import area_lights, shining_surfaces
from .lamps import Lamps
from .light_kinds import Kind
from .open_sky import OpenSky, open_sky
from .outdoors import Outdoors, outdoors_of
from .point_lights import point_lights
from .scene import OUTSIDE, Portals


def light_sources(building: Building, lamps: Lamps, portals: Portals) -> tuple[Kind | OpenSky, ...]:
    """The kinds of light that a scene has: its emitting surfaces, and ``lamps`` if any."""
    clearance, centre = building.blockers.clearance, building.regions.centre
    kinds: list[Kind | OpenSky | None] = []
    if (building.regions.emission > 0).any():
        kinds.append(shining_surfaces(building.regions, building.clusters, clearance))
    outside = lamps.from_outside or (lamps.area.room == OUTSIDE).any() or (lamps.points.room == OUTSIDE).any()
    outdoors = outdoors_of(building) if outside else _indoors(building)
    if len(lamps.area):
        kinds.append(area_lights(lamps.area, centre, outdoors.regions, clearance))
    if len(lamps.points):
        kinds.append(point_lights(lamps.points, centre, outdoors.regions))
    if len(lamps.suns):
        kinds.append(sun_lights(lamps.suns, building, outdoors))
    if lamps.sky is not None:
        kinds += [window_sky(lamps.sky, building, portals, outdoors), open_sky(lamps.sky, building, outdoors)]
    return tuple(kind for kind in kinds if kind is not None)


def _indoors(building: Building) -> Outdoors:
    return Outdoors(np.zeros(building.room_count, bool), np.zeros(len(building.regions), bool))
