# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures: tone curve, error colours, layout without overlaps, PNG files."""

import itertools
import math
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volumetrics_addon.compare import report
from volumetrics_addon.compare.png import encode_png, write_png
from volumetrics_addon.compare.statistics import Estimate, compare


def blocks(string, size):
    """A text mask in which every character is a solid block."""
    return np.ones((math.ceil(1.45 * size), math.ceil(0.6 * size * len(string)) + 2))


def comparison_of(render, reference):
    return compare(Estimate.exact(render), Estimate.exact(reference))


def images(height, width, bias=0.1, seed=1):
    reference = np.random.default_rng(seed).uniform(0.1, 2.0, (height, width, 3))
    return (1.0 + bias) * reference, reference


def report_page(shape=(12, 16), title="Title", lines=("Caption",), bias=0.1, stops=0.0):
    render, reference = images(*shape, bias)
    return report._report_page(
        render, reference, comparison_of(render, reference), title, lines, blocks, stops
    )


# Colour


def test_display_known_values():
    # sRGB of 0.18 is 0.4613; of 0.5 0.7354; above the knee 1 becomes 1 - 0.4 / e = 0.8528.
    linear = np.array([0.0, -1.0, 0.18, 0.5, 1.0])[:, None, None] * np.ones(3)
    assert report.display(linear)[:, 0, 0].tolist() == [0, 0, 118, 188, 238]
    assert report.display(linear[2:3] / 4.0, 2.0)[0, 0].tolist() == [118, 118, 118]


@given(st.lists(st.floats(0.0, 1e6), min_size=2, max_size=20), st.floats(-8.0, 8.0))
def test_display_is_monotonic(values, stops):
    shown = report.display(np.sort(values)[:, None, None] * np.ones(3), stops)
    assert np.all(np.diff(shown[:, 0, 0].astype(int)) >= 0)


def test_display_shows_faults():
    linear = np.ones((1, 3, 3))
    linear[0, 0, 1], linear[0, 1, 2] = np.nan, np.inf
    shown = report.display(linear)
    assert shown[0, 0].tolist() == shown[0, 1].tolist() == [255, 0, 255]
    assert shown[0, 2].tolist() == [238, 238, 238]


def oklab_lightness(rgb):
    """Lightness L of OKLab from sRGB bytes, straight from its definition (Ottosson 2020)."""
    c = rgb / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    lms = linear @ np.array(
        [
            [0.4122214708, 0.2119034982, 0.0883024619],
            [0.5363325363, 0.6806995451, 0.2817188376],
            [0.0514459929, 0.1073969566, 0.6299787005],
        ]
    )
    return np.cbrt(lms) @ np.array([0.2104542553, 0.7936177850, -0.0040720468])


def test_diverging_map_is_even_in_lightness_and_dark_at_zero():
    x = np.linspace(0.0, 1.0, 101)
    above = oklab_lightness(report.diverging_map(x))
    below = oklab_lightness(report.diverging_map(-x))
    # Bytes near black are coarse in L: 1/255 is 0.01 there.
    np.testing.assert_allclose(above, 0.17 + 0.76 * x, atol=0.012)
    np.testing.assert_allclose(below, above, atol=0.012)


def test_diverging_map_signs_and_limits():
    blue, dark, orange = report.diverging_map([-0.5, 0.0, 0.5]).astype(int)
    assert blue[2] > blue[0] + 80 and orange[0] > orange[2] + 80
    assert dark.max() < 30
    assert np.array_equal(report.diverging_map([-7.0, 7.0]), report.diverging_map([-1.0, 1.0]))
    assert report.diverging_map(np.zeros((4, 5))).shape == (4, 5, 3)


@given(st.floats(1e-12, 1e12))
def test_nice_scale_covers_and_is_round(value):
    scale = report.nice_scale(value)
    assert value <= scale * (1.0 + 1e-8) and scale < 2.5 * value * (1.0 + 1e-8)
    digit = scale / 10.0 ** round(math.log10(scale) - 0.35)
    assert min(abs(digit - nice) for nice in (0.5, 1.0, 2.0, 5.0)) < 1e-6


@pytest.mark.parametrize(
    ("value", "scale"),
    [(0.0, 0.01), (0.05, 0.05), (0.051, 0.1), (0.2, 0.2), (0.011, 0.02), (3.0, 5.0)],
)
def test_nice_scale_known_values(value, scale):
    assert report.nice_scale(value) == pytest.approx(scale, rel=1e-12)


def test_signed_error_is_relative_to_luminance():
    render, reference = images(3, 4, bias=-0.25)
    error, unit = report.signed_error(render, reference)
    assert unit == "%"
    np.testing.assert_allclose(error, -0.25, rtol=1e-12)
    error, unit = report.signed_error(0.5 * np.ones((3, 4, 3)), np.zeros((3, 4, 3)))
    assert unit == "W m⁻² sr⁻¹"
    np.testing.assert_allclose(error, 0.5, rtol=1e-12)


# Resampling


def test_resample_repeats_pixels_when_enlarging_by_a_whole_number():
    image = np.random.default_rng(2).random((3, 4, 3))
    expected = image.repeat(5, axis=0).repeat(5, axis=1)
    np.testing.assert_allclose(report._resample(image, 15, 20), expected, rtol=1e-12)


@given(st.integers(1, 12), st.integers(1, 12), st.integers(1, 20), st.integers(1, 20))
@settings(deadline=None)
def test_resample_keeps_the_mean(height, width, new_height, new_width):
    image = np.random.default_rng(3).random((height, width, 1))
    resampled = report._resample(image, new_height, new_width)
    assert resampled.shape == (new_height, new_width, 1)
    assert resampled.mean() == pytest.approx(image.mean(), rel=1e-12)


def test_resample_leaves_a_fault_where_it_is():
    image = np.ones((4, 4, 3))
    image[1, 2] = np.nan
    faults = np.isnan(report._resample(image, 8, 8)).any(-1)
    assert np.argwhere(faults).tolist() == [[2, 4], [2, 5], [3, 4], [3, 5]]


# Layout


def assert_sound(page):
    """Everything lies on the page, and no text on other text or on a picture."""
    painted = page.paint()
    height, width = painted.shape[:2]
    texts = [(left, top, mask.shape[1], mask.shape[0]) for left, top, mask, _ in page.texts]
    pictures = [(left, top, p.shape[1], p.shape[0]) for left, top, p in page.pictures]
    rectangles = [rectangle[:4] for rectangle in page.rectangles]
    assert texts and pictures
    for left, top, wide, tall in texts + pictures + rectangles:
        assert left >= 0 and top >= 0
        assert left + wide <= width and top + tall <= height
    for a, b in itertools.combinations(texts + pictures, 2):
        assert not overlap(a, b), (a, b)


def overlap(a, b):
    return all(a[i] < b[i] + b[i + 2] and b[i] < a[i] + a[i + 2] for i in (0, 1))


@pytest.mark.parametrize("shape", [(1, 1), (12, 16), (16, 12), (90, 5), (5, 90), (200, 700)])
def test_report_is_sound_for_every_shape(shape):
    assert_sound(report_page(shape))


@given(
    st.text(st.characters(codec="utf-8"), max_size=300),
    st.lists(st.text(max_size=200), max_size=3),
    st.floats(-0.999, 1e6),
)
@settings(max_examples=12, deadline=None)
def test_report_is_sound_for_every_text_and_number(title, lines, bias):
    assert_sound(report_page((4, 6), title, lines, bias))


def test_report_is_sound_against_black():
    black = np.zeros((6, 8, 3))
    page = report._report_page(
        black + 1e-5, black, comparison_of(black + 1e-5, black), "t", (), blocks, 0
    )
    assert_sound(page)


def test_wrapping_loses_nothing():
    page = report._Page(blocks, 200)
    text = "some words and averyverylongwordwithoutanyspacethatisbroken at the end"
    lines = page._wrapped(text, 15, 200)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    assert all(blocks(line, 15).shape[1] <= 200 for line in lines)


def test_a_line_shrinks_before_it_is_cut():
    drawn = []

    def recorded(string, size):
        drawn.append((string, size))
        return blocks(string, size)

    page = report._Page(recorded, 200)
    page.line("x" * 20, 0, 0, 16, (0, 0, 0), 170)
    assert drawn[-1] == ("x" * 20, 14)
    page.line("y" * 99, 0, 0, 16, (0, 0, 0), 170)
    assert page.texts[-1][2].shape[1] <= 170
    assert any(string.startswith("y") and string.endswith("…") for string, _ in drawn)


def test_report_shows_the_images_and_the_error():
    page = report_page((12, 16), bias=0.1)
    render, reference = images(12, 16)
    shown, expected, error = (picture for _, _, picture in page.pictures[:3])
    assert shown.shape == expected.shape == error.shape == (360, 480, 3)
    assert np.array_equal(expected[::30, ::30], report.display(reference))
    assert np.array_equal(shown[::30, ::30], report.display(render))
    # 10 % everywhere on a scale of 10 %: the end of the map.
    assert np.array_equal(error[7, 9], report.diverging_map(1.0))


def figures_of(render, reference):
    return {figure.name: figure for figure in report._figures(compare(render, reference))}


def test_figures_are_those_of_the_comparison():
    reference = Estimate.exact(np.ones((10, 10, 3)))
    value = np.ones((10, 10, 3))
    value[0, 0] = 3.0
    figures = figures_of(Estimate.from_errors(value, 0.1 * np.ones_like(value)), reference)
    assert figures["Mean error"].value == "+2.00\u00a0%"
    # 1.96 x 0.1 / sqrt(300) = 1.13 %.
    assert figures["Mean error"].note == "95\u00a0% interval +0.868\u00a0% … +3.13\u00a0%"
    assert figures["Pixels explained by noise"].value == "99.00\u00a0%"
    assert figures["95th percentile"].value == "0\u00a0%"
    assert figures["RMSE after noise"].note.startswith("20.0\u00a0% with noise")


def test_one_failing_pixel_is_not_rounded_away():
    value = np.ones((200, 200, 3))
    value[0, 0] = 2.0
    figures = figures_of(Estimate.exact(value), Estimate.exact(np.ones_like(value)))
    assert figures["Pixels explained by noise"].value == "99.99\u00a0%"


def test_unresolved_rmse_is_stated_as_a_bound():
    value = 1.0 + 0.1 * np.random.default_rng(4).standard_normal((20, 20, 3))
    result = compare(
        Estimate.from_errors(value, 0.11 * np.ones_like(value)), Estimate.exact(np.ones_like(value))
    )
    assert result.rmse_denoised == 0.0
    assert report._resolved(result).startswith("< ")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.4321, "0.432"),
        (-12.345, "−12.3"),
        (99999.0, "99999"),
        (1.234e-5, "1.23×10⁻⁵"),
        (-6.02e23, "−6.02×10²³"),
    ],
)
def test_numbers(value, text):
    assert report._number(value) == text


def test_contact_sheet_is_sound():
    linear = np.random.default_rng(5).random((9, 16, 3))
    bytes_ = np.random.default_rng(6).integers(0, 256, (30, 20, 3), dtype=np.uint8)
    cells = [
        (linear, "A label", "one line"),
        (bytes_, "B", ("x" * 80, "y")),
        (linear, "C", (), 2.0),
    ]
    for count in (1, 2, 3, 7):
        page = report._sheet_page([report.Cell(*c) for c in (cells * 3)[:count]], blocks, "T " * 60)
        assert_sound(page)
        assert len(page.pictures) == count
    sheet = report.contact_sheet(cells, blocks, "Title")
    assert sheet.dtype == np.uint8 and sheet.shape[2] == 3


def test_contact_sheet_keeps_bytes():
    image = np.arange(27, dtype=np.uint8).reshape(3, 3, 3) * 9
    page = report._sheet_page([report.Cell(image, "label")], blocks, "title")
    assert np.array_equal(page.pictures[0][2][50::100, 50::100], image)


def test_contact_sheet_needs_cells():
    with pytest.raises(ValueError, match="cells must hold >= 1 picture, got 0"):
        report.contact_sheet([], blocks, "title")


def test_report_picture_is_the_painted_page():
    render, reference = images(4, 4)
    result = comparison_of(render, reference)
    picture = report.report_picture(render, reference, result, "t", ["l"], blocks, 1.0)
    assert picture.dtype == np.uint8 and picture.shape[2] == 3
    assert picture[0, 0].tolist() == picture[-1, -1].tolist() == [15, 17, 21]


# PNG


def decoded(data):
    """A PNG read chunk by chunk after the specification; filters none and up only."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    chunks, position = {}, 8
    while position < len(data):
        (length,) = struct.unpack(">I", data[position : position + 4])
        kind, body = data[position + 4 : position + 8], data[position + 8 : position + 8 + length]
        (checksum,) = struct.unpack(">I", data[position + 8 + length : position + 12 + length])
        assert checksum == zlib.crc32(body, zlib.crc32(kind))
        chunks[kind] = body
        position += 12 + length
    assert list(chunks) == [b"IHDR", b"sRGB", b"IDAT", b"IEND"]
    width, height, depth, color, *rest = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert (depth, rest) == (8, [0, 0, 0])
    channels = {2: 3, 6: 4}[color]
    raw = zlib.decompress(chunks[b"IDAT"])
    above, rows = [0] * (width * channels), []
    for start in range(0, len(raw), width * channels + 1):
        kind, *row = raw[start : start + width * channels + 1]
        assert kind in (0, 2)
        above = [(value + up) % 256 for value, up in zip(row, above, strict=True)] if kind else row
        rows.append(above)
    return np.array(rows, dtype=np.uint8).reshape(height, width, channels)


@pytest.mark.parametrize("channels", [3, 4])
def test_png_holds_the_image(channels, tmp_path):
    image = np.random.default_rng(7).integers(0, 256, (7, 5, channels), dtype=np.uint8)
    path = write_png(tmp_path / "a.png", image)
    assert np.array_equal(decoded(path.read_bytes()), image)


def test_png_takes_views():
    image = np.random.default_rng(8).integers(0, 256, (8, 6, 3), dtype=np.uint8)[::-2, ::2]
    assert np.array_equal(decoded(encode_png(image)), image)


def test_png_replaces_whole_files_only(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(source, target):
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_png(path, np.zeros((2, 2, 3), np.uint8))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((2, 2, 3)), "must be uint8, got float64"),
        (np.zeros((2, 2), np.uint8), r"3 or 4\), got \(2, 2\)"),
        (np.zeros((0, 2, 3), np.uint8), r"got \(0, 2, 3\)"),
    ],
)
def test_png_refuses(image, message):
    with pytest.raises(ValueError, match=message):
        encode_png(image)
