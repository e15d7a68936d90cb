"""Distributions of luminous intensity against closed forms and against quadrature that knows nothing of hat functions."""

import math

import numpy as np
import pytest
from enfilade.core.luminaires import Luminaire, illuminance
from enfilade.core.luminous_intensity import POLE_DOWN, Distribution, closed, mirrored
from hypothesis import given, settings
from hypothesis import strategies as st


def directions(azimuth, colatitude):
    """Unit vectors by angles in degrees about the downward pole."""
    azimuth, colatitude = np.radians(azimuth), np.radians(colatitude)
    return np.stack((np.sin(colatitude) * np.cos(azimuth), np.sin(colatitude) * np.sin(azimuth), -np.cos(colatitude)), -1)


def turned(rng):
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def round_distribution(colatitude, candela):
    return Distribution(np.array([0.0, 360.0]), np.array(colatitude, float), np.tile(np.array(candela, float), (2, 1)), POLE_DOWN)


def test_flux_of_even_light_is_its_solid_angle():
    assert round_distribution([0, 180], [100, 100]).flux() == pytest.approx(400 * math.pi, rel=1e-14)
    assert round_distribution([0, 1e-3, 90], [100, 100, 100]).flux() == pytest.approx(200 * math.pi, rel=1e-12)
    cap = round_distribution([30, 60], [100, 100]).flux()
    assert cap == pytest.approx(200 * math.pi * (math.cos(math.pi / 6) - 0.5), rel=1e-14)


def test_flux_of_a_falling_line():
    # The integral of 2 pi (1 - 2 g / pi) sin g from 0 to pi / 2 is 2 pi (1 - 2 / pi).
    assert round_distribution([0, 90], [300, 0]).flux() == pytest.approx(600 * math.pi * (1 - 2 / math.pi), rel=1e-14)


def test_flux_of_a_cosine_comes_near_pi():
    gamma = np.arange(0.0, 90.5, 1.0)
    assert round_distribution(gamma, np.cos(np.radians(gamma))).flux() == pytest.approx(math.pi, rel=1e-4)


@st.composite
def distributions(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    whole, planes, rows = draw(st.booleans()), draw(st.integers(2, 6)), draw(st.integers(2, 6))
    first, last = (0.0, 360.0) if whole else (-90.0, 90.0)
    azimuth = np.concatenate(([first], np.sort(rng.uniform(first + 1, last - 1, planes - 2)), [last]))
    colatitude = np.sort(rng.choice(np.arange(0.0, 181.0, 5.0), rows, replace=False))
    candela = rng.uniform(0, 1000, (planes, rows))
    if whole:
        candela[-1] = candela[0]
    return Distribution(azimuth, colatitude, candela, POLE_DOWN)


@given(distributions())
@settings(max_examples=40, deadline=None)
def test_flux_is_the_integral_of_the_intensity(distribution):
    node, weight = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for a, b in zip(distribution.azimuth[:-1], distribution.azimuth[1:], strict=True):
        for c, d in zip(distribution.colatitude[:-1], distribution.colatitude[1:], strict=True):
            azimuth, colatitude = np.meshgrid((a + b) / 2 + (b - a) / 2 * node, (c + d) / 2 + (d - c) / 2 * node, indexing="ij")
            value = distribution.intensity(directions(azimuth, colatitude).reshape(-1, 3)).reshape(8, 8)
            area = np.radians(b - a) / 2 * np.radians(d - c) / 2
            total += area * np.einsum("i,j,ij,ij", weight, weight, value, np.sin(np.radians(colatitude)))
    assert distribution.flux() == pytest.approx(total, rel=1e-6)


@given(distributions())
@settings(max_examples=40, deadline=None)
def test_intensity_at_the_grid_is_that_of_the_grid(distribution):
    azimuth, colatitude = np.meshgrid(distribution.azimuth, distribution.colatitude, indexing="ij")
    off_poles = (colatitude > 0) & (colatitude < 180)
    found = distribution.intensity(3.5 * directions(azimuth, colatitude).reshape(-1, 3)).reshape(azimuth.shape)
    assert found[off_poles] == pytest.approx(distribution.candela[off_poles], abs=1e-6)


def test_dark_outside_of_the_grid():
    downward = round_distribution([0, 90], [100, 100])
    assert downward.intensity(np.array([[0, 0, -1.0], [1, 0, 0], [1, 0, 1e-3], [0, 0, 1]])).tolist() == [100, 100, 0, 0]
    half = Distribution(np.array([-90.0, 90.0]), np.array([0.0, 180.0]), np.full((2, 2), 7.0), POLE_DOWN)
    assert half.intensity(np.array([[1.0, 0, 0], [0, 1, 0], [0, -1, 0], [-1, 0, 0]])).tolist() == [7, 7, 7, 0]


def test_radiant_intensity_states_its_efficacy():
    distribution = round_distribution([0, 180], [358, 358])
    assert distribution.radiant_intensity(np.eye(3)) == pytest.approx(2.0)
    assert distribution.radiant_intensity(np.eye(3), 683.0) == pytest.approx(358 / 683)


def test_mirrored_and_closed():
    angle, candela = mirrored(np.array([0.0, 20.0, 90.0]), np.array([[1.0], [2.0], [3.0]]))
    assert angle.tolist() == [0, 20, 90, 160, 180]
    assert candela[:, 0].tolist() == [1, 2, 3, 2, 1]
    for given_ in ([0.0, 120.0, 240.0], [0.0, 120.0, 240.0, 360.0]):
        angle, candela = closed(np.array(given_), np.arange(1.0, len(given_) + 1)[:, None])
        assert angle.tolist() == [0, 120, 240, 360]
        assert candela[:, 0].tolist() == [1, 2, 3, 1]


def test_illuminance_on_a_grid_is_the_direct_formula():
    """Intensity that is a product of two linear functions of the angles has no error of interpolation."""
    azimuth, gamma = np.arange(0.0, 361.0, 30.0), np.arange(0.0, 91.0, 10.0)

    def intensity(c, g):
        return (1000 - 9 * g) * (1 + np.minimum(c, 360 - c) / 180)

    distribution = Distribution(azimuth, gamma, intensity(azimuth[:, None], gamma[None]), POLE_DOWN)
    x, y = np.meshgrid(np.linspace(-4.1, 4, 21), np.linspace(-3, 3.3, 17))
    points = np.stack((x.ravel(), y.ravel(), np.full(x.size, 0.85)), 1)
    position = np.array([0.3, -0.2, 3.0])
    dx, dy, drop = points[:, 0] - 0.3, points[:, 1] + 0.2, 3.0 - 0.85
    distance = np.sqrt(dx**2 + dy**2 + drop**2)
    c, g = np.degrees(np.arctan2(dy, dx)) % 360, np.degrees(np.arccos(drop / distance))
    expected = intensity(c, g) * (drop / distance) / distance**2
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    assert illuminance(distribution, position, np.eye(3), points, up) == pytest.approx(expected, rel=1e-9)
    assert not np.any(illuminance(distribution, position, np.eye(3), points, -up))

    turn, move = turned(np.random.default_rng(5)), np.array([10.0, -20.0, 5.0])
    moved = illuminance(distribution, turn @ position + move, turn, points @ turn.T + move, up @ turn.T)
    assert moved == pytest.approx(expected, rel=1e-9)


def test_light_of_a_luminaire_on_a_sphere_is_its_flux():
    distribution = round_distribution([0, 45, 120, 180], [500, 800, 50, 0])
    node, weight = np.polynomial.legendre.leggauss(400)
    outward = np.stack((np.sqrt(1 - node**2), np.zeros_like(node), node), 1)
    lux = illuminance(distribution, np.zeros(3), np.eye(3), 2.5 * outward, -outward)
    assert 2 * math.pi * 2.5**2 * weight @ lux == pytest.approx(distribution.flux(), rel=1e-4)


def test_a_point_at_the_luminaire_gets_no_light():
    lux = illuminance(round_distribution([0, 180], [5, 5]), np.ones(3), np.eye(3), np.ones((1, 3)), np.eye(3)[:1])
    assert lux.tolist() == [0]


def test_tilt_factor_is_linear_between_those_of_the_file():
    dark = round_distribution([0, 180], [0, 0])
    lamp = Luminaire("", dark, np.zeros(3), 0.0, np.array([0.0, 90.0]), np.array([1.0, 0.8]))
    assert [lamp.factor_when_tilted(a) for a in (0, 45, 90, 120)] == pytest.approx([1, 0.9, 0.8, 0.8])
    assert Luminaire("", dark, np.zeros(3), 0.0, np.zeros(0), np.zeros(0)).factor_when_tilted(45) == 1
