# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise as voxels: the same cloud, in the tightest box, with nothing at its faces."""

from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.parameters.preset import load
from volumetrics_addon.physics.grid import grid_density
from volumetrics_addon.scene import assemble, noise
from volumetrics_addon.scene.bake import voxelized
from volumetrics_addon.scene.geometry import contains
from volumetrics_addon.scene.model import Box, Homogeneous, Medium, NoiseShape, Volume

CLOUD = NoiseShape((10.0, -5.0, 3.0), (9.0, 7.0, 5.0), 4.0, 2.0, 0.5, 0.5, 0.45, 0.3, 3, profile="dome", billow_size=3.0,
                   billow_strength=0.6, billow_octaves=2, base=0.1)


def volume(density=CLOUD):
    return Volume(Box(density.center, density.half), Medium((0.5,) * 3, (0.0,) * 3, density=density))


def test_voxels_are_the_field_at_their_centres():
    grid = voxelized(volume(), 40).medium.density
    index = np.stack(np.meshgrid(*map(np.arange, grid.values.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    size = (np.array(grid.high) - grid.low) / grid.values.shape
    np.testing.assert_allclose(size, size[0], rtol=1e-12)  # cubes
    position = np.array(grid.low) + (index + 0.5) * size
    inner = ((index > 0) & (index < np.array(grid.values.shape) - 1)).all(axis=1)
    expected = noise.density(CLOUD, position) * contains(volume().domain, position) * inner
    np.testing.assert_allclose(grid.values.ravel(), expected, atol=1e-15)
    assert max(grid.values.shape) == 40 and expected.max() == 1.0


@pytest.mark.parametrize("name", ["cumulus", "ember-smoke"])
def test_the_box_is_tight_and_loses_nothing(name):
    preset = load(name)
    whole, = assemble.scene(preset.family, preset.parameters, preset.stage, preset.props).volumes
    baked = voxelized(whole, 96)
    grid, density = baked.medium.density, whole.medium.density
    points = np.random.default_rng(0).uniform(-1, 1, (400_000, 3)) * density.half + density.center
    field = noise.density(density, points) * contains(whole.domain, points)
    assert field[~contains(baked.domain, points)].sum() < 1e-4 * field.sum()  # wisps smaller than the voxels of the search
    inside = contains(baked.domain, points)
    voxels = np.zeros(len(points))
    voxels[inside] = grid_density(grid.values, grid.low, grid.high, points[inside])
    # Mean over 400,000 points: the difference of the two fields, not of their sampling.
    assert voxels.mean() == pytest.approx(field.mean(), rel=0.01)
    for axis in range(3):  # the search has voxels of twice the size and leaves one and a half of them
        filled = np.flatnonzero(grid.values.any(axis=tuple(k for k in range(3) if k != axis)))
        assert filled[0] <= 5 and filled[-1] >= grid.values.shape[axis] - 6


def test_faces_are_empty_and_nothing_becomes_a_grid_of_nothing():
    values = voxelized(volume(replace(CLOUD, fill=3.0)), 24).medium.density.values
    for axis in range(3):
        assert not np.take(values, [0, -1], axis).any()
    assert not voxelized(volume(replace(CLOUD, fill=-9.0)), 24).medium.density.values.any()


def test_what_cannot_be_baked_is_refused():
    with pytest.raises(ValueError, match="only noise is baked into voxels, got Homogeneous"):
        voxelized(replace(volume(), medium=Medium((1.0,) * 3, (0.0,) * 3, density=Homogeneous())), 32)
    with pytest.raises(ValueError, match="resolution must be >= 4 voxels, got 3"):
        voxelized(volume(), 3)
