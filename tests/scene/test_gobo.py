# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures in a projector's light: means over areas, and a picture that repeats."""

import numpy as np
import pytest

from volumetrics_addon.scene import gobo

PIXELS = np.random.default_rng(3).random((6, 10, 3))


def literal(pixels, rows, columns, sides=400):
    """Mean of many points of every pixel, of a picture that is constant over each of its own pixels."""
    result = np.zeros((rows, columns, 3))
    for i in range(rows):
        for j in range(columns):
            y = ((i + (np.arange(sides) + 0.5) / sides) / rows * pixels.shape[0]).astype(int)
            x = ((j + (np.arange(sides) + 0.5) / sides) / columns * pixels.shape[1]).astype(int)
            result[i, j] = pixels[np.ix_(y, x)].mean(axis=(0, 1))
    return result


@pytest.mark.parametrize(("aspect", "resolution", "shape"), [(1.0, 4, (4, 4)), (2.0, 8, (4, 8)), (0.5, 13, (13, 6)),
                                                             (1.5, 20, (13, 20))])
def test_each_pixel_is_the_mean_over_its_area(aspect, resolution, shape):
    picture = gobo.resampled(PIXELS, aspect=aspect, resolution=resolution)
    assert picture.shape == (*shape, 3)
    assert np.allclose(picture, literal(PIXELS, *shape), atol=2e-3)
    assert np.allclose(picture.mean(axis=(0, 1)), PIXELS.mean(axis=(0, 1)), atol=1e-12)


def test_a_large_file_loses_no_pixel():
    """One bright pixel among a million keeps its light."""
    pixels = np.zeros((1000, 1000, 3))
    pixels[313, 620] = 1.0
    assert gobo.resampled(pixels, aspect=1.0, resolution=8).sum() == pytest.approx(3 * 64 / 1e6, rel=1e-9)
    assert gobo.resampled(pixels, aspect=1.0, resolution=8, scale=0.5).sum() == pytest.approx(3 * 64 / 1e6, rel=1e-9)


def test_drift_moves_the_picture_and_it_comes_in_again():
    """``drift`` is added to the place at which the pattern is looked up: +1 in x shows what was half a height to the right."""
    plain = gobo.resampled(PIXELS, aspect=1.0, resolution=8)
    assert np.allclose(gobo.resampled(PIXELS, aspect=1.0, resolution=8, drift=(1.0, 0.0)), np.roll(plain, -4, axis=1))
    assert np.allclose(gobo.resampled(PIXELS, aspect=1.0, resolution=8, drift=(0.0, 1.0)), np.roll(plain, 4, axis=0))
    assert np.allclose(gobo.resampled(PIXELS, aspect=1.0, resolution=8, drift=(4.0, -6.0)), plain)


def test_scale_and_rotation():
    half = gobo.resampled(PIXELS, aspect=1.0, resolution=8, scale=0.5)
    tile = gobo.resampled(PIXELS, aspect=1.0, resolution=4)
    assert np.allclose(half, np.roll(np.tile(tile, (2, 2, 1)), (2, 2), axis=(0, 1)))
    turned = gobo.resampled(PIXELS, aspect=1.0, resolution=8, rotation=np.pi / 2)  # to the left, as angles count
    assert np.allclose(turned, np.rot90(gobo.resampled(PIXELS, aspect=1.0, resolution=8)))
