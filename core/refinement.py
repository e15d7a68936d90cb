"""The oracle: which pairs of elements exchange light, how finely, and what is too small to matter.

Pairs of regions of two clusters that see each other start at their root elements. A pair is accepted when the light
that it carries is known well enough by its nodes, split on its larger side otherwise, one level of all pairs of the
building at a time (Hanrahan et al. 1991; Bekaert and Willems 1996). Errors are absolute irradiances at the receiver,
in the mean square over its area, so that work goes where the light is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from . import transport
from .building import Building
from .elements import Forest
from .exchanges import Ends, Estimate, Pairs, misfit, modes, weigh
from .glass import through_glass
from .links import LinkCollector, LinkSet
from .pair_visibility import View, look
from .parallel import Crew
from .sightlines import Tile, pairs_of, scopes, tiles

PARTLY_SEEN = 0.3
"""Error of an exchange by a sampled visibility: a part of the spread of that."""
TOUCHING = 1.0
"""Elements closer than this many sums of their radii take the exact polygon formula (design measure: Gauss is 1 % wrong there)."""
EVEN, ROUNDS = 1e-3, 4
"""Fits of touching elements: part of evenly spread light in what is scaled, and how often."""
BLOCK_PAIRS = 1 << 14
"""Pairs of elements that one worker treats at once."""
FEW_PAIRS = 1 << 9
"""Parcels with no more pairs that are split than this together become one: a block of few pairs costs more than its pairs."""


@dataclass(frozen=True)
class Linking:
    """All links of a building and what it took: ``dropped`` bounds the power (W) of the exchanges left out."""

    links: list[LinkSet]
    dropped: float
    segment_tests: int


@dataclass(frozen=True)
class _Block:
    """Pairs of elements, and the clusters ``nearby`` that hold all that can stand between them."""

    nearby: np.ndarray
    a: np.ndarray
    b: np.ndarray

    def parts(self) -> Iterator[_Block]:
        """Its pairs in turn, as many as are treated at once."""
        for low in range(0, len(self.a), BLOCK_PAIRS):
            yield _Block(self.nearby, self.a[low : low + BLOCK_PAIRS], self.b[low : low + BLOCK_PAIRS])


@dataclass
class _Outcome:
    """What became of pairs: their links, those of which one side (the one named first, or second) is split, and the account."""

    links: list[LinkSet]
    split_a: tuple[np.ndarray, np.ndarray]
    split_b: tuple[np.ndarray, np.ndarray]
    dropped: float
    segment_tests: int


def link(
    building: Building, forest: Forest, estimate: Estimate, min_size: float, crew: Crew, collector: LinkCollector | None = None
) -> Iterator[float | Linking]:
    """Make the links of a building; elements are split on the way. Yields the share of the work done, at last the links.

    min_size : metres, elements are not split below it;  collector : takes the links as they are made
    """
    collector = collector or LinkCollector()
    roots = scopes(building)
    parcels, whole, treat = (tiles(building, scope) for scope in roots), len(roots), _treat_roots
    dropped, tests, rounds = 0.0, 0, 0
    while whole:
        # Blocks are made when they are due: all pairs of a building at once would take more memory than anything else.
        outcomes, sources = [], []
        for outcome in crew.map(treat, (building, forest, estimate, min_size), _one_by_one(parcels, sources)):
            collector.add(outcome.links)
            outcome.links = []
            number = sources[len(outcomes)][0]
            outcomes.append(outcome)
            yield 1 - 0.5 ** (rounds + number / whole)
        rounds += 1
        dropped += sum(o.dropped for o in outcomes)
        tests += sum(o.segment_tests for o in outcomes)
        forest.split(np.concatenate([np.zeros(0, np.int32)] + [o.split_a[0] for o in outcomes] + [o.split_b[1] for o in outcomes]))
        estimate = _inherited(estimate, forest)
        below, whole = _next(forest, sources, outcomes)
        parcels, treat = (block.parts() for block in below), _treat
    yield Linking(collector.links(), dropped, tests)


def _one_by_one(parcels: Iterable[Iterable[Tile | _Block]], sources: list[tuple[int, np.ndarray]]) -> Iterator[Tile | _Block]:
    """The parts of parcels; of every part ``sources`` receives the number of its parcel, and what is near."""
    for number, parcel in enumerate(parcels):
        for part in parcel:
            sources.append((number, part.nearby))
            yield part


def _inherited(estimate: Estimate, forest: Forest) -> Estimate:
    """The estimate with younger elements: a child is as bright as its parent and half as steep until more is known."""
    known = len(estimate.exitance)
    parent = forest.parent[known:]
    exitance, slope = (np.concatenate([x, factor * x[parent]]) for x, factor in ((estimate.exitance, 1.0), (estimate.slope, 0.5)))
    return Estimate(exitance, slope, estimate.tolerance)


def _next(forest: Forest, sources: list[tuple[int, np.ndarray]], outcomes: list[_Outcome]) -> tuple[Iterator[_Block], int]:
    """The pairs that were split, those of one scope together, and of several if they are few; and how many such parcels there are."""
    groups: list[tuple[list[np.ndarray], list[_Outcome], int]] = []
    for _, same in groupby(zip(sources, outcomes, strict=True), lambda pair: pair[0][0]):
        group = list(same)
        split = [outcome for _, outcome in group if len(outcome.split_a[0]) + len(outcome.split_b[0])]
        if not split:
            continue
        size = sum(len(outcome.split_a[0]) + len(outcome.split_b[0]) for outcome in split)
        if groups and groups[-1][2] + size <= FEW_PAIRS:
            nearby, before, number = groups.pop()
            groups.append(([*nearby, group[0][0][1]], before + split, number + size))
        else:
            groups.append(([group[0][0][1]], split, size))

    def parcel(nearby: list[np.ndarray], split: list[_Outcome], _: int) -> _Block:
        sides = [_children(forest, outcome) for outcome in split]
        return _Block(np.unique(np.concatenate(nearby)), *(np.concatenate(side) for side in zip(*sides, strict=True)))

    return (parcel(*group) for group in groups), len(groups)


def _children(forest: Forest, outcome: _Outcome) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of every child of the split side with the other side."""
    sides = []
    for (a, b), flip in ((outcome.split_a, False), (outcome.split_b, True)):
        parent, other = (b, a) if flip else (a, b)
        children = forest.children_of(parent)
        row, k = np.nonzero(children >= 0)
        child = children[row, k]
        sides.append((other[row], child) if flip else (child, other[row]))
    return tuple(np.concatenate(side) for side in zip(*sides, strict=True))


def _treat_roots(building: Building, forest: Forest, estimate: Estimate, min_size: float, tile: Tile) -> _Outcome:
    """The pairs of root elements of a tile. In rooms of many surfaces few of them matter: those are sought first, and treated together."""
    none = np.zeros(0, np.int32)
    kept, dropped = [(none, none)], 0.0
    for a, b in pairs_of(building, tile):
        for part in _Block(tile.nearby, a, b).parts():
            ends, worth, out = weigh(building, forest, estimate, part.a, part.b)
            kept.append((ends.elements[worth.ia], ends.elements[worth.ib]))
            dropped += out
    block = _Block(tile.nearby, *(np.concatenate(side) for side in zip(*kept, strict=True)))
    done = [_Outcome([], (none, none), (none, none), dropped, 0)]
    done += [_treat(building, forest, estimate, min_size, part) for part in block.parts()]
    links = [links for outcome in done for links in outcome.links]
    splits = ([np.concatenate(side) for side in zip(*of, strict=True)] for of in zip(*((o.split_a, o.split_b) for o in done), strict=True))
    return _Outcome(links, *map(tuple, splits), sum(o.dropped for o in done), sum(o.segment_tests for o in done))


def _treat(building: Building, forest: Forest, estimate: Estimate, min_size: float, block: _Block) -> _Outcome:
    ends, pairs, dropped = weigh(building, forest, estimate, block.a, block.b)
    ia, ib, elements = pairs.ia, pairs.ib, ends.elements
    splittable = forest.can_split(elements, min_size)
    can_split = splittable[ia] | splittable[ib]
    refine = can_split & (misfit(pairs, forest.order) > 1)
    views = [View(forest, ends, pairs, mode) for mode in modes(pairs, np.flatnonzero(~refine))]
    limit = np.where(can_split, 1 / (PARTLY_SEEN * np.maximum(pairs.gain, 1e-300)), np.inf)
    left = np.unique(np.concatenate([ia, ib]))
    blockers = building.blockers_between(block.nearby, *ends.bodies.take(left).box()) if len(left) else building.blockers.take(left)
    links, tests = [], look(forest, ends, pairs, views, blockers, limit)
    for view in views:
        bad = view.spread() > limit[view.rows]
        refine[view.rows[bad]] = True
        good = np.flatnonzero(~bad & ~view.hidden.all((1, 2)))
        nodes = [x.take(good, 0) for x in view.nodes]
        here = pairs.take(view.rows[good])
        seen = ~view.hidden.take(good, 0) * through_glass(building, forest.region[elements], here.ia, here.ib, *nodes)
        links += _links(forest, ends, here, *nodes, seen)
    larger_a = np.where(splittable[ia] & splittable[ib], ends.radius[ia] >= ends.radius[ib], splittable[ia])
    at_a, at_b = np.flatnonzero(refine & larger_a), np.flatnonzero(refine & ~larger_a)
    return _Outcome(links, (elements[ia[at_a]], elements[ib[at_a]]), (elements[ia[at_b]], elements[ib[at_b]]), dropped, tests)


def _links(forest: Forest, ends: Ends, pairs: Pairs, nodes_a, nodes_b, seen) -> list[LinkSet]:
    """Links of pairs whose nodes and visibility (n, i, j) are known; near ones by the exact polygon formula."""
    ia, ib, normal = pairs.ia, pairs.ib, ends.bodies.normal
    a, b = ends.elements[ia].astype(np.int32), ends.elements[ib].astype(np.int32)
    exchange = transport.kernel(nodes_a, normal.take(ia, 0), nodes_b, normal.take(ib, 0))
    near = TOUCHING * (pairs.xa + pairs.xb) > 1
    out = []
    for rows in (np.flatnonzero(~near), np.flatnonzero(near)):
        found = exchange[rows]
        if near[rows].any():
            found = _fitted(forest, a[rows], b[rows], found, (pairs.xb[rows] / pairs.xa[rows]) ** 2)
        out.append(LinkSet.of(a[rows], b[rows], found * seen[rows]))
    return out


def _fitted(forest: Forest, a: np.ndarray, b: np.ndarray, kernel: np.ndarray, trust: np.ndarray) -> np.ndarray:
    """Kernel (n, i, j) scaled so that every node receives from the other element, if that is of constant exitance, what is exact.

    trust : (n,) of the power that a receives from b over that of the reverse. Both are one number, but here sums over nodes,
    of which those of the smaller element are the better ones; what the nodes receive is scaled to it, so that the exchange stays
    symmetric. Scaling rows and columns in turn changes the kernel least (Sinkhorn and Knopp 1967).
    """
    weights = [forest.node_weights_of(x).astype(np.float64) for x in (a, b)]
    light = [_exact(forest, a, b), _exact(forest, b, a)]
    powers = [(e * w).sum(1) for e, w in zip(light, weights, strict=True)]
    # All nodes of an element may lie behind the other, though parts of it do not: then the others tell, and it takes the light evenly.
    logs = [np.log(np.maximum(np.where(mine > 0, mine, other), 1e-300)) for mine, other in (powers, powers[::-1])]
    power = np.exp((trust * logs[0] + logs[1]) / (trust + 1))[:, None]
    light = [np.where(p[:, None] > 0, e, 1) for e, p in zip(light, powers, strict=True)]
    light_a, light_b = (e * power / (e * w).sum(1, keepdims=True) for e, w in zip(light, weights, strict=True))
    # A node that sees a part of the other element but none of its nodes needs something to scale.
    out = kernel + EVEN * light_a[:, :, None] * light_b[:, None] / np.maximum(power, 1e-300)[:, :, None]
    for _ in range(ROUNDS):
        out *= (light_a / np.maximum(np.einsum("nij,nj->ni", out, weights[1]), 1e-300))[:, :, None]
        out *= (light_b / np.maximum(np.einsum("nij,ni->nj", out, weights[0]), 1e-300))[:, None]
    return out.astype(np.float32)


def _exact(forest: Forest, receiver: np.ndarray, source: np.ndarray) -> np.ndarray:
    """(n, i) float64 irradiance at the nodes of receivers by sources of exitance 1, as if nothing stood between."""
    row, start, end = forest.contours(source)
    regions = forest.regions
    nodes, normal, facing = forest.nodes_of(receiver), *(regions.normal.take(forest.region[x], 0) for x in (receiver, source))
    exact = np.stack([transport.contour_form_factors(nodes[:, k], normal, facing, row, start, end) for k in range(nodes.shape[1])], axis=1)
    # A node on or behind the plane of the source gets none of its light, whatever the formula says of the shape.
    return np.where(np.einsum("nik,nk->ni", nodes - forest.nodes_of(source)[:, :1], facing) > 0, exact, 0.0)
