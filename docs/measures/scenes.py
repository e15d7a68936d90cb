"""Small scenes from polygons, and the tables of exact answers that they are held against."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ...core.scene import Scene

DATA = Path(__file__).resolve().parents[2] / "tests" / "data"


def table(name: str) -> dict:
    """A table of tests/data."""
    return json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))


def scene_of(polygons: list, reflectance, emission) -> Scene:
    """One room of grey polygons (n, 3), each an object of its own.

    reflectance, emission : a number or one for each polygon; exitance in W/m2
    """
    count = len(polygons)
    sizes = [len(p) for p in polygons]
    grey = [np.repeat(np.broadcast_to(np.asarray(x, float), count)[:, None], 3, 1) for x in (reflectance, emission)]
    return Scene(
        name="measure",
        vertices=np.concatenate([np.asarray(p, float) for p in polygons]),
        corner_vertex=np.arange(sum(sizes), dtype=np.int32),
        loop_start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        polygon_start=np.arange(count + 1, dtype=np.int64),
        reflectance=grey[0],
        emission=grey[1],
        room=np.zeros(count, np.int32),
        object=np.arange(count, dtype=np.int32),
        room_names=("room",),
        object_names=tuple(f"surface {k}" for k in range(count)),
    )


def square(at: np.ndarray, normal: np.ndarray, size: float) -> np.ndarray:
    """(4, 3) a square around a point with the given normal."""
    normal = np.asarray(normal, float)
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    corner = 0.5 * size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.asarray(at, float) + corner[:, :1] * u + corner[:, 1:] * v
