# SPDX-License-Identifier: GPL-3.0-or-later
"""Air by depth against the scattering tables and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.parameters.preset import load
from volumetrics_addon.physics.atmosphere import TransmittanceTable, UniformScattering
from volumetrics_addon.reference import depth_air, planet, sky_tables
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.model import Box, Surface


def scene_of(name, **changes):
    preset = load(name).changed({}, changes)
    return assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)


@pytest.mark.parametrize("name, mean, spread", (("clear-noon", 0.02, 0.03), ("clear-sunset", 0.05, 0.08)))
def test_sky_against_the_tables(name, mean, spread):
    """The error that the module states, at most."""
    scene = scene_of(name)
    exact = sky_tables.render(scene, 16, 10, strata=0).image
    error = depth_air.render(scene, 16, 10, repeats=2, strata=0).image - exact
    assert abs(error.mean()) < mean * exact.mean()
    assert math.sqrt((error**2).mean()) < spread * exact.mean()


def test_single_scattering_converges_with_the_slices():
    scene = scene_of("clear-noon", orders=1)
    exact = sky_tables.render(scene, 12, 8, strata=0, orders=1).image[:4]  # the sky: the ground here is lit by a sky too
    errors = []
    for slices in (4, 16, 64):
        error = depth_air.render(scene, 12, 8, repeats=2, strata=0, slices=slices).image[:4] - exact
        errors.append(math.sqrt((error**2).mean()) / exact.mean())
    assert errors[0] > 2.5 * errors[1] and errors[1] > errors[2] and errors[2] < 0.006


def test_the_closure_is_fitted():
    view = planet.planet_of(scene_of("clear-noon"))
    closure = depth_air.closure_of(view.planet, 8, 0.5)
    table = UniformScattering(view.planet, 8, TransmittanceTable(view.planet))
    for altitude in (0.0, 1500.0, 6000.0, 15000.0):
        mu_s = np.linspace(0.02, 1.0, 25)
        expected = table(np.full(25, view.planet.radius + altitude), mu_s)
        assert closure(np.full(25, altitude), mu_s) == pytest.approx(expected, abs=0.06 * expected.max())


def test_a_wall_fades_with_distance():
    """A black wall along the level: its picture is what the air before it scatters, and grows as 1 - T of a level way."""
    scene = scene_of("clear-noon", orders=1)
    camera = replace(scene.camera, direction=(0.0, 1.0, 0.0), field_of_view=0.001)
    seen = []
    for distance in (1e3, 1e4, 5e4):
        wall = Surface(Box((0.0, distance, 0.0), (1e4, 0.0, 1e4)), (0.0, 0.0, 0.0))
        seen.append(depth_air.render(replace(scene, camera=camera, surfaces=(*scene.surfaces, wall)), 1, 1, repeats=2, strata=0).image[0, 0])
    sigma = np.sum([v.medium.sigma_t for v in scene.volumes], axis=0)
    grown = -np.expm1(-np.outer((1e4, 5e4), sigma)) / -np.expm1(-1e3 * sigma)
    # Over 50 km the level way rises by 200 m into air thinner by 2 % (molecules) and 15 % (aerosol).
    assert np.array(seen[1:]) / seen[0] == pytest.approx(grown, rel=0.06)


def test_ground_light_is_the_sun_through_the_air_and_the_sky():
    scene = scene_of("clear-noon")
    view = depth_air.view_of(scene)
    bare = depth_air.below_air(scene)
    mu_s = -scene.lights[0].direction[2]
    passed = view.planet.sunlight(view.planet.radius, np.array([mu_s]))[0]
    assert np.array(bare.lights[0].irradiance) == pytest.approx(np.array(scene.lights[0].irradiance) * passed, rel=5e-3)
    assert not bare.volumes and min(bare.environment) > 0.0
    assert bare.environment[2] > 2.0 * bare.environment[0]  # blue


@pytest.mark.parametrize("change, reason", ((dict(sun_elevation=-5.0), "the sun is not above the horizon"),
                                            (dict(environment_radiance=1.0), "the environment shines"),
                                            (dict(sun_irradiance=0.0), "single light")))
def test_what_it_cannot_render(change, reason):
    scene = scene_of("clear-noon", **change)
    assert reason in depth_air.applies(scene)
    with pytest.raises(ValueError, match="choose the volume"):
        depth_air.below_air(scene)
