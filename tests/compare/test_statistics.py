# SPDX-License-Identifier: GPL-3.0-or-later
"""The statistics themselves are tested: false alarms under a true null, power, coverage, bias."""

import json
import math
import statistics as stdlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from volumetrics_addon.compare import statistics
from volumetrics_addon.compare.statistics import (
    Estimate,
    compare,
    normal_isf,
    normal_sf,
    student_t_isf,
    student_t_sf,
)

GRADIENT = np.linspace(0.2, 2.0, 16)[None, :, None] * np.ones((16, 16, 3)) * (1.0, 0.8, 0.6)


# Noise of relative standard deviation `size`, mean 1, k repeats of a shape.


def gaussian(rng, shape, size=0.3):
    return 1.0 + size * rng.standard_normal(shape)


def exponential(rng, shape):
    return rng.exponential(1.0, shape)


def gamma(rng, shape):
    return rng.gamma(0.2, 5.0, shape)


def spikes(rng, shape):
    """Half of the light steady, half in one of a hundred samples."""
    return 0.5 * gaussian(rng, shape, 0.1) + 50.0 * (rng.random(shape) < 0.01)


def rare(rng, shape):
    """All of the light in one of a hundred samples."""
    return 100.0 * (rng.random(shape) < 0.01)


NOISES = (gaussian, exponential, gamma, spikes, rare)


def noisy(rng, noise, repeats, image=GRADIENT):
    return image * noise(rng, (repeats, *image.shape))


def binomial_limits(trials, probability, risk=1e-6):
    """Counts that a fair test leaves with less than `risk` on either side."""
    return stats.binom.ppf(risk, trials, probability), stats.binom.isf(risk, trials, probability)


def filled(value, shape=(2, 2, 3)):
    return np.full(shape, value)


# Distributions


@pytest.mark.parametrize("dof", [1, 2, 3, 7, 15.5, 48, 147, 675, 3000, 9999, 10001, 1e5, 1e9])
def test_student_t_tail_agrees_with_scipy(dof):
    t = np.concatenate(([0.0], stats.t.isf(np.logspace(-12, -0.31, 60), dof)))
    np.testing.assert_allclose(student_t_sf(t, dof), stats.t.sf(t, dof), rtol=1e-10)
    np.testing.assert_allclose(student_t_sf(-t, dof), stats.t.sf(-t, dof), rtol=1e-10)


@pytest.mark.parametrize("dof", [1, 2, 3, 15.5, 147, 3000, 10001, 1e9])
def test_student_t_quantile_agrees_with_scipy(dof):
    p = np.concatenate((np.logspace(-12, -0.31, 60), [0.5, 0.7, 0.999]))
    np.testing.assert_allclose(student_t_isf(p, dof), stats.t.isf(p, dof), rtol=1e-10, atol=1e-15)


def test_student_t_closed_forms():
    t = np.array([1e-8, 0.3, 2.0, 50.0, 1e5])
    cauchy = np.arctan(1.0 / t) / math.pi
    two = 1.0 / (np.sqrt(2.0 + t**2) * (np.sqrt(2.0 + t**2) + t))
    np.testing.assert_allclose(student_t_sf(t, 1.0), cauchy, rtol=1e-12)
    np.testing.assert_allclose(student_t_sf(t, 2.0), two, rtol=1e-12)


def test_normal_agrees_with_scipy():
    p = np.logspace(-300, -0.01, 100)
    np.testing.assert_allclose(normal_isf(p), stats.norm.isf(p), rtol=1e-12)
    x = np.linspace(-8.0, 30.0, 100)
    np.testing.assert_allclose(normal_sf(x), stats.norm.sf(x), rtol=1e-12)
    np.testing.assert_allclose(student_t_sf(x, math.inf), stats.norm.sf(x), rtol=1e-12)
    np.testing.assert_allclose(student_t_isf(p, math.inf), stats.norm.isf(p), rtol=1e-12)


@pytest.mark.parametrize("p", [0.0, 1.0, -0.1, math.nan])
def test_quantiles_refuse_what_is_no_probability(p):
    with pytest.raises(ValueError, match="p must be between 0 and 1"):
        student_t_isf(p, 3.0)


def test_tail_refuses_no_degrees_of_freedom():
    with pytest.raises(ValueError, match=r"dof must be > 0, got 0\.0"):
        student_t_sf(1.0, 0.0)


# Estimates


def test_estimate_from_repeats_is_mean_and_standard_error():
    images = np.random.default_rng(1).gamma(1.0, 1.0, (5, 2, 3, 3))
    estimate = Estimate.from_repeats(images)
    for index in np.ndindex(2, 3, 3):
        samples = [float(image[index]) for image in images]
        assert estimate.value[index] == pytest.approx(stdlib.mean(samples), rel=1e-12)
        error = stdlib.stdev(samples) / math.sqrt(5)
        assert estimate.standard_error[index] == pytest.approx(error, rel=1e-12)
        third = stats.skew(samples, bias=False) * stdlib.variance(samples) ** 1.5 / 25
        # scipy's G1 divides by s**3: times s**3 it is the unbiased third moment.
        assert estimate.third_cumulant[index] == pytest.approx(third, rel=1e-9)
    means = [float(image.mean()) for image in images]
    assert estimate.mean_value == pytest.approx(stdlib.mean(means), rel=1e-12)
    assert estimate.mean_standard_error == pytest.approx(stdlib.stdev(means) / math.sqrt(5))


def test_mean_error_honours_correlation_between_pixels():
    # All pixels of a repeat share one error, so averaging over pixels does not reduce it.
    images = np.ones((6, 8, 8, 3)) + np.arange(6.0)[:, None, None, None]
    estimate = Estimate.from_repeats(images)
    assert estimate.mean_standard_error == pytest.approx(math.sqrt(3.5 / 6))


def test_equal_repeats_have_exactly_no_error():
    image = np.random.default_rng(2).random((3, 4, 3))
    estimate = Estimate.from_repeats(np.stack([image] * 3))
    assert np.array_equal(estimate.value, image)
    assert not estimate.standard_error.any()


def test_known_errors_are_independent():
    estimate = Estimate.from_errors(filled(1.0), filled(0.3))
    assert estimate.mean_standard_error == pytest.approx(0.3 / math.sqrt(12))
    assert estimate.repeats is None
    assert Estimate.exact(filled(1.0)).mean_standard_error == 0.0


def test_estimate_keeps_its_own_copy():
    image = filled(1.0)
    estimate = Estimate.exact(image)
    image[:] = 7.0
    assert np.all(estimate.value == 1.0)
    with pytest.raises(ValueError, match="read-only"):
        estimate.value[0, 0, 0] = 2.0


@pytest.mark.parametrize("fault", [math.nan, math.inf, -math.inf])
def test_faults_are_counted_and_located(fault):
    image = np.ones((4, 5, 3))
    image[2, 3, 1] = image[3, 0, 0] = fault
    with pytest.raises(ValueError, match=r"2 of 60 values .* row 2, column 3, channel 1"):
        Estimate.exact(image)
    with pytest.raises(
        ValueError, match=r"2 of 120 values .* repeat 1, row 2, column 3, channel 1"
    ):
        Estimate.from_repeats(np.stack((np.ones((4, 5, 3)), image)))
    with pytest.raises(ValueError, match="standard_error must be finite"):
        Estimate.from_errors(np.ones((4, 5, 3)), image)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Estimate.exact(np.ones((4, 5))), r"shape \(height, width, 3\), got \(4, 5\)"),
        (lambda: Estimate.exact(np.ones((0, 5, 3))), r"got \(0, 5, 3\)"),
        (lambda: Estimate.from_repeats(np.ones((4, 5, 3))), r"\(repeats, height, width, 3\)"),
        (lambda: Estimate.from_repeats(np.ones((1, 4, 5, 3))), ">= 2 repeats, got 1"),
        (lambda: Estimate.from_errors(filled(1.0), filled(-0.2)), r">= 0, got -0\.2"),
        (
            lambda: Estimate(filled(1.0), np.ones((1, 2, 3)), None, 1.0, 0.0),
            "have the shape of value",
        ),
        (lambda: Estimate(filled(1.0), filled(1.0), 1, 1.0, 0.0), "repeats must be >= 2, got 1"),
    ],
)
def test_estimate_refuses(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Means


def test_mean_p_value_is_welchs_test():
    rng = np.random.default_rng(3)
    a, b = rng.normal(1.0, 0.1, (4, 6, 5, 3)), rng.normal(1.02, 0.3, (7, 6, 5, 3))
    result = compare(Estimate.from_repeats(a), Estimate.from_repeats(b))
    welch = stats.ttest_ind(a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3)), equal_var=False)
    assert result.mean_p_value == pytest.approx(welch.pvalue, rel=1e-9)
    assert result.mean_degrees_of_freedom == pytest.approx(welch.df, rel=1e-9)
    interval = welch.confidence_interval(0.95)
    assert result.mean_difference_interval == pytest.approx((interval.low, interval.high))


def test_exact_images_have_an_exact_error():
    result = compare(Estimate.exact(filled(1.03)), Estimate.exact(filled(1.0)))
    assert result.mean_relative_error == pytest.approx(0.03)
    assert result.mean_relative_interval == pytest.approx((0.03, 0.03))
    assert result.worst_mean_error == pytest.approx(0.03)
    assert result.mean_p_value == 0.0
    assert compare(Estimate.exact(filled(1.0)), Estimate.exact(filled(1.0))).mean_p_value == 1.0


@pytest.mark.parametrize(
    ("noise", "repeats", "reference_repeats"),
    [(gaussian, 4, None), (gaussian, 4, 8), (gamma, 8, None)],
)
def test_interval_of_the_mean_error_covers_the_truth(noise, repeats, reference_repeats):
    rng = np.random.default_rng(4)
    image, bias, trials = np.ones((4, 4, 3)), 0.03, 800
    covered = 0
    for _ in range(trials):
        render = Estimate.from_repeats((1.0 + bias) * noisy(rng, noise, repeats, image))
        reference = (
            Estimate.from_repeats(noisy(rng, noise, reference_repeats, image))
            if reference_repeats
            else Estimate.exact(image)
        )
        low, high = compare(render, reference).mean_relative_interval
        covered += low <= bias <= high
    assert 0.93 <= covered / trials <= 0.97


def test_mean_finds_a_bias_of_two_percent():
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(100):
        render = Estimate.from_repeats(1.02 * noisy(rng, gaussian, 8))
        low, high = compare(render, Estimate.exact(GRADIENT)).mean_relative_interval
        found += not low <= 0.0 <= high
    assert found >= 95


# Pixels


@pytest.mark.parametrize("reference_repeats", [None, 4])
@pytest.mark.parametrize("repeats", [4, 8, 16])
@pytest.mark.parametrize("noise", NOISES)
def test_pixel_test_raises_no_more_false_alarms_than_stated(noise, repeats, reference_repeats):
    rng = np.random.default_rng(6)
    trials, significance = 20, 0.05
    alarms = 0
    for _ in range(trials):
        render = Estimate.from_repeats(noisy(rng, noise, repeats))
        reference = (
            Estimate.from_repeats(noisy(rng, noise, reference_repeats))
            if reference_repeats
            else Estimate.exact(GRADIENT)
        )
        result = compare(render, reference, significance=significance)
        alarms += result.z_pass_fraction < 1.0
        assert result.z_pass_fraction >= 0.99
    assert alarms <= binomial_limits(trials, significance, 1e-4)[1]


@pytest.mark.sweep
@pytest.mark.parametrize("contrast", [1.0, 100.0])
@pytest.mark.parametrize("repeats", [4, 8, 16])
@pytest.mark.parametrize("noise", NOISES)
def test_false_alarms_at_one_percent(noise, repeats, contrast):
    rng = np.random.default_rng(16)
    trials, significance = 1000, 0.01
    image = np.where(np.arange(32) < 16, contrast, 1.0)[None, :, None] * np.ones((32, 32, 3))
    alarms = sum(
        compare(
            Estimate.from_repeats(noisy(rng, noise, repeats, image)), Estimate.exact(image)
        ).z_pass_fraction
        < 1.0
        for _ in range(trials)
    )
    assert alarms <= binomial_limits(trials, significance, 1e-4)[1]


def test_pixel_test_with_known_errors_has_the_stated_level():
    rng = np.random.default_rng(7)
    trials, significance, image = 1000, 0.2, np.ones((4, 4, 3))
    error = rng.uniform(0.01, 1.0, image.shape)
    reference = Estimate.from_errors(image, error)
    alarms = sum(
        compare(
            Estimate.from_errors(
                image + 2.0**0.5 * error * rng.standard_normal(image.shape), error
            ),
            reference,
            significance=significance,
        ).z_pass_fraction
        < 1.0
        for _ in range(trials)
    )
    low, high = binomial_limits(trials, significance)
    assert low <= alarms <= high


def test_own_variance_alone_would_raise_false_alarms():
    """The trap: repeats without a bright sample show hardly any variance and too low a mean."""
    repeats = noisy(np.random.default_rng(8), spikes, 4)
    t = (repeats.mean(0) - GRADIENT) / (repeats.std(0, ddof=1) / 2.0)
    level = 1.0 - (1.0 - 0.01) ** (1.0 / t.size)
    p = 2.0 * stats.t.sf(np.abs(t), 3)
    assert np.mean(p < 1e-3) > 0.5  # a thousandth expected
    result = compare(Estimate.from_repeats(repeats), Estimate.exact(GRADIENT))
    assert result.z_pass_fraction == 1.0
    # While the variance pooled over the image would miss what its own t-test cannot reject.
    assert np.mean(p < level) < 0.5


def test_symmetric_normal_tail_would_raise_false_alarms():
    """Even with the true variance, a skewed mean reaches far beyond the normal's tail."""
    repeats = np.random.default_rng(9).gamma(0.2, 5.0, (4, 64, 64, 3))
    z = (repeats.mean(0) - 1.0) / math.sqrt(5.0 / 4.0)
    critical = stats.norm.isf(0.5 * 0.01 / z.size)
    assert np.sum(z > critical) > 10  # one in a hundred images expected
    result = compare(Estimate.from_repeats(repeats), Estimate.exact(np.ones((64, 64, 3))))
    assert result.z_pass_fraction == 1.0


@pytest.mark.parametrize(
    ("in_reference", "skewness", "passes"),
    [(False, 1.0, True), (False, -1.0, False), (True, -1.0, True), (True, 1.0, False)],
)
def test_skewed_noise_is_forgiven_towards_its_long_tail(in_reference, skewness, passes):
    """A render 4 standard errors above its reference, at 4.2e-4 on each side (12 tests, 1 %)."""
    level = 0.5 * (1.0 - 0.99 ** (1.0 / 12.0))
    assert stats.pearson3.sf(4.0, 1.0) > level > stats.norm.sf(4.0)
    value = 1.0 if in_reference else 5.0
    skewed = Estimate(filled(value), filled(1.0), None, value, 0.3, filled(skewness))
    exact = Estimate.exact(filled(5.0 if in_reference else 1.0))
    result = compare(exact, skewed) if in_reference else compare(skewed, exact)
    assert (result.z_pass_fraction == 1.0) is passes


@pytest.mark.parametrize("repeats", [4, 8, 16])
def test_pixel_test_finds_a_local_defect(repeats):
    """10 % in 1 % of the pixels, with 1.25 % of noise in each pixel's mean."""
    rng = np.random.default_rng(10)
    image = np.linspace(0.2, 2.0, 40)[None, :, None] * np.ones((40, 40, 3))
    defect = np.zeros((40, 40), dtype=bool)
    defect[20:24, 10:14] = True
    rendered = np.where(defect[..., None], 1.1 * image, image)
    found = 0
    for _ in range(20):
        noise = gaussian(rng, (repeats, *image.shape), 0.0125 * math.sqrt(repeats))
        result = compare(Estimate.from_repeats(rendered * noise), Estimate.exact(image))
        found += result.z_pass_fraction < 0.9975
        assert np.mean(result.pixel_passes[~defect]) > 0.999
        assert np.mean(result.pixel_passes[defect]) < 0.25
    assert found == 20


def test_sign_of_z_is_the_sign_of_the_error():
    rng = np.random.default_rng(11)
    image = np.ones((8, 8, 3))
    image[:, 4:] = 2.0
    render = Estimate.from_repeats(noisy(rng, gaussian, 4, np.full((8, 8, 3), 1.5)))
    z = compare(render, Estimate.exact(image)).z
    assert np.all(z[:, :4].mean() > 0.0) and np.all(z[:, 4:].mean() < 0.0)


@given(st.floats(0.01, 8.0), st.floats(0.05, 2.0))
@settings(max_examples=50, deadline=None)
def test_normal_score_maps_a_gamma_tail_to_the_normals(z, skewness):
    """Wilson-Hilferty against scipy's Pearson III: a factor of two in the tail at most."""
    tail = stats.pearson3.sf(z, skewness)
    score = statistics._normal_score(np.array([z]), np.array([skewness]))
    # Where the score would exceed z it is held there, which only raises the p-value.
    if score[0] < z and tail > 1e-9:
        assert 0.5 < stats.norm.sf(score[0]) / tail < 2.0


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_normal_score_never_sharpens(z, skewness):
    score = statistics._normal_score(np.array([z]), np.array([skewness]))[0]
    assert abs(score) <= abs(z)
    assert score * z >= 0.0


def test_pixels_without_noise_pass_within_float32_rounding_only():
    image = np.random.default_rng(12).uniform(1e-6, 1e6, (16, 16, 3))
    stored = image.astype(np.float32).astype(np.float64)
    assert compare(Estimate.exact(stored), Estimate.exact(image)).z_pass_fraction == 1.0
    stored[3, 4, 1] *= 1.0 + 2.0**-21
    result = compare(Estimate.exact(stored), Estimate.exact(image))
    assert np.argwhere(~result.pixel_passes).tolist() == [[3, 4]]
    assert result.z[3, 4, 1] == math.inf
    assert np.count_nonzero(result.z) == 1


def test_repeats_without_any_spread_count_as_exact():
    image = np.ones((8, 8, 3))
    result = compare(Estimate.from_repeats(np.stack([1.001 * image] * 3)), Estimate.exact(image))
    assert result.z_pass_fraction == 0.0
    assert result.mean_p_value == 0.0


def test_a_failing_channel_fails_its_pixel():
    image = np.ones((10, 10, 3))
    image[0, 0, 2] = 2.0
    result = compare(
        Estimate.from_errors(image, 0.1 * np.ones_like(image)), Estimate.exact(np.ones_like(image))
    )
    assert result.z_pass_fraction == pytest.approx(0.99)
    assert not result.pixel_passes[0, 0]


@pytest.mark.parametrize("radius", [1, 3, 7, 40])
def test_window_sum_is_literal(radius):
    array = np.random.default_rng(13).random((9, 11, 2))
    expected = [
        [
            array[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1].sum(
                (0, 1)
            )
            for x in range(11)
        ]
        for y in range(9)
    ]
    np.testing.assert_allclose(statistics._window_sum(array, radius), expected, rtol=1e-12)


def test_window_sum_leaves_no_trace_of_a_firefly():
    array = np.zeros((40, 40, 1))
    array[5, 5] = 1e30
    assert not statistics._window_sum(array, 3)[20:, 20:].any()


# Spreads


def test_spreads_are_literal():
    render, reference = filled(1.0), filled(1.0)
    reference[0, 0, 0] = 0.0  # of a mean of 11/12, so measured against 11/1200
    render[1, 1, 1] = 1.6
    result = compare(Estimate.exact(render), Estimate.exact(reference))
    mean = 11.0 / 12.0
    assert result.rms_difference == pytest.approx(math.sqrt((1.0 + 0.36) / 12))
    assert result.rmse == pytest.approx(math.sqrt((1.0 + 0.36) / 12) / mean)
    assert result.rmse_denoised == pytest.approx(result.rmse)
    assert result.rmse_noise_floor == 0.0
    # Sorted relative errors: ten zeros, 0.6, 1 / (mean / 100); the 95th percentile lies 0.45 up.
    assert result.percentile95 == pytest.approx(0.6 + 0.45 * (100.0 / mean - 0.6))


@pytest.mark.parametrize("noise", [gaussian, gamma])
def test_denoised_rmse_is_unbiased_in_the_square(noise):
    rng = np.random.default_rng(14)
    image, bias = np.ones((16, 16, 3)), np.where(np.arange(16) < 8, 3.0, -1.0)[None, :, None]
    expected = np.mean(bias**2)  # the mean reference is 1
    squares = []
    for _ in range(100):
        render = Estimate.from_repeats(noisy(rng, noise, 4, image) + bias)
        reference = Estimate.from_repeats(noisy(rng, gaussian, 3, image))
        result = compare(render, reference)
        squares.append((result.rmse_denoised * result.mean_reference) ** 2)
    # Squares that were clamped at zero would bias the mean; there must be none.
    assert min(squares) > 0.0
    error = np.std(squares, ddof=1) / math.sqrt(len(squares))
    assert abs(np.mean(squares) - expected) < 4.0 * error
    assert error < 0.02 * expected


@pytest.mark.parametrize("noise", [gaussian, gamma])
def test_noise_stays_under_its_floor_as_often_as_stated(noise):
    rng = np.random.default_rng(15)
    trials = 80
    under = sum(
        result.rmse_denoised < result.rmse_noise_floor
        for result in (
            compare(Estimate.from_repeats(noisy(rng, noise, 4)), Estimate.exact(GRADIENT))
            for _ in range(trials)
        )
    )
    assert under >= binomial_limits(trials, 0.95)[0]


# Verdict


def test_passes_needs_mean_and_pixels():
    good = Estimate.from_errors(filled(1.004), filled(0.01))
    reference = Estimate.exact(filled(1.0))
    assert compare(good, reference).passes(0.005)
    assert not compare(good, reference).passes(0.003)
    assert not compare(Estimate.exact(filled(1.004)), reference).passes(0.005)
    assert compare(good, reference).worst_mean_error > 0.005
    with pytest.raises(ValueError, match=r"tolerance must be >= 0, got -1"):
        compare(good, reference).passes(-1)


def test_black_reference_is_compared_by_differences():
    black = Estimate.exact(filled(0.0))
    result = compare(black, black)
    assert result.mean_relative_error is None and result.worst_mean_error is None
    assert result.rmse is result.rmse_denoised is result.percentile95 is None
    assert result.passes(0.0)
    leak = compare(Estimate.exact(filled(1e-3)), black)
    assert leak.mean_difference == pytest.approx(1e-3)
    assert leak.rms_difference == pytest.approx(1e-3)
    assert not leak.passes(1.0)
    assert compare(Estimate.from_errors(filled(1e-3), filled(1e-2)), black).passes(0.0)


def test_comparison_refuses():
    one = Estimate.exact(filled(1.0))
    with pytest.raises(ValueError, match=r"same shape, got \(2, 2, 3\) and \(4, 2, 3\)"):
        compare(one, Estimate.exact(np.ones((4, 2, 3))))
    with pytest.raises(ValueError, match=r"mean reference must be > 0, got -1\.0"):
        compare(one, Estimate.exact(filled(-1.0)))
    with pytest.raises(ValueError, match=r"confidence must be between 0 and 1, got 95"):
        compare(one, one, confidence=95)
    with pytest.raises(ValueError, match=r"significance must be between 0 and 1, got 0\.0"):
        compare(one, one, significance=0.0)


@pytest.mark.parametrize("reference", [0.0, 1.0])
def test_json_is_plain_and_finite(reference):
    result = compare(Estimate.exact(filled(1.5)), Estimate.exact(filled(reference)))
    figures = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert figures["mean_difference"] == 1.5 - reference
    assert figures["mean_degrees_of_freedom"] is None
    assert figures["mean_relative_error"] == (0.5 if reference else None)
    assert figures["mean_relative_interval"] == ([0.5, 0.5] if reference else None)
    assert (figures["height"], figures["width"]) == (2, 2)
    assert "z" not in figures


def test_a_float32_sum_of_equal_samples_passes_and_more_does_not():
    """Running sums in float32, as engines make them, of a value that is not exact in binary."""
    n = 24
    value = np.random.default_rng(13).uniform(0.1, 1.0, (6, 6, 3)).astype(np.float32)
    total = np.zeros_like(value)
    for _ in range(n):
        total += value
    summed = (total * np.float32(1.0 / n)).astype(np.float64)
    assert np.mean(summed != value) > 0.2
    truth = Estimate.exact(value.astype(np.float64))
    repeats = np.stack([summed, summed])
    assert compare(Estimate.from_repeats(repeats, n), truth).z_pass_fraction == 1.0
    assert compare(Estimate.from_repeats(repeats * 1.00001, n), truth).z_pass_fraction == 0.0


def test_independent_pixels_know_the_error_of_their_mean_better():
    """Skewed noise in grey pixels: 95 % intervals cover in 93 to 97 % of trials, and vary far less than those of 4 means."""
    rng = np.random.default_rng(21)
    errors, covered, trials = [], 0, 1500
    for _ in range(trials):
        grey = rng.gamma(0.5, 2.0, (4, 16, 16, 1))  # mean 1
        estimate = Estimate.from_repeats(np.repeat(grey, 3, axis=-1), independent_pixels=True)
        low, high = compare(estimate, Estimate.exact(np.ones((16, 16, 3)))).mean_difference_interval
        covered += low <= 0.0 <= high
        errors.append(estimate.mean_standard_error)
    assert 0.93 < covered / trials < 0.97
    # sqrt(variance 2 / (4 x 256 samples)); channels are equal and count once
    assert np.mean(errors) == pytest.approx(math.sqrt(2.0 / 1024), rel=0.02)
    assert np.std(errors) / np.mean(errors) < 0.12
