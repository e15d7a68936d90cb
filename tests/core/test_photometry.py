"""Stored quantities against numbers worked out by hand."""

import math

import numpy as np
import pytest
from enfilade.core.photometry import PARTS, luminance, recombined, stored_quantity

E, RHO, M = np.array([[math.pi, 2 * math.pi, 0.0]]), np.array([[0.5, 0.25, 1.0]]), np.array([[0.0, math.pi, 3 * math.pi]])


def test_radiosity_is_the_radiance_of_the_lit_surface():
    assert stored_quantity("radiosity", E, RHO, M) == pytest.approx(np.array([[0.5, 1.5, 3.0]]))


def test_lighting_is_that_of_a_white_surface():
    assert stored_quantity("lighting", E, RHO, M) == pytest.approx(np.array([[1.0, 2.0, 0.0]]))


def test_lux():
    assert stored_quantity("lux", np.ones((2, 3)), RHO, M) == pytest.approx(179.0)
    green = stored_quantity("lux", np.array([[0.0, 1.0, 0.0]]), RHO, M)
    assert green == pytest.approx(np.full((1, 3), 0.7152 * 179))
    assert green.dtype == np.float32


def test_luminance_of_white_is_one():
    assert luminance(np.ones((4, 5, 3))) == pytest.approx(1.0)


def test_unknown_quantity():
    with pytest.raises(ValueError, match="candela"):
        stored_quantity("candela", E, RHO, M)


@pytest.mark.parametrize("quantity", ["radiosity", "lighting", "lux"])
def test_light_groups_recombine_to_what_a_bake_of_their_light_stores(quantity):
    rng = np.random.default_rng(0)
    irradiance, emission, factor, rho = rng.random((3, 5, 3)), rng.random((3, 5, 3)), rng.random((3, 3)), rng.random((5, 3))
    parts = [stored_quantity(PARTS.get(quantity, quantity), e, rho, m) for e, m in zip(irradiance, emission, strict=True)]
    parts = [np.concatenate([part, np.ones((5, 1), np.float32)], axis=1) for part in parts]
    before = [part.copy() for part in parts]
    found = recombined(quantity, parts, factor)
    whole = stored_quantity(quantity, (factor[:, None] * irradiance).sum(0), rho, (factor[:, None] * emission).sum(0))
    assert found[:, :3] == pytest.approx(whole, rel=1e-5)
    assert (found[:, 3] == 1).all()
    assert found.dtype == np.float32
    np.testing.assert_array_equal(parts, before)


def test_no_light_groups_cannot_be_recombined():
    with pytest.raises(ValueError, match="no light group"):
        recombined("lux", [], [])
