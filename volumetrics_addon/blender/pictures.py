# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the user's in files, through Blender's own reader: every format that Blender knows."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np


def read(name: str, path: str) -> np.ndarray:
    """Linear pixels (rows, columns, 3) in [0, 1] of the file at ``path``, row 0 at the top, for the parameter ``name``.

    The colour space is the one that Blender gives the file: sRGB for pictures of 8 and 16 bits, linear for floats. A picture
    in grey has three equal channels, and what is transparent in it is white: the light passes it. A path that begins with //
    is relative to the saved .blend file. Raises ValueError for a path that names no picture.
    """
    if not path:
        raise ValueError(f"{name} names no file; choose a picture, or another gobo")
    file = Path(bpy.path.abspath(path))
    if not file.is_file():
        raise ValueError(f"{name} = {path}: there is no such file ({file}); check the path")
    try:
        image = bpy.data.images.load(str(file), check_existing=False)
    except RuntimeError as error:
        raise ValueError(f"{name} = {path}: cannot be read ({str(error).strip()}); check its permissions") from None
    try:
        (width, height), channels = image.size, image.channels
        if width * height * channels == 0:
            raise ValueError(f"{name} = {path}: Blender finds no picture in the file; save it as PNG, JPEG or EXR")
        pixels = np.empty(width * height * channels, np.float32)
        image.pixels.foreach_get(pixels)
        pixels = np.nan_to_num(pixels.reshape(height, width, channels)[::-1].astype(float), nan=0.0)
        # Bytes are as the file has them. Floats were made linear when they were loaded, and multiplied by their alpha.
        floats, coded = image.is_float, not image.is_float and image.colorspace_settings.name == "sRGB"
    finally:
        bpy.data.images.remove(image)
    color = np.clip(pixels[..., :3] if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2), 0.0, 1.0)
    if coded:
        color = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    if channels in (2, 4):
        alpha = np.clip(pixels[..., -1:], 0.0, 1.0)
        color = np.clip(1.0 - alpha + (color if floats else alpha * color), 0.0, 1.0)
    return color
