# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples where the noise is: rectangles of the picture, each with its own number of samples a pixel.

With n samples a pixel a rectangle of A pixels, whose samples have the variance v on average, adds A v / n to the sum of squared
errors and takes A n samples. At equal samples that sum is least for n proportional to sqrt(v) (Neyman 1934), and samples times
squared error are then G^2 with G = sum A sqrt(v), where one rectangle has (sum A) (sum A v): by the inequality of Cauchy and
Schwarz never less. The variance comes from a pilot of other random numbers, so that the picture's mean stays what it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..plan.rules import MOST_SAMPLES

FLOOR = 0.2  # of the mean deviation, which every pixel is taken to have at least: a pilot does not see rare bright samples
FLOOR_CELLS = 4  # pixels of the pilot along a side over which deviations are averaged for it
LEAST_SIDE = 2  # pixels of the pilot
MOST_REGIONS = 256
MANY_SAMPLES = 1 << 10  # of which no rectangle is left with less than one


@dataclass(frozen=True)
class Region:
    """Pixels from ``left``, ``top`` up to but without ``right``, ``bottom``, row 0 at the top, and their ``samples``."""

    left: int
    top: int
    right: int
    bottom: int
    samples: int

    @property
    def pixels(self) -> int:
        return (self.right - self.left) * (self.bottom - self.top)


@dataclass(frozen=True)
class Allocation:
    """Rectangles of a pilot's pixels, (left, top, right, bottom), which cover it once, and the standard deviation of a sample in
    each, ``deviations``. ``width``, ``height``: of the pilot."""

    width: int
    height: int
    cells: tuple[tuple[int, int, int, int], ...]
    deviations: tuple[float, ...]

    def regions(self, width: int, height: int, samples: int, least: int = 1) -> list[Region]:
        """For a picture of this size with ``samples`` a pixel on average, at most; those of a rectangle are a power of two, for the
        sake of Sobol's sequence, ``least`` at least, itself one and no more than ``samples``, and what a round may have at most.
        Raises ValueError for samples < 1."""
        if samples < 1:
            raise ValueError(f"samples must be >= 1, got {samples}")
        scale = width / self.width, height / self.height
        edges = [tuple(round(edge * scale[axis % 2]) for axis, edge in enumerate(cell)) for cell in self.cells]
        shown = [(edge, deviation) for edge, deviation in zip(edges, self.deviations) if edge[0] < edge[2] and edge[1] < edge[3]]
        areas = np.array([(right - left) * (bottom - top) for (left, top, right, bottom), _ in shown], float)
        deviations = np.array([deviation for _, deviation in shown])
        level = float(areas @ deviations / areas.sum())
        share = deviations / level if level > 0.0 else np.ones_like(deviations)
        for step in range(-4, 64):  # eighths of a power of two, from above: the first that is not too many
            counts = 2.0 ** np.clip(np.round(np.log2(samples * share) - step / 8.0), math.log2(least), math.log2(MOST_SAMPLES / 2))
            if areas @ counts <= samples * areas.sum():
                break
        else:
            counts = np.full_like(areas, least)
        return [Region(*edge, int(count)) for (edge, _), count in zip(shown, counts)]


def variance_of(pictures: np.ndarray, samples: int) -> np.ndarray:
    """(height, width): variance of one sample, mean over the channels, from pictures (k, height, width, 3), k >= 2, of so many
    samples. Raises ValueError for fewer pictures."""
    if len(pictures) < 2:
        raise ValueError(f"a variance takes 2 pictures at least, got {len(pictures)}")
    return np.var(pictures, axis=0, ddof=1).mean(axis=-1) * samples


def allocate(variance: np.ndarray, seconds: float, region_seconds: float, floor: float = FLOOR) -> Allocation:
    """Rectangles that bring the picture to its error soonest.

    ``variance``: (height, width) of one sample, finite, >= 0. ``seconds``: what the samples of the whole picture take where every
    pixel has equally many, > 0; ``region_seconds``: what each rectangle adds to that, >= 0. The rectangle whose division lowers
    G most is divided, as long as that lowers seconds G^2 / G_0^2 + region_seconds (rectangles), with G of the module and G_0
    that of the whole picture. ``floor`` times the mean deviation is added to every pixel's, as the root of squares.
    """
    height, width = variance.shape
    # the mean deviation of cells, not of pixels, whose few squares tell too little of a root
    cells = [math.sqrt(variance[top:top + FLOOR_CELLS, left:left + FLOOR_CELLS].mean())
             for top in range(0, height, FLOOR_CELLS) for left in range(0, width, FLOOR_CELLS)]
    sums = np.zeros((height + 1, width + 1))
    sums[1:, 1:] = (variance + (floor * float(np.mean(cells))) ** 2).cumsum(axis=0).cumsum(axis=1)
    whole = (0, 0, width, height)
    total = first = float(_spread(sums, *whole))
    found = {whole: _division(sums, whole)}
    while first > 0.0 and len(found) < MOST_REGIONS:
        widest = max(found, key=lambda cell: found[cell][0])
        lowered, parts = found[widest]
        if parts is None or seconds * (total**2 - (total - lowered) ** 2) / first**2 <= region_seconds:
            break
        total -= lowered
        del found[widest]
        found.update({part: _division(sums, part) for part in parts})
    spreads = {cell: float(_spread(sums, *cell)) for cell in found}
    return Allocation(width, height, tuple(found), tuple(
        spreads[cell] / ((cell[2] - cell[0]) * (cell[3] - cell[1])) for cell in found))


def held_out_gain(pictures: np.ndarray, samples: int, seconds: float, region_seconds: float) -> float:
    """What an allocation gains in samples at equal error, told by pictures that it does not know: each half of them allocates for
    the other, and the lesser gain is taken. Below 1 where noise is rare bright samples, which are elsewhere the next time.

    ``pictures`` (k, height, width, 3), k >= 4; the rest as in ``allocate``. Raises ValueError for fewer pictures.
    """
    halves = [variance_of(pictures[half::2], samples) for half in (0, 1)]
    return min(gain(allocate(mine, seconds, region_seconds), other, MANY_SAMPLES) for mine, other in (halves, halves[::-1]))


def gain(allocation: Allocation, variance: np.ndarray, samples: int) -> float:
    """Samples times squared error where every pixel has equally many, over those with the rectangles at ``samples`` on average.

    ``variance`` (height, width): of one sample, at the allocation's size; any. 1 where there is none.
    """
    regions = allocation.regions(allocation.width, allocation.height, samples)
    pixels = variance.size
    error = sum(variance[one.top:one.bottom, one.left:one.right].sum() / one.samples for one in regions)
    used = sum(one.pixels * one.samples for one in regions)
    return float(variance.sum() * pixels / (error * used)) if error > 0.0 else 1.0


def _spread(sums: np.ndarray, left, top, right, bottom):
    """A sqrt(v) of rectangles, sqrt(A sum v): ``sums`` of the variance above and left of every corner."""
    inside = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return np.sqrt(np.maximum(inside, 0.0) * (right - left) * (bottom - top))


def _division(sums: np.ndarray, cell: tuple[int, int, int, int]) -> tuple[float, tuple | None]:
    """By how much the best division of a rectangle lowers G, and its two parts; None where it is too small."""
    left, top, right, bottom = cell
    own, best, parts = float(_spread(sums, *cell)), 0.0, None
    columns = np.arange(left + LEAST_SIDE, right - LEAST_SIDE + 1)
    rows = np.arange(top + LEAST_SIDE, bottom - LEAST_SIDE + 1)
    for along, halves in ((columns, lambda at: ((left, top, at, bottom), (at, top, right, bottom))),
                          (rows, lambda at: ((left, top, right, at), (left, at, right, bottom)))):
        if along.size:
            one, other = halves(along)
            lowered = own - _spread(sums, *one) - _spread(sums, *other)
            index = int(np.argmax(lowered))
            if lowered[index] > best:
                best, parts = float(lowered[index]), halves(int(along[index]))
    return best, parts
