# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity maps against the literal transmittance of the slices, and their errors against the true ones."""

import math

import numpy as np
import pytest
from scipy import fft
from scipy.integrate import quad

from volumetrics_addon.physics import opacity_map

INF = np.inf
LENGTH = 3.0
RNG = np.random.default_rng(1)
# Clumps with gaps between them, a smooth hump, nothing, a wall, and uniform fog: 5 x 96 slices.
SLICES = 96
CENTRES = (np.arange(SLICES) + 0.5) / SLICES
EXTINCTION = np.array(
    [
        RNG.gamma(0.3, 4.0, SLICES), 3 * np.exp(-40 * (CENTRES - 0.4) ** 2), np.zeros(SLICES),
        np.where(CENTRES > 0.6, 200.0, 0.0), np.full(SLICES, 0.7),
    ]
)  # fmt: skip

MAPS = {
    "volume": lambda e, l, **o: opacity_map.extinction_volume(e, l, 24, **o),
    "volume of all slices": lambda e, l, **o: opacity_map.extinction_volume(e, l, SLICES, **o),
    "volume askew": lambda e, l, **o: opacity_map.extinction_volume(e, l, 7, **o),
    "deep": lambda e, l, **o: opacity_map.deep_shadow_map(e, l, 0.01, **o),
    "deep, coarse": lambda e, l, **o: opacity_map.deep_shadow_map(e, l, 0.2, **o),
    "fourier": lambda e, l, **o: opacity_map.fourier_opacity_map(e, l, 7, **o),
    "fourier, constant": lambda e, l, **o: opacity_map.fourier_opacity_map(e, l, 0, **o),
    "dct": lambda e, l, **o: opacity_map.dct_opacity_map(e, l, 8, **o),
    "dct of all slices": lambda e, l, **o: opacity_map.dct_opacity_map(e, l, SLICES, **o),
}
MONOTONE = {name for name in MAPS if name.startswith(("volume", "deep"))}
assert len(MONOTONE) == 5


@pytest.fixture(params=MAPS)
def name(request):
    return request.param


def exact(extinction, length, depth):
    """Transmittance of constant slices, one ray and one depth at a time."""
    n = len(extinction)
    whole = math.floor(depth / length * n)
    tau = sum(extinction[:whole]) * length / n
    if whole < n:
        tau += extinction[whole] * (depth - whole * length / n)
    return math.exp(-tau)


DEPTHS = np.linspace(0, LENGTH, 1501)
EXACT = np.array([[exact(row, LENGTH, depth) for row in EXTINCTION] for depth in DEPTHS])


def test_error_estimate_is_the_true_error(name):
    found = MAPS[name](EXTINCTION, LENGTH)
    assert found.error_estimate.shape == (5,)
    values = found.transmittance(DEPTHS[:, np.newaxis])
    error = np.max(np.abs(values - EXACT), axis=0)
    # Between the compared depths there is a little more.
    assert np.all(error <= 1.05 * found.error_estimate + 1e-13)
    assert np.all(found.error_estimate <= 1.05 * error + 1e-13)
    assert np.all((values >= 0) & (values <= 1))
    if name in MONOTONE:
        assert np.all(np.diff(values, axis=0) <= 1e-15)
        np.testing.assert_array_equal(values[0], 1.0)


def test_volume_of_all_slices_is_exact():
    found = opacity_map.extinction_volume(EXTINCTION, LENGTH, SLICES)
    np.testing.assert_allclose(found.transmittance(DEPTHS[:, np.newaxis]), EXACT, rtol=1e-12, atol=1e-15)
    # The rounding of 97 sums, 2.2e-14.
    assert np.all(found.error_estimate < 5e-14)
    assert found.numbers == SLICES


@pytest.mark.parametrize("tolerance", [0.3, 0.05, 1e-3, 1e-6])
def test_deep_shadow_map_keeps_its_promise(tolerance):
    found = opacity_map.deep_shadow_map(EXTINCTION, LENGTH, tolerance)
    ends = np.linspace(0, LENGTH, SLICES + 1)
    truth = np.array([[exact(row, LENGTH, depth) for row in EXTINCTION] for depth in ends])
    error = np.abs(found.transmittance(ends[:, np.newaxis]) - truth)
    assert np.all(error <= tolerance + 1e-14)
    # It uses what it may: the clumps come close to the tolerance.
    assert np.max(error[:, 0]) > 0.5 * tolerance
    places, values = found.table
    assert np.all(np.diff(places, axis=-1) >= 0) and np.all(np.diff(values, axis=-1) <= 0)
    assert found.numbers == 2 * places.shape[-1]


def test_deep_shadow_map_takes_few_nodes():
    nothing = opacity_map.deep_shadow_map(EXTINCTION[2], LENGTH, 0.01)
    # In the middle of the slopes allowed, half the tolerance off at its end.
    assert nothing.numbers == 4 and nothing.error_estimate == pytest.approx(0.005)
    # The optimal polyline for exp(-x) on [0, 1.05] within 0.01 has pieces of error h^2 / 16: h = 0.4 at T = 1.
    fog = opacity_map.deep_shadow_map(np.full(1000, 0.35), LENGTH, 0.01)
    assert 3 <= fog.numbers / 2 <= 5
    finer = opacity_map.deep_shadow_map(np.full(1000, 0.35), LENGTH, 0.01 / 16)
    assert 2.5 < (finer.numbers / 2 - 1) / (fog.numbers / 2 - 1) < 6


def test_fourier_coefficients_are_the_integrals():
    """Against SciPy's quadrature of the literal formulas (Jansen and Bavoil, eq. 2 and 4)."""
    found = opacity_map.fourier_opacity_map(EXTINCTION[:2], LENGTH, 3)
    for ray in range(2):
        density = EXTINCTION[ray] * LENGTH
        for k in range(1, 4):
            pieces = [(j / SLICES, (j + 1) / SLICES) for j in range(SLICES)]
            a, b = (
                sum(quad(lambda x: 2 * d * wave(2 * np.pi * k * x), *p)[0] for d, p in zip(density, pieces))
                for wave in (np.cos, np.sin)
            )
            assert found.table[1][ray, k - 1] == pytest.approx(a, rel=1e-12, abs=1e-12)
            assert found.table[2][ray, k - 1] == pytest.approx(b, rel=1e-12, abs=1e-12)
    assert found.numbers == 7


def test_fourier_map_of_one_wave_is_exact():
    """A cosine of extinction on many slices: only the slices' own steps remain."""
    found = opacity_map.fourier_opacity_map(lambda d: 1 + np.cos(2 * np.pi * d / LENGTH), LENGTH, 1, slices=512)
    depth = np.linspace(0, LENGTH, 50)
    tau = depth + np.sin(2 * np.pi * depth / LENGTH) * LENGTH / (2 * np.pi)
    error = np.max(np.abs(found.transmittance(depth) - np.exp(-tau)))
    assert error <= found.error_estimate < 1e-3


def test_dct_coefficients_are_scipys():
    found = opacity_map.dct_opacity_map(EXTINCTION[:2], LENGTH, 10)
    centres = CENTRES * LENGTH
    truth = np.array([[exact(row, LENGTH, depth) for depth in centres] for row in EXTINCTION[:2]])
    expected = fft.dct(truth, type=2)[:, :10] / SLICES
    expected[:, 0] /= 2
    np.testing.assert_allclose(found.table[0], expected, rtol=1e-11, atol=1e-13)
    # Parseval: the mean square of the error at the centres is that of the coefficients left out.
    left_out = fft.dct(truth, type=2, norm="ortho")[:, 10:]
    raw = found.look_up(CENTRES[:, np.newaxis], *found.table)
    np.testing.assert_allclose(np.mean((raw.T - truth) ** 2, axis=1), np.mean(left_out**2, axis=1) * 86 / 96, rtol=1e-9)


@pytest.mark.parametrize("slices", [16, 64, 256])
def test_callable_extinction(name, slices):
    """Against the closed form of a linear and a quadratic extinction: the slices' steps are in the estimate."""

    def extinction(depth):
        return np.stack([0.5 + depth, 0.2 * depth**2])

    if "all slices" in name and slices < SLICES:
        slices = SLICES
    found = MAPS[name](extinction, LENGTH, slices=slices)
    truth = np.exp(-np.stack([0.5 * DEPTHS + DEPTHS**2 / 2, 0.2 / 3 * DEPTHS**3], axis=1))
    error = np.max(np.abs(found.transmittance(DEPTHS[:, np.newaxis]) - truth), axis=0)
    assert np.all(error <= found.error_estimate)
    assert np.all(found.error_estimate < 3 * error + 4 / slices**2 * 3)


def test_more_numbers_are_better():
    smooth = EXTINCTION[1]
    for build, counts in (
        (opacity_map.extinction_volume, (4, 8, 16)), (opacity_map.fourier_opacity_map, (0, 1, 3)),
        (opacity_map.dct_opacity_map, (4, 8, 16)),
    ):  # fmt: skip
        errors = [build(smooth, LENGTH, count).error_estimate for count in counts]
        assert errors[0] > 1.5 * errors[1] > 2 * errors[2] > 0


def test_shapes(name):
    build = MAPS[name]
    rays = np.broadcast_to(EXTINCTION[:, np.newaxis], (5, 2, SLICES)).astype(np.float32)
    found = build(rays, np.array([3.0, 1.0]))
    assert found.error_estimate.shape == (5, 2)
    whole = found.transmittance(np.array([3.0, 1.0]))
    assert whole.shape == (5, 2)
    np.testing.assert_array_equal(found.transmittance(INF), whole)
    assert found.transmittance(np.linspace(0, 3, 7)[:, np.newaxis, np.newaxis]).shape == (7, 5, 2)
    one = build(rays[0, 1], 1.0)
    assert np.ndim(one.error_estimate) == np.ndim(one.transmittance(0.5)) == 0
    np.testing.assert_allclose(found.transmittance(0.5)[0, 1], one.transmittance(0.5), rtol=1e-12)
    assert one.transmittance([]).shape == (0,)
    empty = build(np.empty((0, 4)), 1.0)
    assert empty.error_estimate.shape == empty.transmittance(0.5).shape == (0,)


@pytest.mark.parametrize("value", [0.0, 5e-324, 1e-30, 1e30, 1e308])
@pytest.mark.parametrize("length", [1e-30, 1.0, 1e30])
def test_extremes(name, value, length):
    found = MAPS[name](np.full((2, 5), value), length)
    values = found.transmittance(np.array([0.0, 5e-324, length / 3, length, INF])[:, np.newaxis])
    assert np.all((values >= 0) & (values <= 1)) and np.all(np.isfinite(found.error_estimate))
    if value * length < 1e-20 and "deep" not in name:
        np.testing.assert_allclose(values, 1.0, rtol=1e-12)


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("extinction_volume", -EXTINCTION, 1.0, 4), "extinction .* got -.*; clip or mask"),
        (("extinction_volume", 1.0, 1.0, 4), r"extinction must have shape \(..., n\), n > 0, got \(\)"),
        (("extinction_volume", EXTINCTION, 0.0, 4), "length .* got 0.0"),
        (("extinction_volume", EXTINCTION, 1.0, 0), "count must be an integer >= 1, got 0"),
        (("fourier_opacity_map", EXTINCTION, 1.0, -1), "frequencies must be an integer >= 0, got -1"),
        (("dct_opacity_map", EXTINCTION, np.nan, 4), "length .* got nan"),
        (("deep_shadow_map", EXTINCTION, 1.0, 1.0), r"tolerance must be in \(0, 1\), got 1.0"),
        (("dct_opacity_map", lambda d: 1.0, 1.0, 4), r"extinction\(depths\) must have shape \(..., 1024\), got \(\)"),
        (("dct_opacity_map", lambda d: d, [1.0], 4), "length must be one number for a callable"),
        (("dct_opacity_map", lambda d: d, 1.0, 4, 1), "slices must be an integer >= 2, got 1"),
    ],
)
def test_errors_name_value_and_remedy(arguments, message):
    with pytest.raises(ValueError, match=message):
        getattr(opacity_map, arguments[0])(*arguments[1:])


def test_depth_errors():
    with pytest.raises(ValueError, match="depth .* got -1.0"):
        opacity_map.dct_opacity_map(EXTINCTION, 1.0, 4).transmittance(-1.0)
