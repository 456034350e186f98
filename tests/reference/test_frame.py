# SPDX-License-Identifier: GPL-3.0-or-later
"""The frame that integrators of single rays share: tiles, repeats, and which error is stated when."""

import math

import numpy as np
import pytest

from volumetrics_addon.reference.frame import render_rays
from volumetrics_addon.reference.result import subpixels
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import Camera, Scene

SCENE = Scene(Camera((1.0, 2.0, 3.0), (0.0, 1.0, 0.0), 1.0))
KEYWORDS = {"repeats": 4, "strata": 2, "seed": 3, "random": False}


def looked_at(origin, direction, rng):
    """Radiance that tells where the ray went, with an error of a tenth of it."""
    value = 2.0 + direction
    return value, 0.1 * value, len(value)


@pytest.mark.parametrize("tile", [1, 7, 1000])
def test_centres_are_exact_whatever_the_tile(tile):
    result = render_rays("here", looked_at, SCENE, 5, 3, **(KEYWORDS | {"strata": 0}), tile=tile)
    assert result.image.shape == (3, 5, 3) and result.integrator == "here" and len(result.repeats) == 1
    for row in range(3):
        for column in range(5):
            _, direction = geometry.camera_rays(SCENE.camera, 5, 3, np.array([column + 0.5]), np.array([row + 0.5]))
            np.testing.assert_array_equal(result.image[row, column], 2.0 + direction[0])
    np.testing.assert_allclose(result.error_estimate, 0.1 * result.image, rtol=1e-14)
    assert result.evaluations == 15 and result.systematic == pytest.approx(0.1 * result.image.mean())


def test_jittered_repeats_add_their_spread_to_the_stated_error():
    result = render_rays("here", looked_at, SCENE, 5, 3, **KEYWORDS)
    assert result.evaluations == 15 * 4 * 4 and len(result.repeats) == 4
    spread = result.repeats.std(axis=0, ddof=1) / 2.0
    np.testing.assert_allclose(result.error_estimate, np.hypot(spread, 0.1 * result.image), rtol=1e-12)
    again = render_rays("here", looked_at, SCENE, 5, 3, **KEYWORDS, tile=2)
    np.testing.assert_array_equal(again.repeats, result.repeats)


def test_what_is_random_at_the_centres_is_repeated():
    def noisy(origin, direction, rng):
        return rng.random((len(direction), 3)), np.zeros((len(direction), 3)), 1

    result = render_rays("here", noisy, SCENE, 8, 8, **(KEYWORDS | {"strata": 0, "random": True, "repeats": 200}))
    # The standard error of the mean of 200 uniform numbers.
    assert result.error_estimate.mean() == pytest.approx(math.sqrt(1.0 / 12.0 / 200.0), rel=0.02)
    single = render_rays("here", noisy, SCENE, 2, 2, **(KEYWORDS | {"strata": 0, "random": True, "repeats": 1}))
    assert np.isinf(single.error_estimate).all()


def test_progress_ends_at_one():
    seen = []
    render_rays("here", looked_at, SCENE, 5, 3, **KEYWORDS, progress=seen.append, tile=4)
    assert seen == sorted(seen) and seen[-1] == 1.0 and len(seen) == 4 * 4 * 4


def test_strata_cover_their_cells():
    cells = list(subpixels(4, 3, 3, np.random.default_rng(0)))
    assert len(cells) == 9
    for k, (x, y) in enumerate(cells):
        assert ((x % 1 * 3).astype(int) == k % 3).all() and ((y % 1 * 3).astype(int) == k // 3).all()
