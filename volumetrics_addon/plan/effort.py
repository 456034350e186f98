# SPDX-License-Identifier: GPL-3.0-or-later
"""How much to render for an error or within a time: rounds of equal length, and the bound that their spread gives.

A picture is the mean of k rounds: independent renders of equally many samples, with consecutive seeds. Its error is the relative
RMSE, sqrt(mean((x - t)^2)) / mean(t), against the converged picture t. Round k adds the square q_k = (k - 1) / k
mean((x_k - m_(k-1))^2) to the mean m of the rounds before it (Helmert's contrasts, Welford's sums): each q has the variance of a
round as its expectation, their mean is the unbiased variance of a round, and their own spread tells how much the pixels agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist, fmean, variance

from .rules import MOST_SAMPLES

ROUNDS = 8  # before a bound is trusted, and at least so many where there is a choice
FEWEST_ROUNDS = 5  # of which a bound is given at all: it takes the spread of four squares
OVERHEAD = 0.1  # of a round's time, at most, for what each render does once
TYPICAL_ROUND = 64  # samples for which a picture is planned, before a pilot has found those of a round
ROUND_SECONDS = 10.0  # an interruption costs a round: it is no longer than this where its overhead, and what it learns, allow
CONFIDENCE = 0.95
# Where renders learn (see learned_samples), measured in Blender 5.2 by scripts/few_samples.py: the second sample of a pixel is 6 % too
# dark on foggy-street, 3 % on spot-haze; the variance of a sample falls to 0.4 and 0.3 of the first's by the 64th and little beyond.
LEARNED, LOST, LOST_SHARE = 64, 0.06, 0.2


@dataclass(frozen=True)
class Pilot:
    """``variance`` of one sample over the square of the picture's mean; ``sample_seconds`` of one sample of every pixel;
    ``fixed_seconds`` of each render, however many samples it has. ``by_samples``: the variance by the samples of a render, which
    where Sobol's sequence stratifies well falls with them: measured as (samples, samples times the variance of the render)."""

    variance: float
    sample_seconds: float
    fixed_seconds: float
    by_samples: tuple[tuple[int, float], ...] = ()

    def seconds(self, samples: int) -> float:
        """Of one round."""
        return self.fixed_seconds + samples * self.sample_seconds


@dataclass(frozen=True)
class Schedule:
    """Samples of every round, and what is expected: rounds and seconds until the target is reached or the time is spent."""

    samples: int
    rounds: int
    seconds: float


def resolved(pilot: Pilot, noise: float) -> Pilot:
    """The pilot with the variance that makes eight rounds of the shortest render that is enough for this noise.

    Enough are n samples, a power of two, where variance(n) <= 8 n noise^2; between the measured n it follows a power law.
    """
    for (first, high), (last, low) in zip(pilot.by_samples, pilot.by_samples[1:] + pilot.by_samples[-1:]):
        samples = first
        while samples < last or samples == first:
            share = math.log(samples / first) / math.log(last / first) if last > first else 0.0
            between = high ** (1.0 - share) * low**share if low > 0.0 else high
            if between <= ROUNDS * samples * noise**2:
                return replace(pilot, variance=max(between, ROUNDS * samples * noise**2 * (1.0 + 1e-9)))
            samples *= 2
    return pilot


def samples_for(variance_of_sample: float, noise: float) -> float:
    """Samples of a pixel until the relative noise is ``noise``: variance / noise^2."""
    return variance_of_sample / noise**2


def learned_samples(noise: float) -> int:
    """Samples of a render, a power of two, whose bias is at most a fifth of the relative ``noise`` > 0 where they learn.

    Blender 5 learns from the samples of a render how much of a pixel's light scatters in media. The second is off, presumably since it
    is stratified against the first that it learned from: n >= 2 samples are LOST / n off in the mean, which no number of rounds mends.
    """
    return 1 << max(0, math.ceil(math.log2(LOST / (LOST_SHARE * noise))))


def schedule(pilot: Pilot, noise: float | None = None, seconds: float | None = None, *, most_samples: int = MOST_SAMPLES,
             samples: int | None = None, learns: bool = False, denoised: float = 1.0) -> Schedule:
    """Rounds that bring the relative noise to ``noise``, or fill ``seconds``, whichever is less.

    A round has a power of two of samples, for the sake of Sobol's sequence: so many that the fixed cost of a render is below a
    tenth of it, and as many as fit into ten seconds, but no more than leaves eight rounds. Where the fixed cost alone leaves fewer
    rounds, it is the rounds that fit, two at least. Where renders learn (``learns``) a round has LEARNED samples however long they take,
    and those of ``learned_samples``. ``denoised``: what the noise is hoped to be divided by when the rounds have ended; eight rounds of
    ``learned_samples`` are rendered nevertheless where it takes them without that hope. ``samples`` gives those of a round instead.
    """
    if noise is None and seconds is None:
        raise ValueError("neither an error nor a time is given; give one of them")
    step, fixed = max(pilot.sample_seconds, 1e-9), pilot.fixed_seconds
    total = plain = float(most_samples)
    if noise is not None:
        total, plain = (min(total, max(1.0, samples_for(pilot.variance, goal))) for goal in (noise * denoised, noise))
    if samples is None:
        wanted = max(fixed / step * (1.0 / OVERHEAD - 1.0), (ROUND_SECONDS - fixed) / step, LEARNED if learns else 1)
        wanted = min(wanted, total / ROUNDS)
        if learns and noise is not None:
            wanted = max(wanted, min(learned_samples(noise), plain / ROUNDS))
        if seconds is not None:
            rounds = min(ROUNDS, max(2, int(seconds / (fixed + step))))
            wanted = min(wanted, (seconds / rounds - fixed) / step)
        samples = power_of_two(min(wanted, MOST_SAMPLES / 2))
    rounds = max(ROUNDS if noise is not None else 1, math.ceil(total / samples))
    rounds = max(1, min(rounds, most_samples // samples))
    if seconds is not None:
        rounds = max(1, min(rounds, int(seconds / pilot.seconds(samples))))
    return Schedule(samples, rounds, rounds * pilot.seconds(samples))


def power_of_two(value: float) -> int:
    """The largest power of two that is not above the value; 1 below 1."""
    return 1 << max(0, math.floor(math.log2(max(value, 1.0))))


def noise_of(squares: Sequence[float]) -> float:
    """Standard error of the mean of all rounds, as RMS over the pixels, from the square that each round but the first added."""
    return math.sqrt(fmean(squares) / (len(squares) + 1)) if squares else math.inf


def noise_bound(squares: Sequence[float], confidence: float = CONFIDENCE) -> float:
    """What the RMS error of the mean of all rounds stays under with ``confidence``; infinite for fewer than five rounds.

    The error's square is one draw, and the variance over k is the mean of k - 1 like it, so their ratio has an F distribution.
    Its degrees of freedom n are those of a chi-square as widespread as the squares are, 2 mean^2 / variance (Satterthwaite): few
    pixels, correlated ones and rare bright samples all lower them. They are known from k - 1 squares alone and therefore taken
    at their own lower bound.
    """
    count = len(squares)
    if count + 1 < FEWEST_ROUNDS:
        return math.inf
    mean = fmean(squares)
    if mean <= 0.0:
        return 0.0
    spread = variance([square / mean for square in squares])
    if spread <= 0.0:
        return noise_of(squares)
    own = 2.0 / (spread * (count - 1) / chi_square_quantile(1.0 - confidence, count - 1))
    own = max(own, 0.5)  # below, one sample decides the picture, and no approximation holds
    return noise_of(squares) * math.sqrt(f_quantile(confidence, own, count * own))


def chi_square_quantile(p: float, dof: float) -> float:
    """Wilson and Hilferty (1931): the 5 % quantile is 6.7 % low at three degrees of freedom, 2.9 % at four, 1 % at six."""
    return dof * max(0.0, 1.0 - 2.0 / (9.0 * dof) + NormalDist().inv_cdf(p) * math.sqrt(2.0 / (9.0 * dof))) ** 3


def f_quantile(p: float, first: float, second: float) -> float:
    """Paulson (1942), p >= 1/2: the cube root of F solves ((1 - b) x - (1 - a))^2 = z^2 (b x^2 + a), a = 2 / (9 first), b alike.

    The 95 % quantile with second >= 8 first is within 7 % for first = 1/2, 2.5 % for 1, 1 % from 2 on.
    """
    a, b, z = 2.0 / (9.0 * first), 2.0 / (9.0 * second), NormalDist().inv_cdf(p)
    square = (1.0 - b) ** 2 - z * z * b
    if square <= 0.0:
        return math.inf
    half = (1.0 - a) * (1.0 - b)
    return ((half + math.sqrt(max(0.0, half * half - square * ((1.0 - a) ** 2 - z * z * a)))) / square) ** 3


def ladder_error(differences: Sequence[float]) -> tuple[float, float]:
    """Error and bound of the last picture of a ladder, each with four times the samples of the one before, without seeds.

    ``differences``: RMS between neighbours. A picture holds the samples of the one before it, so that the variance falls from 4 v
    to v and the difference has 3 v: the error is the last difference over sqrt(3). The bound is what is left of a geometric
    series d (r + r^2 + ...) = d r / (1 - r), with the measured ratio r of the differences, at least the 1/2 of noise; infinite
    where they no longer fall. With one difference alone r is not known, and the bound is infinite too.
    """
    if not differences:
        return math.inf, math.inf
    last = differences[-1]
    if last == 0.0:
        return 0.0, 0.0
    ratio = max(0.5, last / differences[-2]) if len(differences) > 1 and differences[-2] > 0.0 else 1.0
    return last / math.sqrt(3.0), last * ratio / (1.0 - ratio) if ratio < 1.0 else math.inf


def noise_left(target: float, bias: float) -> float:
    """The noise that together with this bias makes the target, sqrt(target^2 - bias^2); the target where bias alone exceeds it."""
    return math.sqrt(target * target - bias * bias) if bias < target else target
