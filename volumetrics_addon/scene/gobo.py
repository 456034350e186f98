# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that stand in a projector's light, made by formula: the same pixels for the reference and for both engines.

A picture is (rows, columns, 3), the share of the light that passes, row 0 at the top. With u, v in [-1, 1] as in
physics.projector and ``aspect`` = width / height, its pattern is evaluated at

    (x, y) = R(-rotation) (aspect u, v) / scale + drift,

and averaged over ``OVERSAMPLING``^2 points of every pixel. Patterns go on without end, so any drift shows one.
"""

from __future__ import annotations

import math

import numpy as np

from . import noise

OVERSAMPLING = 4
# The numbers of the patterns, which nodes evaluate too (blender/gobo.py).
PANE, SLAT = 0.42, 0.25  # half widths of what lets light through, in its unit cell
LEAF_DETAIL, LEAF_LEVEL, LEAF_EDGE, LEAF_RATE = 2.0, 0.56, 0.25, 0.1
WATER_LAYERS, WATER_STEP, WATER_RATE, WATER_LINE, WATER_SOFTER, WATER_FLOOR = 2, 7.5, 0.3, 0.1, 0.5, 0.12
LEAD, JITTER_LOW, JITTER = 0.12, 0.2, 0.6
PERIOD = 64  # cells after which stained glass repeats
SOFTEST = 1e-6
GLASS_PALETTE = np.array([[0.85, 0.06, 0.05], [0.06, 0.16, 0.85], [0.95, 0.62, 0.08], [0.07, 0.5, 0.16], [0.45, 0.09, 0.6],
                          [0.9, 0.85, 0.6]])


def picture(pattern: str, *, aspect: float, resolution: int, count: int, softness: float, scale: float = 1.0,
            rotation: float = 0.0, drift: tuple[float, float] = (0.0, 0.0), time: float = 0.0, seed: int = 0) -> np.ndarray:
    """The picture of ``pattern`` (see PATTERNS) with ``resolution`` pixels along its longer side.

    ``count`` panes, slats, leaves or ripples lie across the height at scale 1; ``softness`` is the share of one of them over
    which an edge fades. ``rotation`` in radians. Water also changes with ``time`` (s). Raises ValueError for an unknown pattern.
    """
    if pattern not in PATTERNS:
        raise ValueError(f"there is no gobo {pattern!r}; choose one of {', '.join(PATTERNS)}")
    x, y = _plane(aspect, resolution, scale, rotation, drift)
    value = PATTERNS[pattern](x * count / 2.0, y * count / 2.0, max(softness, SOFTEST), seed, time)
    return _averaged(value if value.ndim == 3 else np.repeat(value[..., None], 3, axis=2))


def resampled(pixels: np.ndarray, *, aspect: float, resolution: int, scale: float = 1.0, rotation: float = 0.0,
              drift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """A picture of ``pixels`` (rows, columns, 3), which at scale 1 fill the frustum and repeat beyond it.

    A pixel of the result is the mean of the given ones over its area, exactly so where the picture is not turned, scaled or
    moved, and otherwise over ``OVERSAMPLING``^2 points. Arguments as for ``picture``.
    """
    x, y = _plane(aspect, resolution, scale, rotation, drift)
    # As fine as the points of evaluation, so that none of a large file's pixels falls between them.
    rows, columns = (max(1, min(round(count * scale), max(count, given))) for count, given in zip(x.shape, pixels.shape))
    tile = np.einsum("ir,jc,rck->ijk", _area(pixels.shape[0], rows), _area(pixels.shape[1], columns), pixels, optimize=True)
    column, row = (np.floor((place + 1.0) / 2.0 * count).astype(int) % count
                   for place, count in ((x / aspect, columns), (-y, rows)))
    return _averaged(tile[row, column])


def _plane(aspect: float, resolution: int, scale: float, rotation: float,
           drift: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """The pattern's coordinates x and y at ``OVERSAMPLING``^2 points of every pixel."""
    columns, rows = (max(1, round(resolution * min(1.0, side))) for side in (aspect, 1.0 / aspect))
    u = aspect * ((np.arange(columns * OVERSAMPLING) + 0.5) / (columns * OVERSAMPLING) * 2.0 - 1.0)
    v = 1.0 - (np.arange(rows * OVERSAMPLING) + 0.5) / (rows * OVERSAMPLING) * 2.0
    u, v = np.meshgrid(u, v)
    c, s = math.cos(rotation), math.sin(rotation)
    return (c * u + s * v) / scale + drift[0], (c * v - s * u) / scale + drift[1]


def _averaged(value: np.ndarray) -> np.ndarray:
    rows, columns = (side // OVERSAMPLING for side in value.shape[:2])
    return value.reshape(rows, OVERSAMPLING, columns, OVERSAMPLING, 3).mean(axis=(1, 3))


def _area(given: int, wanted: int) -> np.ndarray:
    """Weights (wanted, given) of the mean over equal parts of a side of ``given`` pixels."""
    ends = np.arange(wanted + 1) * (given / wanted)
    pixels = np.arange(given)
    overlap = np.minimum(ends[1:, None], pixels + 1.0) - np.maximum(ends[:-1, None], pixels)
    return np.maximum(overlap, 0.0) * (wanted / given)


def _ramp(x: np.ndarray, softness: float) -> np.ndarray:
    """Smooth step from 0 to 1 around 0, ``softness`` wide."""
    t = np.clip(x / softness + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _pane(x: np.ndarray, half: float, softness: float) -> np.ndarray:
    """1 within ``half`` of the middle of each unit cell."""
    return _ramp(half - np.abs(x - np.floor(x) - 0.5), softness)


def _window(x, y, softness, seed, time):
    return _pane(x, PANE, softness) * _pane(y, PANE, softness)


def _blinds(x, y, softness, seed, time):
    return _pane(y, SLAT, softness)


def _noise(x, y, z, detail, seed):
    offset = noise.seed_offset(seed)
    return noise.fractal_noise(x + offset[0], y + offset[1], np.full(x.shape, z + offset[2]), detail, 0.5)


def _leaves(x, y, softness, seed, time):
    """Gaps in a canopy: where noise exceeds its median by a little."""
    return _ramp(_noise(x, y, LEAF_RATE * time, LEAF_DETAIL, seed) - LEAF_LEVEL, LEAF_EDGE * softness)


def _water(x, y, softness, seed, time):
    """Bright lines as the sun's caustics below waves: where two layers of noise cross their middle. The mean is near 1 / 2."""
    lines = [np.abs(2.0 * _noise(x, y, WATER_RATE * time + WATER_STEP * layer, 0.0, seed + layer) - 1.0)
             for layer in range(WATER_LAYERS)]
    width = WATER_LINE + WATER_SOFTER * softness
    return np.clip(WATER_FLOOR + sum(np.exp(-((line / width) ** 2)) for line in lines) / WATER_LAYERS, 0.0, 1.0)


def _stained_glass(x, y, softness, seed, time):
    """Cells of coloured glass with lead between them: each cell of a lattice has a random point and colour."""
    points, colors = cells(seed)
    first, second, color = np.full(x.shape, np.inf), np.full(x.shape, np.inf), np.zeros((*x.shape, 3))
    i, j = np.floor(x), np.floor(y)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            a, b = np.int64(i + di), np.int64(j + dj)
            point, glass = points[b % PERIOD, a % PERIOD], colors[b % PERIOD, a % PERIOD]
            distance = np.hypot(a + point[..., 0] - x, b + point[..., 1] - y)
            nearer = distance < first
            second = np.where(nearer, first, np.minimum(second, distance))
            first = np.where(nearer, distance, first)
            color = np.where(nearer[..., None], glass, color)
    return color * _ramp(second - first - LEAD, softness)[..., None]


def cells(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (PERIOD, PERIOD, 2) in the unit cells of stained glass and their colours (..., 3), by row and column modulo PERIOD."""
    index = (np.arange(PERIOD) + PERIOD // 2) % PERIOD - PERIOD // 2
    a, b = np.meshgrid(index, index)
    hashed = [cell_hash(a, b, seed, k) for k in range(3)]
    points = JITTER_LOW + JITTER * np.stack(hashed[:2], axis=-1)
    return points, GLASS_PALETTE[np.minimum((hashed[2] * len(GLASS_PALETTE)).astype(int), len(GLASS_PALETTE) - 1)]


def cell_hash(a: np.ndarray, b: np.ndarray, seed: int, k: int) -> np.ndarray:
    """A number in [0, 1) for each pair of whole numbers: the finaliser of MurmurHash3 (Appleby, public domain)."""
    h = (a * 73856093 ^ b * 19349663 ^ (seed * 83492791 + k * 2654435)) & 0xFFFFFFFF
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        h = ((h ^ (h >> shift)) * factor) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFFFFFF) / 2.0**32


PATTERNS = {"window": _window, "blinds": _blinds, "leaves": _leaves, "water": _water, "stained_glass": _stained_glass}
