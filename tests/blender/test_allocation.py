# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds in rectangles with samples of their own: the pixels are those of whole pictures, and what is stated holds."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.bench import usual  # noqa: E402
from volumetrics_addon.blender import compat, converge, settings, stage  # noqa: E402
from volumetrics_addon.compare.allocation import Region  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
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


def test_samples_go_where_the_noise_is_and_the_error_holds(spot, monkeypatch):
    """Of equally many paths the rectangles have a fraction of the squared error, and the mean stays what it is."""
    monkeypatch.setattr(converge, "_measure_bias", lambda *arguments: None)
    monkeypatch.setattr(converge, "ALLOCATION_SHARE", 10.0)  # of a picture of a second: enough to tell
    wanted = {"error": 0.08, "denoise": False, "seed": 11}
    even, made = (converge.render(spot, "cycles", WIDTH, HEIGHT, allocate=allocate, **wanted) for allocate in (False, True))
    assert not even.regions and made.reached and made.upper_bound <= 0.08
    assert [decision.rule for decision in made.decisions][-1] == "allocation"
    assert made.to_json()["regions"][0].keys() == {"left", "top", "right", "bottom", "samples"}
    covered = np.zeros((HEIGHT, WIDTH), int)
    for one in made.regions:
        covered[one.top:one.bottom, one.left:one.right] += 1
    assert (covered == 1).all()
    with stage.of_scene(spot, "cycles") as on:
        truth = np.mean([on.shoot(WIDTH, HEIGHT, 4096, 900 + index) for index in range(2)], axis=0)
    paths = [even.rounds * even.samples * WIDTH * HEIGHT, made.rounds * sum(one.pixels * one.samples for one in made.regions)]
    squares = [np.mean((one.image - truth) ** 2) / truth.mean() ** 2 for one in (even, made)]
    assert math.sqrt(squares[1]) < made.upper_bound
    assert squares[1] * paths[1] < 0.6 * squares[0] * paths[0]
    off = made.image.mean() / truth.mean() - 1.0
    assert abs(off) < 4.0 * math.sqrt(np.mean(made.standard_error**2) / made.image.size) * math.sqrt(3.0) / truth.mean()


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
