# SPDX-License-Identifier: GPL-3.0-or-later
"""Preintegrated ambient scattering: what the surroundings of a point scatter to it, tabulated once for all media.

Parallel light of unit irradiance falls on a homogeneous ball of optical radius tau = r sigma_t around the point. The light
that is scattered there into the angle theta (0 is forward), per steradian and per sigma_s, is

    L_o(theta, tau, g, albedo) = p(cos theta) exp(-tau) + M(theta, tau, g, albedo),

p Henyey-Greenstein's function: light that comes straight through, and light that the ball has scattered before. M is
found by Monte Carlo. From the point a path goes backwards: its directions follow p, its first flight is forced to end in
the ball, the others are free; from each of its vertices the light's way in is known in closed form (next-event
estimation), at all angles and for all albedos at once, a vertex of order n counting as albedo^n.

M spans decades. As tau tends to 0 it is the twice scattered light, albedo (1 - exp(-tau)) HG(cos theta; g^2), because
the lobes of Henyey-Greenstein multiply their mean cosines when they are folded. The table holds

    ln [ M / (albedo (1 - exp(-tau)) HG(cos theta; g^2)) ],

which is 0 at tau = 0, 0 for every tau where g = 0 and albedo = 1, and smooth between; it is read multilinearly in theta,
tau, g and albedo. What is known without computing: energy is conserved, so that without absorption the integral of L_o
over the sphere is 1 for every tau and g. For all albedos that integral is ``furnace``: what comes out of a uniform
environment of unit radiance.

Source: Ament, Sadlo and Weiskopf, Ambient Volume Scattering, IEEE TVCG 19 (2013): radiance preintegrated over spheres by
theta, r sigma_t and g. The splitting into direct and scattered light, the albedo axis and the ratio to the twice
scattered lobe are this module's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from . import checks, phase
from .quadrature import gauss_legendre

Array = np.ndarray

FORMAT = 1
DEFAULT = Path(__file__).parent / "data" / "ambient_table.npz"

THETA = np.radians([0, 5, 10, 15, 22, 30, 40, 52, 65, 80, 95, 110, 125, 140, 160, 180])
TAU = np.array([0, 0.25, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 12])
G = np.array([-0.9, -0.8, -0.65, -0.45, -0.2, 0, 0.2, 0.4, 0.55, 0.68, 0.78, 0.85, 0.9])
ALBEDO = np.array([0, 0.25, 0.45, 0.6, 0.73, 0.83, 0.9, 0.95, 0.98, 1])

BATCHES = 16  # independent groups of paths, whose spread is the statistical error
_WAVE = 1 << 15  # paths that are followed at once
_AXES = ("theta", "tau", "g", "albedo")
# Relative error of a lookup between the nodes, beyond twice the noise, that 95 of 100 random points stay below. The worst,
# up to 0.11, are thick absorbing balls with backward lobes, where hardly any light is left.
INTERPOLATION_ERROR = 0.04


@dataclass(frozen=True, eq=False)
class AmbientTable:
    """``log_ratio`` and its standard error (theta, tau, g, albedo) over ascending nodes; see the module's docstring.

    About ``samples`` path vertices per pair of tau and g were drawn from ``seed``. Arguments beyond the outermost nodes are
    read at these: optically larger balls as 12, narrower lobes as |g| = 0.9.
    """

    theta: Array
    tau: Array
    g: Array
    albedo: Array
    log_ratio: Array
    error: Array
    samples: int
    seed: int

    def scattered(self, cos_theta, tau, g, albedo) -> Array:
        """M: light scattered at least once in the ball and then at its centre by theta, in 1/sr per unit irradiance.

        cos_theta in [-1, 1], optical radius tau >= 0 (infinite allowed), g in (-1, 1), albedo in [0, 1]; all broadcast.
        Raises ValueError for other values. Relative error: ``relative_error``.
        """
        c = checks.cosine("cos_theta", cos_theta)
        tau, g, albedo = _parameters(tau, g, albedo)
        ratio = np.exp(self._read(self.log_ratio, np.arccos(c), tau, g, albedo))
        return (albedo * -np.expm1(-tau) * phase.henyey_greenstein(c, self._within(g) ** 2) * ratio)[()]

    def radiance(self, cos_theta, tau, g, albedo) -> Array:
        """L_o: the direct light p(cos_theta) exp(-tau) and ``scattered`` together, in 1/sr; same arguments."""
        tau, g, albedo = _parameters(tau, g, albedo)
        return phase.henyey_greenstein(cos_theta, g) * np.exp(-tau) + self.scattered(cos_theta, tau, g, albedo)

    def furnace(self, tau, g, albedo) -> Array:
        """Integral of L_o over the sphere, in [0, 1]: exp(-tau) + F, with F what a uniform environment of unit radiance
        scatters to the centre. 1 for albedo 1; exp(-tau) for albedo 0."""
        tau, g, albedo = _parameters(tau, g, albedo)
        ratio = np.exp(_multilinear(self._furnace_log_ratio, (self.tau, self.g, self.albedo), (tau, g, albedo)))
        return np.minimum(np.exp(-tau) + albedo * -np.expm1(-tau) * ratio, 1.0)[()]

    def relative_error(self, cos_theta, tau, g, albedo) -> Array:
        """One standard error of the table's Monte Carlo plus INTERPOLATION_ERROR, relative to ``scattered``."""
        c = checks.cosine("cos_theta", cos_theta)
        tau, g, albedo = _parameters(tau, g, albedo)
        return (self._read(self.error, np.arccos(c), tau, g, albedo) + INTERPOLATION_ERROR)[()]

    def save(self, path: str | Path) -> None:
        """Write the table as .npz, in single precision."""
        arrays = {name: getattr(self, name) for name in (*_AXES, "log_ratio", "error")}
        np.savez_compressed(path, format=FORMAT, samples=self.samples, seed=self.seed,
                            **{name: values.astype(np.float32) for name, values in arrays.items()})

    @cached_property
    def _furnace_log_ratio(self) -> Array:
        """ln of 2 pi (integral of the ratio times HG(g^2) over the cosine) at the nodes of tau, g and albedo."""
        cosine, weight = gauss_legendre(96)
        mesh = np.meshgrid(cosine, self.tau, self.g, self.albedo, indexing="ij", sparse=True)
        ratio = np.exp(self._read(self.log_ratio, np.arccos(mesh[0]), *mesh[1:]))
        return np.log(2.0 * np.pi * np.tensordot(weight, ratio * phase.henyey_greenstein(mesh[0], mesh[2] ** 2), 1))

    def _read(self, values: Array, *place) -> Array:
        return _multilinear(values, tuple(getattr(self, axis) for axis in _AXES), place)

    def _within(self, g: Array) -> Array:
        return np.clip(g, self.g[0], self.g[-1])


def _parameters(tau, g, albedo) -> tuple[Array, Array, Array]:
    return (checks.nonnegative_or_infinite("tau", tau, "(optical radius)", "multiply the radius by the extinction"),
            checks.checked("g", g, lambda x: np.abs(x) < 1, "in (-1, 1)", "at +-1 nothing is scattered aside; stay below"),
            checks.fraction("albedo", albedo))


def _multilinear(values: Array, axes: tuple[Array, ...], place) -> Array:
    """``values`` over the ascending ``axes``, interpolated at ``place`` (one broadcasting array for each axis), clamped."""
    corners = []
    for axis, x in zip(axes, place):
        below = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, max(len(axis) - 2, 0))
        above = np.minimum(below + 1, len(axis) - 1)
        gap = np.where(above > below, axis[above] - axis[below], 1.0)
        part = (np.clip(x, axis[0], axis[-1]) - axis[below]) / gap
        corners.append(((below, 1.0 - part), (above, part)))
    total = 0.0
    for corner in range(1 << len(axes)):
        index, weight = zip(*(pair[corner >> k & 1] for k, pair in enumerate(corners)))
        total = total + np.prod(np.broadcast_arrays(*weight), axis=0) * values[index]
    return total


@lru_cache(maxsize=4)
def load(path: str | Path = DEFAULT) -> AmbientTable:
    """The table of a file that ``save`` wrote; the shipped one by default. ValueError for another format."""
    with np.load(path) as file:
        if "format" not in file or int(file["format"]) != FORMAT:
            found = int(file["format"]) if "format" in file else "none"
            raise ValueError(f"format of {path} must be {FORMAT}, got {found}; build it with scripts/build_ambient_table.py")
        arrays = {name: file[name].astype(float) for name in (*_AXES, "log_ratio", "error")}
        return AmbientTable(**arrays, samples=int(file["samples"]), seed=int(file["seed"]))


def build(samples: int, seed: int = 0, theta=THETA, tau=TAU, g=G, albedo=ALBEDO, progress=None) -> AmbientTable:
    """A table of about ``samples`` path vertices for each pair of tau and g: 3 seconds each for a million."""
    theta, tau, g, albedo = (np.asarray(axis, float) for axis in (theta, tau, g, albedo))
    shape = (len(theta), len(tau), len(g), len(albedo))
    log_ratio, error = np.zeros(shape), np.zeros(shape)
    pairs = [(i, j) for i in range(len(tau)) for j in range(len(g))]
    for done, ((i, j), sequence) in enumerate(zip(pairs, np.random.SeedSequence(seed).spawn(len(pairs)))):
        if tau[i] > 0.0:
            mean, spread = ratio(theta, tau[i], g[j], albedo, samples, np.random.default_rng(sequence))
            log_ratio[:, i, j], error[:, i, j] = np.log(mean), spread / mean
        if progress:
            progress((done + 1) / len(pairs))
    return AmbientTable(theta, tau, g, albedo, log_ratio, error, samples, seed)


def ratio(theta: Array, tau: float, g: float, albedo: Array, samples: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """M / (albedo (1 - exp(-tau)) HG(cos theta; g^2)) at angles (n,) and albedos (m,), by Monte Carlo with about ``samples``
    vertices: mean and its standard error (n, m). The ball has radius tau > 0, its medium extinction 1."""
    # A path has about so many vertices: tau of free flight, or a random walk of transport length 1 / (1 - g).
    per_batch = max(1, int(samples / (1.0 + tau + tau * tau * (1.0 - g) / 2.0)) // BATCHES)
    sums = np.zeros((BATCHES, len(theta), len(albedo)))
    for start in range(0, per_batch, _WAVE // BATCHES):
        sums += _wave(theta, tau, g, albedo, min(per_batch - start, _WAVE // BATCHES), rng)
    values = sums / per_batch / phase.henyey_greenstein(np.cos(theta), g * g)[:, None]
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(BATCHES)


def _wave(theta: Array, tau: float, g: float, albedo: Array, paths: int, rng: np.random.Generator) -> Array:
    """Sums (BATCHES, n, m) over the vertices of this many paths in each batch, all followed together."""
    light = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)])
    batch = np.repeat(np.arange(BATCHES), paths)
    travel = np.broadcast_to([0.0, 0.0, 1.0], (len(batch), 3))
    position = np.zeros((len(batch), 3))
    sums = np.zeros((BATCHES, len(theta), len(albedo)))
    weight = np.ones(len(albedo))
    flight = -np.log1p(rng.random(len(batch)) * np.expm1(-tau))
    while len(batch):
        travel = _scattered_directions(travel, phase.sample_henyey_greenstein(rng.random(len(batch)), g), rng)
        position = position - flight[:, None] * travel
        inside = np.einsum("ni,ni->n", position, position) < tau * tau
        batch, travel, position = batch[inside], travel[inside], position[inside]
        along = position @ light
        square = np.einsum("ni,ni->n", position, position)[:, None]
        # Against the light's travel the ball ends at s with |position - s light| = tau.
        way_in = along + np.sqrt(np.maximum(along * along + tau * tau - square, 0.0))
        score = phase.henyey_greenstein(np.clip(travel @ light, -1.0, 1.0), g) * np.exp(-way_in)
        present, first = np.unique(batch, return_index=True)
        if len(present):
            sums[present] += np.add.reduceat(score, first)[:, :, None] * weight
        weight = weight * albedo
        flight = rng.exponential(size=len(batch))
    return sums


def _scattered_directions(direction: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Unit vectors (n, 3) at these cosines to ``direction`` and uniform azimuths: a random normal vector gives the plane."""
    across = np.cross(direction, rng.standard_normal(direction.shape))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    turned = cosine[:, None] * direction + np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))[:, None] * across
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)
