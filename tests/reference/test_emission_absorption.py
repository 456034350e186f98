# SPDX-License-Identifier: GPL-3.0-or-later
"""The emission-absorption model against closed forms and quadrature; transfer functions on Grids."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from volumetrics_addon.physics.transfer_function import TransferFunction1D, TransferFunction2D
from volumetrics_addon.reference import emission_absorption
from volumetrics_addon.scene.model import (
    Box, Camera, Dielectric, Ellipsoid, Grid, Medium, NoiseShape, Phase, Point, Scene, Sun, Surface, Volume, normalized,
)

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(40.0))
NARROW = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), 1e-6)
HAZE = Medium((0.4, 0.3, 0.2), (0.02, 0.05, 0.1), Phase(0.5))
BOX = Box((0.0, 0.0, 0.0), (2.0, 1.5, 2.0))


def phase(c, g):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * c) ** 1.5)


def test_homogeneous_box_in_closed_form():
    """S (1 - exp(-sigma_t d)) / sigma_t + L_environment exp(-sigma_t d), to rounding with any number of steps."""
    sun = Sun(normalized((0.3, 1.0, -0.5)), (3.0, 2.0, 1.0))
    scene = Scene(NARROW, (sun,), (0.5, 0.6, 0.7), (Volume(BOX, HAZE),))
    for steps in (2, 9):
        result = emission_absorption.render(scene, 1, 1, steps=steps)
        for k in range(3):
            # Seen along +y: the light's direction of travel back to the eye is -y.
            source = HAZE.sigma_s[k] * (scene.environment[k] + phase(-sun.direction[1], 0.5) * sun.irradiance[k])
            through = math.exp(-HAZE.sigma_t[k] * 3.0)
            expected = source * (1 - through) / HAZE.sigma_t[k] + scene.environment[k] * through
            assert result.image[0, 0, k] == pytest.approx(expected, rel=1e-10)
            assert result.error_estimate[0, 0, k] < 1e-12


def test_point_light_by_quadrature_and_the_stated_error():
    light = Point((0.4, 0.2, 0.9), (30.0, 20.0, 10.0))
    scene = Scene(NARROW, (light,), volumes=(Volume(BOX, HAZE),))

    def integrand(t, k):
        offset = np.array(light.position) - (0.0, -6.0 + t, 0.0)
        d = np.linalg.norm(offset)
        return HAZE.sigma_s[k] * phase(offset[1] / d, 0.5) * light.power[k] / (4 * math.pi * d * d) * math.exp(
            -HAZE.sigma_t[k] * (t - 4.5))

    for steps in (8, 32, 128):
        result = emission_absorption.render(scene, 1, 1, steps=steps)
        for k in range(3):
            error = abs(result.image[0, 0, k] - quad(integrand, 4.5, 7.5, args=(k,), epsabs=1e-13)[0])
            assert error <= 1.5 * result.error_estimate[0, 0, k] < 0.05 * result.image[0, 0, k]


def test_without_absorption_a_uniform_environment_stays():
    """The white furnace: sigma_s L / sigma_t is L, whatever the density."""
    shape = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.5, 2.0, 0.5, 0.6, 0.8, 0.3, 1)
    medium = Medium((5.0, 3.0, 1.0), (0.0, 0.0, 0.0), Phase(0.7), shape)
    scene = Scene(CAMERA, environment=(0.3, 0.5, 0.7), volumes=(Volume(Ellipsoid((0, 0, 0), (1, 1, 1)), medium),))
    result = emission_absorption.render(scene, 12, 12)
    np.testing.assert_allclose(result.image, np.broadcast_to((0.3, 0.5, 0.7), (12, 12, 3)), rtol=1e-12)


def test_surfaces_clip_the_ray():
    black = Surface(Box((0.0, 0.0, 0.0), (3.0, 0.0, 3.0)), (0.0, 0.0, 0.0))
    medium = Medium((0.0, 0.2, 0.0), (0.5, 0.3, 0.1))
    scene = Scene(NARROW, environment=(9.0, 9.0, 9.0), volumes=(Volume(BOX, medium),), surfaces=(black,))
    result = emission_absorption.render(scene, 1, 1, repeats=2)
    expected = [9.0 * s / t * (1 - math.exp(-1.5 * t)) for s, t in zip(medium.sigma_s, medium.sigma_t)]
    np.testing.assert_allclose(result.image[0, 0], expected, rtol=1e-10)


# --- transfer functions ------------------------------------------------------------------------------------------


def data_scene(values, half=(1.0, 1.0, 1.0), camera=NARROW):
    low, high = tuple(-h for h in half), half
    medium = Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), density=Grid(values, low, high))
    return Scene(camera, environment=(0.1, 0.2, 0.3), volumes=(Volume(Box((0, 0, 0), half), medium),))


SHARP = TransferFunction1D([0.0, 0.48, 0.5, 0.52, 1.0], [[0, 0, 0], [0, 0, 0], [40, 20, 10], [0, 0, 0], [1, 1, 2]],
                           [0.0, 0.1, 30.0, 0.1, 0.5])


def ramp(count=9):
    """Values 0 at the near face to 1 at the far one, constant over half a cell at both."""
    return np.broadcast_to((np.linspace(0.0, 1.0, count))[None, :, None], (3, count, 3)).copy()


def literal(transfer, scalar, length, background, count=200_001):
    """Riemann sum in fine steps of the transfer function along scalars."""
    t = (np.arange(count) + 0.5) / count * length
    emission, extinction = transfer(scalar(t))
    step = length / count
    depth = (np.cumsum(extinction) - extinction / 2) * step
    return (emission * np.exp(-depth)[:, None]).sum(axis=0) * step + background * np.exp(-extinction.sum() * step)


def test_a_thin_peak_is_not_stepped_over():
    """A peak of 1/25 of the data's range, met by few steps: preintegration finds all of it."""
    scene = data_scene(ramp())
    expected = literal(SHARP, lambda t: np.clip((t - 1 / 9) / (16 / 9), 0, 1), 2.0, np.array(scene.environment))
    # With 18 steps the kinks at the outermost cell centres lie between steps: measured 1e-8; with others within: 0.017.
    result = emission_absorption.render(scene, 1, 1, steps=18, transfer=SHARP)
    np.testing.assert_allclose(result.image[0, 0], expected, rtol=1e-7)
    for steps in (5, 12, 31):
        result = emission_absorption.render(scene, 1, 1, steps=steps, transfer=SHARP)
        np.testing.assert_allclose(result.image[0, 0], expected, rtol=0.03)
        assert (np.abs(result.image[0, 0] - expected) <= 2 * result.error_estimate[0, 0] + 1e-6).all()


def test_two_dimensions_classify_by_the_gradient():
    """Emission only where data change: on a ramp of slope 1/2 per metre between flat ends."""
    values = np.concatenate([np.zeros((3, 8, 3)), np.broadcast_to(np.linspace(0, 1, 9)[None, :, None], (3, 9, 3)),
                             np.ones((3, 8, 3))], axis=1)
    table = TransferFunction2D([0.0, 1.0], [0.0, 0.1, 0.5], np.array([[[0] * 3, [0] * 3, [2, 4, 6]]] * 2, float),
                               np.zeros((2, 3)))
    scene = data_scene(values, (1.0, 3.125, 1.0))
    result = emission_absorption.render(scene, 1, 1, steps=500, transfer=table)
    cell, slope = 0.25, 0.5
    t = (np.arange(20000) + 0.5) / 20000 * 25 - 0.5
    gradient = np.interp(t, np.arange(25), np.gradient(values[1, :, 1], cell))
    expected = 2 * np.interp(gradient, [0.1, slope], [0, 1]).mean() * 6.25
    added = result.image[0, 0] - scene.environment
    np.testing.assert_allclose(added, expected * np.array([1, 2, 3]), rtol=1e-9)


def test_refuses_what_it_cannot_do():
    medium = Volume(BOX, HAZE)
    with pytest.raises(ValueError, match="no medium of the scene scatters"):
        emission_absorption.render(Scene(CAMERA, volumes=(Volume(BOX, Medium((0, 0, 0), (1, 1, 1))),)), 2, 2)
    assert "refracts" in emission_absorption.applies(Scene(CAMERA, volumes=(Volume(BOX, HAZE, Dielectric(1.3)),)))
    with pytest.raises(ValueError, match="needs a scene of one volume whose density is a Grid, got .'Homogeneous'.; leave"):
        emission_absorption.render(Scene(CAMERA, volumes=(medium,)), 2, 2, transfer=SHARP)
    with pytest.raises(ValueError, match="transfer must be a TransferFunction1D or TransferFunction2D, got 3"):
        emission_absorption.render(data_scene(ramp()), 2, 2, transfer=3)
    with pytest.raises(ValueError, match="steps must be a whole number >= 2, got 1; use"):
        emission_absorption.render(Scene(CAMERA, volumes=(medium,)), 2, 2, steps=1)


def test_settings_render():
    scene = Scene(CAMERA, (Sun((0.0, 0.0, -1.0), (1.0, 1.0, 1.0)),), (0.2, 0.2, 0.2), (Volume(BOX, HAZE),))
    assert len(emission_absorption.SETTINGS) >= 5
    for settings in emission_absorption.SETTINGS:
        result = emission_absorption.render(scene, 4, 4, **settings)
        assert np.isfinite(result.image).all() and np.isfinite(result.error_estimate).all()
