# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on Scenes, without Blender."""

import math
from dataclasses import replace

import pytest

from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.plan.catalogue import BY_NAME, PRESET_RULES, RULES
from volumetrics_addon.plan.model import ENGINES, Plan
from volumetrics_addon.plan.rules import explain_representation, is_baked, participation, plan, representation_costs
from volumetrics_addon.scene import assemble


def made(name, engine, samples=8, *, stage=None, **options):
    scene = scene_of(name, **(stage or {}))
    preset = load(name)
    return plan(scene, assemble.bodies(preset.family, preset.parameters, scene.volumes), engine, samples, **options)


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


# Processor time of a camera path in microseconds, as nodes and as voxels of 128 along the longest side, and of baking in
# seconds, measured on Blender 5.2 with two cores; a few presets of every kind.
MEASURED = {"cirrus": (5.6, 5.9, 0.55), "congestus": (2441.0, 119.8, 2.2), "cumulus": (1482.4, 79.4, 0.86),
            "ember-smoke": (2.1, 15.7, 0.87), "mist-bank": (9.4, 15.7, 0.11), "storm": (3565.7, 581.8, 1.96),
            "stratus": (66.9, 85.9, 0.1)}


def test_the_estimated_costs_tell_nodes_from_voxels():
    for name, (nodes, voxels, baking) in MEASURED.items():
        volume, = scene_of(name).volumes
        costs = representation_costs(volume, 128)
        ratio = costs["nodes"].path / costs["voxels"].path
        assert 0.35 < ratio / (nodes / voxels) < 2.7, (name, ratio)
        if not 0.6 < nodes / voxels < 1.6:  # else it does not matter
            assert (ratio > 1.0) == (nodes > voxels)
        assert 0.3 < costs["voxels"].once / baking < 2.0


def test_the_representation_follows_the_number_of_paths():
    values = load("dust-cloud").parameters
    volume, = scene_of("dust-cloud").volumes
    assert not is_baked(values, volume, "cycles", 12 * 12 * 4) and is_baked(values, volume, "cycles", 512 * 512 * 64)
    assert is_baked(values, volume, "eevee", 1) and not is_baked(values)
    soft = load("ember-smoke")
    volume, = scene_of("ember-smoke").volumes
    assert not is_baked(soft.parameters, volume, "cycles", 1e9)  # long steps through nodes
    assert is_baked(soft.changed({"representation": "baked"}).parameters, volume, "cycles", 1)
    assert not is_baked(load("cumulus").changed({"representation": "procedural"}).parameters, volume, "cycles", 1e9)


def test_the_plan_says_why_it_takes_nodes():
    volume, = scene_of("ember-smoke").volumes
    told = Plan("cycles", 1)
    explain_representation([volume], load("ember-smoke").parameters, 1e6, told)
    decision, = told.decisions
    assert (decision.rule, decision.effect) == ("representation", "nodes") and "voxels" in decision.reason


def test_a_long_path_through_more_of_a_cloud_costs_more():
    thin, = scene_of("cumulus").volumes
    thick = replace(thin, medium=replace(thin.medium, sigma_s=tuple(4.0 * s for s in thin.medium.sigma_s)))
    for name in ("nodes", "voxels"):
        assert representation_costs(thick, 128)[name].path > representation_costs(thin, 128)[name].path


@pytest.mark.parametrize("engine", ENGINES)
def test_every_decision_is_a_rule_that_is_explained(engine):
    told = {rule for name in names() for rule in rules(made(name, engine))}
    assert told <= set(PRESET_RULES)
    for rule in (*PRESET_RULES.values(), *RULES.values()):
        assert rule.condition and rule.leaves_out and rule.guarantee
        assert set(rule.gain) <= set(rule.engines) and bool(rule.gain) == bool(rule.shown_by)


@pytest.mark.parametrize("rule, name, engine, check", [
    ("ray marching", "morning-valley", "cycles", lambda p: p.settings["cycles.volume_biased"] is False
     and p.volume_settings[0]["volume_step_rate"] == 1.0),
    ("screen tracing", "theatre-slats", "eevee", lambda p: p.settings["eevee.use_raytracing"]),
    ("light enclosure", "theatre-spot", "eevee", lambda p: not p.light_enclosure),
    ("unit of length", "clear-noon", "eevee", lambda p: p.unit == 1.0),
])
def test_rules_are_switched_off_by_name(rule, name, engine, check):
    assert PRESET_RULES[rule].switch == BY_NAME
    assert rule in rules(made(name, engine)) and not check(made(name, engine))
    without = made(name, engine, without=(rule,))
    assert rule not in rules(without) and check(without)


def test_without_null_scattering_there_is_nothing_but_marching():
    made_so = made("morning-valley", "cycles", has_null_scattering=False, without=("ray marching",))
    assert "ray marching" in rules(made_so) and made_so.volume_settings[0]["volume_step_rate"] < 1.0


@pytest.mark.parametrize("name, message", [("speed", "no rule 'speed'"), ("octaves", "use --cloud.scattering full"),
                                           ("analytic path", "would change nothing")])
def test_rules_that_no_name_switches_off(name, message):
    with pytest.raises(ValueError, match=message):
        made("cumulus", "cycles", without=(name,))
