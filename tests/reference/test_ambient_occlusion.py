# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumetric ambient occlusion against closed forms, single scattering and its own limits."""

import math

import numpy as np
import pytest

from volumetrics_addon.physics.transfer_function import TransferFunction1D, TransferFunction2D
from volumetrics_addon.reference import ambient_occlusion, emission_absorption, ray_marching
from volumetrics_addon.reference.ambient_scattering import Lattice
from volumetrics_addon.scene.model import (
    Box, Camera, Dielectric, Ellipsoid, Grid, Medium, NoiseShape, Phase, Scene, Sun, Volume, normalized,
)

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(30.0))
NARROW = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), 1e-6)
HAZE = Medium((0.4, 0.3, 0.2), (0.02, 0.05, 0.1), Phase(0.5))
UNIT = Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
LATTICE = Lattice(np.array([-4.0, -4.0, -4.0]), np.array([4.0, 4.0, 4.0]), (24, 24, 24))


@pytest.mark.parametrize("radius", [0.05, 0.7, 2.0])
def test_inside_a_homogeneous_medium(radius):
    """exp(-r sigma) by the ball, (1 - exp(-r sigma)) / (r sigma) by directions: the mean over light born along r."""
    extinction = np.full((24, 24, 24, 1), 1.3)
    middle = (12, 12, 12, 0)
    ball = ambient_occlusion.accessibility(LATTICE, extinction, radius, 0)
    assert ball[middle] == pytest.approx(math.exp(-1.3 * radius), rel=1e-9)  # measured 1e-11: a small part of a large sum
    rays = ambient_occlusion.accessibility(LATTICE, extinction, radius, 14)
    assert rays[middle] == pytest.approx(-math.expm1(-1.3 * radius) / (1.3 * radius), rel=1e-12)
    for values in (ball, rays):
        assert (values >= 0).all() and (values <= 1).all() and values[0, 0, 0, 0] > values[middle] - 1e-9


def test_half_space():
    """On the face of thick matter half of all directions are free."""
    extinction = np.zeros((24, 24, 24))
    extinction[:, :, :12] = 1e4
    position = np.array([[0.0, 0.0, 0.17], [0.0, 0.0, -2.0]])
    above, below = ambient_occlusion._accessibility(LATTICE, extinction, position, 2.0, 100)
    # Directions just below the horizon reach the matter only at the end of the ball; measured 0.503.
    assert 0.49 < above < 0.53
    assert below < 1e-3


def test_directions_are_spread_evenly():
    directions = ambient_occlusion.spiral(200)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=5e-3)
    np.testing.assert_allclose(directions.T @ directions / 200, np.eye(3) / 3, atol=5e-3)


def test_a_small_radius_is_the_emission_absorption_model():
    scene = Scene(CAMERA, environment=(0.3, 0.5, 0.7), volumes=(Volume(UNIT, HAZE),))
    occluded = ambient_occlusion.render(scene, 8, 8, resolution=6, radius=1e-9, steps=20)
    free = emission_absorption.render(scene, 8, 8, steps=20)
    np.testing.assert_allclose(occluded.image, free.image, rtol=1e-8)


def test_lights_scatter_once():
    scene = Scene(CAMERA, (Sun(normalized((1.0, 0.4, -0.6)), (3.0, 2.0, 1.0)),), volumes=(Volume(UNIT, HAZE),))
    found = ambient_occlusion.render(scene, 8, 8, resolution=4, steps=20)
    single = ray_marching.render(scene, 8, 8, strata=0, steps=20)
    np.testing.assert_allclose(found.image, single.image, rtol=1e-10)


def test_a_wider_ball_is_darker_and_never_brighter_than_the_environment():
    shape = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.5, 2.0, 0.5, 0.6, 0.8, 0.3, 1)
    medium = Medium((6.0,) * 3, (0.0,) * 3, Phase(0.7), shape)
    scene = Scene(CAMERA, environment=(0.5,) * 3, volumes=(Volume(UNIT, medium),))
    means = []
    for radius in (0.01, 0.1, 0.4):
        image = ambient_occlusion.render(scene, 12, 12, resolution=12, radius=radius, steps=20).image
        assert (image <= 0.5 * (1 + 1e-12)).all()
        means.append(image.mean())
    assert means[0] > means[1] > means[2] > 0.1


@pytest.mark.parametrize("directions", [0, 14])
def test_the_stated_error_covers_the_numerical_one(directions):
    scene = Scene(CAMERA, environment=(0.5,) * 3, volumes=(Volume(UNIT, Medium((3.0,) * 3, (0.5,) * 3)),))
    best = ambient_occlusion.render(scene, 8, 8, resolution=24, steps=96, radius=0.4, directions=directions)
    quick = ambient_occlusion.render(scene, 8, 8, resolution=10, steps=20, radius=0.4, directions=directions)
    error = np.abs(quick.image - best.image)
    assert (error <= 2.0 * quick.error_estimate + best.error_estimate + 1e-12).mean() > 0.9
    assert quick.error_estimate.mean() < 0.1 * quick.image.mean()


def data_scene(values, **changes):
    density = Grid(values, (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    volume = Volume(Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((1.0,) * 3, (0.0,) * 3, density=density))
    return Scene(NARROW, environment=(0.5, 1.0, 2.0), volumes=(volume,), **changes)


def test_transfer_on_uniform_data_in_closed_form():
    """Deep in data of one value: e L_environment exp(-r sigma) (1 - exp(-sigma d)) / sigma, up to the lighter ends."""
    table = TransferFunction1D([0.0, 1.0], [[0.0] * 3, [2.0, 1.0, 0.5]], [0.0, 0.8])
    scene = data_scene(np.full((4, 4, 4), 0.5))
    sigma, radius = 0.4, 0.02
    image = ambient_occlusion.render(scene, 1, 1, resolution=40, radius=radius, transfer=table).image[0, 0]
    through = math.exp(-2.0 * sigma)
    expected = [e * l * math.exp(-radius * sigma) * (1 - through) / sigma + l * through
                for e, l in zip((1.0, 0.5, 0.25), scene.environment)]
    np.testing.assert_allclose(image, expected, rtol=1e-4)  # measured 4e-5: accessibility is higher within r of the faces
    plain = emission_absorption.render(scene, 1, 1, transfer=table).image[0, 0]
    np.testing.assert_allclose(plain, [e * (1 - through) / sigma + l * through
                                       for e, l in zip((1.0, 0.5, 0.25), scene.environment)], rtol=1e-9)


def test_transfer_in_two_dimensions():
    table = TransferFunction2D([0.0, 1.0], [0.0, 1.0], np.ones((2, 2, 3)), np.full((2, 2), 0.8))
    scene = data_scene(np.random.default_rng(1).random((5, 5, 5)))
    bright = ambient_occlusion.render(scene, 1, 1, resolution=12, radius=1e-9, transfer=table).image[0, 0]
    dark = ambient_occlusion.render(scene, 1, 1, resolution=12, radius=0.5, transfer=table).image[0, 0]
    expected = np.array(scene.environment) * ((1 - math.exp(-1.6)) / 0.8 + math.exp(-1.6))
    np.testing.assert_allclose(bright, expected, rtol=1e-8)
    assert (dark < bright).all()


def test_refuses_what_it_cannot_do():
    black = Scene(CAMERA, volumes=(Volume(UNIT, Medium((0.0,) * 3, (1.0,) * 3)),))
    with pytest.raises(ValueError, match="ambient_occlusion does not apply: no medium of the scene scatters"):
        ambient_occlusion.render(black, 2, 2)
    assert "refracts" in ambient_occlusion.applies(Scene(CAMERA, volumes=(Volume(UNIT, HAZE, Dielectric(1.3)),)))
    scene = Scene(CAMERA, volumes=(Volume(UNIT, HAZE),))
    for name, value in (("resolution", 1), ("steps", 1), ("directions", -1), ("light_steps", 0), ("radius", 0.0)):
        with pytest.raises(ValueError, match=f"{name} must be .*;"):
            ambient_occlusion.render(scene, 2, 2, **{name: value})


def test_settings_render():
    scene = Scene(CAMERA, (Sun((0.0, 0.0, -1.0), (1.0,) * 3),), (0.2,) * 3, (Volume(UNIT, HAZE),))
    assert len(ambient_occlusion.SETTINGS) >= 5
    for settings in ambient_occlusion.SETTINGS[:4]:
        result = ambient_occlusion.render(scene, 3, 3, **settings)
        assert np.isfinite(result.image).all() and np.isfinite(result.error_estimate).all()
