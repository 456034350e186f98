# SPDX-License-Identifier: GPL-3.0-or-later
"""Unbiased volumetric path tracing in NumPy, a wavefront of paths at a time.

Delta tracking with one Poisson process of tentative collisions per volume (the nearest wins, so overlapping volumes add
up exactly), next-event estimation with closed-form or ratio-tracked transmittance, Russian roulette. Coloured media are
followed with a hero channel and the one-sample balance heuristic over the channels (Miller, Georgiev and Jarosz 2019):
``beta`` is the path's contribution over the hero's probability, ``ratio`` the probabilities of all channels over the
hero's, and a contribution counts as beta / mean(ratio).

Sun, point and spot lights are reached by next-event estimation, the uniform environment and emitting surfaces by the
path itself; each has one way only, so nothing is counted twice. ``Scene.orders`` bounds the scattering events, on
surfaces and in media together.
"""

from __future__ import annotations

import numpy as np

from ..scene import geometry, noise
from ..scene.model import ExponentialHeight, NoiseShape, Scene, Volume
from . import optics
from .result import Accumulator, Progress, Result, subpixels

Array = np.ndarray

ROULETTE_START = 16
ROULETTE_THRESHOLD = 0.1
BATCH = 1 << 15


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    return "the scene refracts" if scene.is_dielectric else ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 4, seed: int = 0,
           progress: Progress | None = None) -> Result:
    """Image of the scene with up to ``scene.orders`` scattering events.

    Each of ``repeats`` equally distributed images averages strata^2 paths per pixel. Raises ValueError when the
    integrator does not apply (see ``applies``).
    """
    if reason := applies(scene):
        raise ValueError(f"path_tracing does not apply: {reason}; use dielectric")
    rng = np.random.default_rng(seed)
    accumulator = Accumulator()
    evaluations, done, total = 0, 0, repeats * strata**2
    for _ in range(repeats):
        image = np.zeros((height * width, 3))
        for x, y in subpixels(width, height, strata, rng):
            for start in range(0, len(x), BATCH):
                tile = slice(start, start + BATCH)
                origin, direction = geometry.camera_rays(scene.camera, width, height, x[tile], y[tile])
                value, count = radiance(scene, origin, direction, rng)
                image[tile] += value
                evaluations += count
            done += 1
            if progress:
                progress(done / total)
        accumulator.add(image.reshape(height, width, 3) / strata**2)
    return accumulator.result(evaluations, "path_tracing")


def majorant(volume: Volume) -> float:
    """Upper bound (1/m) of the extinction in the volume, over all channels."""
    density = volume.medium.density
    largest = 1.0
    if isinstance(density, ExponentialHeight):
        # The density grows downwards: the lowest point of the domain bounds it.
        largest = np.exp(-(geometry.lowest(volume.domain) - density.base_height) / density.scale_height)
    return max(volume.medium.sigma_t) * largest


def density_at(volume: Volume, position: Array) -> Array:
    """Density (n,) of any kind at positions (n, 3) inside the domain."""
    if isinstance(volume.medium.density, NoiseShape):
        return noise.density(volume.medium.density, position)
    return optics.density_at(volume, position)


class _Paths:
    """Structure of arrays, compressed as paths end."""

    def __init__(self, origin: Array, direction: Array, rng: np.random.Generator):
        n = len(direction)
        self.pixel = np.arange(n)
        self.origin, self.direction = np.array(origin), np.array(direction)
        self.beta, self.ratio = np.ones((n, 3)), np.ones((n, 3))
        self.hero = rng.integers(0, 3, n)

    def select(self, keep: Array) -> None:
        for name, values in vars(self).items():
            setattr(self, name, values[keep])

    def weight(self, rows: Array | slice = slice(None)) -> Array:
        return self.beta[rows] / self.ratio[rows].mean(axis=1, keepdims=True)


def radiance(scene: Scene, origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, int]:
    """One-path estimates (n, 3) of the radiance along rays (n, 3), and the number of vertices visited."""
    epsilon = 1e-7 * optics.scale_of(scene)
    environment = np.array(scene.environment)
    value = np.zeros((len(direction), 3))
    paths = _Paths(origin, direction, rng)
    vertices = 0
    for order in range(scene.orders + 1):
        hit, surface = geometry.first_hit(scene.surfaces, paths.origin, paths.direction, epsilon)
        distance, volume = _collide(scene, paths, hit, rng)
        escaped = (volume < 0) & (surface < 0)
        np.add.at(value, paths.pixel[escaped], paths.weight(escaped) * environment)
        for i, body in enumerate(scene.surfaces):
            if max(body.emission) > 0.0:
                rows = (volume < 0) & (surface == i)
                np.add.at(value, paths.pixel[rows], paths.weight(rows) * np.array(body.emission))
        if order == scene.orders:
            break
        paths.origin = paths.origin + np.where(escaped, 0.0, np.where(volume < 0, hit, distance))[:, None] * paths.direction
        alive = np.zeros(len(hit), bool)
        for i, medium_volume in enumerate(scene.volumes):
            rows = np.flatnonzero(volume == i)
            if len(rows) and medium_volume.medium.scatters:
                _scatter_in_medium(scene, medium_volume, paths, rows, value, rng, epsilon)
                alive[rows] = True
        for i, body in enumerate(scene.surfaces):
            rows = np.flatnonzero((volume < 0) & (surface == i))
            if len(rows) and max(body.albedo) > 0.0:
                _scatter_on_surface(scene, body, paths, rows, value, rng, epsilon)
                alive[rows] = True
        vertices += int(alive.sum())
        if order >= ROULETTE_START:
            survival = np.clip(paths.weight().max(axis=1) / ROULETTE_THRESHOLD, 0.0, 1.0)
            alive &= rng.random(len(survival)) < survival
            paths.beta = paths.beta / np.where(survival > 0.0, survival, 1.0)[:, None]
        paths.select(alive)
        if not len(paths.pixel):
            break
    return value, vertices


def _collide(scene: Scene, paths: _Paths, limit: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Distance and volume index of the next real collision along each path; index -1 where there is none before limit."""
    n = len(limit)
    found, volume_of = np.full(n, np.inf), np.full(n, -1)
    # A volume without density in its closed form takes part only where it scatters or absorbs.
    active = [(i, v, majorant(v)) for i, v in enumerate(scene.volumes) if max(v.medium.sigma_t) > 0.0]
    if not active:
        return found, volume_of
    intervals = [geometry.interval(v.domain, paths.origin, paths.direction) for _, v, _ in active]
    near = np.stack([np.maximum(low, 0.0) for low, _ in intervals])
    far = np.stack([np.minimum(high, limit) for _, high in intervals])
    rows = np.flatnonzero((near < far).any(axis=0))
    t = np.zeros(n)
    while len(rows):
        first, which = np.full(len(rows), np.inf), np.full(len(rows), -1)
        for k, (_, _, bound) in enumerate(active):
            tentative = np.maximum(t[rows], near[k, rows]) + rng.exponential(1.0 / bound, len(rows))
            closer = (tentative < far[k, rows]) & (tentative < first)
            first[closer], which[closer] = tentative[closer], k
        inside = which >= 0
        rows, which = rows[inside], which[inside]
        t[rows] = first[inside]
        real = np.zeros(len(rows), bool)
        for k, (i, volume, bound) in enumerate(active):
            mine = np.flatnonzero(which == k)
            if not len(mine):
                continue
            path = rows[mine]
            position = paths.origin[path] + t[path, None] * paths.direction[path]
            share = np.array(volume.medium.sigma_t) * (density_at(volume, position) / bound)[:, None]
            hero = np.take_along_axis(share, paths.hero[path, None], axis=1)
            hit = rng.random(len(mine)) < hero[:, 0]
            scattering = np.array(volume.medium.sigma_s) / np.maximum(np.array(volume.medium.sigma_t), 1e-300)
            chance = np.where(hit[:, None], share, 1.0 - share)
            hero = np.where(hit[:, None], hero, 1.0 - hero)
            hero = np.where(hero > 0.0, hero, 1.0)
            paths.beta[path] *= np.where(hit[:, None], chance * scattering, chance) / hero
            paths.ratio[path] *= chance / hero
            real[mine] = hit
            found[path[hit]], volume_of[path[hit]] = t[path[hit]], i
        rows = rows[~real]
    return found, volume_of


def transmittance(scene: Scene, origin: Array, direction: Array, limit: Array | float, rng: np.random.Generator) -> Array:
    """Unbiased estimate (n, 3) of the transmittance over [0, limit]: closed form, or ratio tracking through noise."""
    value = np.ones((len(direction), 3))
    limit = np.broadcast_to(limit, len(direction))
    for volume in scene.volumes:
        sigma_t = np.array(volume.medium.sigma_t)
        if optics.is_closed_form(volume):
            value *= np.exp(-optics.density_depth(volume, origin, direction, limit)[:, None] * sigma_t)
            continue
        bound = majorant(volume)
        near, far = geometry.interval(volume.domain, origin, direction)
        t, far = np.maximum(near, 0.0), np.minimum(far, limit)
        rows = np.flatnonzero(t < far)
        while len(rows) and bound > 0.0:
            t[rows] += rng.exponential(1.0 / bound, len(rows))
            rows = rows[t[rows] < far[rows]]
            position = origin[rows] + t[rows, None] * direction[rows]
            value[rows] *= 1.0 - sigma_t * (density_at(volume, position) / bound)[:, None]
            rows = rows[value[rows].max(axis=1) > 0.0]
    return value


def _scatter_in_medium(scene: Scene, volume: Volume, paths: _Paths, rows: Array, value: Array, rng, epsilon: float) -> None:
    position, direction = paths.origin[rows], paths.direction[rows]
    weight = paths.weight(rows)
    for light in scene.lights:
        toward, distance, irradiance = optics.arriving(light, position)
        cosine = np.clip(np.einsum("ni,ni->n", toward, direction), -1.0, 1.0)
        direct = irradiance * optics.phase_value(volume.medium.phase, cosine)[:, None]
        _next_event(scene, position, toward, distance, weight * direct, paths.pixel[rows], value, rng, epsilon)
    paths.direction[rows] = optics.sample_phase(volume.medium.phase, direction, rng)


def _scatter_on_surface(scene: Scene, body, paths: _Paths, rows: Array, value: Array, rng, epsilon: float) -> None:
    position, direction = paths.origin[rows], paths.direction[rows]
    normal = geometry.normal(body.shape, position)
    normal = np.where(np.einsum("ni,ni->n", normal, direction)[:, None] > 0.0, -normal, normal)
    position = position + epsilon * normal
    paths.beta[rows] *= np.array(body.albedo)
    weight = paths.weight(rows)
    for light in scene.lights:
        toward, distance, irradiance = optics.arriving(light, position)
        cosine = np.maximum(np.einsum("ni,ni->n", normal, toward), 0.0)
        _next_event(scene, position, toward, distance, weight * irradiance * (cosine / np.pi)[:, None], paths.pixel[rows],
                    value, rng, epsilon)
    paths.origin[rows] = position
    paths.direction[rows] = optics.uniform_hemisphere_cosine(normal, rng)


def _next_event(scene: Scene, position: Array, toward: Array, distance: Array, direct: Array, pixel: Array, value: Array,
                rng, epsilon: float) -> None:
    """Add the light that arrives unoccluded from ``toward``."""
    lit = np.flatnonzero(direct.max(axis=1) > 0.0)
    lit = lit[geometry.visible(scene.surfaces, position[lit], toward[lit], distance[lit], epsilon)]
    attenuation = transmittance(scene, position[lit], toward[lit], distance[lit], rng)
    np.add.at(value, pixel[lit], direct[lit] * attenuation)
