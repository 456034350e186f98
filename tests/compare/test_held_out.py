# SPDX-License-Identifier: GPL-3.0-or-later
"""The error of a filter told by the other half, on pictures whose truth is known."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from volumetrics_addon.compare import held_out
from volumetrics_addon.compare.rounds import Rounds

ROWS, COLUMNS = np.mgrid[:40, :50]
TRUTH = np.stack([1.0 + 0.5 * np.sin(COLUMNS / 7.0 + c) * np.cos(ROWS / 5.0) for c in range(3)], axis=-1)


def noisy(count, rng):
    """Rounds whose noise is skewed and grows with the light, as that of paths does."""
    rounds = Rounds()
    for _ in range(count):
        rounds.add(TRUTH * rng.gamma(0.5, 2.0, TRUTH.shape))
    return rounds


FILTERS = {
    "none": lambda image: image,
    "gentle": lambda image: gaussian_filter(image, (0.7, 0.7, 0.0)),
    "blurred": lambda image: uniform_filter(image, (9, 9, 1)),
    "darkened": lambda image: 0.9 * image,
    "flat": lambda image: np.broadcast_to(image.mean(axis=(0, 1)), image.shape),
}


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("count", [8, 11])
def test_the_square_is_that_of_the_filtered_halves(name, count):
    """Unbiased: over 40 pictures the told squares are the true ones; nearly all bounds hold for the mean of both."""
    rng = np.random.default_rng(count)
    told, true, held = [], [], 0
    for _ in range(40):
        halves, variances = noisy(count, rng).halves
        filtered = [FILTERS[name](half) for half in halves]
        value, upper = held_out.error(filtered, halves, variances)
        told.append(value**2)
        true.append(np.mean([np.mean((picture - TRUTH) ** 2) for picture in filtered]))
        held += np.sqrt(np.mean(((filtered[0] + filtered[1]) / 2.0 - TRUTH) ** 2)) <= upper
    spread = np.std(told, ddof=1) / np.sqrt(len(told))
    assert np.mean(told) == pytest.approx(np.mean(true), abs=4.0 * spread)
    assert held >= 36


def test_the_mean_of_both_is_no_further_than_they_are():
    rng = np.random.default_rng(5)
    halves, variances = noisy(8, rng).halves
    filtered = [FILTERS["gentle"](half) for half in halves]
    each = [np.mean((picture - TRUTH) ** 2) for picture in filtered]
    assert np.mean((sum(filtered) / 2.0 - TRUTH) ** 2) <= np.mean(each)


def test_a_filter_that_knows_the_truth_has_no_error():
    halves, variances = noisy(8, np.random.default_rng(2)).halves
    value, upper = held_out.error([TRUTH, TRUTH], halves, variances)
    assert value < 0.05 and upper < 0.1
