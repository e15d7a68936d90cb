"""The power of lamps, of sun and sky as far as it enters, and lamps that shine on nothing."""

from __future__ import annotations

import numpy as np

from .building import Building
from .daylight import SunLights, WindowSky
from .direct import direct_light
from .elements import Forest
from .lamps import AreaLamps, Lamps, PointLamps
from .light_kinds import Kind
from .occlusion import first_hits, hemisphere
from .open_sky import OpenSky
from .parallel import Crew
from .scene import OUTSIDE

SAMPLES = 1 << 11
"""Points at which the light from outside is told from that of lamps."""
_DAYLIGHT = (SunLights, WindowSky, OpenSky)


def lamp_power(lamps: Lamps) -> float:
    """W that area lamps, points and spots give, all channels together; exact."""
    return float(area_power(lamps.area).sum() + point_power(lamps.points).sum())


def area_power(lamps: AreaLamps) -> np.ndarray:
    """(L, 3) W of each area lamp."""
    owner = np.repeat(np.arange(len(lamps)), np.diff(lamps.start))
    following = np.arange(len(lamps.vertices)) + 1
    following[lamps.start[1:] - 1] = lamps.start[:-1]
    local = lamps.vertices - lamps.vertices[lamps.start[:-1]][owner]
    vector = np.zeros((len(lamps), 3))
    np.add.at(vector, owner, 0.5 * np.cross(local, local[following]))
    return lamps.exitance * np.linalg.norm(vector, axis=1)[:, None]


def point_power(lamps: PointLamps) -> np.ndarray:
    """(L, 3) W of each point lamp: its intensity over the directions of its cone, or the flux of its distribution.

    A lamp with both, or whose frame is not of equal scale along all axes, counts as without its cone, or as of equal scale.
    """
    edge = np.cos(np.minimum(lamps.cone, np.pi))
    # The smooth edge of a cone takes half of what is within it away.
    solid = np.where(lamps.cone < np.pi, 2 * np.pi * (1 - edge) * (1 - 0.5 * lamps.blend), 4 * np.pi)
    flux = np.array([d.flux() for d in lamps.distributions] + [0.0])
    return lamps.intensity * np.where(lamps.distribution >= 0, flux[lamps.distribution], solid)[:, None]


def entered_power(building: Building, forest: Forest, kinds: tuple[Kind, ...], light: np.ndarray, crew: Crew) -> float:
    """W of sun and sky that surfaces receive, all channels together.

    light : (E, m, 3) direct irradiance of all kinds. Where lamps shine as well, points chosen by how bright it is tell the shares.
    """
    outside = tuple(kind for kind in kinds if isinstance(kind, _DAYLIGHT))
    if not outside:
        return 0.0
    leaf = np.flatnonzero(forest.leaf)
    weight = np.maximum(forest.at_nodes(leaf, light[leaf]).sum(2), 0) * forest.node_weights_of(leaf)
    total = float(weight.sum())
    if len(outside) == len(kinds) or not total > 0:
        return total
    running = np.cumsum(weight.reshape(-1).astype(np.float64))
    chosen = np.minimum(np.searchsorted(running, (np.arange(SAMPLES) + 0.5) / SAMPLES * running[-1]), len(running) - 1)
    element, node = leaf[chosen // forest.node_count], chosen % forest.node_count
    share = []
    for some in (outside, kinds):
        received = np.zeros(SAMPLES)
        for part in direct_light(building, some, forest.node_of(element, node), forest.region[element], crew):
            received[part.index] = part.irradiance.sum(1)
        share.append(received)
    return total * float((share[0] / np.maximum(share[1], 1e-30)).mean())


def idle_lamps(building: Building, lamps: Lamps, kinds: tuple[Kind, ...]) -> list[str]:
    """Sentences about lamps that shine on nothing: sun and sky without a way in, and lamps inside walls."""
    said = []
    if lamps.from_outside and not _comes_in(building, kinds):
        names = [f"the sun '{name}'" for name in lamps.suns.names] + ([f"the sky '{lamps.sky.name}'"] if lamps.sky is not None else [])
        said.append(f"{_listed(names)} lights nothing, since no portal leads outside: put a portal into every window")
    names = lamps.area.names + lamps.points.names
    first = lamps.area.start[:-1]
    middle = [lamps.area.vertices[a:b].mean(0) for a, b in zip(first, lamps.area.start[1:], strict=True)]
    place = np.concatenate([np.array(middle).reshape(-1, 3), lamps.points.position]) - building.regions.centre
    room = np.concatenate([lamps.area.room, lamps.points.room])
    for k in np.flatnonzero(room != OUTSIDE):
        if _in_a_wall(building, place[k], int(room[k])):
            said.append(f"lamp '{names[k]}' stands inside a wall or a piece of furniture and lights nothing: move it out")
    return said


def _comes_in(building: Building, kinds: tuple[Kind, ...]) -> bool:
    for kind in kinds:
        if isinstance(kind, OpenSky | WindowSky):
            return True
        if isinstance(kind, SunLights) and (kind.outdoors.any() or (kind.rooms == OUTSIDE).any()):
            return True
    return False


def _in_a_wall(building: Building, place: np.ndarray, room: int, rays: int = 64) -> bool:
    """Do most rays from a place (3,) of a room meet the backs of surfaces?"""
    clusters = np.flatnonzero(building.clusters.room == room)
    if not len(clusters):
        return False
    near = building.blockers_of(building.regions_of(building.surroundings(clusters))[0])
    up = hemisphere(rays // 2)
    direction = np.concatenate([up, -up]).astype(np.float32)
    hits = first_hits(near, np.repeat(place[None], len(direction), 0).astype(np.float32), direction)
    return bool(hits.behind.mean() > 0.75)


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]} each"
