"""Pieces cut along segments: nothing is lost, and no segment runs through what is left."""

import numpy as np
import pytest
from enfilade.core.plane_cuts import cut_along, holds
from enfilade.core.polygons import areas_and_centroids

SQUARE = np.array([[(0, 0), (4, 0), (4, 4), (0, 4)]], float)
SLACK = 1e-6


def cut(start, end, pieces=SQUARE):
    start, end = np.asarray(start, float), np.asarray(end, float)
    return cut_along(np.zeros(len(pieces), int), pieces, np.zeros(len(start), int), start, end, SLACK)[1]


def test_a_segment_cuts_by_its_whole_line():
    pieces = cut([(1, 1)], [(1, 2)])
    assert sorted(areas_and_centroids(pieces)[0]) == pytest.approx([4, 12])


@pytest.mark.parametrize("segment", [((5, 0), (5, 4)), ((0, 0), (4, 0)), ((-1, 2), (-0.1, 2)), ((3.9, 5), (5, 3.9)), ((1, 1), (1, 1))])
def test_what_does_not_run_through_does_not_cut(segment):
    assert len(cut([segment[0]], [segment[1]])) == 1


def test_each_owner_is_cut_by_its_own():
    pieces = np.repeat(SQUARE, 3, axis=0)
    owner, out = cut_along(
        np.arange(3), pieces, np.array([0, 2, 2]), *np.array([[(1, 0), (0, 3), (2, 0)], [(1, 4), (4, 3), (2, 4.0)]]), SLACK
    )
    assert owner.tolist() == [0, 0, 1, 2, 2, 2, 2]
    np.testing.assert_allclose(np.bincount(owner, areas_and_centroids(out)[0]), 16)


@pytest.mark.parametrize("seed", range(3))
def test_many_segments_leave_nothing_that_they_run_through(seed):
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.5, 4.5, (120, 2))
    end = start + rng.normal(0, 0.3, (120, 2))
    pieces = cut(start, end)
    area = areas_and_centroids(pieces)[0]
    assert area.min() > 0
    assert area.sum() == pytest.approx(16, rel=1e-9)
    inner = start[:, None] + np.linspace(0.02, 0.98, 20)[:, None] * (end - start)[:, None]
    assert not holds(pieces, np.broadcast_to(inner.reshape(1, -1, 2), (len(pieces), inner.size // 2, 2)), 1e-5).any()


def test_as_many_pieces_as_a_partition_of_the_plane_needs():
    # Feet of 900 tables in rows: cut in their order, the pieces of the floor would be cut some thousand times over.
    corner = np.stack(np.meshgrid(np.arange(30), np.arange(30), indexing="ij"), -1).reshape(-1, 1, 2) + 0.25
    ring = corner + 0.5 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    start, end = ring.reshape(-1, 2), np.roll(ring, -1, 1).reshape(-1, 2)
    pieces = cut(start, end, 7.5 * SQUARE)
    assert areas_and_centroids(pieces)[0].sum() == pytest.approx(900)
    assert len(pieces) < 20 * 900
