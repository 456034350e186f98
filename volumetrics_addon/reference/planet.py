# SPDX-License-Identifier: GPL-3.0-or-later
"""A planet with its atmosphere, recognised in a Scene, and what its integrators share: rays, panels, the image loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..physics.atmosphere import Component, Planet, ground_distance, ray_nodes
from ..scene import geometry
from ..scene.model import Ellipsoid, ExponentialAltitude, Scene, Sun, Surface
from . import optics
from .frame import render_rays
from .result import Progress, Result, subpixels

Array = np.ndarray

TILE = 1 << 12


@dataclass(frozen=True)
class View:
    """The planet of a scene with its sun: ``toward`` is the unit direction to the sun, ``irradiance`` its own (3,)."""

    planet: Planet
    center: Array
    toward: Array
    irradiance: Array
    ground: Surface

    def rays(self, origin: Array, direction: Array) -> Rays:
        """The parts (n,) of rays (n, 3) within the atmosphere and before the ground."""
        planet = self.planet
        offset = origin - self.center
        along = np.einsum("ni,ni->n", offset, direction)
        passing = np.linalg.norm(offset - along[:, None] * direction, axis=1)
        half = np.sqrt(np.maximum((planet.top - passing) * (planet.top + passing), 0.0))
        near = np.maximum(-along - half, 0.0)
        start = np.linalg.norm(offset, axis=1)
        hit = ground_distance(start, np.clip(along / start, -1.0, 1.0), planet.radius)
        length = np.maximum(np.minimum(hit, half - along) - near, 0.0)
        length = np.where(passing < planet.top, length, 0.0)
        shadow = geometry.shadow_interval(self.ground, origin, direction, -self.toward, parallel=True)
        entry = offset + near[:, None] * direction
        radius = np.clip(np.linalg.norm(entry, axis=1), planet.radius, np.maximum(planet.top, passing))
        return Rays(radius, np.clip((along + near) / radius, -1.0, 1.0), np.clip(entry @ self.toward / radius, -1.0, 1.0),
                    np.clip(direction @ self.toward, -1.0, 1.0), near, length, np.isfinite(hit),
                    shadow[0] - near, shadow[1] - near)

    def reflected(self, rays: Rays, irradiance: Callable[[Array], Array], attenuation: Array | None = None) -> Array:
        """Radiance (n, 3) of the ground seen along rays, 0 where they miss it.

        ``irradiance`` maps the sun's zenith cosine on the ground to (m, 3), for unit irradiance of the sun;
        ``attenuation`` (n, 3) is the air's along the rays, by default the exact one.
        """
        value = np.zeros((len(rays.radius), 3))
        rows = np.flatnonzero(rays.hits)
        if len(rows) and max(self.planet.albedo) > 0.0:
            mu_s = (rays.radius[rows] * rays.mu_s[rows] + rays.length[rows] * rays.nu[rows]) / self.planet.radius
            if attenuation is None:
                clear = self.planet.transmittance(rays.radius[rows], rays.mu[rows], rays.length[rows])
            else:
                clear = attenuation[rows]
            value[rows] = clear * np.array(self.planet.albedo) / np.pi * irradiance(np.clip(mu_s, -1.0, 1.0))
        return value * self.irradiance

    def direct(self, mu_s: Array) -> Array:
        """Irradiance (m, 3) on the ground by the attenuated sun alone, for unit irradiance."""
        return np.maximum(mu_s, 0.0)[:, None] * self.planet.sunlight(self.planet.radius, mu_s)


@dataclass(frozen=True)
class Rays:
    """Parts of rays (n,) within the atmosphere: radius, zenith cosines of ray (mu) and sun (mu_s) at the start of the part,
    cosine between ray and sun (nu), distance of that start from the camera (near), length, whether the ground ends it,
    and the interval of it in the planet's shadow, counted from the start."""

    radius: Array
    mu: Array
    mu_s: Array
    nu: Array
    near: Array
    length: Array
    hits: Array
    dark_from: Array
    dark_to: Array

    def at(self, index: Array, t: Array) -> tuple[Array, Array, Array]:
        """Radius and zenith cosines of ray and sun (m, k) at t (m, k) on the rays ``index`` (m,)."""
        start, mu, mu_s, nu = (a[index, None] for a in (self.radius, self.mu, self.mu_s, self.nu))
        radius = np.sqrt(start**2 + t * (2.0 * start * mu + t))
        return radius, np.clip((start * mu + t) / radius, -1.0, 1.0), np.clip((start * mu_s + t * nu) / radius, -1.0, 1.0)

    def samples(self, planet: Planet, order: int, lit: bool) -> tuple[Array, Array, Array]:
        """Ray index (m,), positions and weights (m, order) on the lit or on the shaded parts: found, not sampled."""
        dark_from, dark_to = (np.clip(edge, 0.0, self.length) for edge in (self.dark_from, self.dark_to))
        shaded = dark_from < dark_to
        if lit:
            low = np.concatenate([np.zeros_like(dark_from), dark_to])
            high = np.concatenate([np.where(shaded, dark_from, self.length), np.where(shaded, self.length, dark_to)])
        else:
            low, high = dark_from, dark_to
        index = np.tile(np.arange(len(self.length)), 2 if lit else 1)
        keep = high - low > 1e-9 * planet.radius * np.finfo(np.float32).eps
        index, low, high = index[keep], low[keep], high[keep]
        t, weight = ray_nodes(planet, self.radius[index], self.mu[index], low, high, order)
        return index, t, weight


def planet_of(scene: Scene) -> View | str:
    """The scene as a planet with its atmosphere and sun, or the reason why it is none."""
    if scene.is_dielectric:
        return "the scene refracts"
    if len(scene.lights) != 1 or not isinstance(scene.lights[0], Sun):
        return "a sky needs a single light, the sun"
    if max(scene.environment) > 0.0:
        return "the environment shines"
    if len(scene.surfaces) != 1 or not _is_sphere(scene.surfaces[0].shape):
        return "the only surface must be the planet, a sphere"
    ground = scene.surfaces[0]
    if max(ground.emission) > 0.0:
        return "the planet's ground shines"
    center, radius = ground.shape.center, ground.shape.half[0]
    if not scene.volumes:
        return "the planet has no atmosphere"
    for volume in scene.volumes:
        density = volume.medium.density
        if not isinstance(density, ExponentialAltitude):
            return "a volume is not an atmosphere, whose density falls with the altitude"
        if density.center != center or density.radius != radius:
            return "an atmosphere's density does not start at the planet's ground"
        if not _is_sphere(volume.domain) or volume.domain.center != center:
            return "an atmosphere's domain is not a sphere around the planet"
    top = scene.volumes[0].domain.half[0]
    if any(volume.domain.half[0] != top for volume in scene.volumes) or top <= radius:
        return "the atmospheres do not end at one altitude above the ground"
    if np.linalg.norm(np.subtract(scene.camera.position, center)) < radius * (1.0 - 1e-12):
        return "the camera is below the ground"
    media = (volume.medium for volume in scene.volumes)
    components = tuple(Component(m.sigma_s, m.sigma_a, m.density.scale_height, partial(optics.phase_value, m.phase))
                       for m in media)
    sun = scene.lights[0]
    return View(Planet(radius, top, components, ground.albedo), np.array(center), -np.array(sun.direction),
                np.array(sun.irradiance), ground)


def required_view(scene: Scene, name: str) -> View:
    """The View; raises ValueError with the reason where there is none."""
    view = planet_of(scene)
    if isinstance(view, str):
        raise ValueError(f"{name} does not apply: {view}; use path_tracing")
    return view


def image(scene: Scene, width: int, height: int, name: str, value: Callable, coarse: Callable, *, repeats: int, strata: int,
          seed: int, progress: Progress | None, missing: Array | float = 0.0, prepared: int = 0,
          started: float | None = None) -> Result:
    """The Result of an integrator that is deterministic along a ray, by ``frame.render_rays``.

    ``value`` maps origins and directions (n, 3) to radiance (n, 3) and a number of evaluations; ``coarse`` is the same at
    half the resolution, and its difference the error stated for each ray. ``missing`` is the share of the radiance, per
    channel, known to be left out, and added to that; ``prepared`` counts the evaluations and ``started`` is the time of the
    preparations.
    """
    started = time.perf_counter() if started is None else started

    def stated(origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, Array, int]:
        (radiance, count), (rough, more) = value(origin, direction), coarse(origin, direction)
        return radiance, np.abs(radiance - rough) + missing * radiance, count + more

    result = render_rays(name, stated, scene, width, height, repeats=repeats, strata=strata, seed=seed, random=False,
                         progress=progress, tile=TILE)
    return replace(result, evaluations=result.evaluations + prepared, seconds=time.perf_counter() - started)


def centres(width: int, height: int) -> tuple[Array, Array]:
    """Raster positions x, y (n,) of the pixels' centres."""
    return next(subpixels(width, height, 0, np.random.default_rng()))


def _is_sphere(shape) -> bool:
    return isinstance(shape, Ellipsoid) and shape.half[0] == shape.half[1] == shape.half[2]
