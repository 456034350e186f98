# SPDX-License-Identifier: GPL-3.0-or-later
"""A cloud's field as voxels: the second representation, which engines and references share to the last voxel."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from . import noise
from .geometry import contains
from .model import Box, Grid, NoiseShape, Shape, Volume

def voxelized(volume: Volume, resolution: int) -> Volume:
    """The volume with its noise baked into cubic voxels, in the tightest box along the axes that holds the cloud.

    ``resolution`` voxels lie along the box's longest side. The outermost layer is 0, so that nothing has to be cut. A cloud
    that fills nothing becomes a grid of zeros over its domain. Raises ValueError for other densities than noise, and for
    fewer than 4 voxels.
    """
    density = volume.medium.density
    if not isinstance(density, NoiseShape):
        raise ValueError(f"only noise is baked into voxels, got {type(density).__name__}; leave it procedural")
    if resolution < 4:
        raise ValueError(f"resolution must be >= 4 voxels, got {resolution}; 128 is usual")
    grid = _baked(density, volume.domain, resolution)
    center = tuple((a + b) / 2 for a, b in zip(grid.low, grid.high))
    half = tuple((b - a) / 2 for a, b in zip(grid.low, grid.high))
    return replace(volume, domain=Box(center, half), medium=replace(volume.medium, density=grid))


@lru_cache(maxsize=4)
def _baked(density: NoiseShape, domain: Shape, resolution: int) -> Grid:
    center, half = np.array(density.center), np.array(density.half)
    coarse = _sampled(density, domain, center - half, center + half, max(resolution // 2, 4))
    filled = np.argwhere(coarse.values > 0.0)
    if not len(filled):
        return coarse
    voxel = (np.array(coarse.high) - coarse.low) / coarse.values.shape
    # One more voxel on every side: what lies between the points of the search.
    low, high = coarse.low + (filled.min(axis=0) - 0.5) * voxel, coarse.low + (filled.max(axis=0) + 1.5) * voxel
    return _sampled(density, domain, np.maximum(low, center - half), np.minimum(high, center + half), resolution)


def _sampled(density: NoiseShape, domain: Shape, low: np.ndarray, high: np.ndarray, resolution: int) -> Grid:
    """Cubic voxels over the box, ``resolution`` along its longest side, the outermost layer around the box and 0."""
    voxel = float((high - low).max()) / (resolution - 2)
    counts = np.ceil((high - low) / voxel - 1e-9).astype(int) + 2
    low = (low + high - counts * voxel) / 2.0
    values = np.zeros(counts)
    x, y, z = (low[axis] + voxel * (np.arange(1, counts[axis] - 1) + 0.5) for axis in range(3))
    for i, plane in enumerate(x):  # a plane at a time: working memory stays small
        position = np.stack(np.broadcast_arrays(plane, y[:, None], z[None, :]), axis=-1).reshape(-1, 3)
        inside = contains(domain, position)
        values[i + 1, 1:-1, 1:-1] = (noise.density(density, position) * inside).reshape(len(y), len(z))
    values.setflags(write=False)
    return Grid(values, tuple(map(float, low)), tuple(map(float, low + counts * voxel)))
