# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds where add-ons go wrong: camera inside, overlapping, kilometres and centimetres, light that they take from the ground."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.bench.scenes import planet_scene  # noqa: E402
from volumetrics_addon.blender import render  # noqa: E402
from volumetrics_addon.compare.statistics import Estimate, compare  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.reference import optics, path_tracing  # noqa: E402
from volumetrics_addon.scene import units  # noqa: E402
from volumetrics_addon.scene.describe import describe_scene  # noqa: E402
from volumetrics_addon.scene.model import Camera, normalized  # noqa: E402

TOLERANCE = 0.005  # with 99.9 % confidence, as every preset


def cumulus(**changes):
    """A coarse and thin cumulus, quick to trace, its sky and sun, without ground."""
    chosen = load("cumulus").changed({"resolution": 40, "extinction": 0.02, "phase": "hg", "g": 0.6, **changes}, {"orders": 32})
    return replace(verify.scene_of(chosen), surfaces=())


def shifted(volume, offset):
    grid = volume.medium.density
    moved = replace(grid, low=tuple(np.add(grid.low, offset)), high=tuple(np.add(grid.high, offset)))
    return replace(volume, domain=replace(volume.domain, center=tuple(np.add(volume.domain.center, offset))),
                   medium=replace(volume.medium, density=moved))


def assert_cycles_equals_path_tracing(scene, size=16, samples=64):
    shot = render.render_scene(scene, describe_scene(scene), "cloud", "cycles", size, size, samples, repeats=8)
    truth = path_tracing.render(scene, size, size, repeats=8, strata=4, samples=192, seed=3)
    comparison = compare(Estimate.from_repeats(shot.images, samples), Estimate.from_repeats(truth.repeats, independent_pixels=True),
                         0.999)
    low, high = comparison.mean_relative_interval
    assert low <= TOLERANCE and high >= -TOLERANCE and comparison.z_pass_fraction >= 0.9975, (low, high)
    assert high - low < 0.05
    return truth.image


def test_the_camera_may_be_inside():
    scene = cumulus()
    inside = np.unravel_index(np.argmax(scene.volumes[0].medium.density.values), scene.volumes[0].medium.density.values.shape)
    grid = scene.volumes[0].medium.density
    size = (np.array(grid.high) - grid.low) / grid.values.shape
    eye = tuple(grid.low + (np.array(inside) + 0.5) * size)
    inside = replace(scene, camera=Camera(eye, normalized((0.3, 1.0, 0.4)), math.radians(70.0)))
    assert_cycles_equals_path_tracing(inside)


def test_overlapping_clouds_add_up():
    scene = cumulus()
    cloud, = scene.volumes
    both = replace(scene, volumes=(cloud, shifted(cloud, (60.0, 40.0, 15.0))))
    together = assert_cycles_equals_path_tracing(both)
    alone = path_tracing.render(scene, 16, 16, repeats=1, strata=4, samples=192, seed=3).image
    assert np.abs(together - alone).mean() > 0.05 * alone.mean()


@pytest.mark.parametrize("factor", [4.0, 1e-3])
def test_kilometres_and_table_tops_look_the_same(factor):
    """A cloud of two kilometres, and one of half a metre, with the same optical depth."""
    scene = cumulus()
    other = units.scaled(scene, factor)
    images = [render.render_scene(s, describe_scene(s), "cloud", "cycles", 16, 16, 64, repeats=8).images for s in (scene, other)]
    comparison = compare(*(Estimate.from_repeats(repeats, 64) for repeats in images), 0.999)
    low, high = comparison.mean_relative_interval
    assert low <= TOLERANCE and high >= -TOLERANCE and high - low < 0.05 and comparison.z_pass_fraction >= 0.9975


def test_more_coverage_dims_what_lies_below():
    """Radiance of the ground below a layer, seen from between: less with every step of the coverage."""
    ground = []
    for fill in (-0.5, 0.4, 0.9):
        chosen = load("stratocumulus").changed(
            {"resolution": 32, "fill": fill, "extinction": 0.02},
            {"orders": 48, "camera_location": (0.0, 0.0, 300.0), "camera_target": (1.0, 0.0, 0.0), "field_of_view": 130.0,
             "environment_radiance": 0.0})
        scene = verify.scene_of(chosen)
        ground.append(render.render_scene(scene, describe_scene(scene), "layer", "cycles", 12, 12, 64).images.mean())
    assert ground[0] > 1.1 * ground[1] > 1.2 * ground[2] > 0.0


@pytest.mark.either
def test_air_dims_and_veils_a_distant_cloud():
    """Aerial perspective: a cloud of some kilometres, thirty away, overlaps with the air of a planet."""
    thick = units.scaled(cumulus(), 10.0)
    cloud = shifted(thick.volumes[0], (0.0, 40e3, -2000.0))
    camera = Camera((0.0, 0.0, 500.0), normalized((0.0, 40e3, 900.0)), math.radians(9.0))
    world = planet_scene(camera, math.radians(35.0), 8)
    both = replace(world, volumes=(cloud, *world.volumes))
    veiled = assert_cycles_equals_path_tracing(both, 12, 48)
    clear = path_tracing.render(replace(both, volumes=(cloud,)), 12, 12, repeats=1, strata=4, samples=192, seed=3).image
    sky = path_tracing.render(world, 12, 12, repeats=1, strata=4, samples=64, seed=3).image
    body = clear.mean(axis=2) > 0.3 * clear.max()
    contrast = (veiled - sky)[body].mean(axis=0) / clear[body].mean(axis=0)
    # The air before the cloud lets so much through; what it hides behind and the dimmer sun take more. Blue is lost before red.
    ahead = np.exp(-optics.optical_depth(world, np.array([camera.position]), np.array([camera.direction]), 36e3))[0]
    assert (0.0 < contrast).all() and (contrast < ahead).all() and contrast[2] < contrast[1] < contrast[0]


def test_a_silver_lining():
    """Against the sun the rim of a cloud is brighter than its middle; with the sun behind the camera it is not."""
    rims = []
    for azimuth in (8.0, 180.0):
        chosen = load("cumulus").changed({"resolution": 48}, {"sun_azimuth": azimuth, "sun_elevation": 22.0,
                                                             "environment_radiance": 0.0, "orders": 96})
        scene = replace(verify.scene_of(chosen), surfaces=())
        image = path_tracing.render(scene, 48, 36, repeats=1, strata=4, samples=64, seed=2).image.mean(axis=2)
        lit = image > 0.0
        inner = lit.copy()
        for axis in (0, 1):
            for shift in (-4, 4):
                inner &= np.roll(lit, shift, axis)
        rims.append(image[lit & ~inner].mean() / image[inner].mean())
    against, along = rims
    assert against > 1.5 > along
