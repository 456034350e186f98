# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a render is off whatever its samples: measured on a small picture, against a reference or a longer pilot."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ..compare.statistics import Comparison, Estimate, compare
from ..plan.effort import CONFIDENCE

REPEATS = 8  # that each measurement begins with, of render and reference
CLEAR = 0.5  # RMS noise of the small pictures over a bias that is known well enough


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

    Images are added to the noisier side until the bias is known to be below ``goal``, or stands out at twice the noise of a
    pixel; after ``seconds`` a bias below ``enough`` will do, and images that would take more than ``most_seconds`` in all are
    left out. ``noisy``: whether ``mine`` is. ``independent``: the other's pixels share no random numbers. None where the
    pictures have pixels that are not finite, or are black.
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
        variance = (render.standard_error**2 + truth.standard_error**2).mean(axis=-1) / truth.mean_value**2
        upper = _upper(compared, variance)
        noises = {mine: float(np.mean(render.standard_error**2)), other: float(np.mean(truth.standard_error**2))}
        noisier = max(noises, key=noises.get)
        elapsed = time.perf_counter() - start
        expected = elapsed + 2.0 * taken[noisier]  # as many again as there are, so that each turn halves the variance
        if upper <= goal or float(variance.mean()) <= (CLEAR * compared.rmse_denoised) ** 2 or expected > most_seconds \
                or (expected > seconds and upper <= enough):
            found = compared.rmse_denoised if compared.rmse_denoised > compared.rmse_noise_floor else 0.0
            return Bias(found, upper + systematic() / truth.mean_value, compared.mean_relative_error,
                        compared.mean_relative_interval, against, images[mine].shape[2], images[mine].shape[1], elapsed)
        report(f"bias below {upper:.2%}", min(1.0, elapsed / max(seconds, 1e-9)))
        add(noisier)


def _upper(compared: Comparison, variance: np.ndarray) -> float:
    """What the RMSE stays under: the denoised one, and the quantile of what noise adds to its square.

    The comparison measures the latter from the spread of all pixels, to which a bias that differs between them adds; with
    variances v of pixels that are independent and Gaussian it has the variance mean(2 v^2 + 4 bias^2 v) over their number.
    """
    found = compared.rmse_denoised
    gaussian = math.sqrt(float(np.mean(2.0 * variance**2 + 4.0 * found**2 * variance)) / variance.size)
    floor = compared.rmse_noise_floor**2
    if found**2 > floor:
        floor = min(floor, NormalDist().inv_cdf(CONFIDENCE) * gaussian)
    return math.sqrt(found**2 + floor)
