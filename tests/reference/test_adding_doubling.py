# SPDX-License-Identifier: GPL-3.0-or-later
"""The slab integrator against the slab's own radiance, its mirror image and the path tracer."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.physics.phase import dual_henyey_greenstein
from volumetrics_addon.physics.slab import slab_radiance
from volumetrics_addon.reference import adding_doubling, path_tracing
from volumetrics_addon.scene.model import (
    Box, Camera, Dielectric, Ellipsoid, ExponentialHeight, Medium, Phase, Point, Scene, Sun, Surface, Volume, normalized,
)

MEDIUM = Medium((1.0, 0.5, 0.25), (0.01, 0.1, 0.0), Phase(0.6, -0.2, 0.3))
SUN = Sun(normalized((0.4, 0.1, -0.8)), (3.0, 2.0, 1.0))
CAMERA = Camera((0.0, -8.0, 10.0), normalized((0.0, 0.8, -1.0)), math.radians(20.0))


def slab(ratio=40.0, medium=MEDIUM, **changes):
    box = Box((0.0, 0.0, 0.0), (ratio, ratio, 1.0))
    return replace(Scene(CAMERA, (SUN,), volumes=(Volume(box, medium),), orders=1000), **changes)


def with_volume(**changes):
    scene = slab()
    return replace(scene, volumes=(replace(scene.volumes[0], **changes),))


def test_centre_pixel_by_hand():
    """The camera's own direction, through the middle of an image of one pixel."""
    result = adding_doubling.render(slab(), 1, 1)
    view, sun = np.array(CAMERA.direction), np.array(SUN.direction)
    azimuth = math.acos(-(view[:2] @ sun[:2]) / math.hypot(*view[:2]) / math.hypot(*sun[:2]))
    for channel in range(3):
        sigma_s, sigma_t = MEDIUM.sigma_s[channel], MEDIUM.sigma_s[channel] + MEDIUM.sigma_a[channel]
        expected = slab_radiance(lambda c: dual_henyey_greenstein(c, 0.6, -0.2, 0.3), sigma_s / sigma_t, 2.0 * sigma_t,
                                 -sun[2], -view[2], azimuth)
        # Only rounding of the azimuth lies between them: measured 2e-15.
        assert abs(result.image[0, 0, channel] / (SUN.irradiance[channel] * expected.value) - 1) < 1e-12
        assert abs(result.error_estimate[0, 0, channel] / (SUN.irradiance[channel] * expected.error_estimate) - 1) < 1e-3


def test_centres_need_no_luck():
    first, second = (adding_doubling.render(slab(), 4, 3, seed=seed, repeats=5, quadrature=6) for seed in (0, 1))
    np.testing.assert_array_equal(first.image, second.image)
    assert first.repeats.shape == (1, 3, 4, 3) and first.integrator == "adding_doubling"
    assert np.isfinite(first.error_estimate).all() and first.evaluations == 3 * 12
    assert first.systematic == pytest.approx(first.error_estimate.mean())


def test_jittered_rays():
    scene = slab()
    centres = adding_doubling.render(scene, 4, 3, quadrature=6)
    seen = []
    jittered = adding_doubling.render(scene, 4, 3, quadrature=6, strata=2, repeats=8, progress=seen.append)
    assert jittered.repeats.shape == (8, 3, 4, 3) and seen[-1] == 1.0
    assert (jittered.error_estimate > 0).all()
    # The radiance is nearly linear over a pixel of 5 degrees: measured 0.2 %.
    np.testing.assert_allclose(jittered.image, centres.image, rtol=0.01)
    assert np.isinf(adding_doubling.render(scene, 2, 2, quadrature=4, strata=1).error_estimate).all()


def test_upside_down():
    """Sun and camera below are sun and camera above in a mirror; the far side shows what is transmitted."""
    above = adding_doubling.render(slab(), 1, 1, quadrature=8).image
    flipped = Camera((0.0, -8.0, -10.0), normalized((0.0, 0.8, 1.0)), CAMERA.field_of_view)
    below = Sun(tuple(c * s for c, s in zip(SUN.direction, (1, 1, -1))), SUN.irradiance)
    mirrored = adding_doubling.render(slab(camera=flipped, lights=(below,)), 1, 1, quadrature=8).image
    np.testing.assert_allclose(mirrored, above, rtol=1e-13)
    through = adding_doubling.render(slab(camera=flipped), 1, 1, quadrature=8).image
    assert (np.abs(through / above - 1) > 0.02).all()
    both = adding_doubling.render(slab(camera=flipped, lights=(SUN, below)), 1, 1, quadrature=8).image
    np.testing.assert_allclose(both, above + through, rtol=1e-13)


def test_what_misses_the_box_is_black():
    away = Camera(CAMERA.position, (0.0, 0.0, 1.0), CAMERA.field_of_view)
    for scene in (slab(camera=away), slab(lights=()), slab(medium=Medium((0.0,) * 3, (1.0,) * 3))):
        result = adding_doubling.render(scene, 2, 2, quadrature=4)
        assert (result.image == 0).all()
    empty = adding_doubling.render(slab(medium=Medium((0.0,) * 3, (0.0,) * 3)), 2, 2, quadrature=4)
    assert (empty.image == 0).all()


def test_settings_converge():
    """Each setting's stated error covers its distance from the finest, and that distance shrinks."""
    assert len(adding_doubling.SETTINGS) >= 5 and adding_doubling.BIAS.endswith(".")
    results = [adding_doubling.render(slab(), 2, 2, **setting) for setting in adding_doubling.SETTINGS]
    truth = results[-1]
    for result in results[:-1]:
        assert (np.abs(result.image - truth.image) <= result.error_estimate).all()
    distance = [np.abs(result.image - truth.image).max() for result in results]
    assert distance == sorted(distance, reverse=True)
    assert results[0].systematic > 1e4 * truth.systematic


def deviations(scene, width, repeats):
    """Mean over the image, path tracer over slab minus 1, per channel, with its standard error; and both results."""
    paths = path_tracing.render(scene, width, width, repeats=repeats, strata=2, seed=3)
    exact = adding_doubling.render(scene, width, width, quadrature=12)
    means = paths.repeats.mean(axis=(1, 2)) / exact.image.mean(axis=(0, 1)) - 1
    return means.mean(axis=0), means.std(axis=0, ddof=1) / math.sqrt(repeats), paths, exact


def test_against_path_tracing():
    """A box 40 times as wide as high; 23,000 paths, standard errors of the mean 1 to 3 %."""
    bias, error, paths, exact = deviations(slab(), 24, 10)
    assert (error < 0.05).all()
    # Student with 9 degrees of freedom, three channels: P(|t| > 5.5) = 4e-4 each.
    assert (np.abs(bias) < 5.5 * error).all()
    # Blocks of 6 x 6 pixels and 10 images: 48 values of t(9), whose mean square is 1.29 +- 0.4.
    blocks = (paths.repeats - exact.image).reshape(10, 4, 6, 4, 6, 3).mean(axis=(2, 4))
    t = blocks.mean(axis=0) / (blocks.std(axis=0, ddof=1) / math.sqrt(10))
    assert 0.4 < (t**2).mean() < 2.9


@pytest.mark.sweep
def test_bias_of_the_finite_box():
    """What BIAS says. Isotropic, albedo 1, optical thickness 0.2, 0.5 and 4 in red, green and blue: measured with 166,000
    paths -3.3, -2.2 and 0.1 % (0.4 to 0.5 % standard error) ten times as wide, below 0.4 % twenty times."""
    medium = Medium((0.1, 0.25, 2.0), (0.0, 0.0, 0.0))
    for ratio, largest in ((10.0, 0.03), (20.0, 0.01)):
        bias, error, *_ = deviations(slab(ratio, medium), 48, 18)
        assert (np.abs(bias) < largest + 4 * error).all()
        assert ratio > 10 or (bias[0] < -2 * error[0])


@pytest.mark.parametrize("scene, reason", [
    (slab(orders=1), "orders"),
    (with_volume(boundary=Dielectric(1.3)), "refracts"),
    (slab(volumes=()), "0 volumes"),
    (slab(volumes=slab().volumes * 2), "2 volumes"),
    (slab(surfaces=(Surface(Box((0.0, 0.0, -3.0), (1.0, 1.0, 1.0)), (0.5,) * 3),)), "surfaces"),
    (slab(environment=(0.1, 0.0, 0.0)), "environment"),
    (slab(lights=(Point((0.0, 0.0, 5.0), (1.0,) * 3),)), "not a sun"),
    (slab(lights=(Sun((1.0, 0.0, 0.0), (1.0,) * 3),)), "horizon"),
    (with_volume(domain=Ellipsoid((0.0,) * 3, (40.0, 40.0, 1.0))), "level box"),
    (with_volume(domain=Box((0.0,) * 3, (40.0, 1.0, 40.0), ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)))),
     "level box"),
    (with_volume(medium=replace(MEDIUM, density=ExponentialHeight(1.0, 0.0))), "density"),
    (slab(ratio=9.0), "not flat"),
    (with_volume(domain=Box((0.0,) * 3, (40.0, 40.0, 0.0))), "not flat"),
    (slab(camera=replace(CAMERA, position=(90.0, 0.0, 0.5))), "above nor below"),
])
def test_does_not_apply(scene, reason):
    assert reason in adding_doubling.applies(scene)
    with pytest.raises(ValueError, match=reason):
        adding_doubling.render(scene, 2, 2)


def test_applies():
    assert adding_doubling.applies(slab()) == ""
    turned = Box((5.0, 0.0, 2.0), (10.0, 20.0, 1.0), ((0.6, 0.8, 0.0), (-0.8, 0.6, 0.0), (0.0, 0.0, 1.0)))
    assert adding_doubling.applies(with_volume(domain=turned)) == ""
