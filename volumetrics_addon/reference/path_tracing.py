# SPDX-License-Identifier: GPL-3.0-or-later
"""Unbiased volumetric path tracing, compiled where numba is installed and otherwise a wavefront of paths in NumPy.

Delta tracking with null collisions, next-event estimation with closed-form or ratio-tracked transmittance, Russian roulette.
Coloured media are followed with a hero channel and the one-sample balance heuristic over the channels (Miller, Georgiev
and Jarosz 2019): ``beta`` is the path's contribution over the hero's probability, ``ratio`` the probabilities of all
channels over the hero's, and a contribution counts as beta / mean(ratio).

Sun, point and spot lights are reached by next-event estimation, the uniform environment and emitting surfaces by the
path itself; each has one way only, so nothing is counted twice. Light from a point scatters into a segment of the path
also at a distance drawn equiangularly (Kulla and Fajardo 2012), combined with the collision by the balance heuristic:
near the light its 1 / d^2 is in the density of one of the two. ``Scene.orders`` bounds the scattering events, on surfaces
and in media together.

This module is the NumPy twin and the frame of both; ``path_kernel`` is the compiled one, with local majorants.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import numpy as np

from ..scene import geometry
from ..scene.model import Dust, ExponentialAltitude, ExponentialHeight, Grid, Scene, Spot, Sun, Volume
from . import optics, path_scene
from .path_scene import ROULETTE_START, ROULETTE_THRESHOLD
from .result import Accumulator, Progress, Result, subpixels

Array = np.ndarray

BIAS = "None: unbiased up to the scene's orders of scattering."
SETTINGS = tuple({"samples": 4**exponent} for exponent in range(6))

KERNELS = ("numba", "numpy")
BATCH = 1 << 15
MOST_FLIGHTS = 1e9  # free flights of a path that the NumPy twin takes on
BATCH_SECONDS = 0.25  # of compiled work between two looks at progress and interrupts


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    return "the scene refracts" if scene.is_dielectric else ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 4, samples: int | None = None,
           seed: int = 0, kernel: str | None = None, progress: Progress | None = None) -> Result:
    """Image of the scene with up to ``scene.orders`` scattering events.

    Each of ``repeats`` equally distributed images averages ``samples`` paths per pixel (strata^2 unless given), spread over
    strata^2 cells of the pixel, or with ``strata`` 0 all through its exact centre. ``kernel`` is "numba" or "numpy";
    without it the compiled one renders what it supports where numba is installed. The image depends on the seed and
    the kernel, not on the number of threads. Raises ValueError when the integrator does not apply (see ``applies``), the
    kernel does not support the scene, or there are no samples; ImportError for "numba" where that is missing.
    """
    if reason := applies(scene):
        raise ValueError(f"path_tracing does not apply: {reason}; use dielectric")
    samples = strata**2 if samples is None else samples
    if samples < 1:
        raise ValueError(f"samples must be >= 1, got {samples} (strata {strata}); give samples where strata is 0")
    kernel = preferred_kernel(scene) if kernel is None else kernel
    if kernel not in KERNELS:
        raise ValueError(f"kernel must be one of {', '.join(KERNELS)}, got {kernel!r}; leave it out for the fastest")
    if kernel == "numpy" and (reason := _endless(scene)):
        raise ValueError(f"path_tracing in NumPy {reason}; install numba, whose majorants are local, or cut the domain")
    batches, prepared = (_compiled_batches, path_scene.flatten(scene)) if kernel == "numba" else (_numpy_batches, scene)
    accumulator = Accumulator()
    evaluations, done, total = 0, 0, repeats * samples * width * height
    for sequence in np.random.SeedSequence(seed).spawn(repeats):
        image = np.zeros((height * width, 3))
        for paths, vertices in batches(scene, prepared, width, height, strata, samples, sequence, image):
            evaluations += vertices
            done += paths
            if progress:
                progress(done / total)
        accumulator.add(image.reshape(height, width, 3) / samples)
    return accumulator.result(evaluations, "path_tracing")


def _endless(scene: Scene) -> str:
    """Empty unless a density falls so steeply that paths under one majorant for all of it would not come to an end."""
    for volume in scene.volumes:
        if isinstance(volume.medium.density, (ExponentialHeight, ExponentialAltitude)):
            low, high = path_scene.bounding_box(volume.domain)
            flights = majorant(volume) * float(np.linalg.norm(high - low))
            if flights > MOST_FLIGHTS:
                return f"would take up to {flights:.0e} steps a path through a density that falls off within its domain"
    return ""


def preferred_kernel(scene: Scene) -> str:
    """"numba" where it is installed and renders the scene, otherwise "numpy"."""
    if path_scene.unsupported(scene):
        return "numpy"
    try:
        import numba  # noqa: F401
    except ImportError:
        return "numpy"
    return "numba"


def _compiled_batches(scene: Scene, numbers: Array, width: int, height: int, strata: int, samples: int,
                      sequence: np.random.SeedSequence, image: Array) -> Iterator[tuple[int, int]]:
    """Add all paths to the image (pixels, 3), with the numbers of paths and vertices of each batch."""
    from . import path_kernel
    camera = path_kernel.camera_numbers(scene.camera, width)
    seed = sequence.generate_state(1, np.uint64)[0]
    first, size, total = 0, 4 * path_kernel.CHUNKS, samples * width * height
    while first < total:
        start, last = time.perf_counter(), min(first + size, total)
        vertices = path_kernel.trace_paths(numbers, scene.orders, camera, width, height, strata, samples, first, last, seed,
                                           image)
        yield last - first, int(vertices)
        first, pace = last, BATCH_SECONDS / max(time.perf_counter() - start, 1e-6)
        size = max(1, int(size * min(pace, 4.0)))


def _numpy_batches(scene: Scene, _: Scene, width: int, height: int, strata: int, samples: int,
                   sequence: np.random.SeedSequence, image: Array) -> Iterator[tuple[int, int]]:
    """As ``_compiled_batches``."""
    rng = np.random.default_rng(sequence)
    rounds, rest = divmod(samples, max(1, strata**2))
    passes = (np.stack(xy) for cells in (*[strata] * rounds, *[1] * rest) for xy in subpixels(width, height, cells, rng))
    together = max(1, BATCH // len(image))
    while group := list(itertools.islice(passes, together)):
        positions, pixels = np.concatenate(group, axis=1), np.tile(np.arange(len(image)), len(group))
        for start in range(0, len(pixels), BATCH):
            tile = slice(start, start + BATCH)
            value, vertices = radiance(scene, *geometry.camera_rays(scene.camera, width, height, *positions[:, tile]), rng)
            np.add.at(image, pixels[tile], value)
            yield len(value), vertices


def majorant(volume: Volume) -> float:
    """Upper bound (1/m) of the extinction in the volume above the ground, over all channels."""
    density = volume.medium.density
    largest = 1.0
    match density:
        case ExponentialHeight():
            # The density grows downwards: the lowest point of the domain bounds it.
            largest = optics.density_of_altitude(geometry.lowest(volume.domain) - density.base_height, density.scale_height)
        case ExponentialAltitude():
            center, (low, high) = np.array(density.center), path_scene.bounding_box(volume.domain)
            lowest = np.linalg.norm(np.clip(center, low, high) - center)
            largest = np.exp(-max(0.0, lowest - density.radius) / density.scale_height)
        case Grid():
            largest = float(np.max(density.values, initial=0.0))
        case Dust():
            largest = density.largest
    return max(volume.medium.sigma_t) * largest


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
        segment = _Segment(scene, paths, hit) if order < scene.orders else None
        if segment:
            _scatter_along(scene, segment, paths, value, rng, epsilon)
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
                if order == 0:
                    np.add.at(value, paths.pixel[rows], paths.weight(rows) * np.array(medium_volume.medium.ambient))
                _scatter_in_medium(scene, medium_volume, segment, distance[rows], paths, rows, value, rng, epsilon)
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


class _Segment:
    """Straight pieces of the paths up to the next surface, prepared for sampling their light distance by distance.

    The pieces reach from ``start`` to ``stop``, the hull of the scattering volumes; a free flight with their mean
    extinction ``rate`` stands for distance sampling in the weights, which any function of the distance may do.
    """

    def __init__(self, scene: Scene, paths: _Paths, limit: Array):
        n = len(limit)
        self.spans = []
        self.start, self.stop, depth = np.full(n, np.inf), np.zeros(n), np.zeros(n)
        for volume in scene.volumes:
            near, far = geometry.interval(volume.domain, paths.origin, paths.direction)
            near, far = np.maximum(near, 0.0), np.minimum(far, limit)
            if volume.medium.scatters:
                inside = near < far
                self.start = np.where(inside, np.minimum(self.start, near), self.start)
                self.stop = np.where(inside, np.maximum(self.stop, far), self.stop)
                depth += np.where(inside, far - near, 0.0) * np.mean(volume.medium.sigma_t)
            self.spans.append((near, far))
        length = self.stop - self.start
        self.rate = np.where(length > 0.0, depth / np.where(length > 0.0, length, 1.0), 0.0)
        self.lights = [_Angles(light, paths, self.start, self.stop) if _is_local(light) else None for light in scene.lights]

    def distance_pdf(self, rows: Array, t: Array) -> Array:
        return self.rate[rows] * np.exp(-self.rate[rows] * (t - self.start[rows]))


def _is_local(light) -> bool:
    return not isinstance(light, Sun)


class _Angles:
    """Segments seen from a light: equiangular sampling of their lit part, of density height / (angle (height^2 + a^2))."""

    def __init__(self, light, paths: _Paths, start: Array, stop: Array):
        offset = np.array(light.position) - paths.origin
        self.foot = np.einsum("ni,ni->n", offset, paths.direction)
        across = offset - self.foot[:, None] * paths.direction
        # On the line itself at a distance whose square is still positive.
        self.height = np.maximum(np.linalg.norm(across, axis=1), 1e-150)
        if isinstance(light, Spot) and light.cone_angle < np.pi:
            cos2 = np.cos(light.cone_angle / 2.0) ** 2
            near, far = geometry.nappe_interval(-offset, paths.direction, np.array(light.direction), cos2)
            start, stop = np.maximum(start, near), np.minimum(stop, far)
        lit = start < stop
        self.start, self.stop = np.where(lit, start, 0.0), np.where(lit, stop, 0.0)
        self.low = np.arctan((self.start - self.foot) / self.height)
        self.angle = np.arctan((self.stop - self.foot) / self.height) - self.low

    def sample(self, rows: Array, u: Array) -> Array:
        t = self.foot[rows] + self.height[rows] * np.tan(self.low[rows] + u * self.angle[rows])
        return np.clip(t, self.start[rows], self.stop[rows])

    def pdf(self, rows: Array, t: Array) -> Array:
        possible = (self.angle[rows] > 0.0) & (t >= self.start[rows]) & (t <= self.stop[rows])
        square = self.height[rows] ** 2 + (t - self.foot[rows]) ** 2
        return np.where(possible, self.height[rows] / (np.where(possible, self.angle[rows], 1.0) * square), 0.0)


def _scatter_along(scene: Scene, segment: _Segment, paths: _Paths, value: Array, rng, epsilon: float) -> None:
    """Add what each local light scatters into the segments once, at a distance drawn equiangularly."""
    for light, angles in zip(scene.lights, segment.lights):
        if angles is None:
            continue
        rows = np.flatnonzero(angles.angle > 0.0)
        t = angles.sample(rows, rng.random(len(rows)))
        direction = paths.direction[rows]
        position = paths.origin[rows] + t[:, None] * direction
        toward, distance, irradiance = optics.arriving(light, position)
        cosine = np.clip(np.einsum("ni,ni->n", toward, direction), -1.0, 1.0)
        scattering = np.zeros((len(rows), 3))
        for volume, (near, far) in zip(scene.volumes, segment.spans):
            inside = np.flatnonzero((near[rows] <= t) & (t <= far[rows]))
            if len(inside) and volume.medium.scatters:
                factor = optics.phase_value(volume.medium.phase, cosine[inside])
                factor = factor * optics.density_at(volume, position[inside])
                scattering[inside] += factor[:, None] * np.array(volume.medium.sigma_s)
        # Weight over density, with the balance heuristic.
        factor = 1.0 / (angles.pdf(rows, t) + segment.distance_pdf(rows, t))
        direct = paths.weight(rows) * irradiance * scattering * factor[:, None]
        lit = direct.max(axis=1) > 0.0
        rows, t, position, toward, distance, direct = (a[lit] for a in (rows, t, position, toward, distance, direct))
        direct *= transmittance(scene, paths.origin[rows], paths.direction[rows], t, rng)
        _next_event(scene, position, toward, distance, direct, paths.pixel[rows], value, rng, epsilon)


def _collide(scene: Scene, paths: _Paths, limit: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Distance and volume index of the next real collision along each path; index -1 where there is none before limit."""
    n = len(limit)
    found, volume_of = np.full(n, np.inf), np.full(n, -1)
    active = [(i, v, bound) for i, v in enumerate(scene.volumes) if (bound := majorant(v)) > 0.0]
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
            share = np.array(volume.medium.sigma_t) * (optics.density_at(volume, position) / bound)[:, None]
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
            value[rows] *= 1.0 - sigma_t * (optics.density_at(volume, position) / bound)[:, None]
            rows = rows[value[rows].max(axis=1) > 0.0]
    return value


def _scatter_in_medium(scene: Scene, volume: Volume, segment: _Segment, distance: Array, paths: _Paths, rows: Array,
                       value: Array, rng, epsilon: float) -> None:
    position, direction = paths.origin[rows], paths.direction[rows]
    weight = paths.weight(rows)
    for light, angles in zip(scene.lights, segment.lights):
        toward, reach, irradiance = optics.arriving(light, position)
        cosine = np.clip(np.einsum("ni,ni->n", toward, direction), -1.0, 1.0)
        factor = optics.phase_value(volume.medium.phase, cosine)
        if angles is not None:
            free, angular = segment.distance_pdf(rows, distance), angles.pdf(rows, distance)
            factor = factor * np.where(angular > 0.0, free / np.where(angular > 0.0, free + angular, 1.0), 1.0)
        _next_event(scene, position, toward, reach, weight * irradiance * factor[:, None], paths.pixel[rows], value, rng,
                    epsilon)
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
