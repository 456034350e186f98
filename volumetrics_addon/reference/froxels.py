# SPDX-License-Identifier: GPL-3.0-or-later
"""Grid of froxels: the camera's frustum in cells that are lit once, integrated front to back and looked up by every pixel.

The part of the frustum between the nearest and the farthest depth of the media is divided into columns of ``tile`` x
``tile`` pixels and ``slices`` depths whose thickness grows e^2-fold from front to back. Source and extinction are
evaluated once per froxel, in its middle, integrated along each column with the transmittance of each step in closed form,
and pixels interpolate in-scatter and transmittance trilinearly at the depth of their surface (Wronski, Volumetric fog,
SIGGRAPH 2014 course; Hillaire, Physically based and unified volumetric rendering in Frostbite, SIGGRAPH 2015 course).

``frames`` positions inside the froxels, one for all in each frame, along the sequence of Halton (2, 3, 5), are averaged,
with equal weights: the converged state of the exponential history that engines keep under a still camera, without its
noise. One frame is the unjittered grid.
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

BIAS = ("Interpolation in a grid coarser than the image: blurs shadows, cones and the edges of media by a froxel, and lets "
        "light leak around surfaces. " + marching.SINGLE_BIAS)
SETTINGS = tuple({"tile": tile, "slices": slices, "frames": frames}
                 for tile, slices, frames in ((8, 16, 1), (8, 32, 1), (4, 32, 1), (4, 64, 1), (2, 64, 1), (2, 64, 8),
                                              (1, 128, 1)))

GROWTH = 2.0  # logarithm of the last slice's thickness over the first one's
BASES = (2, 3, 5)

applies = marching.applies


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, tile: int = 4, slices: int = 64,
           frames: int = 1, light_steps: int = marching.LIGHT_STEPS, seed: int = 0,
           progress: Progress | None = None) -> Result:
    """Image of the scene in single scattering, from a grid of ``tile`` pixels by ``slices`` depths.

    The stated error is the difference from the grid of half as many froxels along each axis. ``repeats``, ``strata`` and
    ``light_steps`` are those of ray_marching; all rays look up the same grid. Raises ValueError when the integrator does
    not apply (see ``applies``) and for settings below 1.
    """
    marching.refuse("froxels", applies(scene))
    marching.counted("tile", tile, "engines use 8 to 16 pixels")
    marching.counted("slices", slices, "engines use 64 to 128")
    marching.counted("frames", frames, "use 1 for no jitter, 8 or more for smooth shadows")
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a reference")
    grids = cache(lambda: (_Grid(scene, width, height, tile, slices, frames, light_steps),
                           _Grid(scene, width, height, 2 * tile, max(1, slices // 2), frames, light_steps)))

    def radiance(origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, Array, int]:
        evaluations = 0 if grids.cache_info().currsize else sum(grid.evaluations for grid in grids())
        hit, index = marching.first_hit(scene, origin, direction)
        x, y = geometry.raster(scene.camera, width, height, direction)
        depth = hit * (direction @ geometry.view_axes(scene.camera)[2])
        fine, coarse = (grid.at(x, y, depth) for grid in grids())
        column = marching.Column(*fine, *(np.abs(a - b) for a, b in zip(fine, coarse)))
        return *marching.composed(scene, origin, direction, hit, index, column, rng, light_steps), evaluations

    return render_rays("froxels", radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=max(scene.environment) > 0.0, progress=progress)


def radical_inverse(index: int, base: int) -> float:
    """Van der Corput's sequence: the digits of ``index`` mirrored at the point."""
    value, scale = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        value += digit * scale
        scale /= base
    return value


class _Grid:
    """``scattered`` and ``transmittance`` (rows, columns, slices + 1, 3) from the camera to the faces between slices."""

    def __init__(self, scene: Scene, width: int, height: int, tile: int, slices: int, frames: int, light_steps: int):
        self.tile, self.slices = tile, slices
        self.rows, self.columns = -(-height // tile), -(-width // tile)
        self.evaluations = self.rows * self.columns * slices * frames
        forward = geometry.view_axes(scene.camera)[2]
        ends = (marching.media_corners(scene) - np.array(scene.camera.position)) @ forward if scene.volumes else np.zeros(1)
        self.near = max(0.0, ends.min())
        self.far = max(self.near, ends.max())
        faces = self._depth(np.arange(slices + 1.0))
        emitted, sigma_t = np.zeros((2, self.rows * self.columns, slices, 3))
        column, row = (index.ravel() for index in np.meshgrid(np.arange(self.columns), np.arange(self.rows)))
        batch = marching.rays_at_once(slices)
        for frame in range(frames):
            x, y, z = (radical_inverse(frame + 1, base) for base in BASES) if frames > 1 else (0.5, 0.5, 0.5)
            origin, direction = geometry.camera_rays(scene.camera, width, height, (column + x) * tile, (row + y) * tile)
            t = self._depth(np.arange(slices) + z) / (direction @ forward)[:, None]
            for start in range(0, len(t), batch):
                part = slice(start, start + batch)
                d = np.repeat(direction[part], slices, axis=0)
                position = np.repeat(origin[part], slices, axis=0) + t[part].reshape(-1, 1) * d
                for total, value in zip((emitted, sigma_t), marching.source(scene, position, d, light_steps)):
                    total[part] += value.reshape(-1, slices, 3) / frames
        _, direction = geometry.camera_rays(scene.camera, width, height, (column + 0.5) * tile, (row + 0.5) * tile)
        length = np.diff(faces) / (direction @ forward)[:, None]
        contribution, depth = marching.integrate(emitted, sigma_t, length)
        shape = (self.rows, self.columns, slices + 1, 3)
        start = np.zeros((len(direction), 1, 3))
        self.scattered = np.concatenate([start, np.cumsum(contribution, axis=1)], axis=1).reshape(shape)
        self.transmittance = np.exp(-np.concatenate([start, np.cumsum(depth, axis=1)], axis=1)).reshape(shape)

    def _depth(self, slice_number: Array) -> Array:
        """Depth along the view axis of fractional slice numbers."""
        return self.near + (self.far - self.near) * np.expm1(GROWTH * slice_number / self.slices) / np.expm1(GROWTH)

    def at(self, x: Array, y: Array, depth: Array) -> tuple[Array, Array]:
        """In-scatter and transmittance (n, 3) at raster positions, up to ``depth`` along the view axis."""
        share = np.clip((depth - self.near) / max(self.far - self.near, 1e-30), 0.0, 1.0)
        z = self.slices * np.log1p(share * np.expm1(GROWTH)) / GROWTH
        axes = [((low, 1.0 - weight), (high, weight)) for low, high, weight in (
            marching.linear_weights(y / self.tile, self.rows), marching.linear_weights(x / self.tile, self.columns),
            marching.linear_weights(z + 0.5, self.slices + 1))]
        scattered, transmittance = np.zeros((2, len(x), 3))
        for i, share_i in axes[0]:
            for j, share_j in axes[1]:
                for k, share_k in axes[2]:
                    weight = (share_i * share_j * share_k)[:, None]
                    scattered += weight * self.scattered[i, j, k]
                    transmittance += weight * self.transmittance[i, j, k]
        return scattered, transmittance
