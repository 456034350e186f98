# SPDX-License-Identifier: GPL-3.0-or-later
"""The Chapman function against the exact optical depth around a sphere, and its limits."""

import math

import numpy as np
import pytest

from volumetrics_addon.physics.atmosphere import optical_depth
from volumetrics_addon.physics.chapman import chapman

MU = np.array([0.0, 0.003, 0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.8, 1.0])


@pytest.mark.parametrize("radius, height", ((6.36e6, 8500.0), (6.36e6, 1200.0), (3.3895e6, 11100.0)))
def test_ratio_of_depths(radius, height):
    exact = optical_depth(np.full(MU.shape, radius), MU, np.inf, 1.0, height, radius) / height
    assert chapman(radius / height, MU) == pytest.approx(exact, rel=5e-3)


def test_limits():
    assert chapman(750.0, 0.0) == pytest.approx(math.sqrt(math.pi * 750.0 / 2.0), rel=1e-12)  # Chapman 1931, level
    assert chapman(1e12, np.array([0.3, 1.0])) == pytest.approx([1.0 / 0.3, 1.0], rel=1e-5)  # a flat world


@pytest.mark.parametrize("x, mu, name", ((0.0, 0.5, "x"), (math.nan, 0.5, "x"), (700.0, -0.1, "mu"), (700.0, 1.1, "mu")))
def test_refused(x, mu, name):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        chapman(x, mu)
