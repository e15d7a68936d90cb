"""Small scenes for the tests of the numerical core, and the first stages of a solve on them."""

import numpy as np
from enfilade.core import clustering, exchanges, footprints, links, occlusion, refinement, regions, visibility_graph
from enfilade.core.building import Building, doors_of, items_of
from enfilade.core.elements import Forest
from enfilade.core.lamps import Lamps
from enfilade.core.light_sources import light_sources
from enfilade.core.parallel import Crew
from enfilade.core.scene import Portals, Scene, no_portals
from enfilade.core.shadows import hiding, in_front, visible_light
from enfilade.core.transport import edge_sum


def scene_of(polygons, reflectance=0.5, emission=0.0, room=0, object=0, portals=None) -> Scene:
    """A scene from polygons, each an (n, 3) array of corners or a list of such loops (outer, holes).

    reflectance, emission : a number, (3,) or (P, 3);  room, object : a number or (P,)
    """
    loops = [[p] if np.ndim(p[0][0]) == 0 else list(p) for p in polygons]
    flat = [np.asarray(loop, float) for polygon in loops for loop in polygon]
    count = len(polygons)
    room, object = (np.broadcast_to(np.asarray(x, np.int32), count).copy() for x in (room, object))
    return Scene(
        name="test",
        vertices=np.concatenate(flat),
        corner_vertex=np.arange(sum(map(len, flat)), dtype=np.int32),
        loop_start=np.concatenate([[0], np.cumsum([len(x) for x in flat])]).astype(np.int64),
        polygon_start=np.concatenate([[0], np.cumsum([len(x) for x in loops])]).astype(np.int64),
        reflectance=np.broadcast_to(_column(reflectance), (count, 3)).astype(float),
        emission=np.broadcast_to(_column(emission), (count, 3)).astype(float),
        room=room,
        object=object,
        room_names=tuple(f"room {i}" for i in range(int(room.max()) + 1)),
        object_names=tuple(f"object {i}" for i in range(int(object.max()) + 1)),
        portals=no_portals() if portals is None else portals,
    )


def _column(value):
    value = np.asarray(value, float)
    return value[:, None] if value.ndim == 1 and len(value) != 3 else value


def portals_of(polygons, rooms) -> Portals:
    """Portals from (n, 3) arrays of corners and pairs of rooms."""
    return Portals(
        np.concatenate([np.asarray(p, float) for p in polygons]),
        np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64),
        np.asarray(rooms, np.int32),
        tuple(f"portal {k}" for k in range(len(polygons))),
    )


def rectangle(origin, a, b) -> np.ndarray:
    """(4, 3) corners of a parallelogram; its normal is a x b."""
    o, a, b = (np.asarray(x, float) for x in (origin, a, b))
    return np.stack([o, o + a, o + a + b, o + b])


def box(low=(0, 0, 0), high=(1, 1, 1), inward=True, leave_out="") -> list[np.ndarray]:
    """Faces of a box in the order x-, x+, y-, y+, z-, z+, without those named in ``leave_out`` (such as ``"x- z+"``)."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    faces = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for end, side in ((low, "-"), (high, "+")):
            if "xyz"[axis] + side in leave_out:
                continue
            corners = np.tile(end, (4, 1))
            corners[:, i] = [low[i], high[i], high[i], low[i]]
            corners[:, j] = [low[j], low[j], high[j], high[j]]
            faces.append(corners if (side == "-") == inward else corners[::-1].copy())
    return faces


def rotation(seed) -> np.ndarray:
    """(3, 3) a random rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def building_of(scene: Scene, average=50, large_polygon=1.0, seed=0) -> Building:
    """Everything of a solve that comes before light."""
    surfaces = regions.merge(scene)
    blockers = occlusion.blockers_of(surfaces)
    surfaces = footprints.uncover(surfaces, blockers)
    clusters = clustering.cluster_items(
        items_of(surfaces),
        scene.room_count,
        average=average,
        distance=clustering.DISTANCE_FUNCTIONS["barycenter"],
        large_polygon=large_polygon,
        rng=np.random.default_rng(seed),
    )
    graph, _ = visibility_graph.build(clusters, scene.portals, scene.room_names)
    return Building(surfaces, blockers, clusters, graph, doors_of(scene.portals, surfaces.centre), scene.room_count)


def shoelace(points) -> float:
    """Signed area of a polygon of the plane."""
    x, y = np.asarray(points, float).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def crew(workers=1):
    """Workers that stand ready, so that they do all the work, however little."""
    made = Crew(workers)
    made.summon()
    return made


def linked(building, order=2, exchange=1e-3, min_size=0.01, workers=1, split=0):
    """A forest and its links for surfaces that all shine alike (1 W/m2, nothing known of slopes)."""
    forest = Forest(building.regions, order)
    for _ in range(split):
        forest.split(np.flatnonzero(forest.leaf))
    count = len(forest)
    wall = float(building.regions.area.sum())
    tolerance = np.full(len(building.regions), exchange * np.sqrt(wall))
    estimate = exchanges.Estimate(np.ones(count), np.zeros(count), tolerance)
    *_, linking = refinement.link(building, forest, estimate, min_size, crew(workers))
    return forest, linking


def received_from(forest, linking, regions) -> np.ndarray:
    """(E, m) coefficients of what every element receives over its links from exitance 1 on some regions."""
    exitance = np.zeros((len(forest), forest.functions, 1), np.float32)
    exitance[np.isin(forest.region, regions), 0] = 1
    return links.received(forest, linking.links, exitance)[..., 0]


def region_means(forest, coefficients) -> np.ndarray:
    """(G,) mean over the leaves of every region of coefficients (E, m)."""
    leaf = np.flatnonzero(forest.leaf)
    mean = forest.mean(leaf, coefficients[leaf, :, None])[:, 0]
    weight = forest.area[leaf]
    count = len(forest.regions)
    return np.bincount(forest.region[leaf], mean * weight, minlength=count) / np.bincount(forest.region[leaf], weight, minlength=count)


def visible_form_factors(points, normals, owner, outlines, blockers, pair, blocker):
    """(n,) form factors from points (n, 3) to what they see of polygons (m, k, 3), and (n,) veils; for the rest see ``visible_light``."""
    light = lambda row, parts: edge_sum(parts, normals[row])[:, None]  # noqa: E731
    corners = in_front(owner, outlines - points[owner].astype(float)[:, None], normals)
    rank = np.arange(len(pair)) - np.searchsorted(pair, pair)

    def candidates(pairs, low, high):
        rows = np.flatnonzero((rank >= low) & (rank < high) & np.isin(pair, pairs))
        return pair[rows], blocker[rows]

    found = hiding(points, owner, corners, blockers, candidates)
    seen = visible_light(points, owner, corners, blockers, found.pair, found.blocker, light)[:, 0]
    return np.where(found.veil < 0, seen, 0.0), found.veil


def light_kinds(building, lamps=None, portals=None):
    """The kinds of light of a building: its surfaces, and lamps."""
    return light_sources(building, lamps or Lamps(), portals or no_portals())
