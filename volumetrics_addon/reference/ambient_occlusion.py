# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumetric ambient occlusion: the environment dimmed by what is near, lights scattered once.

Each sample receives the environment's radiance times the local accessibility A of the ball of ``radius`` r around it,

    S = sigma_s [ L_environment A + sum over lights of p(cos) E T ]

with, for ``directions`` 0, the mean extinction of the ball by summed-area table, A = exp(-r sigma_mean), and for more the
mean over so many directions of light that is born evenly along r,

    A = mean over directions of (1/r) integral of exp(-integral of sigma_t over [0, s]) ds over [0, r].

A is kept on a grid of ``resolution`` cells along the longest side of the media; without absorption it is darker than the
truth, which is 1: occlusion knows no light that is scattered back. With ``transfer``, a ``TransferFunction1D`` or ``2D``,
emission and extinction come from the raw values of the scene's one Grid as in ``emission_absorption``, and the
emission is multiplied by L_environment A; lights play no part then.

Measured without ``transfer`` as in ``ambient_scattering``, mean over the truth (RMSE of the pixels over the mean):

                              sun              environment     both
    ball, r sigma_t 2, g 0    0.40  (0.76)     0.80  (0.24)    0.66  (0.42)
    ball, r sigma_t 2, g 0.8  0.16  (1.06)     0.80  (0.24)    0.71  (0.36)
    ball, r sigma_t 8, g 0    0.26  (1.04)     0.52  (0.56)    0.41  (0.73)
    ball, r sigma_t 8, g 0.8  0.05  (1.22)     0.52  (0.56)    0.37  (0.76)
    cloud of noise, g 0.8     0.08  (2.08)     0.85  (0.31)    0.77  (0.49)

Source: Hernell, Ljung and Ynnerman, Efficient ambient and emissive tissue illumination using local occlusion in
multiresolution volume rendering, Volume Graphics 2007 (directions); Schlegel, Makhinya and Pajarola, Extinction-based
shading and illumination in GPU volume ray-casting, IEEE TVCG 17 (2011) (balls of a summed-area table).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..physics import checks
from ..physics.summed_area import SummedArea
from ..physics.transfer_function import TransferFunction1D
from ..scene import geometry
from ..scene.model import Scene
from . import ambient_scattering, emission_absorption, marching
from .ambient_scattering import Lattice
from .emission_absorption import Classified, Transfer
from .result import Progress, Result

Array = np.ndarray

BIAS = ("No light that is scattered back, which matters at high albedo: on balls of optical radius 2 to 8 and a cloud the "
        "environment's image came out at 0.52 to 0.85 of the truth, the sun's, scattered once, at 0.05 to 0.40.")
SETTINGS = tuple({"resolution": resolution, "steps": steps, "directions": directions} for resolution, steps, directions in (
    (8, 8, 0), (16, 16, 0), (24, 32, 0), (16, 32, 14), (24, 48, 26), (32, 64, 50)))

SHELLS = 12  # samples along each direction

applies = emission_absorption.applies


def accessibility(lattice: Lattice, extinction: Array, radius: float, directions: int) -> Array:
    """A (nx, ny, nz, k) in [0, 1] of balls around the cells with this extinction (nx, ny, nz, k), 0 outside the lattice."""
    position = lattice.points()
    channels = [np.ascontiguousarray(channel) for channel in np.moveaxis(extinction, -1, 0)]
    gray = len(channels) == 3 and all(np.array_equal(channels[0], channel) for channel in channels[1:])
    found = [_accessibility(lattice, channel, position, radius, directions) for channel in channels[: 1 if gray else None]]
    return np.stack(found * 3 if gray else found, axis=-1).reshape(extinction.shape)


def _accessibility(lattice: Lattice, extinction: Array, position: Array, radius: float, directions: int) -> Array:
    if directions == 0:
        return np.exp(-radius * SummedArea(extinction, lattice.low, lattice.high).mean_in_ball(position, radius))
    total, step = np.zeros(len(position)), radius / SHELLS
    for direction in spiral(directions):
        depth = np.zeros(len(position))
        for shell in range(SHELLS):
            at = position + (shell + 0.5) * step * direction
            inside = ((at >= lattice.low) & (at <= lattice.high)).all(axis=1)
            # The mean over a step of transmittance, so that thick steps stay right.
            across = step * inside * lattice.read(extinction, at)
            total += np.exp(-depth) * marching.mean_transmittance(across)
            depth += across
    return total / (directions * SHELLS)


def spiral(count: int) -> Array:
    """Evenly spread directions (count, 3): Fibonacci's spiral on the sphere."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle, ring = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0)), np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def occlusion(scene: Scene, data: Classified | None, resolution: int, radius: float | None,
              directions: int) -> tuple[Lattice, Array, float]:
    """The lattice, the accessibility on it and the radius."""
    lattice = ambient_scattering.lattice_of(scene, resolution)
    if data:
        position = lattice.points()
        values = emission_absorption.values_at(data, position)
        one = isinstance(data.transfer, TransferFunction1D)
        _, sigma = data.transfer(values) if one else data.transfer(
            values, emission_absorption.values_at(data, position, data.gradient))
        grid = data.volume.medium.density
        held = geometry.contains(data.volume.domain, position) & ((position >= grid.low) & (position <= grid.high)).all(axis=1)
        extinction = (sigma * held).reshape(*lattice.shape, 1)
    else:
        extinction = sum(ambient_scattering.mean_density(volume, lattice)[..., None] * np.array(volume.medium.sigma_t)
                         for volume in scene.volumes)
    radius = default_radius(lattice) if radius is None else radius
    return lattice, accessibility(lattice, extinction, radius, directions), radius


def default_radius(lattice: Lattice) -> float:
    """An eighth of the longest side of the media (m)."""
    return float(np.max(lattice.high - lattice.low)) / 8.0


def render(scene: Scene, width: int, height: int, *, repeats: int = 1, strata: int = 0, resolution: int = 32,
           radius: float | None = None, directions: int = 0, steps: int = 64, transfer: Transfer | None = None,
           light_steps: int = marching.LIGHT_STEPS, seed: int = 0, progress: Progress | None = None) -> Result:
    """Image of the scene with the environment occluded in balls of ``radius`` (m, see ``default_radius``).

    The stated error is that of ``steps`` and ``resolution``: the difference to half as many of both. Raises ValueError
    when the integrator does not apply (see ``applies`` and ``emission_absorption.classified``) or a setting is out of range.
    """
    marching.refuse("ambient_occlusion", applies(scene))
    marching.counted("resolution", resolution, "use 16 for a preview, 48 for a final image", least=2)
    marching.counted("steps", steps, "use 16 for a preview, 128 for a final image", least=2)
    marching.counted("directions", directions, "0 takes the mean of the ball, 26 are usual", least=0)
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a final image")
    if radius is not None:
        radius = float(checks.positive("radius", radius, "metres", "leave it out to take the default"))
    data = None if transfer is None else emission_absorption.classified(scene, transfer)
    lattice, fine, radius = occlusion(scene, data, resolution, radius, directions)
    coarse_lattice, coarse, _ = occlusion(scene, data, max(1, resolution // 2), radius, directions)
    environment, dark = np.array(scene.environment), replace(scene, environment=(0.0, 0.0, 0.0))

    def column(origin: Array, direction: Array, near: Array, far: Array, count: int) -> tuple[Array, Array]:
        length = np.broadcast_to(((far - near) / count)[:, None], (len(near), count))
        t = near[:, None] + (np.arange(count) + 0.5) * length
        position = (origin[:, None] + t[..., None] * direction[:, None]).reshape(-1, 3)
        access = lattice.read(fine, position) if count == steps else coarse_lattice.read(coarse, position)
        ambient = environment * access.reshape(*t.shape, -1)
        if data:
            radiance, depth = emission_absorption.classify(data, origin, direction, near, far, count)
            return emission_absorption.composited(radiance * ambient, depth[..., None])
        source, sigma_t = (x.reshape(*t.shape, 3) for x in marching.source(
            dark, position, np.repeat(direction, count, axis=0), light_steps))
        sigma_s = emission_absorption.scattering(scene, position).reshape(source.shape)
        depth = sigma_t * length[..., None]
        source = source + sigma_s * ambient
        return emission_absorption.composited(source * length[..., None] * marching.mean_transmittance(depth), depth)

    return emission_absorption.render_columns("ambient_occlusion", scene, data, column, width, height, steps, light_steps,
                                              repeats=repeats, strata=strata, seed=seed, progress=progress)
