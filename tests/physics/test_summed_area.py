# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums over boxes and balls against sums over the cells themselves."""

import math
from fractions import Fraction

import numpy as np
import pytest

from volumetrics_addon.physics import summed_area
from volumetrics_addon.physics.summed_area import CUBE, REACH, WIDTH, SummedArea

LOW, HIGH, SHAPE = np.array([-1.0, 0.5, 2.0]), np.array([2.0, 2.5, 3.5]), (6, 8, 5)
CELL = (HIGH - LOW) / SHAPE
VALUES = np.random.default_rng(3).integers(0, 1000, SHAPE) / 8.0
TABLE = SummedArea(VALUES, LOW, HIGH)


def brute_force_mean(low, high):
    """Overlap of every cell with the box, in exact fractions."""
    low, high = [[Fraction(float(x)) for x in corner] for corner in (low, high)]
    total = Fraction(0)
    for index in np.ndindex(SHAPE):
        share = Fraction(1)
        for k in range(3):
            start = Fraction(float(LOW[k])) + index[k] * Fraction(float(CELL[k]))
            end = start + Fraction(float(CELL[k]))
            share *= max(Fraction(0), min(end, high[k]) - max(start, low[k]))
        total += share * Fraction(float(VALUES[index]))
    return float(total / math.prod(h - l for l, h in zip(low, high)))


def test_boxes_anywhere_are_exact():
    rng = np.random.default_rng(4)
    corners = np.sort(rng.uniform(LOW - 0.5, HIGH + 0.5, (16, 2, 3)), axis=1)
    means = TABLE.mean_in_box(corners[:, 0], corners[:, 1])
    expected = [brute_force_mean(low, high) for low, high in corners]
    np.testing.assert_allclose(means, expected, rtol=1e-11, atol=1e-11)  # measured 2e-13
    whole = TABLE.mean_in_box(LOW, HIGH)
    assert whole == pytest.approx(VALUES.mean(), rel=1e-14)
    assert TABLE.mean_in_box(LOW + (2 * CELL), LOW + 3 * CELL) == pytest.approx(VALUES[2, 2, 2], rel=1e-12)


def test_outside_is_zero():
    assert TABLE.mean_in_box(HIGH + 0.1, HIGH + 0.2) == 0.0
    assert TABLE.mean_in_ball([9.0, 9.0, 9.0], 2.0) == 0.0
    ones = SummedArea(np.ones(SHAPE), LOW, HIGH)
    half = ones.mean_in_box([HIGH[0] - 1.0, LOW[1], LOW[2]], [HIGH[0] + 1.0, HIGH[1], HIGH[2]])
    assert half == pytest.approx(0.5, rel=1e-13)


def test_the_seven_boxes_have_the_moments_of_a_ball():
    """Sums over boxes of products of one-dimensional moments; the ball's are 4 pi / 3, / 15 and 4 pi / 35, / 105."""
    def moment(*powers):
        return sum(math.prod((high[k] ** (n + 1) - low[k] ** (n + 1)) / (n + 1) for k, n in enumerate(powers))
                   for low, high in summed_area._BALL)

    assert moment(0, 0, 0) == pytest.approx(4 * math.pi / 3, rel=1e-14)
    for order in ((2, 0, 0), (0, 2, 0), (0, 0, 2)):
        assert moment(*order) == pytest.approx(4 * math.pi / 15, rel=1e-14)
    assert moment(4, 0, 0) == pytest.approx(4 * math.pi / 35, rel=1e-14)
    assert moment(2, 2, 0) == pytest.approx(1.0505 * 4 * math.pi / 105, rel=1e-3)
    assert abs(moment(1, 0, 0)) + abs(moment(3, 0, 0)) + abs(moment(1, 1, 0)) + abs(moment(1, 1, 1)) < 1e-14
    assert 0 < CUBE < WIDTH < REACH < 1


def test_balls_in_a_cubic_field():
    """Values x^3 + 2 x y z - 3 y z^2 + x^2 on fine cells; over a ball a term x^2 means x0^2 + r^2 / 5."""
    count = 80
    axis = (np.arange(count) + 0.5) / count * 2 - 1
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    table = SummedArea(x**3 + 2 * x * y * z - 3 * y * z**2 + x**2, (-1, -1, -1), (1, 1, 1))
    rng = np.random.default_rng(5)
    center, radius = rng.uniform(-0.4, 0.4, (30, 3)), rng.uniform(0.2, 0.5, 30)
    a, b, c = center.T
    share = radius**2 / 5
    expected = a**3 + 3 * a * share + 2 * a * b * c - 3 * b * (c * c + share) + a * a + share
    # Measured 2.1e-4: the cells of 0.025 are constant inside.
    np.testing.assert_allclose(table.mean_in_ball(center, radius), expected, atol=4e-4)


def test_balls_cut_by_an_edge_against_brute_force():
    """Half spaces of any orientation and offset, against the share of the cells whose centres lie in both."""
    count = 40
    axis = (np.arange(count) + 0.5) / count * 2 - 1
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    inside = np.sum(points**2, axis=-1) < 0.36
    rng = np.random.default_rng(6)
    errors = []
    for _ in range(16):
        normal = rng.standard_normal(3)
        full = points @ normal > rng.uniform(-0.6, 0.6) * np.linalg.norm(normal)
        found = SummedArea(full.astype(float), (-1, -1, -1), (1, 1, 1)).mean_in_ball([0.0, 0.0, 0.0], 0.6)
        errors.append(abs(found - full[inside].mean()))
    assert max(errors) < 0.015  # measured 0.0098 over 60 of them on finer cells
    ball = SummedArea(inside.astype(float), (-1, -1, -1), (1, 1, 1)).mean_in_ball([0.0, 0.0, 0.0], 0.6)
    assert ball == pytest.approx(0.92, abs=0.01)


def test_bounds_and_extremes():
    for factor in (1e-300, 1.0, 1e300):
        table = SummedArea(VALUES * factor, LOW, HIGH)
        mean = table.mean_in_ball(np.stack([LOW, HIGH, (LOW + HIGH) / 2]), [1e-6, 1.0, 1e6])
        assert (mean >= 0).all() and (mean <= VALUES.max() * factor).all()
    empty = TABLE.mean_in_ball(np.zeros((0, 3)), 1.0)
    assert empty.shape == (0,)
    assert SummedArea(np.zeros((2, 2, 2)), LOW, HIGH).mean_in_ball(LOW, 1.0) == 0.0


@pytest.mark.parametrize("make, message", [
    (lambda: SummedArea(np.zeros((2, 2)), LOW, HIGH), r"values must have shape \(nx, ny, nz\)"),
    (lambda: SummedArea([[[math.nan]]], LOW, HIGH), "values must be a finite number"),
    (lambda: SummedArea(VALUES, HIGH, LOW), "high - low must be finite and > 0"),
    (lambda: TABLE.mean_in_ball([0, 0, 0], 0.0), "radius must be finite and > 0 metres, got 0.0"),
    (lambda: TABLE.mean_in_box([0, 0, 0], [1, 1, 0]), "high - low must be finite and > 0 metres, got 0.0"),
    (lambda: TABLE.mean_in_ball([0, 0], 1.0), r"center must have shape \(..., 3\)"),
])
def test_errors_name_value_and_remedy(make, message):
    with pytest.raises(ValueError, match=message + ".*;"):
        make()
