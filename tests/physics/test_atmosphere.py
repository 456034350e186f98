# SPDX-License-Identifier: GPL-3.0-or-later
"""Optical depths against 40-digit quadrature, tables against exact transmittance and against conservation laws."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volumetrics_addon.physics import atmosphere, phase
from volumetrics_addon.physics.atmosphere import (
    RAYLEIGH_RGB, Component, Planet, ScatteringTables, TransmittanceTable, UniformScattering, ground_distance, optical_depth,
    ray_nodes, rayleigh_coefficient, scattering_tables, top_distance, transmittance, transmittance_table,
)

EARTH, TOP = 6.36e6, 6.46e6
AIR = Component((5.802e-6, 13.558e-6, 33.1e-6), (0.0, 0.0, 0.0), 8000.0, phase.rayleigh)
HAZE = Component((3.996e-6,) * 3, (0.44e-6,) * 3, 1200.0, lambda c: phase.henyey_greenstein(c, 0.76))
PLANET = Planet(EARTH, TOP, (AIR, HAZE), (0.2, 0.3, 0.1))


# --- coefficients -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wavelength, value", [(680e-9, 5.19673e-6), (550e-9, 1.21427e-5), (440e-9, 2.96453e-5)])
def test_rayleigh_coefficient(wavelength, value):
    assert float(f"{rayleigh_coefficient(wavelength):.5e}") == value
    anisotropic = rayleigh_coefficient(wavelength, king_factor=1.05)
    assert anisotropic == pytest.approx(1.05 * rayleigh_coefficient(wavelength), rel=1e-15)


def test_rayleigh_rgb_is_of_luminance_one():
    """And its channels are lambda^-4 at one wavelength each, within the bands of the three primaries."""
    assert np.dot(RAYLEIGH_RGB, (0.2126, 0.7152, 0.0722)) == pytest.approx(1.0, abs=5e-4)
    red, green, blue = 657e-9, 548e-9, 445e-9
    ratio = rayleigh_coefficient(np.array([red, green, blue])) / rayleigh_coefficient(green)
    np.testing.assert_allclose(ratio, np.array(RAYLEIGH_RGB) / RAYLEIGH_RGB[1], rtol=5e-3)


@pytest.mark.parametrize("arguments, name", [
    ((0.0,), "wavelength"), ((math.nan,), "wavelength"), ((5e-7, 0.9), "refractive_index"), ((5e-7, 1.0003, -1.0),
                                                                                            "number_density"),
    ((5e-7, 1.0003, 2.5e25, 0.5), "king_factor"), ((1e-200,), "coefficient"),
])
def test_rayleigh_errors(arguments, name):
    with pytest.raises(ValueError, match=f"{name} must be .*, got "):
        rayleigh_coefficient(*arguments)


# --- optical depth ------------------------------------------------------------------------------------------


def literal_depth(radius, mu, distance, scale_height, planet_radius):
    """Integral of the density over the ray's own coordinate, cut where it has dropped by powers, in 30 digits."""
    r, mu, h, ground = (mp.mpf(float(x)) for x in (radius, mu, scale_height, planet_radius))
    passing2 = r * r * (1 - mu * mu)
    passing = mp.sqrt(passing2)
    start = r * mu
    end = mp.inf if distance == math.inf else start + mp.mpf(float(distance))

    def rising(a, b):
        here = mp.sqrt(a * a + passing2)
        # Relative to the density here: the tolerance of quad is absolute.
        density = lambda s: mp.exp(-(mp.sqrt(s * s + passing2) - here) / h)  # noqa: E731
        edges = [a]
        gains = [mp.mpf(q) for q in (0.1, 0.5, 1, 2, 4, 8, 16, 32, 64)]
        gains += [passing / h * k for k in (0.3, 1, 3, 10, 100, 1000)]
        for gain in sorted(gains):
            s = mp.sqrt((here + gain * h) ** 2 - passing2)
            if gain > 64 or s >= b:
                break
            if s > edges[-1]:
                edges.append(s)
        last = mp.sqrt((here + 64 * h) ** 2 - passing2)
        if b <= last:
            edges.append(b)
        return mp.exp(-(here - ground) / h) * mp.fsum(mp.quad(density, pair) for pair in zip(edges, edges[1:]))

    with mp.workdps(30):
        if start >= 0:
            return rising(start, end)
        if end <= 0:
            return rising(-end, -start)
        return rising(mp.mpf(0), -start) + rising(mp.mpf(0), end)


def relative_error(radius, mu, distance, scale_height, planet_radius):
    with mp.workdps(30):
        exact = literal_depth(radius, mu, distance, scale_height, planet_radius)
        return float(abs(optical_depth(radius, mu, distance, 1.0, scale_height, planet_radius) - exact) / exact)


EARTHLIKE = [
    (EARTH, 1.0, math.inf, 8000.0), (EARTH, 0.0, math.inf, 8000.0), (EARTH, 1e-9, math.inf, 1200.0),
    (EARTH + 1e4, 0.3, 5e4, 8000.0), (EARTH + 1e4, -0.0559, math.inf, 8000.0), (EARTH + 1e4, -0.0561, 3.5e5, 8000.0),
    (TOP, -0.1741, math.inf, 1200.0), (TOP, -1.0, 1e5, 8000.0), (EARTH + 2.0, -1e-7, 1e4, 8000.0),
    (EARTH + 2.0, 0.5, 1e-3, 1200.0), (1e8, -0.998, math.inf, 8000.0),
]


@pytest.mark.parametrize("radius, mu, distance, scale_height", EARTHLIKE)
def test_depth_on_earth(radius, mu, distance, scale_height):
    # Measured at most 9e-15; 2e-13 for the last, from 12500 scale heights away.
    assert relative_error(radius, mu, distance, scale_height, EARTH) < 1e-12 + 1e-15 * radius / scale_height


def random_ray(rng):
    planet_radius = 10 ** rng.uniform(0, 8)
    scale_height = planet_radius / 10 ** rng.uniform(1, 6)
    radius = planet_radius + scale_height * rng.choice([0.0, 1e-6, 10 ** rng.uniform(-3, 2)])
    horizon = -math.sqrt(max(0.0, 1 - (planet_radius / radius) ** 2))
    mu = rng.choice([1.0, -1.0, 0.0, rng.uniform(-1, 1), -(10 ** rng.uniform(-9, 0)), horizon * (1 + 1e-3 * rng.normal())])
    distance = rng.choice([math.inf, scale_height * 10 ** rng.uniform(-6, 3), radius * 10 ** rng.uniform(-3, 1)])
    mu = float(np.clip(mu, -1, 1))
    foot = -radius * mu
    lowest = radius if mu >= 0 else math.hypot(radius * math.sqrt(1 - mu * mu), max(0.0, foot - distance))
    return (radius, mu, distance, scale_height, planet_radius), (planet_radius - lowest) / scale_height


def worst_of_random_rays(seed, count):
    rng = np.random.default_rng(seed)
    worst, checked = 0.0, 0
    while checked < count:
        ray, buried = random_ray(rng)
        if buried < 600:  # deeper in the ground the density leaves float64
            worst = max(worst, relative_error(*ray) / (1e-12 + 1e-15 * ray[0] / ray[3]))
            checked += 1
    return worst


def test_depth_on_any_planet():
    assert worst_of_random_rays(0, 25) < 1  # measured 0.14 in 143 rays


@pytest.mark.sweep
def test_depth_on_any_planet_thoroughly():
    assert worst_of_random_rays(1, 600) < 1


def test_depth_through_the_centre():
    """2 H (1 - exp(-r / H)) exp(R / H) from the outside to the outside; near the centre the ray turns sharply."""
    height = 2.0
    value = optical_depth(30.0, -1.0, 60.0, 3.0, height, 10.0)
    assert value == pytest.approx(3.0 * 2 * height * -math.expm1(-15.0) * math.exp(5.0), rel=1e-13)
    for passing in (0.1, 1e-3, 1e-6, 1e-9):
        mu = -math.sqrt((1 - passing) * (1 + passing))
        assert relative_error(1.0, mu, 2.0, 0.05, 1.0) < 1e-12  # measured 2e-14


def test_vertical_depth_in_closed_form():
    """H (1 - exp(-d / H)) upwards, to the last digits."""
    distance = np.geomspace(1e-6, 1e7, 40)
    value = optical_depth(EARTH, 1.0, distance, 1e-5, 8000.0, EARTH)
    np.testing.assert_allclose(value, 1e-5 * 8000.0 * -np.expm1(-distance / 8000.0), rtol=1e-13)


def test_depth_is_additive():
    rng = np.random.default_rng(2)
    radius, mu = EARTH + rng.uniform(0, 5e4, 500), rng.uniform(-0.1, 1, 500)
    first, second = rng.uniform(0, 3e5, (2, 500))
    there = np.sqrt(radius**2 + first * (2 * radius * mu + first))
    mu_there = (radius * mu + first) / there
    whole = optical_depth(radius, mu, first + second, 1e-5, 8000.0, EARTH)
    parts = (optical_depth(radius, mu, first, 1e-5, 8000.0, EARTH)
             + optical_depth(there, mu_there, second, 1e-5, 8000.0, EARTH))
    np.testing.assert_allclose(parts, whole, rtol=1e-12)  # measured 7e-14: rounding of there and mu_there


@settings(max_examples=150, deadline=None)
@given(st.floats(1e-3, 1e12), st.floats(-1, 1), st.one_of(st.just(math.inf), st.floats(0, 1e300)),
       st.one_of(st.just(0.0), st.floats(1e-30, 1e30)), st.floats(1, 1e6))
def test_depth_stays_in_range(radius, mu, distance, sigma_0, ratio):
    arguments = radius, mu, distance, sigma_0, radius / ratio, radius
    depth = optical_depth(*arguments)
    assert depth >= 0
    assert 0 <= transmittance(*arguments) <= 1
    if sigma_0 == 0 or distance == 0:
        assert depth == 0
    if mu >= 0:
        assert depth <= sigma_0 * min(distance, radius) * (1 + 1e-9) * 10


def test_depth_shapes_and_extremes():
    radius, mu = np.full((3, 1), EARTH, np.float32), np.linspace(0, 1, 4, dtype=np.float32)
    value = optical_depth(radius, mu, math.inf, 1e-5, 8e3, EARTH)
    assert value.shape == (3, 4) and value.dtype == np.float64
    assert optical_depth(np.zeros((0, 3)) + EARTH, 0.5, 1.0, 1.0, 8e3, EARTH).shape == (0, 3)
    assert optical_depth(EARTH, -1.0, math.inf, 1.0, 8.0, EARTH) == math.inf  # exp(795000) times the ground's
    assert optical_depth(EARTH, -1.0, math.inf, 0.0, 8.0, EARTH) == 0.0
    assert optical_depth(0.0, 0.3, 5e-324, 1.0, 8000.0, EARTH) >= 0.0
    assert optical_depth(1e9, 0.2, math.inf, 1e-5, 8000.0, EARTH) == 0.0


@pytest.mark.parametrize("position, bad, name", [
    (0, -1.0, "radius"), (0, math.nan, "radius"), (1, 1.1, "mu"), (2, -1.0, "distance"), (2, math.nan, "distance"),
    (3, -1e-5, "sigma_0"), (4, 0.0, "scale_height"), (4, 1e-10, "radius / scale_height"), (5, 0.0, "planet_radius"),
])
def test_depth_errors(position, bad, name):
    arguments = [EARTH, 0.5, 1e3, 1e-5, 8e3, EARTH]
    arguments[position] = bad
    with pytest.raises(ValueError, match=f"{name} must be .*, got "):
        optical_depth(*arguments)


def test_distances():
    """Against the roots of the quadratic in 40 digits."""
    rng = np.random.default_rng(4)
    radius, mu = EARTH + 10 ** rng.uniform(-3, 5, 200), -np.abs(10 ** rng.uniform(-8, 0, 200))
    ground, top = ground_distance(radius, mu, EARTH), top_distance(radius, mu, TOP)
    hits = 0
    with mp.workdps(40):
        for r, m, g, t in zip(radius, mu, ground, top):
            r, m = mp.mpf(float(r)), mp.mpf(float(m))
            below = (r * m) ** 2 - (r * r - mp.mpf(EARTH) ** 2)
            assert (g == math.inf) == (below < 0)
            if below >= 0:
                hits += 1
                assert abs(g - (-r * m - mp.sqrt(below))) < 1e-7 * g
            assert abs(t - (-r * m + mp.sqrt((r * m) ** 2 + mp.mpf(TOP) ** 2 - r * r))) < 1e-12 * t
    assert 20 < hits < 180
    assert ground_distance(EARTH, -0.1, EARTH) == 0 and ground_distance(EARTH, 0.1, EARTH) == math.inf
    assert ground_distance(EARTH * (1 - 1e-12), -1.0, EARTH) == 0 and top_distance(TOP * (1 + 1e-12), 1.0, TOP) == 0
    with pytest.raises(ValueError, match="radius - limit must be"):
        ground_distance(0.9 * EARTH, 0.0, EARTH)
    with pytest.raises(ValueError, match="radius - limit must be"):
        top_distance(1.1 * TOP, 0.0, TOP)


def test_ray_nodes_integrate_densities():
    """Sixteen nodes against the exact path, for rising, falling and grazing rays."""
    radius = np.array([EARTH, EARTH, EARTH + 2e4, EARTH + 2e4, TOP, EARTH + 500.0])
    mu = np.array([1.0, 0.01, -0.078, -0.5, -0.17, 0.3])
    end = np.minimum(ground_distance(radius, mu, EARTH), top_distance(radius, mu, TOP))
    t, weight = ray_nodes(PLANET, radius, mu, np.zeros(6), end, 16)
    there = np.sqrt(radius[:, None] ** 2 + t * (2 * (radius * mu)[:, None] + t))
    paths = np.einsum("nk,nkc->nc", weight, PLANET.density(there))
    np.testing.assert_allclose(paths, PLANET.paths(radius, mu, end), rtol=3e-4)  # measured 1.3e-4


# --- tables -------------------------------------------------------------------------------------------------


def test_transmittance_table():
    table = transmittance_table(PLANET)
    assert table.interpolation_error() == pytest.approx(0.0036, rel=0.2)  # largest near the horizon
    assert TransmittanceTable(PLANET, 64, 256).interpolation_error() < 0.0012
    rng = np.random.default_rng(5)
    radius = rng.uniform(EARTH, TOP, 2000)
    mu = rng.uniform(-1, 1, 2000)
    exact = PLANET.sunlight(radius, mu)
    assert np.abs(table(radius, mu) - exact).max() < table.interpolation_error()  # measured half of it
    blocked = np.isfinite(ground_distance(radius, mu, EARTH))
    assert 200 < blocked.sum() < 1800
    assert (table(radius[blocked], mu[blocked]) == 0).all() and (table(radius[~blocked], mu[~blocked]) > 0).all()
    with pytest.raises(ValueError, match="must be >= 2, got 1 and 4"):
        TransmittanceTable(PLANET, 1, 4)


def test_second_order_against_a_literal_integral():
    """Light scattered once and arriving from all around a point: an integral over directions of one along each of them."""
    radius, mu_s, channel = EARTH + 3000.0, 0.6, 2
    sun = np.array([math.sqrt(1 - mu_s**2), 0.0, mu_s])
    view = np.array([math.sin(0.5), 0.0, math.cos(0.5)])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    side = nodes / 2 + 0.5

    def scatter(altitude, cosine):
        return sum(c.sigma_s[channel] * np.exp(-altitude / c.scale_height) * c.phase(cosine) for c in (AIR, HAZE))

    def once(direction):
        mu, nu = direction[:, 2, None], np.clip(direction @ sun, -1, 1)[:, None]
        ground = ground_distance(radius, mu, EARTH)
        end = np.minimum(ground, top_distance(radius, mu, TOP))
        foot = np.clip(-radius * mu, 0.0, end)
        total = np.zeros(len(direction))
        for start, length in ((foot, -foot), (foot, end - foot)):
            t = start + length * side**2  # squared towards the lowest point
            r = np.sqrt(radius**2 + 2 * radius * mu * t + t * t)
            light = PLANET.sunlight(r, np.clip((radius * mu_s + t * nu) / r, -1, 1)) * PLANET.transmittance(radius, mu, t)
            total += (np.abs(length) * light[..., channel] * scatter(r - EARTH, nu)) @ (weights * side)
        hits = np.flatnonzero(np.isfinite(ground[:, 0]))
        there = ((radius * mu_s + ground * nu) / EARTH)[hits, 0]
        lit = np.maximum(there, 0.0) * PLANET.sunlight(EARTH, there)[:, channel] * PLANET.albedo[channel] / math.pi
        total[hits] += lit * PLANET.transmittance(radius, mu[hits, 0], ground[hits, 0])[:, channel]
        return total

    expected = 0.0
    x, w = np.polynomial.legendre.leggauss(10)
    azimuth, mu = (a.ravel() for a in np.meshgrid(math.pi * (x + 1) / 2, x))
    horizon = float(PLANET.horizon(radius))
    for low, high in ((-1.0, horizon), (horizon, horizon + 0.1), (horizon + 0.1, 1.0)):
        cosine = low + (high - low) * (mu + 1) / 2
        across = np.sqrt(1 - cosine**2)
        direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), cosine], axis=1)
        values = 2 * scatter(3000.0, np.clip(direction @ view, -1, 1)) * once(direction)
        expected += np.outer(w, w).ravel() @ values * math.pi / 2 * (high - low) / 2
    tables = scattering_tables(PLANET, 2, 12)
    value = tables.source(np.array(radius), np.array(view[2]), np.array(mu_s), np.array(float(view @ sun)))[channel]
    assert value == pytest.approx(expected, rel=0.005)  # measured 0.23 %


def test_the_ground_absorbs_no_more_than_arrives():
    """Over a planet whose air does not absorb: measured 0.482 of the disc's light, against 0.5 without the air."""
    air = Component((1e-5,) * 3, (0.0,) * 3, 8000.0, phase.isotropic)
    grey = Planet(EARTH, TOP, (air,), (0.5,) * 3)
    tables = ScatteringTables(grey, 8, 8)
    x, w = np.polynomial.legendre.leggauss(24)
    mu_s = x / 2 + 0.5
    absorbed = 0.5 * tables.irradiance(mu_s)[:, 0]
    total = 2 * np.pi * EARTH**2 * (w / 2) @ absorbed
    assert 0.47 < total / (np.pi * EARTH**2) < 0.5
    few = ScatteringTables(grey, 2, 8).irradiance(mu_s)
    assert (few <= tables.irradiance(mu_s)).all()


def test_one_order_needs_no_table():
    tables = ScatteringTables(PLANET, 1, 8)
    assert tables.change == 0.0 and (tables.source(np.array(EARTH), np.array(0.5), np.array(0.3), np.array(0.1)) == 0).all()
    exact = 0.4 * PLANET.sunlight(EARTH, 0.4)
    np.testing.assert_allclose(tables.irradiance(0.4), exact, rtol=1e-3)


def test_uniform_scattering_is_near_the_tables():
    """In air that scatters isotropically the closure's only guess is that the field is the same around each point."""
    air = Component((1e-5, 2e-5, 3e-5), (0.0,) * 3, 8000.0, phase.isotropic)
    planet = Planet(EARTH, TOP, (air,), (0.2,) * 3)
    transmitted = TransmittanceTable(planet)
    radius, mu_s = np.array(EARTH + 1000.0), np.array(0.7)
    for orders, tolerance in ((2, 0.005), (6, 0.12)):  # measured 0.2 %; 4, 6 and 9 %, thicker air more
        uniform, tables = UniformScattering(planet, orders, transmitted), ScatteringTables(planet, orders, 8)
        source = uniform(radius, mu_s) * planet.scattering[0] * planet.density(radius)
        exact = tables.source(radius, np.array(0.2), mu_s, np.array(0.3))
        np.testing.assert_allclose(source, exact, rtol=tolerance)
        sky = tables.irradiance(mu_s) - 0.7 * planet.sunlight(EARTH, 0.7)
        np.testing.assert_allclose(uniform.irradiance(mu_s), sky, rtol=tolerance)


def test_planet_errors():
    with pytest.raises(ValueError, match="top - radius must be"):
        Planet(EARTH, EARTH, (AIR,))
    with pytest.raises(ValueError, match="albedo must be"):
        Planet(EARTH, TOP, (AIR,), (0.5, 0.5, 1.5))
    with pytest.raises(ValueError, match="at least one Component"):
        Planet(EARTH, TOP, ())
    with pytest.raises(ValueError, match="orders must be >= 1 and size >= 4, got 0 and 12"):
        ScatteringTables(PLANET, 0)


def test_interpolation_reproduces_multilinear_functions():
    x, y, z = np.meshgrid(np.arange(4.0), np.arange(3.0), np.arange(5.0), indexing="ij")
    table = np.stack([1 + x * y * z, 2 * x - y + 3 * z], axis=-1)
    rng = np.random.default_rng(6)
    a, b, c = rng.uniform(0, 3, 50), rng.uniform(0, 2, 50), rng.uniform(0, 4, 50)
    expected = np.stack([1 + a * b * c, 2 * a - b + 3 * c], axis=-1)
    np.testing.assert_allclose(atmosphere.interpolated(table, (a, b, c)), expected, rtol=1e-13)
