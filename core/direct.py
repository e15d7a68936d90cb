"""Light straight from lamps, at points: the exact polygon formula over what blockers leave of them.

Emission is constant over a region, so that Lambert's formula over the part that is seen is exact, near or far. Lamps that are
points, suns and the sky are polygons too, as each point sees them (``light_kinds``), and go the same way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .building import Building
from .grouping import ragged, runs
from .light_kinds import Kind, Reach
from .occlusion import ShaftIndex, Shafts, near_axis
from .open_sky import OpenSky
from .parallel import Crew
from .patches import Patches, patch_blocks, patches_of
from .polygons import clip_half
from .shadows import Candidates, Hiding, hiding, in_front, visible_light

_PAIR_BLOCK = 1 << 16


@dataclass(frozen=True)
class DirectLight:
    """Light of the luminaires at a block of points ``index`` (n,), and the pairs of lamp and blocker that it took.

    irradiance : (n, 3) float32 W/m2
    doubt : (n,) float32 W/m2, irradiance, largest channel, from the lamps that something hides at least in part, were it not there
    veil : (n,) int64, the one blocker that alone hides all these lamps, -1 where there is none
    """

    index: np.ndarray
    irradiance: np.ndarray
    doubt: np.ndarray
    veil: np.ndarray
    tests: int


def direct_light(building: Building, kinds: tuple[Kind, ...], points: np.ndarray, region: np.ndarray, crew: Crew) -> Iterator[DirectLight]:
    """Irradiance from all ``kinds`` of light at points (N, 3) float32 (relative to the scene's centre) on the fronts of ``region`` (N,)."""
    if not kinds or not len(points):
        return
    patches = patches_of(building.regions, points, region)
    yield from crew.map(_block, (building, kinds, patches, points), patch_blocks(building, patches))


def _block(building: Building, kinds: tuple[Kind, ...], patches: Patches, points: np.ndarray, block: np.ndarray) -> DirectLight:
    """Light at the points of the patches ``block`` (k,)."""
    members, patch = ragged(patches.start[block], np.diff(patches.start)[block])
    index = patches.order[members]
    return _light(building, kinds, patches, block, index, points[index], patch)


def _light(building: Building, kinds: tuple[Kind, ...], patches: Patches, block, index, points, patch) -> DirectLight:
    """Light at points (n, 3) of the patches ``patch`` (n,), sorted."""
    count = len(points)
    result = DirectLight(index, np.zeros((count, 3), np.float32), np.zeros(count, np.float32), np.full(count, -1), 0)
    for kind in kinds:
        if isinstance(kind, OpenSky):
            light = kind.received(building, points, patches.region[block][patch]).astype(np.float32)
            result = replace(result, irradiance=result.irradiance + light)
            continue
        reach = kind.reach(building, patches, block)
        for pairs in reach.pairs:
            result = _sum(result, _shine(building, kind, reach, *pairs, index, points, patch))
    return result


def _shine(building: Building, kind: Kind, reach: Reach, patch, end, source, index, points, patch_of) -> DirectLight:
    """The light of pairs of a patch and a source, sorted by patch."""
    count, first = len(index), np.searchsorted(patch_of, np.arange(patch_of[-1] + 2))
    bodies, far = reach.patches.joined(reach.ends), len(reach.patches)
    used, place = np.unique(np.concatenate([patch, far + end]), return_inverse=True)
    bodies = bodies.take(used)
    opaque, panes = building.blockers_between(reach.nearby, *bodies.box()), building.doors.panes
    passes = np.concatenate([np.zeros(len(opaque)), building.doors.transmittance[panes.region]])
    shafts = ShaftIndex(opaque.joined(panes) if len(panes) else opaque)
    pair, blocker = Shafts(bodies, shafts).candidates(place[: len(patch)], place[len(patch) :])
    # Those first that look large from the patch: most lamps that nothing is seen of are behind one of them.
    across = shafts.blockers.middle.take(blocker, 0) - reach.patches.centre.take(patch.take(pair), 0)
    squared = np.maximum(np.einsum("ij,ij->i", across, across), 1e-18)
    blocker = blocker[np.lexsort((squared / (shafts.blockers.size**2 + 1e-30).take(blocker), pair))]
    # From patches to their points.
    point, of = ragged(first[patch], np.diff(first)[patch])
    normals = reach.patches.normal[patch_of[point]].astype(np.float64)
    places = points.astype(np.float64)
    light = np.zeros((len(point), 3))
    front = np.flatnonzero(kind.faces(source[of], places[point]))
    light[front] = _unobstructed(kind, source[of[front]], places[point[front]], normals[front])
    lit = np.flatnonzero(light.any(1))
    point, of, normals, light = point[lit], of[lit], normals[lit], light[lit]
    begin = np.searchsorted(pair, np.arange(len(patch) + 1))
    number = np.diff(begin)[of]
    balls, ends = (np.ascontiguousarray(points.T), np.zeros(count, np.float32)), bodies.balls()

    def candidates(pairs: np.ndarray, low: int, high: int) -> tuple[np.ndarray, np.ndarray]:
        many, rows = np.clip(number[pairs], low, high) - low, []
        for some in np.split(np.arange(len(pairs)), runs(np.cumsum(many) // _PAIR_BLOCK)[1:]):
            # What may be in the way of a patch is seldom in the way of a point: most rows go as soon as they are made.
            here = pairs[some]
            members, row = ragged(begin[of[here]] + low, many[some])
            which = blocker[members]
            near = near_axis(shafts, balls, ends, (point[here], place[len(patch) + of[here]]), row, which)
            rows.append((here[row[near]], which[near]))
        return tuple(np.concatenate(column) for column in zip(*rows, strict=True))

    seen, found = _obstructed(kind, source[of], points[point], normals, light, shafts.blockers, passes, candidates)
    # Glass dims but hides nothing: it leaves no doubt.
    doubtful = np.flatnonzero(found.doubtful & kind.sharp)
    doubt = np.bincount(point[doubtful], light[doubtful].max(1), minlength=count).astype(np.float32)
    veil = _common(point[doubtful], found.veil[doubtful], count)
    irradiance = np.stack([np.bincount(point, seen[:, k], minlength=count) for k in range(3)], 1).astype(np.float32)
    return DirectLight(index, irradiance, doubt, veil, found.asked)


def _sum(one: DirectLight, other: DirectLight) -> DirectLight:
    """The light of two sets of lamps at the same points."""
    veil = np.where(one.doubt == 0, other.veil, np.where((other.doubt == 0) | (one.veil == other.veil), one.veil, -1))
    return DirectLight(one.index, one.irradiance + other.irradiance, one.doubt + other.doubt, veil, one.tests + other.tests)


def _unobstructed(kind: Kind, source: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n, 3) irradiance of points (n, 3) from sources (n,) with nothing in the way."""
    out = np.zeros((len(source), 3))
    for start in range(0, len(source), _PAIR_BLOCK):
        here = slice(start, start + _PAIR_BLOCK)
        row, corners = kind.pieces(source[here], points[here])
        ahead = normals[here][row]
        height = np.einsum("nkd,nd->nk", corners, ahead)
        above = (height >= 0).all(1)
        cut = np.flatnonzero(~above & (height > 0).any(1))
        for rows, part in ((np.flatnonzero(above), corners[above]), (cut, clip_half(corners[cut], height[cut]))):
            if len(rows):
                _add(out[here], row[rows], kind.light(source[here][row[rows]], part, ahead[rows]))
    return out


def _obstructed(kind: Kind, source, points, normals, light, blockers, passes, candidates: Candidates) -> tuple[np.ndarray, Hiding]:
    """(n, 3) irradiance of points (n, 3) from sources (n,), which is ``light`` (n, 3) with nothing in the way; and what is."""
    depth = 0.0 if kind.endless else 1.0
    owner, corners = kind.pieces(source, points.astype(np.float64))
    corners = in_front(owner, corners, normals)
    found = hiding(points, owner, corners, blockers, candidates, depth, passes)
    out = np.where((found.veil >= 0)[:, None], 0.0, light)
    partly = np.zeros(len(points), bool)
    partly[found.pair] = True
    number, own, rows = np.cumsum(partly) - 1, np.flatnonzero(partly[owner]), np.flatnonzero(partly)
    mine, its = source[rows], normals[rows]
    out[rows] = visible_light(
        points[rows],
        number[owner[own]],
        corners[own],
        blockers,
        number[found.pair],
        found.blocker,
        lambda row, part: kind.light(mine[row], part, its[row]),
        depth,
        passes,
    )
    return out, found


def _add(out: np.ndarray, row: np.ndarray, light: np.ndarray) -> None:
    """Add light (m, 3) to rows (m,) of ``out`` (n, 3)."""
    for k in range(3):
        out[:, k] += np.bincount(row, light[:, k], minlength=len(out))


def _common(owner: np.ndarray, value: np.ndarray, count: int) -> np.ndarray:
    """(count,) the value that all members of an owner share, -1 where they differ or there are none."""
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(low, owner, value)
    np.maximum.at(high, owner, value)
    return np.where(low == high, high, -1)
