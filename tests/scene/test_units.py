# SPDX-License-Identifier: GPL-3.0-or-later
"""Another unit of length is another set of numbers for the same picture."""

import math

import numpy as np
import pytest

from volumetrics_addon.bench.scenes import SCENES, by_name
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.parameters.stage import PROP, STAGE
from volumetrics_addon.reference import select
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.model import Camera, Projector, Scene
from volumetrics_addon.scene.units import DIMENSIONS, scaled, scaled_body


def scene_of(preset):
    return assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)


@pytest.mark.parametrize("name", ["street-lamp", "spot-gobo", "valley-fog", "sky-sunset", "glass"])
def test_integrators_see_the_same_picture(name):
    """A power of two scales every float exactly; what is left is the integrators' own rounding."""
    scene = by_name(name).make()
    module = select.integrator(scene)
    options = {"resolution": 6, "orders": 2, "order": 8} if module.__name__.endswith("sky_tables") else {}
    here, there = (module.render(s, 6, 6, repeats=1, strata=0, **options).image for s in (scene, scaled(scene, 2.0**-10)))
    np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-9 * here.max())


@pytest.mark.parametrize("bench", SCENES, ids=lambda bench: bench.name)
def test_there_and_back(bench):
    scene = bench.make()
    assert scaled(scaled(scene, 2.0**-10), 2.0**10) == scene


@pytest.mark.parametrize("name", names())
def test_a_body_is_scaled_as_its_volumes(name):
    """Scaled values, assembled, are the scaled volumes."""
    preset = load(name)
    scene = scene_of(preset)
    bodies = [scaled_body(body, 0.5) for body in assemble.bodies(preset.family, preset.parameters, scene.volumes)]
    volumes = tuple(volume for body in bodies for volume in body.volumes)
    assert volumes == scaled(scene, 0.5).volumes
    body = bodies[0]
    assert [p.name for p in body.family.parameters] == [p.name for p in preset.group.parameters]
    assert body.family.check(body.values) == body.values  # within limits that were scaled too
    if preset.family != "fog":  # which is fitted to bounds
        again = assemble.ASSEMBLERS[preset.family](body.values).volumes
        for mine, other in zip(again, volumes, strict=True):
            assert mine.medium.sigma_t == pytest.approx(other.medium.sigma_t, rel=1e-12)
            assert mine.medium.density == other.medium.density


def test_every_declared_unit_of_a_family_has_a_dimension():
    units = {p.unit for group in FAMILIES.values() for p in group.parameters}
    assert units <= set(DIMENSIONS) and len(units) >= 5
    assert STAGE and PROP  # their values are in the Scene


def test_a_projector_keeps_its_light():
    light = Projector((0, 0, 4), (0, 0, -1), (0, 1, 0), (8.0, 8.0, 8.0), 1.0, 1.0, near=1.0, far=6.0, falloff=1)
    moved, = scaled(Scene(Camera((0, -1, 0), (0, 1, 0), 1.0), (light,)), 0.5).lights
    assert moved.power == (4.0, 4.0, 4.0) and (moved.near, moved.far) == (0.5, 3.0) and moved.position == (0, 0, 2)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.inf, math.nan])
def test_a_factor_that_is_none(factor):
    with pytest.raises(ValueError, match="must be > 0 and finite"):
        scaled(Scene(Camera((0, -1, 0), (0, 1, 0), 1.0)), factor)
