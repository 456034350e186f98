# SPDX-License-Identifier: GPL-3.0-or-later
"""Transmittance and path lengths against integrals in 40-digit arithmetic and closed forms."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volumetrics_addon.physics import transmittance as tr

RTOL = 1e-12
DIGITS = 40
INF = np.inf


# --- Beer-Lambert and colours --------------------------------------------------


@pytest.mark.parametrize("sigma_t", [0.0, 5e-324, 1e-30, 0.3, 7.0, 1e30])
@pytest.mark.parametrize("distance", [0.0, 1e-30, 0.5, 100.0, 1e30])
def test_beer_lambert(sigma_t, distance):
    expected = float(mp.exp(-mp.mpf(sigma_t) * mp.mpf(distance)))
    assert tr.beer_lambert(sigma_t, distance) == pytest.approx(expected, rel=RTOL, abs=1e-307)


def test_beer_lambert_limits():
    assert tr.beer_lambert(0.0, INF) == 1
    assert tr.beer_lambert(1e-300, INF) == 0
    assert tr.beer_lambert(1e300, 1e300) == 0
    assert tr.beer_lambert(1.7e308, 0.0) == 1


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 50), st.floats(0, 10), st.floats(0, 10))
def test_beer_lambert_multiplies_along_a_ray(sigma_t, first, second):
    whole = tr.beer_lambert(sigma_t, first + second)
    parts = tr.beer_lambert(sigma_t, first) * tr.beer_lambert(sigma_t, second)
    np.testing.assert_allclose(whole, parts, rtol=1e-12, atol=1e-300)


@settings(max_examples=100, deadline=None)
@given(st.floats(1e-300, 1.0), st.floats(1e-3, 1e6))
def test_extinction_gives_its_color_back(color, distance):
    sigma_t = tr.extinction_from_color(color, distance)
    assert sigma_t >= 0
    np.testing.assert_allclose(tr.beer_lambert(sigma_t, distance), color, rtol=1e-12)


def test_extinction_from_color_near_white():
    color = 1 - 2.0**-53
    with mp.workdps(DIGITS):
        expected = float(-mp.log(mp.mpf(color)) / 3)
    assert tr.extinction_from_color(color, 3.0) == pytest.approx(expected, rel=1e-15)
    assert not np.signbit(tr.extinction_from_color(1.0, 3.0))


# --- height fog ----------------------------------------------------------------


def literal_height_depth(z, dir_z, distance, sigma_0, scale_height, base):
    z, dir_z, distance, sigma_0, scale_height, base = map(
        mp.mpf, (z, dir_z, distance, sigma_0, scale_height, base)
    )
    start = sigma_0 * mp.exp(-(z - base) / scale_height)
    if dir_z == 0 or distance == 0:
        return start * distance
    return start * scale_height / dir_z * (1 - mp.exp(-distance * dir_z / scale_height))


@pytest.mark.parametrize("dir_z", [0.0, 1e-300, 1e-12, -1e-12, 1e-3, -0.02, 0.5, -0.5, 1.0, -1.0])
@pytest.mark.parametrize("distance", [0.0, 1e-20, 1.0, 300.0, 1e4])
@pytest.mark.parametrize(
    "z, scale_height, base", [(0.0, 20.0, 0.0), (-50.0, 20.0, 3.0), (1e3, 50.0, 10.0)]
)
def test_height_optical_depth(z, dir_z, distance, scale_height, base):
    with mp.workdps(400):
        exact = literal_height_depth(z, dir_z, distance, 0.2, scale_height, base)
        expected = float(exact) if exact < mp.mpf("1.7e308") else INF
    depth = tr.height_optical_depth(z, dir_z, distance, 0.2, scale_height, base)
    np.testing.assert_allclose(depth, expected, rtol=RTOL)
    np.testing.assert_allclose(
        tr.height_transmittance(z, dir_z, distance, 0.2, scale_height, base),
        float(mp.exp(-mp.mpf(expected))),
        rtol=1e-10,
        atol=1e-300,
    )


def test_height_optical_depth_is_the_integral():
    """The closed form in this test, too, is only algebra: integrate once for real."""
    with mp.workdps(20):
        expected = mp.quad(lambda t: 0.1 * mp.exp(-(2 + t * mp.mpf("-0.25") - 1) / 5), [0, 7])
    depth = tr.height_optical_depth(2.0, -0.25, 7.0, 0.1, 5.0, 1.0)
    assert depth == pytest.approx(float(expected), rel=1e-13)


def test_height_optical_depth_of_infinite_rays():
    # sigma_0 exp(-h/H) H / dir_z
    assert tr.height_optical_depth(10.0, 0.5, INF, 0.2, 10.0) == pytest.approx(
        0.2 * np.exp(-1) * 10 / 0.5, rel=1e-14
    )
    assert tr.height_optical_depth(0.0, 1e-12, INF, 0.2, 10.0) == pytest.approx(2e12, rel=1e-12)
    assert tr.height_optical_depth(0.0, 0.0, INF, 0.2, 10.0) == INF
    assert tr.height_optical_depth(0.0, -1e-12, INF, 0.2, 10.0) == INF
    assert tr.height_optical_depth(0.0, -1.0, INF, 0.0, 10.0) == 0
    assert tr.height_transmittance(0.0, -1.0, INF, 0.2, 10.0) == 0


def test_height_optical_depth_extremes():
    # e^800 alone overflows; with sigma_0 = e^-790 the product is e^10.
    assert tr.height_optical_depth(-800.0, 0.0, 1.0, float(np.exp(-700)), 1.0, -90.0) == (
        pytest.approx(np.exp(10), rel=1e-12)
    )
    assert tr.height_optical_depth(1e30, 0.3, 1e30, 1e30, 1e-30) == 0
    assert tr.height_optical_depth(-1e30, 0.3, 1.0, 1e-30, 1e-3) == INF
    assert tr.height_optical_depth(5.0, 1.0, 1e30, 1e-30, 1e30) == pytest.approx(
        float(1 - mp.exp(-1)), rel=1e-12
    )


heights = st.floats(-100, 1000)
slopes = st.floats(-1, 1)


@settings(max_examples=150, deadline=None)
@given(heights, slopes, st.floats(0, 500), st.floats(0, 500), st.floats(1, 500))
def test_height_depth_adds_along_a_ray(z, dir_z, first, second, scale_height):
    whole = tr.height_optical_depth(z, dir_z, first + second, 0.1, scale_height)
    near = tr.height_optical_depth(z, dir_z, first, 0.1, scale_height)
    far = tr.height_optical_depth(z + first * dir_z, dir_z, second, 0.1, scale_height)
    assert whole >= 0
    # Rounding of the middle height, up to 1500 m over 1 m, scales the far part.
    np.testing.assert_allclose(whole, near + far, rtol=1e-11, atol=1e-300)


@settings(max_examples=150, deadline=None)
@given(heights, slopes, st.floats(0, 500), st.floats(1, 500))
def test_height_depth_is_the_same_backwards(z, dir_z, distance, scale_height):
    there = tr.height_optical_depth(z, dir_z, distance, 0.1, scale_height)
    back = tr.height_optical_depth(z + distance * dir_z, -dir_z, distance, 0.1, scale_height)
    np.testing.assert_allclose(there, back, rtol=1e-11, atol=1e-300)


# --- depth fogs ----------------------------------------------------------------


def test_depth_fogs():
    depths = [0, 10, 15, 20, 1e30, INF]
    np.testing.assert_allclose(tr.linear_fog(depths, 10, 20), [1, 1, 0.5, 0, 0, 0])
    np.testing.assert_allclose(
        tr.exp_fog([0, 2, 1e30, INF], 0.5), [1, 0.36787944117144233, 0, 0], rtol=1e-15
    )
    np.testing.assert_allclose(
        tr.exp2_fog([0, 4, 1e300, INF], 0.5), [1, 0.018315638888734179, 0, 0], rtol=1e-15
    )
    assert tr.exp_fog(INF, 0.0) == tr.exp2_fog(INF, 0.0) == 1


def test_coverage_blend():
    assert tr.coverage_blend(0.25, 0.8) == pytest.approx(0.6, rel=1e-15)
    assert tr.coverage_blend(1.0, 1.0) == 0
    assert tr.coverage_blend(0.0, 0.3) == 0.3


# --- slab ----------------------------------------------------------------------

SLAB_CASES = [
    # z, dir_z, distance, expected for the slab from 2 to 5
    (0.0, 1.0, 10.0, 3.0),
    (0.0, 0.5, 100.0, 6.0),
    (0.0, 1.0, 1.0, 0.0),
    (0.0, 1.0, 3.0, 1.0),
    (0.0, -1.0, INF, 0.0),
    (3.0, 1.0, INF, 2.0),
    (3.0, -1.0, INF, 1.0),
    (3.0, 0.6, 1.0, 1.0),
    (9.0, -1.0, 5.0, 1.0),
    (9.0, 1.0, INF, 0.0),
    (3.0, 0.0, 7.0, 7.0),
    (3.0, 0.0, INF, INF),
    (1.0, 0.0, INF, 0.0),
    (5.0, 0.0, 2.0, 2.0),
    (3.0, 1e-12, INF, 2e12),
    (3.0, 1e-12, 50.0, 50.0),
    (3.0, 1.0, 0.0, 0.0),
]


@pytest.mark.parametrize("z, dir_z, distance, expected", SLAB_CASES)
def test_slab_path_length(z, dir_z, distance, expected):
    length = tr.slab_path_length(z, dir_z, distance, 2.0, 5.0)
    np.testing.assert_allclose(length, expected, rtol=1e-14)
    if np.isfinite(expected):
        depth = tr.slab_optical_depth(0.5, z, dir_z, distance, 2.0, 5.0)
        np.testing.assert_allclose(depth, 0.5 * expected, rtol=1e-14)


def test_slab_limits():
    # A slab of 1 mm keeps its thickness from 10^6 km.
    assert tr.slab_path_length(1e9, -0.5, INF, 0.0, 1e-3) == pytest.approx(2e-3, rel=1e-15)
    assert tr.slab_path_length(0.0, 0.5, 10.0, -INF, INF) == 10
    assert tr.slab_path_length(0.0, -0.5, 10.0, -INF, -1.0) == pytest.approx(8.0)
    assert tr.slab_path_length(0.0, 5e-324, INF, 1.0, 2.0) == 0
    assert tr.slab_optical_depth(0.0, 3.0, 0.0, INF, 2.0, 5.0) == 0


@settings(max_examples=150, deadline=None)
@given(st.floats(-20, 20), st.floats(-1, 1), st.floats(0, 50))
def test_slab_length_is_the_share_of_points_inside(z, dir_z, distance):
    t = (np.arange(4000) + 0.5) / 4000 * distance
    inside = np.mean((z + t * dir_z >= -3) & (z + t * dir_z <= 4)) * distance
    length = tr.slab_path_length(z, dir_z, distance, -3.0, 4.0)
    assert 0 <= length <= distance
    assert length == pytest.approx(inside, abs=distance / 2000 + 1e-12)


# --- plate and shell -----------------------------------------------------------


@pytest.mark.parametrize("ior", [1.0, 1 + 2.0**-52, 1.000293, 1.33, 1.5, 1000.0])
@pytest.mark.parametrize("cos_theta", [1.0, -0.7, 0.3, 1e-8, 1e-200, 0.0])
def test_plate_path_length(cos_theta, ior):
    if ior == 1 and cos_theta == 0:
        assert tr.plate_path_length(cos_theta, 0.01, ior) == INF
        assert tr.plate_path_length(cos_theta, 0.0, ior) == 0
        return
    with mp.workdps(500):
        sine = mp.sqrt(1 - mp.mpf(cos_theta) ** 2) / mp.mpf(ior)
        expected = float(mp.mpf(0.01) / mp.sqrt(1 - sine**2))
    assert tr.plate_path_length(cos_theta, 0.01, ior) == pytest.approx(expected, rel=RTOL)


def traced_shell_length(b, outer, inner, n):
    """Follow the ray by Snell's law in vectors, in the plane of ray and centre."""
    b, outer, inner, n = map(mp.mpf, (b, outer, inner, n))
    if b > outer:
        return mp.mpf(0)

    def refract(direction, normal, ratio):
        """Direction behind the surface, or None beyond the critical angle; normal against it."""
        cosine = -(direction[0] * normal[0] + direction[1] * normal[1])
        squared = 1 - ratio**2 * (1 - cosine**2)
        if squared < 0:
            return None
        factor = ratio * cosine - mp.sqrt(squared)
        return [ratio * d + factor * m for d, m in zip(direction, normal)]

    def hit(point, direction, radius):
        """Distance to the circle, the next one ahead, or None."""
        along = point[0] * direction[0] + point[1] * direction[1]
        square = along**2 - (point[0] ** 2 + point[1] ** 2 - radius**2)
        if square < 0:
            return None
        roots = [-along - mp.sqrt(square), -along + mp.sqrt(square)]
        ahead = [t for t in roots if t > mp.mpf(10) ** -30]
        return min(ahead) if ahead else None

    def move(point, direction, t):
        return [p + t * d for p, d in zip(point, direction)]

    point = [-mp.sqrt(outer**2 - b**2), b]
    direction = refract([mp.mpf(1), mp.mpf(0)], [x / outer for x in point], 1 / n)
    length = mp.mpf(0)
    for _ in range(4):
        to_inner = hit(point, direction, inner) if inner > 0 else None
        if to_inner is None:
            return length + hit(point, direction, outer)
        point = move(point, direction, to_inner)
        length += to_inner
        outward = [x / inner for x in point]
        inside = refract(direction, outward, n)
        if inside is None:
            cosine = sum(d * m for d, m in zip(direction, outward))
            direction = [d - 2 * cosine * m for d, m in zip(direction, outward)]
        else:
            point = move(point, inside, hit(point, inside, inner))
            direction = refract(inside, [-x / inner for x in point], 1 / n)
        return length + hit(point, direction, outer)
    raise AssertionError("the ray did not leave the shell")


@pytest.mark.parametrize("ior", [1.0, 1 + 1e-9, 1.33, 1.5, 2.4])
@pytest.mark.parametrize("inner", [0.0, 0.3, 0.9, 1 - 1e-6])
@pytest.mark.parametrize("b", [0.0, 0.1, 0.29, 0.31, 0.44, 0.46, 0.85, 0.95, 0.99999, 1.2])
def test_shell_path_length_against_ray_tracing(b, inner, ior):
    with mp.workdps(60):
        expected = float(traced_shell_length(b, 1.0, inner, ior))
    assert tr.shell_path_length(b, 1.0, inner, ior) == pytest.approx(expected, rel=1e-11)


def test_shell_limits():
    assert tr.shell_path_length(0.0, 2.0, 1.5, 1.5) == 1.0
    assert tr.shell_path_length(0.3, 2.0, 2.0, 1.5) == 0.0
    assert tr.shell_path_length(2.0, 2.0, 1.0) == 0.0
    # Wall of 10^-12 m, seen straight on: twice its thickness.
    assert tr.shell_path_length(0.0, 1.0, 1 - 2.0**-40) == 2.0**-39
    assert tr.shell_path_length(np.zeros((0, 2)), 1.0, 0.5).shape == (0, 2)


# --- ratio tracking ------------------------------------------------------------


def test_ratio_tracking_is_unbiased():
    rng = np.random.default_rng(5)
    rates = np.linspace(0.2, 1.0, 5)

    def density(t):
        return rates * (1 + np.sin(t)) / 2

    estimate = tr.ratio_tracking(density, np.broadcast_to(1.2, (40_000, 5)), 4.0, rng)
    # Integral of (1 + sin t) / 2 over [0, 4] is (4 + 1 - cos 4) / 2.
    expected = np.exp(-rates * (5 - np.cos(4.0)) / 2)
    standard_error = np.std(estimate, axis=0) / np.sqrt(len(estimate))
    assert np.all((estimate >= 0) & (estimate <= 1))
    assert np.all(np.abs(np.mean(estimate, axis=0) - expected) < 4 * standard_error)


def test_ratio_tracking_edges():
    rng = np.random.default_rng(5)
    assert tr.ratio_tracking(np.zeros_like, 0.0, 10.0, rng) == 1
    assert tr.ratio_tracking(np.zeros_like, 3.0, 10.0, rng) == 1
    assert tr.ratio_tracking(np.ones_like, 3.0, 0.0, rng) == 1
    assert tr.ratio_tracking(np.ones_like, np.ones((0, 2)), 1.0, rng).shape == (0, 2)
    with pytest.raises(ValueError, match="raise the majorant"):
        tr.ratio_tracking(lambda t: 0 * t + 5, 3.0, 10.0, rng)


# --- arrays and errors ---------------------------------------------------------


def test_broadcasting_and_dtypes():
    sigma = np.array([0.1, 0.2, 0.4], dtype=np.float32)
    length = np.ones((4, 1), dtype=np.float32)
    assert tr.beer_lambert(sigma, length).shape == (4, 3)
    assert tr.beer_lambert(sigma, length).dtype == np.float64
    assert tr.height_optical_depth(0, sigma, length, 1, 1).shape == (4, 3)
    assert tr.slab_path_length(0, sigma, length, 0, 1).shape == (4, 3)
    assert tr.shell_path_length(sigma, length, 0.5, 1.5).shape == (4, 3)
    assert tr.beer_lambert(np.empty(0), 1.0).shape == (0,)
    assert tr.height_optical_depth(np.empty(0), 0.1, 1, 1, 1).shape == (0,)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: tr.beer_lambert(-0.2, 1), "sigma_t must be .* metre, got -0.2; use a positive"),
        (lambda: tr.beer_lambert([0.1, np.nan], 1), "sigma_t .* got nan"),
        (lambda: tr.beer_lambert(INF, 1), "sigma_t .* got inf"),
        (lambda: tr.beer_lambert(0.1, -1), "distance must be >= 0 metres, got -1.0"),
        (lambda: tr.extinction_from_color(0.0, 1), "color must be in .* got 0.0; .*0.001"),
        (lambda: tr.extinction_from_color(1.1, 1), "color .* got 1.1"),
        (lambda: tr.extinction_from_color(0.5, 0), "distance .* got 0.0"),
        (lambda: tr.extinction_from_color(0.5, 1e-320), "extinction .* longer distance"),
        (lambda: tr.height_optical_depth(0, 0, 1, 1, 0), "scale_height .* got 0.0"),
        (lambda: tr.height_optical_depth(0, 2, 1, 1, 1), "dir_z .* got 2.0"),
        (lambda: tr.height_optical_depth(INF, 0, 1, 1, 1), "z .* got inf"),
        (lambda: tr.linear_fog(1, 5, 5), "end - start .* got 0.0"),
        (lambda: tr.exp_fog(1, -1), "density .* got -1.0"),
        (lambda: tr.slab_path_length(0, 0, 1, 2, 1), "bottom must be at most top, got 2.0; swap"),
        (lambda: tr.plate_path_length(0.5, 1, 0.9), "ior .* got 0.9"),
        (lambda: tr.shell_path_length(0.5, 1, 1.1), "inner_radius must be at most .* got 1.1"),
        (lambda: tr.coverage_blend(1.5, 0.5), "coverage .* got 1.5"),
        (lambda: tr.ratio_tracking(np.ones_like, 1.0, INF, None), "distance .* got inf"),
    ],
)
def test_errors_name_value_and_remedy(call, message):
    with pytest.raises(ValueError, match=message):
        call()
