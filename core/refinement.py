"""The oracle: which pairs of elements exchange light, how finely, and what is too small to matter.

Pairs of regions of two clusters that see each other start at their root elements. A pair is accepted when the light
that it carries is known well enough by its nodes, split on its larger side otherwise, one level of all pairs of the
building at a time (Hanrahan et al. 1991; Bekaert and Willems 1996). Errors are absolute irradiances at the receiver,
in the mean square over its area, so that work goes where the light is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import transport
from .building import Building
from .elements import Forest
from .grouping import ragged
from .links import LinkSet, joined
from .occlusion import Blockers, Bodies, Cuts, Shafts, cut_segments
from .parallel import ordered_map

# Relative errors of one exchange, in the mean square over the receiver, for elements of radius r at distance d: the second
# derivative of the kernel leaves 0.3 (r/d)**2 of a linear function, the first 0.8 r/d of a constant; a node in place of a
# rule misses 0.6 (r/d)**2 of the source; a sampled visibility misses a part of its own spread.
LINEAR, CONSTANT, ONE_SOURCE, PARTLY_SEEN = 0.3, 0.8, 0.6, 0.3
FAR = 1.5
"""Elements this many sums of their radii apart may be one node each."""
TOUCHING = 1.0
"""Elements closer than this many sums of their radii take the exact polygon formula (design measure: Gauss is 1 % wrong there)."""
NEGLIGIBLE = 1e-3
"""An exchange below this part of what is admissible as an error is left out and its bound added to the total."""
BLOCK_PAIRS = 1 << 14
"""Pairs of elements that one thread treats at once."""


@dataclass(frozen=True)
class Estimate:
    """What is known of the light before the links are made, for the oracle alone.

    exitance : (E,) float64, largest channel of the mean reflected exitance of every element, W/m2
    tolerance : (G,) float64, per region, admissible error times the root of the receiver's area, W/m
    """

    exitance: np.ndarray
    tolerance: np.ndarray


@dataclass(frozen=True)
class Linking:
    """All links of a building and what it took: ``dropped`` bounds the power (W) of the exchanges left out."""

    links: list[LinkSet]
    dropped: float
    segment_tests: int


@dataclass(frozen=True)
class _Block:
    """Pairs of elements of one start: a group of clusters and a room that it sees, which share the blockers between them."""

    start: int
    a: np.ndarray
    b: np.ndarray


@dataclass
class _Outcome:
    links: list[LinkSet]
    split_a: tuple[np.ndarray, np.ndarray]
    split_b: tuple[np.ndarray, np.ndarray]
    dropped: float
    segment_tests: int


def link(building: Building, forest: Forest, estimate: Estimate, min_size: float, workers: int) -> Iterator[float | Linking]:
    """Make the links of a building; elements are split on the way. Yields the share of the work done, at last the links.

    min_size : metres, elements are not split below it
    """
    starts = [start for group in _cluster_groups(building) for start in _first_pairs(building, group)]
    blockers = [building.blockers_between(nearby, *_hull(building, np.concatenate([a, b]))) for nearby, a, b in starts]
    exitance = estimate.exitance
    blocks = [block for k, (_, a, b) in enumerate(starts) for block in _blocks_of(k, a, b)]
    links, dropped, tests, rounds = [], 0.0, 0, 0
    while blocks:
        total, done, outcomes = len(blocks), 0, []

        def treat(block: _Block, exitance=exitance) -> _Outcome:
            return _treat(forest, blockers[block.start], exitance, estimate.tolerance, min_size, block)

        for outcome in ordered_map(treat, blocks, workers):
            outcomes.append(outcome)
            done += 1
            yield 1 - 0.5 ** (rounds + done / total)
        rounds += 1
        links = joined(links + [s for o in outcomes for s in o.links])
        dropped += sum(o.dropped for o in outcomes)
        tests += sum(o.segment_tests for o in outcomes)
        forest.split(np.concatenate([o.split_a[0] for o in outcomes] + [o.split_b[1] for o in outcomes]))
        # A child is as bright as its parent until more is known.
        known = len(exitance)
        exitance = np.concatenate([exitance, np.zeros(len(forest) - known)])
        exitance[known:] = exitance[forest.parent[known:]]
        blocks = [child for block, o in zip(blocks, outcomes, strict=True) for child in _blocks_of(block.start, *_children(forest, o))]
    yield Linking(links, dropped, tests)


def _cluster_groups(building: Building) -> list[np.ndarray]:
    """Clusters of one room in groups of a few, so that small clusters share the overhead of a block."""
    clusters = building.clusters
    size = np.diff(clusters.start)
    order = np.argsort(clusters.room, kind="stable")
    room = clusters.room[order]
    fresh = np.r_[True, room[1:] != room[:-1]]
    run = np.flatnonzero(fresh)[np.cumsum(fresh) - 1]
    total = np.cumsum(size[order])
    part = (total - total[run]) // 64
    cut = np.flatnonzero(fresh | np.r_[False, part[1:] != part[:-1]])
    return np.split(order, cut[1:])


def _first_pairs(building: Building, group: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Clusters in the PVS of ``group`` and root elements (equal to regions) of pairs of regions, for each room that the group sees.

    Every pair of regions whose clusters see each other comes once in all groups: where its lesser cluster is in the group.
    """
    own, other = [], []
    for cluster in group:
        near = building.graph.neighbours(int(cluster))
        mine = building.regions_of(np.array([cluster]))[0]
        theirs = building.regions_of(near[near > cluster])[0]
        i, j = np.triu_indices(len(mine), 1)
        own += [np.repeat(mine, len(theirs)), mine[i]]
        other += [np.tile(theirs, len(mine)), mine[j]]
    a, b = np.concatenate(own).astype(np.int32), np.concatenate(other).astype(np.int32)
    room = building.regions.room[b]
    order = np.argsort(room, kind="stable")
    cuts = np.flatnonzero(np.diff(room[order])) + 1
    nearby = building.surroundings(group)
    return [(nearby, a[rows], b[rows]) for rows in np.split(order, cuts) if len(rows)]


def _hull(building: Building, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return building.regions.box_min[ends].min(0), building.regions.box_max[ends].max(0)


def _blocks_of(start: int, a: np.ndarray, b: np.ndarray) -> list[_Block]:
    return [_Block(start, a[k : k + BLOCK_PAIRS], b[k : k + BLOCK_PAIRS]) for k in range(0, len(a), BLOCK_PAIRS)]


def _children(forest: Forest, outcome: _Outcome) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of every child of the split side with the other side."""
    sides = []
    for (a, b), flip in ((outcome.split_a, False), (outcome.split_b, True)):
        parent, other = (b, a) if flip else (a, b)
        children = forest.children[parent]
        row, k = np.nonzero(children >= 0)
        child = children[row, k]
        sides.append((other[row], child) if flip else (child, other[row]))
    return tuple(np.concatenate(side) for side in zip(*sides, strict=True))


def _bodies(forest: Forest, elements: np.ndarray) -> tuple[Bodies, np.ndarray]:
    """The elements as bodies of a shaft, and their radii (n,)."""
    centre, radius = forest.spheres(elements)
    region, half = forest.region[elements], 0.5 * forest.cover[elements, 2:]
    r = forest.regions
    sides = (half[:, :1] * r.u[region], half[:, 1:] * r.v[region], r.normal[region])
    return Bodies(centre, *(x.astype(np.float32) for x in sides)), radius


def _treat(forest: Forest, blockers: Blockers, exitance: np.ndarray, tolerance: np.ndarray, min_size: float, block: _Block) -> _Outcome:
    elements, index = np.unique(np.concatenate([block.a, block.b]), return_inverse=True)
    ia, ib = index[: len(block.a)], index[len(block.a) :]
    bodies, radius = _bodies(forest, elements)
    facing = _face_each_other(bodies, ia, ib, blockers.clearance)
    ia, ib = ia[facing], ib[facing]
    form_a, form_b, distance = _form_factors(forest, elements, bodies, ia, ib)
    area = forest.area[elements]
    limit = tolerance[forest.region[elements]]
    # Errors below are in units of what is admissible, so that 1 is the threshold for both directions.
    gain_a = form_a * exitance[elements[ib]] * np.sqrt(area[ia]) / limit[ia]
    gain_b = form_b * exitance[elements[ia]] * np.sqrt(area[ib]) / limit[ib]
    worth = np.maximum(gain_a, gain_b) > NEGLIGIBLE
    dropped = float(np.sum((form_a * exitance[elements[ib]] * area[ia] + form_b * exitance[elements[ia]] * area[ib])[~worth]))
    ia, ib, distance, gain_a, gain_b = (x[worth] for x in (ia, ib, distance, gain_a, gain_b))
    xa, xb = radius[ia] / distance, radius[ib] / distance
    error = np.maximum(gain_a, gain_b) * LINEAR * (xa**2 + xb**2)
    splittable = forest.can_split(elements, min_size)
    refine = (error > 1) & (splittable[ia] | splittable[ib])
    # A single node stands for an element only from afar, however little light is at stake: its kernel has no bound near by.
    afar = ~refine & (distance > FAR * (radius[ia] + radius[ib]))
    one_a = afar & (np.maximum(gain_a * CONSTANT * xa, gain_b * ONE_SOURCE * xa**2) < 0.5)
    one_b = afar & (np.maximum(gain_b * CONSTANT * xb, gain_a * ONE_SOURCE * xb**2) < 0.5)
    keep = np.flatnonzero(~refine)
    shafts = Shafts(bodies, blockers)
    pair, blocker = shafts.candidates(ia[keep], ib[keep])
    doubtful = np.zeros(len(ia), bool)
    doubtful[keep[pair]] = True
    # One ray sees all or nothing: good enough only where even that does not matter.
    risky = doubtful & (np.maximum(gain_a, gain_b) * 0.5 > 0.5)
    one_a &= ~risky
    one_b &= ~risky
    first = np.searchsorted(pair, np.arange(len(keep) + 1))
    links, partial, tests = [], np.zeros(len(ia), bool), 0
    for side_a in (False, True):
        for side_b in (False, True):
            local = np.flatnonzero((one_a[keep] == side_a) & (one_b[keep] == side_b))
            if not len(local):
                continue
            rows = keep[local]
            nodes_a = _nodes(forest, elements[ia[rows]], side_a)
            nodes_b = _nodes(forest, elements[ib[rows]], side_b)
            cuts, count = _cuts(blockers, first, blocker, local, nodes_a, nodes_b)
            tests += count
            hidden = cuts.hidden
            seen = 1 - hidden.mean((1, 2), dtype=np.float32)
            spread = _spread(hidden, cuts.alone, doubtful[rows])
            bad = (np.maximum(gain_a[rows], gain_b[rows]) * PARTLY_SEEN * spread > 1) & (splittable[ia[rows]] | splittable[ib[rows]])
            partial[rows[bad]] = True
            good = np.flatnonzero(~bad & (seen > 0))
            rows = rows[good]
            links += _links(
                forest, elements, bodies, radius, ia[rows], ib[rows], distance[rows], nodes_a[good], nodes_b[good], ~hidden[good]
            )
    refine |= partial
    larger_a = np.where(splittable[ia] & splittable[ib], radius[ia] >= radius[ib], splittable[ia])
    at_a, at_b = np.flatnonzero(refine & larger_a), np.flatnonzero(refine & ~larger_a)
    return _Outcome(links, (elements[ia[at_a]], elements[ib[at_a]]), (elements[ia[at_b]], elements[ib[at_b]]), dropped, tests)


def _spread(hidden: np.ndarray, alone: np.ndarray, doubtful: np.ndarray) -> np.ndarray:
    """(n,) standard deviation of the visibility of a segment between two elements, of which samples (n, i, j) are known.

    Samples that agree prove nothing while a blocker may stand between them: half a sample is taken to disagree. A pair
    without candidates, and one that a single blocker hides, are certain.
    """
    count = hidden.shape[1] * hidden.shape[2]
    share = (hidden.sum((1, 2)) + 0.5) / (count + 1)
    return np.where(doubtful & ~alone, np.sqrt(share * (1 - share)), 0.0)


def _face_each_other(bodies: Bodies, ia: np.ndarray, ib: np.ndarray, clearance: float) -> np.ndarray:
    """(n,) bool: some part of each body lies in front of the other's plane."""
    offset = bodies.centre[ib] - bodies.centre[ia]
    front = np.ones(len(ia), bool)
    for sign, i, j in ((1, ia, ib), (-1, ib, ia)):
        normal = bodies.normal[i]
        dot = lambda x, n=normal: np.einsum("ij,ij->i", x, n)  # noqa: E731
        front &= sign * dot(offset) + np.abs(dot(bodies.half_u[j])) + np.abs(dot(bodies.half_v[j])) > 2 * clearance
    return front


def _form_factors(forest, elements, bodies, ia, ib):
    """Unoccluded estimates (n,): part of the light of b in the irradiance at a and the reverse, and the distance of the centres."""
    offset = (bodies.centre[ib] - bodies.centre[ia]).astype(np.float64)
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
    cosine = []
    for sign, i, j in ((1, ia, ib), (-1, ib, ia)):
        normal = bodies.normal[i]
        dot = lambda x, n=normal: np.einsum("ij,ij->i", x, n)  # noqa: E731
        top = sign * dot(offset) + np.abs(dot(bodies.half_u[j])) + np.abs(dot(bodies.half_v[j]))
        cosine.append(np.clip(top / distance, 0, 1))
    area = forest.area[elements]
    both = cosine[0] * cosine[1]
    sphere = np.pi * distance**2
    return both * area[ib] / (sphere + area[ib]), both * area[ia] / (sphere + area[ia]), distance


def _nodes(forest: Forest, elements: np.ndarray, one: bool) -> np.ndarray:
    """(n, 1 or q*q, 3) float32."""
    return forest.centroids(elements)[:, None] if one else forest.nodes[elements]


def _cuts(blockers, first, blocker, local, nodes_a, nodes_b) -> tuple[Cuts, int]:
    """Cuts of the segments between the nodes of the pairs ``local`` (indices into ``first``), and the tests that they took."""
    count = first[local + 1] - first[local]
    some = np.flatnonzero(count)
    cuts = Cuts(np.zeros((len(local), nodes_a.shape[1], nodes_b.shape[1]), bool), np.zeros(len(local), bool))
    if len(some):
        rows, owner = ragged(first[local[some]], count[some])
        found = cut_segments(blockers, owner, blocker[rows], nodes_a[some], nodes_b[some])
        cuts.hidden[some], cuts.alone[some] = found.hidden, found.alone
    return cuts, int(count.sum()) * nodes_a.shape[1] * nodes_b.shape[1]


def _links(forest, elements, bodies, radius, ia, ib, distance, nodes_a, nodes_b, seen) -> list[LinkSet]:
    """Links of pairs whose nodes and visibility (n, i, j) are known; near ones by the exact polygon formula, each way apart."""
    a, b = elements[ia].astype(np.int32), elements[ib].astype(np.int32)
    exchange = transport.kernel(nodes_a, bodies.normal[ia], nodes_b, bodies.normal[ib])
    near = distance < TOUCHING * (radius[ia] + radius[ib])
    if exchange.shape[1] == 1 or exchange.shape[2] == 1:
        near[:] = False
    far = ~near
    out = [LinkSet(a[far], b[far], (exchange * seen)[far], True)]
    here = np.flatnonzero(near)
    if len(here):
        for i, j, turn in ((a[here], b[here], False), (b[here], a[here], True)):
            k, v = (exchange[here].transpose(0, 2, 1), seen[here].transpose(0, 2, 1)) if turn else (exchange[here], seen[here])
            out.append(LinkSet(i, j, _fitted(forest, i, j, k) * v, False))
    return out


def _fitted(forest: Forest, receiver: np.ndarray, source: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Kernel (n, i, j) scaled so that a source of constant exitance gives every receiving node its exact irradiance."""
    row, outline = forest.outlines(source)
    nodes, normal = forest.nodes[receiver], forest.regions.normal[forest.region[receiver]]
    count = nodes.shape[1]
    exact = np.zeros((len(receiver), count))
    for k in range(count):
        factor = transport.lambert(nodes[row, k], normal[row], outline)
        exact[:, k] = np.bincount(row, factor, minlength=len(receiver))
    # A node on or behind the plane of the source gets none of its light, whatever the formula says of the polygon.
    facing = forest.regions.normal[forest.region[source]]
    height = np.einsum("nik,nk->ni", nodes - forest.nodes[source, :1], facing)
    exact = np.where(height > 0, exact, 0.0)
    weights = forest.node_weights[source]
    rule = np.einsum("nij,nj->ni", kernel, weights)
    # A node that sees a part of the source but none of its nodes takes the light evenly from all of it.
    scale = np.where(rule > 0, exact / np.maximum(rule, 1e-30), 0.0)
    even = np.where(rule > 0, 0.0, exact / weights.sum(1, keepdims=True))
    return (kernel * scale[..., None] + even[..., None]).astype(np.float32)
