"""The figures of a solve, as a dict that JSON can hold: what the command line prints and the panel shows."""

from __future__ import annotations

import numpy as np

from .building import Building, items_of
from .clustering.quality import as_report, quality_of
from .elements import Forest
from .memory import peak_bytes
from .shooting import Radiosity
from .stages import Linked


def report_of(
    polygons: int,
    building: Building,
    forest: Forest,
    linked: Linked,
    radiosity: Radiosity,
    irradiance: np.ndarray,
    closed: np.ndarray,
    emitted: float,
    escaped: float,
) -> dict:
    """irradiance : (E, m, 3) of every element, direct and reflected, W/m2;  closed : (R,) bool of every room
    emitted : W of surfaces, of lamps, and of what enters from outside;  escaped : W that leaves again

    Powers are sums over the three channels, W. ``residual_bound`` (W/m2) bounds what the unshot light can still add anywhere,
    ``dropped_bound`` (W) the light of exchanges too small to be linked.
    """
    regions, graph = building.regions, building.graph
    roots = np.arange(len(regions))
    absorbed = ((1 - regions.reflectance) * regions.area[:, None] * forest.mean(roots, irradiance[roots])).sum()
    brightest = float(regions.reflectance.max(initial=0.0))
    return {
        "rooms": building.room_count,
        "rooms_closed": int(closed.sum()),
        "lost_rays": float(linked.lost.max(initial=0.0)),
        "polygons": polygons,
        "clusters": len(building.clusters),
        "rooms_oscillated": int(building.clusters.oscillated.sum()),
        "cluster_quality": as_report(quality_of(items_of(regions), building.clusters, graph)),
        "portals": len(building.doors.area),
        "pvs_polygons_max": int(graph.pvs_polygons.max(initial=0)),
        "pvs_polygons_mean": float(graph.pvs_polygons.mean()),
        "elements": len(forest),
        "links": linked.count,
        "iterations": radiosity.iterations,
        "unshot_fraction": float(radiosity.unshot.sum() / max(emitted, 1e-300)),
        "residual_bound": brightest / (1 - brightest) * radiosity.unshot_exitance if brightest < 1 else float("inf"),
        "dropped_bound": linked.dropped,
        "energy": {"emitted": emitted, "absorbed": float(absorbed), "escaped": escaped},
        "segment_tests": linked.segment_tests,
        "peak_bytes": peak_bytes(),
    }


def emitted_power(building: Building) -> float:
    """W that the surfaces emit, all channels together, without what is buried under other surfaces."""
    regions = building.regions
    return float((regions.emission.sum(1) * regions.area * ~regions.buried).sum())
