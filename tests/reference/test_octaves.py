# SPDX-License-Identifier: GPL-3.0-or-later
"""Octaves against single scattering, a closed form and the path tracer."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import octaves, path_tracing, ray_marching
from volumetrics_addon.scene.model import Box, Camera, Ellipsoid, Medium, Phase, Point, Scene, Spot, Sun, Volume, normalized

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(50.0))
HAZE = Medium((0.4, 0.3, 0.2), (0.02, 0.05, 0.1), Phase(0.5))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
LIGHTS = {
    "sun": Sun(normalized((0.3, 0.2, -1.0)), (3.0, 2.0, 1.0)),
    "point": Point((0.5, -0.3, 1.7), (30.0, 20.0, 10.0)),
    "spot": Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4),
}


@pytest.mark.parametrize("kind", LIGHTS)
def test_one_octave_is_single_scattering(kind):
    scene = Scene(CAMERA, (LIGHTS[kind],), volumes=(Volume(BOX, HAZE),), orders=64)
    one = octaves.render(scene, 12, 12, strata=0, octaves=1, steps=24)
    none = octaves.render(scene, 12, 12, strata=0, octaves=9, steps=24, attenuation=0.0, contribution=0.0)
    single = ray_marching.render(scene, 12, 12, strata=0, steps=24)
    np.testing.assert_array_equal(one.image, single.image)
    np.testing.assert_array_equal(one.error_estimate, single.error_estimate)
    np.testing.assert_array_equal(none.image, single.image)


def test_slab_along_the_sun_in_closed_form():
    """Sun behind the camera: sum of b^n sigma_s p(c^n g, -1) E (1 - exp(-(1 + a^n) sigma_t d)) / ((1 + a^n) sigma_t)."""
    a, b, c, thickness = 0.4, 0.6, 0.7, 3.0
    sun = Sun((0.0, 1.0, 0.0), (5.0, 5.0, 5.0))
    narrow = Camera(CAMERA.position, CAMERA.direction, 1e-4)
    scene = Scene(narrow, (sun,), volumes=(Volume(Box((0.0, 0.0, 0.0), (50.0, thickness / 2, 50.0)), HAZE),))
    result = octaves.render(scene, 1, 1, strata=0, octaves=5, steps=400, attenuation=a, contribution=b, eccentricity=c)
    for channel in range(3):
        sigma_s, sigma_t = HAZE.sigma_s[channel], HAZE.sigma_t[channel]
        expected = 0.0
        for n in range(5):
            g, rate = 0.5 * c**n, (1 + a**n) * sigma_t
            lobe = (1 - g * g) / (4 * math.pi * (1 + g) ** 3)
            expected += b**n * sigma_s * lobe * 5.0 * -math.expm1(-rate * thickness) / rate
        assert result.image[0, 0, channel] == pytest.approx(expected, rel=1e-6)  # measured 4e-7
        assert abs(result.image[0, 0, channel] - expected) < 2.0 * result.error_estimate[0, 0, channel]


def test_every_octave_adds_light():
    scene = Scene(CAMERA, (LIGHTS["sun"],), volumes=(Volume(BOX, HAZE),))
    images = [octaves.render(scene, 8, 8, strata=0, octaves=n, steps=8).image for n in (1, 2, 4, 8)]
    for dim, bright in zip(images, images[1:]):
        assert (bright >= dim).all() and bright.mean() > dim.mean()


def test_refuses_factors_that_create_light():
    scene = Scene(CAMERA, (LIGHTS["sun"],), volumes=(Volume(BOX, HAZE),))
    with pytest.raises(ValueError, match="attenuation must be <= contribution 0.5, got 0.6: .*lower the attenuation"):
        octaves.render(scene, 4, 4, attenuation=0.6)
    for name in ("attenuation", "contribution", "eccentricity"):
        for bad in (-0.1, 1.1, math.nan):
            with pytest.raises(ValueError, match=rf"{name} must be in \[0, 1\], got"):
                octaves.render(scene, 4, 4, **{name: bad})


# Mean radiance over the truth, as the docstring states it.
STATED = {(2.0, 0.0): (0.97, 1.05, 1.20), (2.0, 0.8): (2.06, 1.29, 0.58), (8.0, 0.0): (0.57, 0.73, 1.31),
          (8.0, 0.8): (0.53, 0.45, 0.22)}
TRAVEL = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), normalized((0.1, -1.0, 0.0)))


def ball(radius, g, travel):
    medium = Medium((radius,) * 3, (0.0,) * 3, Phase(g))
    return Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(26.0)), (Sun(travel, (1.0, 1.0, 1.0)),),
                 volumes=(Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), medium),), orders=256)


def ratio(scene, repeats, strata, kernel=None):
    truth = path_tracing.render(scene, 12, 12, repeats=repeats, strata=strata, seed=1, kernel=kernel)
    near = octaves.render(scene, 12, 12, repeats=1, strata=4, octaves=8, steps=48)
    spread = truth.repeats.mean(axis=(1, 2, 3)).std(ddof=1) / math.sqrt(repeats)
    return near.image.mean() / truth.image.mean(), spread / truth.image.mean()


def test_bias_is_the_stated_one():
    """Thin ball, isotropic, three suns: the table's numbers within the path tracer's error."""
    for travel, stated in zip(TRAVEL, STATED[2.0, 0.0]):
        value, error = ratio(ball(2.0, 0.0, travel), 8, 5, "numpy")
        assert error < 0.03
        assert value == pytest.approx(stated, abs=4.5 * error * stated + 0.02)


@pytest.mark.sweep
@pytest.mark.parametrize("radius, g", STATED)
def test_every_number_of_the_table(radius, g):
    for travel, stated in zip(TRAVEL, STATED[radius, g]):
        value, error = ratio(ball(radius, g, travel), 8, 16)
        assert error < 0.02
        assert value == pytest.approx(stated, abs=4.5 * error * stated + 0.01)


def test_the_table_is_the_docstrings():
    for (radius, g), numbers in STATED.items():
        name = f"sigma_t R = {radius:g}, g = {g:g} "
        line = next(line for line in octaves.__doc__.splitlines() if line.strip().startswith(name))
        assert [float(word) for word in line.split()[7:] if "(" not in word] == list(numbers)


def test_errors_of_the_steps_are_stated_for_octaves_too():
    scene = replace(ball(8.0, 0.8, TRAVEL[1]), orders=8)
    fine = octaves.render(scene, 12, 12, strata=0, steps=512).image
    coarse = octaves.render(scene, 12, 12, strata=0, steps=16)
    error = np.abs(coarse.image - fine)
    assert error.max() > 1e-4 * fine.max()
    assert (error <= 2.0 * coarse.error_estimate + 1e-12).mean() > 0.9
