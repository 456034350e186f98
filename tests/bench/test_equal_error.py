# SPDX-License-Identifier: GPL-3.0-or-later
"""Ladders of samples, read at one error: against ladders whose seconds have a closed form."""

import math

import numpy as np
import pytest

from volumetrics_addon.bench.equal_error import (
    Rung, at_error, common_error, descending, fixed_and_growing, rms, seconds_at_size, soonest,
)


def ladder(noise, fixed, each, samples=(4, 16, 64, 256)):
    """A picture of n samples has the error noise / sqrt(n) and takes fixed + each n seconds."""
    return [Rung(n, fixed + each * n, 2.0 * (fixed + each * n), noise / math.sqrt(n)) for n in samples]


def test_samples_at_an_error_follow_the_square_law_between_rungs():
    rungs = ladder(1.0, 0.0, 0.01)
    for error in (0.5, 0.37, 0.2, 0.0625):
        assert at_error(rungs, error, "samples") == pytest.approx(1.0 / error**2, rel=1e-12)
        assert at_error(rungs, error, "cpu") == pytest.approx(0.01 / error**2, rel=1e-12)
        assert at_error(rungs, error, "wall") == pytest.approx(0.02 / error**2, rel=1e-12)


def test_half_the_noise_is_a_gain_of_four():
    stock, planned = ladder(2.0, 0.0, 0.01), ladder(1.0, 0.0, 0.01)
    error = common_error([stock, planned], 0.2)
    assert error == 0.2
    assert at_error(stock, error, "cpu") / at_error(planned, error, "cpu") == pytest.approx(4.0, rel=1e-12)


def test_the_common_error_is_the_wanted_one_or_the_nearest_in_the_overlap():
    coarse, fine = ladder(8.0, 0.0, 0.01), ladder(1.0, 0.0, 0.01)  # 4 to 0.5, and 0.5 to 0.0625
    assert common_error([coarse, fine], 0.01) == 0.5 == common_error([coarse, fine], 10.0)
    assert common_error([fine, fine], 0.1) == 0.1
    with pytest.raises(ValueError, match="no error is common.*ends at 1, another starts at 0.5; widen"):
        common_error([ladder(16.0, 0.0, 0.01), fine], 0.1)


def test_nothing_is_extrapolated():
    for error in (0.51, 0.06):
        with pytest.raises(ValueError, match="outside the ladder's 0.0625 to 0.5"):
            at_error(ladder(1.0, 0.0, 0.01), error, "cpu")


def test_a_rung_that_gains_nothing_is_passed_over():
    rungs = ladder(1.0, 0.0, 0.01)
    stuck = [*rungs[:2], Rung(32, 9.0, 9.0, 0.3), *rungs[2:]]
    assert descending(stuck[::-1]) == rungs
    assert at_error(stuck, 0.2, "cpu") == at_error(rungs, 0.2, "cpu")


@pytest.mark.parametrize(("fixed", "each"), [(3.0, 0.01), (0.0, 0.2), (5.0, 0.0)])
def test_what_is_fixed_is_told_from_what_grows(fixed, each):
    assert fixed_and_growing(ladder(1.0, fixed, each)) == pytest.approx((fixed, each), abs=1e-9)


def test_neither_part_is_below_nothing():
    assert fixed_and_growing([Rung(4, 1.0, 1.0, 0.5), Rung(16, 9.0, 9.0, 0.2)])[0] == 0.0
    assert fixed_and_growing([Rung(4, 9.0, 9.0, 0.5), Rung(16, 1.0, 1.0, 0.2)])[1] == 0.0


def test_a_large_picture_pays_what_is_fixed_once():
    """3 s + 0.01 s a sample, 100 samples for this error: 3 + 1000 times 1 second."""
    assert seconds_at_size(ladder(1.0, 3.0, 0.01), 0.1, 1000.0) == pytest.approx(1003.0, rel=1e-9)


def test_the_truth_s_own_noise_is_taken_off():
    rng = np.random.default_rng(5)
    exact = rng.uniform(1.0, 3.0, (200, 200))
    truths = exact + rng.normal(0.0, 0.3, (8, 200, 200))
    pictures = exact + rng.normal(0.0, 0.2, (4, 200, 200))
    found = rms(pictures, truths.mean(axis=0), truths.var(axis=0, ddof=1) / 8)
    # 160,000 squares of deviation 0.2^2 + 0.3^2 / 8, of which sqrt(2 / 160,000) is 0.35 %; the mean of 40,000 is known to 0.3 %
    assert found == pytest.approx(0.2 / exact.mean(), rel=0.015)


def test_where_samples_do_not_help_the_first_rung_that_is_as_good_counts():
    flat = [Rung(1, 1.0, 1.0, 0.40), Rung(4, 2.0, 2.0, 0.353), Rung(16, 5.0, 5.0, 0.36), Rung(64, 17.0, 17.0, 0.35)]
    assert soonest(flat, 0.35) == flat[1] and soonest(flat[::-1], 0.4) == flat[0]
    assert soonest(flat, 0.35, slack=0.0) == flat[3]
    with pytest.raises(ValueError, match="no rung has the error 0.2; the best has 0.35"):
        soonest(flat, 0.2)
