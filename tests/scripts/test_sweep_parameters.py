# SPDX-License-Identifier: GPL-3.0-or-later
"""The sweep covers what is declared, beside values at which it has an effect; its records resume and are drawn."""

import json
import sys
from pathlib import Path

import pytest

from volumetrics_addon.parameters.families import FAMILIES

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import sweep_parameters as sweep  # noqa: E402
import sweep_plots  # noqa: E402


@pytest.mark.parametrize("family", FAMILIES)
def test_every_parameter_has_values_that_are_allowed_and_have_an_effect(family):
    group, base = FAMILIES[family], sweep.base_of(family)
    swept = {parameter.name: (beside, values) for parameter, beside, values in sweep.cases(family)}
    assert list(swept) == [p.name for p in group.parameters if p.kind not in sweep.WORDS] and len(swept) > 8
    for name, (beside, values) in swept.items():
        assert len(values) == len(set(values)) >= (2 if group[name].kind in ("choice", "bool") else 3), name
        for value in values:
            preset = base.changed({**beside, name: value})  # raises where a value is refused
            assert group.applies(name, preset.parameters), name
        both = [(name, value) for outer in (True, False) for p, _, _, value in sweep.ordered(family, outer) if p.name == name]
        assert sorted(map(repr, both)) == sorted(repr((name, value)) for value in values)


def test_values_around_a_base():
    fog, cloud = FAMILIES["fog"], FAMILIES["cloud"]
    assert sweep.spread(fog["scale_height"], 4.0) == pytest.approx((0.25, 1.0, 4.0, 16.0, 64.0))
    assert sweep.spread(cloud["softness"], 0.25) == pytest.approx((0.01, 0.25, 0.258, 0.505, 0.752, 1.0))
    assert sweep.spread(cloud["billow_octaves"], 1) == (0, 1, 2, 6)  # 1/16, 1/4, 1, 6 ** 0.5, 6
    assert sweep.spread(cloud["albedo"], (0.5, 0.25, 0.5))[-1] == (1.0, 0.5, 1.0)
    assert sweep.spread(cloud["profile"], "dome") == ("round", "dome", "tower", "anvil", "layer")


def test_records_resume_and_survive_changes(tmp_path):
    record = sweep.Record(tmp_path / "fog.json")
    values, header = (0.0, 0.5, 1.0), {"preset": "morning-valley", "base": {}, "pixels": 14}
    assert not record.has("g", {}, values, "cycles 5.2", 0.5)
    record.add(header, "g", {}, values, "cycles 5.2", 0.5, [0.001, -0.002, 0.004])
    record.add(header, "g", {}, values, "cycles 4.5", 1.0, "refused")
    assert record.has("g", {}, values, "cycles 5.2", 0.5) and not record.has("g", {}, values, "cycles 5.2", 1.0)
    assert json.loads(record.path.read_text())["parameters"]["g"]["cycles 4.5"] == [None, None, "refused"]
    # Another surrounding is another measurement.
    assert not record.has("g", {"profile": "slab"}, values, "cycles 5.2", 0.5)
    record.add(header, "g", {}, values[:2], "cycles 5.2", 0.0, [None, None, None])
    assert set(record.read()["parameters"]["g"]) == {"beside", "values", "cycles 5.2"}


def test_an_interval_beyond_the_tolerance_is_wrong():
    assert sweep.wrong((0.006, 0.0051, 0.007)) and sweep.wrong((-0.02, -0.03, -0.01))
    assert not sweep.wrong((0.006, 0.004, 0.008)) and not sweep.wrong((None, None, None))


def test_sheets_and_table_are_made_of_the_records(tmp_path):
    record = sweep.Record(tmp_path / "sweeps" / "fog.json")
    header = {"preset": "morning-valley", "base": {}, "pixels": 14}
    for value, error in ((0.0, 0.001), (0.5, -0.0125)):
        record.add(header, "g", {}, (0.0, 0.5), "cycles 5.2", value, [error, error - 0.001, error + 0.002])
    record.add(header, "profile", {}, ("exponential", "slab"), "cycles 5.2", "slab", "no reason")
    sweep_plots.write(tmp_path / "sweeps")
    table = (tmp_path / "sweeps.md").read_text()
    assert "| `g` | 0, 0.5 | -1.25% [-1.35%, -1.05%] at 0.5 |" in table and "| `profile` | exponential, slab | refused |" in table
    assert (tmp_path / "sweeps" / "fog-cycles.png").read_bytes().startswith(b"\x89PNG")
