# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders to an error: resumed ones are equal to the last bit, and what is stated holds."""

import math
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.blender import bias, compat, converge, files, identity, render, settings, stage, tuning  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.plan.effort import Pilot  # noqa: E402

LEARNS = bpy.app.version >= (5, 0, 0)
GLASS = load("emerald-sphere")  # noisy, and quick in engine and reference


class Interruption:
    """Progress that ends the render after so many rounds, as Ctrl-C between two of them does."""

    def __init__(self, rounds):
        self.rounds = rounds

    def __call__(self, what, share):
        if what.startswith(f"round {self.rounds},"):
            raise KeyboardInterrupt


def without_bias(monkeypatch):
    monkeypatch.setattr(converge, "_measure_bias", lambda *arguments: None)


@pytest.mark.parametrize("name", ["emerald-sphere", pytest.param("clear-noon", marks=pytest.mark.sweep)])
def test_interrupted_and_resumed_is_the_same_to_the_last_bit(name, tmp_path, monkeypatch):
    """clear-noon is three renders in grey."""
    without_bias(monkeypatch)
    source, file = load(name), tmp_path / ".x.partial.npz"
    wanted = {"error": 1e-6, "round_samples": 2, "most_samples": 12, "seed": 3}
    whole = converge.render(source, "cycles", 6, 5, **wanted)
    assert (whole.rounds, whole.samples, whole.stopped, whole.reached) == (6, 2, "samples", False)
    for rounds in (2, 5):
        with pytest.raises(KeyboardInterrupt, match="goes on from the last of its rounds"):
            converge.render(source, "cycles", 6, 5, **wanted, checkpoint=file, progress=Interruption(rounds))
        assert [path.name for path in tmp_path.iterdir()] == [file.name]
    said = []
    resumed = converge.render(source, "cycles", 6, 5, **wanted, checkpoint=file, say=said.append)
    assert resumed.resumed_rounds == 5 and resumed.rounds == 6 and "going on from" in said[0]
    np.testing.assert_array_equal(resumed.image, whole.image)
    np.testing.assert_array_equal(resumed.standard_error, whole.standard_error)
    assert (resumed.noise, resumed.noise_upper) == (whole.noise, whole.noise_upper)


def test_rounds_are_the_renders_of_consecutive_seeds(monkeypatch):
    without_bias(monkeypatch)
    made = converge.render(GLASS, "cycles", 6, 6, error=1e-6, round_samples=4, most_samples=20, seed=7)
    images = render.render(GLASS, verify.scene_of(GLASS), "cycles", 6, 6, 4, seed=7, repeats=5).images
    np.testing.assert_allclose(made.image, images.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(made.standard_error, images.std(axis=0, ddof=1) / math.sqrt(5), rtol=1e-9, atol=1e-12)


def test_the_schedule_of_a_checkpoint_stands(tmp_path, monkeypatch):
    """The pilot's times do not repeat: a resumed render keeps the samples that were settled."""
    without_bias(monkeypatch)
    file = tmp_path / "x.npz"
    with pytest.raises(KeyboardInterrupt):
        converge.render(GLASS, "cycles", 8, 8, error=0.02, checkpoint=file, progress=Interruption(1), save_seconds=0.0)
    with np.load(file) as stored:
        samples = int(converge.json.loads(str(stored["meta"]))["samples"])
    monkeypatch.setattr(converge, "pilot", lambda *arguments: pytest.fail("measured again"))
    made = converge.render(GLASS, "cycles", 8, 8, error=0.02, checkpoint=file)
    assert made.samples == samples and made.reached and not file.exists()
    assert made.resumed_rounds == 1


def test_a_longer_time_goes_on_where_a_shorter_one_ended(tmp_path, monkeypatch):
    without_bias(monkeypatch)
    file, said = tmp_path / "x.npz", []
    first = converge.render(GLASS, "cycles", 8, 8, error=1e-6, round_samples=4, most_samples=40, checkpoint=file)
    assert first.rounds == 10 and file.exists() and "limit is 40 samples" in first.notes[-1] and first.needed_seconds > first.seconds
    second = converge.render(GLASS, "cycles", 8, 8, error=1e-6, round_samples=4, most_samples=60, checkpoint=file, say=said.append)
    assert second.resumed_rounds == 10 and second.rounds == 15
    assert second.noise == pytest.approx(first.noise * math.sqrt(10 / 15), rel=0.3)


@pytest.mark.either
def test_a_checkpoint_of_another_render_is_not_used(tmp_path, monkeypatch):
    without_bias(monkeypatch)
    file, said = tmp_path / "x.npz", []
    wanted = {"error": 1e-6, "round_samples": 4, "most_samples": 20, "checkpoint": file, "say": said.append}
    converge.render(GLASS, "cycles", 6, 6, **wanted)
    fresh = converge.render(GLASS.changed({"ior": 1.4}), "cycles", 6, 6,
                            **wanted)
    assert fresh.resumed_rounds == 0 and "of another render" in said[-1]
    file.write_bytes(b"torn")
    assert converge.render(GLASS, "cycles", 6, 6, **wanted).resumed_rounds == 0 and "cannot be read" in said[-1]


@pytest.mark.either
def test_the_stated_error_holds_against_a_long_render():
    made = converge.render(GLASS, "cycles", 12, 12, error=0.08)
    truth = render.render(GLASS, verify.scene_of(GLASS), "cycles", 12, 12, 16384, seed=1 << 20).images[0]  # noise below 0.4 %
    error = math.sqrt(np.mean((made.image - truth) ** 2)) / truth.mean()
    assert made.reached and made.stopped == "error" and made.rounds >= 8 and made.upper_bound <= 0.08
    assert 0.5 * made.noise < error < made.upper_bound + 0.004
    assert made.bias.upper < 0.064 and "dielectric" in made.bias.against
    assert made.upper_bound == pytest.approx(math.hypot(made.noise_upper, made.bias.upper))


# --- a user's own scene ------------------------------------------------------------------------------------------------


@pytest.fixture
def scene():
    """A grey floor under a lamp and an emitter, with settings that rounds have to change."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    result = bpy.context.scene
    result.render.engine = "CYCLES"
    for place, rotation in (((0.0, 0.0, 0.0), 0.0), ((0.0, 2.0, 0.0), 1.2)):
        bpy.ops.mesh.primitive_plane_add(size=4.0, location=place, rotation=(rotation, 0.0, 0.0))
    bpy.ops.object.light_add(type="AREA", location=(0.5, -0.5, 1.5))
    bpy.context.object.data.energy, bpy.context.object.data.size = 60.0, 1.0
    bpy.ops.object.camera_add(location=(0.0, -5.0, 3.0), rotation=(1.05, 0.0, 0.0))
    result.camera = bpy.context.object
    result.cycles.use_adaptive_sampling = result.cycles.use_denoising = True
    result.cycles.samples, result.view_layers[0].samples = 77, 5
    result.render.resolution_x, result.render.resolution_y, result.render.resolution_percentage = 400, 200, 50
    result.render.filepath = "//mine"
    yield result
    bpy.ops.wm.read_factory_settings()


@pytest.mark.either
def test_a_denoised_picture_states_an_error_that_holds(scene):
    """Against 4096 samples, whose own noise is a tenth of it."""
    wanted = {"seconds": 1e3, "round_samples": 1, "most_samples": 8, "seed": 5}
    plain, better = (converge.render(scene, "cycles", 48, 32, denoise=denoise, **wanted) for denoise in (False, True))
    with stage.of_scene(scene, "cycles") as on:
        truth = on.shoot(48, 32, 4096, 99)
    error = [np.sqrt(np.mean((made.image - truth) ** 2)) / truth.mean() for made in (plain, better)]
    assert plain.denoised is None and better.denoised is not None
    assert error[1] < 0.7 * error[0]  # it pays
    assert error[1] <= better.denoised.upper < plain.noise_upper
    assert better.noise == plain.noise and (better.rounds, better.samples) == (8, 1)
    assert [decision.rule for decision in better.decisions][-1] == "denoising"
    assert better.to_json()["denoised"].keys() == {"value", "upper", "mean_change"}


def test_denoising_ends_a_render_sooner_and_resumed_at_the_same_pixels(scene, tmp_path, monkeypatch):
    without_bias(monkeypatch)
    file = tmp_path / ".x.partial.npz"
    wanted = {"error": 0.05, "round_samples": 1, "most_samples": 4096, "denoise": True, "digest": "mine"}
    whole = converge.render(scene, "cycles", 48, 32, **wanted)
    assert whole.reached and whole.stopped == "error" and whole.denoised is not None
    assert whole.noise_upper > 0.05  # more rounds would have been needed
    with pytest.raises(KeyboardInterrupt):
        converge.render(scene, "cycles", 48, 32, **wanted, checkpoint=file, progress=Interruption(whole.rounds - 1))
    resumed = converge.render(scene, "cycles", 48, 32, **wanted, checkpoint=file)
    assert resumed.rounds == whole.rounds
    np.testing.assert_array_equal(resumed.image, whole.image)


def test_a_picture_of_few_pixels_is_not_denoised(scene):
    made = converge.render(scene, "cycles", 16, 8, seconds=1e3, round_samples=1, most_samples=8, denoise=True)
    assert made.denoised is None


TOUCHED = ("cycles.samples", "cycles.sample_offset", "cycles.use_sample_subset", "cycles.sample_subset_length", "cycles.seed",
           "cycles.use_adaptive_sampling", "cycles.use_denoising", "cycles.time_limit", "cycles.sampling_pattern",
           "cycles.use_animated_seed", "cycles.volume_step_rate", "cycles.sample_clamp_indirect", "eevee.taa_render_samples",
           "render.engine", "render.filepath", "render.resolution_x", "render.resolution_y", "render.resolution_percentage",
           "render.use_file_extension", "render.use_sequencer", "render.use_stamp", "render.dither_intensity",
           "render.image_settings.file_format", "render.image_settings.color_mode", "render.image_settings.color_depth",
           "render.image_settings.exr_codec", "render.image_settings.color_management")


def values(of):
    return {path: settings.get(of, path) for path in TOUCHED} | {"layer": of.view_layers[0].samples}


def test_a_scene_is_as_it_was_afterwards_and_counts_every_sample(scene):
    before = values(scene)
    assert stage.size_of(scene) == (200, 100) and stage.size_of(scene, 20) == (20, 10)
    with stage.of_scene(scene, compat.engine_of(scene)) as on:
        assert {decision.effect for decision in on.decisions} == {"adaptive sampling off", "denoising off"}
        few, many, other = (on.shoot(20, 10, samples, seed) for samples, seed in ((4, 0), (256, 0), (256, 1)))
        assert settings.get(scene, "cycles.use_adaptive_sampling") is False
    assert values(scene) == before
    assert few.shape == (10, 20, 3)
    # The view layer's five samples would leave all three as noisy.
    assert np.mean((few - other) ** 2) > 10.0 * np.mean((many - other) ** 2) > 0.0


@pytest.mark.either
def test_a_clamp_shows_as_bias(scene):
    """Light through a clamp is lost whatever the samples: the longer pilot without it sees how much."""
    honest = converge.render(scene, "cycles", 20, 10, error=0.05)
    scene.cycles.sample_clamp_direct = 0.5 * float(np.quantile(honest.image, 0.9))
    with stage.of_scene(scene, "cycles") as on:
        clamped = on.shoot(20, 10, 4096)
    lost = clamped.mean() / honest.image.mean() - 1.0
    assert honest.reached and honest.bias.value < 0.03 and lost < -0.1
    made = converge.render(scene, "cycles", 20, 10, error=0.05)
    assert not made.reached and made.bias.is_seen and "bias alone" in made.notes[-1]
    assert made.bias.mean == pytest.approx(lost, abs=0.04) and made.relative_error >= made.bias.value > 0.1


def test_a_plan_is_applied_before_the_first_render(scene):
    seen = []
    with stage.of_scene(scene, "cycles", prepare=lambda given: seen.append(given.name)) as on:
        on.shoot(4, 4, 1)
    assert seen == [scene.name]


def test_a_file_is_opened_at_its_frame_and_known_by_what_it_holds(scene, tmp_path):
    scene.frame_set(5)
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    first = identity.of_blend(path, None, None, None, 0)
    opened = files.open_scene(path)
    assert opened.frame_current == 5 and files.open_scene(path, frame=9).frame_current == 9
    assert first == identity.of_blend(path, None, None, None, 0)
    others = {identity.of_blend(path, *request) for request in (
        ("cycles", None, None, 0), (None, 9, None, 0), (None, None, 32, 0), (None, None, None, 1))}
    bpy.context.scene.cycles.max_bounces = 1
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert len(others | {first, identity.of_blend(path, None, None, None, 0)}) == 6
    (tmp_path / "no.blend").write_bytes(b"no")
    with pytest.raises(ValueError, match="no.blend cannot be opened"):
        files.open_scene(tmp_path / "no.blend")


def test_files_that_a_scene_uses_count(scene, tmp_path):
    picture = tmp_path / "p.exr"
    render.write_exr(picture, np.ones((2, 2, 3)))
    bpy.data.images.load(str(picture))
    before = identity.externals()
    render.write_exr(picture, np.zeros((2, 2, 3)))
    assert str(picture) in before and identity.of_files(before) != before


@pytest.mark.parametrize("change, words", [
    (lambda s: setattr(s, "camera", None), "no camera"),
    (lambda s: setattr(s.render, "engine", "BLENDER_WORKBENCH"), "which has no samples"),
])
def test_scenes_that_cannot_be_rendered_say_so(scene, change, words):
    change(scene)
    with pytest.raises(ValueError, match=words):
        with stage.of_scene(scene, compat.engine_of(scene)):
            pass


@pytest.mark.sweep
def test_eevee_climbs_a_ladder(scene, tmp_path):
    """Without seeds: four times the samples until the pictures agree, and the file goes on from the last of them."""
    file = tmp_path / "x.npz"
    scene.render.engine = compat.current().eevee
    short = converge.render(scene, "eevee", 24, 12, error=1e-7, most_samples=16, checkpoint=file, digest="scene")
    assert not short.reached and short.samples == 16 and file.exists()
    assert "what EEVEE comes to" in short.notes[0]
    made = converge.render(scene, "eevee", 24, 12, error=1e-7, most_samples=64, checkpoint=file, digest="scene")
    assert made.resumed_rounds == 1 and made.samples == 64 and made.noise < short.noise
    error = math.sqrt(np.mean((short.image - made.image) ** 2)) / made.image.mean()
    assert 0.0 < error < short.noise_upper


@pytest.mark.either
def test_eevees_cells_count_in_the_error(scene, tmp_path):
    """What is stated of a medium's cells holds against ones of a pixel, and cells that cannot be finer are told."""
    material = bpy.data.materials.new("haze")
    tree = compat.use_nodes(material)
    shader, output = tree.nodes.new("ShaderNodeVolumeScatter"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Density"].default_value = 1.0
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=1.6, location=(0.0, -0.5, 0.8))
    bpy.context.object.data.materials.append(material)
    scene.render.engine, eevee = compat.current().eevee, scene.eevee
    eevee.volumetric_tile_size, eevee.volumetric_samples = "4", 64
    made = converge.render(scene, "eevee", 32, 18, error=1e-7, most_samples=4)
    assert (eevee.volumetric_tile_size, eevee.volumetric_samples) == ("4", 64)
    assert made.bias.against == "cells 2 instead of 4 pixels wide and 128 instead of 64 steps" and not made.reached
    eevee.volumetric_tile_size, eevee.volumetric_samples = "1", 256
    finest = converge.render(scene, "eevee", 32, 18, error=1e-7, most_samples=4)
    assert finest.bias is None and any("no finer cells" in note for note in finest.notes)
    error = math.sqrt(np.mean((made.image - finest.image) ** 2)) / finest.image.mean()
    assert 0.02 < error < made.bias.upper, (error, made.bias)
    assert made.bias.value < 3.0 * error


# --- what a render learns ------------------------------------------------------------------------------------------------


@pytest.fixture
def street():
    """Lamps in fog."""
    made = usual.by_name("foggy-street").build()
    made.render.engine, made.frame_end = "CYCLES", 1
    yield made
    bpy.ops.wm.read_factory_settings()


def test_the_second_sample_is_too_dark_where_a_render_learns(street):
    """The reason for long rounds, in the engine: two samples lack 3 % of the fog's light in Blender 5, nothing in 4.5."""
    tuning.apply(street, [found for found in tuning.plan(street, samples=4, pixels=768) if found.rule.name == "lamp hits"])
    with stage.of_scene(street, "cycles") as on:
        assert on.learns == LEARNS
        two, many = (np.array([on.shoot(32, 18, samples, 1000 + index).mean() for index in range(count)])
                     for samples, count in ((2, 300), (128, 16)))
    change = two.mean() / many.mean() - 1.0
    doubt = math.sqrt(sum(means.var(ddof=1) / len(means) for means in (two, many))) / many.mean()
    assert doubt < 0.004
    assert change < -0.01 - 3.0 * doubt if LEARNS else abs(change) < 4.0 * doubt


@pytest.mark.parametrize("has_media", [True, False])
def test_rounds_are_long_where_they_learn(street, has_media, monkeypatch):
    """Also where they take longer than an interruption should cost; and the pictures that tell the bias are no longer."""
    measured = []
    monkeypatch.setattr(converge.effort, "ROUND_SECONDS", 1e-6)
    monkeypatch.setattr(converge.effort, "OVERHEAD", 1.0)
    monkeypatch.setattr(converge, "pilot", lambda *arguments: Pilot(4.0, 1e-4, 1.0))
    monkeypatch.setattr(converge, "_against_longer", lambda *arguments: measured.append(arguments[5]))
    monkeypatch.setattr(converge, "_stop", lambda task, state, took=None: "samples" if state.rounds.count else "")  # one round
    if not has_media:
        street.world = None
    monkeypatch.setattr(converge, "LEAST_PIXELS", 1)  # small as it is, it may be denoised
    for denoise, error, samples in ((False, 0.05, 64), (False, 0.2, 8), (True, 0.05, 16)):
        made = converge.render(street, "cycles", 8, 4, error=error, most_samples=1024, allocate=False, denoise=denoise)
        assert made.samples == (samples if LEARNS and has_media else 1)
        assert measured.pop() == (samples if LEARNS and has_media else 4096)


# --- bad input -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wanted, words", [
    ({}, "neither"), ({"error": 0.0}, "error must be > 0"), ({"error": math.nan}, "error must be > 0"),
    ({"seconds": -1.0}, "seconds must be > 0"), ({"error": 0.1, "round_samples": 0}, "round_samples must be >= 1"),
    ({"seconds": math.inf}, "finite"),
])
def test_bad_targets_are_refused(wanted, words):
    with pytest.raises(ValueError, match=words):
        converge.render(GLASS, "cycles", 4, 4, **wanted)


def test_a_checkpoint_of_a_scene_needs_a_digest(scene):
    with pytest.raises(ValueError, match="needs a digest"):
        converge.render(scene, "cycles", 4, 4, error=0.1, checkpoint=Path("x.npz"))


# --- bias, on pictures of known bias -----------------------------------------------------------------------------------


def pictures(level, noise, seed):
    def make(have):
        rng = np.random.default_rng((seed, have))
        return level * (1.0 + noise * rng.normal(size=(max(8, have), 8, 8, 3)))
    return make


def test_measured_bias_is_the_true_one():
    for truth in (0.0, 0.004, 0.1):
        found = bias.measure(pictures(1.0 + truth, 0.1, 1), pictures(1.0, 0.05, 2), "", 0.01, 0.02, 60.0, math.inf)
        assert found.upper >= truth and abs(found.mean - truth) < 0.004
        if truth == 0.1:
            assert found.is_seen and found.value == pytest.approx(0.1, rel=0.05)
        else:
            assert found.upper <= 0.01


def test_bias_ends_with_its_time():
    found = bias.measure(pictures(1.0, 2.0, 1), pictures(1.0, 2.0, 2), "", 1e-6, 1e-6, 0.0, 0.0)
    assert found.upper > 0.01 and not found.is_seen
    assert bias.measure(pictures(0.0, 1.0, 1), pictures(0.0, 1.0, 2), "", 1e-6, 1e-6, 0.0, 0.0) is None
