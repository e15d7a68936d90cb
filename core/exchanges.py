"""Pairs of elements that may exchange light: how much at most, and how well their nodes would know it.

All that is said here of a pair is said as if nothing stood between its elements. Errors are absolute irradiances at the
receiver, in the mean square over its area, in units of what is admissible there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from .building import Building
from .elements import Forest
from .occlusion import Bodies
from .passages import Passages

# Relative errors of one exchange, in the mean square over the receiver, for elements of radius r at distance d: the second
# derivative of the kernel leaves 0.3 (r/d)**2 of a linear function, the first 0.8 r/d of a constant; a node in place of a
# rule misses 0.6 (r/d)**2 of the source, and r/d of its slope.
LINEAR, CONSTANT, ONE_SOURCE, SLOPE = 0.3, 0.8, 0.6, 1.0
FAR = 1.5
"""Elements this many sums of their radii apart may be one node each."""
NEGLIGIBLE = 1e-3
"""An exchange below this part of what is admissible as an error is left out and its bound added to the total."""


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
class Ends:
    """The elements (m,) that some pairs are of, the same as ``bodies`` of a shaft, and their radii (m,), m."""

    elements: np.ndarray
    bodies: Bodies
    radius: np.ndarray


@dataclass(frozen=True)
class Pairs:
    """n pairs of ends.

    ia, ib : (n,) indices of the :class:`Ends`
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
        """(n,) the larger of both gains."""
        return np.maximum(self.gain_a, self.gain_b)

    def take(self, rows: np.ndarray) -> Pairs:
        """The pairs with the given indices."""
        return Pairs(*(getattr(self, f.name).take(rows) for f in fields(self)))


def weigh(building: Building, forest: Forest, estimate: Estimate, a: np.ndarray, b: np.ndarray) -> tuple[Ends, Pairs, float]:
    """Of pairs of elements a, b (n,) those that matter, and a bound (W) on the light of the others."""
    elements, index = np.unique(np.concatenate([a, b]), return_inverse=True)
    ends = Ends(elements, *_bodies(forest, elements))
    ia, ib = _open_pairs(building, forest.region[elements], ends.bodies, index[: len(a)], index[len(a) :])
    return ends, *_worthwhile(_assess(forest, estimate, ends, ia, ib), estimate, ends, forest)


def misfit(pairs: Pairs, order: int) -> np.ndarray:
    """(n,) error of an exchange between all nodes of both elements, in units of what is admissible."""
    if order > 1:
        return pairs.gain * LINEAR * (pairs.xa**2 + pairs.xb**2)
    at_a = pairs.gain_a * (CONSTANT * pairs.xa + LINEAR * pairs.xb**2) + SLOPE * pairs.slope_b * pairs.xb
    at_b = pairs.gain_b * (CONSTANT * pairs.xb + LINEAR * pairs.xa**2) + SLOPE * pairs.slope_a * pairs.xa
    return np.maximum(at_a, at_b)


def modes(pairs: Pairs, rows: np.ndarray) -> Iterator[tuple[bool, bool, np.ndarray]]:
    """``rows`` of pairs by which side may be a single node: (a is single, b is single, rows)."""
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


def _bodies(forest: Forest, elements: np.ndarray) -> tuple[Bodies, np.ndarray]:
    """The elements as bodies of a shaft, and their radii (n,)."""
    centre, radius = forest.spheres(elements)
    region, half = forest.region[elements], 0.5 * forest.cover_of(elements)[:, 2:]
    r = forest.regions
    sides = (half[:, :1] * r.u[region], half[:, 1:] * r.v[region], r.normal[region])
    return Bodies(centre, *(x.astype(np.float32) for x in sides)), radius


def _open_pairs(building: Building, region: np.ndarray, bodies: Bodies, ia: np.ndarray, ib: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pairs that face each other and, in different rooms, meet a portal of either room."""
    facing = _face_each_other(bodies, ia, ib, building.blockers.clearance)
    ia, ib = ia[facing], ib[facing]
    room = building.regions.room[region]
    passes = Passages(building.doors, room).open(bodies, room, ia, ib)
    return ia[passes], ib[passes]


def _assess(forest: Forest, estimate: Estimate, ends: Ends, ia: np.ndarray, ib: np.ndarray) -> Pairs:
    elements, radius = ends.elements, ends.radius
    form_a, form_b, distance = _form_factors(forest, ends, ia, ib)
    root = np.sqrt(forest.area_of(elements)) / estimate.tolerance[forest.region[elements]]
    exitance, slope = estimate.exitance[elements], estimate.slope[elements]
    to_a, to_b = form_a * root[ia], form_b * root[ib]
    return Pairs(
        ia, ib, distance, radius[ia] / distance, radius[ib] / distance,
        to_a * exitance[ib], to_b * exitance[ia], to_b * slope[ia], to_a * slope[ib],
    )  # fmt: skip


def _worthwhile(pairs: Pairs, estimate: Estimate, ends: Ends, forest: Forest) -> tuple[Pairs, float]:
    """The pairs that matter, and a bound (W) on the light of those that do not."""
    worth = pairs.gain > NEGLIGIBLE
    rest = pairs.take(np.flatnonzero(~worth))
    scale = estimate.tolerance[forest.region[ends.elements]] * np.sqrt(
        forest.area_of(ends.elements)
    )  # back from admissible errors to watts
    return pairs.take(np.flatnonzero(worth)), float(np.sum(rest.gain_a * scale[rest.ia]) + np.sum(rest.gain_b * scale[rest.ib]))


def _face_each_other(bodies: Bodies, ia: np.ndarray, ib: np.ndarray, clearance: float) -> np.ndarray:
    """(n,) bool: some part of each body lies in front of the other's plane."""
    offset = bodies.centre.take(ib, 0) - bodies.centre.take(ia, 0)
    front = np.ones(len(ia), bool)
    for sign, i, j in ((1, ia, ib), (-1, ib, ia)):
        normal = bodies.normal.take(i, 0)
        dot = lambda x, n=normal: np.einsum("ij,ij->i", x, n)  # noqa: E731
        front &= sign * dot(offset) + np.abs(dot(bodies.half_u.take(j, 0))) + np.abs(dot(bodies.half_v.take(j, 0))) > 2 * clearance
    return front


def _form_factors(forest: Forest, ends: Ends, ia: np.ndarray, ib: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unoccluded estimates (n,): part of the light of b in the irradiance at a and the reverse, and the distance of the centres.

    The cosines are those of the nearest points of the balls around both: the centres of two wide parallel plates a hand apart
    may lie far off to the side of each other.
    """
    bodies, radius = ends.bodies, ends.radius
    offset = (bodies.centre.take(ib, 0) - bodies.centre.take(ia, 0)).astype(np.float64)
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
    gap = np.maximum(distance - radius[ia] - radius[ib], 1e-9)
    cosine = []
    for sign, i, j in ((1, ia, ib), (-1, ib, ia)):
        normal = bodies.normal.take(i, 0)
        dot = lambda x, n=normal: np.einsum("ij,ij->i", x, n)  # noqa: E731
        top = sign * dot(offset) + np.abs(dot(bodies.half_u.take(j, 0))) + np.abs(dot(bodies.half_v.take(j, 0)))
        cosine.append(np.clip(top / gap, 0, 1))
    area = forest.area_of(ends.elements)
    both = cosine[0] * cosine[1]
    sphere = np.pi * distance**2
    return both * area[ib] / (sphere + area[ib]), both * area[ia] / (sphere + area[ia]), distance
