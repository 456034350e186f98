# SPDX-License-Identifier: GPL-3.0-or-later
"""Summed-area table of a voxel grid: the mean of a volume over any box or ball at the cost of a few look-ups.

S[i, j, k] is the sum of the cells before plane i, j and k. The values are constant in each cell and 0 outside the grid, so
that the integral over a box is the alternating sum of S at its eight corners, S read trilinearly between the planes: exact
for corners anywhere. A ball is replaced by a cube and six plates on its faces. Their three sizes give them the ball's
volume and its moments of x^2 and x^4; all odd moments vanish by symmetry. Means are therefore exact for polynomials of
third degree; of the fourth only x^2 y^2 is off, by 5 %. The plates overlap at the cube's edges, where they count twice.

Source: Crow, Summed-area tables for texture mapping, SIGGRAPH 1984; for volumes Diaz et al., Real-time ambient occlusion
and halos with summed area tables, Computers & Graphics 34 (2010).
"""

from __future__ import annotations

import numpy as np

from . import checks

Array = np.ndarray

# Half size of the cube, half width of the plates and where they end, in radii: the real root of the three equations.
CUBE, WIDTH, REACH = 0.41675474767080280, 0.54472670528377677, 0.92363441422586031
# The cube and the plates as (low, high) corners in radii.
_BALL = np.array([[(-CUBE,) * 3, (CUBE,) * 3]] + [
    [[low if k == axis else -WIDTH for k in range(3)], [high if k == axis else WIDTH for k in range(3)]]
    for axis in range(3) for low, high in ((CUBE, REACH), (-REACH, -CUBE))])
# Points are summed in tiles of so many.
_TILE = 1 << 15


class SummedArea:
    """The table of ``values`` (nx, ny, nz), finite, of equal cells that fill the box from ``low`` to ``high`` (3,) in m.

    Raises ValueError for other values or an empty box.
    """

    def __init__(self, values, low, high):
        values = checks.finite("values", values, "any unit", "clip or mask the grid")
        if values.ndim != 3 or values.size == 0:
            raise ValueError(f"values must have shape (nx, ny, nz), none of them 0, got {values.shape}; fill each cell")
        self.low, self.high = checks.vector("low", low, "metres"), checks.vector("high", high, "metres")
        if self.low.shape != (3,) or self.high.shape != (3,):
            raise ValueError(f"low and high must have shape (3,), got {self.low.shape} and {self.high.shape}; give one box")
        checks.positive("high - low", self.high - self.low, "metres", "exchange or widen the corners")
        self.shape = values.shape
        self.cell = (self.high - self.low) / self.shape
        self.bounds = min(0.0, values.min()), max(0.0, values.max())
        self.scale = float(np.max(np.abs(values))) or 1.0  # keeps the sums finite
        self.sums = np.zeros(tuple(n + 1 for n in values.shape))
        self.sums[1:, 1:, 1:] = (values / self.scale).cumsum(axis=0).cumsum(axis=1).cumsum(axis=2)

    def mean_in_box(self, low, high) -> Array:
        """Mean over boxes with corners ``low`` < ``high`` (..., 3) in metres, the zeros outside the grid included."""
        low, high = checks.vector("low", low, "metres"), checks.vector("high", high, "metres")
        checks.positive("high - low", high - low, "metres", "exchange or widen the corners")
        return self._mean(_tiled(self._integral, low, high), np.prod((high - low) / self.cell, axis=-1))

    def mean_in_ball(self, center, radius) -> Array:
        """Mean over balls around ``center`` (..., 3) of ``radius`` > 0 (...) in metres, zeros outside the grid included.

        Exact where the values are a cubic polynomial around the centre, to the size of the cells; see the module.
        With edges it is coarser: where a plane cuts the ball, the mean is within 0.01 of the full value; of a ball that is
        exactly full, all around it empty, it is 0.92.
        """
        center = checks.vector("center", center, "metres")
        radius = checks.positive("radius", radius, "metres", "use the mean free path")[..., np.newaxis]
        cells = 4.0 / 3.0 * np.pi * np.prod(radius / self.cell, axis=-1)
        return self._mean(_tiled(self._ball_integral, center, radius), cells)

    def _mean(self, total: Array, cells: Array) -> Array:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            return np.clip(np.nan_to_num(self.scale * (total / cells)), *self.bounds)[()]

    def _ball_integral(self, center: Array, radius: Array) -> Array:
        return sum(self._integral(center + radius * low, center + radius * high) for low, high in _BALL)

    def _integral(self, low: Array, high: Array) -> Array:
        """Integral over boxes, in cells."""
        ends = [(np.clip(corner, self.low, self.high) - self.low) / self.cell for corner in (low, high)]
        return sum((-1) ** (3 - x - y - z) * self._before(ends[x][..., 0], ends[y][..., 1], ends[z][..., 2])
                   for x in (0, 1) for y in (0, 1) for z in (0, 1))

    def _before(self, *place: Array) -> Array:
        """The sum of all cells, and parts of cells, before the planes."""
        below = [np.minimum(x.astype(np.intp), n - 1) for x, n in zip(place, self.shape)]
        part = [x - i for x, i in zip(place, below)]
        total = 0.0
        for corner in range(8):
            at = [corner >> k & 1 for k in range(3)]
            weight = np.prod([part[k] if at[k] else 1.0 - part[k] for k in range(3)], axis=0)
            total = total + weight * self.sums[tuple(below[k] + at[k] for k in range(3))]
        return total


def _tiled(function, first: Array, second: Array) -> Array:
    """``function`` over the broadcast rows (n, 3) and (n, 3 or 1) of its arguments, in tiles."""
    shape = np.broadcast_shapes(first.shape[:-1], second.shape[:-1])
    first, second = (np.broadcast_to(x, (*shape, x.shape[-1])).reshape(-1, x.shape[-1]) for x in (first, second))
    parts = [function(first[i : i + _TILE], second[i : i + _TILE]) for i in range(0, len(first), _TILE)]
    return np.concatenate([np.zeros(0), *parts]).reshape(shape)
