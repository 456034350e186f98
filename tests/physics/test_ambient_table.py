# SPDX-License-Identifier: GPL-3.0-or-later
"""The ambient table against conservation of energy, closed forms, quadrature and a literal Monte Carlo."""

import importlib.util
import math
import random
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import dblquad

from volumetrics_addon.physics import ambient_table

ROOT = Path(__file__).resolve().parent.parent.parent
TABLE = ambient_table.load()
# Measured with the shipped table: 0.041 (at g = -0.7; 0.024 for g >= 0), 0.024 and 0.0047.
CONSERVATION, ISOTROPIC, SECOND_ORDER = 0.05, 0.03, 0.007
COSINE, WEIGHT = np.polynomial.legendre.leggauss(200)


def over_sphere(values):
    return 2 * math.pi * WEIGHT @ values


def henyey_greenstein(c, g):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * c) ** 1.5)


def test_shipped_table():
    assert ambient_table.DEFAULT.stat().st_size < 300_000
    axes = TABLE.theta, TABLE.tau, TABLE.g, TABLE.albedo
    assert TABLE.log_ratio.shape == TABLE.error.shape == tuple(len(axis) for axis in axes)
    assert np.isfinite(TABLE.log_ratio).all() and (TABLE.error >= 0).all()
    assert TABLE.tau[0] == 0 and not TABLE.log_ratio[:, 0].any() and not TABLE.error[:, 0].any()


@pytest.mark.parametrize("tau", [0.1, 0.5, 1.2, 3.0, 7.0, 12.0])
@pytest.mark.parametrize("g", [-0.7, 0.0, 0.3, 0.8, 0.9])
def test_energy_is_conserved(tau, g):
    """Without absorption the integral over the sphere is 1."""
    total = over_sphere(TABLE.radiance(COSINE, tau, g, 1.0))
    assert total == pytest.approx(1.0, abs=CONSERVATION)


def test_isotropic_ball_without_absorption_glows_evenly():
    """L_o = 1 / (4 pi) at every angle, however thick the ball."""
    tau = np.linspace(0.0, 12.0, 41)[:, None]
    ratio = TABLE.radiance(COSINE, tau, 0.0, 1.0) * 4 * math.pi
    np.testing.assert_allclose(ratio, 1.0, atol=ISOTROPIC)


def test_thin_balls_scatter_twice():
    """M -> albedo tau HG(cos; g^2): folded lobes multiply their mean cosines."""
    c = np.linspace(-1, 1, 21)
    for g in (-0.8, -0.4, 0.0, 0.35, 0.88):
        for tau in (1e-12, 1e-6):
            expected = 0.7 * tau * henyey_greenstein(c, g * g)
            np.testing.assert_allclose(TABLE.scattered(c, tau, g, 0.7), expected, rtol=1e-5)


def test_limits():
    c = np.linspace(-1, 1, 5)
    assert not TABLE.scattered(c, 3.0, 0.5, 0.0).any()
    assert not TABLE.scattered(c, 0.0, 0.5, 1.0).any()
    np.testing.assert_allclose(TABLE.radiance(c, 2.0, 0.5, 0.0), henyey_greenstein(c, 0.5) * math.exp(-2.0), rtol=1e-12)
    tau = np.array([0.0, 1e-30, 0.3, 5.0, 1e30, math.inf])
    np.testing.assert_allclose(TABLE.furnace(tau, 0.5, 0.0), np.exp(-tau), rtol=1e-12)
    for g in (-0.999, -0.3, 0.0, 0.95):
        for albedo in (0.0, 0.4, 1.0):
            scattered, furnace = TABLE.scattered(0.3, tau, g, albedo), TABLE.furnace(tau, g, albedo)
            assert (scattered >= 0).all() and np.isfinite(scattered).all() and ((furnace >= 0) & (furnace <= 1)).all()


def test_furnace_is_the_integral_over_the_sphere():
    for tau, g, albedo in ((1.0, 0.68, 0.9), (4.0, -0.45, 0.7), (8.0, 0.9, 0.98)):
        total = over_sphere(TABLE.radiance(COSINE, tau, g, albedo))
        assert TABLE.furnace(tau, g, albedo) == pytest.approx(min(total, 1.0), rel=1e-4)
    assert TABLE.furnace([0.3, 2.0, 9.0], 0.6, 1.0) == pytest.approx(1.0, abs=CONSERVATION)


def test_more_albedo_more_light():
    albedo = np.linspace(0, 1, 33)
    values = TABLE.scattered(np.array([[-0.9], [0.1], [1.0]]), 3.0, 0.6, albedo)
    assert (np.diff(values, axis=1) > 0).all()


@pytest.mark.parametrize("tau", [0.5, 2.0, 6.0])
def test_second_order_by_quadrature(tau):
    """g = 0, albedo -> 0: M / albedo = (1 / 4 pi)^2 times the integral over the ball of exp(-s - way in) / s^2."""
    def integrand(mu, s):
        return 2 * math.pi * math.exp(-s - (s * mu + math.sqrt(tau * tau - s * s * (1 - mu * mu)))) / (4 * math.pi) ** 2

    expected, _ = dblquad(integrand, 0, tau, -1, 1, epsabs=1e-12)
    found = TABLE.scattered([-0.6, 0.2, 1.0], tau, 0.0, 1e-12) / 1e-12
    np.testing.assert_allclose(found, expected, rtol=SECOND_ORDER)


def literal_shares(tau, g, albedo, paths, edges):
    """Analog: where backward paths that scatter at least once more leave the ball, as shares of bins of the cosine."""
    rng = random.Random(11)
    counts = [0] * (len(edges) - 1)
    for _ in range(paths):
        x = y = z = dx = dy = 0.0
        dz, order = 1.0, 0
        while True:
            u = rng.random()
            c = 2 * u - 1 if g == 0 else (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
            s, phi = math.sqrt(max(0.0, 1 - c * c)), 2 * math.pi * rng.random()
            if abs(dz) > 0.99999:
                ex, ey, ez = s * math.cos(phi), s * math.sin(phi), c * math.copysign(1.0, dz)
            else:
                w = math.sqrt(1 - dz * dz)
                ex = s * (dx * dz * math.cos(phi) - dy * math.sin(phi)) / w + dx * c
                ey = s * (dy * dz * math.cos(phi) + dx * math.sin(phi)) / w + dy * c
                ez = -s * math.cos(phi) * w + dz * c
            dx, dy, dz = ex, ey, ez
            flight = -math.log(1 - rng.random())
            x, y, z = x - flight * dx, y - flight * dy, z - flight * dz
            if x * x + y * y + z * z >= tau * tau:
                if order:
                    counts[min(int(np.searchsorted(edges, dz, side="right")) - 1, len(counts) - 1)] += 1
                break
            order += 1
            if rng.random() > albedo:
                break
    return np.array(counts) / paths


@pytest.mark.parametrize("tau, g, albedo", [(1.0, 0.0, 0.9), (2.0, 0.68, 1.0), (3.0, -0.45, 0.82), (1.7, 0.5, 0.94)])
def test_against_a_literal_monte_carlo(tau, g, albedo):
    edges, paths = np.array([-1.0, -0.5, 0.0, 0.5, 0.9, 1.0]), 40000
    found = literal_shares(tau, g, albedo, paths, edges)
    for low, high, share in zip(edges, edges[1:], found):
        c, w = (high - low) / 2 * COSINE + (low + high) / 2, (high - low) / 2 * WEIGHT
        expected = 2 * math.pi * w @ TABLE.scattered(c, tau, g, albedo)
        # Four standard deviations of the literal sum, and the stated error of a lookup.
        stated = float(np.mean(TABLE.relative_error(c, tau, g, albedo)))
        assert abs(share - expected) < 4 * math.sqrt(expected * (1 - expected) / paths) + stated * expected


def test_the_stated_noise_is_the_noise():
    """Two builds from different seeds differ by their standard errors."""
    nodes = {"theta": [0.0, 1.0, 3.0], "tau": [0.0, 0.8, 4.0], "g": [-0.3, 0.0, 0.7], "albedo": [0.0, 0.6, 1.0]}
    one, two = (ambient_table.build(20000, seed, **nodes) for seed in (1, 2))
    z = (one.log_ratio - two.log_ratio)[:, 1:] / np.hypot(one.error, two.error)[:, 1:]
    # Student with about 30 degrees of freedom, correlated in theta and albedo.
    assert np.abs(z).max() < 5.0 and 0.5 < np.sqrt(np.mean(z**2)) < 1.6
    again = ambient_table.build(20000, 1, **nodes)
    np.testing.assert_array_equal(again.log_ratio, one.log_ratio)


def test_saves_and_loads(tmp_path):
    table = ambient_table.build(2000, 3, theta=[0.0, 3.14], tau=[0.0, 1.0], g=[0.0, 0.5], albedo=[0.0, 1.0])
    table.save(tmp_path / "a.npz")
    back = ambient_table.load(tmp_path / "a.npz")
    np.testing.assert_allclose(back.log_ratio, table.log_ratio, rtol=1e-6, atol=1e-7)
    assert (back.samples, back.seed) == (2000, 3)
    np.savez(tmp_path / "b.npz", format=99)
    with pytest.raises(ValueError, match="format of .*b.npz must be 1, got 99; build it with"):
        ambient_table.load(tmp_path / "b.npz")


def test_the_script_builds_a_file(tmp_path, monkeypatch, capsys):
    spec = importlib.util.spec_from_file_location("build_ambient_table", ROOT / "scripts" / "build_ambient_table.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    few = partial(ambient_table.build, theta=[0.0, 3.14], tau=[0.0, 1.0], g=[0.0, 0.5], albedo=[0.0, 1.0])
    monkeypatch.setattr(ambient_table, "build", few)
    path = tmp_path / "new" / "table.npz"
    assert script.main(["--samples", "500", "--seed", "4", "--output", str(path)]) == 0
    assert "16 entries" in capsys.readouterr().out
    np.testing.assert_allclose(ambient_table.load(path).log_ratio, few(500, 4).log_ratio, atol=1e-6)
    with pytest.raises(SystemExit):
        script.main(["--samples", "0"])


@pytest.mark.parametrize("arguments, message", [
    ((1.5, 1.0, 0.0, 0.5), "cos_theta must be"), ((0.0, -1.0, 0.0, 0.5), "tau must be >= 0"),
    ((0.0, 1.0, 1.0, 0.5), r"g must be in \(-1, 1\), got 1.0"), ((0.0, 1.0, 0.0, 1.01), r"albedo must be in \[0, 1\]"),
    ((math.nan, 1.0, 0.0, 0.5), "cos_theta must be"),
])
def test_errors_name_value_and_remedy(arguments, message):
    for function in (TABLE.scattered, TABLE.radiance, TABLE.relative_error):
        with pytest.raises(ValueError, match=message):
            function(*arguments)


def test_shapes():
    assert TABLE.scattered(np.zeros((0, 3)), 1.0, 0.0, 0.5).shape == (0, 3)
    value = TABLE.scattered(np.float32(0.5), np.float32(1.0), np.float32(0.2), np.float32(0.5))
    assert value.dtype == np.float64 and value.shape == ()
    assert TABLE.furnace(np.ones((2, 1)), 0.0, np.ones(4)).shape == (2, 4)


@pytest.mark.sweep
def test_interpolation_between_the_nodes():
    """Direct Monte Carlo at random points: the lookup's error, beyond twice the noise of both, is the stated one."""
    rng = np.random.default_rng(8)
    excess = []
    for _ in range(200):
        theta, albedo = rng.uniform(0, math.pi, 1), rng.beta(2.0, 0.5, 1)
        tau, g = float(rng.uniform(0.02, 10.0)), float(rng.uniform(-0.9, 0.9))
        mean, spread = ambient_table.ratio(theta, tau, g, albedo, 400_000, rng)
        direct = albedo * -math.expm1(-tau) * henyey_greenstein(np.cos(theta), g * g) * mean[0]
        found = TABLE.scattered(np.cos(theta), tau, g, albedo)
        noise = TABLE.relative_error(np.cos(theta), tau, g, albedo) - ambient_table.INTERPOLATION_ERROR
        excess.append(float((abs(found - direct) / direct - 2.0 * np.hypot(noise, spread[0] / mean[0]))[0]))
    assert np.quantile(excess, 0.95) < ambient_table.INTERPOLATION_ERROR and max(excess) < 0.2
