# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on Scenes, without Blender."""

import math

import pytest

from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.plan.rules import participation, plan
from volumetrics_addon.scene import assemble


def scene_of(name, **stage):
    preset = load(name)
    return assemble.scene(preset.family, preset.parameters, {**preset.stage, **stage}, preset.props)


def rules(made):
    return {decision.rule for decision in made.decisions}


def test_homogeneous_media_stay_analytic():
    made = plan(scene_of("theatre-slats"), "cycles", 8)
    assert made.volume_settings == [{"homogeneous_volume": True, "volume_sampling": "EQUIANGULAR", "volume_step_rate": 1.0}]
    assert "analytic path" in rules(made)
    assert not plan(scene_of("cumulus"), "cycles", 8).volume_settings[0]["homogeneous_volume"]


@pytest.mark.parametrize("orders", [1, 2, 40])
def test_bounces_follow_the_orders(orders):
    settings = plan(scene_of("cumulus", orders=orders), "cycles", 8).settings
    assert settings["cycles.volume_bounces"] == settings["cycles.max_bounces"] == orders - 1


def test_glass_bounces_only_where_something_refracts():
    assert plan(scene_of("emerald-sphere"), "cycles", 8).settings["cycles.transmission_bounces"] >= 32
    assert plan(scene_of("tea-glass"), "cycles", 8).settings["cycles.transmission_bounces"] == 0


def test_marching_steps_resolve_the_scale_height():
    scene = scene_of("morning-valley")
    made = plan(scene, "cycles", 8, has_null_scattering=False)
    half = scene.volumes[0].domain.half
    step = 0.1 * (2 * sum(half) / 3) * made.volume_settings[0]["volume_step_rate"]
    assert step <= 0.31 * scene.volumes[0].medium.density.scale_height
    assert "ray marching" in rules(made)
    assert plan(scene, "cycles", 8).settings["cycles.volume_biased"] is True
    assert "ray marching" not in rules(plan(scene_of("theatre-slats"), "cycles", 8))


def test_nothing_is_left_to_a_default_that_changes_the_image():
    for name in names():
        settings = plan(scene_of(name), "cycles", 8).settings
        for path in ("sample_clamp_direct", "sample_clamp_indirect", "light_sampling_threshold", "blur_glossy"):
            assert settings[f"cycles.{path}"] == 0.0
        assert settings["cycles.use_denoising"] is False and settings["cycles.use_adaptive_sampling"] is False


def test_light_enclosure_only_where_a_light_stands_in_the_scene():
    assert plan(scene_of("theatre-slats"), "eevee", 8).light_enclosure
    assert not plan(scene_of("morning-valley"), "eevee", 8).light_enclosure
    assert not plan(scene_of("tea-glass"), "eevee", 8).light_enclosure


def test_participation_raises_and_never_lowers():
    scene = scene_of("cumulus")
    wanted = participation(scene, {"cycles.max_bounces": 500, "cycles.volume_bounces": 0, "eevee.light_threshold": 1e-9}.get)
    assert wanted["cycles.max_bounces"] == 500
    assert wanted["cycles.volume_bounces"] == scene.orders - 1
    assert wanted["eevee.light_threshold"] == 1e-9
    assert all(not math.isnan(v) for v in wanted.values() if isinstance(v, float))
