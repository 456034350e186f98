# SPDX-License-Identifier: GPL-3.0-or-later
"""Phase functions against textbook formulas in 60-digit arithmetic, quadrature and chi-square."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from volumetrics_addon.physics import phase

# Measured 7e-16 for single lobes and 2.4e-14 for Fournier-Forand.
LOBE_RTOL = 2e-15
FOURNIER_FORAND_RTOL = 1e-13
# Measured 8e-16 over 3600 draws: five roundings of numbers up to 2.
COSINE_ATOL = 1e-15
DIGITS = 60

COSINES = [
    -1.0, -1 + 1e-15, -0.999999, -0.9, -0.577, -0.3, -1e-9, 0.0, 1e-300,
    0.1, 0.5774, 0.9, 0.999, 1 - 1e-9, 1 - 1e-15, 1 - 2.0**-53, 1.0,
]  # fmt: skip
ASYMMETRIES = [
    0.0, 1e-300, -1e-12, 0.1, -0.3, 0.5, 0.77, -0.9, 0.99, 0.999999,
    1 - 1e-12, -1 + 1e-12, 1 - 2.0**-53,
]  # fmt: skip


# --- textbook formulas, literally ---------------------------------------------


def literal_rayleigh(c):
    return 3 / (16 * mp.pi) * (1 + mp.mpf(c) ** 2)


def literal_henyey_greenstein(c, g):
    c, g = mp.mpf(c), mp.mpf(g)
    return (1 - g**2) / (4 * mp.pi * (1 + g**2 - 2 * g * c) ** mp.mpf("1.5"))


def literal_dual(c, g0, g1, w):
    return (1 - mp.mpf(w)) * literal_henyey_greenstein(c, g0) + mp.mpf(
        w
    ) * literal_henyey_greenstein(c, g1)


def literal_schlick(c, k):
    c, k = mp.mpf(c), mp.mpf(k)
    return (1 - k**2) / (4 * mp.pi * (1 - k * c) ** 2)


def literal_cornette_shanks(c, g):
    c, g = mp.mpf(c), mp.mpf(g)
    shape = (1 - g**2) * (1 + c**2) / ((2 + g**2) * (1 + g**2 - 2 * g * c) ** mp.mpf("1.5"))
    return 3 / (8 * mp.pi) * shape


def literal_draine(c, g, alpha):
    c, g, alpha = mp.mpf(c), mp.mpf(g), mp.mpf(alpha)
    return (
        literal_henyey_greenstein(c, g)
        * (1 + alpha * c**2)
        / (1 + alpha * (1 + 2 * g**2) / 3)
    )


def literal_mie_parameters(d):
    """Jendersie and d'Eon, equations 4 to 7, for 5 to 50 micrometres."""
    d = mp.mpf(d)
    return (
        mp.exp(-mp.mpf("0.0990567") / (d - mp.mpf("1.67154"))),
        mp.exp(-mp.mpf("2.20679") / (d + mp.mpf("3.91029")) - mp.mpf("0.428934")),
        mp.exp(mp.mpf("3.62489") - mp.mpf("8.29288") / (d + mp.mpf("5.52825"))),
        mp.exp(-mp.mpf("0.599085") / (d - mp.mpf("0.641583")) - mp.mpf("0.665888")),
    )


def literal_mie(c, d):
    g_hg, g_draine, alpha, w = literal_mie_parameters(d)
    return (1 - w) * literal_henyey_greenstein(c, g_hg) + w * literal_draine(c, g_draine, alpha)


def literal_slope(backscatter, ior):
    """v of Fournier-Forand from the backscatter fraction (Mobley 2002)."""
    delta_90 = 4 / (3 * (mp.mpf(ior) - 1) ** 2) * mp.mpf("0.5")
    return -mp.log(2 * mp.mpf(backscatter) * (delta_90 - 1) + 1) / mp.log(delta_90)


def literal_fournier_forand(c, v, ior):
    """Fournier and Jonasz (1999), as printed by Mobley (2002)."""
    return literal_fournier_forand_of_s((1 - mp.mpf(c)) / 2, v, ior)


def literal_fournier_forand_of_s(s, v, ior):
    c, v, n = 1 - 2 * s, mp.mpf(v), mp.mpf(ior)
    d, d_180 = 4 / (3 * (n - 1) ** 2) * s, 4 / (3 * (n - 1) ** 2)
    bracket = v * (1 - d) - (1 - d**v) + (d * (1 - d**v) - v * (1 - d)) / s
    first = bracket / (4 * mp.pi * (1 - d) ** 2 * d**v)
    second = (1 - d_180**v) / (16 * mp.pi * (d_180 - 1) * d_180**v) * (3 * c**2 - 1)
    return first + second


SINGLE_LOBES = [
    (phase.rayleigh, literal_rayleigh, [()]),
    (phase.henyey_greenstein, literal_henyey_greenstein, [(g,) for g in ASYMMETRIES]),
    (phase.cornette_shanks, literal_cornette_shanks, [(g,) for g in ASYMMETRIES]),
    (phase.schlick, literal_schlick, [(k,) for k in ASYMMETRIES]),
    (
        phase.dual_henyey_greenstein,
        literal_dual,
        [(0.8, -0.3, 0.25), (1 - 1e-12, -1 + 1e-12, 0.5), (0.5, 0.9, 0.0), (0.5, 0.9, 1.0)],
    ),
    (
        phase.draine,
        literal_draine,
        [(g, a) for g in ASYMMETRIES for a in (0.0, 1e-9, 1.0, 27.0, 250.0, 1e30)],
    ),
]


@pytest.mark.parametrize("function, literal, parameters", SINGLE_LOBES)
def test_value_matches_textbook_formula(function, literal, parameters):
    with mp.workdps(DIGITS):
        for arguments in parameters:
            expected = [float(literal(c, *arguments)) for c in COSINES]
            values = function(np.array(COSINES), *arguments)
            np.testing.assert_allclose(values, expected, rtol=LOBE_RTOL, atol=0)


def test_isotropic():
    np.testing.assert_array_equal(
        phase.isotropic(COSINES), np.full(len(COSINES), 0.07957747154594767)
    )


@pytest.mark.parametrize("diameter", [5.0, 7.3, 20.0, 50.0])
def test_mie_fit_matches_paper(diameter):
    with mp.workdps(DIGITS):
        expected = [float(x) for x in literal_mie_parameters(diameter)]
        values = [float(literal_mie(c, diameter)) for c in COSINES]
    np.testing.assert_allclose(phase.mie_fit_parameters(diameter), expected, rtol=1e-14)
    # exp(-0.1/(d - 1.7)) rounds 1 - g_hg, about 3e-3, to 1e-14 relative, which the
    # peak squares.
    np.testing.assert_allclose(phase.mie_fit(COSINES, diameter), values, rtol=2e-13)


def test_mie_fit_below_fog():
    """The supplement's formulas worked out once in 20 digits, one diameter per range."""
    expected = {
        0.05: (0.0345, 0.025661182441902122, 250.0, 0.25218067240104991),
        # ln 1 = 0 leaves the constants, ln e = 1 the sums of the coefficients.
        1.0: (0.862, 0.50691618130173283, 250.0, 0.24075857115188248),
        np.e: (0.940256, 0.40281792736647050, 13.62029, 0.37684593734256208),
    }
    for diameter, parameters in expected.items():
        np.testing.assert_allclose(phase.mie_fit_parameters(diameter), parameters, rtol=1e-14)


def test_mie_fit_of_tiny_droplets_is_nearly_rayleigh():
    c = np.linspace(-1, 1, 101)
    np.testing.assert_allclose(phase.mie_fit(c, 1e-4), phase.rayleigh(c), rtol=0.01)


def test_mie_fit_meets_at_five_micrometres():
    below, above = (phase.mean_cosine_mie_fit(d) for d in (5 - 1e-9, 5.0))
    assert abs(below - above) < 0.01


FOURNIER_FORAND = [
    (b, n)
    for b in (1e-12, 1e-4, 0.01, 0.1, 0.49, 0.5 - 2.0**-53)
    for n in (1 + 2.0**-52, 1 + 1e-9, 1.02, 1.175, 1.8164965809277260, 1.81, 2.1547, 10, 1000)
]


@pytest.mark.parametrize("backscatter, ior", FOURNIER_FORAND)
def test_fournier_forand_matches_literature(backscatter, ior):
    with mp.workdps(DIGITS):
        v = literal_slope(backscatter, ior)
        # Beside delta = 1, where the printed formula is 0/0.
        pole = 1 - 1.5 * (ior - 1) ** 2 * (1 + 1e-9)
        cosines = [c for c in [*COSINES, pole] if -1 <= c < 1]
        expected = [float(literal_fournier_forand(c, v, ior)) for c in cosines]
    np.testing.assert_allclose(
        phase.fournier_forand(cosines, backscatter, ior), expected, rtol=FOURNIER_FORAND_RTOL
    )


@pytest.mark.parametrize(
    "ior, junge_slope, backscatter, rounding",
    # The index is printed to 0.0005, which is 2.4 % of 1.021 - 1 and counts twice.
    [(1.021, 3.0742, 1e-4, 0.05), (1.04, 3.2010, 1e-3, 0.005), (1.08, 3.483, 0.01, 0.005),
     (1.175, 4.065, 0.1, 0.005), (1.15, 4.874, 0.4, 0.005)],
)  # fmt: skip
def test_fournier_forand_matches_published_table(ior, junge_slope, backscatter, rounding):
    """Ocean Optics Web Book, The Fournier-Forand phase function, table 1."""
    cosines = np.array([-1.0, -0.5, 0.1, 0.5, 0.9])
    expected = [
        float(literal_fournier_forand(c, (3 - mp.mpf(junge_slope)) / 2, ior)) for c in cosines
    ]
    np.testing.assert_allclose(
        phase.fournier_forand(cosines, backscatter, ior), expected, rtol=rounding
    )


def test_fournier_forand_is_singular_only_forward():
    assert phase.fournier_forand(1.0, 0.01, 1.1) == np.inf
    assert np.isfinite(phase.fournier_forand(1 - 2.0**-53, 0.01, 1.1))


# --- normalisation, mean cosine, orientation ----------------------------------

LOBES = [
    pytest.param(
        lambda c: phase.isotropic(c),
        lambda u: phase.sample_isotropic(u),
        phase.mean_cosine_isotropic(),
        id="isotropic",
    ),
    pytest.param(
        lambda c: phase.rayleigh(c),
        lambda u: phase.sample_rayleigh(u),
        phase.mean_cosine_rayleigh(),
        id="rayleigh",
    ),
]


def _lobe(name, *arguments):
    return pytest.param(
        lambda c: getattr(phase, name)(c, *arguments),
        lambda u: getattr(phase, f"sample_{name}")(u, *arguments),
        getattr(phase, f"mean_cosine_{name}")(*arguments),
        id=f"{name}{arguments}",
    )


LOBES += [
    _lobe("henyey_greenstein", g) for g in (0.0, 1e-9, 0.3, -0.7, 0.95, 0.99)
]
LOBES += [
    _lobe("dual_henyey_greenstein", 0.8, -0.3, 0.25),
    _lobe("dual_henyey_greenstein", 0.99, 0.2, 1.0),
]
LOBES += [_lobe("schlick", k) for k in (0.0, 0.2, -0.6, 0.4999, 0.5001, 0.98)]
LOBES += [_lobe("cornette_shanks", g) for g in (0.0, 0.6, -0.9)]
LOBES += [
    _lobe("draine", g, a)
    for g, a in [(0.0, 3.0), (0.5, 27.0), (-0.8, 250.0), (0.99, 1.0), (0.3, 1e12)]
]
LOBES += [_lobe("mie_fit", d) for d in (0.05, 0.7, 3.0, 5.0, 20.0, 50.0)]


def over_sphere(p, weight=lambda c: 1.0, lower=-1.0, upper=1.0):
    """Integral of 2 pi p(c) weight(c) over c, by panels logarithmic towards both poles."""
    nodes, weights = np.polynomial.legendre.leggauss(16)

    def half(sign, first, last):
        first, last = np.log(max(first, 1e-30)), np.log(last)
        panels = int(np.ceil(2 * (last - first)))
        width = (last - first) / panels
        x = first + width * (np.arange(panels)[:, np.newaxis] + (nodes + 1) / 2)
        c = sign * (1 - np.exp(x))
        return np.sum(np.exp(x) * p(c) * weight(c) * weights) * width / 2

    forward = half(1, 1 - upper, 1 - max(lower, 0.0)) if upper > 0 else 0.0
    backward = half(-1, 1 + lower, 1 + min(upper, 0.0)) if lower < 0 else 0.0
    return 2 * np.pi * (forward + backward)


@pytest.mark.parametrize("p, sample, mean", LOBES)
def test_integrates_to_one_with_stated_mean(p, sample, mean):
    assert over_sphere(p) == pytest.approx(1, abs=2e-10)
    assert over_sphere(p, lambda c: c) == pytest.approx(mean, abs=2e-10)


@pytest.mark.parametrize("p, sample, mean", LOBES)
def test_samples_follow_the_density(p, sample, mean):
    rng = np.random.default_rng(20)
    samples = sample(rng.random(40_000))
    assert np.all(np.abs(samples) <= 1)
    # Bins even in angle, with finer ones about the poles.
    edges = np.cos(np.linspace(np.pi, 0, 25))
    fine = 1 - np.array([1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
    edges = np.sort(np.concatenate([edges, fine, -fine]))
    edges[0], edges[-1] = -1, 1
    nodes, weights = np.polynomial.legendre.leggauss(24)
    half = np.diff(edges) / 2
    c = edges[:-1, np.newaxis] + half[:, np.newaxis] * (nodes + 1)
    expected = 2 * np.pi * half * (p(np.clip(c, -1, 1)) @ weights)
    assert chi_square(samples, edges, expected) > 1e-3


def chi_square(samples, edges, probabilities):
    """p-value; neighbouring bins are merged until each expects 10 samples."""
    counts = np.histogram(samples, edges)[0]
    expected = probabilities * len(samples)
    bins, observed, wanted = [], 0, 0.0
    for n, e in zip(counts, expected):
        observed, wanted = observed + n, wanted + e
        if wanted >= 10:
            bins.append((observed, wanted))
            observed, wanted = 0, 0.0
    bins[-1] = (bins[-1][0] + observed, bins[-1][1] + wanted)
    observed, wanted = np.array(bins).T
    assert len(bins) >= 4
    statistic = np.sum((observed - wanted) ** 2 / wanted)
    return stats.chi2.sf(statistic, len(bins) - 1)


def test_chi_square_notices_a_wrong_density():
    rng = np.random.default_rng(3)
    edges = np.linspace(-1, 1, 21)
    uniform = np.full(20, 0.05)
    accepted = [chi_square(rng.uniform(-1, 1, 40_000), edges, uniform) for _ in range(50)]
    assert min(accepted) > 1e-3
    assert chi_square(phase.sample_henyey_greenstein(rng.random(40_000), 0.02), edges, uniform) < (
        1e-3
    )


@pytest.mark.parametrize("backscatter, ior", [(1e-3, 1.04), (0.02, 1.1), (0.1, 1.2), (0.45, 1.8)])
def test_fournier_forand_shares_and_samples(backscatter, ior):
    def p(c):
        return phase.fournier_forand(c, backscatter, ior)

    assert over_sphere(p, upper=0.0) == pytest.approx(backscatter, rel=1e-9)
    with mp.workdps(30):
        # The singularity holds part of the light closer to forward than 1 - c can
        # resolve, so the total and the mean are taken from the literal formula.
        v = literal_slope(backscatter, ior)
        nodes, weights = np.polynomial.legendre.leggauss(16)
        edges = np.concatenate([-np.geomspace(40 / float(-v), 40, 12), np.arange(-38, 1, 2)])
        total = mean_s = 0
        for low, high in zip(edges, edges[1:]):
            for x, w in zip(nodes, weights):
                s = mp.exp((low + high) / 2 + (high - low) / 2 * x)
                p_of_s = literal_fournier_forand_of_s(s, v, ior)
                term = (high - low) / 2 * w * 4 * mp.pi * s * p_of_s
                total, mean_s = total + term, mean_s + s * term
    assert float(total) == pytest.approx(1, abs=1e-12)
    mean = phase.mean_cosine_fournier_forand(backscatter, ior)
    assert mean == pytest.approx(float(1 - 2 * mean_s), abs=1e-10)

    rng = np.random.default_rng(7)
    samples = phase.sample_fournier_forand(rng.random(20_000), backscatter, ior)
    edges = np.sort(np.cos(np.concatenate([np.linspace(np.pi, 0.1, 20), [1e-2, 1e-3]])))
    edges[0] = -1
    log_edges = np.log(1 - edges)
    middle, half = (log_edges[1:] + log_edges[:-1]) / 2, -np.diff(log_edges) / 2
    from_forward = np.exp(middle[:, np.newaxis] + half[:, np.newaxis] * nodes)
    shares = 2 * np.pi * half * ((p(1 - from_forward) * from_forward) @ weights)
    edges, shares = np.append(edges, 1.0), np.append(shares, 1 - np.sum(shares))
    assert chi_square(samples, edges, shares) > 1e-3


@pytest.mark.parametrize(
    "name, arguments",
    [
        ("henyey_greenstein", (0.4,)),
        ("schlick", (0.4,)),
        ("cornette_shanks", (0.4,)),
        ("draine", (0.4, 5.0)),
        ("dual_henyey_greenstein", (0.4, 0.1, 0.3)),
        ("mie_fit", (10.0,)),
        ("fournier_forand", (0.1, 1.2)),
    ],
)
def test_positive_asymmetry_is_forward(name, arguments):
    function = getattr(phase, name)
    assert function(0.99, *arguments) > function(-0.99, *arguments)
    assert getattr(phase, f"mean_cosine_{name}")(*arguments) > 0
    u = (np.arange(2000) + 0.5) / 2000
    assert np.mean(getattr(phase, f"sample_{name}")(u, *arguments)) > 0


@pytest.mark.parametrize("g", [0.0, 1e-12, 0.3, -0.7, 0.999, 1 - 1e-12, -1 + 1e-12])
def test_henyey_greenstein_inversion(g):
    """The distribution function, integrated by hand, gives u back."""
    for u in (1e-12, 0.01, 0.3, 0.5, 0.99):
        c = phase.sample_henyey_greenstein(u, g)
        with mp.workdps(DIGITS):
            g_, u_ = mp.mpf(g), mp.mpf(u)
            if g == 0:
                expected = 2 * u_ - 1
            else:
                root = (1 - g_**2) / (1 - g_ + 2 * g_ * u_)
                expected = (1 + g_**2 - root**2) / (2 * g_)
        assert c == pytest.approx(float(expected), abs=COSINE_ATOL)


@pytest.mark.parametrize("g", [0.0, 0.5, -0.9, 0.9999, 1 - 1e-12])
@pytest.mark.parametrize("alpha", [0.0, 1.0, 250.0, 1e30])
def test_draine_inversion(g, alpha):
    """Polynomial moments of Henyey-Greenstein's t give the distribution function literally."""
    u = np.array([1e-15, 1e-6, 0.1, 0.37, 0.5, 0.9, 1 - 1e-9])
    cosines = phase.sample_draine(u, g, alpha)
    with mp.workdps(80):
        g_, alpha_ = mp.mpf(g), mp.mpf(alpha)
        for u_i, c in zip(u, cosines):
            lower = -1

            def antiderivative(x):
                """Of 2 pi HG (1 + alpha x^2), by y = 1 + g^2 - 2 g x."""
                if g == 0:
                    return (x + alpha_ * x**3 / 3) / 2
                y, b = 1 + g_**2 - 2 * g_ * x, 1 + g_**2
                plain = 2 / mp.sqrt(y)
                squared = (2 * b**2 / mp.sqrt(y) + 4 * b * mp.sqrt(y) - 2 * y**mp.mpf(1.5) / 3) / (
                    4 * g_**2
                )
                return (1 - g_**2) / (4 * g_) * (plain + alpha_ * squared)

            norm = antiderivative(mp.mpf(1)) - antiderivative(mp.mpf(lower))

            def share(x):
                return (antiderivative(mp.mpf(x)) - antiderivative(mp.mpf(lower))) / norm

            # A rounding step of the cosine either way brackets u.
            step = COSINE_ATOL
            assert share(max(c - step, -1)) <= u_i * (1 + 1e-13)
            assert share(min(c + step, 1)) >= u_i * (1 - 1e-13)


@pytest.mark.parametrize(
    "name, arguments",
    [("isotropic", ()), ("rayleigh", ()), ("henyey_greenstein", (-0.9,)), ("schlick", (0.9,)),
     ("cornette_shanks", (0.8,)), ("draine", (0.7, 30.0)), ("fournier_forand", (0.05, 1.1))],
)  # fmt: skip
def test_single_lobes_map_the_unit_interval_upwards(name, arguments):
    u = np.linspace(0, 1, 1001)
    cosines = getattr(phase, f"sample_{name}")(u, *arguments)
    np.testing.assert_allclose(cosines[[0, -1]], [-1, 1], rtol=3e-16)
    assert np.all(np.diff(cosines) >= 0)


def test_schlick_k():
    # 1.55 * 0.5 - 0.55 * 0.125
    assert phase.schlick_k(0.5) == pytest.approx(0.70625, rel=1e-15)
    assert phase.schlick_k(-0.938) > -1
    with pytest.raises(ValueError, match="henyey_greenstein"):
        phase.schlick_k(0.9382)


@pytest.mark.parametrize("k", [1e-300, 1e-8, 0.1, 0.4999999, 0.5, -0.7, 0.999, 1 - 1e-12])
def test_mean_cosine_schlick_to_full_precision(k):
    with mp.workdps(DIGITS):
        k_ = mp.mpf(k)
        expected = 1 / k_ - (1 - k_**2) / k_**2 * mp.atanh(k_)
        if abs(k) < 1e-20:
            expected = 2 * k_ / 3
    assert phase.mean_cosine_schlick(k) == pytest.approx(float(expected), rel=2e-15)


# --- arrays, extremes and errors ----------------------------------------------


def test_broadcasting_and_dtypes():
    c = np.linspace(-1, 1, 5, dtype=np.float32)[:, np.newaxis]
    g = np.array([0.1, 0.5, -0.5], dtype=np.float32)
    values = phase.henyey_greenstein(c, g)
    assert values.shape == (5, 3) and values.dtype == np.float64
    assert phase.fournier_forand(c, 0.1, np.array([1.1, 1.2])).shape == (5, 2)
    assert phase.sample_fournier_forand(np.full((4, 1), 0.5), 0.1, [1.1, 1.2]).shape == (4, 2)
    assert phase.mie_fit(c, [5.0, 1.0, 0.05, 3.0]).shape == (5, 4)
    assert phase.mean_cosine_fournier_forand([[0.1], [0.2]], [1.1, 1.2, 1.3]).shape == (2, 3)
    assert np.ndim(phase.fournier_forand(0.5, 0.1, 1.1)) == 0
    assert np.ndim(phase.sample_draine(0.5, 0.1, 1.1)) == 0


@pytest.mark.parametrize(
    "name, arguments",
    [("isotropic", ()), ("rayleigh", ()), ("henyey_greenstein", (0.5,)), ("schlick", (0.5,)),
     ("dual_henyey_greenstein", (0.5, 0.1, 0.2)), ("cornette_shanks", (0.5,)),
     ("draine", (0.5, 2.0)), ("mie_fit", (10.0,)), ("fournier_forand", (0.1, 1.1))],
)  # fmt: skip
def test_empty_and_nan(name, arguments):
    function, sample = getattr(phase, name), getattr(phase, f"sample_{name}")
    assert function(np.empty((0, 3)), *arguments).shape == (0, 3)
    assert sample(np.empty(0), *arguments).shape == (0,)
    for bad in (np.nan, 1.1, -1.5, np.inf):
        with pytest.raises(ValueError, match="cos_theta must be in"):
            function([0.5, bad], *arguments)
    for bad in (np.nan, -0.1, 1.1):
        with pytest.raises(ValueError, match="u must be in"):
            sample([0.5, bad], *arguments)


def test_rounding_beyond_one_is_clipped():
    assert phase.henyey_greenstein(1 + 4e-16, 0.5) == phase.henyey_greenstein(1.0, 0.5)
    assert phase.henyey_greenstein(np.float32(1 + 3e-7), 0.5) == phase.henyey_greenstein(1.0, 0.5)
    with pytest.raises(ValueError, match="normalised"):
        phase.henyey_greenstein(1 + 1e-9, 0.5)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: phase.henyey_greenstein(0.0, 1.0), r"g must be in \(-1, 1\), got 1.0; at \+-1"),
        (lambda: phase.dual_henyey_greenstein(0, 0, 0, 1.5), "weight must be in .0, 1., got 1.5"),
        (lambda: phase.schlick(0.0, -1.0), "k must be in .* got -1.0; .*schlick_k"),
        (lambda: phase.draine(0.0, 0.5, -1.0), "alpha must be .* got -1.0"),
        (lambda: phase.mie_fit(0.0, 51.0), "droplet_diameter must be in .* got 51.0"),
        (lambda: phase.mie_fit(0.0, [5.0, 0.0]), "droplet_diameter must be in .* got 0.0"),
        (lambda: phase.fournier_forand(0.0, 0.5, 1.1), "backscatter must be in .* got 0.5"),
        (lambda: phase.fournier_forand(0.0, 0.1, 1.0), "ior must be in .* got 1.0"),
    ],
)
def test_errors_name_value_and_remedy(call, message):
    with pytest.raises(ValueError, match=message):
        call()


units = st.floats(0, 1)
cosines = st.floats(-1, 1)
asymmetries = st.floats(-1 + 1e-12, 1 - 1e-12)


@settings(max_examples=150, deadline=None)
@given(cosines, units, asymmetries, st.floats(0, 1e30), st.floats(1e-6, 50))
def test_values_and_samples_stay_in_range(c, u, g, alpha, diameter):
    for value in (
        phase.henyey_greenstein(c, g),
        phase.schlick(c, g),
        phase.draine(c, g, alpha),
        phase.mie_fit(c, diameter),
    ):
        assert np.isfinite(value) and value >= 0
    for sample in (
        phase.sample_henyey_greenstein(u, g),
        phase.sample_schlick(u, g),
        phase.sample_draine(u, g, alpha),
        phase.sample_mie_fit(u, diameter),
    ):
        assert -1 <= sample <= 1


@settings(max_examples=60, deadline=None)
@given(cosines, units, st.floats(1e-9, 0.499999), st.floats(1 + 1e-12, 1000))
def test_fournier_forand_stays_in_range(c, u, backscatter, ior):
    value = phase.fournier_forand(c, backscatter, ior)
    assert value > 0 and (np.isfinite(value) or c == 1)
    assert -1 <= phase.sample_fournier_forand(u, backscatter, ior) <= 1
