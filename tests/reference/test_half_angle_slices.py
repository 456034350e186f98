# SPDX-License-Identifier: GPL-3.0-or-later
"""Half-angle slices against the quadrature, from all sides of the light, and the blur's bounds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import half_angle_slices, marching, ray_marching, single_scattering
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Ellipsoid, ExponentialHeight, Medium, NoiseShape, Phase, Point, Projector, Scene, Spot, Sun, Surface,
    Volume, normalized,
)

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(50.0))
HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
LAYER = replace(HAZE, density=ExponentialHeight(1.0, -2.0))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
BALL = Ellipsoid((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
BLOCKER = Surface(Box((0.0, 0.0, 1.2), (0.4, 0.6, 0.1)), (0.0, 0.0, 0.0))
SPOT = Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4)
SUN = Sun(normalized((0.3, 0.2, -1.0)), (3.0, 2.0, 1.0))
SCENES = {
    "height": Scene(CAMERA, (SUN,), volumes=(Volume(BOX, LAYER),)),
    "frontlit": Scene(CAMERA, (replace(SUN, direction=normalized((0.4, 1.0, -0.3))),), volumes=(Volume(BOX, HAZE),)),
    "backlit": Scene(CAMERA, (replace(SUN, direction=normalized((0.4, -1.0, -0.3))),), volumes=(Volume(BOX, HAZE),)),
    "ball": Scene(CAMERA, (SUN,), volumes=(Volume(BALL, HAZE),)),
    "point": Scene(CAMERA, (Point((1.0, -7.0, 5.0), (900.0, 600.0, 300.0)),), volumes=(Volume(BOX, HAZE),)),
    "blocked": Scene(CAMERA, (SPOT,), volumes=(Volume(BOX, HAZE),), surfaces=(BLOCKER,)),
    "inside": Scene(Camera((0.3, -1.0, -1.5), normalized((0.1, 1.0, 0.4)), 1.2), (SUN,), volumes=(Volume(BOX, HAZE),)),
    "two": Scene(CAMERA, (SUN, SPOT), volumes=(Volume(BOX, HAZE),)),
}


def relative_error(result, truth):
    return math.sqrt(((result.image - truth) ** 2).mean()) / truth.mean()


def truth_of(scene, size=16):
    """32 nodes on every lit interval, through the centres of the pixels, without the compilation of larger images."""
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = geometry.camera_rays(scene.camera, size, size, column.ravel(), row.ravel())
    return single_scattering.radiance(scene, *rays, np.random.default_rng(0), 32)[0].reshape(size, size, 3)


@pytest.mark.parametrize("name", SCENES)
def test_converges_to_the_quadrature(name):
    coarse, fine = (relative_error(half_angle_slices.render(SCENES[name], 16, 16, strata=0, slices=n, resolution=n // 4),
                                   truth_of(SCENES[name])) for n in (32, 256))
    assert fine < coarse / 4.0
    assert fine < {"blocked": 2e-2, "two": 1e-2}.get(name, 5e-3)


@pytest.mark.parametrize("name", SCENES)
def test_stated_error_covers_the_truth(name):
    truth = truth_of(SCENES[name])
    result = half_angle_slices.render(SCENES[name], 16, 16, strata=0, slices=64, resolution=32)
    error = np.abs(result.image - truth)
    # Least measured 0.82, where the buffer's texels on the edge of a box decide.
    assert (error <= 2.0 * result.error_estimate + 1e-9 * truth.mean()).mean() > 0.75
    assert (result.error_estimate**2).mean() < 10.0**2 * (error**2).mean()


def test_slabs_alone_are_of_second_order():
    """A sun along the slabs' normal lights each of them evenly: the buffer's texels do not matter."""
    sun = Sun((0.0, 1.0, 0.0), (3.0, 3.0, 3.0))
    scene = Scene(replace(CAMERA, field_of_view=math.radians(24.0)), (sun,), volumes=(Volume(BOX, HAZE),))
    truth = truth_of(scene)
    errors = [relative_error(half_angle_slices.render(scene, 16, 16, strata=0, slices=n, resolution=4), truth)
              for n in (8, 16, 32)]
    for one, two in zip(errors, errors[1:]):
        assert 3.0 < one / two < 5.0


def test_half_vector_keeps_both_within_45_degrees():
    directions = np.random.default_rng(1).normal(size=(200, 2, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    for view, travel in directions:
        half = half_angle_slices.half_vector(view, travel)
        assert np.linalg.norm(half) == pytest.approx(1.0)
        assert half @ travel >= math.sqrt(0.5) - 1e-12  # the light always goes forward
        assert abs(half @ view) >= math.sqrt(0.5) - 1e-12
        assert (half @ view > 0.0) == (view @ travel >= 0.0)


def test_buffer_holds_the_optical_depth_of_the_light():
    for name in ("height", "point", "blocked"):
        scene = SCENES[name]
        light = scene.lights[0]
        buffer = half_angle_slices._Buffer(scene, light, 128, 64, 0.0)
        position = np.random.default_rng(2).uniform(-1.2, 1.2, (300, 3))
        if isinstance(light, Sun):
            toward, distance = np.broadcast_to(-np.array(light.direction), position.shape), np.full(300, np.inf)
        else:
            offset = np.array(light.position) - position
            distance = np.linalg.norm(offset, axis=1)
            if isinstance(light, Spot):
                keep = -(offset @ light.direction) > 0.95 * distance
                position, offset, distance = position[keep], offset[keep], distance[keep]
            toward = offset / distance[:, None]
        exact = marching.optical_depth(scene, position, toward, distance, 1)
        found = buffer.depth(position, toward, distance)
        assert len(position) > 50
        # Measured 1e-2 at worst, in the row of texels where the light enters through another face of the box.
        np.testing.assert_allclose(found, exact, atol=0.03 * exact.max())


def test_blur_keeps_light_and_creates_none():
    white = Medium((0.5, 0.5, 0.5), (0.0, 0.0, 0.0), Phase(0.5))
    scene = Scene(CAMERA, (SUN,), volumes=(Volume(BOX, white),))
    single, narrow, wide = (half_angle_slices.render(scene, 12, 12, strata=0, slices=32, resolution=16, blur=b).image
                            for b in (0.0, 0.1, 0.8))
    assert narrow.mean() > 1.1 * single.mean() and wide.mean() > 1.1 * single.mean()
    buffer = half_angle_slices._Buffer(scene, SUN, 32, 16, 0.3)
    assert (buffer.left >= 0.0).all() and buffer.left.max() < 1e-9  # nothing is absorbed, nothing is gained
    black = Scene(CAMERA, (SUN,), volumes=(Volume(BOX, replace(white, sigma_s=(0.01,) * 3, sigma_a=(0.5,) * 3)),))
    dark, blurred = (half_angle_slices._Buffer(black, SUN, 32, 16, b).left for b in (0.0, 0.3))
    assert (blurred <= dark + 1e-12).all() and (blurred >= 0.9 * dark).all()


def test_spread_keeps_constants_and_moves_light_by_its_radius():
    np.testing.assert_allclose(half_angle_slices.spread(np.full((8, 8, 3), 0.7), 1.3), 0.7)
    image = np.zeros((21, 21, 3))
    image[10, 10] = 1.0
    spread = half_angle_slices.spread(image, 3.0)
    assert spread.sum() == pytest.approx(3.0)
    row, column = np.indices((21, 21)) - 10
    assert (spread[..., 0] * (row**2 + column**2)).sum() == pytest.approx(9.0, rel=0.06)
    np.testing.assert_array_equal(half_angle_slices.spread(image, 0.0), image)


def test_noise_against_a_fine_march():
    noise = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.8, 1.0, 0.5, 1.0, 0.8, 0.5, 5)
    cloud = Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((3.0, 2.0, 1.0), (0.0, 0.5, 1.0), Phase(0.6), noise))
    scene = Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(30.0)), (SUN,), volumes=(cloud,))
    truth = ray_marching.render(scene, 12, 12, strata=0, steps=128, light_steps=48).image
    result = half_angle_slices.render(scene, 12, 12, strata=0, slices=96, resolution=48)
    assert relative_error(result, truth) < 0.04
    assert (np.abs(result.image - truth) <= 2.0 * result.error_estimate + 1e-9).mean() > 0.85


def test_refuses_lights_without_common_slices():
    volumes = (Volume(BOX, HAZE),)
    slide = Projector((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 1.0, 1.0), 0.5, 0.5)
    cases = {"Point light in or close to": Point((0.5, -0.3, 1.7), (1.0, 1.0, 1.0)),
             "Spot light in or close to": replace(SPOT, cone_angle=math.radians(150.0)), "no projected image": slide}
    for reason, light in cases.items():
        scene = Scene(CAMERA, (light,), volumes=volumes)
        assert reason in half_angle_slices.applies(scene)
        with pytest.raises(ValueError, match=reason):
            half_angle_slices.render(scene, 4, 4)


@pytest.mark.parametrize("blur", [-0.1, 1.1, math.nan])
def test_refuses_other_blurs(blur):
    with pytest.raises(ValueError, match=r"blur must be in \[0, 1\] rad, got"):
        half_angle_slices.render(SCENES["height"], 4, 4, blur=blur)
