# SPDX-License-Identifier: GPL-3.0-or-later
"""Slabs against published tables, another program, literal doubling, Monte Carlo and the closed forms of the limits."""

import math

import iadpython
import mpmath
import numpy as np
import pytest
from scipy.integrate import quad

from volumetrics_addon.physics import phase as phases
from volumetrics_addon.physics.slab import adding_doubling, h_function, slab_radiance

PHASES = {
    "rayleigh": phases.rayleigh,
    "draine": lambda c: phases.draine(c, 0.6, 2.0),
    "cloud": lambda c: phases.mie_fit(c, 10.0),
    "haze": lambda c: phases.mie_fit(c, 0.8),
    "ocean": lambda c: phases.fournier_forand(c, 0.0183, 1.1),
    "two lobes": lambda c: phases.dual_henyey_greenstein(c, 0.8, -0.3, 0.3),
}
FLUXES = slice(0, 4)


def hg(cosine, g):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


# --- published values and another program ----------------------------------------------------------------------


def test_van_de_hulst():
    """Multiple Light Scattering, table 35: five decimals."""
    slab = adding_doubling(0.75, 0.9, 2.0)
    assert abs(slab.reflectance - 0.09739) < 0.5e-5 + 1e-8
    assert abs(slab.transmittance - 0.66096) < 0.5e-5 + 1e-8


def test_giovanelli():
    """Half space, isotropic, albedo 0.9, ior 1.5: four decimals in Giovanelli 1955, taken over by Prahl et al. 1993."""
    assert abs(adding_doubling(0.0, 0.9, np.inf, 1.5).reflectance - 0.2600) < 1e-4


# iadpython loses its way beyond 32 points for matched boundaries. At 24 it is still up to 1.1e-5 (g = 0.9) and 1e-6 off.
@pytest.mark.parametrize("albedo, tau, g, tolerance", [
    (0.9, 2.0, 0.75, 3e-6), (0.5, 1.0, 0.9, 2e-5), (0.99, 10.0, 0.0, 3e-6), (1.0, 4.0, 0.5, 3e-6), (0.3, 0.1, -0.5, 3e-6),
])
def test_iadpython_matched(albedo, tau, g, tolerance):
    theirs = iadpython.Sample(a=albedo, b=tau, g=g, n=1.0, quad_pts=24).rt()
    np.testing.assert_allclose(adding_doubling(g, albedo, tau)[FLUXES], theirs, rtol=0, atol=tolerance)


@pytest.mark.parametrize("albedo, tau, g, ior", [(0.9, 2.0, 0.75, 1.5), (0.9, 1.0, 0.0, 1.4), (0.6, 5.0, 0.4, 1.33)])
def test_iadpython_with_boundaries(albedo, tau, g, ior):
    """Their error falls with the third power of the points: from 24 to 48 to an eighth."""
    coarse, fine = (np.array(iadpython.Sample(a=albedo, b=tau, g=g, n=ior, quad_pts=n).rt()) for n in (24, 48))
    ours = np.array(adding_doubling(g, albedo, tau, ior)[FLUXES])
    assert (np.abs(ours - fine) < 0.25 * np.abs(coarse - fine) + 1e-6).all()


# --- literal doubling and adding -------------------------------------------------------------------------------


def literal_slab(g, albedo, tau, points=24):
    """R and T matrices by the textbook: diamond start, doubling; phase function averaged over the azimuth by summation."""
    x, w = np.polynomial.legendre.leggauss(points)
    mu, w = (x + 1) / 2, w / 2
    azimuth = (np.arange(256) + 0.5) * 2 * np.pi / 256
    sine = np.sqrt(1 - mu * mu)
    across = sine[:, None, None] * sine[None, :, None] * np.cos(azimuth)
    along = (mu[:, None] * mu[None, :])[:, :, None]
    forward, backward = (4 * np.pi * hg(across + sign * along, g).mean(axis=2) for sign in (1, -1))
    halvings = 24
    step = tau / 2**halvings
    scale = step / (2 * mu)[:, None]
    a = scale * (np.eye(points) - albedo / 2 * forward * w)
    b = scale * (albedo / 2 * backward * w)
    # (1 + a) I_out - b J_out = (1 - a) I_in + b J_in on both sides of the thin layer.
    left = np.block([[np.eye(points) + a, -b], [-b, np.eye(points) + a]])
    right = np.block([[np.eye(points) - a, b], [b, np.eye(points) - a]])
    response = np.linalg.solve(left, right)
    layer = response[points:, :points], response[:points, :points]
    for _ in range(halvings):
        layer = literal_add(layer, layer)
    return layer, mu, w


def literal_add(top, bottom):
    """Reflection and transmission of two symmetric layers, lit from above."""
    (r1, t1), (r2, t2) = top, bottom
    between = np.linalg.inv(np.eye(len(r1)) - r1 @ r2)
    return r1 + t1 @ r2 @ between @ t1, t2 @ between @ t1


def diffuse(layer, mu, w):
    return [2 * (w * mu) @ (matrix @ np.ones(len(mu))) for matrix in layer]


@pytest.mark.parametrize("g, albedo", [(0.0, 0.9), (0.5, 1.0), (0.6, 0.5), (-0.5, 0.95)])
def test_added_parts_equal_the_whole(g, albedo):
    """Slabs of 0.5 and 1.0 from the literal formulas, added, against 1.5 at once: measured 1.1e-7 (24 azimuthal means)."""
    thin, mu, w = literal_slab(g, albedo, 0.5)
    thick = literal_add(thin, thin)
    expected = diffuse(literal_add(thick, thin), mu, w)
    whole = adding_doubling(g, albedo, 1.5)
    np.testing.assert_allclose([whole.diffuse_reflectance, whole.diffuse_transmittance], expected, rtol=0, atol=5e-7)


# --- limits ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ior", [1.0, 1.33])
@pytest.mark.parametrize("g", [0.99, 0.75, 0.0, -0.99, *PHASES])
def test_energy_is_conserved(g, ior):
    """Albedo 1: measured 2e-14."""
    slab = adding_doubling(PHASES.get(g, g), 1.0, [1e-9, 0.1, 30.0, 1e9], ior, quadrature=12)
    np.testing.assert_allclose(slab.reflectance + slab.transmittance, 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(slab.diffuse_reflectance + slab.diffuse_transmittance, 1.0, rtol=0, atol=1e-12)


def fresnel_outside(cosine, ior):
    inside = math.sqrt(1 - (1 - cosine**2) / ior**2)
    across, along = (cosine - ior * inside) / (cosine + ior * inside), (ior * cosine - inside) / (ior * cosine + inside)
    return (across**2 + along**2) / 2, inside


@pytest.mark.parametrize("ior", [1.0, 1.33, 1.5, 3.0])
@pytest.mark.parametrize("tau", [0.0, 0.3, 5.0])
def test_pure_absorption(ior, tau):
    """Plate with all its internal reflections, averaged over Lambertian light by adaptive quadrature. Measured 3e-9."""
    def plate(cosine):
        r, inside = fresnel_outside(cosine, ior)
        t = math.exp(-tau / inside) if inside > 0 else float(tau == 0)
        denominator = 1 - r * r * t * t
        if denominator == 0:
            return 1.0, 0.0
        transmitted = (1 - r) ** 2 * t / denominator
        return r + r * t * transmitted, transmitted

    expected = [*plate(1.0), *(quad(lambda c: 2 * c * plate(c)[k], 0, 1, epsabs=1e-12, limit=200)[0] for k in (0, 1))]
    np.testing.assert_allclose(adding_doubling(0.3, 0.0, tau, ior)[FLUXES], expected, rtol=0, atol=1e-7)


def test_absorption_keeps_its_digits():
    """T = exp(-tau) far below the rounding of 1."""
    tau = np.array([1e-3, 1.0, 40.0, 400.0])
    np.testing.assert_allclose(adding_doubling(0.0, 0.0, tau).transmittance, np.exp(-tau), rtol=1e-11)


@pytest.mark.parametrize("albedo", [0.0, 1e-12, 0.5, 0.999999, 1 - 1e-12, 1.0])
@pytest.mark.parametrize("ior", [1.0, 1.5])
def test_any_thickness(albedo, ior):
    tau = np.array([0.0, 5e-324, 1e-30, 1e-8, 1.0, 1e4, 1e12, 1e30, 1.7e308, np.inf])
    slab = np.array(adding_doubling(0.6, albedo, tau, ior, quadrature=8))
    assert np.isfinite(slab).all()
    assert ((0 <= slab[FLUXES]) & (slab[FLUXES] <= 1)).all()
    assert (slab[0] + slab[1] <= 1 + 1e-12).all() and (slab[2] + slab[3] <= 1 + 1e-12).all()
    assert (np.diff(slab[1]) <= 1e-12).all() and (np.diff(slab[0]) >= -1e-12).all() or ior > 1
    assert slab[1, -1] < 1e-12


def test_half_space_of_isotropic_scatterers():
    """Plane albedo 1 - sqrt(1 - albedo) H(mu); spherical albedo 1 - 2 sqrt(1 - albedo) alpha_1. Measured 5e-10."""
    for albedo in (0.1, 0.9, 0.999):
        slab = adding_doubling(0.0, albedo, np.inf)
        root = math.sqrt(1 - albedo)
        moment = quad(lambda t: t * h_function(albedo, t), 0, 1, epsabs=1e-11)[0]
        assert abs(slab.reflectance - (1 - root * h_function(albedo, 1.0))) < 5e-9
        assert abs(slab.diffuse_reflectance - (1 - 2 * root * moment)) < 5e-9


def test_stated_errors_hold():
    """Of 200 random slabs the worst true error was 0.47 of the estimate."""
    rng = np.random.default_rng(11)
    worst = []
    for _ in range(30):
        g, albedo, tau = rng.uniform(-0.9, 0.95), rng.choice([1.0, 0.99, rng.random()]), 10 ** rng.uniform(-2, 2)
        ior, points = rng.choice([1.0, 1.33, 1.5]), int(rng.choice([4, 6, 8, 12, 16, 24]))
        truth = np.array(adding_doubling(g, albedo, tau, ior, quadrature=48)[FLUXES])
        slab = adding_doubling(g, albedo, tau, ior, quadrature=points)
        worst.append(np.abs(np.array(slab[FLUXES]) - truth).max() / slab.error_estimate)
    assert max(worst) < 1


@pytest.mark.parametrize("g", [0.99, -0.99, 0.9, *PHASES])
def test_default_accuracy(g):
    """Sharp lobes: measured 4.5e-6 at 24 points for g = 0.99, below 1e-6 up to g = 0.9."""
    arguments = PHASES.get(g, g), 0.99, 5.0
    slab, truth = adding_doubling(*arguments), adding_doubling(*arguments, quadrature=96)
    error = np.abs(np.array(slab[FLUXES]) - truth[FLUXES]).max()
    assert error < slab.error_estimate < 1e-4
    assert error < (1e-5 if g in (0.99, -0.99, "cloud", "ocean") else 1e-6)


# --- radiance --------------------------------------------------------------------------------------------------


def scattering_angle(mu0, mu, azimuth):
    return np.sqrt((1 - mu0**2) * (1 - mu**2)) * np.cos(azimuth) - mu0 * mu


@pytest.mark.parametrize("name", PHASES)
def test_thin_slab_scatters_once(name):
    """L = albedo p tau / |mu| for tau -> 0; the rest is of the order tau / |mu|."""
    mu0, mu, azimuth = 0.6, np.array([1.0, 0.5, -0.3, -0.9]), np.array([0.0, 1.0, 2.0, 0.3])
    expected = 0.8 * PHASES[name](scattering_angle(mu0, mu, azimuth)) * 1e-7 / np.abs(mu)
    np.testing.assert_allclose(slab_radiance(PHASES[name], 0.8, 1e-7, mu0, mu, azimuth).value, expected, rtol=2e-5)


@pytest.mark.parametrize("albedo", [0.3, 0.95, 1.0])
def test_half_space_against_h(albedo):
    """Measured 6e-9 (mu0 0.03: 1.2e-8)."""
    mu = np.array([1.0, 0.7, 0.4, 0.1])
    for mu0 in (1.0, 0.6, 0.03):
        expected = albedo / (4 * np.pi) * mu0 / (mu + mu0) * h_function(albedo, mu) * h_function(albedo, mu0)
        radiance = slab_radiance(0.0, albedo, np.inf, mu0, mu, 1.3)
        np.testing.assert_allclose(radiance.value, expected, rtol=1e-7)
        assert (np.abs(radiance.value - expected) <= radiance.error_estimate).all()
        assert slab_radiance(0.0, albedo, np.inf, mu0, -0.5, 0.0, quadrature=8).value < 1e-15


@pytest.mark.parametrize("g, side", [(0.0, 1), (0.6, -1), (-0.4, 1), (0.85, 1)])
def test_reciprocity(g, side):
    """Light and eye exchanged: L(mu, mu0) / mu0 is symmetric. Measured 1.2e-7 for g = 0.85, else 2e-9."""
    mu0, mu = np.array([0.9, 0.8, 0.3]), np.array([0.2, 0.5, 0.7])
    there = slab_radiance(g, 0.97, 1.7, mu0, side * mu, 0.8).value / mu0
    back = slab_radiance(g, 0.97, 1.7, mu, side * mu0, 0.8).value / mu
    np.testing.assert_allclose(there, back, rtol=5e-7 if g == 0.85 else 1e-8)


@pytest.mark.parametrize("g, mu0", [(0.8, 1.0), (0.6, 0.4), (-0.5, 0.7)])
def test_radiance_carries_the_energy(g, mu0):
    """Albedo 1: what leaves is what came in. Measured 1.1e-8; normal incidence agrees with the fluxes."""
    x, w = np.polynomial.legendre.leggauss(40)
    mu, w = (x + 1) / 2, w / 2
    azimuth = (np.arange(64) + 0.5) * 2 * np.pi / 64
    leaving = [2 * np.pi * (w * mu) @ slab_radiance(g, 1.0, 2.0, mu0, sign * mu[:, None], azimuth).value.mean(axis=1)
               for sign in (1, -1)]
    direct = math.exp(-2.0 / mu0)
    assert abs(leaving[0] / mu0 + leaving[1] / mu0 + direct - 1) < 1e-7
    if mu0 == 1.0:
        slab = adding_doubling(g, 1.0, 2.0)
        np.testing.assert_allclose([leaving[0], leaving[1] + direct], slab[:2], rtol=0, atol=1e-7)


def monte_carlo(g, albedo, tau, mu0, directions, photons, rng):
    """Mean and standard error of the radiance, by the local estimate at each collision; nothing but the definitions."""
    position = np.zeros(photons)
    travel = np.tile([math.sqrt(1 - mu0**2), 0.0, mu0], (photons, 1))  # z counts downwards
    weight = np.ones(photons)
    batch = np.arange(photons) % 20
    total = np.zeros((20, len(directions)))
    for _ in range(60):
        position = position + travel[:, 2] * rng.exponential(size=len(position))
        inside = (position > 0) & (position < tau)
        position, travel, weight, batch = position[inside], travel[inside], weight[inside] * albedo, batch[inside]
        for k, (mu, azimuth) in enumerate(directions):
            sine = math.sqrt(1 - mu * mu)
            out = np.array([sine * math.cos(azimuth), sine * math.sin(azimuth), -mu])
            way = position / mu if mu > 0 else (tau - position) / -mu
            total[:, k] += np.bincount(batch, weight * hg(travel @ out, g) * np.exp(-way) / abs(mu), 20)
        cosine = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * rng.random(len(position)))) ** 2) / (2 * g)
        helper = np.where(np.abs(travel[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
        first = np.cross(travel, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(travel, first)
        angle = 2 * np.pi * rng.random(len(position))
        sine = np.sqrt(1 - cosine**2)[:, None]
        travel = cosine[:, None] * travel + sine * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)
    samples = total * mu0 / (photons / 20)
    return samples.mean(axis=0), samples.std(axis=0, ddof=1) / math.sqrt(20)


def test_radiance_against_monte_carlo():
    """Three slabs, six directions each: 18 deviations in standard errors (Student, 19 degrees of freedom)."""
    directions = np.array([(0.9, 0.0), (0.5, 2.5), (0.2, 0.4), (-0.95, 1.0), (-0.6, 0.1), (-0.3, 3.0)])
    deviations = []
    for seed, (g, albedo, tau, mu0) in enumerate([(0.6, 0.95, 2.0, 0.7), (0.8, 1.0, 1.0, 0.4), (-0.4, 0.8, 3.0, 0.95)]):
        mean, error = monte_carlo(g, albedo, tau, mu0, directions, 40_000, np.random.default_rng(seed))
        exact = slab_radiance(g, albedo, tau, mu0, *directions.T).value
        assert (error < 0.05 * exact).all()
        deviations.append((mean - exact) / error)
    deviations = np.concatenate(deviations)
    # P(|t| > 4.5) = 2.5e-4 each; the mean square of t(19) is 1.12 with a standard deviation of about 0.45 over 18.
    assert np.abs(deviations).max() < 4.5 and (deviations**2).mean() < 2.9


def fresnel_monte_carlo(g, albedo, tau, ior, photons, rng):
    """Reflectance and transmittance for normal incidence with refracting surfaces, photon by photon."""
    r = ((ior - 1) / (ior + 1)) ** 2
    z, mu, weight = np.zeros(photons), np.ones(photons), np.full(photons, 1 - r)
    batch = np.arange(photons) % 20
    leaving = np.zeros((2, 20))
    leaving[0] = r * photons / 20
    while weight.size:
        z = z + mu * rng.exponential(size=z.size)
        while True:
            out = (z < 0) | (z > tau)
            if not out.any():
                break
            # The path beyond the surface is folded back; reflected or not is decided by a draw.
            inside = np.abs(mu)
            sine = ior**2 * (1 - inside**2)
            cosine = np.sqrt(np.maximum(1 - sine, 0))
            across = (ior * inside - cosine) / (ior * inside + cosine)
            along = (inside - ior * cosine) / (inside + ior * cosine)
            passes = out & (rng.random(z.size) > np.where(sine < 1, (across**2 + along**2) / 2, 1.0))
            leaving[0] += np.bincount(batch[passes & (z < 0)], weight[passes & (z < 0)], 20)
            leaving[1] += np.bincount(batch[passes & (z > tau)], weight[passes & (z > tau)], 20)
            folded = np.where(z < 0, -z, 2 * tau - z)
            z, mu = np.where(out, folded, z)[~passes], np.where(out, -mu, mu)[~passes]
            weight, batch = weight[~passes], batch[~passes]
        weight = weight * albedo
        cosine = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * rng.random(z.size))) ** 2) / (2 * g)
        mu = mu * cosine + np.sqrt((1 - mu**2) * (1 - cosine**2)) * np.cos(2 * np.pi * rng.random(z.size))
        survives = rng.random(z.size) < np.minimum(weight / 0.3, 1)
        z, mu, weight, batch = z[survives], mu[survives], np.maximum(weight, 0.3)[survives], batch[survives]
    samples = leaving / (photons / 20)
    return samples.mean(axis=1), samples.std(axis=1, ddof=1) / math.sqrt(20)


def test_boundaries_against_monte_carlo():
    for seed, (g, albedo, tau, ior) in enumerate([(0.75, 0.9, 2.0, 1.5), (0.3, 0.99, 1.0, 1.33)]):
        mean, error = fresnel_monte_carlo(g, albedo, tau, ior, 100_000, np.random.default_rng(seed))
        exact = np.array(adding_doubling(g, albedo, tau, ior)[:2])
        assert (error < 0.005).all()
        assert (np.abs(mean - exact) < 4.5 * error).all()


def test_radiance_states_its_error():
    """Of 900 random directions 1.2 % missed by more than the estimate, all of them at 4 points; the median by 2 % of it."""
    rng = np.random.default_rng(5)
    ratios = []
    for points in (4, 8, 16) * 2:
        slab = rng.uniform(-0.6, 0.8), rng.choice([1.0, rng.random()]), 10 ** rng.uniform(-1, 1.5), rng.uniform(0.05, 1.0)
        directions = rng.uniform(-1, 1, 30), rng.uniform(0, np.pi, 30)
        truth = slab_radiance(*slab, *directions, quadrature=32).value
        seen = slab_radiance(*slab, *directions, quadrature=points)
        ratios.append(np.abs(seen.value - truth) / seen.error_estimate)
    assert (np.concatenate(ratios) > 1).mean() < 0.04
    assert np.median(ratios) < 0.25


@pytest.mark.parametrize("albedo", [0.0, 1e-12, 0.7, 1.0])
def test_radiance_anywhere(albedo):
    tau = np.array([0.0, 5e-324, 1e-30, 1e-6, 1.0, 1e4, 1e30, np.inf])[:, None, None]
    mu0 = np.array([1e-12, 0.3, 1.0])[:, None]
    mu = np.array([-1.0, -0.3, -1e-20, 0.0, 1e-12, 0.3, 1.0])
    radiance = slab_radiance(0.7, albedo, tau, mu0, mu, 0.4, quadrature=6)
    assert radiance.value.shape == (8, 3, 7)
    assert np.isfinite(radiance.value).all() and (radiance.value >= 0).all() and (radiance.error_estimate > 0).all()
    assert (radiance.value[0] < 1e-80).all()
    # Out of the bottom of a very thick slab comes nothing.
    assert (radiance.value[-1, :, :2] < 1e-12).all()


def test_singular_forward_peak_stays_infinite():
    """Fournier-Forand's function itself is infinite straight ahead; nowhere else is the radiance."""
    radiance = slab_radiance(PHASES["ocean"], 0.9, 1.0, 1.0, [-1.0, -0.99, 1.0], 0.0, quadrature=8)
    assert np.isinf(radiance.value).tolist() == [True, False, False]
    assert np.isfinite(radiance.error_estimate).all()


@pytest.mark.parametrize("g", [1 - 1e-16, 1 - 1e-7, -1 + 1e-7, -1 + 1e-16])
@pytest.mark.parametrize("albedo", [0.5, 1.0])
def test_almost_a_mirror(g, albedo):
    """All light goes straight on, or straight back: two streams, R = a / (1 + k coth(k tau)) with k^2 = 1 - a^2."""
    slab = adding_doubling(g, albedo, 3.0, quadrature=8)
    if g > 0:
        assert slab.reflectance < 1e-6
        assert abs(slab.transmittance - math.exp(-3.0 * (1 - albedo))) < 1e-5
    else:
        kappa = math.sqrt((1 - albedo) * (1 + albedo))
        expected = 3.0 / 4.0 if albedo == 1 else albedo / (1 + kappa / math.tanh(3.0 * kappa))
        assert abs(slab.reflectance - expected) < 1e-5
    assert np.isfinite(slab_radiance(g, albedo, 3.0, 0.5, [0.3, -0.3], 1.0, quadrature=8)).all()


# --- H ---------------------------------------------------------------------------------------------------------


def test_h_table():
    """Chandrasekhar, Radiative Transfer, table XI, albedo 1, mu = 0, 0.1 ... 1: one unit of the last digit."""
    table = [1.0, 1.2474, 1.4503, 1.6425, 1.8293, 2.0128, 2.1941, 2.3740, 2.5527, 2.7306, 2.9078]
    np.testing.assert_allclose(h_function(1.0, np.arange(11) / 10), table, rtol=0, atol=1e-4)


@pytest.mark.parametrize("albedo", ["1", "0.999999", "0.9", "0.2", "1e-6"])
@pytest.mark.parametrize("mu", ["1e-6", "0.03", "0.5", "1"])
def test_h_against_mpmath(albedo, mu):
    """In the angle theta = arctan x, adaptively, to 30 digits. Measured 6e-15."""
    with mpmath.workdps(30):
        a, m = mpmath.mpf(float(albedo)), mpmath.mpf(float(mu))
        # Breaks around the near-zero of 1 - albedo theta cot(theta) at 0 and around the peak of 1 / (cos^2 + mu^2 sin^2).
        edge = min(m, mpmath.mpf("0.1"))
        breaks = sorted({mpmath.mpf(0), *(mpmath.mpf(10) ** -k for k in (12, 9, 6, 4, 3, 2, 1)), mpmath.mpf(1),
                         *(mpmath.pi / 2 - edge * s for s in (30, 5, 1, 0.2, 0.03) if edge * s < 0.5), mpmath.pi / 2})

        def integrand(t):
            rest = t * t / 3 + t**4 / 45 if t < 1e-7 else 1 - t * mpmath.cot(t)
            return mpmath.log((1 - a) + a * rest) / (mpmath.cos(t) ** 2 + (m * mpmath.sin(t)) ** 2)

        expected = mpmath.exp(-m / mpmath.pi * mpmath.quad(integrand, breaks))
        assert abs(h_function(float(albedo), float(mu)) / expected - 1) < 1e-12


@pytest.mark.parametrize("albedo", [1e-3, 0.4, 0.9, 0.9999, 1.0])
def test_h_moments(albedo):
    """alpha_0 = 2 (1 - sqrt(1 - albedo)) / albedo; alpha_1 = 2 / sqrt(3) without absorption; the integral equation."""
    x, w = np.polynomial.legendre.leggauss(200)
    # mu = t^2 smooths mu ln(mu) at 0.
    t, w = (x + 1) / 2, w / 2
    mu, w = t**2, 2 * t * w
    h = h_function(albedo, mu)
    assert abs(w @ h - 2 * (1 - math.sqrt(1 - albedo)) / albedo) < 1e-9
    if albedo == 1.0:
        assert abs(w @ (mu * h) - 2 / math.sqrt(3)) < 1e-9
    at = np.array([0.05, 0.5, 1.0])
    equation = 1 + albedo / 2 * at * h_function(albedo, at) * (w * h / (mu + at[:, None])).sum(axis=1)
    np.testing.assert_allclose(h_function(albedo, at), equation, rtol=1e-9)


# --- arguments -------------------------------------------------------------------------------------------------


def test_shapes():
    assert adding_doubling(0.5, np.zeros((0, 1)), np.ones(3), quadrature=6).reflectance.shape == (0, 3)
    assert np.shape(adding_doubling(0.5, np.float32(0.5), [[1.0], [2.0]], [1.0, 1.3], quadrature=6).error_estimate) == (2, 2)
    assert slab_radiance(0.5, 0.5, 1.0, 0.5, np.zeros((0,)), 0.0).value.shape == (0,)
    assert slab_radiance(0.5, 0.5, 1.0, 0.5, np.float32(0.5), 0.0, quadrature=6).value.dtype == np.float64
    assert h_function(np.zeros((2, 1)), np.zeros(0)).shape == (2, 0)
    np.testing.assert_array_equal(
        slab_radiance(0.5, [0.5, 0.9], 1.0, 0.5, 0.3, 0.0, quadrature=6).value,
        [slab_radiance(0.5, albedo, 1.0, 0.5, 0.3, 0.0, quadrature=6).value for albedo in (0.5, 0.9)])


@pytest.mark.parametrize("call, message", [
    (lambda: adding_doubling(0.5, 1.1, 1.0), "albedo"),
    (lambda: adding_doubling(0.5, 0.5, -1.0), "tau"),
    (lambda: adding_doubling(0.5, 0.5, np.nan), "tau"),
    (lambda: adding_doubling(0.5, 0.5, 1.0, 0.9), "ior"),
    (lambda: adding_doubling(1.0, 0.5, 1.0), "g must"),
    (lambda: adding_doubling(0.5, 0.5, 1.0, quadrature=2), "quadrature"),
    (lambda: adding_doubling(lambda c: np.full_like(c, 1.0), 0.5, 1.0), "integral of phase"),
    (lambda: adding_doubling(lambda c: -phases.rayleigh(c), 0.5, 1.0), "phase"),
    (lambda: slab_radiance(0.5, 0.5, 1.0, 0.0, 0.5, 0.0), "mu0"),
    (lambda: slab_radiance(0.5, 0.5, 1.0, 0.5, 1.5, 0.0), "mu must"),
    (lambda: slab_radiance(0.5, 0.5, 1.0, 0.5, 0.5, np.inf), "azimuth"),
    (lambda: h_function(0.5, -0.1), "mu"),
])
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()
