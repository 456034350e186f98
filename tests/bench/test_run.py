# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark measures what it says, resumes where it stopped, and believes no file it did not write."""

import json
import math
import random
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.bench import run
from volumetrics_addon.bench.rivals import RivalFailed, Shot
from volumetrics_addon.bench.scenes import SCENES, BenchScene, by_name
from volumetrics_addon.reference import select
from volumetrics_addon.scene.model import Box, Camera, Medium, Phase, Point, Scene, Surface, Volume

FOG = Medium((0.1, 0.1, 0.1), (0.0, 0.0, 0.0), Phase(0.3))
SCENE = Scene(Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), 1.0), (Point((0.0, 0.0, 1.0), (50.0, 40.0, 30.0)),),
              volumes=(Volume(Box((0.0, 0.0, 0.0), (3.0, 3.0, 3.0)), FOG),))
BENCH = BenchScene("lamp", "Lamp", lambda: SCENE, "single_scattering", {"order": 32})


class Scaled:
    """A rival that is off by a known factor, and counts how often it was asked."""

    name = "scaled"

    def __init__(self, *factors, seconds=2.0, reason=""):
        self.settings = tuple({"factor": factor} for factor in factors)
        self.seconds, self.reason, self.shots = seconds, reason, []

    def applies(self, scene):
        return self.reason

    def shoot(self, scene, width, height, setting, seed):
        self.shots.append((width, setting["factor"]))
        truth = select.load("single_scattering").render(scene, width, height, strata=0, order=32).image
        return Shot(truth * setting["factor"], self.seconds * setting["factor"], 7, None)


def test_errors_are_relative_to_the_mean_of_the_truth(tmp_path):
    rows = run.measure([BENCH], [Scaled(1.1, 1.3)], 8, tmp_path)
    truth = select.load("single_scattering").render(SCENE, 8, 8, strata=0, order=32).image
    shape = math.sqrt((truth**2).mean()) / truth.mean()
    for row, factor in zip(rows, (1.1, 1.3)):
        assert row.bias == pytest.approx(factor - 1.0, rel=1e-9)
        assert row.rmse == pytest.approx((factor - 1.0) * shape, rel=1e-9)
        assert row.seconds == 2.0 * factor and json.loads(row.setting) == {"factor": factor}


def test_what_is_measured_is_not_measured_again(tmp_path):
    first, second = Scaled(1.1, 1.2), Scaled(1.1, 1.2, 1.3)
    before = run.measure([BENCH], [first], 10, tmp_path)
    after = run.measure([BENCH], [second], 10, tmp_path)
    assert after[:2] == before
    assert first.shots == [(run.WARM_UP, 1.1), (10, 1.1), (10, 1.2)]
    assert second.shots == [(run.WARM_UP, 1.1), (10, 1.3)]


def test_another_scene_or_size_is_another_measurement(tmp_path):
    run.measure([BENCH], [Scaled(1.1)], 8, tmp_path)
    brighter = replace(BENCH, make=lambda: replace(SCENE, environment=(1.0, 1.0, 1.0)))
    for bench, size in ((BENCH, 6), (brighter, 8)):
        rival = Scaled(1.1)
        run.measure([bench], [rival], size, tmp_path)
        assert (size, 1.1) in rival.shots
    assert len(run.read_rows(tmp_path / "bench.csv")) == 3


def test_a_torn_last_line_is_measured_again(tmp_path):
    run.measure([BENCH], [Scaled(1.1, 1.2)], 8, tmp_path)
    path = tmp_path / "bench.csv"
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    rival = Scaled(1.1, 1.2)
    rows = run.measure([BENCH], [rival], 8, tmp_path)
    assert [factor for width, factor in rival.shots] == [1.1, 1.2]  # the warm-up, then the torn one
    assert [json.loads(row.setting)["factor"] for row in rows] == [1.1, 1.2]


def test_a_foreign_table_is_refused_and_kept(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="remove it or choose another folder"):
        run.measure([BENCH], [Scaled(1.1)], 8, tmp_path)
    assert path.read_text() == "a,b\n1,2\n"


def test_a_slow_rival_stops_and_says_so(tmp_path):
    said = []
    rows = run.measure([BENCH], [Scaled(1.0, 2.0, 3.0, seconds=10.0)], 8, tmp_path, limit=15.0, say=said.append)
    assert [row.seconds for row in rows] == [10.0, 20.0]
    assert any("stopped at 20 s" in text for text in said)


def test_reasons_are_said_and_infinities_refused(tmp_path):
    said = []
    assert run.measure([BENCH], [Scaled(1.0, reason="it is Monday")], 8, tmp_path, say=said.append) == []
    assert any("it is Monday" in text for text in said)
    with pytest.raises(RuntimeError, match="not finite"):
        run.measure([BENCH], [Scaled(math.nan)], 8, tmp_path)
    with pytest.raises(ValueError, match="size must be >= 1"):
        run.measure([BENCH], [], 0, tmp_path)


def test_a_rival_that_fails_leaves_the_others(tmp_path):
    class Broken(Scaled):
        name = "broken"

        def shoot(self, *arguments):
            raise RivalFailed("no EGL here")

    said = []
    rows = run.measure([BENCH], [Broken(1.0, 2.0), Scaled(1.1)], 6, tmp_path, say=said.append)
    assert [row.rival for row in rows] == ["scaled"] and any("broken failed: no EGL" in text for text in said)


def test_the_truth_is_rendered_once(tmp_path):
    digest = run.digest_of(SCENE, BENCH, 8, 8)
    first = run.truth_of(BENCH, SCENE, 8, 8, tmp_path, digest)
    second = run.truth_of(BENCH, SCENE, 8, 8, tmp_path, digest)
    assert np.array_equal(first.image, second.image) and first.seconds == second.seconds
    assert not list(tmp_path.glob(".*")) and len(list(tmp_path.iterdir())) == 1


def test_pareto_front_against_its_definition():
    generator = random.Random(3)
    points = [(generator.randint(1, 12), generator.randint(1, 12)) for _ in range(60)]
    front = {points[i] for i in run.pareto_front(points)}
    literal = {p for p in points if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)}
    assert front == literal


@pytest.mark.parametrize("name", [scene.name for scene in SCENES])
def test_every_scene_has_a_truth_that_applies(name):
    bench = by_name(name)
    module = select.load(bench.truth)
    scene = bench.make()
    assert module.applies(scene) == ""
    settings = {**bench.truth_settings, "repeats": 2}
    settings |= {key: least for key, least in (("samples", 1), ("resolution", 6), ("order", 8)) if key in settings}
    image = module.render(scene, 4, 4, **{"strata": 0, **settings}).image
    assert np.isfinite(image).all() and image.max() > 0.0


def test_an_unknown_scene_names_the_known_ones():
    with pytest.raises(ValueError, match="street-lamp"):
        by_name("moon")


def test_engines_too_show_the_centres_of_the_pixels():
    """A grid of thin lights, seen in one pixel each: an image at centres is all or nothing, one of whole pixels is grey."""
    from volumetrics_addon.bench.rivals import rival

    size = 8
    pixel = 2.0 * math.tan(0.5) / size
    absorbing = Volume(Box((0.0, 0.0, 0.0), (9.0, 9.0, 1e-3)), Medium((0.0,) * 3, (0.0,) * 3))
    lines = tuple(Surface(Box(((column + 0.5 - size / 2) * pixel, 0.0, -0.01), (0.1 * pixel, 5.0, 0.0)), (0.0,) * 3, (1.0,) * 3)
                  for column in range(0, size, 2))
    scene = Scene(Camera((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 1.0), volumes=(absorbing,), surfaces=lines)
    for name in ("cycles", "eevee"):
        image = rival(name).shoot(scene, size, size, {"samples": 16}, 0).image
        expected = np.zeros((size, size))
        expected[:, ::2] = 1.0
        # Over whole pixels a line would have 0.2. Measured: all exact but one of Cycles' pixels, which lost one sample.
        np.testing.assert_allclose(image[..., 1], expected, atol=0.1, err_msg=name)
