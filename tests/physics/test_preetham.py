# SPDX-License-Identifier: GPL-3.0-or-later
"""Preetham's sky against the paper's formulas written out one by one, and against what they must fulfil."""

import math

import numpy as np
import pytest

from volumetrics_addon.physics import preetham
from volumetrics_addon.physics.preetham import MAX_LUMINOUS_EFFICACY, preetham_sky, preetham_xyy


def literal(theta, gamma, sun, t):
    """Appendix A.2 of the paper, scalar by scalar."""
    def perez(a, b, c, d, e, theta, gamma):
        return (1 + a * math.exp(b / math.cos(theta))) * (1 + c * math.exp(d * gamma) + e * math.cos(gamma) ** 2)

    chi = (4 / 9 - t / 120) * (math.pi - 2 * sun)
    zenith_luminance = (4.0453 * t - 4.9710) * math.tan(chi) - 0.2155 * t + 2.4192
    zenith_x = (t * t * (0.00166 * sun**3 - 0.00375 * sun**2 + 0.00209 * sun)
                + t * (-0.02903 * sun**3 + 0.06377 * sun**2 - 0.03202 * sun + 0.00394)
                + 0.11693 * sun**3 - 0.21196 * sun**2 + 0.06052 * sun + 0.25886)
    zenith_y = (t * t * (0.00275 * sun**3 - 0.00610 * sun**2 + 0.00317 * sun)
                + t * (-0.04214 * sun**3 + 0.08970 * sun**2 - 0.04153 * sun + 0.00516)
                + 0.15346 * sun**3 - 0.26756 * sun**2 + 0.06670 * sun + 0.26688)
    of_luminance = 0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251, 0.1206 * t - 2.5771, -0.0670 * t + 0.3703
    of_x = -0.0193 * t - 0.2592, -0.0665 * t + 0.0008, -0.0004 * t + 0.2125, -0.0641 * t - 0.8989, -0.0033 * t + 0.0452
    of_y = -0.0167 * t - 0.2608, -0.0950 * t + 0.0092, -0.0079 * t + 0.2102, -0.0441 * t - 1.6537, -0.0109 * t + 0.0529
    return [zenith * perez(*k, theta, gamma) / perez(*k, 0.0, sun)
            for zenith, k in ((zenith_x, of_x), (zenith_y, of_y), (zenith_luminance, of_luminance))]


@pytest.mark.parametrize("turbidity", [2.0, 3.7, 6.0, 10.0])
@pytest.mark.parametrize("sun", [0.0, 30.0, 60.0, 88.0])
def test_formula(turbidity, sun):
    for theta, azimuth in ((0, 0), (20, 0), (45, 90), (80, 180), (88, 10)):
        s, v = math.radians(sun), math.radians(theta)
        cosine = math.cos(s) * math.cos(v) + math.sin(s) * math.sin(v) * math.cos(math.radians(azimuth))
        value = preetham_xyy(math.cos(v), cosine, s, turbidity)
        # Measured 3e-14: arccos near the sun.
        np.testing.assert_allclose(value, literal(v, math.acos(min(1.0, cosine)), s, turbidity), rtol=1e-12)


def test_published_zenith():
    """Luminance and chromaticity at the zenith of the paper's clearest sky, sun overhead and rising, by hand."""
    overhead = preetham_xyy(1.0, 1.0, 0.0, 2.0)
    # chi = (4/9 - 1/60) pi = 1.343904, tan chi = 4.3315: 3.1196 * 4.3315 - 0.4310 + 2.4192 = 15.5007 kcd/m^2.
    np.testing.assert_allclose(overhead, [0.25886 + 2 * 0.00394, 0.26688 + 2 * 0.00516, 15.50067], rtol=1e-6)
    rising = preetham_xyy(1.0, 0.0, np.pi / 2, 2.0)
    np.testing.assert_allclose(rising[2], 2.4192 - 2 * 0.2155, rtol=1e-12)


def test_white_has_equal_channels_and_luminance_in_watts():
    """The weights of the channels add up to the luminance; D65 would be grey."""
    rng = np.random.default_rng(3)
    theta, gamma = rng.uniform(0, 0.4 * np.pi, 100), rng.uniform(0.5, 1.5, 100)
    xyy = preetham_xyy(np.cos(theta), np.cos(gamma), 0.7, 4.0)
    rgb = preetham_sky(np.cos(theta), np.cos(gamma), 0.7, 4.0)
    assert (rgb > 0).all()
    np.testing.assert_allclose(rgb @ [0.2126390059, 0.7151686788, 0.0721923154],
                               xyy[:, 2] * 1000 / MAX_LUMINOUS_EFFICACY, rtol=1e-9)
    x, y = 0.3127, 0.3290
    # D65 rounded to four digits: measured 8e-4.
    np.testing.assert_allclose(preetham._FROM_XYZ @ [x / y, 1.0, (1 - x - y) / y], [1, 1, 1], atol=2e-3)


def test_sky_is_blue_by_day_and_bright_around_the_sun():
    noon = preetham_sky(1.0, math.cos(math.radians(30)), math.radians(30), 2.5)
    assert noon[2] > 1.5 * noon[0]
    near, far = preetham_sky(math.cos(1.0), np.cos([0.05, 1.0]), 1.05, 4.0)
    assert (near > 2 * far).all()


def test_shapes_and_ranges():
    cos_theta = np.linspace(0, 1, 21, dtype=np.float32)[:, None, None, None]
    cos_gamma = np.linspace(-1, 1, 21, dtype=np.float32)[:, None, None]
    sun = np.linspace(0, np.pi / 2, 11)[:, None]
    value = preetham_sky(cos_theta, cos_gamma, sun, np.array([2.0, 5.0, 10.0]))
    assert value.shape == (21, 21, 11, 3, 3) and value.dtype == np.float64
    assert np.isfinite(value).all() and (value >= 0).all()
    assert preetham_sky(np.zeros((0, 2)), 0.5, 0.3, 3.0).shape == (0, 2, 3)


@pytest.mark.parametrize("arguments, name", [
    ((-0.1, 0.5, 0.3, 3.0), "cos_theta"), ((0.5, 1.5, 0.3, 3.0), "cos_gamma"), ((0.5, 0.5, 1.6, 3.0), "sun_zenith"),
    ((0.5, 0.5, 0.3, 1.5), "turbidity"), ((0.5, 0.5, 0.3, math.nan), "turbidity"),
])
def test_errors(arguments, name):
    with pytest.raises(ValueError, match=f"{name} must be .*, got "):
        preetham_sky(*arguments)
