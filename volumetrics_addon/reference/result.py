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

    ``image`` (height, width, 3) linear radiance, row 0 at the top; ``error_estimate`` of the same shape: the standard error
    of the repeats and the method's own doubt about each pixel (quadrature order, truncation), added in quadrature;
    ``systematic``: that doubt alone, which more samples would not remove, as radiance averaged over the image;
    ``evaluations``: in-scatter or path-vertex evaluations; ``seconds``: wall time; ``repeats`` (k, height, width, 3): the
    independent images behind mean and error. A single repeat of a random image knows no error: its estimate is infinite.
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

    def result(self, evaluations: int, integrator: str, systematic: float | np.ndarray = 0.0, exact: bool = False) -> Result:
        """``systematic``: absolute error (radiance) by construction, a number or an image; ``exact``: nothing was random."""
        images = np.stack(self.images) if len(self.images) > 1 else self.images[0][None]
        doubt = np.broadcast_to(systematic, images[0].shape)
        if exact:
            error = doubt
        elif len(images) > 1:
            # On a ray through a light single scattering is infinite, and so is its spread.
            with np.errstate(over="ignore", invalid="ignore"):
                spread = images.std(axis=0, ddof=1) / np.sqrt(len(images))
            error = np.hypot(np.where(np.isnan(spread), np.inf, spread), doubt)
        else:
            error = np.full_like(images[0], np.inf)
        mean = images.mean(axis=0) if len(images) > 1 else images[0]
        return Result(mean, error, evaluations, time.perf_counter() - self._start, float(np.mean(systematic)),
                      integrator, images)


def subpixels(width: int, height: int, strata: int, rng: np.random.Generator) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Raster positions, one jittered set for each of strata x strata cells of the pixel: a stratified repeat.

    ``strata`` 0 gives one set at the exact centres of the pixels: an image without the pixel's filter, on which methods
    can be compared to the last digit.
    """
    column, row = np.tile(np.arange(float(width)), height), np.repeat(np.arange(float(height)), width)
    if strata == 0:
        yield column + 0.5, row + 0.5
    for cell in range(strata * strata):
        x = column + (cell % strata + rng.random(width * height)) / strata
        y = row + (cell // strata + rng.random(width * height)) / strata
        yield x, y
