# SPDX-License-Identifier: GPL-3.0-or-later
"""Pilots of a user's scene: the noise they tell, and the threshold that follows from it; the cells and shadows of EEVEE."""

import json
import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
OpenEXR = pytest.importorskip("OpenEXR")

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.blender import compat, files, observe, pilot, render, settings, stage, tuning  # noqa: E402
from volumetrics_addon.cli.main import OK, USAGE, WORSE, main  # noqa: E402
from volumetrics_addon.plan.catalogue import RULES  # noqa: E402
from volumetrics_addon.plan.observed import Cells  # noqa: E402
from volumetrics_addon.plan.tuning import Advice, Change  # noqa: E402

WIDTH, HEIGHT, SAMPLES = 64, 48, 256
KEPT = ("cycles.samples", "cycles.use_adaptive_sampling", "cycles.adaptive_threshold", "cycles.use_denoising", "cycles.use_light_tree",
        "render.resolution_x", "render.resolution_y", "render.use_compositing", "render.use_persistent_data", "render.filepath")


@pytest.fixture
def spot():
    """A beam that is noisy, and a dark around it that is not."""
    scene = usual.by_name("spot-haze").build()
    scene.render.engine, scene.frame_end = "CYCLES", 1
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = WIDTH, HEIGHT, SAMPLES
    yield scene
    bpy.ops.wm.read_factory_settings()


def pictures(scene, count, samples, adaptive):
    with stage.of_scene(scene, "cycles", changes={"cycles.use_adaptive_sampling": adaptive}) as on:
        return np.stack([on.shoot(WIDTH, HEIGHT, samples, 70 + index) for index in range(count)])


def noise(made):
    return math.sqrt(made.var(axis=0, ddof=1).mean()) / made.mean()


@pytest.mark.either
def test_a_pilot_tells_the_noise_of_a_picture_of_more_pixels_and_samples(spot):
    scene = usual.by_name("cathedral").build()
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "CYCLES", WIDTH, HEIGHT
    found = pilot.measure(scene, 300, 32)
    made = pictures(scene, 4, 128, False)
    assert 3.0 * math.sqrt(found.variance / 128) / found.brightness == pytest.approx(noise(made), rel=0.3)  # which falls a little faster
    assert found.brightness == pytest.approx(made.sum(axis=-1).mean(), rel=0.05)
    scene.cycles.samples, scene.frame_end = SAMPLES, 1
    assert tuning.NOISE_RULE not in {advice.rule.name for advice in tuning.plan(scene, pilot=True)}  # as noisy all over


def test_pieces_of_a_picture_have_their_own_noise():
    """Two pictures of 9 samples, 8 x 8 pixels: on the left the samples sum to 18 and 0, so 81 x 2 over 9 x 3 for one; the right is dark."""
    sums = np.zeros((2, 8, 8, 3))
    sums[0, :, :4] = 18.0
    assert pilot._pieces(sums) == pytest.approx((81.0 * 2.0 / (9.0 * 3.0), 0.0) * 2)


def test_a_pilot_is_rendered_where_it_pays(spot):
    """Two pictures of 256 pixels of 16 samples at least, a 64th of the paths of 256 samples at most; 4096 pixels of 64 samples at most."""
    size = lambda **asked: pilot.size(observe.scene(spot, survey=False, **asked))  # noqa: E731
    assert size(samples=256, pixels=2048) == (256, 16) and size(samples=256, pixels=2047) is None
    assert size(samples=4096, pixels=4096) == (256, 32) and size(samples=256, pixels=16384) == (512, 64)
    assert size() == (256, 3072 * 256 // 128 // 256) and size(samples=4096, pixels=2e6) == (4096, 64)
    spot.cycles.use_adaptive_sampling = False
    assert size() is None
    cloud = usual.by_name("noise-cube").build()
    cloud.render.engine = "CYCLES"
    large = observe.scene(cloud, survey=False, pixels=1e6)
    assert pilot.size(large, marched=True) and bool(pilot.size(large)) != large.null_scattering  # which has octrees


def test_planning_with_a_pilot_changes_nothing_and_raises_the_threshold(spot):
    before = {path: settings.get(spot, path) for path in KEPT}
    assert tuning.NOISE_RULE not in {found.rule.name for found in tuning.plan(spot)}
    advice = tuning.plan(spot, pilot=True)
    assert {path: settings.get(spot, path) for path in KEPT} == before and not tuning.is_applied(spot)
    assert tuning.NOISE_RULE not in {found.rule.name for found in tuning.plan(spot, without=(tuning.NOISE_RULE,), pilot=True)}
    tuning.apply(spot, advice)
    assert 0.0105 < spot.cycles.adaptive_threshold < 0.2
    again = {found.rule.name: found for found in tuning.plan(spot, pilot=True)}  # of what is applied: the threshold is there
    assert tuning.is_applied(spot) and tuning.NOISE_RULE not in again
    tuning.restore(spot)
    assert {path: settings.get(spot, path) for path in KEPT} == before


def counted(scene, folder):
    """The share of their samples that the pixels take on average, by the pass that Cycles has for it."""
    scene.cycles.use_denoising, scene.render.use_persistent_data = False, False
    scene.view_layers[0].cycles.pass_debug_sample_count = True
    image = scene.render.image_settings
    if hasattr(image, "media_type"):  # Blender 5
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.filepath = str(folder / "counted.exr")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with OpenEXR.File(scene.render.filepath, separate_channels=True) as file:
        channels = {name: channel for part in file.parts for name, channel in part.channels.items()}
        return float(next(channel.pixels for name, channel in channels.items() if "Sample Count" in name).mean())


@pytest.mark.either
def test_a_threshold_takes_samples_and_little_else(spot, tmp_path):
    """Fewer samples on average, counted by the engine; at most a fifth more noise, and the mean as it was."""
    advice = [found for found in tuning.plan(spot, pilot=True) if found.rule.name == tuning.NOISE_RULE]
    own, share = pictures(spot, 12, SAMPLES, True), counted(spot, tmp_path)
    tuning.apply(spot, advice)
    planned = pictures(spot, 12, SAMPLES, True)
    assert counted(spot, tmp_path) < 0.85 * share
    assert noise(planned) < 1.2 * 1.2 * noise(own)  # 1.2: twelve pictures tell a noise to within that
    means = [made.mean(axis=(1, 2, 3)) for made in (own, planned)]
    spread = math.sqrt(sum(mean.var(ddof=1) for mean in means) / 12)
    assert abs(means[1].mean() - means[0].mean()) < 3.0 * spread < 0.02 * own.mean()


def test_a_command_line_render_with_a_plan_has_a_pilot(spot, tmp_path, capsys):
    path, out = tmp_path / "lit.blend", tmp_path / "x.exr"
    files.save(path)
    capsys.readouterr()
    assert main(["plan", str(path), "--pilot", "--json"]) == OK
    rules = {rule["rule"]: rule for rule in json.loads(capsys.readouterr().out)["rules"]}
    assert rules[tuning.NOISE_RULE]["changes"][0]["path"] == "cycles.adaptive_threshold"
    assert main(["plan", str(path), "--json"]) == OK
    assert tuning.NOISE_RULE not in {rule["rule"] for rule in json.loads(capsys.readouterr().out)["rules"]}
    assert main(["render", str(path), "--plan", "--out", str(out), "--json"]) == OK
    assert tuning.NOISE_RULE in {decision["rule"] for decision in json.loads(capsys.readouterr().out)["decisions"]}
    assert main(["render", str(path), "--plan", "--samples", "8", "--out", str(out), "--json"]) == OK
    assert tuning.NOISE_RULE not in {decision["rule"] for decision in json.loads(capsys.readouterr().out)["decisions"]}
    assert main(["plan", "cumulus", "--pilot"]) == USAGE
    assert "--pilot is not allowed with a preset" in capsys.readouterr().err


def test_a_picture_of_a_file_keeps_its_adaptive_sampling(spot):
    with stage.of_scene(spot, "cycles", rounds=False) as on:
        assert spot.cycles.use_adaptive_sampling and not spot.cycles.use_denoising
        assert "adaptive sampling off" not in {decision.effect for decision in on.decisions}
    assert spot.cycles.use_denoising


# --- EEVEE --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def street():
    """Six lamps in fog, in EEVEE."""
    scene = usual.by_name("foggy-street").build()
    scene.render.engine, scene.frame_end = compat.current().eevee, 1
    scene.render.resolution_x, scene.render.resolution_y = 96, 54
    yield scene
    bpy.ops.wm.read_factory_settings()


def advised(**values):
    """Advice that changes these of EEVEE's settings."""
    return [Advice(RULES["froxels"], tuple(Change("scenes", "", f"eevee.{name}", value) for name, value in values.items()), "", 0.0)]


@pytest.mark.either
def test_eevee_says_when_shadows_have_no_memory(street, tmp_path, capsys):
    """A pool of 16 MB has 64 pages of 256 x 256 depths."""
    with stage.of_scene(street, "eevee") as on:
        on.shoot(32, 18, 1)
        assert on.heard and on.missing_shadows == ""
    street.eevee.shadow_pool_size, street.eevee.volumetric_tile_size = "16", "1"
    with stage.of_scene(street, "eevee") as on:
        on.shoot(96, 54, 1)
        assert on.shadow_pages[0] > on.shadow_pages[1] == 64 and "memory for 64 of" in on.missing_shadows
    path, out = tmp_path / "street.blend", tmp_path / "x.exr"
    files.save(path)
    capsys.readouterr()
    for asked, code in ((["--samples", "1"], OK), (["--error", "90%", "--max-samples", "4"], WORSE)):  # one picture tells no error
        assert main(["render", str(path), "--size", "96", "--out", str(out), "--json", *asked]) == code
        notes = json.loads(capsys.readouterr().out)["notes"]
        assert any("memory for 64 of" in note for note in notes)
        assert any("bias is not in this error: finer cells have no memory" in note for note in notes) == (code == WORSE)


@pytest.mark.either
def test_a_pilot_of_eevee_tells_its_cells_and_noise(street):
    """The error of the cells rather too little and the noise rather too much, against pictures of more samples; nothing where shadows
    do not fit. Every value is back."""
    kept = ("eevee.volumetric_tile_size", "eevee.volumetric_samples", "eevee.shadow_pool_size", "eevee.taa_render_samples",
            "render.resolution_x", "render.resolution_y")
    before = {path: settings.get(street, path) for path in kept}
    assert pilot.cells(street, 64 * 36, advised(volumetric_tile_size="1", shadow_pool_size="16")) is None
    for one in [one for one in street.objects if one.type == "LIGHT"][3:]:  # each takes as long as a picture otherwise does
        bpy.data.objects.remove(one)
    found = pilot.cells(street, 64 * 36, advised(volumetric_tile_size="2", volumetric_samples=128))
    assert {path: settings.get(street, path) for path in kept} == before
    with stage.of_scene(street, "eevee") as on:
        own = on.shoot(64, 36, 16)
    with stage.of_scene(street, "eevee", changes={"eevee.volumetric_tile_size": "2", "eevee.volumetric_samples": 128}) as on:
        few, many = (on.shoot(64, 36, samples) for samples in (8, 16))
    error, noise_of_eight = (float(np.sqrt(np.mean((made - many) ** 2)) / many.mean()) for made in (own, few))
    assert 0.3 * error < found.error < error
    assert noise_of_eight < found.noise / math.sqrt(8) < 4.0 * noise_of_eight


def test_a_plan_of_eevee_has_a_pilot_where_something_follows(street, monkeypatch):
    asked = []
    monkeypatch.setattr(tuning.pilots, "cells", lambda scene, pixels, advice: asked.append(pixels) or Cells(0.1, 0.1, 1.0, 4.0))
    froxels = lambda **given: {change.path: change.value for found in tuning.plan(street, **given) if found.rule.name == "froxels"  # noqa: E731
                               for change in found.changes}
    assert froxels(pixels=96 * 54) == froxels(pixels=96 * 54, pilot=True) != {} and asked == []
    assert froxels(pixels=1920 * 1080) == {} and asked == []
    assert froxels(pixels=1920 * 1080, pilot=True)["eevee.shadow_pool_size"] == "1024" and asked == [1920 * 1080]
    assert froxels(pixels=1920 * 1080, pilot=True, again=False) and len(asked) == 1
    assert froxels(pixels=1600 * 900, pilot=True, again=False) and len(asked) == 2
    street.camera.keyframe_insert("location", frame=1)  # a camera that moves sees other shadows later
    street.camera.location.x += 1.0
    street.camera.keyframe_insert("location", frame=20)
    assert froxels(pixels=1920 * 1080, pilot=True) == {} and len(asked) == 2
