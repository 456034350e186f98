# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture files: the same linear pixels whatever the format, and files that are none."""

import struct
import zlib

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import pictures, render  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.scene import assemble  # noqa: E402

GREY, RGB, GREY_ALPHA, RGBA = 0, 2, 4, 6


def png(path, values, bits, kind):
    """A PNG of whole numbers (rows, columns, channels), as the standard describes it."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = b"".join(b"\0" + row.astype(">u2" if bits == 16 else "u1").tobytes() for row in np.array(values))
    height, width = np.shape(values)[:2]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
                     + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
    return str(path)


def linear(code):
    """sRGB as IEC 61966-2-1 defines it."""
    return code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4


@pytest.mark.parametrize("bits", [8, 16])
def test_png_is_read_as_srgb(bits, tmp_path):
    largest = 2**bits - 1
    values = np.round(np.array([[[0.0, 0.5, 1.0], [0.03, 0.2, 0.8]], [[0.9, 0.1, 0.4], [0.6, 0.7, 0.02]]]) * largest).astype(int)
    before = len(bpy.data.images)
    read = pictures.read("gobo_image", png(tmp_path / "a.png", values, bits, RGB))
    assert np.allclose(read, np.vectorize(linear)(values / largest), atol=1e-5)
    grey = pictures.read("gobo_image", png(tmp_path / "b.png", values[..., :1], bits, GREY))
    assert np.allclose(grey, np.vectorize(linear)(values[..., :1] / largest), atol=1e-5) and grey.shape == (2, 2, 3)
    assert len(bpy.data.images) == before


@pytest.mark.parametrize("bits", [8, 16])
def test_light_passes_what_is_transparent(bits, tmp_path):
    largest = 2**bits - 1
    alpha = np.array([0, largest // 2, largest]) / largest
    values = [[(largest // 5, largest // 3, 0, round(a * largest)) for a in alpha]]
    read = pictures.read("gobo_image", png(tmp_path / "a.png", values, bits, RGBA))
    color = np.vectorize(linear)(np.array([largest // 5, largest // 3, 0]) / largest)
    assert np.allclose(read[0], 1.0 + alpha[:, None] * (color - 1.0), atol=2e-5)
    values = [[(largest // 5, round(a * largest)) for a in alpha]]
    read = pictures.read("gobo_image", png(tmp_path / "b.png", values, bits, GREY_ALPHA))
    assert np.allclose(read[0], 1.0 + alpha[:, None] * (color[0] - 1.0), atol=2e-5)


def test_exr_is_linear_and_adds_no_light(tmp_path):
    values = np.array([[[0.0, 0.25, 1.0], [0.5, 7.0, 0.125]]])
    render.write_exr(tmp_path / "a.exr", values)
    assert np.array_equal(pictures.read("gobo_image", str(tmp_path / "a.exr")), np.minimum(values, 1.0))


@pytest.mark.parametrize(("path", "reason"), [
    ("", "names no file; choose a picture"), ("missing.png", "missing.png: there is no such file .*check the path"),
    (".", "no such file"), ("text.png", "text.png: Blender finds no picture in the file; save it as")])
def test_what_is_no_picture_is_refused_by_its_name(path, reason, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.png").write_text("no picture")
    values = FAMILIES["godray"].check({"light": "projector", "gobo": "image", "gobo_image": str(tmp_path / path) if path else ""})
    before = len(bpy.data.images)
    with pytest.raises(ValueError, match=f"gobo_image .*{reason}"):
        assemble.ASSEMBLERS["godray"](values, None)
    assert len(bpy.data.images) == before


def test_the_picture_stands_upright_in_the_beam(tmp_path):
    """Red above, blue at the lower right: row 0 at the top, column 0 on the left, seen from the light."""
    file = png(tmp_path / "a.png", [[(255, 0, 0), (255, 0, 0)], [(0, 0, 0), (0, 0, 255)]], 8, RGB)
    values = FAMILIES["godray"].check({"light": "projector", "gobo": "image", "gobo_image": file, "gobo_resolution": 2})
    (light,) = assemble.ASSEMBLERS["godray"](values, None).lights
    assert np.allclose(light.gobo, [[(1, 0, 0), (1, 0, 0)], [(0, 0, 0), (0, 0, 1)]])
