# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart and summary from rows that are known."""

import pytest

from volumetrics_addon.bench import chart, summary
from volumetrics_addon.bench.rivals import names
from volumetrics_addon.bench.run import Row


def row(rival, seconds, rmse, setting='{"samples": 1}', scene="lamp"):
    return Row(scene, rival, setting, 8, 8, seconds, rmse, 0.01, None, 1e-4, 64, "abc")


ROWS = [row("cycles", 1.0, 0.5), row("cycles", 8.0, 0.05), row("eevee", 2.0, 0.3), row("ray_marching", 0.1, 0.08),
        row("ray_marching", 0.5, 0.009), row("single_scattering", 0.02, 0.2), row("single_scattering", 0.05, 1e-6)]


def test_every_rival_has_its_colour():
    assert set(chart.COLORS) == set(names())


def test_chart_is_a_picture(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    path = tmp_path / "new" / "lamp.png"
    chart.chart(ROWS, "Lamp", path)
    image = matplotlib.image.imread(path)
    assert image.shape[:2] == (720, 1280) and image.std() > 0.05
    assert [p.name for p in path.parent.iterdir()] == ["lamp.png"]


def test_overview_holds_every_scene(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    chart.overview([("Lamp", ROWS)] * 5, tmp_path / "all.png")
    image = matplotlib.image.imread(tmp_path / "all.png")
    assert image.shape[:2] == (700, 1920) and image.std() > 0.05
    # Four charts in the first line and one in the second: its other places are empty paper.
    assert image[420:, :400, 0].std() > 0.02 and image[420:, 550:1400, 0].std() < 1e-6


def test_summary_names_the_quickest_to_each_error():
    lines = summary.summary(ROWS).splitlines()
    assert lines[2] == ("| lamp | single scattering, 50 ms | single scattering, 50 ms | single scattering, 50 ms | "
                        "single scattering, 1e-06 in 50 ms | 0.01% |")
    assert sum(line.startswith("| lamp |") for line in lines) == 5


def test_summary_of_a_goal_nobody_reaches():
    lines = summary.summary([row("cycles", 1.0, 0.05)]).splitlines()
    assert lines[2] == "| lamp | Cycles, 1 s | none | none | Cycles, 5% in 1 s | 0.01% |"


@pytest.mark.parametrize("value, text", [(0.5, "50%"), (0.012345, "1.23%"), (1e-5, "0.001%"), (3e-7, "3e-07"), (20.0, "2000%")])
def test_percent(value, text):
    assert chart.percent(value) == text
