"""Values of faces: few, and with the same sum."""

import numpy as np
import pytest
from enfilade.core.patch_means import patch_means


def line(count):
    return np.stack([np.arange(count) + 0.5, np.zeros(count), np.zeros(count)], axis=1)


def means(value, cells=8, tolerance=0.05, area=None, patch=None):
    value = np.asarray(value, float)
    count = len(value)
    area = np.ones(count) if area is None else np.asarray(area, float)
    patch = np.zeros(count, int) if patch is None else np.asarray(patch)
    return patch_means(value[:, None], area, patch, line(count), cells, np.full(patch.max() + 1, tolerance))[:, 0]


def test_what_is_alike_is_one():
    assert means([0.5, 0.51, 0.49, 0.5], area=[1, 1, 1, 3]) == pytest.approx([0.5] * 4, abs=1e-12)


def test_what_differs_stays():
    assert means([0.0, 1.0]) == pytest.approx([0.0, 1.0])


def test_others_than_the_mean_are_alike_too():
    assert means([0.0, 0.9, 0.92]) == pytest.approx([0.0, 0.91, 0.91])


def test_patches_are_apart():
    assert means([0.0, 0.02, 0.04, 1.0], patch=[0, 0, 1, 1]) == pytest.approx([0.01, 0.01, 0.04, 1.0])


def test_small_faces_share_cells_and_no_sum_is_lost():
    rng = np.random.default_rng(0)
    value, area = rng.random(1000), rng.random(1000)
    out = means(value, cells=4, tolerance=1e-6, area=area)
    assert len(np.unique(out)) == 4
    assert out @ area == pytest.approx(value @ area, rel=1e-12)
    assert out[:250] == pytest.approx(np.average(value[:250], weights=area[:250]))


def test_a_face_without_area_takes_no_part():
    assert means([0.2, 7.0, 0.2], area=[1, 0, 1])[[0, 2]] == pytest.approx(0.2)
