# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples where the noise is, on pictures whose variance is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volumetrics_addon.compare.allocation import Allocation, allocate, gain, held_out_gain, variance_of
from volumetrics_addon.plan.rules import MOST_SAMPLES

ROWS, COLUMNS = np.mgrid[:36, :64]
SPOT = 0.01 + 25.0 * ((COLUMNS >= 40) & (COLUMNS < 48) & (ROWS >= 8) & (ROWS < 16))  # noise in 1/36 of the picture
FLAT = np.ones((36, 64))


def counts(regions, width, height):
    """Samples of every pixel; fails where two regions overlap."""
    result = np.zeros((height, width), int)
    for one in regions:
        assert not result[one.top:one.bottom, one.left:one.right].any()
        result[one.top:one.bottom, one.left:one.right] = one.samples
    return result


def error_times_samples(variance, samples):
    """By the definition, pixel by pixel."""
    return sum(v / n for v, n in zip(variance.ravel(), samples.ravel())) * samples.sum()


def test_one_spot_of_noise_is_found_exactly():
    """Two levels: G = A1 sqrt(v1) + A2 sqrt(v2), and the gain is A (A1 v1 + A2 v2) / G^2. Cells of equal deviation share it."""
    found = allocate(SPOT, 100.0, 1e-3, floor=0.0)
    inside = [cell for cell, deviation in zip(found.cells, found.deviations) if deviation > 1.0]
    assert inside == [(40, 8, 48, 16)] and len(found.cells) == 5
    spread = 64 * 25.01**0.5 + (36 * 64 - 64) * 0.1
    exact = 36 * 64 * (64 * 25.01 + (36 * 64 - 64) * 0.01) / spread**2
    assert sum(deviation * (c[2] - c[0]) * (c[3] - c[1]) for c, deviation in zip(found.cells, found.deviations)) == \
        pytest.approx(spread)
    samples = counts(found.regions(64, 36, 1024), 64, 36)
    assert samples[10, 44] / samples[30, 10] in (32.0, 64.0)  # 50 times the deviation: the powers of two beside it
    assert gain(found, SPOT, 1024) == pytest.approx(error_times_samples(SPOT, FLAT) / error_times_samples(SPOT, samples))
    assert 0.95 * exact < gain(found, SPOT, 1024) <= exact


def test_even_noise_is_left_in_one_piece():
    found = allocate(FLAT, 100.0, 1e-3, floor=0.0)
    assert found.cells == ((0, 0, 64, 36),)
    assert gain(found, FLAT, 16) == 1.0
    assert [one.samples for one in found.regions(64, 36, 16)] == [16]


def test_a_black_picture_has_no_noise():
    found = allocate(np.zeros((9, 16)), 1.0, 0.01, floor=0.0)
    assert found.cells == ((0, 0, 16, 9),) and gain(found, np.zeros((9, 16)), 4) == 1.0
    assert [one.samples for one in found.regions(16, 9, 4)] == [4]


def test_rectangles_that_cost_more_than_they_save_are_not_made():
    """Each division pays by itself: the sum of what is expected falls with every one, and would not with one more."""
    cells = [len(allocate(SPOT, 100.0, each, floor=0.0).cells) for each in (1e-3, 20.0, 60.0, 1e3)]
    assert cells[0] == 5 and cells[-1] == 1 and cells == sorted(cells, reverse=True)


def test_the_gain_does_not_depend_on_the_unit():
    found, brighter = allocate(SPOT, 100.0, 0.1, floor=0.0), allocate(1e6 * SPOT, 100.0, 0.1, floor=0.0)
    assert found.cells == brighter.cells
    assert brighter.deviations == pytest.approx([1e3 * one for one in found.deviations])


def test_where_a_pilot_saw_no_noise_samples_are_left():
    """A fifth of the mean deviation everywhere: nowhere fewer than about a sixth of the samples."""
    dark = np.where(SPOT > 1.0, 25.0, 0.0)
    samples = counts(allocate(dark, 100.0, 1e-3).regions(64, 36, 256), 64, 36)
    assert 0.08 < samples.min() / 256 < 0.25 and samples.max() > 1024


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 90), st.integers(1, 70), st.integers(1, 300), st.integers(0, 2**32 - 1))
def test_regions_cover_every_picture_once_and_keep_the_mean(width, height, samples, seed):
    rng = np.random.default_rng(seed)
    pilot = rng.gamma(0.1, 1.0, (min(height, 20), min(width, 30)))
    found = allocate(pilot, 100.0, 0.01)
    regions = found.regions(width, height, samples)
    per_pixel = counts(regions, width, height)
    assert per_pixel.min() >= 1
    assert per_pixel.mean() <= samples
    assert all(one.samples & (one.samples - 1) == 0 for one in regions)
    assert sum(one.pixels for one in regions) == width * height


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_more_rectangles_are_never_worse_for_the_variance_they_know(seed):
    """G falls with each division (Cauchy and Schwarz)."""
    pilot = np.random.default_rng(seed).gamma(0.2, 1.0, (18, 32))
    spreads = []
    for each in (1e3, 1.0, 0.1, 1e-3):
        found = allocate(pilot, 100.0, each, floor=0.0)
        spreads.append(sum(d * (c[2] - c[0]) * (c[3] - c[1]) for c, d in zip(found.cells, found.deviations)))
        for cell, deviation in zip(found.cells, found.deviations):
            left, top, right, bottom = cell
            assert deviation == pytest.approx(np.sqrt(pilot[top:bottom, left:right].mean()))
    assert all(later <= earlier * (1.0 + 1e-12) for earlier, later in zip(spreads, spreads[1:]))


def test_the_variance_is_that_of_one_sample():
    rng = np.random.default_rng(4)
    pictures = 3.0 + rng.normal(size=(400, 5, 6, 3)) * np.array([1.0, 2.0, 3.0]) / 4.0
    assert variance_of(pictures, 16).mean() == pytest.approx((1.0 + 4.0 + 9.0) / 3.0, rel=0.03)
    with pytest.raises(ValueError, match="2 pictures at least, got 1"):
        variance_of(pictures[:1], 16)


def drawn(deviation, count, rng):
    return 1.0 + rng.normal(size=(count, *deviation.shape, 3)) * deviation[..., None]


def test_what_is_held_out_tells_the_gain():
    """Gaussian noise: with 200 pictures the gain of the known variance, with 4 somewhat less, for its allocation knows less."""
    rng = np.random.default_rng(7)
    deviation = np.sqrt(SPOT)
    known = gain(allocate(SPOT, 100.0, 0.1), SPOT, 1024)
    assert held_out_gain(drawn(deviation, 200, rng), 1, 100.0, 0.1) == pytest.approx(known, rel=0.02)
    assert 0.7 * known < held_out_gain(drawn(deviation, 4, rng), 1, 100.0, 0.1) < 1.1 * known


def test_rare_bright_samples_are_not_taken_for_a_pattern():
    """One pixel in 500 is bright, elsewhere in each picture: what a pilot saw is of no use, and it says so."""
    rng = np.random.default_rng(3)
    pictures = 1.0 + 100.0 * (rng.random((4, 36, 64, 1)) < 0.002) * np.ones(3)
    told = gain(allocate(variance_of(pictures, 1), 100.0, 0.1), variance_of(pictures, 1), 1024)
    assert told > 3.0  # what it believes of itself
    assert held_out_gain(pictures, 1, 100.0, 0.1) < 1.1


def test_no_rectangle_has_more_samples_than_a_round_may_have():
    regions = allocate(SPOT, 100.0, 1e-3, floor=0.0).regions(64, 36, MOST_SAMPLES // 2)
    assert max(one.samples for one in regions) == MOST_SAMPLES // 2


def test_no_rectangle_has_fewer_samples_than_are_asked_for():
    found = allocate(SPOT, 100.0, 1e-3, floor=0.0)
    for samples, least in ((24, 16), (16, 16)):
        regions = found.regions(64, 36, samples, least)
        assert min(one.samples for one in regions) == least
        assert sum(one.pixels * one.samples for one in regions) <= samples * 64 * 36
    assert min(one.samples for one in found.regions(64, 36, 24)) < 16


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="samples must be >= 1, got 0"):
        Allocation(1, 1, ((0, 0, 1, 1),), (1.0,)).regions(4, 4, 0)
