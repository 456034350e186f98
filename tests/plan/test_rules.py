# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on Scenes, without Blender."""

import math

import pytest

from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.plan.rules import participation, plan
from volumetrics_addon.scene import assemble


def made(name, engine, samples=8, *, stage=None, **options):
    scene = scene_of(name, **(stage or {}))
    preset = load(name)
    return plan(scene, [assemble.body(preset.family, preset.parameters, scene.volumes)], engine, samples, **options)


def scene_of(name, **stage):
    preset = load(name)
    return assemble.scene(preset.family, preset.parameters, {**preset.stage, **stage}, preset.props)


def rules(planned):
    return {decision.rule for decision in planned.decisions}


def test_homogeneous_media_stay_analytic():
    slats = made("theatre-slats", "cycles")
    assert slats.volume_settings == [{"homogeneous_volume": True, "volume_sampling": "EQUIANGULAR", "volume_step_rate": 1.0}]
    assert "analytic path" in rules(slats)
    assert not made("cumulus", "cycles").volume_settings[0]["homogeneous_volume"]


@pytest.mark.parametrize("orders", [1, 2, 40])
def test_bounces_follow_the_orders(orders):
    settings = made("cumulus", "cycles", stage={"orders": orders}).settings
    assert settings["cycles.volume_bounces"] == settings["cycles.max_bounces"] == orders - 1


def test_glass_bounces_only_where_something_refracts():
    assert made("emerald-sphere", "cycles").settings["cycles.transmission_bounces"] >= 32
    assert made("tea-glass", "cycles").settings["cycles.transmission_bounces"] == 0


def test_marching_steps_resolve_the_scale_height():
    scene = scene_of("morning-valley")
    marched = made("morning-valley", "cycles", has_null_scattering=False)
    half = scene.volumes[0].domain.half
    step = 0.1 * (2 * sum(half) / 3) * marched.volume_settings[0]["volume_step_rate"]
    assert step <= 0.31 * scene.volumes[0].medium.density.scale_height
    assert "ray marching" in rules(marched)
    assert made("morning-valley", "cycles").settings["cycles.volume_biased"] is True
    assert "ray marching" not in rules(made("theatre-slats", "cycles"))


def test_nothing_is_left_to_a_default_that_changes_the_image():
    for name in names():
        settings = made(name, "cycles").settings
        for path in ("sample_clamp_direct", "sample_clamp_indirect", "light_sampling_threshold", "blur_glossy"):
            assert settings[f"cycles.{path}"] == 0.0
        assert settings["cycles.use_denoising"] is False and settings["cycles.use_adaptive_sampling"] is False


def test_light_enclosure_only_where_a_light_stands_in_the_scene():
    assert made("theatre-slats", "eevee").light_enclosure
    assert not made("morning-valley", "eevee").light_enclosure
    assert not made("tea-glass", "eevee").light_enclosure


def test_participation_raises_and_never_lowers():
    scene = scene_of("cumulus")
    wanted = participation(scene, {"cycles.max_bounces": 500, "cycles.volume_bounces": 0, "eevee.light_threshold": 1e-9}.get)
    assert wanted["cycles.max_bounces"] == 500
    assert wanted["cycles.volume_bounces"] == scene.orders - 1
    assert wanted["eevee.light_threshold"] == 1e-9
    assert all(not math.isnan(v) for v in wanted.values() if isinstance(v, float))
