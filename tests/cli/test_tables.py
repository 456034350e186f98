# SPDX-License-Identifier: GPL-3.0-or-later
"""The documentation is what the declarations and the measurements say."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from volumetrics_addon.cli import doctor, tables
from volumetrics_addon.parameters.preset import names

ROOT = Path(__file__).resolve().parents[2]


def test_documented_parameters_are_the_declared_ones():
    text = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    assert text.endswith(tables.parameters() + "\n"), "run: volumetrics table parameters"


def test_documented_integrators_are_those_that_are_here():
    text = (ROOT / "docs" / "integrators.md").read_text(encoding="utf-8")
    assert text.endswith(tables.integrators() + "\n"), "run: volumetrics table integrators"


def test_documented_rules_are_those_that_are_here():
    text = (ROOT / "docs" / "plan.md").read_text(encoding="utf-8")
    assert text.endswith(tables.rules() + "\n"), "run: volumetrics table rules"


def test_readme_lists_every_preset_with_an_error_for_each_engine():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if re.fullmatch(r"\| `.*` \| \w+ \|.*\| [+-][\d.]+% \[.*\] \| [+-][\d.]+%.* \|", line)]
    assert [row.split("`")[1] for row in rows] == names() and rows


def test_readme_names_the_system_libraries_that_the_doctor_knows():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if "apt-get install" in line)
    assert set(line.split()) >= {*doctor.LIBRARIES.values(), doctor.DRIVERS}


def test_extension_and_package_have_one_version():
    manifest, project = (tomllib.loads((ROOT / name).read_text(encoding="utf-8"))
                         for name in ("blender_manifest.toml", "pyproject.toml"))
    assert manifest["version"] == project["project"]["version"]


def test_preset_table_from_results(tmp_path):
    for name in names():
        for engine in ("cycles", "eevee"):
            interval = [-0.001, 0.003] if engine == "cycles" else [0.08, 0.12]
            figures = {"comparison": {"mean_relative_error": sum(interval) / 2, "mean_relative_interval": interval}}
            (tmp_path / f"{name}-{engine}.json").write_text(json.dumps(figures))
    table = tables.presets(tmp_path)
    assert table.count("+0.10% [-0.10%, +0.30%] | +10.00% [+8.00%, +12.00%] |") == len(names())


def test_a_missing_result_names_the_command(tmp_path):
    with pytest.raises(ValueError, match="volumetrics verify all"):
        tables.presets(tmp_path)
