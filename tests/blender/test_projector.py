# SPDX-License-Identifier: GPL-3.0-or-later
"""Projectors and sunlight through openings in both engines against their references; EEVEE's bound is the error measured plus
a margin."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender.render import write_exr  # noqa: E402
from volumetrics_addon.cli.doctor import checks  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402

BEAM = {"light": "projector", "location": [0, 0, 6], "target": [0, 0, 0], "length": 6.0, "extinction": 0.1, "blocker": "none",
        "horizontal_fov": 50.0, "vertical_fov": 30.0}
STAGED = {"camera_location": [1, -9, 2.5], "camera_target": [0, 0, 1.6], "field_of_view": 16}
VARIANTS = {
    "plain": {}, "hard": {"blend": 0.0, "roll": 30.0}, "elliptic": {"frustum": "elliptic"}, "linear": {"falloff": "linear"},
    "constant": {"falloff": "constant"}, "near-far": {"near": 1.0, "far": 4.0, "domain": "box"},
    "window": {"gobo": "window", "gobo_resolution": 32}, "glass": {"gobo": "stained_glass", "gobo_resolution": 32},
    "count": {"count": 2},
    "ambient": {"ambient": 2.0, "ambient_color": [1.0, 0.5, 0.2], "albedo": [0.9, 0.8, 0.7], "extinction": 0.3},
    "sun": {"light": "sun", "location": [-1, -1.5, 5], "target": [0.4, 1, 0], "opening_tilt": 60.0, "opening_width": 1.8,
            "count": 2, "spacing": 2.0, "blocker": "slats", "blocker_rotation": 30.0, "blocker_fill": 0.3},
    "image": {"gobo": "image", "gobo_image": "slide.exr", "gobo_resolution": 32, "gobo_scale": 0.7, "gobo_rotation": 25.0},
}


DUST = {"light": "spot", "dust_strength": 1.0, "dust_size": 0.6, "dust_drift": [0.1, 0.2, -0.3], "dust_time": 5.0, "dust_seed": 7}


def measured(changes, engine, samples, size=16, **options):
    preset = Preset("test", "godray", "Test", "", FAMILIES["godray"].check(BEAM | changes), STAGE.check(STAGED))
    return verify.verify(preset, engine, size, samples, repeats=4, **{"reference_samples": 4, **options}).comparison


@pytest.mark.parametrize("name", VARIANTS)
def test_cycles_equals_the_reference(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_exr(tmp_path / "slide.exr", np.random.default_rng(1).random((5, 8, 3)))
    comparison = measured(VARIANTS[name], "cycles", 256)
    assert abs(comparison.mean_relative_error) <= 0.005 and comparison.z_pass_fraction >= 0.9975


def test_cycles_shows_the_dust_of_the_reference():
    """Within 0.5 % with 99.9 % confidence; -0.0 % to +0.1 % +- 0.14 % with eight times the samples on four times the pixels."""
    low, high = measured(DUST, "cycles", 1024, 8, reference_samples=1024, confidence=0.999).mean_relative_interval
    assert low <= 0.005 and high >= -0.005 and high - low < 0.015


@pytest.mark.either
@pytest.mark.skipif(not all(c.ok for c in checks() if c.name == "EEVEE"), reason="no EGL on this machine")
@pytest.mark.parametrize("name", ["plain", "glass"])
def test_eevee_masks_the_light(name):
    assert abs(measured(VARIANTS[name], "eevee", 64).mean_relative_error) < 0.03  # -1.5 % and -1.8 %
