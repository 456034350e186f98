# SPDX-License-Identifier: GPL-3.0-or-later
"""fit-phase: from a text file to the options of a cloud."""

import json
import math

import pytest

from volumetrics_addon.cli.fit import read_table
from volumetrics_addon.cli.main import OK, USAGE, main


def hg(c, g):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * c) ** 1.5)


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "phase.csv"
    lines = ["angle, value", "# measured"]
    for angle in range(0, 181):
        c = math.cos(math.radians(angle))
        lines.append(f"{angle}; {7.0 * (0.7 * hg(c, 0.8) + 0.3 * hg(c, -0.3))!r}")
    path.write_text("\n".join(lines))
    return path


def test_known_lobes_come_back(table, capsys):
    assert main(["fit-phase", str(table), "--json"]) == OK
    found = json.loads(capsys.readouterr().out)
    # A degree resolves the lobe of 0.8 to about 1e-3 in the integral, which the norm is held to.
    assert found["g"] == pytest.approx(0.8, abs=2e-3)
    assert found["g_back"] == pytest.approx(-0.3, abs=5e-3)
    assert found["lobe_weight"] == pytest.approx(0.3, abs=2e-3) and found["residual"] < 2e-3


def test_options_are_those_of_a_cloud(table, capsys):
    assert main(["fit-phase", str(table)]) == OK
    options = capsys.readouterr().out.splitlines()[1].split()
    assert main(["show", "cumulus", "--json", *options]) == OK
    shown = json.loads(capsys.readouterr().out)["parameters"]
    assert shown["phase"] == "dual_hg" and shown["g"] == pytest.approx(0.8, abs=2e-3)


def test_droplets(capsys):
    assert main(["fit-phase", "--droplet", "20", "--keep-mean-cosine", "--json"]) == OK
    found = json.loads(capsys.readouterr().out)
    assert found["mean_cosine"] == pytest.approx(found["given_mean_cosine"], abs=1e-9) and found["mean_cosine"] > 0.8


@pytest.mark.parametrize("text, words", [
    ("0 1\n10 x\n", "line 2"), ("0 1\n200 1\n", "from 0 to 180"), ("0 1\n5\n", "line 2"), ("0 1\n1 2\n2 3\n", "5"),
    ("", "5"), ("0 1\n1 -1\n2 1\n3 1\n4 1\n", "-1"),
])
def test_bad_tables_are_told(text, words, tmp_path, capsys):
    path = tmp_path / "bad.txt"
    path.write_text(text)
    assert main(["fit-phase", str(path)]) == USAGE
    assert words in capsys.readouterr().err


def test_headings_and_byte_order_mark_are_left_out(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("\ufeffangle,value\n0,1\n\n90;2\n# end\n180 3\n", encoding="utf-8")
    assert read_table(path) == ([0.0, 90.0, 180.0], [1.0, 2.0, 3.0])


@pytest.mark.parametrize("arguments", [[], ["x.txt", "--droplet", "3"], ["--droplet", "-1"], ["--droplet", "nan"]])
def test_wrong_usage(arguments, capsys):
    assert main(["fit-phase", *arguments]) == USAGE
    assert "volumetrics:" in capsys.readouterr().err
