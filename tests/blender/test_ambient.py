# SPDX-License-Identifier: GPL-3.0-or-later
"""The ambient light of haze in both engines, against its closed form: sigma_s A (1 - exp(-sigma_t s)) / sigma_t."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import render  # noqa: E402
from volumetrics_addon.cli.doctor import checks  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402
from volumetrics_addon.verify import scene_of  # noqa: E402

ALBEDO, AMBIENT, SIGMA_T, LENGTH = np.array([0.9, 0.6, 0.3]), np.array([3.0, 1.5, 0.6]), 0.4, 5.0
HAS_EEVEE = all(check.ok for check in checks() if check.name == "EEVEE")


def seen(engine, orders):
    """A picture along the axis of a dark beam, all of it inside: each ray is LENGTH / cos long, here to 1e-4."""
    values = {"light": "projector", "power": 0.0, "location": [0, 0, 10], "target": [0, 0, 0], "near": 1.0,
              "length": 1.0 + LENGTH, "horizontal_fov": 60.0, "vertical_fov": 60.0, "extinction": SIGMA_T, "albedo": list(ALBEDO),
              "g": 0.6, "blocker": "none", "ambient": 3.0, "ambient_color": [1.0, 0.5, 0.2]}
    stage = {"camera_location": [0, 0, 20], "camera_target": [0, 0, 0], "field_of_view": 1.0, "orders": orders}
    preset = Preset("test", "godray", "Test", "", FAMILIES["godray"].check(values), STAGE.check(stage))
    return render.render(preset, scene_of(preset), engine, 4, 4, 256 if engine == "cycles" else 16).images.mean(axis=(0, 1, 2))


@pytest.mark.parametrize("orders", [1, 4])
def test_cycles_scatters_ambient_light_once(orders):
    expected = ALBEDO * AMBIENT * -np.expm1(-SIGMA_T * LENGTH)
    assert np.abs(seen("cycles", orders) / expected - 1.0).max() < 1e-3  # 1e-4 measured


@pytest.mark.skipif(not HAS_EEVEE, reason="no EGL on this machine")
def test_eevee_scatters_ambient_light_once():
    expected = ALBEDO * AMBIENT * -np.expm1(-SIGMA_T * LENGTH)
    error = seen("eevee", 1) / expected - 1.0
    # -0.9 %, -0.6 % and -3.4 % measured: froxels hold floats of 11, 11 and 10 bits, cut off.
    assert (np.abs(error) < (0.02, 0.02, 0.045)).all()
