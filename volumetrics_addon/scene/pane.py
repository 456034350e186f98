# SPDX-License-Identifier: GPL-3.0-or-later
"""What lies on a pane, and where: the same picture for the reference and for both engines.

A picture is (rows, columns, 2) float32, row 0 at the lower end of the pane's second axis, looked up between pixel centres. Its
first channel u orders the points of the pane: it is their rank, evenly spread over [0, 1], by the distance to the nearest lead
or to the edge of the pane, or by fractal noise. So the opaque share is the coverage c exactly, whatever the pattern:

    kappa(u) = clamp(1/2 + (c - u) / w, 0, 1),   w = 2 softness min(c, 1 - c),   mean of kappa over u in [0, 1] = c.

The second channel is a number of the cell in [0, 1) that turns its absorption about the grey axis; see ``turned_absorption``.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from . import noise
from .gobo import cell_hash
from .model import Cover, Volume

Array = np.ndarray

CELL_PIXELS, MOST_PIXELS, FEWEST_PIXELS = 64, 1024, 128  # across a cell or speck, along the pane's longer side
SHARPEST = 1e-6  # of the width w: a hard edge
GREY_AXIS = np.ones(3) / math.sqrt(3.0)


def axes_of(volume: Volume) -> tuple[int, int]:
    """The two axes of the domain along which a pane extends."""
    first, second = (axis for axis in range(3) if volume.domain.half[axis] > 0.0)
    return first, second


def normal_of(volume: Volume) -> Array:
    """Unit normal (3,) of a pane."""
    return np.array(volume.domain.axes[volume.domain.half.index(0.0)])


def size_of(volume: Volume) -> tuple[float, float]:
    """Width and height (m) of a pane along its two axes."""
    return tuple(2.0 * volume.domain.half[axis] for axis in axes_of(volume))


@lru_cache(maxsize=8)
def picture(cover: Cover, width: float, height: float) -> Array:
    """The picture of a cover on a pane of this size (m)."""
    longer = max(width, height)
    pixels = min(MOST_PIXELS, max(FEWEST_PIXELS, CELL_PIXELS * math.ceil(longer / cover.size)))
    columns, rows = (max(8, round(pixels * side / longer)) for side in (width, height))
    x, y = np.meshgrid(*((np.arange(n) + 0.5) / n * side / cover.size for n, side in ((columns, width), (rows, height))))
    result = np.zeros((rows, columns, 2), np.float32)
    if cover.pattern == "lead":
        value, result[..., 1] = _cells(x, y, cover.seed)
        edge = np.minimum(np.minimum(x, width / cover.size - x), np.minimum(y, height / cover.size - y))
        value = np.minimum(value, edge)
    else:
        offset = noise.seed_offset(cover.seed)
        value = noise.fractal_noise(x + offset[0], y + offset[1], np.full(x.shape, offset[2]), 5.0, 0.6)
    ranks = np.empty(value.size, np.float32)
    ranks[np.argsort(value, axis=None, kind="stable")] = (np.arange(value.size) + 0.5) / value.size
    result[..., 0] = ranks.reshape(value.shape)
    return result


def _cells(x: Array, y: Array, seed: int) -> tuple[Array, Array]:
    """Distance to the nearest bisector between the random points of the cells, in cells, and the number of the point's cell."""
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)

    def point(a: Array, b: Array) -> tuple[Array, Array]:
        return a + 0.15 + 0.7 * cell_hash(a, b, seed, 0), b + 0.15 + 0.7 * cell_hash(a, b, seed, 1)

    nearest, own, number = np.full(x.shape, np.inf), [np.zeros(x.shape), np.zeros(x.shape)], np.zeros(x.shape)
    steps = [(di, dj) for di in range(-2, 3) for dj in range(-2, 3)]
    for di, dj in steps:
        px, py = point(i + di, j + dj)
        distance = np.hypot(px - x, py - y)
        nearer = distance < nearest
        nearest = np.where(nearer, distance, nearest)
        own = [np.where(nearer, new, old) for new, old in zip((px, py), own)]
        number = np.where(nearer, cell_hash(i + di, j + dj, seed, 2), number)
    edge = np.full(x.shape, np.inf)
    for di, dj in steps:
        px, py = point(i + di, j + dj)
        apart = np.hypot(px - own[0], py - own[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            bisector = ((px - x) ** 2 + (py - y) ** 2 - nearest**2) / (2.0 * apart)
        edge = np.where(apart > 1e-9, np.minimum(edge, bisector), edge)
    return edge, number


def share(cover: Cover, u: Array) -> Array:
    """Opaque share kappa of points of rank u; see the module."""
    width = max(2.0 * cover.softness * min(cover.coverage, 1.0 - cover.coverage), SHARPEST)
    return np.clip(0.5 + (cover.coverage - u) / width, 0.0, 1.0)


def looked_up(volume: Volume, position: Array) -> tuple[Array, Array]:
    """Opaque share (n,) and absorption (n, 3) per metre at positions (n, 3) on a pane."""
    cover, sigma = volume.sheet.cover, np.array(volume.medium.sigma_a)
    if cover is None or cover.pattern == "uniform":
        return np.full(len(position), cover.coverage if cover else 0.0), np.broadcast_to(sigma, position.shape)
    values = picture(cover, *size_of(volume))
    rows, columns = values.shape[:2]
    local = (position - np.array(volume.domain.center)) @ np.array(volume.domain.axes).T
    place = [np.clip(local[:, axis] / (2.0 * volume.domain.half[axis]) + 0.5, 0.0, 1.0) for axis in axes_of(volume)]
    x, y = place[0] * columns, place[1] * rows
    number = values[np.minimum(y.astype(int), rows - 1), np.minimum(x.astype(int), columns - 1), 1]
    x, y = np.clip(x - 0.5, 0.0, columns - 1.0), np.clip(y - 0.5, 0.0, rows - 1.0)
    i, j = np.minimum(x.astype(int), columns - 2), np.minimum(y.astype(int), rows - 2)
    fx, fy = x - i, y - j
    u = ((values[j, i, 0] * (1.0 - fx) + values[j, i + 1, 0] * fx) * (1.0 - fy)
         + (values[j + 1, i, 0] * (1.0 - fx) + values[j + 1, i + 1, 0] * fx) * fy)
    return share(cover, u), turned_absorption(sigma, cover.variation, number)


def turned_absorption(sigma: Array, variation: float, number: Array) -> Array:
    """The absorption (n, 3) turned about the grey axis by 2 pi variation (number - 1/2), what falls below 0 cut off.

    The sum over the channels stays but for that cut: the cells differ in hue rather than in darkness.
    """
    angle = 2.0 * np.pi * variation * (number - 0.5)
    along = GREY_AXIS * (sigma @ GREY_AXIS)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.maximum(along + (sigma - along) * c + np.cross(GREY_AXIS, sigma) * s, 0.0)
