# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity maps: the transmittance along rays in few numbers, with the error of having so few.

Each map is built from the extinction along rays over [0, length], length > 0 metres (...,), given as

    an array (..., n), its means per metre over n equal slices, constant in each of them, or
    a callable of depths (m,) in metres that returns (..., m); it takes one length for all rays, is
    averaged over ``slices`` slices by Gauss-Legendre rules of 4 points.

All maps have one shape: ``transmittance(depth)`` for depths >= 0 metres, which broadcast with the rays'
leading shape and count as ``length`` beyond it; ``error_estimate`` (...,), the largest error of that
transmittance, measured against the slices' own at four depths in each (a callable adds the change
that half as many slices make); and ``numbers``, how many are stored for a ray.

All functions raise ValueError for NaN and for arguments out of range.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from . import checks
from .quadrature import gauss_legendre

_DEPTHS_PER_SLICE = 4
_OPAQUE = 1e290  # optical depth; sums of larger ones might overflow
_NODES, _WEIGHTS = gauss_legendre(4)


class OpacityMap(NamedTuple):
    """Tabulated transmittance along rays; see the module."""

    length: np.ndarray  # metres, broadcasts with the rays
    table: tuple[np.ndarray, ...]  # stored numbers, the rays' axes first
    look_up: Callable  # (fraction of the length, *table) -> transmittance before clipping
    numbers: int
    error_estimate: np.ndarray

    def transmittance(self, depth):
        """Transmittance in [0, 1] from 0 to ``depth``, >= 0 metres, infinity included."""
        depth = checks.nonnegative_or_infinite("depth", depth, "metres", "measure from the start of the map")
        fraction = np.minimum(depth, self.length) / self.length
        return np.clip(self.look_up(fraction, *self.table), 0.0, 1.0)[()]


def extinction_volume(extinction, length, count, slices=256):
    """Optical depth at ``count`` + 1 equally spaced depths, linear between them: monotone.

    It is that of a froxel grid, integrated front to back. Source: Wronski, Volumetric fog, SIGGRAPH 2014.
    """
    samples = _samples(extinction, length, slices)
    count = _count("count", count, 1)
    ends = np.linspace(0.0, 1.0, count + 1).reshape(-1, *[1] * (samples.depth.ndim - 1))
    table = np.moveaxis(_interpolated(ends, samples.depth), 0, -1)
    return _map(samples, (table,), lambda x, tau: np.exp(-_interpolated(x, tau)), count)


def deep_shadow_map(extinction, length, tolerance, slices=256):
    """Polyline through the transmittance with as few nodes as a greedy search finds: monotone.

    Within ``tolerance``, in (0, 1), at the end of every slice; between them the error exceeds it by
    no more than the exponential bends within a slice. From each node the search goes on while one
    falling straight line passes all ends that closely, keeping the window of its slopes. ``numbers``
    are two for each node of the ray with most.
    Source: Lokovic and Veach, Deep shadow maps, SIGGRAPH 2000.
    """
    samples = _samples(extinction, length, slices)
    tolerance = checks.checked(
        "tolerance", tolerance, lambda x: (x > 0) & (x < 1), "in (0, 1)", "use such as 0.01 of the light"
    )
    exact = np.exp(-samples.depth)
    shape, last = exact.shape[:-1], exact.shape[-1] - 1
    start, level = np.zeros(shape), np.ones(shape)
    # Slopes per slice; none is below -1 - tolerance.
    steepest, flattest = np.full(shape, -2.0), np.zeros(shape)
    node = np.zeros(exact.shape, dtype=bool)
    value = np.ones(exact.shape)
    for i in range(1, last + 1):
        run = i - start
        low = (exact[..., i] - tolerance - level) / run
        high = (exact[..., i] + tolerance - level) / run
        ended = (low > flattest) | (high < steepest)
        level = np.where(ended, level + (steepest + flattest) / 2 * (run - 1), level)
        node[..., i - 1] |= ended
        value[..., i - 1] = level
        start = np.where(ended, i - 1, start)
        low = np.where(ended, exact[..., i] - tolerance - level, low)
        high = np.where(ended, exact[..., i] + tolerance - level, high)
        steepest = np.where(ended, low, np.maximum(steepest, low))
        flattest = np.where(ended, np.minimum(high, 0.0), np.minimum(flattest, high))
    node[..., 0] = node[..., last] = True
    value[..., last] = level + (steepest + flattest) / 2 * (last - start)

    # The nodes first, in order; rays with fewer repeat their last.
    most = int(np.max(np.sum(node, axis=-1), initial=2))
    order = np.argsort(~node, axis=-1, kind="stable")[..., :most]
    order = np.where(np.take_along_axis(node, order, axis=-1), order, last)
    table = order / last, np.take_along_axis(value, order, axis=-1)
    return _map(samples, table, _polyline, 2 * most)


def fourier_opacity_map(extinction, length, frequencies, slices=256):
    """Extinction as a Fourier series, its constant and ``frequencies`` cosines and sines, integrated in closed form.

    Not monotone: it rings where the extinction jumps.
    Source: Jansen and Bavoil, Fourier opacity mapping, I3D 2010.
    """
    samples = _samples(extinction, length, slices)
    k = 2 * np.pi * np.arange(1, _count("frequencies", frequencies, 0) + 1)
    ends = np.linspace(0.0, 1.0, samples.depth.shape[-1])[:, np.newaxis]
    density = np.diff(samples.depth, axis=-1) * (len(ends) - 1)
    cosines = 2 * density @ np.diff(np.sin(k * ends) / k, axis=0)
    sines = 2 * density @ np.diff(-np.cos(k * ends) / k, axis=0)

    def look_up(x, mean, cosines, sines):
        angle = k * x[..., np.newaxis]
        waves = cosines * np.sin(angle) + sines * (1 - np.cos(angle))
        return np.exp(-np.maximum(mean * x + np.sum(waves / k, axis=-1), 0.0))

    return _map(samples, (samples.depth[..., -1], cosines, sines), look_up, 1 + 2 * len(k))


def dct_opacity_map(extinction, length, count, slices=256):
    """The transmittance itself as ``count`` cosines, the first of its discrete cosine transform.

    There is one for each slice at most. Not monotone.
    Source: Delalandre, Gautron, Marvie and François, Transmittance function mapping, I3D 2011.
    """
    samples = _samples(extinction, length, slices)
    n = samples.depth.shape[-1] - 1
    k = np.pi * np.arange(min(_count("count", count, 1), n))
    centres = (np.arange(n) + 0.5) / n
    exact = np.exp(-(samples.depth[..., 1:] + samples.depth[..., :-1]) / 2)
    coefficients = exact @ np.cos(k * centres[:, np.newaxis]) * np.where(k > 0, 2 / n, 1 / n)

    def look_up(x, coefficients):
        return np.sum(coefficients * np.cos(k * x[..., np.newaxis]), axis=-1)

    return _map(samples, (coefficients,), look_up, len(k))


# --- shared ------------------------------------------------------------------------


class _Samples(NamedTuple):
    length: np.ndarray
    depth: np.ndarray  # optical depth at the ends of the slices (..., n + 1)
    error: np.ndarray  # of the transmittance, from the slices' own number


def _samples(extinction, length, slices):
    length = checks.positive("length", length, "metres", "tabulate over the part inside the medium")
    if callable(extinction):
        if length.ndim:
            raise ValueError(f"length must be one number for a callable extinction, got shape {length.shape}; pass arrays")
        slices = _count("slices", slices, 2)
        depths = (np.arange(slices)[:, np.newaxis] + 0.5 + _NODES / 2) * (length / slices)
        values = _extinction(extinction(depths.ravel()))
        if values.shape[-1:] != (depths.size,):
            raise ValueError(f"extinction(depths) must have shape (..., {depths.size}), got {values.shape}; depths go last")
        means = values.reshape(*values.shape[:-1], slices, -1) @ (_WEIGHTS / 2)
    else:
        means = _extinction(extinction)
        if means.ndim == 0 or means.shape[-1] == 0:
            raise ValueError(f"extinction must have shape (..., n), n > 0, got {means.shape}; put the slices last")
    with np.errstate(over="ignore"):
        steps = means * (length[..., np.newaxis] / means.shape[-1])
        tau = np.minimum(np.cumsum(steps, axis=-1), _OPAQUE)
    tau = np.concatenate([np.zeros((*tau.shape[:-1], 1)), tau], axis=-1)
    error = np.zeros(tau.shape[:-1])
    if callable(extinction):
        even = tau[..., ::2]
        halved = np.exp(-(even[..., 1:] / 2 + even[..., :-1] / 2))
        error = np.max(np.abs(halved - np.exp(-tau[..., 1::2][..., : halved.shape[-1]])), axis=-1)
    return _Samples(length, tau, error)


def _map(samples, table, look_up, numbers):
    """The map with its largest error over the depths that are compared."""
    result = OpacityMap(samples.length, table, look_up, numbers, samples.error)
    count = _DEPTHS_PER_SLICE * (samples.depth.shape[-1] - 1)
    worst = np.zeros(samples.depth.shape[:-1])
    for fraction in np.linspace(0.0, 1.0, count + 1):
        exact = np.exp(-_interpolated(np.array(fraction), samples.depth))
        worst = np.maximum(worst, np.abs(result.transmittance(fraction * samples.length) - exact))
    rounding = samples.depth.shape[-1] * np.finfo(np.float64).eps
    return result._replace(error_estimate=(worst + samples.error + rounding)[()])


def _interpolated(x, values):
    """Values (rays..., n + 1) at equal steps over [0, 1], linear between, at fractions x that broadcast with the rays."""
    n = values.shape[-1] - 1
    before = np.minimum((x * n).astype(np.intp), n - 1)
    part = x * n - before
    return _taken(values, before) * (1 - part) + _taken(values, before + 1) * part


def _polyline(x, places, values):
    """Linear between nodes at the given places, of which the last may repeat."""
    before = np.sum(places[..., 1:-1] <= x[..., np.newaxis], axis=-1)
    start, end = _taken(places, before), _taken(places, before + 1)
    part = (x - start) / np.where(end > start, end - start, 1.0)
    return _taken(values, before) * (1 - part) + _taken(values, before + 1) * part


def _taken(values, index):
    """The element of each ray's last axis that ``index``, broadcasting with the rays, names."""
    *shape, count = values.shape
    rays = np.arange(np.prod(shape, dtype=int)).reshape(shape)
    return values.reshape(rays.size, count)[rays, index]


def _extinction(value):
    return checks.nonnegative("extinction", value, "per metre", "clip or mask it")


def _count(name, value, least):
    if not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} must be an integer >= {least}, got {value!r}; more give a smaller error")
    return int(value)
