# SPDX-License-Identifier: GPL-3.0-or-later
"""Plane-parallel single scattering against integrals taken literally and published functions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import expn

from volumetrics_addon.physics import plane_parallel


@pytest.mark.parametrize("height", (3.0, math.inf))
@pytest.mark.parametrize("z", (-4.0, 0.5, 2.0, 7.0))
def test_vertical_depth_is_the_integral_of_the_extinction(z, height):
    sigma = 0.4
    expected, _ = quad(lambda h: sigma * math.exp(-(h - 0.5) / height), min(max(z, 0.5), 6.0), 6.0)
    assert plane_parallel.vertical_depth(z, sigma, height, 0.5, 6.0) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def literal(tau, depth, mu, mu0):
    return quad(lambda t: math.exp(-t - (tau - mu * t) / mu0), 0.0, depth, epsabs=0.0, epsrel=1e-11)[0]


@given(tau=st.floats(0.0, 6.0), share=st.floats(0.01, 1.0), mu=st.floats(-1.0, 1.0), mu0=st.floats(0.01, 1.0))
def test_single_scattering_is_the_integral_along_the_ray(tau, share, mu, mu0):
    depth = share * min(8.0, tau / mu if mu * 8.0 > tau else 8.0)
    value = plane_parallel.single_scattering(tau, depth, mu, mu0)
    assert value == pytest.approx(literal(tau, depth, mu, mu0), rel=1e-7, abs=1e-300)


def test_single_scattering_of_a_ray_towards_the_sun_is_its_limit():
    near = plane_parallel.single_scattering(2.0, 1.5, 0.4, 0.4 + np.array([-1e-9, 0.0, 1e-9]))
    assert near == pytest.approx([1.5 * math.exp(-2.0 / 0.4)] * 3, rel=1e-6)


def rays(count=300):
    """(tau, depth, mu) of rays in a fog of vertical depth 3."""
    rng = np.random.default_rng(5)
    mu = np.where(rng.random(count) < 0.5, rng.uniform(-1.0, 1.0, count), rng.uniform(-0.2, 0.2, count))
    tau = 3.0 * rng.random(count)
    longest = np.where(mu > 0.0, tau, 3.0 - tau) / np.maximum(np.abs(mu), 1e-9)
    return tau, np.minimum(longest, 10.0) * rng.random(count), mu


@pytest.mark.parametrize("g, spread", ((0.0, 0.012), (0.6, 0.02), (-0.5, 0.02), (0.8, 0.08)))
def test_sky_light_is_the_sum_over_the_sky(g, spread):
    tau, depth, mu = rays()
    x, w = np.polynomial.legendre.leggauss(200)
    root, weight = (x + 1.0) / 2.0, w / 2.0
    azimuth = (np.arange(128) + 0.5) / 128 * math.pi
    expected = np.zeros(len(mu))
    for r, v in zip(root, weight):  # mu0 = r^2: the exponential is steep at the horizon
        cosine = mu[:, None] * r**2 + np.sqrt((1.0 - mu[:, None] ** 2) * (1.0 - r**4)) * np.cos(azimuth)
        phase = (1.0 - g * g) / (4.0 * math.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
        gathered = (np.exp(-tau / r**2) - np.exp(-(tau - mu * depth) / r**2 - depth)) / (1.0 - mu / r**2)
        expected += 2.0 * math.pi * phase.mean(axis=1) * gathered * v * 2.0 * r
    error = plane_parallel.sky_light(tau, depth, mu, g) - expected
    assert np.sqrt((error**2).mean()) < spread * expected.mean()
    assert abs(error.mean()) < spread / 5.0 * expected.mean()  # what is missing rings about the truth, with the elevation


def test_sky_light_that_is_only_scattered_is_the_sky():
    """Without extinction before it, a thin layer shows albedo times its depth of what the upper half of the sky sends."""
    assert plane_parallel.sky_light(0.0, 1e-6, 0.0, 0.0) == pytest.approx(1e-6 / 2.0, rel=1e-5)


def test_sky_transmittance_is_twice_the_third_exponential_integral():
    tau = np.linspace(0.0, 5.0, 21)
    assert plane_parallel.sky_transmittance(tau) == pytest.approx(2.0 * expn(3, tau), abs=5e-4)


@pytest.mark.parametrize("arguments, name", (((-1.0, 1.0, 0.5, 0.5), "tau"), ((1.0, math.nan, 0.5, 0.5), "depth"),
                                             ((1.0, 1.0, 2.0, 0.5), "mu"), ((1.0, 1.0, 0.5, 0.0), "mu0")))
def test_refused(arguments, name):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        plane_parallel.single_scattering(*arguments)
