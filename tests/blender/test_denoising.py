# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Image Denoise through the compositor."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender.denoising import denoised  # noqa: E402

ROWS, COLUMNS = np.mgrid[:60, :90]
TRUTH = np.stack([level * (1.0 + 0.5 * np.sin(COLUMNS / 20.0)) * (1.0 + ROWS / 60.0) for level in (0.2, 1.0, 20.0)], axis=-1)


INSIDE = np.s_[8:-8, 8:-8]  # it knows less of a picture's border


def rmse(image, where=np.s_[:]):
    return np.sqrt(np.mean((image[where] / TRUTH[where] - 1.0) ** 2))


def test_noise_goes_and_the_picture_stays_in_its_place():
    noisy = TRUTH * np.random.default_rng(0).gamma(4.0, 0.25, (*TRUTH.shape[:2], 1))
    clean = denoised(noisy)
    assert clean.shape == TRUTH.shape and clean.dtype == np.float64
    assert rmse(clean) < 0.25 * rmse(noisy)
    assert clean.mean(axis=(0, 1)) == pytest.approx(TRUTH.mean(axis=(0, 1)), rel=0.02)


def test_a_clean_picture_keeps_its_levels():
    clean = denoised(TRUTH)
    assert rmse(clean, INSIDE) < 0.01
    assert clean.mean(axis=(0, 1)) == pytest.approx(TRUTH.mean(axis=(0, 1)), rel=0.005)


def test_the_same_picture_gives_the_same_result_and_nothing_is_left_behind():
    noisy = TRUTH * np.random.default_rng(1).gamma(4.0, 0.25, TRUTH.shape)
    first = denoised(noisy)
    count = [len(getattr(bpy.data, name)) for name in ("scenes", "images", "node_groups", "objects", "cameras")]
    np.testing.assert_array_equal(denoised(noisy), first)
    assert [len(getattr(bpy.data, name)) for name in ("scenes", "images", "node_groups", "objects", "cameras")] == count
