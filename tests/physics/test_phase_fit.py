# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits of two lobes: known ones are found, others are as good as SciPy's, and the residual is what it says."""

import miepython
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares

from volumetrics_addon.physics import phase
from volumetrics_addon.physics.phase_fit import fit_dual_henyey_greenstein

MODES = [{"logarithmic": log, "keep_mean_cosine": keep, "free_norm": free}
         for log in (False, True) for keep in (False, True) for free in (False, True)]  # fmt: skip
TABLE = np.cos(np.linspace(0, np.pi, 181))


def lobe(c, g):
    """Henyey-Greenstein, literally."""
    return (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * c) ** 1.5)


def two_lobes(g0, g1, weight):
    return lambda c: (1 - weight) * lobe(c, g0) + weight * lobe(c, g1)


def literal_residual(function, fit, logarithmic):
    """Root mean square over the sphere by SciPy's quadrature in theta."""
    model = two_lobes(fit.g0, fit.g1, fit.weight)

    def square(theta):
        ratio = fit.norm * model(np.cos(theta)) / function(np.cos(theta))
        return (np.log(ratio) if logarithmic else ratio - 1) ** 2 * np.sin(theta) / 2

    ends = [0, 0.003, 0.03, 0.1, 0.3, 1, 2, 2.8, 3.1, np.pi]
    return np.sqrt(sum(quad(square, a, b, epsabs=1e-16, limit=200)[0] for a, b in zip(ends, ends[1:])))


def scipy_cost(c, value, share, bound, logarithmic, free_norm, mean=None):
    """The smallest root mean square that SciPy finds from many starts, for a normalised table and |g| < bound."""

    def unpack(q):
        if mean is None:
            g0, g1, w = bound * np.tanh(q[0]), bound * np.tanh(q[1]), 1 / (1 + np.exp(-q[2]))
        else:
            g0, g1 = mean + (bound - mean) / (1 + np.exp(-q[0])), mean - (bound + mean) / (1 + np.exp(-q[1]))
            w = (g0 - mean) / (g0 - g1)
        return two_lobes(g0, g1, w)(c) * (np.exp(q[-1]) if free_norm else 1)

    def residual(q):
        ratio = unpack(q) / value
        return np.sqrt(share) * (np.log(ratio) if logarithmic else ratio - 1)

    rng = np.random.default_rng(3)
    starts = rng.uniform(-1.5, 2.5, size=(6, (3 if mean is None else 2) + free_norm))
    if free_norm:
        starts[:, -1] = 0
    found = [least_squares(residual, q, xtol=1e-13, ftol=1e-13, gtol=1e-13, max_nfev=400).cost for q in starts]
    return np.sqrt(2 * min(found))


# --- known lobes -----------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("known", [(0.85, -0.3, 0.2), (0.97, 0.4, 0.6), (0.9, 0.85, 0.5), (-0.1, -0.8, 0.7)])
def test_known_lobes_are_found(known, mode):
    fit = fit_dual_henyey_greenstein(None, two_lobes(*known), **mode)
    # Measured 2e-13 at worst, for the two lobes that lie close together.
    np.testing.assert_allclose(fit[:3], known, rtol=0, atol=1e-9)
    assert fit.residual < 1e-8
    mean = (1 - known[2]) * known[0] + known[2] * known[1]
    assert fit.given_mean_cosine == pytest.approx(mean, abs=1e-12)
    assert fit.mean_cosine == pytest.approx(mean, abs=1e-8)
    assert fit.norm == pytest.approx(1, abs=1e-8) and fit.given_norm == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize("unit", [1e-300, 1.0, 1e3, 1e300])
def test_known_lobes_in_a_coarse_table(logarithmic, unit):
    """With a free norm even degree by degree: its sums are not exact, but at every point the lobes are."""
    rng = np.random.default_rng(4)
    shuffled = rng.permutation(TABLE).astype(np.float64)
    values = unit * two_lobes(0.8, -0.4, 0.25)(shuffled)
    fit = fit_dual_henyey_greenstein(shuffled, values, logarithmic, free_norm=True)
    np.testing.assert_allclose(fit[:3], (0.8, -0.4, 0.25), atol=1e-6)
    assert fit.norm == pytest.approx(unit, rel=1e-6)
    # The table's own sum: trapezia of 1 degree, off by 3e-4.
    assert fit.given_norm == pytest.approx(unit, rel=1e-3)
    assert fit.given_mean_cosine == pytest.approx(0.5, abs=1e-3)
    asked = fit_dual_henyey_greenstein(shuffled, lambda c: unit * two_lobes(0.8, -0.4, 0.25)(c), logarithmic, free_norm=True)
    assert asked == fit


@pytest.mark.parametrize("mode", MODES[::3])
@pytest.mark.parametrize("g", [0.0, -0.7, 0.95])
def test_a_single_lobe_is_found(g, mode):
    """Two equal lobes: the weight is undetermined, the phase function is not."""
    fit = fit_dual_henyey_greenstein(None, lambda c: lobe(c, g), **mode)
    assert fit.residual < 1e-5
    found = phase.dual_henyey_greenstein(TABLE, fit.g0, fit.g1, fit.weight)
    np.testing.assert_allclose(found, lobe(TABLE, g), rtol=1e-4)


# --- others ------------------------------------------------------------------------

OTHERS = {
    "rayleigh": phase.rayleigh,
    "cornette-shanks": lambda c: phase.cornette_shanks(c, 0.7),
    "mie fit": lambda c: phase.mie_fit(c, 10.0),
}


@pytest.fixture(params=OTHERS)
def function(request):
    return OTHERS[request.param]


@pytest.mark.parametrize("mode", MODES)
def test_residual_is_what_it_says(function, mode):
    fit = fit_dual_henyey_greenstein(None, function, **mode)
    # The quadrature of the fit against SciPy's: measured 6e-13.
    assert fit.residual == pytest.approx(literal_residual(function, fit, mode["logarithmic"]), rel=1e-10)
    if mode["keep_mean_cosine"]:
        assert fit.mean_cosine == pytest.approx(fit.given_mean_cosine, abs=1e-14)
    if not mode["free_norm"]:
        assert fit.norm == pytest.approx(1, abs=1e-12)
    mean = quad(lambda c: 2 * np.pi * c * function(c), -1, 1, points=[0, 0.9, 0.99, 0.999], limit=500)[0]
    assert fit.given_mean_cosine == pytest.approx(mean, abs=1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_residual_is_as_small_as_scipys(function, mode):
    theta = np.pi / 2 * (1 + np.cos(np.pi * np.arange(101) / 100))
    nodes = np.cos(theta)
    value = function(nodes)
    # The table's own solid angles, literally: half way to the neighbours.
    edges = np.concatenate([[-1], (nodes[1:] + nodes[:-1]) / 2, [1]])
    share = np.diff(edges) / 2
    normalised = value / (4 * np.pi * share @ value)
    mean = 4 * np.pi * share @ (normalised * nodes)
    kept = mean if mode["keep_mean_cosine"] else None
    best = scipy_cost(nodes, normalised, share, 1 - theta[-2], mode["logarithmic"], mode["free_norm"], kept)
    fit = fit_dual_henyey_greenstein(nodes, value, **mode)
    assert fit.residual <= best * (1 + 1e-6) + 1e-12
    assert fit.given_mean_cosine == pytest.approx(mean, abs=1e-13)


def test_constraints_cost_residual(function):
    free, norm, mean = (
        fit_dual_henyey_greenstein(None, function, True, **options).residual
        for options in ({"free_norm": True}, {}, {"keep_mean_cosine": True})
    )
    assert free <= norm * (1 + 1e-12) and norm <= mean * (1 + 1e-12)


def test_residuals_of_known_functions():
    """Regression values, for the documentation: the relative error of two lobes over the sphere."""
    expected = {"rayleigh": 0.0280, "cornette-shanks": 0.1153, "mie fit": 0.5315}
    for name, function in OTHERS.items():
        assert fit_dual_henyey_greenstein(None, function).residual == pytest.approx(expected[name], abs=1e-4)


def mie(diameter):
    """Water droplets of a diameter in micrometres, at 550 nm: (cos_theta, phase function, mean cosine)."""
    x = np.pi * diameter / 0.55
    # Dense towards forward, where the peak is about 1 / x wide.
    theta = np.pi * np.linspace(0, 1, 2001) ** 2
    value = miepython.phase_matrix(1.333, x, np.cos(theta), norm="one")[0, 0]
    return np.cos(theta), value, miepython.efficiencies_mx(1.333, x)[3]


def test_water_droplets_of_ten_micrometres():
    cos_theta, value, mean_cosine = mie(10.0)
    fit = fit_dual_henyey_greenstein(cos_theta, value, logarithmic=True, keep_mean_cosine=True)
    # Table sums against the Mie series.
    assert fit.given_norm == pytest.approx(1, rel=1e-4)
    assert fit.given_mean_cosine == pytest.approx(mean_cosine, abs=1e-4)
    assert fit.mean_cosine == pytest.approx(mean_cosine, abs=1e-4)
    # One size of drop has rings, fog-bow and glory that no lobe has: the fit is off by a factor of e^0.84.
    assert fit.residual == pytest.approx(0.844, abs=0.002)
    assert fit.g0 == pytest.approx(0.912, abs=0.002)
    assert fit.g1 == pytest.approx(-0.790, abs=0.01) and fit.weight == pytest.approx(0.0435, abs=0.001)
    single = np.log(lobe(cos_theta, mean_cosine) / value)
    share = np.gradient(-cos_theta) / 2
    assert fit.residual < 0.8 * np.sqrt(share @ single**2)
    free = fit_dual_henyey_greenstein(cos_theta, value, logarithmic=True)
    assert free.residual == pytest.approx(0.820, abs=0.002)


# --- arguments -----------------------------------------------------------------------


@pytest.mark.parametrize("value", [5e-324, 1e308])
@pytest.mark.parametrize("mode", MODES[::3])
def test_extreme_tables(value, mode):
    spike = np.full(9, 1e-50)
    spike[-1] = 1.0
    tables = [np.full(9, value)]
    if value > 1 and not mode["keep_mean_cosine"]:
        tables.append(spike * value)
    for values in tables:
        fit = fit_dual_henyey_greenstein(np.linspace(-1, 1, 9), values, **mode)
        assert np.all(np.isfinite(fit[:6])) and abs(fit.g0) < 1 and abs(fit.g1) < 1 and 0 <= fit.weight <= 1


@pytest.mark.parametrize(
    "cos_theta, value, message",
    [
        (TABLE, -np.ones(181), "value must be finite and > 0 .*, got -1.0; .*leave out zeros"),
        (TABLE, np.zeros(181), "value .* got 0.0"),
        (TABLE, np.full(181, np.nan), "value .* got nan"),
        (TABLE, np.ones(180), r"value must have the shape of cos_theta, \(181,\), got \(180,\)"),
        (TABLE, np.geomspace(1e-80, 1, 181), "value, of its largest, must be at least 1e-60, got .*leave out what"),
        (TABLE[:4], np.ones(4), r"cos_theta must have shape \(n,\) with 5 different values or more, got shape \(4,\)"),
        (np.zeros(9), np.ones(9), "cos_theta must have shape .*with 5 different"),
        (TABLE * 2, np.ones(181), r"cos_theta must be in \[-1, 1\]"),
        (None, lambda c: -c, "value .* got "),
    ],
)
def test_errors_name_value_and_remedy(cos_theta, value, message):
    with pytest.raises(ValueError, match=message):
        fit_dual_henyey_greenstein(cos_theta, value)


def test_a_spike_has_no_second_lobe_to_keep_its_mean_cosine():
    spike = np.where(np.linspace(-1, 1, 9) == 1, 1.0, 1e-50)
    with pytest.raises(ValueError, match=r"mean cosine of value must be in \(-0.277.*, 0.277.*\), .* got 1.0; give a finer"):
        fit_dual_henyey_greenstein(np.linspace(-1, 1, 9), spike, keep_mean_cosine=True)


def test_a_table_without_cosines_is_no_callable():
    with pytest.raises(ValueError, match="cos_theta is needed with a table"):
        fit_dual_henyey_greenstein(None, np.ones(9))
