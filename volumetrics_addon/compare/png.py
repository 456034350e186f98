# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG files of 8-bit images, with the standard library only (PNG specification, 3rd edition)."""

import os
import struct
import uuid
import zlib
from pathlib import Path

import numpy as np

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOR_TYPES = {3: 2, 4: 6}  # RGB, RGB with straight alpha
_FILTER_UP = 2


def encode_png(image):
    """Bytes of a PNG of a uint8 image (h, w, 3) or (h, w, 4), declared as sRGB.

    Raises ValueError for another type or shape.
    """
    image = np.asarray(image)
    if image.dtype != np.uint8:
        raise ValueError(
            f"image must be uint8, got {image.dtype}: the file holds 8 bits; use "
            "report.display for linear radiance"
        )
    if image.ndim != 3 or image.shape[2] not in _COLOR_TYPES or 0 in image.shape:
        raise ValueError(
            f"image must have the shape (height, width, 3 or 4), got {image.shape}: give RGB or "
            "RGBA"
        )
    height, width, channels = image.shape
    header = struct.pack(">IIBBBBB", width, height, 8, _COLOR_TYPES[channels], 0, 0, 0)
    return b"".join(
        (
            _SIGNATURE,
            _chunk(b"IHDR", header),
            _chunk(b"sRGB", b"\x00"),
            _chunk(b"IDAT", zlib.compress(_scanlines(image), 6)),
            _chunk(b"IEND", b""),
        )
    )


def write_png(path, image):
    """Write `encode_png(image)` to `path`, whole or not at all, and return the path.

    The bytes go to a temporary file beside it, which then takes its place.
    """
    path = Path(path)
    data = encode_png(image)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def _chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _scanlines(image):
    """Rows as differences from the row above, modulo 256, each after its filter's number."""
    rows = image.reshape(image.shape[0], -1)
    filtered = np.empty((rows.shape[0], rows.shape[1] + 1), dtype=np.uint8)
    filtered[:, 0] = _FILTER_UP
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    return filtered.tobytes()
