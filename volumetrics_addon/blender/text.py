# SPDX-License-Identifier: GPL-3.0-or-later
"""Text as an array, drawn with Blender's own interface font. Works without a window.

`blf` draws into an image buffer that is no datablock, so nothing is left in the file. A buffer
cannot be read from Python in every version; one loaded from BMP is also written as BMP, whose
pixels are plain bytes.
"""

import math
import struct
import tempfile
from pathlib import Path

import numpy as np

_DEFAULT_FONT = 0
# Line box in units of the size, measured to hold accented capitals above and descenders, bars
# and brackets below, from 9 to 40 pixels.
_LINE_HEIGHT = 1.45
_BASELINE = 0.35
# Glyphs may reach a pixel beyond their advance on either side.
_MARGIN = 1
_BMP_HEADER = 54


def text_mask(string, size_px):
    """Coverage (height, width) in 0..1 of one line of text.

    size_px : nominal font size in pixels, > 0. Every line of a size has the same height,
    1.45 sizes, and its baseline 0.35 sizes above the lower edge, so that lines align.

    Raises ValueError for a line break or a size that is not positive.
    """
    import bpy  # noqa: F401  outside Blender its wheel brings blf and imbuf along

    import blf  # isort: skip
    import imbuf  # isort: skip

    if "\n" in string or "\r" in string:
        raise ValueError(f"string must be one line, got {string!r}: draw each line by itself")
    if not size_px > 0.0:
        raise ValueError(f"size_px must be > 0, got {size_px}: it is a height in pixels")
    blf.size(_DEFAULT_FONT, float(size_px))
    width = math.ceil(blf.dimensions(_DEFAULT_FONT, string)[0]) + 2 * _MARGIN
    height = math.ceil(_LINE_HEIGHT * size_px)
    image = imbuf.load_from_buffer(_black_bmp(width, height))
    blf.color(_DEFAULT_FONT, 1.0, 1.0, 1.0, 1.0)
    blf.position(_DEFAULT_FONT, _MARGIN, round(_BASELINE * size_px), 0.0)
    with blf.bind_imbuf(_DEFAULT_FONT, image):
        blf.draw_buffer(_DEFAULT_FONT, string)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "text.bmp")
        imbuf.write(image, filepath=str(path))
        data = path.read_bytes()
    image.free()
    return _red_of_bmp(data, width, height)


def _black_bmp(width, height):
    """A black 24-bit BMP: file header, BITMAPINFOHEADER, rows padded to four bytes."""
    size = _row_bytes(width) * height
    file_header = struct.pack("<2sIHHI", b"BM", _BMP_HEADER + size, 0, 0, _BMP_HEADER)
    info = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, size, 0, 0, 0, 0)
    return file_header + info + bytes(size)


def _red_of_bmp(data, width, height):
    # Rows run upwards and pixels are blue, green, red; white text has them equal.
    rows = np.frombuffer(data, np.uint8, _row_bytes(width) * height, _BMP_HEADER)
    rows = rows.reshape(height, -1)[::-1, : 3 * width]
    return rows[:, 2::3] / 255.0


def _row_bytes(width):
    return (3 * width + 3) // 4 * 4
