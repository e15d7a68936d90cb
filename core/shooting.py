"""Figure 7 of the paper: choose an emitter, let it shoot to its PVS, mark it, until little light is unshot.

Light is kept at the nodes of elements while it travels: what an element receives is gathered per node, and turned into
coefficients, pushed to the leaves, reflected and pulled back up when the element's emitter is next to shoot.

From the second time on an emitter shoots somewhat more than it has, because some of it will come back (successive
over-relaxation: Young 1954). What it has shot too much it holds back later: unshot light may be negative.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .elements import Forest, Subtrees
from .emitters import Emitters
from .grouping import runs
from .links import BLOCK, Gains
from .ordering import Candidates, Strategy
from .routes import Beam, Routes
from .store import Residency, Space, give_back

DIM = 10.0
"""The unshot part of any one room's light may be this many times the part of the whole building's."""
RELAXATION = 1.5
"""Most times what they have not shot that clusters shoot, because some of it will come back."""
GROWTH = 10.0
"""Unshot light of this many times its least so far grows without end: a shot never brings back all of it in a building that can be."""
ROUNDING = 1e-6
"""A room with less than this part of the emitted light holds what single precision lets slip through its walls: nobody waits for it."""


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
    growing : room whose unshot light grew, so that the shooting was given up, or -1
    received, shot : (units, 3) float64 W, per emitter, of this reflected light
    """

    irradiance: np.ndarray
    iterations: int
    unshot: np.ndarray
    unshot_exitance: float
    received: np.ndarray
    shot: np.ndarray
    growing: int


class Shooter:
    """State of the shooting of reflected light between emitters (clusters or cells).

    routes : the links of ``emitters``, whose elements are those of ``forest``;  rooms : (U,) room of each emitter
    direct : (E, m, 3) irradiance from luminaires at every element, ancestors included
    gains : of the links;  emitted : W, for the convergence test
    space : where the light is kept. What is not in memory of it goes to disk emitter by emitter.
    most : times what it has not shot that an emitter may shoot
    """

    def __init__(
        self,
        forest: Forest,
        routes: Routes,
        emitters: Emitters,
        rooms: np.ndarray,
        direct: np.ndarray,
        gains: Gains,
        emitted: float,
        space: Space | None = None,
        most: float = RELAXATION,
    ):
        self._forest, self._routes, self._emitters, self._emitted = forest, routes, emitters, emitted
        self._rooms, self._first, self._gains = rooms, direct, gains
        self._space = space or Space()
        self._trees: dict[int, Subtrees] = {}
        self._light, mapped = self._space.paged(len(forest), _light_of(forest))
        units, size = len(emitters), np.diff(emitters.start) * self._light.itemsize
        self._mapped = mapped
        limit = 0.5 * self._space.limit if mapped is not None else np.inf
        self._residency = Residency(size, limit, self._leave)
        self._links_read = 0
        self.unshot = np.zeros((units, 3))
        for places in emitters.blocks():
            own = emitters.order[places]
            leaf = own[forest.leaf_of(own)]
            power = forest.mean(leaf, direct[leaf]) * self._reflectance(leaf) * forest.area_of(leaf)[:, None]
            np.add.at(self.unshot, emitters.of(emitters.place[leaf]), power)
            self._space.breathe()
        self.received, self.shot = np.zeros((units, 3)), np.zeros((units, 3))
        self._fresh, self._marked = np.ones(units, bool), np.zeros(units, bool)
        self._iteration, self._last = 0, -1
        self._factor, self._most, self._grown = 1.0, most, 0
        self._left = self._lowest = float(np.abs(self.unshot).sum())

    def run(self, strategy: Strategy, rng: np.random.Generator, tolerance: float, max_iterations: int) -> Iterator[Shot | Radiosity]:
        """Shoot until the unshot part of the emitted power is at most ``tolerance``, and that of the light of each room ``DIM`` times
        this, or until it has grown ``GROWTH`` times; yields every shot, at last the light.

        In every iteration each emitter shoots once, in the order of ``strategy`` (paper, figure 7). One with next to nothing to
        shoot is passed over, and nothing is read for it, until it has received more. At the end the links are let go: a shooter
        runs once.
        """
        # Whoever is marked has shot in an iteration that was interrupted: it is finished first.
        while self._marked.any() or (self._iteration < max_iterations and not self._grows() and not self._settled(tolerance)):
            while (waiting := ~self._marked & ((unshot := np.abs(self.unshot).sum(1)) > self._least(tolerance))).any():
                self._last = strategy(Candidates(np.flatnonzero(waiting), unshot, self._last, rng))
                self._marked[self._last] = True
                self._shoot(self._last)
                yield Shot(self._iteration, self._last, float(np.abs(self.unshot).sum()) / max(self._emitted, 1e-300))
            self._iteration += 1
            self._marked[:] = False
            self._relax()
        # The result takes memory that the links need no more.
        self._trees, self._routes = {}, None
        yield self._finish()

    def _relax(self) -> None:
        """Choose the factor of the next iteration from what the last one has left (Young 1954; Hageman and Young 1981, section 9.5)."""
        left = float(np.abs(self.unshot).sum())
        rate, self._left, self._lowest = left / max(self._left, 1e-300), left, min(self._lowest, left)
        # The first iteration with a larger factor may leave more, the second must not.
        self._grown = self._grown + 1 if rate >= 1 else 0
        if self._grown > 1:
            # An emitter that lights itself, as a room does, takes less: once too much, the factor stays below for good.
            self._factor = self._most = 1 + 0.5 * (self._factor - 1)
        elif rate > self._factor - 1:
            squared = (rate + self._factor - 1) ** 2 / (rate * self._factor**2)
            self._factor = min(max(self._factor, 2 / (1 + np.sqrt(max(1 - squared, 0)))), self._most)

    def _grows(self) -> bool:
        return self._left > GROWTH * self._lowest

    def _admissible(self, tolerance: float) -> np.ndarray:
        """(R,) W that each room may leave unshot: a part of all that its emitters have reflected so far, and yet will."""
        whole = np.bincount(self._rooms, (self.unshot + self.shot).sum(1))
        return np.where(whole > ROUNDING * self._emitted, DIM * tolerance * whole, np.inf)

    def _settled(self, tolerance: float) -> bool:
        unshot = np.bincount(self._rooms, np.abs(self.unshot).sum(1))
        return unshot.sum() <= tolerance * self._emitted and bool((unshot <= self._admissible(tolerance)).all())

    def _least(self, tolerance: float) -> np.ndarray:
        """(U,) W below which an emitter waits for more: a shot of next to nothing costs as much as any."""
        share = self._admissible(tolerance) / np.maximum(np.bincount(self._rooms), 1)
        return 0.1 * np.minimum(tolerance * self._emitted / len(self._emitters), share[self._rooms])

    def state(self) -> dict[str, np.ndarray]:
        """All that a shooter of the same links needs to go on from here; to be used before the next shot."""
        numbers = {name: getattr(self, name) for name in ("unshot", "received", "shot")}
        flags = {"fresh": self._fresh, "marked": self._marked}
        pace = np.array([self._factor, self._most, self._grown, self._left, self._lowest])
        return {"light": self._light, "at": np.array([self._iteration, self._last]), "pace": pace} | numbers | flags

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go on from a :meth:`state`."""
        for low in range(0, len(self._light), BLOCK):
            self._light[low : low + BLOCK] = state["light"][low : low + BLOCK]
        self._page_out(0, len(self._light))
        self.unshot, self.received, self.shot = (state[name].copy() for name in ("unshot", "received", "shot"))
        self._fresh, self._marked = state["fresh"].copy(), state["marked"].copy()
        self._iteration, self._last = (int(x) for x in state["at"])
        self._factor, self._most, self._grown, self._left, self._lowest = (float(x) for x in state["pace"])

    def disk(self) -> dict[str, int]:
        """Bytes of light that were read and written, and of links that were read, because they are not in memory."""
        light = (self._residency.read, self._residency.written) if self._mapped is not None else (0, 0)
        return {"light_read": light[0], "light_written": light[1], "links_read": self._links_read}

    def so_far(self) -> np.ndarray:
        """(E, m, 3) coefficients as in ``Radiosity.irradiance``, of the light that was received up to now."""
        return self._finish().irradiance

    def _leave(self, emitters: np.ndarray) -> None:
        """The light of ``emitters`` need not be in memory any more."""
        start = self._emitters.start
        for emitter in emitters:
            self._page_out(start[emitter], start[emitter + 1])

    def _page_out(self, low: int, high: int) -> None:
        if self._mapped is not None:
            give_back(self._mapped, int(low) * self._light.itemsize, int(high) * self._light.itemsize)

    def _subtrees(self, emitter: int) -> Subtrees:
        """Push and pull on the elements of an emitter, kept for its next shot where there is memory for it."""
        if emitter in self._trees:
            return self._trees[emitter]
        trees = self._emitters.trees(self._forest, emitter)
        if not self._space.limited:
            self._trees[emitter] = trees
        return trees

    def _reflectance(self, elements: np.ndarray) -> np.ndarray:
        """(n, 3) float32."""
        return self._forest.regions.reflectance.take(self._forest.region.take(elements), 0).astype(np.float32)

    def _take(self, emitter: int, own: np.ndarray, factor: float) -> np.ndarray:
        """Exitance (n, m, 3) that the elements ``own`` of an emitter have not shot, now taken as shot."""
        forest, trees = self._forest, self._subtrees(emitter)
        light = self._light[self._emitters.start[emitter] : self._emitters.start[emitter + 1]]
        due = factor * (_received(forest, own, light) - light["shot"])
        light["shot"] += due
        leaves = own[trees.leaves]
        total = self._times(self._gains.received, trees.push(due).take(trees.leaves, 0), leaves)
        if self._fresh[emitter]:
            total += self._first.take(leaves, 0)
            self._fresh[emitter] = False
        exitance = np.zeros_like(due)
        exitance[trees.leaves] = self._times(self._gains.sent, total, leaves) * self._reflectance(leaves)[:, None]
        return trees.pull(exitance)

    def _times(self, gains: np.ndarray, light: np.ndarray, leaves: np.ndarray) -> np.ndarray:
        """Irradiance (n, m, 3) of leaves times the gain at their nodes, in place."""
        gain = gains.take(leaves, 0)
        some = (gain != 1).any(1).nonzero()[0]
        ids = leaves.take(some)
        light[some] = self._forest.from_nodes(ids, self._forest.at_nodes(ids, light.take(some, 0)) * gain.take(some, 0)[..., None])
        return light

    def _shoot(self, emitter: int) -> None:
        forest, emitters = self._forest, self._emitters
        own = emitters.order[emitters.start[emitter] : emitters.start[emitter + 1]]
        self._residency.next_shot()
        self._residency.need(np.array([emitter]))
        factor = 1.0 if self._fresh[emitter] else self._factor
        exitance = self._take(emitter, own, np.float32(factor))
        power = forest.at_nodes(own, exitance) * forest.node_weights_of(own)[..., None]
        flux = power.sum(1, keepdims=True)
        self.shot[emitter] += factor * self.unshot[emitter]
        self.unshot[emitter] *= 1 - factor
        arrived = []
        for beam in self._routes.beams(emitter):
            self._links_read += beam.nbytes if self._routes.on_disk else 0
            sent = (power if beam.exchange.shape[2] > 1 else flux).take(beam.source, 0)
            light = np.add.reduceat(np.matmul(beam.exchange, sent), beam.first, axis=0)
            arrived.append((beam.receivers, self._receive(beam, light)))
        if arrived:
            self._count(*(np.concatenate(column) for column in zip(*arrived, strict=True)))
        self._space.breathe()

    def _receive(self, beam: Beam, light: np.ndarray) -> np.ndarray:
        """Flux (n, 3) W of light (n, i, 3) that the receivers of a beam get at their nodes, or all over alike."""
        places = beam.receivers
        elements = self._emitters.order.take(places)
        if light.shape[1] == 1:
            self._light["constant"][places] += light[:, 0]
            return light[:, 0] * self._forest.area_of(elements).astype(np.float32)[:, None]
        self._light["gathered"][places] += light
        return np.einsum("nqc,nq->nc", light, self._forest.node_weights_of(elements))

    def _count(self, places: np.ndarray, flux: np.ndarray) -> None:
        """Add flux (n, 3) to what the emitters of ``places`` (n,), some of them more than once, have received and not shot."""
        emitter = self._emitters.of(places)
        first = runs(emitter)
        lit = emitter.take(first)
        self._residency.need(np.unique(lit))
        flux = flux.astype(np.float64)  # sums over many elements
        np.add.at(self.received, lit, np.add.reduceat(flux, first, axis=0))
        np.add.at(self.unshot, lit, np.add.reduceat(flux * self._reflectance(self._emitters.order.take(places)), first, axis=0))

    def _finish(self) -> Radiosity:
        forest, emitters = self._forest, self._emitters
        out = self._space.zeros((len(forest), forest.functions, 3), np.float32)
        brightest = 0.0
        for places in emitters.blocks():
            own, trees, light = emitters.order[places], emitters.trees_of_block(forest, places), self._light[places]
            received = _received(forest, own, light)
            rest = received - light["shot"]
            leaves = own[trees.leaves]
            waiting = self._fresh[emitters.of(places.start + trees.leaves)][:, None, None]
            left = self._times(self._gains.received, trees.push(rest)[trees.leaves], leaves) + np.where(waiting, self._first[leaves], 0)
            exitance = np.abs(forest.mean(leaves, left)) * self._reflectance(leaves)
            brightest = max(brightest, float(exitance.max(initial=0.0)))
            total = np.zeros_like(received)
            total[trees.leaves] = self._times(self._gains.received, trees.push(received)[trees.leaves], leaves)
            out[own] = trees.pull(total)
            self._page_out(places.start, places.stop)
            self._space.breathe()
        growing = int(np.bincount(self._rooms, np.abs(self.unshot).sum(1)).argmax()) if self._grows() else -1
        return Radiosity(out, self._iteration, np.abs(self.unshot).sum(0), brightest, self.received, self.shot, growing)


def summed(parts: Sequence[Radiosity]) -> Radiosity:
    """The light of several lightings of one forest together."""
    if len(parts) == 1:
        return parts[0]
    irradiance = parts[0].irradiance + parts[1].irradiance
    for part in parts[2:]:
        irradiance += part.irradiance
    unshot, received, shot = (np.sum([getattr(part, name) for part in parts], axis=0) for name in ("unshot", "received", "shot"))
    iterations, growing = (max(getattr(part, name) for part in parts) for name in ("iterations", "growing"))
    brightest = sum(part.unshot_exitance for part in parts)
    return Radiosity(irradiance, iterations, unshot, brightest, received, shot, growing)


def _light_of(forest: Forest) -> np.dtype:
    """The light of an element: what its nodes, and all of it alike, have received, and what of it has been shot."""
    parts = [("gathered", (forest.node_count, 3)), ("constant", (3,)), ("shot", (forest.functions, 3))]
    return np.dtype([(name, "<f4", shape) for name, shape in parts])


def _received(forest: Forest, elements: np.ndarray, light: np.ndarray) -> np.ndarray:
    """(n, m, 3) coefficients of the light that elements have received."""
    received = forest.from_nodes(elements, np.ascontiguousarray(light["gathered"]))
    received[:, 0] += light["constant"]
    return received
