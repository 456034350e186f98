# SPDX-License-Identifier: GPL-3.0-or-later
"""Every preset has a reference, and the exact one where there is one."""

from dataclasses import replace

import pytest

from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.reference.select import integrator
from volumetrics_addon.scene import assemble

EXPECTED = {"cloud": {"path_tracing"}, "fog": {"single_scattering", "path_tracing"}, "godray": {"single_scattering"},
            "glass": {"dielectric", "single_scattering"}}


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
