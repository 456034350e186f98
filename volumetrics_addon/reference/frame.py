# SPDX-License-Identifier: GPL-3.0-or-later
"""From the radiance along rays to an image with its error: the frame that integrators of single rays share."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..scene import geometry
from ..scene.model import Scene
from .result import Accumulator, Progress, Result, subpixels

Array = np.ndarray

# (origin (n, 3), direction (n, 3), rng) -> radiance (n, 3), its absolute error by construction (n, 3), evaluations
Radiance = Callable[[Array, Array, np.random.Generator], tuple[Array, Array, int]]

TILE = 1 << 14


def render_rays(name: str, radiance: Radiance, scene: Scene, width: int, height: int, *, repeats: int, strata: int, seed: int,
                random: bool, progress: Progress | None = None, tile: int = TILE) -> Result:
    """Image of ``radiance`` over the camera's pixels, in tiles of rays: memory does not grow with the resolution.

    Each of ``repeats`` images averages strata^2 jittered rays per pixel; with ``strata`` 0 it is one ray through each
    pixel's centre. ``random`` tells whether ``radiance`` differs from call to call: an image at pixel centres that does
    not is rendered once, and its error is the one that ``radiance`` states. Otherwise the error adds the spread of the
    repeats to that.
    """
    exact = strata == 0 and not random
    repeats = 1 if exact else repeats
    rng = np.random.default_rng(seed)
    accumulator = Accumulator()
    evaluations, doubt = 0, np.zeros((height * width, 3))
    rays_per_pixel = max(1, strata * strata)
    done, total = 0, repeats * rays_per_pixel * height * width
    for _ in range(repeats):
        image = np.zeros((height * width, 3))
        for part, x, y in _tiles(width, height, strata, rng, tile):
            value, error, count = radiance(*geometry.camera_rays(scene.camera, width, height, x, y), rng)
            image[part] += value
            doubt[part] += error
            evaluations += count
            done += len(value)
            if progress:
                progress(done / total)
        image /= rays_per_pixel
        accumulator.add(image.reshape(height, width, 3))
    doubt /= repeats * rays_per_pixel
    return accumulator.result(evaluations, name, doubt.reshape(height, width, 3), exact)


def _tiles(width: int, height: int, strata: int, rng: np.random.Generator, tile: int) -> Iterator[tuple[slice, Array, Array]]:
    """Pixels and raster positions x, y of one tile of rays after the other; positions at centres are made tile by tile."""
    pixels = width * height
    parts = [slice(start, min(start + tile, pixels)) for start in range(0, pixels, tile)]
    if strata == 0:
        for part in parts:
            row, column = np.divmod(np.arange(part.start, part.stop), width)
            yield part, column + 0.5, row + 0.5
    for x, y in subpixels(width, height, strata, rng) if strata else ():
        for part in parts:
            yield part, x[part], y[part]
