# SPDX-License-Identifier: GPL-3.0-or-later
"""A channel of a Scene, in grey, is that channel of its picture."""

import numpy as np
import pytest

from volumetrics_addon.bench.scenes import by_name
from volumetrics_addon.reference import select
from volumetrics_addon.scene.channels import CHANNELS, channel, channel_body, mixes
from volumetrics_addon.scene.describe import describe_scene
from volumetrics_addon.scene.model import Camera, Medium, Phase, Projector, RayleighPhase, Scene


@pytest.mark.parametrize("name", ["street-lamp", "sky-noon"])
def test_integrators_see_the_channel(name):
    scene = by_name(name).make()
    module = select.integrator(scene)
    options = {"resolution": 4, "orders": 2, "order": 4} if name == "sky-noon" else {}
    whole = module.render(scene, 4, 4, repeats=1, strata=0, **options).image
    for index in CHANNELS:
        grey = module.render(channel(scene, index), 4, 4, repeats=1, strata=0, **options).image
        np.testing.assert_allclose(grey, np.repeat(whole[..., index, None], 3, axis=-1), rtol=1e-12)


def test_bodies_follow_their_volumes():
    scene = by_name("sky-noon").make()
    body, = describe_scene(scene)
    for index in CHANNELS:
        grey = channel_body(body, index)
        assert grey.volumes == channel(scene, index).volumes
        assert grey.values["rayleigh_color"] == (body.values["rayleigh_color"][index],) * 3


def test_a_gobo_keeps_its_channel():
    gobo = np.random.default_rng(0).random((2, 3, 3))
    light = Projector((0, 0, 4), (0, 0, -1), (0, 1, 0), (1.0, 2.0, 3.0), 1.0, 1.0, gobo=gobo)
    grey, = channel(Scene(Camera((0, -1, 0), (0, 1, 0), 1.0), (light,)), 1).lights
    assert grey.power == (2.0, 2.0, 2.0) and np.array_equal(grey.gobo, gobo[..., 1])


@pytest.mark.parametrize("sigma, phase, expected", [
    ((1.0, 2.0, 3.0), RayleighPhase(), True),
    ((1.0, 1.0, 1.0), RayleighPhase(), False),  # in every channel the same mixture
    ((1.0, 2.0, 3.0), Phase(0.5), False),  # one phase function in all
    ((0.0, 0.0, 0.0), RayleighPhase(), False),
])
def test_mixtures(sigma, phase, expected):
    other = Medium((0.5, 0.5, 0.5), (0.0, 0.0, 0.0), Phase(0.5))
    assert mixes(Medium(sigma, (0.0, 0.0, 0.0), phase), other) is expected
