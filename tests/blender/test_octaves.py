# SPDX-License-Identifier: GPL-3.0-or-later
"""Octaves in Cycles' nodes, against their definition summed path by path."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import render  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402
from volumetrics_addon.plan.rules import plan  # noqa: E402
from volumetrics_addon.scene import assemble  # noqa: E402

G, EXTINCTION, ALBEDO, SUN = 0.4, 1.5, 0.9, 3.0
OCTAVES = {"scattering": "octaves", "octaves": 3, "octave_extinction": 0.5, "octave_phase": 0.3, "octave_contribution": 0.4}


def preset(parameters, orders):
    values = FAMILIES["cloud"].check({"location": [0, 0, 0], "size": [2, 2, 2], "domain": "box", "density": "homogeneous",
                                      "phase": "hg", "g": G, "extinction": EXTINCTION, "albedo": [ALBEDO] * 3, **parameters})
    stage = STAGE.check({"camera_location": [0, -9, 0], "camera_target": [0, 0, 0], "field_of_view": 1.0, "orders": orders,
                         "sun_irradiance": SUN, "sun_azimuth": 90.0, "sun_elevation": 30.0, "environment_radiance": 0.5})
    return Preset("test", "cloud", "Test", "", values, stage, ())


def cycles(parameters, orders, samples):
    chosen = preset(parameters, orders)
    images = render.render(chosen, verify.scene_of(chosen), "cycles", 8, 8, samples, repeats=4).images
    means = images.mean(axis=(1, 2, 3))
    return means.mean(), means.std(ddof=1) / 2.0


def hg(c, g):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * c) ** 1.5)


def box_exit(p, d):
    return np.min((np.sign(d) - p) / d, axis=1)


def literal(octaves, extinction, phase, contribution, count=1_500_000):
    """Radiance along the axis by paths of uniform directions and distances, each event's octave as it is defined."""
    rng = np.random.default_rng(0)
    toward_sun = -np.array(assemble.sun_direction(math.radians(30.0), math.radians(90.0)))
    p, d = np.tile((1e-9, -1.0, 1e-9), (count, 1)), np.tile((1e-9, 1.0, 1e-9), (count, 1))
    total, weight = np.zeros(count), np.ones(count)
    environment = 0.5
    for event in range(1, octaves + 1):
        octave = max(event - 2, 0)  # of the ray that left event - 1
        sigma_t, sigma_s = EXTINCTION * extinction**octave, EXTINCTION * ALBEDO * contribution**octave
        length = box_exit(p, d)
        t = rng.random(count) * length
        weight = weight * length * np.exp(-sigma_t * t) * sigma_s
        p = p + t[:, None] * d
        leaving = EXTINCTION * extinction ** (event - 1)
        g = G * phase**octave
        light = SUN * hg(d @ toward_sun, g) * np.exp(-leaving * box_exit(p, np.tile(toward_sun, (count, 1))))
        total += weight * light
        z, angle = rng.uniform(-1, 1, count), rng.uniform(0, 2 * np.pi, count)
        new = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)
        weight = weight * 4 * np.pi * hg(np.einsum("ni,ni->n", d, new), g)
        d = new
        total += weight * environment * np.exp(-leaving * box_exit(p, d))
    total += environment * np.exp(-EXTINCTION * 2.0)
    return total.mean(), total.std() / math.sqrt(count)


@pytest.mark.either
def test_octaves_equal_their_definition():
    expected, doubt = literal(3, 0.5, 0.3, 0.4)
    value, spread = cycles(OCTAVES, 50, 4096)
    assert abs(value - expected) < 4.0 * math.hypot(doubt, spread)
    assert math.hypot(doubt, spread) < 3e-3 * expected
    full, _ = cycles({}, 50, 1024)
    assert abs(full - expected) > 0.03 * expected  # the octaves do something


def test_one_octave_is_single_scattering():
    single, _ = cycles({}, 1, 256)
    octave, _ = cycles(OCTAVES | {"octaves": 1}, 50, 256)
    assert octave == pytest.approx(single, rel=1e-5)  # the same random numbers


def test_the_plan_follows_the_octaves():
    chosen = preset(OCTAVES, 50)
    scene = verify.scene_of(chosen)
    made = plan(scene, [assemble.body("cloud", chosen.parameters, scene.volumes)], "cycles", 4)
    assert made.settings["cycles.volume_bounces"] == 2 and "octaves" in [decision.rule for decision in made.decisions]
    beside = replace(scene, volumes=(*scene.volumes, replace(scene.volumes[0], octaves=None)))
    bodies = [assemble.body("cloud", chosen.parameters, (volume,)) for volume in beside.volumes]
    assert plan(beside, bodies, "cycles", 4).settings["cycles.volume_bounces"] == 49


def test_more_contribution_than_extinction_is_refused():
    with pytest.raises(ValueError, match="octave_contribution must be <= octave_extinction, got 0.9 > 0.5"):
        verify.scene_of(preset(OCTAVES | {"octave_contribution": 0.9}, 8))
