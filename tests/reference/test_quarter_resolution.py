# SPDX-License-Identifier: GPL-3.0-or-later
"""The quarter-resolution march against the quadrature, and its depth edges against plain interpolation."""

import math

import numpy as np
import pytest

from volumetrics_addon.reference import quarter_resolution, ray_marching, single_scattering
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Ellipsoid, ExponentialHeight, Medium, NoiseShape, Phase, Point, Scene, Spot, Sun, Surface, Volume,
    normalized,
)

HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
LAYER = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5), ExponentialHeight(1.0, -2.0))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
SUN = Sun(normalized((0.3, 0.2, -1.0)), (3.0, 2.0, 1.0))
# Narrow enough that the edges of the box stay out of the picture.
NARROW = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(24.0))
HEIGHT = Scene(NARROW, (SUN,), volumes=(Volume(BOX, LAYER),))
POINT = Scene(NARROW, (Point((0.2, -0.3, 2.6), (30.0, 20.0, 10.0)),), volumes=(Volume(BOX, HAZE),))
# Under a sun in the zenith pillars through the whole fog cast no shadow into it.
PILLARS = Scene(NARROW, (Sun((0.0, 0.0, -1.0), (3.0, 2.0, 1.0)),), volumes=(Volume(BOX, HAZE),), surfaces=tuple(
    Surface(Box((x, y, 0.0), (0.12, 0.12, 3.0)), (0.0, 0.0, 0.0)) for x, y in ((-0.8, -1.5), (0.1, 0.0), (0.5, -1.8))))
SPOT = Scene(NARROW, (Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4),),
             volumes=(Volume(BOX, HAZE),), surfaces=(Surface(Box((0.0, 0.0, 1.2), (0.4, 0.6, 0.1)), (0.0, 0.0, 0.0)),))


def relative_error(result, truth):
    return math.sqrt(((result.image - truth) ** 2).mean()) / truth.mean()


def truth_of(scene, size):
    """32 nodes on every lit interval, through the centres of the pixels, without the compilation of larger images."""
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = geometry.camera_rays(scene.camera, size, size, column.ravel(), row.ravel())
    return single_scattering.radiance(scene, *rays, np.random.default_rng(0), 32)[0].reshape(size, size, 3)


@pytest.mark.parametrize("factor", [2, 4])
@pytest.mark.parametrize("scene", [HEIGHT, POINT], ids=["height", "point"])
def test_second_order_in_the_resolution_where_light_is_smooth(scene, factor):
    errors = [relative_error(quarter_resolution.render(scene, n, n, strata=0, steps=128, factor=factor), truth_of(scene, n))
              for n in (16, 32, 64)]
    # The outermost half sample is extended, which is first order on a share of the image that shrinks.
    assert 1.2 < math.log2(errors[0] / errors[1]) < 2.3 and 1.2 < math.log2(errors[1] / errors[2]) < 2.3
    assert errors[2] < 0.01 * factor**2  # measured 0.040 for the point light at factor 4


def test_shadows_converge_in_the_first_half_order():
    """An edge of light that has no edge of depth is blurred over a sample: error as the square root of its share."""
    errors = [relative_error(quarter_resolution.render(SPOT, n, n, strata=0, steps=128), truth_of(SPOT, n))
              for n in (16, 32, 64)]
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.5 * errors[0]


def test_depth_edges_keep_light_where_it_is(monkeypatch):
    """Pillars in the fog hide most of it: without their depth the fog behind bleeds over them."""
    truth = truth_of(PILLARS, 32)
    aware = relative_error(quarter_resolution.render(PILLARS, 32, 32, strata=0, steps=64), truth)
    monkeypatch.setattr(quarter_resolution, "DEPTH_TOLERANCE", 1e9)
    blind = relative_error(quarter_resolution.render(PILLARS, 32, 32, strata=0, steps=64), truth)
    assert aware < 0.1 * blind  # measured 0.025


@pytest.mark.parametrize("scene", [HEIGHT, POINT, PILLARS, SPOT], ids=["height", "point", "pillars", "spot"])
@pytest.mark.parametrize("factor", [2, 4])
def test_stated_error_covers_the_truth(scene, factor):
    truth = truth_of(scene, 32)
    result = quarter_resolution.render(scene, 32, 32, strata=0, steps=32, factor=factor)
    error = np.abs(result.image - truth)
    assert (error <= 2.0 * result.error_estimate + 1e-12).mean() > 0.9
    # Pillars of one sample's width cannot be told from their neighbours: 17 times too large.
    assert (result.error_estimate**2).mean() < 30.0**2 * (error**2).mean()


def test_evaluates_a_quarter_and_a_sixteenth():
    full = ray_marching.render(HEIGHT, 32, 16, strata=0, steps=8).evaluations
    for factor in (2, 4):
        assert quarter_resolution.render(HEIGHT, 32, 16, strata=0, steps=8, factor=factor).evaluations * factor**2 == full
    # Sizes that the factor does not divide round up.
    assert quarter_resolution.render(HEIGHT, 9, 5, strata=0, steps=8, factor=4).evaluations == 3 * 2 * 8


def test_noise_against_a_fine_march():
    noise = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.8, 1.0, 0.5, 1.0, 0.8, 0.5, 5)
    cloud = Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((3.0, 2.0, 1.0), (0.0, 0.5, 1.0), Phase(0.6), noise))
    scene = Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(30.0)), (SUN,), volumes=(cloud,))
    truth = ray_marching.render(scene, 32, 32, strata=0, steps=48, light_steps=16).image
    assert relative_error(quarter_resolution.render(scene, 32, 32, strata=0, steps=32), truth) < 0.2  # measured 0.10


@pytest.mark.parametrize("factor", [1, 3, 8, "2"])
def test_refuses_other_factors(factor):
    with pytest.raises(ValueError, match="factor must be 2 or 4, got .*a quarter of the pixels"):
        quarter_resolution.render(HEIGHT, 4, 4, factor=factor)
