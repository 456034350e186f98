# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples and rounds from a pilot's figures, and the bound on the error, against closed forms and streams of known noise."""

import math

import numpy as np
import pytest
from scipy import stats

from volumetrics_addon.compare.rounds import Rounds
from volumetrics_addon.plan import effort
from volumetrics_addon.plan.effort import Pilot, schedule

PLAIN = Pilot(variance=4.0, sample_seconds=0.01, fixed_seconds=0.0)


def test_samples_follow_from_variance_and_target():
    """A variance of 4 in one sample takes 4 / 0.02^2 = 10 000 samples for 2 %; four times as many for half of that."""
    planned = schedule(PLAIN, noise=0.02)
    assert planned.samples * (planned.rounds - 1) < 10_000 <= planned.samples * planned.rounds
    assert planned.seconds == pytest.approx(0.01 * planned.samples * planned.rounds)
    finer = schedule(PLAIN, noise=0.01)
    assert finer.samples * (finer.rounds - 1) < 40_000 <= finer.samples * finer.rounds


@pytest.mark.parametrize("fixed", [0.0, 0.1, 1.0, 20.0])
@pytest.mark.parametrize("noise", [0.05, 0.005])
def test_overhead_is_small_and_rounds_are_many(fixed, noise):
    pilot = Pilot(4.0, 0.01, fixed)
    planned = schedule(pilot, noise=noise)
    assert planned.rounds >= 8 and planned.samples.bit_count() == 1
    if planned.samples * 16 <= 4.0 / noise**2:  # not held down by the eight rounds: within a power of two of what was wanted
        assert fixed <= 2.0 * 0.1 * pilot.seconds(planned.samples)
        assert pilot.seconds(planned.samples) <= max(10.0, 10.0 * fixed) * (1.0 + 1e-9)


@pytest.mark.parametrize("seconds", [0.5, 5.0, 60.0, 3600.0])
@pytest.mark.parametrize("fixed", [0.0, 0.05, 2.0, 40.0])
def test_a_time_is_filled_and_not_exceeded(seconds, fixed):
    pilot = Pilot(4.0, 0.01, fixed)
    planned = schedule(pilot, seconds=seconds)
    if pilot.seconds(1) * 2 <= seconds:
        assert 2 <= planned.rounds and planned.seconds <= seconds
        assert planned.seconds + pilot.seconds(planned.samples) > seconds  # no further round fits
        if 8 * pilot.seconds(1) <= seconds:
            assert planned.rounds >= 8
    else:
        assert (planned.rounds, planned.samples) == (1, 1)  # a picture there must be


def test_the_nearer_limit_counts():
    assert schedule(PLAIN, noise=0.1, seconds=1e6) == schedule(PLAIN, noise=0.1)
    assert schedule(PLAIN, noise=1e-6, seconds=10.0).seconds <= 10.0
    limited = schedule(PLAIN, noise=1e-6, most_samples=100)
    assert limited.samples * limited.rounds <= 100 and limited.rounds >= 8
    assert schedule(PLAIN, noise=0.02, samples=100).samples == 100
    with pytest.raises(ValueError, match="neither an error nor a time"):
        schedule(PLAIN)


def test_rounds_that_learn_are_as_long_as_learning_takes():
    """A picture so large that ten seconds are two samples: 64 nevertheless, or what leaves eight rounds; more where 6 % of one sample
    would be more than a fifth of the error."""
    large = Pilot(4.0, 4.0, 0.0)
    assert schedule(large, noise=0.02).samples == 2
    assert schedule(large, noise=0.02, learns=True).samples == 64
    assert schedule(large, noise=0.2, learns=True).samples == 8 and schedule(large, noise=0.2, learns=True).rounds == 13  # 100 in all
    assert schedule(large, noise=0.02, seconds=100.0, learns=True).seconds <= 100.0
    assert schedule(PLAIN, noise=0.02, learns=True) == schedule(PLAIN, noise=0.02)  # is longer anyway
    assert [effort.learned_samples(noise) for noise in (1.0, 0.1, 0.01, 0.001)] == [1, 4, 32, 512]
    assert schedule(large, noise=0.001, learns=True).samples == 512


def test_rounds_that_may_be_denoised_are_no_darker_than_without_it():
    """A third of the noise takes a ninth of the samples, in eight rounds as short; but where they learn, as long as the error itself
    wants them, or as leaves eight rounds of the samples that are due without denoising."""
    quiet = Pilot(0.02, 4.0, 0.0)
    assert schedule(quiet, noise=0.01).samples == schedule(quiet, noise=0.01, denoised=3.0).samples == 2  # 200 samples, or 22: ten seconds
    for noise, due, samples, rounds in ((0.01, 200, 16, 8), (0.03, 22.22, 2, 8), (0.001, 20000, 512, 8)):
        assert due == pytest.approx(quiet.variance / noise**2, rel=1e-3) and samples <= due / 8
        planned = schedule(quiet, noise=noise, learns=True, denoised=3.0)
        assert (planned.samples, planned.rounds) == (samples, rounds)
        assert samples >= 0.06 / (0.2 * noise) or 2 * samples > due / 8


def test_stratified_samples_count_as_what_they_are():
    """A variance of 1 / n in renders of n samples: n of them have the error 1 / n, and eight rounds of n take 1 / (n sqrt(8))."""
    pilot = Pilot(1 / 64, 0.01, 0.0, tuple((n, 1.0 / n) for n in (1, 4, 16, 64)))
    for noise, samples in ((0.4, 1), (0.2, 2), (0.1, 4), (0.02, 32), (0.012, 32), (0.006, 64)):
        assert samples == 64 or 1.0 / (samples * math.sqrt(8.0)) <= noise < 2.0 / (samples * math.sqrt(8.0))
        planned = schedule(effort.resolved(pilot, noise), noise=noise)
        assert planned.samples == samples and planned.rounds in (8, 9)
    assert effort.resolved(pilot, 1e-4).variance == 1 / 64  # as few as were measured
    assert effort.resolved(PLAIN, 0.1) is PLAIN


def test_a_picture_without_noise_takes_the_fewest_rounds():
    assert schedule(Pilot(0.0, 0.01, 0.0), noise=0.01).rounds == 8


@pytest.mark.parametrize("value, power", [(0.0, 1), (1.0, 1), (1.9, 1), (2.0, 2), (1023.0, 512), (1024.0, 1024)])
def test_power_of_two(value, power):
    assert effort.power_of_two(value) == power


def test_quantiles():
    for dof, accuracy in ((3, 0.07), (4, 0.03), (6, 0.01), (20, 0.01), (300, 0.01)):
        assert effort.chi_square_quantile(0.05, dof) == pytest.approx(stats.chi2.ppf(0.05, dof), rel=accuracy)
    for first, accuracy in ((0.5, 0.07), (1.0, 0.025), (2.0, 0.01), (10.0, 0.01), (200.0, 0.01)):
        for second in (8.0 * first, 40.0 * first):
            assert effort.f_quantile(0.95, first, second) == pytest.approx(stats.f.ppf(0.95, first, second), rel=accuracy)


def test_bound_of_few_rounds_is_unknown_and_of_equal_ones_zero():
    assert effort.noise_of([]) == math.inf and effort.noise_bound([1.0, 1.0, 1.0]) == math.inf
    assert effort.noise_bound([0.0] * 7) == 0.0
    assert effort.noise_of([2.0, 4.0, 6.0]) == pytest.approx(1.0)  # sqrt(mean 4 / 4 rounds)
    wide, narrow = effort.noise_bound([1.0, 9.0, 1.0, 9.0, 5.0, 5.0]), effort.noise_bound([5.0, 5.1, 4.9, 5.0, 5.0, 5.0])
    assert wide > narrow > effort.noise_of([5.0] * 6)


GREY = 3  # channels that share their light
STREAMS = {  # a round of mean 1, and the target at which a few dozen rounds are enough
    "four pixels": (lambda r: 1.0 + 0.3 * r.normal(size=(2, 2, 3)), 0.07),
    "one number": (lambda r: 1.0 + np.full((2, 2, 3), 0.3 * r.normal()), 0.12),
    "gaussian": (lambda r: 1.0 + 0.3 * r.normal(size=(8, 8, 3)), 0.05),
    "brightness and pixels": (lambda r: 1.0 + 0.2 * r.normal() + 0.3 * r.normal(size=(8, 8, 3)), 0.1),
    "gamma": (lambda r: r.gamma(0.05, 20.0, (8, 8, 3)), 1.0),
    "rare bright samples": (lambda r: 0.5 + 50.0 * (r.random((8, 8, 3)) < 0.01), 1.0),
    "fireflies": (lambda r: np.repeat(0.5 + 500.0 * (r.random((32, 32, 1)) < 1e-3), GREY, 2), 3.0),
    "lognormal": (lambda r: np.exp(2.0 * r.normal(size=(16, 16, 3)) - 2.0), 1.2),
    "infinite fourth moment": (lambda r: 1.5 * r.pareto(2.5, (16, 16, 3)), 0.35),
    "infinite variance": (lambda r: 0.8 * r.pareto(1.8, (16, 16, 3)), 1.5),
}


@pytest.mark.either
@pytest.mark.parametrize("name", STREAMS)
def test_the_bound_holds_when_rounds_end_as_soon_as_it_is_low_enough(name):
    """The true error is below the bound at the stop in nine of ten runs at least, whatever the noise is like."""
    draw, target = STREAMS[name]
    held, stopped, runs = 0, 0, 120
    for run in range(runs):
        rng = np.random.default_rng((run, 11))
        rounds = Rounds()
        while rounds.count < 150:
            rounds.add(draw(rng))
            if rounds.count >= effort.ROUNDS and effort.noise_bound(rounds.squares) <= target * rounds.mean.mean():
                stopped += 1
                break
        error = math.sqrt(np.mean((rounds.mean - 1.0) ** 2))
        held += error <= effort.noise_bound(rounds.squares)
    assert held >= 0.9 * runs
    assert stopped >= 0.5 * runs  # the rule was used


def test_the_ladder_states_the_error_of_its_last_picture():
    """Nested means of noise: the estimate is right on average, and the bound holds."""
    estimates, errors, held = [], [], 0
    for run in range(100):
        samples = np.random.default_rng(run).normal(1.0, 1.0, (256, 12, 12))
        pictures = [samples[:count].mean(axis=0) for count in (4, 16, 64, 256)]
        differences = [math.sqrt(np.mean((b - a) ** 2)) for a, b in zip(pictures, pictures[1:])]
        estimate, bound = effort.ladder_error(differences)
        error = math.sqrt(np.mean((pictures[-1] - 1.0) ** 2))
        estimates.append(estimate)
        errors.append(error)
        held += error <= bound
    assert np.mean(estimates) == pytest.approx(np.mean(errors), rel=0.03) and held >= 95


def test_a_ladder_that_does_not_converge_has_no_bound():
    assert effort.ladder_error([]) == (math.inf, math.inf)
    assert effort.ladder_error([0.1])[1] == math.inf
    assert effort.ladder_error([0.1, 0.1])[1] == math.inf
    assert effort.ladder_error([0.1, 0.0]) == (0.0, 0.0)
    assert effort.ladder_error([0.4, 0.1])[1] == pytest.approx(0.1)  # falls faster than noise: as noise
    assert effort.ladder_error([0.4, 0.3])[1] == pytest.approx(0.9)  # 0.3 * 0.75 / 0.25


@pytest.mark.parametrize("target, bias, left", [(0.05, 0.0, 0.05), (0.05, 0.03, 0.04), (0.05, 0.06, 0.05)])
def test_noise_that_bias_leaves(target, bias, left):
    assert effort.noise_left(target, bias) == pytest.approx(left)
