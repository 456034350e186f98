# SPDX-License-Identifier: GPL-3.0-or-later
"""A described volume, assembled again, is the volume."""

import math
from dataclasses import replace

import pytest

from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.describe import describe, describe_scene
from volumetrics_addon.scene.model import (
    Box, Camera, ExponentialAltitude, Grid, Medium, MiePhase, Phase, Projector, RayleighPhase, Scene, Volume,
)

BOX = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def close(a, b):
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(close, a, b))
    if isinstance(a, float):
        return math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-15)
    return a == b


@pytest.mark.parametrize("name", names())
def test_inverse_of_assembly(name):
    preset = load(name)
    scene = assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)
    assert scene.volumes
    for volume in scene.volumes:
        family, values = describe(volume)
        # Position and size of a domain are the Scene's, only the material is described.
        placed = values | {key: preset.parameters[key] for key in ("location", "size", "rotation", "domain", "margin", "cutoff")
                           if key in preset.parameters and key in values}
        if preset.family == "godray":
            assert family == "cloud"
            placed |= {"domain": "box"}
        again, = assemble.ASSEMBLERS[family](placed, assemble.Bounds([(0.0, 0.0, 0.0)])).volumes
        for mine, other in ((again.medium.sigma_s, volume.medium.sigma_s), (again.medium.sigma_a, volume.medium.sigma_a)):
            assert close(mine, other)
        assert again.medium.phase == volume.medium.phase
        assert again.medium.density == volume.medium.density
        assert again.boundary == volume.boundary


def test_droplets_and_billows_come_back():
    values = FAMILIES["cloud"].check({"phase": "mie", "droplet_diameter": 7.5, "profile": "anvil", "billow_octaves": 4,
                                      "billow_size": 3.0, "billow_strength": 0.7, "billow_roughness": 0.4, "base": 0.1,
                                      "stretch": 2.0, "wind": (1.0, 2.0, 3.0), "time": 5.0, "evolution": 0.25})
    volume, = assemble.cloud(values).volumes
    assert volume.medium.phase == MiePhase(7.5) and volume.medium.density.drift == (5.0, 10.0, 15.0)
    family, described = describe(volume)
    again, = assemble.cloud(described | {key: values[key] for key in ("location", "size", "domain")}).volumes
    assert family == "cloud" and again == volume


@pytest.mark.parametrize("medium", [
    Medium((1.0, 1.0, 1.0), (0.0, 0.1, 0.0), Phase(0.0)),
    Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), RayleighPhase()),
    Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), Phase(0.0), ExponentialAltitude((0, 0, -9), 9.0, 1.0)),
])
def test_what_no_family_has_is_refused(medium):
    with pytest.raises(ValueError, match="; |use"):
        describe(Volume(BOX, medium))


def test_voxels_are_a_cloud_that_may_only_absorb():
    """The values of the cloud colour them; the density is the volume's own."""
    for sigma_s, albedo in (((1.0, 0.5, 0.0), (1.0, 0.5, 0.0)), ((0.0,) * 3, (0.0,) * 3)):
        medium = Medium(sigma_s, tuple(1.0 - s for s in sigma_s), Phase(0.3), Grid(None, (0, 0, 0), (1, 1, 1)))
        family, values = describe(Volume(BOX, medium))
        assert family == "cloud" and values["extinction"] == 1.0 and values["albedo"] == albedo and values["g"] == 0.3


def test_projector_is_refused():
    light = Projector((0, 0, 0), (0, 0, -1), (0, 1, 0), (1, 1, 1), 1.0, 1.0)
    scene = Scene(Camera((0, -1, 0), (0, 1, 0), 1.0), (light,))
    with pytest.raises(ValueError, match="spot with blockers"):
        describe_scene(scene)
    assert describe_scene(replace(scene, lights=())) == []
