# SPDX-License-Identifier: GPL-3.0-or-later
"""How much sooner one way of rendering reaches the error of another: ladders of sample counts, read at one error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rung:
    """One sample count of a ladder: seconds of all processors, seconds on the clock, and relative RMSE."""

    samples: int
    cpu: float
    wall: float
    error: float


def descending(ladder: Sequence[Rung]) -> list[Rung]:
    """The rungs that lower the error, by their samples: noise and an early stop can make a step that gains nothing."""
    kept: list[Rung] = []
    for rung in sorted(ladder, key=lambda rung: rung.samples):
        if not kept or rung.error < kept[-1].error:
            kept.append(rung)
    return kept


def common_error(ladders: Sequence[Sequence[Rung]], wanted: float) -> float:
    """The error nearest to the wanted one that every ladder passes, so that nothing is extrapolated.

    Raises ValueError where the ladders share none.
    """
    low = max(min(rung.error for rung in ladder) for ladder in ladders)
    high = min(max(rung.error for rung in ladder) for ladder in ladders)
    if low > high:
        raise ValueError(f"no error is common to all ladders: one ends at {low:.3g}, another starts at {high:.3g}; "
                         "widen the ladders")
    return min(max(wanted, low), high)


def at_error(ladder: Sequence[Rung], error: float, what: str) -> float:
    """``what`` ("cpu", "wall" or "samples") where the ladder has this error, linear between rungs in both logarithms.

    Raises ValueError where the error lies beyond the ladder.
    """
    rungs = descending(ladder)
    if not rungs[-1].error <= error * (1.0 + 1e-9) or not error <= rungs[0].error * (1.0 + 1e-9):
        raise ValueError(f"the error {error:.3g} lies outside the ladder's {rungs[-1].error:.3g} to {rungs[0].error:.3g}")
    logs = [(math.log(rung.error), math.log(getattr(rung, what))) for rung in reversed(rungs)]
    return math.exp(np.interp(math.log(error), *zip(*logs)))


def soonest(ladder: Sequence[Rung], error: float, slack: float = 0.01) -> Rung:
    """The first rung whose error is at most this one, within the slack: for errors that samples do not lower.

    Raises ValueError where no rung is as good.
    """
    for rung in sorted(ladder, key=lambda rung: rung.samples):
        if rung.error <= error * (1.0 + slack):
            return rung
    raise ValueError(f"no rung has the error {error:.3g}; the best has {min(rung.error for rung in ladder):.3g}")


def fixed_and_growing(ladder: Sequence[Rung]) -> tuple[float, float]:
    """Processor seconds of a picture whatever its samples, and for each sample: relative least squares, neither below 0."""
    samples = np.array([rung.samples for rung in ladder], float)
    cpu = np.array([rung.cpu for rung in ladder])
    rows = np.stack([1.0 / cpu, samples / cpu], axis=1)
    fixed, growing = np.linalg.lstsq(rows, np.ones(len(cpu)), rcond=None)[0]
    if fixed < 0.0:
        return 0.0, float((samples / cpu).sum() / ((samples / cpu) ** 2).sum())
    if growing < 0.0:
        return float((1.0 / cpu).sum() / (1.0 / cpu**2).sum()), 0.0
    return float(fixed), float(growing)


def seconds_at_size(ladder: Sequence[Rung], error: float, pixels: float) -> float:
    """Processor seconds to the error in a picture of ``pixels`` times as many pixels: what is fixed is paid once."""
    fixed, growing = fixed_and_growing(ladder)
    return fixed + growing * pixels * at_error(ladder, error, "samples")


def rms(pictures: np.ndarray, truth: np.ndarray, truth_variance: np.ndarray) -> float:
    """Relative RMSE of pictures (k, ...) against the truth, less the truth's own mean variance; relative to the truth's mean."""
    squared = np.mean((pictures - truth) ** 2) - np.mean(truth_variance)
    return math.sqrt(max(float(squared), 1e-16)) / float(truth.mean())
