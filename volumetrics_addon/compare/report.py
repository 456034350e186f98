# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a comparison: render, reference and error side by side, with their figures.

Pictures are uint8 sRGB arrays (height, width, 3) for `png.write_png`. Text comes from a callable
`text_mask(string, size) -> (h, w)` coverage in 0..1, so that this module needs no font: inside
Blender it is `blender.text.text_mask`.
"""

import math
from bisect import bisect_left
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .statistics import DARK_PIXEL_FRACTION, REQUIRED_PASS_FRACTION

# Colours, sRGB 0..255.
_BACKGROUND = (15, 17, 21)
_CARD = (24, 27, 33)
_HAIRLINE = (52, 58, 68)
_BRIGHT = (236, 238, 241)
_QUIET = (150, 159, 170)
_GOOD = (126, 211, 154)
_BAD = (255, 158, 102)
_FAULT = (255, 0, 255)

# Lengths and text sizes, pixels.
_MARGIN = 36
_GAP = 24
_ROW_GAP = 34
_PADDING = 16
_PANEL = 480
_LEAST_COLUMN = 300
_CELL = (400, 300)
_TITLE, _FIGURE, _LABEL, _BODY, _NOTE = 27, 28, 16, 15, 14
_LEAST_SIZE = 10

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec.709
_SHEET_ASPECT = 1.6
_RADIANCE = "W m⁻² sr⁻¹"


# Colour ---------------------------------------------------------------------------------------

# Values up to the knee stay linear; above, the shoulder approaches 1.
_KNEE = 0.6


def display(image, exposure_stops=0.0):
    """Linear Rec.709 (h, w, 3) to sRGB uint8, with a gentle shoulder for highlights.

    x = max(0, image) * 2**exposure_stops; up to the knee k = 0.6 y = x, above it
    y = 1 - (1 - k) exp(-(x - k) / (1 - k)), which joins with the same slope and tends to 1; then
    the sRGB curve. Not Blender's AgX: each channel by itself, monotonic, without a look of its
    own, so that render and reference are changed alike. Pixels that are not finite turn magenta.
    """
    image = np.asarray(image, dtype=np.float64)
    finite = np.isfinite(image).all(axis=-1, keepdims=True)
    x = np.where(finite, np.maximum(image, 0.0), 0.0) * 2.0**exposure_stops
    over = np.maximum(x - _KNEE, 0.0) / (1.0 - _KNEE)
    y = np.minimum(x, _KNEE) - (1.0 - _KNEE) * np.expm1(-over)
    return np.where(finite, _to_bytes(_srgb_encode(y)), np.uint8(_FAULT))


def _srgb_encode(x):
    """Linear 0..1 to sRGB 0..1 (IEC 61966-2-1)."""
    return np.where(
        x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055
    )


def _srgb_decode(y):
    """sRGB 0..1 to linear 0..1, the inverse of `_srgb_encode`."""
    return np.where(y <= 0.04045, y / 12.92, ((y + 0.055) / 1.055) ** 2.4)


def _to_bytes(y):
    return np.rint(255.0 * np.clip(y, 0.0, 1.0)).astype(np.uint8)


def diverging_map(x):
    """Colours uint8 (..., 3) for x (...) in -1..1: blue below zero, near black, orange above.

    Lightness grows evenly with |x|, and lightness and chroma are the same on both sides (OKLab),
    so the size of an error reads as brightness and its sign as hue. The centre is dark, as the
    report is: what is right recedes, what is wrong glows. Values outside are clipped to the ends.
    """
    table = _diverging_table()
    half = len(table) // 2
    x = np.clip(np.asarray(x, dtype=np.float64), -1.0, 1.0)
    return table[np.rint(half + half * x).astype(int)]


@lru_cache(maxsize=1)
def _diverging_table():
    size = np.linspace(0.0, 1.0, 513)
    below = _ramp(size, hues=(265.0, 230.0))
    above = _ramp(size, hues=(30.0, 60.0))
    return np.concatenate((below[:0:-1], above))


def _ramp(size, hues):
    """Colours from the dark centre to the light end at |x| = `size`, turning through `hues`."""
    lightness = 0.17 + 0.76 * size
    # The most colour that sRGB can show on both sides at every lightness on the way.
    chroma = 0.135 * (np.sin(math.pi * size**0.9) + 0.15 * size**2)
    hue = np.radians(hues[0] + (hues[1] - hues[0]) * size)
    return _to_bytes(_srgb_encode(_oklch_to_linear(lightness, chroma, hue)))


def _oklch_to_linear(lightness, chroma, hue):
    """OKLab in cylindrical form to linear sRGB (Ottosson 2020), hue in radians."""
    a, b = chroma * np.cos(hue), chroma * np.sin(hue)
    cones = np.stack(
        (
            lightness + 0.3963377774 * a + 0.2158037573 * b,
            lightness - 0.1055613458 * a - 0.0638541728 * b,
            lightness - 0.0894841775 * a - 1.2914855480 * b,
        ),
        axis=-1,
    )
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return cones**3 @ to_rgb.T


# Pictures -------------------------------------------------------------------------------------


def report_picture(render, reference, comparison, title, lines, text_mask, exposure_stops=0.0):
    """Render, reference and signed error side by side, with the figures of the comparison.

    render, reference : (h, w, 3) linear radiance.
    comparison : `statistics.Comparison` of the two.
    title, lines : a heading and a sequence of caption lines; long ones are wrapped.
    exposure_stops : of both images on display.

    Returns uint8 (H, W, 3).
    """
    return _report_page(
        render, reference, comparison, title, lines, text_mask, exposure_stops
    ).paint()


def _report_page(render, reference, comparison, title, lines, text_mask, exposure_stops):
    height, width = _fitted(np.shape(render)[:2], (_PANEL, _PANEL))
    column = max(width, _LEAST_COLUMN)
    page = _Page(text_mask, 3 * column + 2 * _GAP)
    _heading(page, title, lines)
    top = page.bottom + _GAP
    lefts = [_MARGIN + i * (column + _GAP) for i in range(3)]
    error, unit = signed_error(render, reference)
    scale = nice_scale(np.percentile(np.abs(error), 99.0))
    kind = "Relative error" if unit == "%" else "Difference"
    labels = ("Render", "Reference", f"{kind}, render − reference")
    pictures = (
        display(_resample(render, height, width), exposure_stops),
        display(_resample(reference, height, width), exposure_stops),
        diverging_map(_resample(error[..., None], height, width)[..., 0] / scale),
    )
    for left, label, picture in zip(lefts, labels, pictures, strict=True):
        _panel(page, left, top, column, label, picture)
    below = page.bottom + 10
    for left, mean in zip(lefts, (comparison.mean_render, comparison.mean_reference), strict=False):
        note = f"mean {_number(mean)} {_RADIANCE}{_exposure(exposure_stops)}"
        page.line(note, left, below, _NOTE, _QUIET, column)
    _color_bar(page, lefts[2], below, width, scale, unit)
    _cards(page, page.bottom + _GAP, _figures(comparison))
    return page


class Cell(NamedTuple):
    """One picture of a contact sheet.

    image : (h, w, 3), uint8 sRGB as it is, or linear radiance shown at `exposure_stops`.
    label : a heading beneath. sub_labels : one line, or a sequence of lines, under it.
    """

    image: np.ndarray
    label: str
    sub_labels: str | tuple = ()
    exposure_stops: float = 0.0


def contact_sheet(cells, text_mask, title):
    """A grid of pictures with their labels beneath. Returns uint8 (H, W, 3).

    cells : sequence of `Cell` or of tuples (image, label, sub_labels[, exposure_stops]).
    Raises ValueError without cells.
    """
    return _sheet_page([Cell(*cell) for cell in cells], text_mask, title).paint()


def _sheet_page(cells, text_mask, title):
    if not cells:
        raise ValueError(
            "cells must hold >= 1 picture, got 0: a sheet without pictures shows nothing"
        )
    box = _common_box(cells)
    columns = _columns(len(cells), box)
    page = _Page(text_mask, columns * box[1] + (columns - 1) * _GAP)
    _heading(page, title, ())
    for start in range(0, len(cells), columns):
        top = page.bottom + (_ROW_GAP if start else _GAP)
        for column, cell in enumerate(cells[start : start + columns]):
            _cell(page, _MARGIN + column * (box[1] + _GAP), top, box, cell)
    return page


def _common_box(cells):
    """Height and width that all pictures share: the middle one's shape, at most _CELL."""
    shapes = sorted((np.shape(cell.image)[:2] for cell in cells), key=lambda s: s[0] / s[1])
    height, width = _fitted(shapes[len(shapes) // 2], (_CELL[1], _CELL[0]))
    return height, max(width, _LEAST_COLUMN)


def _columns(count, box):
    """Columns that bring the sheet's shape nearest to _SHEET_ASPECT."""
    tall, wide = box[0] + 90, box[1] + _GAP
    columns = min(count, max(1, round(math.sqrt(count * _SHEET_ASPECT * tall / wide))))
    while columns < count and count % columns == 1:  # no picture alone in the last row
        columns -= 1
    return max(columns, 1)


def _cell(page, left, top, box, cell):
    height, width = _fitted(np.shape(cell.image)[:2], box)
    page.rectangle(left - 1, top - 1, box[1] + 2, box[0] + 2, _HAIRLINE)
    page.rectangle(left, top, box[1], box[0], _CARD)
    page.picture(
        _shown(cell, height, width), left + (box[1] - width) // 2, top + (box[0] - height) // 2
    )
    bottom = page.paragraph(cell.label, left, top + box[0] + 8, _LABEL, _BRIGHT, box[1])
    sub_labels = (cell.sub_labels,) if isinstance(cell.sub_labels, str) else cell.sub_labels
    for line in sub_labels:
        bottom = page.paragraph(line, left, bottom, _NOTE, _QUIET, box[1])


def _shown(cell, height, width):
    image = np.asarray(cell.image)
    if image.dtype == np.uint8:
        # Averaged in linear light, as the other pictures are.
        return _to_bytes(_srgb_encode(_resample(_srgb_decode(image / 255.0), height, width)))
    return display(_resample(image, height, width), cell.exposure_stops)


def signed_error(render, reference):
    """Signed error of luminance (h, w) and its unit, "%" or "W m⁻² sr⁻¹".

    (render - reference) / max(reference, 1 % of its mean), as a fraction; against an all-black
    reference the difference itself.
    """
    render, reference = (
        np.asarray(image, dtype=np.float64) @ _LUMINANCE for image in (render, reference)
    )
    mean = reference.mean()
    if mean <= 0.0:
        return render - reference, _RADIANCE
    return (render - reference) / np.maximum(reference, DARK_PIXEL_FRACTION * mean), "%"


def nice_scale(value):
    """The smallest 1, 2 or 5 times a power of ten that is >= value; 0.01 for zero."""
    if value <= 0.0:
        return 0.01
    power = 10.0 ** math.floor(math.log10(value))
    # A value that is such a number but for rounding keeps it.
    return next(
        step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1 + 1e-9)
    )


# Parts ----------------------------------------------------------------------------------------


def _heading(page, title, lines):
    page.paragraph(title, _MARGIN, _MARGIN - 10, _TITLE, _BRIGHT, page.content)
    for line in lines:
        page.paragraph(line, _MARGIN, page.bottom, _BODY, _QUIET, page.content)


def _panel(page, left, top, column, label, picture):
    bottom = page.line(label, left, top, _LABEL, _BRIGHT, column) + 4
    height, width = picture.shape[:2]
    page.rectangle(left - 1, bottom - 1, width + 2, height + 2, _HAIRLINE)
    page.picture(picture, left, bottom)


def _color_bar(page, left, top, width, scale, unit):
    bar = diverging_map(np.linspace(-1.0, 1.0, width))
    page.picture(np.broadcast_to(bar, (10, width, 3)), left, top + 4)
    ends = _number(100.0 * scale if unit == "%" else scale, exact=True)
    ends = f"{ends} {unit}"
    third = width // 3
    below = top + 16
    page.line(f"−{ends}", left, below, _NOTE, _QUIET, third)
    page.line("0", left + third, below, _NOTE, _QUIET, third, align=0.5)
    page.line(f"+{ends}", left + width - third, below, _NOTE, _QUIET, third, align=1.0)


class _Figure(NamedTuple):
    name: str
    value: str
    note: str
    color: tuple = _BRIGHT


def _figures(c):
    pixels = _pixel_figure(c)
    if c.mean_relative_error is None:
        mean = _Figure(
            f"Mean difference, {_RADIANCE}",
            _signed(c.mean_difference),
            _interval(c, c.mean_difference_interval, _signed),
        )
        rms = _Figure(f"RMS difference, {_RADIANCE}", _number(c.rms_difference), "noise included")
        return (mean, rms, pixels)
    mean = _Figure(
        "Mean error",
        _signed_percent(c.mean_relative_error),
        _interval(c, c.mean_relative_interval, _signed_percent),
    )
    floor = _percent(c.rmse_noise_floor)
    rmse = _Figure(
        "RMSE after noise", _resolved(c), f"{_percent(c.rmse)} with noise · floor {floor}"
    )
    single = _Figure(
        "95th percentile", _percent(c.percentile95), "error of single pixels, with noise"
    )
    return (mean, rmse, pixels, single)


def _pixel_figure(c):
    # Rounded down: one failing pixel must not read as 100 %.
    share = math.floor(c.z_pass_fraction * 1e4) / 1e4
    needed = f"{100.0 * REQUIRED_PASS_FRACTION:.2f}{_NBSP}%"
    return _Figure(
        "Pixels explained by noise",
        f"{100.0 * share:.2f}{_NBSP}%",
        f"{needed} needed · test at {_number(100.0 * c.significance, exact=True)}{_NBSP}%",
        _GOOD if c.z_pass_fraction >= REQUIRED_PASS_FRACTION else _BAD,
    )


def _interval(c, interval, written):
    low, high = interval
    if low == high:
        return "neither image has noise"
    level = f"{_number(100.0 * c.confidence, exact=True)}{_NBSP}% interval"
    return f"{level} {written(low)} … {written(high)}"


def _resolved(c):
    if c.rmse_denoised < c.rmse_noise_floor:
        return f"< {_percent(c.rmse_noise_floor)}"
    return _percent(c.rmse_denoised)


def _cards(page, top, figures):
    width = (page.content - (len(figures) - 1) * _GAP) // len(figures)
    inner = width - 2 * _PADDING
    bottoms = []
    for i, figure in enumerate(figures):
        left = _MARGIN + i * (width + _GAP) + _PADDING
        bottom = page.line(figure.name, left, top + 10, _NOTE, _QUIET, inner)
        bottom = page.line(figure.value, left, bottom, _FIGURE, figure.color, inner)
        bottoms.append(page.paragraph(figure.note, left, bottom, _NOTE, _QUIET, inner))
    for i in range(len(figures)):
        page.rectangle(_MARGIN + i * (width + _GAP), top, width, max(bottoms) + 12 - top, _CARD)


# Numbers


# Keeps a number and its unit on one line; drawn as a plain space.
_NBSP = "\u00a0"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def _number(value, exact=False):
    """Three significant digits, or no more than `exact` needs; powers of ten where it is long."""
    value = float(value)
    if value == 0.0:
        return "0"
    if not math.isfinite(value):
        return "∞" if value > 0 else "not finite"
    if 1e-3 <= abs(value) < 1e5:
        decimals = max(0, 2 - math.floor(math.log10(abs(value))))
        text = f"{value:g}" if exact else f"{value:.{decimals}f}"
    else:
        digits, power = f"{value:.{0 if exact else 2}e}".split("e")
        text = f"{digits}×10{str(int(power)).translate(_SUPERSCRIPTS)}"
    return text.replace("-", "−")


def _signed(value):
    return f"+{_number(value)}" if value > 0 else _number(value)


def _percent(fraction):
    return f"{_number(100.0 * fraction)}{_NBSP}%"


def _signed_percent(fraction):
    return f"{_signed(100.0 * fraction)}{_NBSP}%"


def _exposure(stops):
    return f" · shown at {_signed(stops)} stops" if stops else ""


# Page -----------------------------------------------------------------------------------------


class _Page:
    """Parts placed on a page that grows downwards; painted once, when its height is known."""

    def __init__(self, text_mask, content):
        self.content = content
        self.width = content + 2 * _MARGIN
        self.bottom = 0
        self.rectangles, self.pictures, self.texts = [], [], []
        self._mask = lru_cache(maxsize=None)(text_mask)

    def rectangle(self, left, top, width, height, color):
        self.rectangles.append((left, top, width, height, color))
        self.bottom = max(self.bottom, top + height)

    def picture(self, picture, left, top):
        self.pictures.append((left, top, picture))
        self.bottom = max(self.bottom, top + len(picture))

    def line(self, string, left, top, size, color, width, align=0.0):
        """One line of text, made smaller and then shortened to fit. Returns its lower edge.

        align : 0 at the left of `width`, 0.5 in its middle, 1 at its right.
        """
        string = string.replace(_NBSP, " ")
        while size > _LEAST_SIZE and self._wide(string, size) > width:
            size -= 1
        if self._wide(string, size) > width:
            string = _longest(string, lambda part: self._wide(part + "…", size) <= width) + "…"
        mask = self._mask(string, size)
        self.texts.append((left + round(align * (width - mask.shape[1])), top, mask, color))
        self.bottom = max(self.bottom, top + mask.shape[0])
        return top + mask.shape[0]

    def paragraph(self, string, left, top, size, color, width):
        """Text wrapped to `width`, words too long for a line broken. Returns its lower edge."""
        for line in self._wrapped(string, size, width):
            top = self.line(line, left, top, size, color, width)
        return top

    def _wide(self, string, size):
        return self._mask(string, size).shape[1]

    def _wrapped(self, string, size, width):
        def fits(part):
            return self._wide(part.replace(_NBSP, " "), size) <= width

        lines = [""]
        # Not split(), which would also break at non-breaking spaces.
        for word in string.replace("\n", " ").split(" "):
            longer = f"{lines[-1]} {word}".strip()
            if fits(longer):
                lines[-1] = longer
                continue
            while not fits(word):
                head = _longest(word, fits) or word[0]
                lines.append(head)
                word = word[len(head) :]
            lines.append(word)
        return [line for line in lines if line]

    def paint(self):
        """The page as uint8 (height, width, 3)."""
        canvas = np.empty((self.bottom + _MARGIN, self.width, 3))
        canvas[:] = _BACKGROUND
        for left, top, width, height, color in self.rectangles:
            canvas[top : top + height, left : left + width] = color
        for left, top, picture in self.pictures:
            height, width = picture.shape[:2]
            canvas[top : top + height, left : left + width] = picture
        for left, top, mask, color in self.texts:
            height, width = mask.shape
            area = canvas[top : top + height, left : left + width]
            area += mask[..., None] * (np.asarray(color) - area)
        return np.rint(canvas).astype(np.uint8)


def _longest(string, fits):
    """The longest beginning of `string` that fits; fitting ends once and for all."""
    lengths = range(1, len(string) + 1)
    return string[: bisect_left(lengths, True, key=lambda n: not fits(string[:n]))]


# Sizes


def _fitted(shape, box):
    """Height and width of `shape`, scaled to fill the box (height, width) without distortion."""
    scale = min(box[0] / shape[0], box[1] / shape[1])
    return tuple(max(1, round(scale * side)) for side in shape)


def _resample(image, height, width):
    """Image (h, w, c) resampled by area to (height, width, c).

    Enlarged pixels stay sharp squares, those on a border between two are mixed by their share;
    reduced images are averages.
    """
    image = np.asarray(image, dtype=np.float64)
    rows = _overlap(image.shape[0], height)
    columns = _overlap(image.shape[1], width)

    def averaged(values):
        return np.tensordot(rows, np.tensordot(columns, values, (1, 1)), (1, 1))

    faults = ~np.isfinite(image)
    # Zero times NaN is NaN: a fault must stay in its own pixel instead of filling its row.
    resampled = averaged(np.where(faults, 0.0, image))
    if faults.any():
        resampled[averaged(faults) > 0.0] = np.nan
    return resampled


def _overlap(old, new):
    """Weights (new, old): the share of each old pixel in each new one."""
    edges = np.linspace(0.0, old, new + 1)
    pixels = np.arange(old)
    high = np.minimum(edges[1:, None], pixels + 1)
    low = np.maximum(edges[:-1, None], pixels)
    return np.maximum(high - low, 0.0) * (new / old)
