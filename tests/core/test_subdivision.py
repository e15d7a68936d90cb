"""Subdivided meshes cover what was there, hang together and keep to the limit."""

import numpy as np
import pytest
from enfilade.core import subdivision
from enfilade.core.scene import SceneError
from enfilade.core.subdivision import subdivide


def mesh(seed, n=12):
    """A random height field over a grid: triangles of many shapes."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.cumsum(rng.random(n) ** 3), np.cumsum(rng.random(n) ** 3), indexing="ij")
    position = np.stack([x, y, rng.random((n, n))], -1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    v = lambda a, b: a * n + b  # noqa: E731
    return position, np.concatenate(
        [np.stack([v(i, j), v(i + 1, j), v(i, j + 1)], 1), np.stack([v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)], 1)]
    )


def areas(corners):
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def edge_use(vertex):
    edges = np.sort(np.stack([vertex, np.roll(vertex, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_random_surface(seed):
    position, triangles = mesh(seed)
    made = subdivide(position, triangles, 0.1)
    corners = np.einsum("tij,tjk->tik", made.weight, position[triangles[made.parent]])
    # Corners with one number are one point, also across triangles: no cracks.
    place = np.full((made.count, 3), np.nan)
    place[made.vertex.ravel()] = corners.reshape(-1, 3)
    assert np.isfinite(place).all()
    assert place[made.vertex] == pytest.approx(corners, abs=1e-12)
    assert np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max() <= 0.1
    covered = np.bincount(made.parent, areas(corners), len(triangles))
    assert covered == pytest.approx(areas(position[triangles]))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    before = position[triangles[made.parent]]
    assert (np.einsum("ij,ij->i", normal, np.cross(before[:, 1] - before[:, 0], before[:, 2] - before[:, 0])) > 0).all()
    # As many rim edges as the rim has pieces, every other edge between two triangles: no T-junctions.
    use = edge_use(made.vertex)
    assert use.max() == 2
    euler = made.count - len(use) + len(made.vertex)
    assert euler == 1


def test_a_square_becomes_a_grid():
    position = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    made = subdivide(position, np.array([[0, 1, 2], [0, 2, 3]]), 0.36)
    assert len(made.vertex) == 32
    assert made.count == 25


def test_short_edges_stay():
    position, triangles = mesh(2)
    made = subdivide(position, triangles, 1e3)
    assert np.array_equal(made.vertex, triangles)
    assert made.count == len(position)
    assert subdivide(position, triangles[:0], 0.1).vertex.shape == (0, 3)


def test_too_many_triangles_are_refused(monkeypatch):
    monkeypatch.setattr(subdivision, "LARGEST", 1000)
    position, triangles = mesh(0)
    with pytest.raises(SceneError, match="take a longer edge"):
        subdivide(position, triangles, 1e-6)
