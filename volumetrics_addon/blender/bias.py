# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a render is off whatever its samples: measured on a small picture, against a reference or a longer pilot."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..compare.statistics import Comparison, Estimate, compare
from ..plan.effort import CONFIDENCE

REPEATS = 8  # that each measurement begins with, of render and reference


@dataclass(frozen=True)
class Bias:
    """``value``: relative RMSE without the noise of both pictures, 0 where noise alone could have made it. ``upper``: what it
    stays under with 95 % confidence, the reference's own doubt included. ``mean`` and ``interval``: signed error of the picture's
    mean. ``against``: what it was compared with; on ``width`` x ``height`` pixels."""

    value: float
    upper: float
    mean: float
    interval: tuple[float, float]
    against: str
    width: int
    height: int
    seconds: float

    @property
    def is_seen(self) -> bool:
        return self.value > 0.0


Source = Callable[[int], np.ndarray]  # from how many images there are already, more of them (k, height, width, 3)


def measure(mine: Source, other: Source, against: str, goal: float, enough: float, seconds: float, most_seconds: float, *,
            noisy: bool = True, systematic: Callable[[], float] = lambda: 0.0, independent: bool = False,
            samples: int = 1, progress: Callable[[str, float], None] | None = None) -> Bias | None:
    """Bias of the pictures that ``mine`` makes, against those of ``other``.

    Images are added to the noisier side until the bias is known to be below ``goal``, or seen and at least twice the noise that
    could be taken for one; after ``seconds`` a bias below ``enough`` will do, and images that would take more than
    ``most_seconds`` in all are left out. ``noisy``: of ``mine``. ``independent``: the other's pixels share no random numbers.
    None where the pictures have pixels that are not finite, or are black.
    """
    report = progress or (lambda what, share: None)
    start = time.perf_counter()
    taken: dict[Source, float] = {}
    images: dict[Source, np.ndarray] = {}

    def add(source: Source) -> None:
        began = time.perf_counter()
        more = source(len(images.get(source, ())))
        images[source] = np.concatenate([images[source], more]) if source in images else more
        taken[source] = time.perf_counter() - began

    report("bias: pictures", 0.0)
    add(mine)
    report("bias: reference", 0.3)
    add(other)
    while True:
        if not all(np.isfinite(stack).all() for stack in images.values()) or images[other].mean() <= 0.0:
            return None
        render = Estimate.from_repeats(images[mine], samples) if noisy else Estimate.exact(images[mine][0])
        truth = Estimate.from_repeats(images[other], independent_pixels=independent)
        compared = compare(render, truth, CONFIDENCE)
        result = _bias(compared, systematic() / truth.mean_value, against, time.perf_counter() - start)
        noises = {mine: float(np.mean(render.standard_error**2)), other: float(np.mean(truth.standard_error**2))}
        if result.upper <= goal or compared.rmse_denoised > 2.0 * compared.rmse_noise_floor or not any(noises.values()):
            return result
        noisier = max(noises, key=noises.get)
        expected = result.seconds + 2.0 * taken[noisier]  # as many again as there are, so that each turn halves the variance
        if expected > most_seconds or (expected > seconds and result.upper <= enough):
            return result
        report(f"bias below {result.upper:.2%}", min(1.0, result.seconds / seconds))
        add(noisier)


def _bias(comparison: Comparison, systematic: float, against: str, seconds: float) -> Bias:
    found, floor = comparison.rmse_denoised, comparison.rmse_noise_floor
    return Bias(found if found > floor else 0.0, math.hypot(found, floor) + systematic, comparison.mean_relative_error,
                comparison.mean_relative_interval, against, comparison.z.shape[1], comparison.z.shape[0], seconds)
