# SPDX-License-Identifier: GPL-3.0-or-later
"""The path tracer against conservation laws and published multiple scattering."""

import math

import numpy as np
import pytest

from volumetrics_addon.reference import optics, path_tracing
from volumetrics_addon.scene.model import (
    Box, Camera, Ellipsoid, ExponentialHeight, Homogeneous, Medium, NoiseShape, Phase, Scene, Spot, Surface, Volume, swept,
)

CAMERA = Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(40.0))
BALL = Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
NOISE = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.4, 2.0, 0.5, 1.0, 0.8, 0.3, 5)


@pytest.mark.parametrize("density", [Homogeneous(), ExponentialHeight(0.5, -1.0), NOISE], ids=lambda d: type(d).__name__)
def test_white_furnace(density):
    """Nothing is absorbed and light of radiance 1 comes from everywhere: every path returns exactly 1."""
    medium = Medium((3.0, 3.0, 3.0), (0.0, 0.0, 0.0), Phase(0.6, -0.3, 0.3), density)
    white = Surface(Box((0.0, 0.0, -1.5), (3.0, 3.0, 0.1)), (1.0, 1.0, 1.0))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(Volume(BALL, medium),), surfaces=(white,), orders=1024)
    result = path_tracing.render(scene, 8, 8, repeats=2, strata=2)
    np.testing.assert_allclose(result.image, 1.0, atol=1e-9)


def test_coloured_white_furnace():
    """Coloured scattering without absorption: the hero channels' weights still average to 1."""
    medium = Medium((2.0, 1.0, 0.5), (0.0, 0.0, 0.0), Phase(0.4))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(Volume(BALL, medium),), orders=512)
    result = path_tracing.render(scene, 10, 10, repeats=8, strata=8)
    error = result.repeats.mean(axis=(1, 2)).std(axis=0, ddof=1) / math.sqrt(8)
    assert (np.abs(result.image.mean(axis=(0, 1)) - 1.0) < 4.5 * error).all() and (error < 0.01).all()


def test_van_de_hulsts_slab():
    """Albedo 0.9, g 0.75, optical depth 2, normal incidence: R 0.09739 and T 0.66096 (van de Hulst 1980, table 35).

    By reciprocity the radiance that leaves along the normal under uniform light from all sides is R + T.
    """
    medium = Medium((0.9, 0.9, 0.9), (0.1, 0.1, 0.1), Phase(0.75))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(Volume(Box((0, 0, 0), (1e5, 1.0, 1e5)), medium),), orders=1024)
    rng = np.random.default_rng(3)
    n = 120_000
    value, _ = path_tracing.radiance(scene, np.tile(CAMERA.position, (n, 1)), np.tile((0.0, 1.0, 0.0), (n, 1)), rng)
    grey = value.mean(axis=1)
    assert grey.mean() == pytest.approx(0.09739 + 0.66096, abs=4.5 * grey.std() / math.sqrt(n))
    assert grey.std() / math.sqrt(n) < 1e-3


@pytest.mark.parametrize("density", [Homogeneous(), ExponentialHeight(0.5, -1.0), NOISE], ids=lambda d: type(d).__name__)
def test_transmittance_of_an_absorber(density):
    """Without scattering the image is the transmittance, here against many small steps along the ray."""
    sigma = np.array((2.0, 1.0, 0.5))
    volume = Volume(BALL, Medium((0.0, 0.0, 0.0), tuple(sigma), density=density))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(volume,))
    origin, direction = np.array([[-2.0, 0.1, 0.2]]), np.array([[1.0, 0.0, 0.0]])
    t = 2.0 + math.sqrt(1 - 0.05) * (np.arange(20000) + 0.5) / 10000 - math.sqrt(1 - 0.05)
    depth = optics.density_at(volume, origin + t[:, None] * direction).mean() * 2 * math.sqrt(1 - 0.05)
    rng = np.random.default_rng(0)
    n = 40000
    ratio = path_tracing.transmittance(scene, np.tile(origin, (n, 1)), np.tile(direction, (n, 1)), np.inf, rng)
    traced, _ = path_tracing.radiance(scene, np.tile(origin, (n, 1)), np.tile(direction, (n, 1)), rng)
    for estimate in (ratio, traced):
        error = estimate.std(axis=0) / math.sqrt(n)
        assert (np.abs(estimate.mean(axis=0) - np.exp(-sigma * depth)) < 4.5 * error + 1e-6).all()
        assert (error < 0.01).all()


def test_overlapping_volumes_add_up():
    half = Medium((0.5, 0.5, 0.5), (0.2, 0.2, 0.2), Phase(0.3))
    whole = Medium((1.0, 1.0, 1.0), (0.4, 0.4, 0.4), Phase(0.3))
    images = []
    for volumes in ((Volume(BALL, half), Volume(BALL, half)), (Volume(BALL, whole),)):
        scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=volumes, orders=64)
        images.append(path_tracing.render(scene, 10, 10, repeats=8, strata=6, seed=len(volumes)))
    spread = math.sqrt(sum(r.repeats.mean(axis=(1, 2, 3)).var(ddof=1) / 8 for r in images))
    assert abs(images[0].image.mean() - images[1].image.mean()) < 4.5 * spread


def test_orders_bound_the_scattering():
    """More orders never lose light, and the first order alone is dimmer."""
    medium = Medium((3.0, 3.0, 3.0), (0.0, 0.0, 0.0))
    means = []
    for orders in (1, 2, 8, 128):
        scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(Volume(BALL, medium),), orders=orders)
        means.append(path_tracing.render(scene, 10, 10, repeats=2, strata=6).image.mean())
    assert means[0] < means[1] < means[2] < means[3] == pytest.approx(1.0)


def test_majorant_bounds_the_density():
    for density in (Homogeneous(), ExponentialHeight(0.5, -0.3), NOISE):
        for domain in (BALL, Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))):
            volume = Volume(domain, Medium((2.0, 1.0, 0.0), (0.5, 0.0, 0.0), density=density))
            points = np.random.default_rng(1).uniform(-0.57, 0.57, (5000, 3))
            points[0] = (0.0, 0.0, -1.0)  # the lowest point of both domains
            assert path_tracing.majorant(volume) >= 2.5 * optics.density_at(volume, points).max() * (1 - 1e-12)


def test_the_twin_refuses_what_it_would_not_end():
    """One majorant for a fog of scale height 1 mm that reaches 1 m below its base: free flights of e^-1000 m."""
    fog = Medium((1.0,) * 3, (0.0,) * 3, Phase(0.0), ExponentialHeight(1e-3, 0.0))
    scene = Scene(Camera((0.0, -3.0, 0.0), (0.0, 1.0, 0.0), 1.0), volumes=(Volume(Box((0, 0, 0), (1, 1, 1)), fog),), orders=2)
    with pytest.raises(ValueError, match="install numba"):
        path_tracing.render(scene, 2, 2, strata=1, repeats=1, kernel="numpy")


def test_ambient_light_is_scattered_once():
    """sigma_s A (1 - T) / sigma_t, however many orders the scene follows."""
    medium = Medium((0.6, 0.3, 0.2), (0.1, 0.2, 0.0), Phase(0.5), ambient=(1.0, 2.0, 3.0))
    cube = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    scene = Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), 1e-6), (), volumes=(Volume(cube, medium),), orders=3)
    result = path_tracing.render(scene, 16, 16, repeats=4, samples=64, strata=0, seed=3)
    sigma_t = np.array(medium.sigma_t)
    expected = np.array(medium.sigma_s) * medium.ambient * -np.expm1(-2.0 * sigma_t) / sigma_t
    assert np.abs(result.image.mean(axis=(0, 1)) / expected - 1.0).max() < 0.02  # 0.5 % of noise


def test_a_polyhedron_is_the_box_that_it_equals():
    medium = Medium((0.6, 0.3, 0.2), (0.1, 0.2, 0.0), Phase(0.5))
    box = Box((0.0, 0.0, 0.0), (1.0, 0.7, 0.5))
    floor, roof = (tuple((x, y, z) for x, y in ((-1.0, -0.7), (1.0, -0.7), (1.0, 0.7), (-1.0, 0.7))) for z in (-0.5, 0.5))
    spot = Spot((0.0, 0.0, 2.0), (0.0, 0.0, -1.0), (100.0,) * 3, 1.0, 0.3)
    scenes = [Scene(CAMERA, (spot,), volumes=(Volume(domain, medium),), orders=3) for domain in (box, swept(floor, roof))]
    images = [path_tracing.render(scene, 6, 6, repeats=2, kernel="numpy").image for scene in scenes]
    np.testing.assert_allclose(*images, rtol=1e-9)
    assert images[0].max() > 0.0
