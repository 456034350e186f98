# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog in Cycles against closed forms: visibility, two layers, a slab."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import items, render  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402
from volumetrics_addon.scene import assemble  # noqa: E402
from volumetrics_addon.scene.describe import describe_scene  # noqa: E402

BLACK = {"albedo": [0.0] * 3, "margin": 10.0}


def transmittance(values, height=2.0):
    """Of a level ray at this height, 10 m from the camera to the end of the box, before an environment of radiance 1."""
    fog = FAMILIES["fog"].check(BLACK | values)
    stage = STAGE.check({"camera_location": [0, 0, height], "camera_target": [0, 1, height], "field_of_view": 1.0,
                         "environment_radiance": 1.0})
    chosen = Preset("test", "fog", "Test", "", fog, stage)
    return np.mean(render.render(chosen, verify.scene_of(chosen), "cycles", 4, 4, 64).images)


def test_visibility_leaves_two_per_cent_of_the_contrast():
    values = FAMILIES["fog"].check({"visibility": 20.0, "extinction": 7.0})
    volume, = assemble.ASSEMBLERS["fog"](values, assemble.Bounds([(0.0, 0.0, 0.0)])).volumes
    assert math.exp(-20.0 * volume.medium.sigma_t[0]) == pytest.approx(0.02, rel=1e-12)


# Values, and the extinction at 2 m by hand: ln 50 = 3.912.
CASES = {
    "extinction": ({"extinction": 0.1, "scale_height": 4.0}, 0.1 * math.exp(-0.5)),
    "visibility": ({"visibility": 20.0, "scale_height": 4.0}, math.log(50.0) / 20.0 * math.exp(-0.5)),
    "two layers": ({"extinction": 0.2, "scale_height": 1.0, "second_extinction": 0.05, "second_scale_height": 8.0},
                   0.2 * math.exp(-2.0) + 0.05 * math.exp(-0.25)),
    "base": ({"extinction": 0.1, "scale_height": 2.0, "base_height": 1.0}, 0.1 * math.exp(-0.5)),
    "slab": ({"extinction": 0.1, "profile": "slab", "slab_height": 3.0}, 0.1),
    "above the slab": ({"extinction": 0.1, "profile": "slab", "slab_height": 1.0}, 0.0),
}


@pytest.mark.parametrize("name", CASES)
def test_cycles_transmittance(name):
    values, sigma_t = CASES[name]
    assert transmittance(values) == pytest.approx(math.exp(-10.0 * sigma_t), rel=2e-3)


def test_two_layers_are_one_body_and_come_back():
    values = FAMILIES["fog"].check({"second_extinction": 0.05, "second_scale_height": 8.0})
    stage = STAGE.check({})
    scene = assemble.scene("fog", values, stage, ())
    assert len(scene.volumes) == 2 and scene.volumes[0].domain == scene.volumes[1].domain
    body, = describe_scene(scene)
    assert body.family.name == "fog" and body.values["second_extinction"] == pytest.approx(0.05)
    assert body.values["second_scale_height"] == pytest.approx(8.0) and body.values["scale_height"] == pytest.approx(4.0)


def test_visibility_is_live():
    """A socket, so that it can be keyframed; one tree serves both the extinction and the visibility of the cases above."""
    scene = bpy.data.scenes.new("user")
    scene.collection.objects.link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    item = items.add_item(scene, "fog", FAMILIES["fog"].check({"visibility": 50.0}), "Fog")
    socket = items.live_node(item).inputs["Visibility"]
    assert socket.default_value == pytest.approx(50.0)
    socket.default_value = 80.0
    assert items.values_of(item)["visibility"] == pytest.approx(80.0)
    socket.keyframe_insert("default_value", frame=1)
    items.remove_item(scene, item)
    bpy.data.scenes.remove(scene)
