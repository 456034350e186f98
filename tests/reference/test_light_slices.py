# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices through light frustums against the quadrature."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import light_slices, ray_marching, single_scattering
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Ellipsoid, ExponentialHeight, Medium, NoiseShape, Phase, Point, Projector, Scene, Spot, Sun, Surface,
    Volume, normalized,
)

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(50.0))
HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
LAYER = replace(HAZE, density=ExponentialHeight(1.0, -2.0))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
BLOCKER = Surface(Box((0.0, 0.0, 1.2), (0.4, 0.6, 0.1)), (0.0, 0.0, 0.0))
SPOT = Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4)
SOFT = replace(SPOT, blend=1.0)
SLIDE = Projector((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (0.0, 1.0, 0.0), (90.0, 60.0, 30.0), 0.7, 0.5, 0.4, 4.2,
                  blend=1.0)
SCENES = {
    "soft": Scene(CAMERA, (SOFT,), volumes=(Volume(BOX, HAZE),)),
    "blocked": Scene(CAMERA, (SPOT,), volumes=(Volume(BOX, HAZE),), surfaces=(BLOCKER,)),
    "layer": Scene(CAMERA, (SOFT,), volumes=(Volume(BOX, LAYER),)),
    "slide": Scene(CAMERA, (SLIDE,), volumes=(Volume(BOX, HAZE),)),
    "inside": Scene(Camera((0.2, -1.0, -1.0), normalized((-0.2, 1.0, 0.2)), 1.4), (SOFT,), volumes=(Volume(BOX, HAZE),)),
    "two": Scene(CAMERA, (SOFT, replace(SOFT, position=(1.5, -1.0, 0.0), direction=normalized((-1.0, 0.4, 0.1)))),
                 volumes=(Volume(BOX, HAZE),)),
}


def relative_error(result, truth):
    return math.sqrt(((result.image - truth) ** 2).mean()) / truth.mean()


def truth_of(scene, size=16):
    """32 nodes on every lit interval, through the centres of the pixels, without the compilation of larger images."""
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = geometry.camera_rays(scene.camera, size, size, column.ravel(), row.ravel())
    return single_scattering.radiance(scene, *rays, np.random.default_rng(0), 32)[0].reshape(size, size, 3)


# Measured with 256 slices: 3.5e-3 behind the blocker, 9e-6 to 3.7e-4 elsewhere.
@pytest.mark.parametrize("name", SCENES)
def test_converges_to_the_quadrature(name):
    error = relative_error(light_slices.render(SCENES[name], 16, 16, strata=0, slices=256), truth_of(SCENES[name]))
    assert error < {"blocked": 7e-3}.get(name, 7.5e-4)


@pytest.mark.parametrize("name, least, most", [("soft", 1.8, 2.6), ("layer", 1.8, 2.6), ("blocked", 0.6, 1.6)])
def test_order_of_convergence(name, least, most):
    truth = truth_of(SCENES[name])
    slices = 2 ** np.arange(5, 9)
    errors = [relative_error(light_slices.render(SCENES[name], 16, 16, strata=0, slices=int(n)), truth) for n in slices]
    assert least < -np.polyfit(np.log(slices), np.log(errors), 1)[0] < most


@pytest.mark.parametrize("name", SCENES)
def test_stated_error_covers_the_truth(name):
    truth = truth_of(SCENES[name])
    result = light_slices.render(SCENES[name], 16, 16, strata=0, slices=64)
    error = np.abs(result.image - truth)
    assert (error <= 2.0 * result.error_estimate + 1e-9 * truth.mean()).mean() > 0.85
    assert (result.error_estimate**2).mean() < 30.0**2 * (error**2).mean()


def test_spends_its_slices_on_the_beam():
    """A narrow beam across a long room of fog: the march steps over it, the slices fill it."""
    room = Volume(Box((0.0, 14.0, 0.0), (3.0, 18.0, 2.0)), HAZE)
    beam = Spot((-2.9, 3.0, 0.2), (1.0, 0.0, 0.0), (50.0, 50.0, 50.0), math.radians(8.0), 1.0)
    scene = Scene(CAMERA, (beam,), volumes=(room,))
    truth = truth_of(scene)
    sliced = light_slices.render(scene, 16, 16, strata=0, slices=16)
    marched = ray_marching.render(scene, 16, 16, strata=0, steps=64)
    assert relative_error(sliced, truth) < 0.1 * relative_error(marched, truth)
    assert sliced.evaluations < 0.1 * marched.evaluations


def test_frustums():
    """Spot: the square around its cone, shrunk to the light at the near end. Projector: near and far face as given."""
    spot = Spot((1.0, 2.0, 3.0), (0.0, 0.0, -1.0), (1.0, 1.0, 1.0), math.radians(90.0), 0.0)
    corners = light_slices.frustum_corners(spot, 2.0)
    np.testing.assert_allclose(corners[:4], [(1.0, 2.0, 3.0)] * 4)
    np.testing.assert_allclose(sorted(map(tuple, np.round(corners[4:], 9))), [(-1, 0, 1), (-1, 4, 1), (3, 0, 1), (3, 4, 1)])
    slide = Projector((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0), math.radians(90.0),
                      2.0 * math.atan(0.5), 0.5, 9.0)
    corners = light_slices.frustum_corners(slide, 4.0)
    np.testing.assert_allclose(corners.min(axis=0), (-4.0, 0.5, -2.0))
    np.testing.assert_allclose(corners.max(axis=0), (4.0, 4.0, 2.0))


def test_a_wide_spot_fills_its_media():
    wide = replace(SOFT, cone_angle=math.radians(179.0))
    scene = Scene(CAMERA, (wide,), volumes=(Volume(BOX, HAZE),))
    assert relative_error(light_slices.render(scene, 16, 16, strata=0, slices=128), truth_of(scene)) < 1e-2


def test_a_light_turned_away_from_the_media_adds_nothing():
    scene = Scene(CAMERA, (replace(SPOT, direction=(0.0, 0.0, 1.0)),), volumes=(Volume(BOX, HAZE),))
    result = light_slices.render(scene, 8, 8, strata=0)
    assert (result.image == 0.0).all() and result.evaluations == 0


def test_noise_against_a_fine_march():
    noise = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.8, 1.0, 0.5, 1.0, 0.8, 0.5, 5)
    cloud = Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((3.0, 2.0, 1.0), (0.0, 0.5, 1.0), Phase(0.6), noise))
    scene = Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(30.0)), (SOFT,), volumes=(cloud,))
    truth = ray_marching.render(scene, 12, 12, strata=0, steps=128, light_steps=48).image
    result = light_slices.render(scene, 12, 12, strata=0, slices=64, light_steps=24)
    assert relative_error(result, truth) < 0.02
    assert (np.abs(result.image - truth) <= 2.0 * result.error_estimate + 1e-9).mean() > 0.85


@pytest.mark.parametrize("light, reason", [
    (Sun((0.0, 0.0, -1.0), (1.0, 1.0, 1.0)), "a Sun light has no frustum"),
    (Point((0.0, 0.0, 3.0), (1.0, 1.0, 1.0)), "a Point light has no frustum"),
], ids=["sun", "point"])
def test_refuses_lights_without_a_frustum(light, reason):
    scene = Scene(CAMERA, (SPOT, light), volumes=(Volume(BOX, HAZE),))
    assert reason in light_slices.applies(scene)
    with pytest.raises(ValueError, match=reason):
        light_slices.render(scene, 4, 4)


def test_refuses_ambient_light():
    scene = Scene(CAMERA, (SPOT,), volumes=(Volume(BOX, replace(HAZE, ambient=(0.1, 0.0, 0.0))),))
    assert "ambient light" in light_slices.applies(scene)
