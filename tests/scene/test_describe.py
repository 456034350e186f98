# SPDX-License-Identifier: GPL-3.0-or-later
"""A described volume, assembled again, is the volume."""

import math
from dataclasses import replace

import pytest

from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.describe import describe, describe_scene
from volumetrics_addon.scene.model import Box, Camera, Grid, Medium, Phase, Projector, RayleighPhase, Scene, Volume

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
        assert again.medium.phase.mean_cosine == volume.medium.phase.mean_cosine
        assert again.medium.density == volume.medium.density
        assert again.boundary == volume.boundary


@pytest.mark.parametrize("medium", [
    Medium((1.0, 1.0, 1.0), (0.0, 0.1, 0.0), Phase(0.0)),
    Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), RayleighPhase()),
    Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), Phase(0.0), Grid(None, (0, 0, 0), (1, 1, 1))),
])
def test_what_no_family_has_is_refused(medium):
    with pytest.raises(ValueError, match="; |use"):
        describe(Volume(BOX, medium))


def test_projector_is_refused():
    light = Projector((0, 0, 0), (0, 0, -1), (0, 1, 0), (1, 1, 1), 1.0, 1.0)
    scene = Scene(Camera((0, -1, 0), (0, 1, 0), 1.0), (light,))
    with pytest.raises(ValueError, match="spot with blockers"):
        describe_scene(scene)
    assert describe_scene(replace(scene, lights=())) == []
