# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfer functions: what a scalar of volume data emits and how much it extinguishes.

``TransferFunction1D`` maps a scalar, ``TransferFunction2D`` a scalar and the magnitude of its gradient, to emission (RGB,
W m^-3 sr^-1: radiance added per metre) and extinction (1/m). Between their nodes they are linear, bilinear in 2D, and
beyond the outermost nodes constant.

Along a ray the transfer function may oscillate while the data hardly change. ``TransferFunction1D.segment`` therefore
integrates the function itself over a segment on which the scalar goes linearly from ``front`` to ``back`` (preintegrated
classification):

    tau = d integral of sigma(s(u)) du over [0, 1]
    C   = d integral of e(s(u)) exp(-d integral of sigma(s(v)) dv over [0, u]) du

Their integrals are cut where s passes a node; there sigma and e are linear, tau is exact and C a Gauss sum. Engel's table
over (front, back) for one length d of the segments is what ``preintegrated`` makes from the same sums.

Source: Engel, Kraus and Ertl, High-quality pre-integrated volume rendering, Graphics Hardware 2001; Kniss, Kindlmann and
Hansen, Multidimensional transfer functions, IEEE TVCG 8 (2002).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import checks
from .quadrature import gauss_legendre

Array = np.ndarray

_NODES, _WEIGHTS = gauss_legendre(12, 0.0, 1.0)
_MAX_DEPTH = 4.0  # optical depth over which twelve nodes keep twelve digits
_MAX_CUTS = 10  # exp(-40) of the light comes from beyond
_TILE = 1 << 13


@dataclass(frozen=True, eq=False)
class TransferFunction1D:
    """``scalar`` (n,) ascending, ``emission`` (n, 3) >= 0 and ``extinction`` (n,) >= 0 at these nodes.

    Raises ValueError for other values or shapes.
    """

    scalar: Array
    emission: Array
    extinction: Array

    def __post_init__(self) -> None:
        scalar = _ascending("scalar", self.scalar)
        emission, extinction = _coefficients(self.emission, self.extinction, scalar.shape)
        for name, value in (("scalar", scalar), ("emission", emission), ("extinction", extinction)):
            object.__setattr__(self, name, value)

    def __call__(self, scalar) -> tuple[Array, Array]:
        """Emission (..., 3) and extinction (...) of finite scalars (...)."""
        scalar = checks.finite("scalar", scalar, "the data's unit", "mask missing data")
        emission = np.stack([np.interp(scalar, self.scalar, channel) for channel in self.emission.T], axis=-1)
        return emission, np.interp(scalar, self.scalar, self.extinction)

    def segment(self, front, back, length) -> tuple[Array, Array]:
        """Radiance C (..., 3) that leaves segments at the front, and their optical depth tau (...); see the module.

        ``front`` and ``back`` are finite scalars, ``length`` >= 0 metres; all broadcast to (...). Relative error below 1e-9.
        """
        front = checks.finite("front", front, "the data's unit", "mask missing data")
        back = checks.finite("back", back, "the data's unit", "mask missing data")
        length = checks.nonnegative("length", length, "metres", "measure along the ray")
        front, back, length = np.broadcast_arrays(front, back, length)
        shape = front.shape
        front, back, length = front.ravel(), back.ravel(), length.ravel()
        radiance, depth = np.empty((front.size, 3)), np.empty(front.size)
        for start in range(0, front.size, _TILE):
            tile = slice(start, start + _TILE)
            radiance[tile], depth[tile] = self._segment(front[tile], back[tile], length[tile])
        return radiance.reshape(*shape, 3), depth.reshape(shape)[()]

    def preintegrated(self, scalar, length: float) -> tuple[Array, Array]:
        """The look-up table (n, n, 3) and (n, n) of ``segment`` over ``scalar`` (n,) at front and back, for one length."""
        scalar = _ascending("scalar", scalar)
        return self.segment(scalar[:, np.newaxis], scalar, length)

    def _segment(self, front: Array, back: Array, length: Array) -> tuple[Array, Array]:
        change = back - front
        flat = change == 0.0
        with np.errstate(over="ignore"):
            crossing = (self.scalar - front[:, None]) / np.where(flat, 1.0, change)[:, None]
        crossing = np.where(flat[:, None], 0.0, np.clip(crossing, 0.0, 1.0))
        cuts = np.sort(np.pad(crossing, ((0, 0), (1, 1)), constant_values=(0.0, 1.0)), axis=1)
        row, column = np.nonzero(np.diff(cuts, axis=1) > 0.0)
        row, low, high = self._thin(row, cuts[row, column], cuts[row, column + 1], front, change, length)
        (emission, sigma), (emission_1, sigma_1) = (self(front[row] + u * change[row]) for u in (low, high))
        size = (high - low) * length[row]
        piece = np.arange(len(row)) - np.searchsorted(row, row)
        depths = np.zeros((len(front), piece.max(initial=0) + 1))
        depths[row, piece] = size * (sigma + sigma_1) / 2.0
        before = (np.cumsum(depths, axis=1) - depths)[row, piece]
        radiance = np.zeros((len(front), 3))
        for node, weight in zip(_NODES, _WEIGHTS):
            inner = size * node * (sigma + (sigma_1 - sigma) * node / 2.0)
            sample = (weight * size * np.exp(-(before + inner)))[:, None] * (emission + node * (emission_1 - emission))
            for channel in range(3):
                radiance[:, channel] += np.bincount(row, sample[:, channel], len(front))
        return radiance, depths.sum(axis=1)

    def _thin(self, row: Array, low: Array, high: Array, front: Array, change: Array, length: Array):
        """The pieces, in turn, cut where they are optically long: at depths 4, 8, ... 40 from their fronts."""
        sigma, sigma_1 = (self(front[row] + u * change[row])[1] for u in (low, high))
        size = (high - low) * length[row]
        parts = np.clip(np.ceil(size * (sigma + sigma_1) / 2.0 / _MAX_DEPTH), 1, _MAX_CUTS + 1).astype(int)
        which = np.repeat(np.arange(len(row)), parts)
        step = np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)

        def cut(k: Array) -> Array:
            """Share u of the piece whose optical depth size (sigma u + (sigma_1 - sigma) u^2 / 2) is 4 k."""
            depth = _MAX_DEPTH * k
            first, change = (size * sigma)[which], (size * (sigma_1 - sigma))[which]
            root = np.sqrt(np.maximum(first * first + 2.0 * change * depth, 0.0))
            return np.clip(2.0 * depth / np.maximum(first + root, 1e-300), 0.0, 1.0)

        start, end = np.where(step == 0, 0.0, cut(step)), np.where(step + 1 == parts[which], 1.0, cut(step + 1))
        width = (high - low)[which]
        return row[which], low[which] + start * width, low[which] + end * width


@dataclass(frozen=True, eq=False)
class TransferFunction2D:
    """``scalar`` (n,) and ``gradient`` (m,) >= 0 ascending, ``emission`` (n, m, 3) and ``extinction`` (n, m) >= 0 there.

    ``gradient`` is the magnitude of the scalar's gradient per metre. Raises ValueError for other values or shapes.
    """

    scalar: Array
    gradient: Array
    emission: Array
    extinction: Array

    def __post_init__(self) -> None:
        scalar, gradient = _ascending("scalar", self.scalar), _ascending("gradient", self.gradient)
        checks.nonnegative("gradient", gradient, "per metre", "it is a magnitude")
        emission, extinction = _coefficients(self.emission, self.extinction, (len(scalar), len(gradient)))
        for name, value in (("scalar", scalar), ("gradient", gradient), ("emission", emission), ("extinction", extinction)):
            object.__setattr__(self, name, value)

    def __call__(self, scalar, gradient) -> tuple[Array, Array]:
        """Emission (..., 3) and extinction (...) of finite scalars and gradient magnitudes >= 0, which broadcast."""
        scalar = checks.finite("scalar", scalar, "the data's unit", "mask missing data")
        gradient = checks.nonnegative("gradient", gradient, "per metre", "it is a magnitude")
        i, x = _cell(self.scalar, scalar)
        j, y = _cell(self.gradient, gradient)
        emission, extinction = 0.0, 0.0
        for a, weight_x in ((0, 1.0 - x), (1, x)):
            for b, weight_y in ((0, 1.0 - y), (1, y)):
                weight = weight_x * weight_y
                emission = emission + weight[..., np.newaxis] * self.emission[i + a, j + b]
                extinction = extinction + weight * self.extinction[i + a, j + b]
        return emission, extinction


def gradient_magnitude(values, low, high) -> Array:
    """Magnitude (nx, ny, nz) of the gradient per metre of voxels that fill the box from ``low`` to ``high`` (3,).

    Central differences, one-sided at the faces, 0 along axes of one cell.
    """
    values = checks.finite("values", values, "the data's unit", "mask missing data")
    if values.ndim != 3 or values.size == 0:
        raise ValueError(f"values must have shape (nx, ny, nz), none of them 0, got {values.shape}; give each cell a value")
    cell = checks.positive("high - low", np.subtract(high, low), "metres", "exchange or widen the corners") / values.shape
    squares = [np.gradient(values, cell[k], axis=k) ** 2 for k in range(3) if values.shape[k] > 1]
    return np.sqrt(np.sum(squares, axis=0)) if squares else np.zeros_like(values)


def _cell(nodes: Array, x: Array) -> tuple[Array, Array]:
    """Index of the cell between nodes that holds each x, and the place in it, 0 to 1."""
    below = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
    return below, np.clip((x - nodes[below]) / (nodes[below + 1] - nodes[below]), 0.0, 1.0)


def _ascending(name: str, nodes) -> Array:
    nodes = checks.finite(name, nodes, "the data's unit", "mask missing data")
    if nodes.ndim != 1 or nodes.size < 2:
        raise ValueError(f"{name} must have shape (n,) with n >= 2, got {nodes.shape}; give the values at both ends")
    checks.positive(f"steps of {name}", np.diff(nodes), "apart", "sort the nodes; a jump is two close ones")
    return nodes


def _coefficients(emission, extinction, shape: tuple[int, ...]) -> tuple[Array, Array]:
    emission = checks.nonnegative("emission", emission, "W m^-3 sr^-1", "data cannot take light away by emitting")
    extinction = checks.nonnegative("extinction", extinction, "per metre", "use 0 where the data are clear")
    for name, value, expected in (("emission", emission, (*shape, 3)), ("extinction", extinction, shape)):
        if value.shape != expected:
            raise ValueError(f"{name} must have shape {expected}, got {value.shape}; give one for each node")
    return emission, extinction
