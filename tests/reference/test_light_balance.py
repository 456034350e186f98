# SPDX-License-Identifier: GPL-3.0-or-later
"""Shares of light by closed forms: slabs, white furnaces, and the frustum by its picture."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expn

from volumetrics_addon.reference import light_balance, optics
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Dust, ExponentialAltitude, Medium, NoiseShape, Phase, Point, Scene, Sun, Surface, Volume,
)

FLOOR = Surface(Box((0.0, 0.0, 0.0), (1e4, 1e4, 0.0)), (0.5, 0.4, 0.3))
SLAB = Box((0.0, 0.0, 2.0), (1e4, 1e4, 1.0))  # from 1 m to 3 m
ABOVE = Camera((0.0, 0.0, 30.0), (0.0, 0.2, -1.0), math.radians(30.0))
SUN = Sun((0.0, 0.6, -0.8), (1.0, 0.5, 0.25))


def scene(medium, lights=(SUN,), orders=1, environment=(0.0, 0.0, 0.0), camera=ABOVE, domain=SLAB):
    return Scene(camera, tuple(lights), environment, (Volume(domain, medium),), (FLOOR,), orders)


def test_a_sun_through_a_slab_by_beer_and_lambert():
    sigma = (0.1, 0.4, 1.6)
    found = light_balance.balance(scene(Medium((0.0,) * 3, sigma)))
    assert found.surfaces[0] == pytest.approx([math.exp(-s * 2.0 / 0.8) for s in sigma], rel=1e-9)
    assert found.media[0] == (1.0, 1.0, 1.0)  # nothing scatters


def test_a_lamp_far_above_the_slab_is_a_sun():
    found = light_balance.balance(scene(Medium((0.0,) * 3, (0.3,) * 3), [Point((0.0, 0.0, 1e7), (1.0,) * 3)]))
    assert found.surfaces[0] == pytest.approx([math.exp(-0.6)] * 3, rel=1e-4)


@pytest.mark.parametrize("depth", [0.2, 1.0, 3.0])
def test_the_sky_through_a_slab_by_the_exponential_integral(depth):
    """Diffuse transmittance 2 E3(tau); 1024 pixels of 16 directions each."""
    found = light_balance.balance(scene(Medium((0.0,) * 3, (depth / 2.0,) * 3), (), environment=(1.0, 1.0, 1.0)))
    assert found.sky == pytest.approx([2.0 * expn(3, depth)] * 3, rel=0.02)


def test_many_orders_in_a_white_furnace_show_the_engine_s_own_sky():
    """Where nothing absorbs, all of a uniform sky's light arrives: as if it were neither dimmed nor shadowed."""
    white = replace(scene(Medium((0.4,) * 3, (0.0,) * 3), (), 64, (1.0, 1.0, 1.0)), surfaces=(replace(FLOOR, albedo=(1.0,) * 3),))
    assert light_balance.balance(white).sky == pytest.approx([1.0] * 3, abs=0.01)


def test_many_orders_bring_light_to_floor_and_haze():
    """Light that was scattered on its way arrives too: more than the first order alone, less than without the haze."""
    medium = Medium((0.2,) * 3, (0.1,) * 3, Phase(0.3))
    once = light_balance.balance(scene(medium, [Point((2.0, 3.0, 6.0), (50.0,) * 3)]))
    shown = scene(medium, [Point((2.0, 3.0, 6.0), (50.0,) * 3)], orders=2)
    twice = light_balance.balance(shown)
    assert once.surfaces[0][0] < twice.surfaces[0][0] < 1.0
    assert once.media[0][0] == 1.0 < twice.media[0][0]


def test_a_sun_s_way_in_the_frustum_is_what_the_picture_shows_of_it():
    """Points along the way, counted where they fall into the picture."""
    camera, aspect, height = Camera((1.0, -8.0, 2.0), (0.1, 1.0, -0.1), math.radians(50.0)), 1.5, 100
    medium = scene(Medium((0.1,) * 3, (0.0,) * 3), camera=camera, domain=Box((0.0, 0.0, 5.0), (40.0, 40.0, 5.0)))
    rng = np.random.default_rng(3)
    origin, direction = geometry.camera_rays(camera, 150, height, *(rng.random((2, 40)) * [[150.0], [100.0]]))
    position = origin + (rng.random((40, 1)) * 20.0 + 1.0) * direction
    position[:, 2] = np.clip(position[:, 2], 0.5, 9.5)
    toward = np.broadcast_to(-np.array(SUN.direction), position.shape)
    step = 1e-3
    depth = np.zeros(len(position))
    for t in np.arange(0.0, 20.0, step) + step / 2.0:
        at = position + t * toward
        x, y = geometry.raster(camera, 150, height, at - np.array(camera.position))
        ahead = (at - np.array(camera.position)) @ np.array(camera.direction) > 0.0
        inside = ahead & (0.0 < x) & (x < 150.0) & (0.0 < y) & (y < 100.0) & (at[:, 2] < 10.0)
        depth += 0.1 * step * inside
    found = light_balance._frustum_depth(medium, aspect, position, toward)
    assert found[:, 0] == pytest.approx(depth, abs=3e-4)
    assert depth.max() > 0.1


def test_sun_in_media_has_a_share_only_where_its_way_leaves_the_picture():
    medium = Medium((0.2,) * 3, (0.0,) * 3)
    assert light_balance.balance(scene(medium)).media[0] == pytest.approx([1.0] * 3, abs=0.05)
    within = Camera((0.0, 0.0, 2.0), (0.0, 1.0, 0.0), math.radians(20.0))
    assert max(light_balance.balance(scene(medium, camera=within)).media[0]) < 0.95
    lamp = [Point((0.0, 5.0, 2.9), (1.0,) * 3)]
    assert light_balance.balance(scene(medium, lamp, camera=within)).media[0] == (1.0, 1.0, 1.0)


def test_dust_has_its_mean_and_noise_is_voxels():
    even = light_balance.balance(scene(Medium((0.1,) * 3, (0.1,) * 3)))
    dusty = light_balance.balance(scene(Medium((0.1,) * 3, (0.1,) * 3, density=Dust(0.8, 2.0))))
    assert dusty.surfaces == even.surfaces
    shape = NoiseShape((0.0, 0.0, 2.0), (8.0, 8.0, 1.5), 2.0, 2.0, 0.5, 0.5, 0.8, 0.2, 1)
    cloudy = light_balance.balance(scene(Medium((0.5,) * 3, (0.0,) * 3, density=shape), domain=Box(shape.center, shape.half)))
    assert 0.1 < cloudy.surfaces[0][0] < 1.0


def test_what_is_refused_says_why():
    empty = scene(Medium((0.0,) * 3, (0.0,) * 3))
    assert "nothing dims" in light_balance.applies(empty)
    air = scene(Medium((1e-5,) * 3, (0.0,) * 3, density=ExponentialAltitude((0.0, 0.0, -1e5), 1e5, 1e3)))
    with pytest.raises(ValueError, match="planet"):
        light_balance.balance(air)


def test_nothing_lit_has_nothing_taken_off():
    dark = light_balance.balance(scene(Medium((0.1,) * 3, (0.0,) * 3), [Sun((0.0, 0.0, 1.0), (1.0,) * 3)]))
    assert dark.surfaces[0] == (1.0, 1.0, 1.0)  # the sun shines from below


def test_mean_depth_is_that_of_the_haze():
    volume = Volume(SLAB, Medium((0.1,) * 3, (0.0,) * 3, density=Dust(0.5, 1.0)))
    down = np.array([[0.0, 0.0, 10.0]]), np.array([[0.0, 0.0, -1.0]])
    assert optics.mean_depth(volume, *down, 8.0) == pytest.approx([1.0])
    assert optics.mean_depth(volume, *down, 50.0) == pytest.approx([2.0])
