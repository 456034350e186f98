# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds added one by one against all of them at once."""

import numpy as np
import pytest

from volumetrics_addon.compare.rounds import Rounds
from volumetrics_addon.compare.statistics import Estimate


def images(count, seed=0):
    return np.random.default_rng(seed).gamma(0.3, 2.0, (count, 5, 7, 3))


def added(stack):
    rounds = Rounds()
    for image in stack:
        rounds.add(image)
    return rounds


@pytest.mark.parametrize("count", [2, 3, 9])
def test_mean_and_error_are_those_of_all_images(count):
    stack = images(count)
    rounds, whole = added(stack), Estimate.from_repeats(stack)
    np.testing.assert_allclose(rounds.mean, whole.value, rtol=1e-13)
    np.testing.assert_allclose(rounds.standard_error, whole.standard_error, rtol=1e-10)
    assert len(rounds.squares) == count - 1
    assert np.mean(rounds.squares) == pytest.approx(stack.var(axis=0, ddof=1).mean(), rel=1e-12)


def test_squares_are_those_of_helmert():
    stack = images(4)
    literal = [k / (k + 1) * np.mean((stack[k] - stack[:k].mean(axis=0)) ** 2) for k in (1, 2, 3)]
    np.testing.assert_allclose(added(stack).squares, literal, rtol=1e-12)


def test_equal_rounds_have_no_spread():
    rounds = added(np.full((5, 2, 2, 3), 0.1) * np.pi)
    assert rounds.squares == [0.0] * 4 and not rounds.standard_error.any()
    assert (added(images(1)).standard_error == np.inf).all()


def test_restored_rounds_go_on_to_the_last_bit():
    stack = images(7).astype(np.float32)
    half = Rounds.restored({name: np.array(value) for name, value in added(stack[:3]).state().items()})
    for image in stack[3:]:
        half.add(image)
    whole = added(stack)
    assert half.squares == whole.squares and half.count == 7
    np.testing.assert_array_equal(half.mean, whole.mean)
    np.testing.assert_array_equal(half.standard_error, whole.standard_error)


def test_wrong_rounds_are_refused():
    rounds = added(images(2))
    bad = images(1)[0]
    bad[3, 4, 1] = np.nan
    with pytest.raises(ValueError, match="round 3 has a pixel that is not finite, at row 3, column 4"):
        rounds.add(bad)
    with pytest.raises(ValueError, match="shape"):
        rounds.add(images(1)[0][:4])
    assert rounds.count == 2
