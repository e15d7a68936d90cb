"""The oracle: which pairs of elements exchange light, how finely, and what is too small to matter.

Pairs of regions of two clusters that see each other start at their root elements. A pair is accepted when the light
that it carries is known well enough by its nodes, split on its larger side otherwise, one level of all pairs of the
building at a time (Hanrahan et al. 1991; Bekaert and Willems 1996). Errors are absolute irradiances at the receiver,
in the mean square over its area, so that work goes where the light is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import groupby

import numpy as np

from . import transport
from .building import Building
from .elements import Forest
from .glass import through_glass
from .links import LinkCollector, LinkSet
from .occlusion import Bodies, Cuts, ShaftIndex, Shafts, cut_segments
from .parallel import Crew
from .passages import Passages
from .sightlines import scope_groups, scope_of

# Relative errors of one exchange, in the mean square over the receiver, for elements of radius r at distance d: the second
# derivative of the kernel leaves 0.3 (r/d)**2 of a linear function, the first 0.8 r/d of a constant; a node in place of a
# rule misses 0.6 (r/d)**2 of the source, and r/d of its slope; a sampled visibility misses a part of its own spread.
LINEAR, CONSTANT, ONE_SOURCE, SLOPE, PARTLY_SEEN = 0.3, 0.8, 0.6, 1.0, 0.3
FAR = 1.5
"""Elements this many sums of their radii apart may be one node each."""
TOUCHING = 1.0
"""Elements closer than this many sums of their radii take the exact polygon formula (design measure: Gauss is 1 % wrong there)."""
EVEN, ROUNDS = 1e-3, 4
"""Fits of touching elements: part of evenly spread light in what is scaled, and how often."""
NEGLIGIBLE = 1e-3
"""An exchange below this part of what is admissible as an error is left out and its bound added to the total."""
BLOCK_PAIRS = 1 << 14
"""Pairs of elements that one worker treats at once."""
FEW_PAIRS = 1 << 9
"""Parcels with no more pairs that are split than this together become one: a block of few pairs costs more than its pairs."""


@dataclass(frozen=True)
class Estimate:
    """What is known of the light before the links are made, for the oracle alone.

    exitance : (E,) float64, largest channel of the mean reflected exitance of every element, W/m2
    slope : (E,) float64, root mean square of the part of it that is not constant, W/m2
    tolerance : (G,) float64, per region, admissible error times the root of the receiver's area, W/m
    """

    exitance: np.ndarray
    slope: np.ndarray
    tolerance: np.ndarray


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


@dataclass
class _Outcome:
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
    groups = scope_groups(building)
    parcels, whole = (_first(building, *group) for group in groups), len(groups)
    dropped, tests, rounds = 0.0, 0, 0
    while whole:
        # Blocks are made when they are due: all pairs of a building at once would take more memory than anything else.
        outcomes, sources = [], []
        for outcome in crew.map(_treat, (building, forest, estimate, min_size), _blocks(parcels, sources)):
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
        parcels, whole = _next(forest, sources, outcomes)
    yield Linking(collector.links(), dropped, tests)


def _first(building: Building, group: np.ndarray, within: bool) -> _Block:
    """All pairs of root elements of one scope."""
    scope = scope_of(building, group, within)
    return _Block(scope.nearby, scope.a, scope.b)


def _blocks(parcels: Iterable[_Block], sources: list[tuple[int, np.ndarray]]) -> Iterator[_Block]:
    """Parcels cut into blocks; of every block ``sources`` receives the number of its parcel, and what is near."""
    for number, parcel in enumerate(parcels):
        for k in range(0, len(parcel.a), BLOCK_PAIRS):
            sources.append((number, parcel.nearby))
            yield _Block(parcel.nearby, parcel.a[k : k + BLOCK_PAIRS], parcel.b[k : k + BLOCK_PAIRS])


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


def _bodies(forest: Forest, elements: np.ndarray) -> tuple[Bodies, np.ndarray]:
    """The elements as bodies of a shaft, and their radii (n,)."""
    centre, radius = forest.spheres(elements)
    region, half = forest.region[elements], 0.5 * forest.cover_of(elements)[:, 2:]
    r = forest.regions
    sides = (half[:, :1] * r.u[region], half[:, 1:] * r.v[region], r.normal[region])
    return Bodies(centre, *(x.astype(np.float32) for x in sides)), radius


@dataclass(frozen=True)
class _Pairs:
    """n pairs of bodies ia, ib (indices into the elements of a block).

    distance : of their centres, m;  xa, xb : radius over distance
    gain_a, gain_b : light that each would receive unoccluded, in units of the error that is admissible there
    slope_a, slope_b : the same for the part of the exitance of a (of b) that is not constant, at the other side
    """

    ia: np.ndarray
    ib: np.ndarray
    distance: np.ndarray
    xa: np.ndarray
    xb: np.ndarray
    gain_a: np.ndarray
    gain_b: np.ndarray
    slope_a: np.ndarray
    slope_b: np.ndarray

    def __len__(self) -> int:
        return len(self.ia)

    @property
    def gain(self) -> np.ndarray:
        return np.maximum(self.gain_a, self.gain_b)

    def take(self, rows: np.ndarray) -> _Pairs:
        return _Pairs(*(getattr(self, f.name).take(rows) for f in fields(self)))


def _treat(building: Building, forest: Forest, estimate: Estimate, min_size: float, block: _Block) -> _Outcome:
    elements, index = np.unique(np.concatenate([block.a, block.b]), return_inverse=True)
    bodies, radius = _bodies(forest, elements)
    ia, ib = _open_pairs(building, forest.region[elements], bodies, index[: len(block.a)], index[len(block.a) :])
    pairs, dropped = _worthwhile(
        _assess(forest, estimate, elements, bodies, radius, ia, ib), forest.area_of(elements), estimate, elements, forest
    )
    splittable = forest.can_split(elements, min_size)
    can_split = splittable[pairs.ia] | splittable[pairs.ib]
    refine = can_split & (_misfit(pairs, forest.order) > 1)
    links, tests = [], 0
    points = _points(forest, elements, bodies)
    left = np.unique(np.concatenate([pairs.ia, pairs.ib]))
    shafts = ShaftIndex(building.blockers_between(block.nearby, *bodies.take(left).box()) if len(left) else building.blockers.take(left))
    modes = list(_modes(pairs, np.flatnonzero(~refine)))
    wide = _Sought(shafts, bodies, pairs, [rows for one_a, one_b, rows in modes if not (one_a and one_b)])
    for one_a, one_b, rows in modes:
        here = pairs.take(rows)
        nodes = _nodes(forest, elements[here.ia], one_a), _nodes(forest, elements[here.ib], one_b)
        # The shaft of a single ray is the ray: nothing else is asked, and next to nothing stands in it.
        ray = one_a and one_b
        pair, blocker = (_Sought(shafts, points, pairs, [rows]) if ray else wide).candidates(here)
        cuts = cut_segments(shafts.blockers, pair, blocker, *nodes)
        tests += len(pair) * nodes[0].shape[1] * nodes[1].shape[1]
        bad = np.zeros(len(here), bool)
        if not ray:
            bad = can_split[rows] & (here.gain * PARTLY_SEEN * _spread(cuts, pair) > 1)
            alone = np.flatnonzero(bad & (cuts.alone >= 0))
            bad[alone] = ~_surely_hidden(forest, shafts.blockers, elements[here.ia[alone]], elements[here.ib[alone]], alone, pair, blocker)
        refine[rows[bad]] = True
        good = np.flatnonzero(~bad & ~cuts.hidden.all((1, 2)))
        nodes = nodes[0].take(good, 0), nodes[1].take(good, 0)
        seen = ~cuts.hidden.take(good, 0) * through_glass(building, forest.region[elements], here.ia[good], here.ib[good], *nodes)
        links += _links(forest, elements, bodies, radius, here.take(good), *nodes, seen)
    ia, ib = pairs.ia, pairs.ib
    larger_a = np.where(splittable[ia] & splittable[ib], radius[ia] >= radius[ib], splittable[ia])
    at_a, at_b = np.flatnonzero(refine & larger_a), np.flatnonzero(refine & ~larger_a)
    return _Outcome(links, (elements[ia[at_a]], elements[ib[at_a]]), (elements[ia[at_b]], elements[ib[at_b]]), dropped, tests)


def _open_pairs(building: Building, region: np.ndarray, bodies: Bodies, ia: np.ndarray, ib: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pairs that face each other and, in different rooms, meet a portal of either room."""
    facing = _face_each_other(bodies, ia, ib, building.blockers.clearance)
    ia, ib = ia[facing], ib[facing]
    room = building.regions.room[region]
    passes = Passages(building.doors, room).open(bodies, room, ia, ib)
    return ia[passes], ib[passes]


def _assess(forest: Forest, estimate: Estimate, elements, bodies: Bodies, radius: np.ndarray, ia: np.ndarray, ib: np.ndarray) -> _Pairs:
    form_a, form_b, distance = _form_factors(forest, elements, bodies, radius, ia, ib)
    root = np.sqrt(forest.area_of(elements)) / estimate.tolerance[forest.region[elements]]
    exitance, slope = estimate.exitance[elements], estimate.slope[elements]
    to_a, to_b = form_a * root[ia], form_b * root[ib]
    return _Pairs(
        ia, ib, distance, radius[ia] / distance, radius[ib] / distance,
        to_a * exitance[ib], to_b * exitance[ia], to_b * slope[ia], to_a * slope[ib],
    )  # fmt: skip


def _worthwhile(pairs: _Pairs, area: np.ndarray, estimate: Estimate, elements: np.ndarray, forest: Forest) -> tuple[_Pairs, float]:
    """The pairs that matter, and a bound (W) on the light of those that do not."""
    worth = pairs.gain > NEGLIGIBLE
    rest = pairs.take(np.flatnonzero(~worth))
    scale = estimate.tolerance[forest.region[elements]] * np.sqrt(area)  # back from admissible errors to watts
    return pairs.take(np.flatnonzero(worth)), float(np.sum(rest.gain_a * scale[rest.ia]) + np.sum(rest.gain_b * scale[rest.ib]))


def _misfit(pairs: _Pairs, order: int) -> np.ndarray:
    """(n,) error of an exchange between all nodes of both elements, in units of what is admissible."""
    if order > 1:
        return pairs.gain * LINEAR * (pairs.xa**2 + pairs.xb**2)
    at_a = pairs.gain_a * (CONSTANT * pairs.xa + LINEAR * pairs.xb**2) + SLOPE * pairs.slope_b * pairs.xb
    at_b = pairs.gain_b * (CONSTANT * pairs.xb + LINEAR * pairs.xa**2) + SLOPE * pairs.slope_a * pairs.xa
    return np.maximum(at_a, at_b)


def _modes(pairs: _Pairs, rows: np.ndarray) -> Iterator[tuple[bool, bool, np.ndarray]]:
    """Splits ``rows`` by which side may be a single node: (a is single, b is single, rows)."""
    p = pairs.take(rows)
    # A single node stands for an element only from afar, however little light is at stake: its kernel has no bound near by.
    afar = FAR * (p.xa + p.xb) < 1
    single = []
    for x, received, sent, slope in ((p.xa, p.gain_a, p.gain_b, p.slope_a), (p.xb, p.gain_b, p.gain_a, p.slope_b)):
        error = np.maximum(received * CONSTANT * x, sent * ONE_SOURCE * x**2 + slope * SLOPE * x)
        single.append(afar & (error < 0.5))
    # One ray sees all or nothing: good enough only where even that does not matter.
    full = single[0] & single[1] & (p.gain >= 1)
    for one_a in (False, True):
        for one_b in (False, True):
            chosen = np.flatnonzero(((single[0] & ~full) == one_a) & ((single[1] & ~full) == one_b))
            if len(chosen):
                yield one_a, one_b, rows[chosen]


class _Sought:
    """The shafts of the bodies of some rows of pairs, for the blockers that may stand between them."""

    def __init__(self, blockers: ShaftIndex, bodies: Bodies, pairs: _Pairs, rows: list[np.ndarray]):
        used = np.zeros(len(bodies), bool)
        for some in rows:
            used[pairs.ia[some]] = used[pairs.ib[some]] = True
        self._place = np.cumsum(used) - 1
        self._shafts = Shafts(bodies.take(np.flatnonzero(used)), blockers)

    def candidates(self, pairs: _Pairs) -> tuple[np.ndarray, np.ndarray]:
        """Rows (pair, blocker) of the blockers that may stand between the bodies of ``pairs``."""
        return self._shafts.candidates(self._place[pairs.ia], self._place[pairs.ib])


def _points(forest: Forest, elements: np.ndarray, bodies: Bodies) -> Bodies:
    """The elements shrunk to their centres of gravity."""
    zero = np.zeros_like(bodies.half_u)
    return Bodies(forest.centroids(elements), zero, zero, bodies.normal)


def _spread(cuts: Cuts, pair: np.ndarray) -> np.ndarray:
    """(n,) standard deviation of the visibility of a segment between two elements, of which some are known.

    Samples that agree prove nothing while a blocker may stand between them: half a sample is taken to disagree. Only a
    pair without candidates is certain.
    """
    count = cuts.hidden.shape[1] * cuts.hidden.shape[2]
    share = (cuts.hidden.sum((1, 2)) + 0.5) / (count + 1)
    doubtful = np.zeros(len(cuts.alone), bool)
    doubtful[pair] = True
    return np.where(doubtful, np.sqrt(share * (1 - share)), 0.0)


def _surely_hidden(forest, blockers, a, b, chosen, pair, blocker) -> np.ndarray:
    """(n,) bool: one blocker cuts all segments between the corners of elements a and b, and so all between the elements.

    chosen : (n,) numbers of these pairs in the rows (pair, blocker).
    """
    place = np.full(int(pair.max(initial=-1)) + 1, -1)
    place[chosen] = np.arange(len(chosen))
    mine = place[pair] >= 0
    return cut_segments(blockers, place[pair[mine]], blocker[mine], forest.corners(a), forest.corners(b)).alone >= 0


def _face_each_other(bodies: Bodies, ia: np.ndarray, ib: np.ndarray, clearance: float) -> np.ndarray:
    """(n,) bool: some part of each body lies in front of the other's plane."""
    offset = bodies.centre.take(ib, 0) - bodies.centre.take(ia, 0)
    front = np.ones(len(ia), bool)
    for sign, i, j in ((1, ia, ib), (-1, ib, ia)):
        normal = bodies.normal.take(i, 0)
        dot = lambda x, n=normal: np.einsum("ij,ij->i", x, n)  # noqa: E731
        front &= sign * dot(offset) + np.abs(dot(bodies.half_u.take(j, 0))) + np.abs(dot(bodies.half_v.take(j, 0))) > 2 * clearance
    return front


def _form_factors(forest, elements, bodies, radius, ia, ib):
    """Unoccluded estimates (n,): part of the light of b in the irradiance at a and the reverse, and the distance of the centres.

    The cosines are those of the nearest points of the balls around both: the centres of two wide parallel plates a hand apart
    may lie far off to the side of each other.
    """
    offset = (bodies.centre.take(ib, 0) - bodies.centre.take(ia, 0)).astype(np.float64)
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
    gap = np.maximum(distance - radius[ia] - radius[ib], 1e-9)
    cosine = []
    for sign, i, j in ((1, ia, ib), (-1, ib, ia)):
        normal = bodies.normal.take(i, 0)
        dot = lambda x, n=normal: np.einsum("ij,ij->i", x, n)  # noqa: E731
        top = sign * dot(offset) + np.abs(dot(bodies.half_u.take(j, 0))) + np.abs(dot(bodies.half_v.take(j, 0)))
        cosine.append(np.clip(top / gap, 0, 1))
    area = forest.area_of(elements)
    both = cosine[0] * cosine[1]
    sphere = np.pi * distance**2
    return both * area[ib] / (sphere + area[ib]), both * area[ia] / (sphere + area[ia]), distance


def _nodes(forest: Forest, elements: np.ndarray, one: bool) -> np.ndarray:
    """(n, 1 or q*q, 3) float32."""
    return forest.centroids(elements)[:, None] if one else forest.nodes_of(elements)


def _links(forest, elements, bodies, radius, pairs: _Pairs, nodes_a, nodes_b, seen) -> list[LinkSet]:
    """Links of pairs whose nodes and visibility (n, i, j) are known; near ones by the exact polygon formula."""
    ia, ib = pairs.ia, pairs.ib
    a, b = elements[ia].astype(np.int32), elements[ib].astype(np.int32)
    exchange = transport.kernel(nodes_a, bodies.normal.take(ia, 0), nodes_b, bodies.normal.take(ib, 0))
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
