# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays as images that materials read."""

from __future__ import annotations

import bpy
import numpy as np


def packed(pixels: np.ndarray, name: str) -> bpy.types.Image:
    """A linear float image of (rows, columns, channels <= 4), row 0 at the bottom, packed into the file; what is missing is 1."""
    rows, columns, channels = pixels.shape
    rgba = np.ones((rows, columns, 4), np.float32)
    rgba[..., :channels] = pixels
    result = bpy.data.images.new(name, columns, rows, alpha=False, float_buffer=True, is_data=True)
    result.pixels.foreach_set(rgba.ravel())
    result.update()
    result.pack()
    return result
