"""The light of a solved scene at any points of its surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import basis
from .building import Building
from .coverage import covered
from .direct import direct_light
from .elements import Forest
from .exitance_map import ExitanceMap, beside, exitance_map
from .gather import gather
from .light_kinds import Kind
from .parallel import Crew
from .regions import Regions
from .scene import Scene

EDGE = 1e-4
"""Points on the edge of a polygon are moved in by this part of its region's size: on the edge itself light is undefined."""

RIM = 3e-3
"""So near to what lies on it, metres, a surface counts as hidden: there, rounding decides what a point sees."""
RAYS_ABOVE = 384
"""Rays that gather the reflected light of points in the open space where none are asked for on surfaces."""


@dataclass(frozen=True)
class Light:
    """The light on every element, as it is saved; E elements, m coefficients.

    region, level : (E,);  children : (E, 4), -1 where there is none;  box : (E, 4) u, v, width, height in the region's frame, m
    direct, reflected : (E, m, 3) float32 irradiance coefficients, ancestors included, W/m2
    """

    region: np.ndarray
    level: np.ndarray
    children: np.ndarray
    box: np.ndarray
    direct: np.ndarray
    reflected: np.ndarray


@dataclass(frozen=True, eq=False)
class Contribution:
    """The light of some of a scene's lamps.

    kinds : the lamps;  direct, reflected : (E, m, 3) float32 irradiance coefficients as of :class:`Light`, W/m2
    """

    kinds: tuple[Kind, ...]
    direct: np.ndarray
    reflected: np.ndarray


class Solution:
    """Exitance and irradiance at surface points, and the ``report`` of the solve (a dict that JSON can hold).

    ``clamped_values`` in it counts the values that :meth:`irradiance` has set to zero because they came out negative.

    The direct light of all kinds of lamps is computed anew at every point. The reflected light is gathered there by ``rays`` over
    its hemisphere from the exitance of the wavelet solution, in texels of ``texel`` metres; without rays it is that of the elements.
    ``groups`` are the contributions of the scene's light groups, where it has some.
    """

    def __init__(
        self,
        scene: Scene,
        building: Building,
        forest: Forest,
        kinds: tuple[Kind, ...],
        direct: np.ndarray,
        reflected: np.ndarray,
        rays: int,
        texel: float,
        crew: Crew,
        report: dict,
        groups: tuple[Contribution, ...] = (),
    ):
        self._scene, self._building, self._forest, self._crew = scene, building, forest, crew
        self._direct, self._reflected = direct, reflected
        self._whole, self._groups = (Contribution(kinds, direct, reflected),), groups
        self._rays, self._texel = rays, texel
        self._maps: dict[tuple[Contribution, ...], ExitanceMap] = {}
        self.report = report | {"clamped_values": 0}

    @property
    def regions(self) -> Regions:
        """The surfaces."""
        return self._building.regions

    @property
    def forest(self) -> Forest:
        """The elements of the surfaces."""
        return self._forest

    @property
    def scene(self) -> Scene:
        """What was solved."""
        return self._scene

    @property
    def building(self) -> Building:
        """Its surfaces, clusters and rooms, as they were for the solver."""
        return self._building

    @property
    def light(self) -> Light:
        """The light on the elements, as arrays."""
        forest = self._forest
        return Light(forest.region, forest.level, forest.children, forest.box, self._direct, self._reflected)

    def irradiance(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """(N, 3) float32 W/m2 on the fronts of ``polygon`` (N,) at ``points`` (N, 3) world positions, own emission excluded.

        Points may lie on the boundary of their polygon. A polygon without area gets zero. Values that the linear functions
        take below zero are set to zero.
        """
        out = np.zeros((len(points), 3), np.float32)
        for _ in self.irradiance_steps(points, polygon, out):
            pass
        return out

    def irradiance_of_groups(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """(N, G, 3) float32 W/m2: as :meth:`irradiance`, by each of the light groups of the scene alone."""
        out = np.zeros((len(points), 3 * len(self._groups)), np.float32)
        for _ in self._irradiance_steps(self._groups, points, polygon, out):
            pass
        return out.reshape(len(points), -1, 3)

    def shows(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """(N,) bool: the fronts of ``polygon`` (N,) are open at ``points`` (N, 3), neither under what lies on them nor at its edge."""
        regions = self._building.regions
        region = regions.polygon_region[np.asarray(polygon, np.int64)]
        out = np.zeros(len(region), bool)
        valid = np.flatnonzero(region >= 0)
        own = region[valid].astype(np.int64)
        uv = regions.local(own, np.asarray(points, np.float64)[valid])
        open_ = ~regions.buried[own]
        for side in RIM * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]):
            open_ &= covered(regions, own, _inside(uv + side, regions.size[own]), 1e-6)
        out[valid] = open_
        return out

    def irradiance_steps(self, points: np.ndarray, polygon: np.ndarray, out: np.ndarray) -> Iterator[float]:
        """As :meth:`irradiance`, into ``out`` (N, 3); yields the share of the work done."""
        yield from self._irradiance_steps(self._whole, points, polygon, out)

    def _irradiance_steps(
        self, parts: tuple[Contribution, ...], points: np.ndarray, polygon: np.ndarray, out: np.ndarray
    ) -> Iterator[float]:
        """The irradiance by each of the parts, three channels after three, into ``out`` (N, c)."""
        regions = self._building.regions
        region = regions.polygon_region[np.asarray(polygon, np.int64)]
        valid = np.flatnonzero(region >= 0)
        region = region[valid].astype(np.int64)
        uv = regions.local(region, np.asarray(points, np.float64)[valid])
        uv = _inside(uv, regions.size[region])
        position = regions.world(region, uv).astype(np.float32)
        light = np.zeros((len(region), out.shape[1]), np.float32)
        if not self._rays:
            light[:] = np.concatenate([self._smooth(part.reflected, region, uv) for part in parts], axis=1)
        yield from self._arriving(parts, position, region, self._rays, light)
        self.report["clamped_values"] += int((light < 0).sum())
        out[valid] = np.maximum(light, 0)

    def irradiance_above_steps(self, points: np.ndarray, polygon: np.ndarray, out: np.ndarray) -> Iterator[float]:
        """Irradiance (N, 3) on small planes at points (N, 3) of the open space, parallel to ``polygon`` (N,), into ``out``.

        All points of a polygon lie at one height over it, in its room. Yields the share of the work done.
        """
        regions = self._building.regions
        region = regions.polygon_region[np.asarray(polygon, np.int64)].astype(np.int64)
        position = (np.asarray(points, np.float64) - regions.centre).astype(np.float32)
        yield from self._arriving(self._whole, position, region, self._rays or RAYS_ABOVE, out)

    def _arriving(
        self, parts: tuple[Contribution, ...], position: np.ndarray, region: np.ndarray, rays: int, light: np.ndarray
    ) -> Iterator[float]:
        """Add the direct light, and with ``rays`` the reflected light, to ``light`` (n, c) of points facing as ``region`` (n,)."""
        done, whole = 0, max(len(region), 1) * (len(parts) + (1 if rays else 0))
        for k, part in enumerate(parts):
            for found in direct_light(self._building, part.kinds, position, region, self._crew):
                light[found.index, 3 * k : 3 * k + 3] += found.irradiance
                done += len(found.index)
                yield done / whole
        for found in gather(self._building, self._exitance_map(parts), position, region, rays, self._crew) if rays else ():
            light[found.index] += found.irradiance
            done += len(found.index)
            yield done / whole

    def _exitance_map(self, parts: tuple[Contribution, ...]) -> ExitanceMap:
        """Made at its first use."""
        if parts not in self._maps:
            regions, forest = self._building.regions, self._forest
            maps = [exitance_map(regions, forest, part.direct, part.reflected, self._texel) for part in parts]
            self._maps[parts] = maps[0] if len(maps) == 1 else beside(maps)
        return self._maps[parts]

    def exitance(self, points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """(N, 3) float32 W/m2: emission + reflectance * irradiance."""
        polygon = np.asarray(polygon, np.int64)
        reflected = self._scene.reflectance[polygon] * self.irradiance(points, polygon)
        return (self._scene.emission[polygon] + reflected).astype(np.float32)

    def polygon_exitance(self) -> np.ndarray:
        """(P, 3) float32 W/m2, mean over the region that each polygon was merged into; emission alone without area."""
        region = self._building.regions.polygon_region
        roots = np.arange(len(self._building.regions))
        mean = self._forest.mean(roots, self._direct[roots] + self._reflected[roots])
        light = np.where(region[:, None] >= 0, mean[np.maximum(region, 0)], 0.0)
        return (self._scene.emission + self._scene.reflectance * np.maximum(light, 0)).astype(np.float32)

    def _smooth(self, reflected: np.ndarray, region: np.ndarray, uv: np.ndarray) -> np.ndarray:
        """(n, 3) float32 reflected irradiance at points of the frames of ``region``, averaged over four places around each.

        The polynomials of neighbouring elements do not meet exactly. The four places lie evenly about the point, a quarter of its
        element away, so that what is linear stays as it is and the steps between elements become ramps. Towards the border
        of the surface they close in on the point.
        """
        element, own = self._at(reflected, region, uv)
        reach = np.minimum(0.25 * self._forest.box[element, 2:], np.minimum(uv, self._building.regions.size[region] - uv))
        reach *= 1 - 1e-9  # rounding must not carry a place over the border
        total, leaf = np.zeros_like(own), self._forest.leaf
        for side in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]):
            other, light = self._at(reflected, region, uv + side * reach)
            # Where the surface has a hole there is no element to ask: the point speaks for itself.
            total += np.where(leaf[other][:, None], light, own)
        return total / 4

    def _at(self, reflected: np.ndarray, region: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The elements (n,) at points, and their reflected irradiance (n, 3) there."""
        element, local = self._forest.locate(region, uv)
        values = basis.evaluate(self._forest.order, local).astype(np.float32)
        return element, np.einsum("nm,nmc->nc", values, reflected[element])


def _inside(uv: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.clip(uv, EDGE * size, (1 - EDGE) * size)
