# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog by depth: against quadrature where nothing casts a shadow, and depth fogs against their formulas."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import depth_fog, single_scattering
from volumetrics_addon.reference.select import integrator
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, DepthFog, ExponentialHeight, Homogeneous, Medium, Phase, Point, Scene, Spot, Sun, Surface, Volume, normalized,
)

GROUND = Surface(Box((0.0, 0.0, 0.0), (4000.0, 4000.0, 0.0)), (0.3, 0.25, 0.2))
BOX = Box((0.0, 0.0, 9.9), (4000.0, 4000.0, 10.1))
SUN = Sun(normalized((0.3, 0.6, -0.5)), (3.0, 2.5, 2.0))


def fog(density, sigma=0.05, g=0.5):
    return Volume(BOX, Medium((0.9 * sigma, 0.8 * sigma, 0.7 * sigma), (0.1 * sigma, 0.2 * sigma, 0.3 * sigma), Phase(g), density))


LAYERS = (fog(ExponentialHeight(2.0, 0.0)), fog(ExponentialHeight(8.0, 0.0), 0.01))
CAMERA = Camera((0.0, 0.0, 3.0), normalized((0.0, 1.0, -0.05)), 1.0)


@pytest.mark.parametrize("volumes", (LAYERS, (fog(Homogeneous(), 0.02),)), ids=("layers", "slab"))
@pytest.mark.parametrize("height", (1.0, 30.0))
def test_sun_over_open_ground(volumes, height):
    scene = Scene(Camera((0.0, 0.0, height), normalized((0.0, 1.0, 0.02 - 0.02 * height)), 1.0), (SUN,), volumes=volumes,
                  surfaces=(GROUND,))
    quick, exact = (module.render(scene, 24, 18, strata=0).image for module in (depth_fog, single_scattering))
    assert quick == pytest.approx(exact, rel=1e-3, abs=1e-9)


def test_sky_over_open_ground():
    """A uniform sky is many suns: 16 elevations, denser at the horizon, in 12 directions."""
    radiance = (0.5, 0.7, 1.0)
    x, w = np.polynomial.legendre.leggauss(16)
    suns = []
    for root, weight in zip((x + 1.0) / 2.0, w / 2.0):
        mu0, solid_angle = root**2, weight * 2.0 * root * 2.0 * math.pi / 12
        for azimuth in (np.arange(12) + 0.5) / 12 * 2.0 * math.pi:
            level = math.sqrt(1.0 - mu0**2)
            suns.append(Sun((level * math.cos(azimuth), level * math.sin(azimuth), -mu0), tuple(r * solid_angle for r in radiance)))
    sky = Scene(CAMERA, environment=radiance, volumes=LAYERS, surfaces=(GROUND,))
    exact = single_scattering.render(replace(sky, lights=tuple(suns), environment=(0.0, 0.0, 0.0)), 4, 3, strata=0).image
    rays = geometry.camera_rays(CAMERA, 4, 3, *(a.ravel() + 0.5 for a in np.meshgrid(np.arange(4), np.arange(3))))
    quick = image_of(sky, *rays)
    # The suns' discs are not seen: the sky itself is taken out again.
    up = rays[1][:, 2] > 0.0
    assert up.any() and not up.all()
    _, depth = depth_fog.along(depth_fog.fog_of(sky), *rays, 0.0, np.inf)
    quick[up] -= np.exp(-depth)[up, None] * np.array(radiance)
    quick = quick.reshape(3, 4, 3)
    assert quick == pytest.approx(exact, rel=0.03)
    assert quick.mean() == pytest.approx(exact.mean(), rel=0.005)


def image_of(scene, origin, direction):
    """Mean of many drawings of what reaches the ground, which is all that is random."""
    rng = np.random.default_rng(1)
    return np.mean([depth_fog.composited(scene, DepthFog(), depth_fog.fog_of(scene), origin, direction, rng) for _ in range(64)], axis=0)


def test_loss_grows_with_what_casts_shadows():
    tower = Surface(Box((0.0, 30.0, 10.0), (40.0, 2.0, 10.0)), (0.3, 0.3, 0.3))
    bare = Scene(CAMERA, (replace(SUN, direction=normalized((0.0, -1.0, -0.4))),), volumes=LAYERS, surfaces=(GROUND,))
    assert depth_fog.loss(bare) < 0.002
    assert depth_fog.loss(replace(bare, surfaces=(GROUND, tower))) > 0.02


DEPTH_FOGS = {
    "linear": lambda d: np.clip((50.0 - d) / (50.0 - 5.0), 0.0, 1.0),
    "exp": lambda d: np.exp(-0.03 * np.maximum(d - 5.0, 0.0)),
    "exp2": lambda d: np.exp(-((0.03 * np.maximum(d - 5.0, 0.0)) ** 2)),
}


@pytest.mark.parametrize("kind", DEPTH_FOGS)
def test_depth_fog_by_its_formula(kind):
    """Walls at known distances, one ray each: a wall of radiance E cos albedo / pi, faded to the far radiance and the sun's."""
    settings = DepthFog(start=5.0, falloff=kind, end=50.0, density=0.03, albedo=(0.9, 0.8, 0.7), g=0.4, radiance=(0.1, 0.2, 0.3))
    sun = Sun((0.0, 1.0, 0.0), (2.0, 2.0, 1.0))  # level: below its lowest elevation it does not count, so tip it
    sun = replace(sun, direction=normalized((0.0, 1.0, -0.5)))
    for distance in (3.0, 20.0, 45.0, 200.0):
        wall = Surface(Box((0.0, distance, 0.0), (500.0, 0.0, 500.0)), (0.5, 0.5, 0.5))
        scene = Scene(Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.01), (sun,), surfaces=(wall,), depth_fog=settings)
        assert integrator(scene) is depth_fog
        seen = depth_fog.render(scene, 1, 1, strata=0).image[0, 0]
        cosine = sun.direction[1]  # of the ray with the way to the sun behind it: light travels on along the ray, backwards
        phase = (1.0 - 0.4**2) / (4.0 * math.pi * (1.0 + 0.4**2 + 2.0 * 0.4 * cosine) ** 1.5)
        passed = DEPTH_FOGS[kind](distance)
        for channel in range(3):
            irradiance = sun.irradiance[channel]
            far = settings.radiance[channel] + settings.albedo[channel] * phase * irradiance
            expected = passed * 0.5 * irradiance * cosine / math.pi + (1.0 - passed) * far
            assert seen[channel] == pytest.approx(expected, rel=1e-9)


def image(scene):
    return depth_fog.render(scene, 8, 6, strata=0).image


def test_artists_settings():
    scene = Scene(CAMERA, (SUN,), volumes=LAYERS, surfaces=(GROUND,), depth_fog=DepthFog())
    plain, clear = image(scene), image(replace(scene, volumes=(fog(Homogeneous(), 1e-12),)))
    assert image(replace(scene, depth_fog=DepthFog(max_opacity=0.0)))[-1] == pytest.approx(  # dimmed light stays
        (clear * depth_fog.lit_share(scene, depth_fog.fog_of(scene), np.zeros(1)))[-1], rel=1e-6)
    assert image(replace(scene, depth_fog=DepthFog(cutoff=1e-3))) == pytest.approx(clear, rel=1e-6, abs=1e-9)
    assert image(replace(scene, depth_fog=DepthFog(start=1e5)))[0] == pytest.approx(clear[0], abs=1e-9)
    tinted = image(replace(scene, depth_fog=DepthFog(sun_tint=(1.0, 0.5, 0.0))))
    assert tinted[..., 0] == pytest.approx(plain[..., 0], rel=1e-12)
    assert (tinted[0, :, 2] < 1e-12).all() and tinted[0, :, 1] == pytest.approx(plain[0, :, 1] / 2.0, rel=1e-9)


CAMERA_LAMP = Point((0.0, 0.0, 3.0), (10.0, 10.0, 10.0))


@pytest.mark.parametrize("change, reason", (
    ({"lights": (CAMERA_LAMP,)}, "a lamp lights the fog"),
    ({"lights": (Spot((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (1.0, 1.0, 1.0), 1.0, 0.0),)}, "a lamp lights the fog"),
    ({"orders": 2}, "follows 2 orders"),
    ({"volumes": ()}, "there is no fog"),
    ({"surfaces": (replace(GROUND, emission=(1.0, 1.0, 1.0)),)}, "an emitting surface"),
    ({"volumes": (LAYERS[0], replace(LAYERS[1], domain=replace(BOX, half=(1.0, 1.0, 1.0))))}, "several domains"),
))
def test_what_has_no_closed_form(change, reason):
    scene = replace(Scene(CAMERA, (SUN,), volumes=LAYERS, surfaces=(GROUND,)), **change)
    assert reason in depth_fog.applies(scene)
    with pytest.raises(ValueError, match="depth_fog does not apply"):
        depth_fog.render(scene, 2, 2)


def test_a_linear_fog_ends_behind_its_start():
    with pytest.raises(ValueError, match="end must be > start, got end 3 m and start 5 m"):
        DepthFog(start=5.0, falloff="linear", end=3.0)
