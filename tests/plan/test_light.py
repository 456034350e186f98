# SPDX-License-Identifier: GPL-3.0-or-later
"""How finely light is baked."""

import pytest

from volumetrics_addon.plan.rules import light_resolution
from volumetrics_addon.scene.model import Box, Medium, Volume


@pytest.mark.parametrize("half, asked, expected", [
    ((10.0, 10.0, 10.0), 32, 32),  # a cube has what is asked for
    ((100.0, 100.0, 10.0), 32, 80),  # eight voxels across a tenth of the length
    ((100.0, 100.0, 10.0), 96, 96),
    ((1000.0, 1000.0, 1.0), 32, 128),  # and not more than a grid can hold
    ((1000.0, 1000.0, 1.0), 160, 160),
])
def test_flat_domains_get_layers(half, asked, expected):
    volume = Volume(Box((0.0, 0.0, 0.0), half), Medium((1.0,) * 3, (0.0,) * 3))
    assert light_resolution(volume, {"light_resolution": asked}) == expected
