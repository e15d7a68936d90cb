"""The pairs of surfaces that the oracle starts from, against all pairs of a scene."""

import numpy as np
import pytest
from enfilade.core.sightlines import scope_groups, scope_of
from scenery import box, building_of, rotation, scene_of


@pytest.mark.parametrize("seed", [0, 1])
def test_every_pair_that_faces_each_other_comes_once(seed):
    rng = np.random.default_rng(seed)
    polygons = list(box(high=(6, 5, 3)))
    for _ in range(60):
        size, place, turn = rng.uniform(0.1, 0.6, 3), rng.uniform([1, 1, 0.8], [5, 4, 2.2]), rotation(int(rng.integers(100)))
        polygons += [place + face @ turn.T for face in box(high=size, inward=False)]
    building = building_of(scene_of(polygons, object=np.repeat(np.arange(61), 6).tolist()))
    regions = building.regions
    of = regions.polygon_region
    order = np.argsort(of[: len(polygons)])
    corners, normals = np.asarray(polygons, float)[order], regions.normal
    assert len(corners) == len(regions)
    found = []
    for group, within in scope_groups(building):
        scope = scope_of(building, group, within)
        found += [tuple(sorted(pair)) for pair in zip(scope.a.tolist(), scope.b.tolist(), strict=True)]
    assert len(found) == len(set(found))
    ahead = np.einsum("ik,jck->ijc", normals, corners).max(2) - np.einsum("ik,ik->i", normals, corners[:, 0])[:, None] > 1e-3
    i, j = np.nonzero(np.triu(ahead & ahead.T, 1))
    assert set(zip(i.tolist(), j.tolist(), strict=True)) <= set(found)
    # Where all of a cluster lies behind a face, its pairs with that face are not asked for at all.
    assert len(found) < 0.8 * len(regions) * (len(regions) - 1) / 2
