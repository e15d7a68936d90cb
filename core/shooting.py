"""Figure 7 of the paper: choose an emitter, let it shoot to its PVS, mark it, until little light is unshot.

Light is kept at the nodes of elements while it travels: what an element receives is gathered per node, and turned into
coefficients, pushed to the leaves, reflected and pulled back up when the element's emitter is next to shoot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .elements import Forest, Subtrees
from .links import LinkSet
from .ordering import Candidates, Strategy


@dataclass(frozen=True)
class Shot:
    """How far the solution is: iteration, the emitter that shot, and unshot over emitted power."""

    iteration: int
    emitter: int
    unshot_fraction: float


@dataclass(frozen=True)
class Radiosity:
    """The converged light.

    irradiance : (E, m, 3) float32 coefficients of the irradiance received by reflection at every element, ancestors included, W/m2
    iterations : int;  unshot : (3,) W left;  unshot_exitance : largest unshot mean exitance of an element, W/m2
    received, shot : (units, 3) float64 W, per emitter, of this reflected light
    """

    irradiance: np.ndarray
    iterations: int
    unshot: np.ndarray
    unshot_exitance: float
    received: np.ndarray
    shot: np.ndarray


@dataclass(frozen=True)
class _Route:
    """The links of one shape over which one emitter shoots: rows of the set sorted by receiver, and the receivers."""

    links: LinkSet
    rows: np.ndarray
    reverse: bool
    first: np.ndarray
    receivers: np.ndarray


class Shooter:
    """State of the shooting of reflected light between emitters (clusters or cells).

    unit : (E,) int emitter of every element, 0..units-1;  direct : (E, m, 3) irradiance from luminaires at every element,
    ancestors included;  gain : (E, q*q) factor for what each node of a leaf receives over its links;
    emitted : W, for the convergence test
    """

    def __init__(
        self, forest: Forest, links: list[LinkSet], unit: np.ndarray, units: int, direct: np.ndarray, gain: np.ndarray, emitted: float
    ):
        self._forest, self._units, self._emitted = forest, units, emitted
        self._unit, self._gain = unit, gain
        order = np.lexsort((forest.level, unit))
        self._elements = np.split(order, np.searchsorted(unit[order], np.arange(1, units)))
        self._place = np.zeros(len(forest), np.int32)
        for own in self._elements:
            self._place[own] = np.arange(len(own))
        self._trees = [Subtrees(forest, own, self._place) for own in self._elements]
        self._gained = forest.leaf & (gain != 1).any(1)
        self._reflectance = forest.regions.reflectance[forest.region].astype(np.float32)
        self._routes = _routes(links, unit, units)
        count = len(forest)
        self._gathered = np.zeros((count, forest.node_count, 3), np.float32)
        self._constant = np.zeros((count, 3), np.float32)
        self._total = np.zeros((count, forest.functions, 3), np.float32)
        self._first = direct
        self._fresh = np.ones(units, bool)
        leaf = np.flatnonzero(forest.leaf)
        power = forest.mean(leaf, direct[leaf]) * self._reflectance[leaf] * forest.area[leaf, None]
        self.unshot = np.zeros((units, 3))
        np.add.at(self.unshot, unit[leaf], power)
        self.received, self.shot = np.zeros((units, 3)), np.zeros((units, 3))

    def run(self, strategy: Strategy, rng: np.random.Generator, tolerance: float, max_iterations: int) -> Iterator[Shot | Radiosity]:
        """Shoot until the unshot part of the emitted power is at most ``tolerance``; yields every shot, at last the light.

        In every iteration each emitter shoots once, in the order of ``strategy`` (paper, figure 7). One with next to nothing to
        shoot is passed over, and nothing is read for it, until it has received more.
        """
        iteration, last = 0, -1
        limit = tolerance * max(self._emitted, 1e-300)
        # What is far below its share of the tolerance waits for more: a shot of next to nothing costs as much as any.
        least = 0.1 * limit / self._units
        while self.unshot.sum() > limit and iteration < max_iterations:
            marked = np.zeros(self._units, bool)
            while (waiting := ~marked & ((unshot := self.unshot.sum(1)) > least)).any():
                last = strategy(Candidates(np.flatnonzero(waiting), unshot, last, rng))
                marked[last] = True
                self._shoot(last)
                yield Shot(iteration, last, float(self.unshot.sum()) / max(self._emitted, 1e-300))
            iteration += 1
        yield self._finish(iteration)

    def _take(self, unit: int) -> np.ndarray:
        """Exitance (n, m, 3) that the elements of a unit have not shot, now taken as shot."""
        own = self._elements[unit]
        forest, trees = self._forest, self._trees[unit]
        received = forest.from_nodes(own, self._gathered[own])
        received[:, 0] += self._constant[own]
        self._gathered[own] = 0
        self._constant[own] = 0
        self._total[own] += received
        light = self._corrected(trees.push(received), own)
        if self._fresh[unit]:
            light = light + self._first[own]
            self._fresh[unit] = False
        return trees.pull(light * self._reflectance[own][:, None])

    def _corrected(self, light: np.ndarray, elements: np.ndarray) -> np.ndarray:
        """Irradiance (n, m, 3) of elements times the gain at their nodes; only leaves matter, the others are pulled from them."""
        leaf = np.flatnonzero(self._gained[elements])
        ids = elements[leaf]
        light[leaf] = self._forest.from_nodes(ids, self._forest.at_nodes(ids, light[leaf]) * self._gain[ids, :, None])
        return light

    def _shoot(self, unit: int) -> None:
        forest, own = self._forest, self._elements[unit]
        exitance = self._take(unit)
        power = forest.at_nodes(own, exitance) * forest.node_weights[own][..., None]
        flux = power.sum(1)
        self.shot[unit] += self.unshot[unit]
        self.unshot[unit] = 0
        for route in self._routes[unit]:
            links, rows = route.links, route.rows
            source = links.a if route.reverse else links.b
            exchange = links.exchange[rows]
            if route.reverse:
                exchange = exchange.transpose(0, 2, 1)
            at = self._place[source[rows]]
            sent = power[at] if exchange.shape[2] > 1 else flux[at][:, None]
            light = np.add.reduceat(np.matmul(exchange, sent), route.first, axis=0)
            self._receive(route.receivers, light)

    def _receive(self, receivers: np.ndarray, light: np.ndarray) -> None:
        forest = self._forest
        if light.shape[1] == 1:
            self._constant[receivers] += light[:, 0]
            flux = light[:, 0] * forest.area[receivers, None]
        else:
            self._gathered[receivers] += light
            flux = np.einsum("nqc,nq->nc", light, forest.node_weights[receivers])
        unit, reflected = self._unit[receivers], flux * self._reflectance[receivers]
        for channel in range(3):
            self.received[:, channel] += np.bincount(unit, flux[:, channel], minlength=self._units)
            self.unshot[:, channel] += np.bincount(unit, reflected[:, channel], minlength=self._units)

    def so_far(self) -> np.ndarray:
        """(E, m, 3) coefficients as in ``Radiosity.irradiance``, of the light that was received up to now."""
        return self._finish(0).irradiance

    def _finish(self, iterations: int) -> Radiosity:
        forest = self._forest
        everything = np.arange(len(forest))
        rest = forest.from_nodes(everything, self._gathered)
        rest[:, 0] += self._constant
        waiting = self._fresh[self._unit][:, None, None]
        leaf = np.flatnonzero(forest.leaf)
        left = (self._corrected(forest.push(rest), everything) + np.where(waiting, self._first, 0))[leaf]
        exitance = np.abs(forest.mean(leaf, left)) * self._reflectance[leaf]
        brightest = float(exitance.max(initial=0.0))
        total = self._corrected(forest.push(self._total + rest), everything)
        total = forest.pull(np.where(forest.leaf[:, None, None], total, 0))
        return Radiosity(total, iterations, self.unshot.sum(0), brightest, self.received, self.shot)


def _routes(links: list[LinkSet], unit: np.ndarray, units: int) -> list[list[_Route]]:
    """For every emitter the links that leave its elements, receivers together, so that sums run over neighbours in memory."""
    routes: list[list[_Route]] = [[] for _ in range(units)]
    for group in links:
        for reverse in (False, True) if group.two_way else (False,):
            source, receiver = (group.a, group.b) if reverse else (group.b, group.a)
            order = np.lexsort((receiver, unit[source]))
            cuts = np.searchsorted(unit[source[order]], np.arange(units + 1))
            for k in np.flatnonzero(np.diff(cuts)):
                rows = order[cuts[k] : cuts[k + 1]].astype(np.int32)
                to = receiver[rows]
                first = np.flatnonzero(np.r_[True, to[1:] != to[:-1]])
                routes[k].append(_Route(group, rows, reverse, first, to[first]))
    return routes
