# SPDX-License-Identifier: GPL-3.0-or-later
"""Every preset has a reference, the exact one where there is one, and every integrator keeps the contract."""

import inspect
import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.reference import select
from volumetrics_addon.reference.select import NAMES, integrator
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.model import Camera, Dielectric, Ellipsoid, Medium, Scene, Volume

EXPECTED = {"cloud": {"path_tracing"}, "fog": {"single_scattering", "path_tracing"}, "godray": {"single_scattering", "path_tracing"},
            "glass": {"dielectric", "single_scattering"}, "air": {"sky_tables", "path_tracing"}}


def scene_of(name):
    preset = load(name)
    return assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)


def test_the_reference_of_every_preset():
    used = {family: set() for family in EXPECTED}
    for name in names():
        used[load(name).family].add(integrator(scene_of(name)).__name__.rsplit(".", 1)[-1])
    assert used == EXPECTED


def test_a_scene_that_nothing_renders_names_every_reason():
    glass = scene_of("emerald-sphere")
    lit = replace(glass, surfaces=tuple(replace(s, albedo=(0.5, 0.5, 0.5)) for s in glass.surfaces))
    with pytest.raises(ValueError, match="single_scattering: .*dielectric: .*path_tracing: "):
        integrator(lit)


def test_every_integrator_file_is_listed():
    """A module with applies and render is an integrator; nothing is forgotten, nothing listed twice."""
    files = [path.stem for path in Path(select.__file__).parent.glob("*.py")]
    modules = {name: import_module(f"volumetrics_addon.reference.{name}") for name in files if name != "__init__"}
    found = {name for name, module in modules.items() if hasattr(module, "applies") and hasattr(module, "render")}
    assert found == set(NAMES) and len(NAMES) == len(set(NAMES)) >= 17


@pytest.mark.parametrize("name", NAMES)
def test_the_contract(name):
    module = select.load(name)
    summary = select.summary(module)
    assert summary.endswith(".") and 20 < len(summary) < 140
    assert module.BIAS.strip().endswith(".")
    signature = inspect.signature(module.render)
    assert list(signature.parameters)[:3] == ["scene", "width", "height"]
    for common in ("repeats", "strata", "seed", "progress"):
        assert signature.parameters[common].kind is inspect.Parameter.KEYWORD_ONLY
    assert len(module.SETTINGS) >= 5
    for setting in module.SETTINGS:
        assert set(setting) <= set(signature.parameters)
        json.dumps(setting)
    nothing = Scene(Camera((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), 1.0), volumes=(
        Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((1.0,) * 3, (0.0,) * 3), Dielectric(1.5)),), orders=2)
    assert module.applies(nothing)  # nobody scatters inside glass
    with pytest.raises(ValueError, match="appl"):
        module.render(nothing, 4, 4)


def test_an_unknown_integrator_names_the_known_ones():
    with pytest.raises(ValueError, match="path_tracing"):
        select.load("radiosity")
