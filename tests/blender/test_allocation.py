# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds in rectangles with samples of their own: the pixels are those of whole pictures, and what is stated holds."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.blender import compat, converge, settings, stage  # noqa: E402
from volumetrics_addon.compare.allocation import FLOOR, Region, allocate, variance_of  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.plan.effort import Pilot, Schedule  # noqa: E402
from volumetrics_addon.verify import scene_of  # noqa: E402

WIDTH, HEIGHT = 48, 27
# Odd edges and single pixels; each quarter of the picture has samples of its own.
QUARTERS = [Region(0, 0, 17, 11, 1), Region(17, 0, 48, 11, 8), Region(0, 11, 17, 27, 2), Region(17, 11, 47, 27, 4),
            Region(47, 11, 48, 12, 16), Region(47, 12, 48, 27, 2)]
ONE_EACH = [replace(one, samples=1) for one in QUARTERS]


@pytest.fixture
def spot():
    """A spot in haze: noise beside the lamp."""
    scene = usual.by_name("spot-haze").build()
    scene.render.engine = "CYCLES"
    yield scene
    bpy.ops.wm.read_factory_settings()


def pieces(on, seed, regions):
    """Whole pictures with the samples of each region, of which it is cut out."""
    result = np.full((HEIGHT, WIDTH, 3), np.nan)
    for one in regions:
        whole = on.shoot(WIDTH, HEIGHT, one.samples, seed)
        result[one.top:one.bottom, one.left:one.right] = whole[one.top:one.bottom, one.left:one.right]
    return result


def test_a_region_has_the_pixels_of_the_whole_picture(spot):
    """Of one sample: from the second on Blender 5 learns from the pixels around where rays scatter in media."""
    spot.render.border_min_x, spot.render.use_crop_to_border = 0.25, True  # not in use, and the user's
    with stage.of_scene(spot, "cycles") as on:
        assert on.divisible
        np.testing.assert_array_equal(on.shoot(WIDTH, HEIGHT, 0, 3, ONE_EACH), pieces(on, 3, ONE_EACH))
    assert not spot.render.use_border and spot.render.use_crop_to_border and spot.render.border_min_x == 0.25
    assert spot.render.border_max_x == 1.0


@pytest.mark.parametrize("name, regions", [("stained-glass", QUARTERS), ("clear-noon", ONE_EACH)])
def test_so_has_a_region_of_a_preset(name, regions):
    """Glass in one scene, air in three grey ones."""
    preset = load(name)
    with stage.of_preset(preset, scene_of(preset, "cycles", WIDTH * HEIGHT * 8), "cycles", paths=WIDTH * HEIGHT * 8) as on:
        assert on.divisible
        np.testing.assert_array_equal(on.shoot(WIDTH, HEIGHT, 0, 1, regions), pieces(on, 1, regions))


def test_compositing_that_looks_beyond_a_pixel_keeps_the_picture_in_one_piece(spot):
    tree = compat.compositing_tree(spot)
    with stage.of_scene(spot, "cycles") as on:
        assert on.divisible  # nodes that do nothing
        tree.nodes.new("CompositorNodeBlur")
        assert not on.divisible
        spot.render.use_compositing = False
        assert on.divisible
        spot.render.use_border = True
        assert not on.divisible
    with stage.of_scene(spot, "eevee") as on:
        spot.render.use_border = False
        assert not on.divisible


@pytest.mark.either
def test_samples_go_where_the_noise_is_and_the_error_holds(spot, monkeypatch):
    """Of equally many paths the rectangles have a fraction of the squared error, and the mean stays what it is."""
    monkeypatch.setattr(converge, "_measure_bias", lambda *arguments: None)
    with stage.of_scene(spot, "cycles") as on:
        pictures = np.stack([on.shoot(WIDTH, HEIGHT, 64, 700 + index) for index in range(4)])
        truth = on.shoot(WIDTH, HEIGHT, 4096, 900)
    found = allocate(variance_of(pictures, 64), 10.0, 0.05)
    assert len(found.cells) > 4
    schedule = {"error": 1e-6, "denoise": False, "seed": 11, "most_samples": 8 * 64}

    def fixed(task, state, on, goal, planned):
        state.samples, state.regions = 64, found.regions(WIDTH, HEIGHT, 64) if task.seed == 12 else []
        return replace(planned, samples=64)

    monkeypatch.setattr(converge, "_allocate", fixed)
    even, made = (converge.render(spot, "cycles", WIDTH, HEIGHT, **schedule | {"seed": seed}) for seed in (11, 12))
    assert not even.regions and even.rounds == made.rounds == 8
    assert made.to_json()["regions"][0].keys() == {"left", "top", "right", "bottom", "samples"}
    assert sum(one.pixels for one in made.regions) == WIDTH * HEIGHT
    paths = [64 * WIDTH * HEIGHT, sum(one.pixels * one.samples for one in made.regions)]
    squares = [np.mean((one.image - truth) ** 2) / truth.mean() ** 2 for one in (even, made)]
    assert math.sqrt(squares[1]) < made.upper_bound and made.noise == pytest.approx(math.sqrt(squares[1]), rel=0.5)
    assert squares[1] * paths[1] < 0.6 * squares[0] * paths[0]
    doubt = np.sqrt(np.sum(made.standard_error.mean(axis=-1) ** 2)) / (WIDTH * HEIGHT)  # channels share their paths
    assert abs(made.image.mean() - truth.mean()) < 4.0 * doubt


class Clocked:
    """A stage whose noise and seconds are known, and its clock. Noise is in a square of the picture's height / 4; samples there take
    ``slow`` times as long as others."""

    def __init__(self, monkeypatch, deviation=5.0, elsewhere=0.1, slow=1.0, each=0.004, of_path=1e-6):
        self.deviation, self.elsewhere, self.slow, self.each, self.of_path = deviation, elsewhere, slow, each, of_path
        self.clock, self.asked = 0.0, []
        monkeypatch.setattr(converge.time, "perf_counter", lambda: self.clock)

    def shoot(self, width, height, samples, seed=0, regions=()):
        self.asked.append((width, height, samples, len(regions)))
        noisy = np.zeros((height, width), bool)
        noisy[height // 4:height // 2, width // 2:width // 2 + height // 4] = True
        counts = np.full((height, width), samples)
        for one in regions:
            counts[one.top:one.bottom, one.left:one.right] = one.samples
        self.clock += max(1, len(regions)) * self.each + self.of_path * float((counts * np.where(noisy, self.slow, 1.0)).sum())
        noise = np.random.default_rng(seed).normal(size=(height, width, 1))
        return 1.0 + noise * np.where(noisy, self.deviation, self.elsewhere)[..., None] / np.sqrt(counts)[..., None] * np.ones(3)

    def find(self, samples, width=320, height=180):
        of_sample = self.of_path * width * height
        known = Pilot(1.0, of_sample, self.each + converge.PIXEL_SECONDS * width * height)
        return known, converge.allocated_samples(self, width, height, known, Schedule(samples, 8, 8 * known.seconds(samples)))


def test_rectangles_are_found_and_what_they_gain_is_told(monkeypatch):
    on = Clocked(monkeypatch)
    known, (found, gain, pilot) = on.find(128)
    # by its definition: 45 x 45 of 320 x 180 pixels with a deviation of 5, the rest 0.1
    share = 45 * 45 / (320 * 180)
    floor = FLOOR * (share * 5.0 + (1.0 - share) * 0.1)
    spread = share * math.hypot(5.0, floor) + (1.0 - share) * math.hypot(0.1, floor)
    own = (share * 25.0 / math.hypot(5.0, floor) + (1.0 - share) * 0.01 / math.hypot(0.1, floor)) * spread
    exact = (share * 25.0 + (1.0 - share) * 0.01) / own
    assert 0.6 * exact < gain < 1.05 * exact
    assert pilot.variance == pytest.approx(known.variance / gain, rel=0.02)
    assert pilot.sample_seconds == pytest.approx(known.sample_seconds, rel=0.02)
    assert pilot.fixed_seconds == pytest.approx(known.fixed_seconds + (len(found.cells) - 1) * on.each)
    assert len(on.asked) == converge.ALLOCATION_PICTURES + 1 and on.asked[-1][3] == len(found.cells)
    assert on.clock <= 1.5 * converge.ALLOCATION_SHARE * 8 * known.seconds(128)


def test_the_small_picture_grows_with_the_time_there_is(monkeypatch):
    sizes = []
    for samples in (18, 64, 4096):
        on = Clocked(monkeypatch)
        on.find(samples)
        sizes.append(on.asked[0][0] if on.asked else 0)
    assert sizes == [64, 128, 256]


@pytest.mark.parametrize("why, stage_is, samples", [
    ("too short to tell", {}, 2),
    ("noise is even", {"deviation": 0.1}, 128),
    ("each rectangle has what a render does once", {"each": 2.0}, 128),
    ("samples where the noise is take forty times as long", {"slow": 40.0, "deviation": 0.6}, 128),
])
def test_where_they_do_not_pay_every_pixel_has_equally_many(why, stage_is, samples, monkeypatch):
    assert Clocked(monkeypatch, **stage_is).find(samples)[1] is None


def test_resumed_rounds_have_the_same_rectangles_to_the_last_bit(spot, tmp_path, monkeypatch):
    monkeypatch.setattr(converge, "_measure_bias", lambda *arguments: None)

    def fixed(task, state, on, goal, planned):
        state.samples, state.regions = 4, list(QUARTERS)
        return replace(planned, samples=4)

    monkeypatch.setattr(converge, "_allocate", fixed)
    wanted = {"error": 1e-6, "most_samples": 24, "digest": "mine", "seed": 5}
    whole = converge.render(spot, "cycles", WIDTH, HEIGHT, **wanted)
    assert whole.rounds == 6 and whole.regions == tuple(QUARTERS)
    file, said = tmp_path / "x.npz", []

    def interrupt(what, share):
        if what.startswith("round 3,"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        converge.render(spot, "cycles", WIDTH, HEIGHT, checkpoint=file, progress=interrupt, save_seconds=0.0, **wanted)
    monkeypatch.setattr(converge, "_allocate", lambda *arguments: pytest.fail("measured again"))
    resumed = converge.render(spot, "cycles", WIDTH, HEIGHT, checkpoint=file, **wanted)
    assert resumed.resumed_rounds == 3 and resumed.rounds == 6
    np.testing.assert_array_equal(resumed.image, whole.image)
    again = converge.render(spot, "cycles", WIDTH, HEIGHT, checkpoint=file, allocate=False, say=said.append, **wanted)
    assert again.resumed_rounds == 0 and not again.regions and "starting anew" in said[-1]


def test_what_is_found_is_used_and_said(spot, monkeypatch):
    """Its pilot settles the samples of a round, whose rectangles and their gain are in the result."""
    monkeypatch.setattr(converge, "_measure_bias", lambda *arguments: None)
    found = allocate(np.where(np.arange(36 * 64).reshape(36, 64) % 64 < 16, 25.0, 0.01), 10.0, 0.05)
    quick = Pilot(512.0, 1e-3, 1e-4)  # for noise of 1: eight rounds of 64 samples
    least = 16 if bpy.app.version >= (5, 0, 0) else 1  # fewer would be too dark where a render learns
    monkeypatch.setattr(converge, "allocated_samples", lambda *arguments: (found, 3.5, quick))
    made = converge.render(spot, "cycles", WIDTH, HEIGHT, error=1.0, most_samples=512)
    assert made.samples == 64 and made.regions == tuple(found.regions(WIDTH, HEIGHT, 64, least))
    assert made.decisions[-1].rule == "allocation" and "3.5 times as long" in made.decisions[-1].reason
    assert f"{len(made.regions)} rectangles" in made.decisions[-1].effect
    left = {one.samples for one in made.regions if one.right <= WIDTH // 4}
    assert min(left) > 4 * max(one.samples for one in made.regions if one.left >= WIDTH // 4)


def test_samples_of_a_round_that_are_given_are_those_of_every_pixel(spot, monkeypatch):
    monkeypatch.setattr(converge, "_measure_bias", lambda *arguments: None)
    made = converge.render(spot, "cycles", WIDTH, HEIGHT, error=1e-6, round_samples=2, most_samples=12)
    assert not made.regions and made.samples == 2


def test_borders_come_back_when_a_render_fails(spot, monkeypatch):
    with stage.of_scene(spot, "cycles") as on:
        before = {path: settings.get(spot, path) for path in stage.BORDER}
        monkeypatch.setattr(stage.render, "render_built", lambda *arguments, **others: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            on.shoot(WIDTH, HEIGHT, 4, regions=QUARTERS)
        assert {path: settings.get(spot, path) for path in stage.BORDER} == before
