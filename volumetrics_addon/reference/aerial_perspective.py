# SPDX-License-Identifier: GPL-3.0-or-later
"""Aerial perspective in a grid of froxels: light scattered towards the camera and transmittance, marched once per column.

Nodes lie on the corners of nx by ny columns over the image and at nz depths, spaced with the square of their index; the
image interpolates them trilinearly at the distance of the ground or of the end of the air. Each slice is one sample,
integrated as if its source were constant. Orders beyond the first are the isotropic closure of UniformScattering.
Source: Hillaire, A scalable and production ready sky and atmosphere rendering technique, EGSR 2020; slices and froxels
after Wronski, Volumetric fog, SIGGRAPH 2014.
"""

from __future__ import annotations

import time

import numpy as np

from ..physics.atmosphere import TransmittanceTable, UniformScattering, interpolated
from ..scene import geometry
from ..scene.model import Scene
from . import planet
from .result import Progress, Result

Array = np.ndarray

BIAS = ("Interpolation between froxels and one sample a slice; light scattered more than once is made isotropic: the sky's mean "
        "came out 8 % (noon) and 11 % (sunset) too dark with 8 x 6 x 8 froxels, 2 % and 5 % with 32 x 24 x 32.")
SETTINGS = (
    {"nx": 8, "ny": 6, "nz": 8},
    {"nx": 16, "ny": 12, "nz": 16},
    {"nx": 32, "ny": 24, "nz": 32},
    {"nx": 64, "ny": 48, "nz": 32},
    {"nx": 64, "ny": 48, "nz": 128},
    {"nx": 128, "ny": 96, "nz": 128},
)

# What the isotropic closure misses of a clear sky, as a share of its radiance: measured against the scattering tables.
CLOSURE_ERROR = 0.1
PROBED_RAYS = 256


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    view = planet.planet_of(scene)
    return view if isinstance(view, str) else ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 1, strata: int = 0, seed: int = 0, nx: int = 32,
           ny: int = 24, nz: int = 32, progress: Progress | None = None) -> Result:
    """Image of the sky from nx x ny x nz froxels, each >= 2.

    The error estimate of a pixel is the difference to half as many froxels along each axis, and shares of its radiance: the
    error of some pixels against rays marched on their own, and CLOSURE_ERROR for scenes of several orders. Raises ValueError when
    the integrator does not apply.
    """
    if min(nx, ny, nz) < 2:
        raise ValueError(f"nx, ny and nz must be >= 2, got {nx}, {ny} and {nz}; 32, 24 and 32 are usual")
    started = time.perf_counter()
    view = planet.required_view(scene, "aerial_perspective")
    transmittance = TransmittanceTable(view.planet)
    closure = UniformScattering(view.planet, min(scene.orders, 1000), transmittance) if scene.orders > 1 else None
    fine = Froxels(view, scene, width, height, (nx, ny, nz), transmittance, closure)
    coarse = Froxels(view, scene, width, height, (max(1, nx // 2), max(1, ny // 2), nz // 2), transmittance, closure)
    missing = _interpolation_error(fine, scene, width, height) + (CLOSURE_ERROR if closure else 0.0)
    return planet.image(scene, width, height, "aerial_perspective", fine.radiance, coarse.radiance, repeats=repeats,
                        strata=strata, seed=seed, progress=progress, missing=missing,
                        prepared=fine.count + coarse.count, started=started)


def _interpolation_error(froxels: Froxels, scene: Scene, width: int, height: int) -> Array:
    """Root mean square error (3,) of pixels against rays marched on their own, relative to their mean."""
    x, y = (a[:: max(1, len(a) // PROBED_RAYS)] for a in planet.centres(width, height))
    rays = geometry.camera_rays(scene.camera, width, height, x, y)
    exact = froxels.marched(*rays)
    difference = froxels.radiance(*rays)[0] - exact
    return np.sqrt((difference**2).mean(axis=0)) / np.maximum(exact.mean(axis=0), 1e-300)


class Froxels:
    """In-scatter and transmittance from the camera to the nodes (nx + 1, ny + 1, nz + 1) of the frustum.

    In-scatter is kept per component without its phase function, which is multiplied in at the pixel, and once for the
    closure. Columns that meet the ground serve only pixels that do, and the other ones the sky: else the horizon bleeds.
    """

    def __init__(self, view: planet.View, scene: Scene, width: int, height: int, counts: tuple[int, int, int],
                 transmittance: TransmittanceTable, closure: UniformScattering | None):
        self._view, self._counts, self._size, self._sun = view, counts, (width, height), transmittance
        self._camera = scene.camera
        self._closure = closure
        nx, ny, nz = counts
        x, y = np.meshgrid(np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1), indexing="ij")
        rays = view.rays(*geometry.camera_rays(scene.camera, width, height, x.ravel(), y.ravel()))
        reaching = rays.length > 0.0
        self._near = float(rays.near[reaching].min()) if reaching.any() else 0.0
        self._far = float((rays.near + rays.length)[reaching].max()) if reaching.any() else 1.0
        columns = np.concatenate(self._march(rays, nz), axis=-1)
        self.count = columns.shape[0] * columns.shape[1]
        self._grids = []
        for member in (~rays.hits, rays.hits):
            weighted = np.concatenate([columns, np.ones((*columns.shape[:2], 1))], axis=-1) * member[:, None, None]
            self._grids.append(weighted.reshape(nx + 1, ny + 1, nz + 1, -1))

    def _march(self, rays: planet.Rays, slices: int) -> tuple[Array, Array]:
        """In-scatter (n, slices + 1, 3 (components + 1)) and transmittance (n, slices + 1, 3) up to each slice."""
        count, kinds = len(rays.radius), len(self._view.planet.components) + 1
        edges = self._near + (self._far - self._near) * (np.arange(slices + 1) / slices) ** 2
        scattered = np.zeros((count, slices + 1, kinds, 3))
        clear = np.ones((count, slices + 1, 3))
        for k in range(slices):
            low, high = (np.clip(edge - rays.near, 0.0, rays.length) for edge in edges[k : k + 2])
            radius, _, mu_s = (a[:, 0] for a in rays.at(np.arange(count), (low + high)[:, None] / 2.0))
            source, extinction = self._source(radius, mu_s)
            size = (high - low)[:, None]
            passed = np.exp(-extinction * size)
            # A constant source dimmed over its own slice; without extinction its length.
            share = np.where(extinction > 0.0, (1.0 - passed) / np.where(extinction > 0.0, extinction, 1.0), size)
            scattered[:, k + 1] = scattered[:, k] + source * (clear[:, k] * share)[:, None, :]
            clear[:, k + 1] = clear[:, k] * passed
        return scattered.reshape(count, slices + 1, -1), clear

    def _source(self, radius: Array, mu_s: Array) -> tuple[Array, Array]:
        """Sources (n, components + 1, 3) and extinction (n, 3) per metre, for unit irradiance."""
        body = self._view.planet
        radius = np.clip(radius, body.radius, body.top)
        density = body.density(radius)
        each = density[:, :, None] * body.scattering
        closure = self._closure(radius, mu_s) * each.sum(axis=1) if self._closure else np.zeros((len(radius), 3))
        single = self._sun(radius, mu_s)[:, None, :] * each
        return np.concatenate([single, closure[:, None, :]], axis=1), density @ body.extinction

    def radiance(self, origin: Array, direction: Array) -> tuple[Array, int]:
        """Radiance (n, 3) along rays from the camera; the froxels were counted before."""
        rays = self._view.rays(origin, direction)
        x, y = geometry.raster(self._camera, *self._size, direction)
        depth = np.clip((rays.near + rays.length - self._near) / (self._far - self._near), 0.0, 1.0)
        coordinates = tuple(value * count for value, count in
                            zip((x / self._size[0], y / self._size[1], np.sqrt(depth)), self._counts))
        sky, ground = (interpolated(grid, coordinates) for grid in self._grids)
        value = np.where(rays.hits[:, None], ground, sky)
        # Where no column around is of the pixel's own kind, those of the other have to do.
        value = np.where(value[:, -1:] > 0.0, value, sky + ground)
        value = value[:, :-1] / value[:, -1:]
        return self._seen(rays, value[:, :-3], value[:, -3:]), 0

    def marched(self, origin: Array, direction: Array) -> Array:
        """Radiance (n, 3) along rays marched on their own, in twice as many slices."""
        rays = self._view.rays(origin, direction)
        scattered, clear = self._march(rays, 2 * self._counts[2])
        return self._seen(rays, scattered[:, -1], clear[:, -1])

    def _seen(self, rays: planet.Rays, scattered: Array, clear: Array) -> Array:
        """Radiance (n, 3) from in-scatter (n, 3 (components + 1)) and transmittance (n, 3) up to the rays' ends."""
        phases = np.concatenate([self._view.planet.phases(rays.nu), np.ones((len(rays.nu), 1))], axis=1)
        value = np.einsum("ncx,nc->nx", scattered.reshape(len(rays.nu), -1, 3), phases) * (rays.length > 0.0)[:, None]
        return value * self._view.irradiance + self._view.reflected(rays, self._irradiance, clear)

    def _irradiance(self, mu_s: Array) -> Array:
        """Irradiance (n, 3) on the ground, for unit irradiance: the sun's, and the sky's by the closure."""
        value = np.maximum(mu_s, 0.0)[:, None] * self._sun(self._view.planet.radius, mu_s)
        return value + self._closure.irradiance(mu_s) if self._closure else value
