# SPDX-License-Identifier: GPL-3.0-or-later
"""What every integrator returns, and how repeats become a value with an error."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Result:
    """An image with its stated error.

    ``image`` (height, width, 3) linear radiance, row 0 at the top; ``error_estimate`` of the same shape: one standard
    error per pixel and channel; ``systematic``: bound on what more samples would not remove (quadrature order,
    truncated orders), as radiance averaged over the image; ``evaluations``: in-scatter or path-vertex evaluations;
    ``seconds``: wall time.
    """

    image: np.ndarray
    error_estimate: np.ndarray
    evaluations: int
    seconds: float
    systematic: float = 0.0
    integrator: str = ""


class Accumulator:
    """Mean and standard error of repeated, equally distributed images."""

    def __init__(self, width: int, height: int):
        self.shape = (height, width, 3)
        self.count = 0
        self.mean = np.zeros(self.shape)
        self._m2 = np.zeros(self.shape)
        self._start = time.perf_counter()

    def add(self, image: np.ndarray) -> None:
        """Welford's update, which keeps its digits where the variance is small beside the mean."""
        self.count += 1
        delta = image - self.mean
        self.mean += delta / self.count
        self._m2 += delta * (image - self.mean)

    def result(self, evaluations: int, integrator: str, systematic: float = 0.0) -> Result:
        variance = self._m2 / max(self.count - 1, 1)
        return Result(self.mean.copy(), np.sqrt(variance / self.count), evaluations,
                      time.perf_counter() - self._start, systematic, integrator)


def subpixels(width: int, height: int, strata: int, rng: np.random.Generator) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Raster positions, one jittered set for each of strata x strata cells of the pixel: a stratified repeat."""
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    for cell in range(strata * strata):
        x = column.ravel() + (cell % strata + rng.random(width * height)) / strata
        y = row.ravel() + (cell // strata + rng.random(width * height)) / strata
        yield x, y
