"""Lamps as arrays of a scene file, written only where a scene has some.

``lamps_version`` is 1. Area lamps are ``area_names``, ``area_room``, ``area_vertices``, ``area_start``, ``area_exitance`` and
``area_spread``; lamps that are points, suns and the sky begin with ``point_``, ``sun_`` and ``sky_``; all are fields of
:mod:`lamps` of the same shapes. Distributions are ``point_azimuth_0``, ``point_colatitude_0``, ``point_candela_0``,
``point_axes_0`` and so on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from .lamps import AreaLamps, Lamps, PointLamps, Sky, Suns
from .luminous_intensity import Distribution
from .scene import SceneError

VERSION = 1
_DISTRIBUTION = ("azimuth", "colatitude", "candela", "axes")


class Reader(Protocol):
    """The arrays of a file, by name, with their kind and shape checked; as in :mod:`scene_files`."""

    arrays: Mapping[str, np.ndarray]

    def numbers(self, key: str, shape: tuple[int | None, ...]) -> np.ndarray: ...

    def integers(self, key: str, shape: tuple[int | None, ...]) -> np.ndarray: ...

    def starts(self, key: str, total: int, count: int | None = None) -> np.ndarray: ...

    def texts(self, key: str, default: list[str]) -> tuple[str, ...]: ...


def lamp_arrays(lamps: Lamps, compact: Callable[[np.ndarray], np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a file; ``compact`` makes numbers as short as they can be."""
    out: dict[str, np.ndarray] = {"lamps_version": np.array(VERSION)} if lamps.any else {}
    for prefix, kind in (("area", lamps.area), ("point", lamps.points), ("sun", lamps.suns)):
        for name, value in vars(kind).items() if len(kind) else ():
            if name == "names":
                out[f"{prefix}_names"] = np.array(value, dtype=str)
            elif name == "distributions":
                for k, distribution in enumerate(value):
                    out |= {f"point_{field}_{k}": getattr(distribution, field).astype(np.float64) for field in _DISTRIBUTION}
            else:
                out[f"{prefix}_{name}"] = compact(value) if value.dtype.kind == "f" else value
    if lamps.sky is not None:
        out |= {"sky_radiance": lamps.sky.radiance.astype(np.float32), "sky_name": np.array([lamps.sky.name])}
    return out


def read_lamps(reader: Reader, where: str) -> Lamps:
    """The lamps of a file, none where it has none. Raises SceneError for arrays that do not fit each other; ``where`` names the file."""
    if "lamps_version" not in reader.arrays:
        return Lamps()
    version = reader.arrays["lamps_version"]
    if version.shape != () or version != VERSION:
        raise SceneError(f"{where}: version {version} of the lamps is not known, only version {VERSION} is")
    kinds = {}
    if "area_exitance" in reader.arrays:
        exitance = reader.numbers("area_exitance", (None, 3))
        n = len(exitance)
        vertices = reader.numbers("area_vertices", (None, 3))
        start = reader.starts("area_start", len(vertices), n)
        room, spread = reader.integers("area_room", (n,)), reader.numbers("area_spread", (n,))
        kinds["area"] = AreaLamps(_names(reader, "area", n), room, vertices, start, exitance, spread)
    if "point_intensity" in reader.arrays:
        kinds["points"] = _points(reader, where)
    if "sun_irradiance" in reader.arrays:
        irradiance = reader.numbers("sun_irradiance", (None, 3))
        n = len(irradiance)
        kinds["suns"] = Suns(_names(reader, "sun", n), reader.numbers("sun_toward", (n, 3)), irradiance, reader.numbers("sun_angle", (n,)))
    if "sky_radiance" in reader.arrays:
        name = reader.texts("sky_name", ["sky"])
        kinds["sky"] = Sky(name[0] if name else "sky", reader.numbers("sky_radiance", (None, None, 3)).astype(np.float32))
    return Lamps(**kinds)


def _points(reader: Reader, where: str) -> PointLamps:
    intensity = reader.numbers("point_intensity", (None, 3))
    n = len(intensity)
    distributions = []
    while f"point_candela_{len(distributions)}" in reader.arrays:
        k = len(distributions)
        candela = reader.numbers(f"point_candela_{k}", (None, None))
        azimuth = reader.numbers(f"point_azimuth_{k}", (candela.shape[0],))
        colatitude = reader.numbers(f"point_colatitude_{k}", (candela.shape[1],))
        distributions.append(Distribution(azimuth, colatitude, candela, reader.numbers(f"point_axes_{k}", (3, 3))))
    index = reader.integers("point_distribution", (n,))
    if len(index) and not (index.min() >= -1 and index.max() < len(distributions)):
        raise SceneError(f"{where}: the array 'point_distribution' names a distribution that the file does not have")
    ball = reader.arrays.get("point_ball")
    if ball is None or ball.dtype != bool or ball.shape != (n,):
        raise SceneError(f"{where}: the array 'point_ball' must hold {n} truth values")
    return PointLamps(
        names=_names(reader, "point", n),
        room=reader.integers("point_room", (n,)),
        position=reader.numbers("point_position", (n, 3)),
        radius=reader.numbers("point_radius", (n,)),
        ball=ball,
        intensity=intensity,
        frame=reader.numbers("point_frame", (n, 3, 3)),
        cone=reader.numbers("point_cone", (n,)),
        blend=reader.numbers("point_blend", (n,)),
        distribution=index,
        distributions=tuple(distributions),
    )


def _names(reader: Reader, prefix: str, count: int) -> tuple[str, ...]:
    names = reader.texts(f"{prefix}_names", [f"{prefix} lamp {k}" for k in range(count)])
    return names if len(names) == count else tuple(f"{prefix} lamp {k}" for k in range(count))
