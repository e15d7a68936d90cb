"""Clusters that are only boxes, and worlds of rooms and portals with pairs of them that are proven to see each other."""

import json
from pathlib import Path

import numpy as np
from enfilade.core.clustering import Clusters

WORLDS = json.loads((Path(__file__).resolve().parents[1] / "data" / "portal_worlds.json").read_text())


def box_clusters(low, high, room, rooms=None, polygons=None) -> Clusters:
    """Clusters that are only boxes with rooms, one polygon in each unless ``polygons`` says how many."""
    count, rooms = len(room), max(room) + 1 if rooms is None else rooms
    return Clusters(
        cluster_of=np.arange(count, dtype=np.int32),
        start=np.arange(count + 1),
        members=np.arange(count, dtype=np.int32),
        room=np.asarray(room, np.int32),
        polygons=np.ones(count, np.int64) if polygons is None else np.asarray(polygons),
        box_min=np.asarray(low, float).reshape(-1, 3),
        box_max=np.asarray(high, float).reshape(-1, 3),
        iterations=np.zeros(rooms, np.int32),
        oscillated=np.zeros(rooms, bool),
    )


def world_of(case):
    """Low and high corners and rooms of the clusters; the portals as polygons, turned from first to second room, and these rooms."""
    low, high = (np.array([c[key] for c in case["clusters"]]) for key in ("low", "high"))
    room = np.array([c["room"] for c in case["clusters"]])
    middle = np.array([0.5 * (low[room == r].min(axis=0) + high[room == r].max(axis=0)) for r in range(case["rooms"])])
    polygons = []
    for portal in case["portals"]:
        corners, (a, b) = np.array(portal["corners"], float), portal["rooms"]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        polygons.append(corners if normal @ (middle[b] - middle[a]) > 0 else corners[::-1])
    return low, high, room, polygons, [p["rooms"] for p in case["portals"]]
