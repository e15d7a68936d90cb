"""How fast the light of a smooth pair comes right as its elements become smaller: once, twice, three times their size in the exponent."""

from __future__ import annotations

import numpy as np

from ...core import basis, clustering, occlusion, regions, visibility_graph
from ...core.building import Building, doors_of, items_of
from ...core.elements import Forest
from ...core.exchanges import Estimate
from ...core.links import received
from ...core.options import Options
from ...core.parallel import Crew
from ...core.refinement import link
from .quadrature import normal_of
from .scenes import scene_of
from .tables import Table, met

ROUNDS = 5
"""Elements are quartered this many times."""
SOURCE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
RECEIVER = np.array([[0.2, 0.1, 1.5], [0.2, 1.1, 1.7], [1.2, 1.1, 1.7], [1.2, 0.1, 1.5]])
"""Two squares of about a metre, the one over the other and tilted; nothing between."""
NODES = 24
"""Gauss nodes along each side of the source for the exact light, and places along each side of an element where it is compared."""
PLACES = 4


def measure(quick: bool) -> Table:
    """Slopes of the error against the size of elements, for each basis."""
    rows, lines = [], []
    for order in (1, 2, 3):
        errors = [error_at(order, k) for k in range(ROUNDS - 1 if quick else ROUNDS)]
        slope = slope_of(errors)
        rows.append([f"M{order}", *(f"{e:.1e}" for e in errors), f"{slope:.2f}"])
        lines.append(
            [f"slope of the error against element size, M{order}", f"{order} within 0.2", f"{slope:.2f}", met(abs(slope - order) <= 0.2)]
        )
    head = ["basis", *(f"1/{2**k} m" for k in range(len(rows[0]) - 2)), "slope"]
    text = (
        "Root mean square error of the irradiance on a square, as its elements represent it, over its mean, when a square with smoothly "
        "varying exitance shines on it from 1.6 m; both in elements of the same size, which the oracle links. The slope is that "
        "of the last halving."
    )
    return Table("Convergence", text, head, rows, lines)


def slope_of(errors: list[float]) -> float:
    """The power of the size with which the error falls at the last halving."""
    return float(np.log2(errors[-2] / errors[-1]))


def exitance(points: np.ndarray) -> np.ndarray:
    """(n,) W/m2, smooth and of no finite order."""
    return 1 + 0.5 * np.cos(2 * points[:, 0] + 0.7) * np.sin(1.5 * points[:, 1] + 0.4)


def error_at(order: int, rounds: int) -> float:
    """Relative error with elements quartered ``rounds`` times."""
    building = _building()
    forest = Forest(building.regions, order)
    for _ in range(rounds):
        forest.split(np.flatnonzero(forest.leaf))
    count = len(forest)
    # No error is small enough for the oracle, and no element large enough to be split further: it links the leaves.
    estimate = Estimate(np.ones(count), np.zeros(count), np.full(len(building.regions), 1e-12))
    *_, linking = link(building, forest, estimate, 1e9, Crew(1))
    receiver, source = building.regions.polygon_region
    centre = building.regions.centre
    nodes = forest.nodes.reshape(-1, 3) + centre
    light = exitance(nodes).reshape(count, -1, 1) * (forest.region == source)[:, None, None]
    coefficients = received(forest, linking.links, forest.from_nodes(np.arange(count), light).astype(np.float32))
    leaf = np.flatnonzero(forest.leaf & (forest.region == receiver))
    uv, weights = basis.gauss_square(PLACES)
    box = forest.box[leaf]
    places = box[:, None, :2] + uv * box[:, None, 2:]
    points = building.regions.world(np.repeat(forest.region[leaf], len(uv)), places.reshape(-1, 2)) + centre
    found = coefficients[leaf, :, 0].astype(float) @ basis.evaluate(order, uv).T
    exact = exact_light(points).reshape(found.shape)
    weight = forest.area_of(leaf)[:, None] * weights
    return float(np.sqrt((weight * (found - exact) ** 2).sum() / weight.sum()) / ((weight * exact).sum() / weight.sum()))


def exact_light(points: np.ndarray) -> np.ndarray:
    """(n,) irradiance on the receiver: a Gauss rule over the source, exact to rounding for so smooth a kernel."""
    x, w = basis.gauss_square(NODES)
    source = SOURCE[0] + x[:, :1] * (SOURCE[1] - SOURCE[0]) + x[:, 1:] * (SOURCE[3] - SOURCE[0])
    out = np.empty(len(points))
    for start in range(0, len(points), 512):
        part = points[start : start + 512]
        d = source - part[:, None]
        r2 = (d * d).sum(2)
        cosines = (d @ normal_of(RECEIVER)) * -(d @ normal_of(SOURCE))
        out[start : start + 512] = (cosines / (np.pi * r2 * r2)) @ (w * exitance(source))
    return out


def _building() -> Building:
    scene = scene_of([RECEIVER, SOURCE], 0.5, 0.0)
    surfaces = regions.merge(scene)
    items = items_of(surfaces)
    clusters = clustering.cluster_as_chosen(items, 1, Options(), np.random.default_rng(0))
    graph, _ = visibility_graph.build_as_chosen(clusters, items, scene.portals, scene.room_names, Options())
    return Building(surfaces, occlusion.blockers_of(surfaces), clusters, graph, doors_of(scene.portals, surfaces.centre), 1)
