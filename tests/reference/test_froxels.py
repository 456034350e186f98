# SPDX-License-Identifier: GPL-3.0-or-later
"""Froxels against the quadrature."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import froxels, ray_marching, single_scattering
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Ellipsoid, ExponentialHeight, Medium, NoiseShape, Phase, Point, Scene, Spot, Sun, Surface, Volume,
    normalized,
)

HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
LAYER = replace(HAZE, density=ExponentialHeight(1.0, -2.0))
SUN = Sun(normalized((0.3, 0.2, -1.0)), (3.0, 2.0, 1.0))
# A hall of fog around the camera and a wall behind it: no edge of a medium and no shadow in the picture.
ROOM = Box((0.0, 0.0, 0.0), (6.0, 6.0, 6.0))
THIN = replace(HAZE, density=ExponentialHeight(3.0, -3.0))
WITHIN = Camera((0.3, -5.0, 0.0), (0.0, 1.0, 0.0), math.radians(40.0))
OUTSIDE = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(50.0))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
WALL = Surface(Box((0.0, 7.0, 0.0), (9.0, 0.1, 9.0)), (0.5, 0.4, 0.3))
SPOT = Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4)
SCENES = {
    "layer": Scene(WITHIN, (SUN,), volumes=(Volume(ROOM, THIN),), surfaces=(WALL,)),
    "point": Scene(WITHIN, (Point((3.5, 0.0, 1.8), (60.0, 40.0, 20.0)),), volumes=(Volume(ROOM, HAZE),), surfaces=(WALL,)),
    "box": Scene(OUTSIDE, (SUN,), volumes=(Volume(BOX, LAYER),)),
    "spot": Scene(OUTSIDE, (SPOT,), volumes=(Volume(BOX, HAZE),),
                  surfaces=(Surface(Box((0.0, 0.0, 1.2), (0.4, 0.6, 0.1)), (0.0, 0.0, 0.0)),)),
}


def relative_error(result, truth):
    return math.sqrt(((result.image - truth) ** 2).mean()) / truth.mean()


def truth_of(scene, size):
    """32 nodes on every lit interval, through the centres of the pixels, without the compilation of larger images."""
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = geometry.camera_rays(scene.camera, size, size, column.ravel(), row.ravel())
    return single_scattering.radiance(scene, *rays, np.random.default_rng(0), 32)[0].reshape(size, size, 3)


@pytest.mark.parametrize("name, order", [("layer", 1.4), ("point", 1.3), ("box", 0.8), ("spot", 0.5)])
def test_converges_with_the_grid(name, order):
    """Twice the resolution in all three axes. Where all is smooth the outermost half tile, which is extended, keeps it
    below the second order; at edges it is about the first."""
    truth = truth_of(SCENES[name], 32)
    errors = [relative_error(froxels.render(SCENES[name], 32, 32, strata=0, tile=tile, slices=128 // tile), truth)
              for tile in (8, 4, 2)]
    assert np.polyfit(np.log2((8, 4, 2)), np.log2(errors), 1)[0] > order


def test_columns_of_one_pixel_leave_the_error_of_the_slices():
    """At the centres of pixels nothing is interpolated across the screen: second order in the slices, as a march."""
    truth = truth_of(SCENES["layer"], 16)
    errors = [relative_error(froxels.render(SCENES["layer"], 16, 16, strata=0, tile=1, slices=n), truth)
              for n in (16, 32, 64, 128)]
    order = -np.polyfit(np.log((16, 32, 64, 128)), np.log(errors), 1)[0]
    assert 1.5 < order < 2.3 and errors[-1] < 5e-3


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("tile", [2, 4])
def test_stated_error_covers_the_truth(name, tile):
    truth = truth_of(SCENES[name], 32)
    result = froxels.render(SCENES[name], 32, 32, strata=0, tile=tile, slices=64)
    error = np.abs(result.image - truth)
    assert (error <= 2.0 * result.error_estimate + 1e-12).mean() > 0.75
    assert (result.error_estimate**2).mean() < 10.0**2 * (error**2).mean()


def test_frames_average_positions_inside_the_froxels():
    """A hard shadow's steps along the slices: sixteen frames smooth what one frame draws as bands."""
    scene = SCENES["spot"]
    truth = truth_of(scene, 32)
    one, many = (froxels.render(scene, 32, 32, strata=0, tile=1, slices=12, frames=n) for n in (1, 16))
    assert many.evaluations == 16 * one.evaluations
    assert relative_error(many, truth) < relative_error(one, truth)


def test_halton_positions():
    assert [froxels.radical_inverse(i, 2) for i in range(1, 6)] == [0.5, 0.25, 0.75, 0.125, 0.625]
    np.testing.assert_allclose([froxels.radical_inverse(i, 3) for i in range(1, 5)], [1 / 3, 2 / 3, 1 / 9, 4 / 9])


def test_slices_grow_by_the_stated_ratio_from_near_to_far():
    grid = froxels._Grid(SCENES["box"], 8, 8, 8, 400, 1, 1)
    depth = grid._depth(np.arange(401))
    assert depth[0] == pytest.approx(4.0) and depth[-1] == pytest.approx(8.0)
    assert math.log((depth[-1] - depth[-2]) / (depth[1] - depth[0])) == pytest.approx(froxels.GROWTH, rel=0.01)


def test_grid_stops_at_surfaces():
    """In a homogeneous fog under uniform light the lookup at a wall's depth is the march to it."""
    scene = replace(SCENES["layer"], volumes=(Volume(ROOM, HAZE),))
    nearer = replace(scene, surfaces=(Surface(Box((0.0, 0.0, 0.0), (9.0, 0.1, 9.0)), (0.0, 0.0, 0.0)),))
    for case in (scene, nearer):
        assert relative_error(froxels.render(case, 16, 16, strata=0, tile=1, slices=128), truth_of(case, 16)) < 5e-3


def test_noise_against_a_fine_march():
    noise = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.8, 1.0, 0.5, 1.0, 0.8, 0.5, 5)
    cloud = Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((3.0, 2.0, 1.0), (0.0, 0.5, 1.0), Phase(0.6), noise))
    scene = Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(30.0)), (SUN,), volumes=(cloud,))
    truth = ray_marching.render(scene, 16, 16, strata=0, steps=96, light_steps=32).image
    assert relative_error(froxels.render(scene, 16, 16, strata=0, tile=1, slices=48), truth) < 0.05
