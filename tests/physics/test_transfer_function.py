# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfer functions against interpolation by hand, closed forms and adaptive quadrature."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from volumetrics_addon.physics.transfer_function import TransferFunction1D, TransferFunction2D, gradient_magnitude

SCALAR = np.array([0.0, 0.1, 0.3, 0.31, 0.8, 1.0])
EMISSION = np.array([[0, 0, 0], [1, 0.2, 0], [0, 3, 0.1], [5, 0, 0], [0.2, 0.4, 2], [0, 0, 1]], float)
EXTINCTION = np.array([0.0, 2.0, 0.0, 9.0, 0.5, 4.0])
TABLE = TransferFunction1D(SCALAR, EMISSION, EXTINCTION)


def literal(x, values):
    """Piecewise linear, by hand."""
    if x <= SCALAR[0]:
        return values[0]
    for k in range(len(SCALAR) - 1):
        if x <= SCALAR[k + 1]:
            share = (x - SCALAR[k]) / (SCALAR[k + 1] - SCALAR[k])
            return (1 - share) * values[k] + share * values[k + 1]
    return values[-1]


def test_linear_between_nodes_and_constant_beyond():
    x = np.linspace(-0.5, 1.5, 83)
    emission, extinction = TABLE(x)
    np.testing.assert_allclose(extinction, [literal(v, EXTINCTION) for v in x], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(emission, [literal(v, EMISSION) for v in x], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("length", [1e-3, 0.7, 20.0, 900.0])
@pytest.mark.parametrize("front, back", [(0.05, 0.95), (1.2, -0.3), (0.29, 0.32), (0.2, 0.2), (0.31, 0.8), (-2.0, -1.0)])
def test_segment_against_adaptive_quadrature(front, back, length):
    """The optical depth by quad between the nodes, the radiance as a sum of fine steps."""
    radiance, depth = TABLE.segment(front, back, length)
    span = back - front
    cuts = sorted({0.0, 1.0, *(float((s - front) / span) for s in SCALAR if span and 0 < (s - front) / span < 1)})

    def depth_to(u):
        return length * sum(quad(lambda v: literal(front + v * span, EXTINCTION), a, min(b, u), epsabs=0, epsrel=1e-12)[0]
                            for a, b in zip(cuts, cuts[1:]) if a < u)

    assert depth == pytest.approx(depth_to(1.0), rel=1e-11, abs=1e-14)
    # The radiance as a midpoint sum of fine equal steps.
    count = 200000
    u = (np.arange(count) + 0.5) / count
    s = np.clip(front + u * span, SCALAR[0], SCALAR[-1])
    k = np.clip(np.searchsorted(SCALAR, s) - 1, 0, len(SCALAR) - 2)
    share = ((s - SCALAR[k]) / (SCALAR[k + 1] - SCALAR[k]))
    sigma = EXTINCTION[k] * (1 - share) + EXTINCTION[k + 1] * share
    emitted = EMISSION[k] * (1 - share)[:, None] + EMISSION[k + 1] * share[:, None]
    step = length / count
    before = step * (np.cumsum(sigma) - sigma / 2)
    expected = (emitted * np.exp(-before)[:, None]).sum(axis=0) * step
    # A step of the sum at 900 m has an optical depth t = 0.04, whose midpoint errs by t^2 / 24: measured 6.9e-5; else 4e-8.
    np.testing.assert_allclose(radiance, expected, rtol=1.5e-4 if length == 900.0 else 1e-7, atol=1e-12)


@pytest.mark.parametrize("sigma, length", [(0.0, 3.0), (1e-30, 2.0), (0.4, 2.0), (30.0, 7.0), (1e8, 5.0), (1e30, 1e3)])
def test_constant_data_in_closed_form(sigma, length):
    """e (1 - exp(-sigma d)) / sigma."""
    table = TransferFunction1D([0.0, 1.0], [[1.0, 2.0, 3.0]] * 2, [sigma] * 2)
    radiance, depth = table.segment([0.1, 0.2], [0.9, 0.2], length)
    each = length if sigma == 0.0 else -math.expm1(-sigma * length) / sigma
    np.testing.assert_allclose(radiance, np.outer([each] * 2, [1, 2, 3]), rtol=1e-9)  # measured 2e-10
    np.testing.assert_allclose(depth, sigma * length, rtol=1e-13)


def test_segments_compose():
    """C(a, c) = C(a, b) + exp(-tau(a, b)) C(b, c) when b lies on the way; tau(a, c) = tau(c, a)."""
    rng = np.random.default_rng(1)
    a, c, d, part = rng.uniform(-0.2, 1.2, 200), rng.uniform(-0.2, 1.2, 200), rng.uniform(0, 9, 200), rng.random(200)
    b = a + part * (c - a)
    whole, depth = TABLE.segment(a, c, d)
    first, depth_1 = TABLE.segment(a, b, part * d)
    second, depth_2 = TABLE.segment(b, c, (1 - part) * d)
    np.testing.assert_allclose(depth, depth_1 + depth_2, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(whole, first + np.exp(-depth_1)[:, None] * second, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(TABLE.segment(c, a, d)[1], depth, rtol=1e-11, atol=1e-13)


def test_table_of_one_length():
    scalar = np.linspace(0.0, 1.0, 9)
    colour, depth = TABLE.preintegrated(scalar, 0.3)
    assert colour.shape == (9, 9, 3) and depth.shape == (9, 9)
    np.testing.assert_array_equal(colour[2, 7], TABLE.segment(scalar[2], scalar[7], 0.3)[0])


def test_bilinear_in_two_dimensions():
    scalar, gradient = np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0])
    rng = np.random.default_rng(2)
    emission, extinction = rng.random((3, 2, 3)), rng.random((3, 2))
    table = TransferFunction2D(scalar, gradient, emission, extinction)
    e, s = table(2.5, 0.5)
    weights = np.outer([0.25, 0.75], [0.75, 0.25])
    np.testing.assert_allclose(s, (weights * extinction[1:]).sum(), rtol=1e-14)
    np.testing.assert_allclose(e, (weights[..., None] * emission[1:]).sum(axis=(0, 1)), rtol=1e-14)
    np.testing.assert_array_equal(table([-1.0, 9.0], [0.0, 7.0])[1], [extinction[0, 0], extinction[2, 1]])
    assert table(np.zeros((0, 4)), np.zeros((0, 4)))[0].shape == (0, 4, 3)


def test_gradient_of_a_plane():
    x, y, z = np.meshgrid(np.arange(4) + 0.5, np.arange(5) + 0.5, [0.5], indexing="ij")
    values = 3.0 * x * 0.5 - 4.0 * y * 0.25
    np.testing.assert_allclose(gradient_magnitude(values, (0, 0, 0), (2.0, 1.25, 1.0)), 5.0, rtol=1e-13)


@pytest.mark.parametrize("make, message", [
    (lambda: TransferFunction1D([0.0], [[1, 1, 1]], [1]), r"scalar must have shape \(n,\) with n >= 2"),
    (lambda: TransferFunction1D([0.0, 0.0], [[1, 1, 1]] * 2, [1, 1]), "steps of scalar must be .* > 0 apart, got 0.0"),
    (lambda: TransferFunction1D([0, 1], [[1, 1, 1], [1, -2, 1]], [1, 1]), "emission must be .* got -2.0"),
    (lambda: TransferFunction1D([0, 1], [[1, 1, 1]] * 2, [1, math.nan]), "extinction must be .* got nan"),
    (lambda: TransferFunction1D([0, 1], [[1, 1]] * 2, [1, 1]), r"emission must have shape \(2, 3\), got \(2, 2\)"),
    (lambda: TransferFunction2D([0, 1], [-1, 1], np.ones((2, 2, 3)), np.ones((2, 2))), "gradient must be .* got -1.0"),
    (lambda: TransferFunction2D([0, 1], [0, 1], np.ones((2, 2, 3)), [[1, 1, 1]]), r"extinction must have shape \(2, 2\)"),
    (lambda: TABLE(math.inf), "scalar must be a finite number"),
    (lambda: TABLE.segment(0, 1, -1.0), "length must be finite and >= 0 metres, got -1.0"),
    (lambda: gradient_magnitude(np.zeros((2, 2)), (0, 0, 0), (1, 1, 1)), r"values must have shape \(nx, ny, nz\)"),
])
def test_errors_name_value_and_remedy(make, message):
    with pytest.raises(ValueError, match=message + ".*;"):
        make()


def test_accepts_float32_and_empty_arrays():
    radiance, depth = TABLE.segment(np.zeros((0, 2), np.float32), np.zeros(2, np.float32), 1.0)
    assert radiance.shape == (0, 2, 3) and depth.shape == (0, 2)
    radiance, depth = TABLE.segment(np.float32(0.25), np.float32(0.75), np.float32(0.5))
    assert radiance.dtype == np.float64 and radiance.shape == (3,) and depth > 0.0
