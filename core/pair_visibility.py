"""What stands between pairs of elements: the segments between their nodes, and the blockers in their shafts.

Where very many blockers may stand between the pairs, the largest are asked first: what they hide for certain needs no
others. What is found is the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .elements import Forest
from .exchanges import Ends, Pairs
from .occlusion import Blockers, Bodies, ShaftIndex, Shafts, cut_segments

MANY = 1 << 10
"""Blockers above which they are asked by size."""
LARGEST = (1 << 6, 1 << 9)
"""Of so many, the first and the next that are asked."""


class View:
    """What pairs of elements see of each other between some of their nodes, as the blockers are asked one lot after another.

    rows : (n,) of the pairs;  nodes : (n, i, 3), (n, j, 3) float32 of both sides, one where a single node stands for its element
    ray : bool, each pair is one segment: its shaft is that segment, nothing else is asked, and next to nothing stands in it
    hidden : (n, i, j) bool, a blocker cuts the segment;  done : (n,) bool, no part of either element sees the other
    """

    def __init__(self, forest: Forest, ends: Ends, pairs: Pairs, mode: tuple[bool, bool, np.ndarray]):
        one_a, one_b, self.rows = mode
        self.ray = one_a and one_b
        self._a, self._b = (ends.elements[i[self.rows]] for i in (pairs.ia, pairs.ib))
        self.nodes = tuple(_nodes(forest, x, one) for x, one in ((self._a, one_a), (self._b, one_b)))
        self.hidden = np.zeros((len(self.rows), *(x.shape[1] for x in self.nodes)), bool)
        self.done = np.zeros(len(self.rows), bool)
        self._doubtful = np.zeros(len(self.rows), bool)

    @property
    def asked(self) -> np.ndarray:
        """Rows of the pairs that more blockers may hide."""
        return self.rows[~self.done]

    def spread(self) -> np.ndarray:
        """(n,) standard deviation of the visibility of a segment between two elements, of which some are known.

        Samples that agree prove nothing while a blocker may stand between them: half a sample is taken to disagree. Only a
        pair without candidates is certain, and one that is hidden for certain; a single ray is not asked to be.
        """
        count = self.hidden.shape[1] * self.hidden.shape[2]
        share = (self.hidden.sum((1, 2)) + 0.5) / (count + 1)
        return np.where(self._doubtful & ~self.done, np.sqrt(share * (1 - share)), 0.0)

    def ask(self, forest: Forest, blockers: Blockers, pair: np.ndarray, blocker: np.ndarray, limit: np.ndarray) -> int:
        """Test the pairs that are ``asked`` against the candidates (pair, blocker), rows sorted by pair; returns how many segments.

        limit : (n,) spread that does not matter: then a pair all of whose segments are cut is done
        """
        at = np.flatnonzero(~self.done)
        nodes = [x.take(at, 0) for x in self.nodes]
        cuts = cut_segments(blockers, pair, blocker, *nodes)
        self.hidden[at] |= cuts.hidden
        self._doubtful[at[pair]] = not self.ray
        whole = self.hidden.take(at, 0).all((1, 2))
        sure = whole & (self.spread()[at] <= limit[at])
        alone = np.flatnonzero(whole & ~sure & (cuts.alone >= 0))
        sure[alone] = _surely_hidden(forest, blockers, self._a[at[alone]], self._b[at[alone]], alone, pair, blocker)
        self.done[at[sure]] = True
        return len(pair) * nodes[0].shape[1] * nodes[1].shape[1]


def look(forest: Forest, ends: Ends, pairs: Pairs, views: list[View], blockers: Blockers, limit: np.ndarray) -> int:
    """Ask all blockers that may stand between the pairs of ``views``; returns how many segments were tested.

    limit : (n,) of the pairs, as of :meth:`View.ask`
    """
    points, tests = _points(forest, ends), 0
    for lot in _by_size(blockers):
        asked = [view.asked for view in views]
        if not sum(map(len, asked)):
            break
        used = np.unique(np.concatenate([i[rows] for rows in asked for i in (pairs.ia, pairs.ib)]))
        some = lot.within(*ends.bodies.take(used).box())
        index = ShaftIndex(some)
        wide = _Sought(index, ends.bodies, pairs, [rows for view, rows in zip(views, asked, strict=True) if not view.ray])
        for view, rows in zip(views, asked, strict=True):
            sought = _Sought(index, points, pairs, [rows]) if view.ray else wide
            tests += view.ask(forest, some, *sought.candidates(pairs.take(rows)), limit[view.rows])
    return tests


def _by_size(blockers: Blockers) -> Iterator[Blockers]:
    """All blockers, the largest first where there are many; those of one lot in their own order."""
    if len(blockers) <= MANY:
        yield blockers
        return
    for lot in np.split(np.argsort(-blockers.size, kind="stable"), LARGEST):
        yield blockers.take(np.sort(lot))


class _Sought:
    """The shafts of the bodies of some rows of pairs, for the blockers that may stand between them."""

    def __init__(self, blockers: ShaftIndex, bodies: Bodies, pairs: Pairs, rows: list[np.ndarray]):
        used = np.zeros(len(bodies), bool)
        for some in rows:
            used[pairs.ia[some]] = used[pairs.ib[some]] = True
        self._place = np.cumsum(used) - 1
        self._shafts = Shafts(bodies.take(np.flatnonzero(used)), blockers)

    def candidates(self, pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
        """Rows (pair, blocker) of the blockers that may stand between the bodies of ``pairs``."""
        return self._shafts.candidates(self._place[pairs.ia], self._place[pairs.ib])


def _points(forest: Forest, ends: Ends) -> Bodies:
    """The ends shrunk to their centres of gravity."""
    zero = np.zeros_like(ends.bodies.half_u)
    return Bodies(forest.centroids(ends.elements), zero, zero, ends.bodies.normal)


def _surely_hidden(forest: Forest, blockers: Blockers, a, b, chosen, pair, blocker) -> np.ndarray:
    """(n,) bool: one blocker cuts all segments between the corners of elements a and b, and so all between the elements.

    chosen : (n,) numbers of these pairs in the rows (pair, blocker).
    """
    place = np.full(int(pair.max(initial=-1)) + 1, -1)
    place[chosen] = np.arange(len(chosen))
    mine = place[pair] >= 0
    return cut_segments(blockers, place[pair[mine]], blocker[mine], forest.corners(a), forest.corners(b)).alone >= 0


def _nodes(forest: Forest, elements: np.ndarray, one: bool) -> np.ndarray:
    """(n, 1 or q*q, 3) float32."""
    return forest.centroids(elements)[:, None] if one else forest.nodes_of(elements)
