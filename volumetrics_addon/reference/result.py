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
    ``seconds``: wall time; ``repeats`` (k, height, width, 3): the independent images behind mean and error. A single
    repeat knows no error: its estimate is infinite.
    """

    image: np.ndarray
    error_estimate: np.ndarray
    evaluations: int
    seconds: float
    systematic: float = 0.0
    integrator: str = ""
    repeats: np.ndarray | None = None


class Accumulator:
    """Collects equally distributed images and turns them into a Result."""

    def __init__(self) -> None:
        self.images: list[np.ndarray] = []
        self._start = time.perf_counter()

    def add(self, image: np.ndarray) -> None:
        self.images.append(image)

    def result(self, evaluations: int, integrator: str, systematic: float = 0.0) -> Result:
        images = np.stack(self.images)
        error = images.std(axis=0, ddof=1) / np.sqrt(len(images)) if len(images) > 1 else np.full_like(images[0], np.inf)
        return Result(images.mean(axis=0), error, evaluations, time.perf_counter() - self._start, systematic, integrator,
                      images)


def subpixels(width: int, height: int, strata: int, rng: np.random.Generator) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Raster positions, one jittered set for each of strata x strata cells of the pixel: a stratified repeat."""
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    for cell in range(strata * strata):
        x = column.ravel() + (cell % strata + rng.random(width * height)) / strata
        y = row.ravel() + (cell // strata + rng.random(width * height)) / strata
        yield x, y
