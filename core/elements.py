"""The forest of surface elements: one tree of rectangles per region, refined as light demands, as a structure of arrays."""

from __future__ import annotations

import numpy as np

from . import basis
from .contours import contours
from .coverage import clipped_pieces, measure
from .grouping import GrowingArray, ragged, runs, starts_of
from .regions import Regions

SQUARISH = 1.5
"""A cell longer than this many times its width is halved across its length, any other is quartered."""
BLOCK = 1 << 14
"""Elements that are made at once: what is known of them on the way takes a kilobyte each."""


_RANK = np.array([[(family & ((1 << k) - 1)).bit_count() if family >> k & 1 else -1 for k in range(4)] for family in range(16)], np.int32)
"""(16, 4) which of the children that there are each of four is, -1 for one that there is not, by the bits of those that there are."""

Rows = np.ndarray | slice
"""Some elements by number, or all in turn."""


def _rows(table: np.ndarray, rows: Rows) -> np.ndarray:
    """``table[rows]``; for wide rows by number ``take`` is several times as fast."""
    return table[rows] if isinstance(rows, slice) else table.take(rows, 0)


class Forest:
    """Quadtrees on the rectangles of regions; element ids only ever grow, children come after their parents.

    order : order of the basis, m = order**2 coefficients;  q**2 nodes per element, q = ``basis.nodes_per_axis(order)``.
    Elements that a region covers in part know the covered area, have their nodes inside it, and fit their
    coefficients to those nodes; elements outside the cover do not exist.

    An element holds some fifty bytes: where it stands in its tree, and its box. What follows from these is computed when it is asked
    for (the functions whose names end in ``_of``, for some elements; properties, for all of them), and only elements that are
    covered in part, the cut ones, have a row in tables of what does not.
    """

    def __init__(self, regions: Regions, order: int):
        self.regions, self.order = regions, order
        q = basis.nodes_per_axis(order)
        self.functions, self.node_count = order * order, q * q
        self._uv, self._weights = basis.gauss_square(q)
        self._region = GrowingArray((), np.int32)
        self._slot = GrowingArray((), np.int8)
        self._level = GrowingArray((), np.int8)
        self._parent = GrowingArray((), np.int32)
        self._first_child = GrowingArray((), np.int32)
        self._family = GrowingArray((), np.uint8)
        self._box = GrowingArray((4,), np.float64)
        self._cut = GrowingArray((), np.int32)
        # Rows of cut elements; row 0 stands for all others.
        self._cover = GrowingArray((4,), np.float64)
        self._area = GrowingArray((), np.float64)
        self._pieces = GrowingArray((2,), np.int64)
        self._piece_ids = GrowingArray((), np.int32)
        self._nodes = GrowingArray((self.node_count, 3), np.float32)
        self._node_weights = GrowingArray((self.node_count,), np.float32)
        self._pull_row = GrowingArray((), np.int32)
        self._pull_child = GrowingArray((self.node_count,), np.int32)
        self._pull_basis = GrowingArray((self.node_count, self.functions), np.float64)
        self._evaluate = GrowingArray((self.node_count, self.functions), np.float64)
        self._project = GrowingArray((self.functions, self.node_count), np.float64)
        self._mean = GrowingArray((self.functions,), np.float64)
        for array in (self._cover, self._area, self._pieces, self._nodes, self._node_weights, self._pull_row):
            array.extend(np.zeros((1, *array.view().shape[1:])))
        full = basis.evaluate(order, self._uv)[None]
        self._evaluate.extend(full)
        self._project.extend(basis.fit(full, self._weights[None]) if order == 1 else np.linalg.inv(full))
        self._mean.extend(np.eye(self.functions)[:1])
        count = len(regions)
        start, pieces = regions.cover_start[:-1], np.diff(regions.cover_start)
        box = np.concatenate([np.zeros((count, 2)), regions.size], axis=1)
        made = self._append(
            np.arange(count),
            np.full(count, -1),
            np.zeros(count, np.int8),
            box,
            regions.full,
            start,
            pieces,
            np.arange(len(regions.cover)),
        )
        if not np.array_equal(made, np.arange(count)):
            raise ValueError("every region must have an area: its root element is its first")

    def __len__(self) -> int:
        return len(self._region)

    region = property(lambda self: self._region.view(), doc="(E,) int32 region")
    slot = property(lambda self: self._slot.view(), doc="(E,) int8 place in the parent, a row of ``basis.SLOTS``")
    level = property(lambda self: self._level.view(), doc="(E,) int8, 0 for roots")
    parent = property(lambda self: self._parent.view(), doc="(E,) int32, -1 for roots")
    box = property(lambda self: self._box.view(), doc="(E, 4) float64: u, v, width, height in the region's frame, m")
    leaf = property(lambda self: self._family.view() == 0, doc="(E,) bool")
    first_child = property(lambda self: self._first_child.view(), doc="(E,) int32, -1 for leaves; its siblings follow it")
    children = property(lambda self: self.children_of(slice(None)), doc="As :meth:`children_of`, of all elements.")
    area = property(lambda self: self.area_of(slice(None)), doc="As :meth:`area_of`, of all elements.")
    nodes = property(lambda self: self.nodes_of(slice(None)), doc="As :meth:`nodes_of`, of all elements.")
    node_weights = property(lambda self: self.node_weights_of(slice(None)), doc="As :meth:`node_weights_of`, of all elements.")

    def leaf_of(self, elements: Rows) -> np.ndarray:
        """(n,) bool."""
        return self._family.view()[elements] == 0

    def children_of(self, elements: Rows) -> np.ndarray:
        """(n, 4) int32, -1 where there is none; the children of an element follow one another."""
        rank = _RANK.take(self._family.view()[elements], 0)
        return np.where(rank < 0, -1, self._first_child.view()[elements][:, None] + rank)

    def area_of(self, elements: Rows) -> np.ndarray:
        """(n,) float64 covered area, m2."""
        box, row = _rows(self._box.view(), elements), self._cut.view()[elements]
        return np.where(row > 0, self._area.view()[row], box[:, 2] * box[:, 3])

    def cover_of(self, elements: Rows) -> np.ndarray:
        """(n, 4) float64: the box of the covered part."""
        row = self._cut.view()[elements]
        return np.where((row > 0)[:, None], self._cover.view().take(row, 0), _rows(self._box.view(), elements))

    def nodes_of(self, elements: Rows) -> np.ndarray:
        """(n, q*q, 3) float32 relative to the scene's centre, m."""
        box, row = _rows(self._box.view(), elements), self._cut.view()[elements]
        out = self._world(self._region.view()[elements], box[:, None, :2] + self._uv * box[:, None, 2:])
        cut = np.flatnonzero(row)
        out[cut] = self._nodes.view().take(row[cut], 0)
        return out

    def node_of(self, elements: np.ndarray, node: np.ndarray) -> np.ndarray:
        """(n, 3) float32, one node of each of ``elements``, by its number ``node`` (n,)."""
        box, row = self._box.view()[elements], self._cut.view()[elements]
        out = self._world(self._region.view()[elements], (box[:, :2] + self._uv[node] * box[:, 2:])[:, None])[:, 0]
        cut = np.flatnonzero(row)
        out[cut] = self._nodes.view()[row[cut], node[cut]]
        return out

    def node_weights_of(self, elements: Rows) -> np.ndarray:
        """(n, q*q) float32, sum = area."""
        box, row = _rows(self._box.view(), elements), self._cut.view()[elements]
        out = ((box[:, 2] * box[:, 3])[:, None] * self._weights).astype(np.float32)
        cut = row.nonzero()[0]
        out[cut] = self._node_weights.view().take(row[cut], 0)
        return out

    def _world(self, region: np.ndarray, uv: np.ndarray) -> np.ndarray:
        """(n, k, 3) float32 of places (n, k, 2) in the frames of regions (n,)."""
        regions = self.regions
        origin, u, v = (axis.take(region, 0)[:, None] for axis in (regions.origin, regions.u, regions.v))
        return (origin + uv[..., :1] * u + uv[..., 1:] * v).astype(np.float32)

    def can_split(self, elements: np.ndarray, min_size: float) -> np.ndarray:
        """(n,) bool: leaves whose children would have a longer edge of at least ``min_size`` (m), or that are split already."""
        return (self.box[elements, 2:].max(1) >= 2 * min_size) | ~self.leaf_of(elements)

    def spheres(self, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centre (n, 3) and radius (n,) of a ball around the covered part of elements, float32."""
        cover, region = self.cover_of(elements), self.region[elements]
        centre = self.regions.world(region, cover[:, :2] + 0.5 * cover[:, 2:])
        return centre.astype(np.float32), (0.5 * np.hypot(cover[:, 2], cover[:, 3])).astype(np.float32)

    def split(self, elements: np.ndarray) -> None:
        """Give children to those of ``elements`` (n,) that have none."""
        elements = np.unique(elements)
        parents = elements[self.leaf_of(elements)]
        if not len(parents):
            return
        first = self.first_slot(parents)
        slot, owner = ragged(first, np.where(first == 0, 4, 2))
        parent = parents[owner]
        place = basis.SLOTS[slot]
        box = np.empty((len(slot), 4))
        box[:, :2] = self.box[parent, :2] + place[:, :2] * self.box[parent, 2:]
        box[:, 2:] = place[:, 2:] * self.box[parent, 2:]
        row = self._cut.view()[parent]
        start, count = self._pieces.view()[row].T
        made = self._append(self.region[parent], parent, slot.astype(np.int8), box, row == 0, start, count, self._piece_ids.view())
        exists = made >= 0
        np.bitwise_or.at(self._family.view(), parent[exists], (1 << (slot - first[owner]))[exists].astype(np.uint8))
        oldest = exists.nonzero()[0][runs(owner[exists])]
        self._first_child.view()[parent[oldest]] = made[oldest]
        self._prepare_pull(parents[self.cut(parents)])

    def _append(self, region, parent, slot, box, full, piece_start, piece_count, piece_table):
        """Add elements; those that cover nothing are left out. Returns the id of each, -1 where left out."""
        columns = (region, parent, slot, box, full, piece_start, piece_count)
        parts = (slice(low, low + BLOCK) for low in range(0, len(region) or 1, BLOCK))
        return np.concatenate([self._append_block(*(x[part] for x in columns), piece_table) for part in parts])

    def _append_block(self, region, parent, slot, box, full, piece_start, piece_count, piece_table):
        count, q = len(region), basis.nodes_per_axis(self.order)
        row = np.zeros(count, np.int32)
        keep = np.ones(count, bool)
        partial = np.flatnonzero(~full)
        if len(partial):
            members, owner = ragged(piece_start[partial], piece_count[partial])
            ids = piece_table[members]
            sub_area, sub_moment, low, high, touched = measure(self.regions, box[partial], owner, ids, q)
            total = sub_area.sum(1)
            cell = box[partial, 2] * box[partial, 3]
            keep[partial] = total > 1e-7 * cell
            cut = keep[partial] & (total < (1 - 1e-6) * cell)
            inside = np.flatnonzero(cut)
            here = partial[inside]
            row[here] = len(self._area) + np.arange(len(here))
            mean = sub_moment[inside].sum(1) / total[inside, None]
            empty = sub_area[inside] <= 1e-9 * total[inside, None]
            uv = np.where(empty[..., None], mean[:, None], sub_moment[inside] / np.where(empty, 1.0, sub_area[inside])[..., None])
            weights = np.where(empty, 0.0, sub_area[inside])
            local = (uv - box[here, None, :2]) / box[here, None, 2:]
            values = basis.evaluate(self.order, local)
            self._evaluate.extend(values)
            self._project.extend(basis.fit(values, weights))
            self._mean.extend(np.einsum("nq,nqm->nm", weights, values) / weights.sum(1, keepdims=True))
            self._area.extend(total[inside])
            self._cover.extend(np.concatenate([low[inside], high[inside] - low[inside]], axis=1))
            self._nodes.extend(self._world(region[here], uv))
            self._node_weights.extend(weights)
            self._pull_row.extend(np.full(len(here), -1))
            used = touched & cut[owner]
            start = len(self._piece_ids) + np.searchsorted(owner[used], inside)
            self._pieces.extend(np.stack([start, np.bincount(owner[used], minlength=len(partial))[inside]], axis=1))
            self._piece_ids.extend(ids[used])
        ids = np.where(keep, len(self) + np.cumsum(keep) - 1, -1)
        made = int(keep.sum())
        level = np.where(parent < 0, 0, self.level[parent] + 1) if len(self) else np.zeros(count)
        self._region.extend(region[keep])
        self._slot.extend(slot[keep])
        self._level.extend(level[keep])
        self._parent.extend(parent[keep])
        self._first_child.extend(np.full(made, -1))
        self._family.extend(np.zeros(made))
        self._box.extend(box[keep])
        self._cut.extend(row[keep])
        return ids

    def _prepare_pull(self, parents: np.ndarray) -> None:
        """For partly covered parents: the child under each node and its basis there."""
        if not len(parents):
            return
        evaluate = self._evaluate.view()[self._cut.view()[parents]]
        # The linear functions give the node's place back, so it need not be stored; M1 has none and takes the mean anyway.
        if self.order > 1:
            x = (evaluate[:, :, self.order] / np.sqrt(3) + 1) / 2
            y = (evaluate[:, :, 1] / np.sqrt(3) + 1) / 2
        else:
            x = y = np.full(evaluate.shape[:2], 0.5)
        slot0 = self.first_slot(parents)[:, None]
        east, north = (x > 0.5).astype(int), (y > 0.5).astype(int)
        index = np.where(slot0 == 4, east, np.where(slot0 == 6, north, east + 2 * north))
        child = np.take_along_axis(self.children_of(parents), index, 1)
        place = basis.SLOTS[slot0 + index]
        local = (np.stack([x, y], -1) - place[..., :2]) / place[..., 2:]
        self._pull_row.view()[self._cut.view()[parents]] = len(self._pull_child) + np.arange(len(parents))
        self._pull_child.extend(child)
        self._pull_basis.extend(basis.evaluate(self.order, local))

    def cut(self, elements: np.ndarray) -> np.ndarray:
        """(n,) bool: the region covers the element in part."""
        return self._cut.view()[elements] > 0

    def first_slot(self, parents: np.ndarray) -> np.ndarray:
        """(n,) place of the first child, a row of ``basis.SLOTS``: 0 quarters, 4 halves along u, 6 halves along v."""
        width, height = self.box[parents, 2], self.box[parents, 3]
        return np.where(width > SQUARISH * height, 4, np.where(height > SQUARISH * width, 6, 0))

    def locate(self, region: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The smallest element (n,) under each point ``uv`` (n, 2) of the frames of ``region`` (n,), the parent where no child lies
        there, and the point in its unit square (n, 2).
        """
        element = region.astype(np.int64)
        active = np.arange(len(element))
        while len(active):
            children = self.children_of(element[active])
            box = self.box[np.maximum(children, 0)]
            offset = uv[active, None] - box[:, :, :2]
            inside = (children >= 0) & (offset >= 0).all(2) & (offset <= box[:, :, 2:]).all(2)
            found = inside.any(1)
            active = active[found]
            element[active] = np.take_along_axis(children[found], inside[found].argmax(1)[:, None], 1)[:, 0]
        box = self.box[element]
        return element, np.clip((uv - box[:, :2]) / box[:, 2:], 0, 1)

    def at_nodes(self, elements: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Values (n, q*q, c) at the nodes of ``elements`` of functions with coefficients (n, m, c)."""
        return self._apply(self._evaluate.view(), elements, coefficients)

    def from_nodes(self, elements: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Coefficients (n, m, c) of values (n, q*q, c) at the nodes of ``elements``; keeps the mean."""
        return self._apply(self._project.view(), elements, values)

    def _apply(self, table, elements, values):
        matrix = self._cut.view().take(elements)
        out = np.matmul(table[0].astype(values.dtype), values)
        partial = matrix.nonzero()[0]
        if len(partial):
            out[partial] = np.matmul(table.take(matrix.take(partial), 0).astype(values.dtype), values.take(partial, 0))
        return out

    def mean(self, elements: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Mean (n, c) over the covered part of functions with coefficients (n, m, c)."""
        matrix = self._cut.view()[elements]
        out = coefficients[:, 0].copy()
        partial = np.flatnonzero(matrix)
        out[partial] = np.einsum("nm,nmc->nc", self._mean.view().take(matrix[partial], 0), coefficients.take(partial, 0))
        return out

    def push(self, coefficients: np.ndarray) -> np.ndarray:
        """Total at every element (E, m, c): its own coefficients plus what its ancestors hold, root to leaf. Exact."""
        everything = np.arange(len(self))
        return Subtrees(self, everything, everything).push(coefficients)

    def pull(self, coefficients: np.ndarray) -> np.ndarray:
        """Coefficients (E, m, c) of every element from those of the leaves below it; the mean is kept to rounding."""
        everything = np.arange(len(self))
        return Subtrees(self, everything, everything).pull(coefficients)

    def pull_cut(self, parents: np.ndarray, place: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Coefficients (n, m, c) of partly covered ``parents``, fitted at their nodes to the children under them.

        place : (E,) where each child stands among the coefficients ``total`` (.., m, c)
        """
        row = self._pull_row.view()[self._cut.view()[parents]]
        child, values = self._pull_child.view().take(row, 0), self._pull_basis.view().take(row, 0).astype(total.dtype)
        below = total.take(place.take(np.maximum(child, 0)), 0)
        nodes = np.matmul(values[:, :, None], below)[:, :, 0] * (child >= 0)[..., None]
        out = self.from_nodes(parents, nodes)
        children = self.children_of(parents)
        flat = np.maximum(children, 0).reshape(-1)
        area = np.where(children >= 0, self.area_of(flat).reshape(children.shape), 0.0)
        means = self.mean(flat, total.take(place.take(flat), 0)).reshape(*children.shape, -1)
        target = np.einsum("nk,nkc->nc", area / area.sum(1, keepdims=True), means)
        out[:, 0] += (target - self.mean(parents, out)).astype(total.dtype)
        return out

    def centroids(self, elements: np.ndarray) -> np.ndarray:
        """(n, 3) float32 centre of gravity of the covered part of elements."""
        weights = self.node_weights_of(elements)
        return np.einsum("nq,nqk->nk", weights / weights.sum(1, keepdims=True), self.nodes_of(elements))

    def corners(self, elements: np.ndarray) -> np.ndarray:
        """(n, 4, 3) float32 corners of the rectangles around the covered part of elements."""
        cover, region = self.cover_of(elements), np.repeat(self.region[elements], 4)
        uv = cover[:, None, :2] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * cover[:, None, 2:]
        return self.regions.world(region, uv.reshape(-1, 2)).reshape(-1, 4, 3).astype(np.float32)

    def contours(self, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Edges around the covered part of elements (n,): their rows (e,), sorted, and their ends (e, 3), (e, 3) float64.

        As of :func:`contours.contours`: closed chains with the element on their left, seen from its front.
        """
        some, index = np.unique(elements, return_inverse=True)
        row, *ends = self._flat_contours(some)
        region = self.region[some][row]
        first = starts_of(row, len(some))
        edge, row = ragged(first[index], np.diff(first)[index])
        return row, *(self.regions.world(region, end).take(edge, 0) for end in ends)

    def _flat_contours(self, elements):
        """The same in the frames of the regions."""
        partial = self._cut.view()[elements] > 0
        full, cut = np.flatnonzero(~partial), np.flatnonzero(partial)
        box = self.box[elements]
        u, v = (np.stack([box[full, k], box[full, k] + box[full, k + 2]], axis=1) for k in (0, 1))
        corner = np.stack([u[:, [0, 1, 1, 0]], v[:, [0, 0, 1, 1]]], axis=2)
        start, count = self._pieces.view()[self._cut.view()[elements[cut]]].T
        members, owner = ragged(start, count)
        around, first, last = contours(owner, clipped_pieces(self.regions, box[cut], owner, self._piece_ids.view()[members]))
        row = np.concatenate([np.repeat(full, 4), cut[around]])
        order = np.argsort(row, kind="stable")
        ends = np.concatenate([corner.reshape(-1, 2), first]), np.concatenate([np.roll(corner, -1, 1).reshape(-1, 2), last])
        return row[order], *(end[order] for end in ends)


class Subtrees:
    """Push and pull on some trees of a forest: the indices of every level, looked up once; good until the next split.

    elements : (n,) whole trees;  place : (E,) where each of them stands in ``elements`` (other entries are not read)
    leaves : (l,) int32, where the leaves stand in ``elements``
    """

    def __init__(self, forest: Forest, elements: np.ndarray, place: np.ndarray):
        self._forest, self._place = forest, place
        level = forest.level[elements]
        depth = int(level.max(initial=0))
        by_level = np.argsort(level, kind="stable").astype(np.int32)
        start = np.searchsorted(level[by_level], np.arange(depth + 2))
        # Elements that stand by level, as those of an emitter do, need no index: that of a slice is shorter and quicker.
        in_order = bool((np.diff(level) >= 0).all())
        inner = ~forest.leaf_of(elements)
        self.leaves = np.flatnonzero(~inner).astype(np.int32)
        self._down, self._up = [], []
        for k in range(1, depth + 1):
            here = by_level[start[k] : start[k + 1]]
            ids = elements[here]
            rows = slice(int(start[k]), int(start[k + 1])) if in_order else here
            self._down.append((rows, self._place[forest.parent[ids]], forest.slot[ids]))
        for k in range(depth - 1, -1, -1):
            here = by_level[start[k] : start[k + 1]]
            self._up.append(self._upward(elements, here[inner[here]]))

    def _upward(self, elements: np.ndarray, at: np.ndarray) -> tuple:
        """Parents ``at`` of one level: whole ones with one way to split after another, with the first slots of their children and the
        places (n, 2 or 4) of these; and cut ones, with their elements.
        """
        forest = self._forest
        cut = forest.cut(elements[at])
        first, whole = forest.first_slot(elements[at]), []
        for slot, number in basis.FAMILIES:
            alike = at[~cut & (first == slot)]
            if len(alike):
                whole.append((slot, alike, self._place[forest.children_of(elements[alike])[:, :number]]))
        return whole, at[cut], elements[at[cut]]

    def push(self, coefficients: np.ndarray) -> np.ndarray:
        """Total at every element (n, m, c): its own coefficients plus what its ancestors hold, root to leaf. Exact."""
        total = coefficients.copy()
        filters = basis.two_scale(self._forest.order).astype(total.dtype).transpose(0, 2, 1)
        for here, parent, slot in self._down:
            total[here] += np.matmul(filters.take(slot, 0), total.take(parent, 0))
        return total

    def pull(self, coefficients: np.ndarray) -> np.ndarray:
        """Coefficients (n, m, c) of every element from those of the leaves below it; the mean is kept to rounding."""
        total = coefficients.copy()
        two_scale = basis.two_scale(self._forest.order).astype(total.dtype)
        for whole, cut, ids in self._up:
            for slot, full, children in whole:
                number = children.shape[1]
                filters = np.concatenate(two_scale[slot : slot + number], axis=1) / total.dtype.type(number)
                total[full] = np.matmul(filters, total.take(children, 0).reshape(len(full), -1, total.shape[2]))
            if len(cut):
                total[cut] = self._forest.pull_cut(ids, self._place, total)
        return total
