# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray marching of one pixel in four or sixteen, upsampled to the full image along its depth edges.

In-scatter and transmittance are marched at 1 / ``factor`` of the width and height. A pixel takes them from the four
samples around it, with bilinear weights times a Gaussian of the relative difference of depth, so that light does not bleed
across the silhouettes of surfaces (joint bilateral upsampling: Kopf, Cohen, Lischinski and Uyttendaele, SIGGRAPH 2007; for
volumetric light Toth and Umenhoffer, Eurographics 2009 short papers). Surfaces beyond the media and the sky share one
depth, that of the farthest medium. What lies behind the media is evaluated at full resolution.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ..scene import geometry
from ..scene.model import Scene
from . import marching
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = ("Interpolation between one marched pixel in four or sixteen, which blurs shadows and cones that have no depth edge, "
        "and the steps of the march. " + marching.SINGLE_BIAS)
SETTINGS = tuple({"steps": steps, "factor": factor}
                 for steps, factor in ((4, 4), (8, 4), (16, 4), (8, 2), (16, 2), (32, 2), (64, 2)))

DEPTH_TOLERANCE = 0.05  # relative difference of depth at which a sample weighs exp(-1/2)
LEAST_WEIGHT = 1e-6  # of samples at another depth, for pixels that have no other

applies = marching.applies


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, steps: int = 32, factor: int = 2,
           light_steps: int = marching.LIGHT_STEPS, seed: int = 0, progress: Progress | None = None) -> Result:
    """Image of the scene in single scattering, marched at 1 / ``factor`` (2 or 4) of the resolution along each side.

    ``repeats``, ``strata`` and ``light_steps`` are those of ray_marching; all rays of a pixel look up the same samples.
    Raises ValueError when the integrator does not apply (see ``applies``), for fewer than one step and other factors.
    """
    marching.refuse("quarter_resolution", applies(scene))
    marching.counted("steps", steps, "use 16 for a preview, 128 for a reference")
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a reference")
    if factor not in (2, 4):
        raise ValueError(f"factor must be 2 or 4, got {factor!r}; 2 marches a quarter of the pixels, 4 a sixteenth")
    samples = cache(lambda: _Samples(scene, width, height, factor, steps, light_steps))  # made within the measured time

    def radiance(origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, Array, int]:
        evaluations = 0 if samples.cache_info().currsize else steps * samples().depth.size
        hit, index = marching.first_hit(scene, origin, direction)
        x, y = geometry.raster(scene.camera, width, height, direction)
        column = samples().at(x, y, hit)
        return *marching.composed(scene, origin, direction, hit, index, column, rng, light_steps), evaluations

    return render_rays("quarter_resolution", radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=max(scene.environment) > 0.0, progress=progress)


class _Samples:
    """The marched image: ``values`` (rows, columns, 12) are the parts of a ``marching.Column``."""

    def __init__(self, scene: Scene, width: int, height: int, factor: int, steps: int, light_steps: int):
        self.factor = factor
        self.rows, self.columns = -(-height // factor), -(-width // factor)
        column, row = (index.ravel() for index in np.meshgrid(np.arange(self.columns), np.arange(self.rows)))
        origin, direction = geometry.camera_rays(scene.camera, width, height, (column + 0.5) * factor, (row + 0.5) * factor)
        hit, _ = marching.first_hit(scene, origin, direction)
        tile = marching.rays_at_once(steps)
        parts = [np.concatenate(marching.march(scene, origin[i:i + tile], direction[i:i + tile], hit[i:i + tile], steps,
                                               light_steps), axis=1) for i in range(0, len(hit), tile)]
        self.values = np.concatenate(parts).reshape(self.rows, self.columns, 12)
        offset = marching.media_corners(scene) - np.array(scene.camera.position)
        self.farthest = np.linalg.norm(offset, axis=1).max(initial=0.0)
        self.depth = np.minimum(hit, self.farthest).reshape(self.rows, self.columns)
        self.values[..., 6:] += self._interpolation_doubt(self.values[..., :6])

    def at(self, x: Array, y: Array, hit: Array) -> marching.Column:
        """The media (n,) before surfaces at the distance ``hit``, at raster positions of the full image."""
        depth = np.minimum(hit, self.farthest)
        cells_x = marching.linear_weights(x / self.factor, self.columns)
        cells_y = marching.linear_weights(y / self.factor, self.rows)
        total, value = np.zeros(len(x)), np.zeros((len(x), 12))
        for row, share_y in ((cells_y[0], 1.0 - cells_y[2]), (cells_y[1], cells_y[2])):
            for column, share_x in ((cells_x[0], 1.0 - cells_x[2]), (cells_x[1], cells_x[2])):
                weight = share_x * share_y * _likeness(depth, self.depth[row, column])
                total += weight
                value += weight[:, None] * self.values[row, column]
        return marching.Column(*np.split(value / total[:, None], 4, axis=1))

    def _interpolation_doubt(self, values: Array) -> Array:
        """Half of what each sample differs by from the mean of its neighbours along either axis.

        Twice the error between samples where the image is smooth, half a step at an edge.
        """
        doubt = np.zeros(values.shape)
        for axis in (0, 1):
            around, weight = np.zeros(values.shape), np.zeros(self.depth.shape)
            for shift in (-1, 1):
                index = np.clip(np.arange(values.shape[axis]) + shift, 0, values.shape[axis] - 1)
                near = _likeness(self.depth, np.take(self.depth, index, axis=axis))
                around += near[..., None] * np.take(values, index, axis=axis)
                weight += near
            doubt += np.abs(around / weight[..., None] - values) / 2.0
        return doubt


def _likeness(depth: Array, other: Array) -> Array:
    """Weight of samples by their depth: a Gaussian of the relative difference."""
    relative = (depth - other) / np.maximum(np.maximum(depth, other), 1e-300)
    return np.exp(-0.5 * (relative / DEPTH_TOLERANCE) ** 2) + LEAST_WEIGHT
