# SPDX-License-Identifier: GPL-3.0-or-later
"""What the techniques that sum samples along a ray share: the light at a point, the sum over steps, what lies behind.

Along a ray with extinction sigma_t(t) and source S(t), both constant over each step of length h,

    L = sum_k T_k S_k (1 - exp(-sigma_k h)) / sigma_k,  T_k = exp(-sum_{i<k} sigma_i h):

transmittance is integrated within the step, so that no step, however long, scatters more light than it receives
(Hillaire, Physically based and unified volumetric rendering in Frostbite, SIGGRAPH 2015 course). The other sum in use,
of T_k S_k h, has no such bound. S_k is evaluated in the middle of the step: second order where S is smooth, first
order at the edges of shadows and of light cones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..physics import phase as phase_functions
from ..scene import geometry
from ..scene.model import AnyPhase, Box, Cone, Ellipsoid, Hull, Phase, Scene, Shape, Volume, look_frame
from . import optics, single_scattering
from .frame import TILE, render_rays
from .result import Progress, Result

Array = np.ndarray

POINTS = 1 << 16  # positions that are lit at once
LIGHT_STEPS = 16

# (b, a, c) of each octave: factors of scattering, of extinction towards the light, of the phase function's mean cosine.
Octaves = tuple[tuple[float, float, float], ...]
SINGLE: Octaves = ((1.0, 1.0, 1.0),)


class Column(NamedTuple):
    """What the media add to rays and what they let through, (n, 3) each, with the estimated absolute errors."""

    scattered: Array
    transmittance: Array
    scattered_doubt: Array
    transmittance_doubt: Array


SINGLE_BIAS = "Single scattering only: scenes that ask for more orders come out too dark."


def applies(scene: Scene) -> str:
    """Empty when single scattering from delta lights and the environment describes the scene, otherwise why not."""
    if scene.is_dielectric:
        return "the scene refracts"
    if any(max(surface.emission) > 0.0 for surface in scene.surfaces):
        if any(volume.medium.scatters for volume in scene.volumes):
            return "an emitting surface lights a scattering medium"
        if any(max(surface.albedo) > 0.0 for surface in scene.surfaces):
            return "an emitting surface lights another surface"
    return ""


def glowing(scene: Scene) -> str:
    """Why a technique that gathers light for light cannot render the scene: its media have ambient light. Empty otherwise."""
    return "a medium has ambient light, which no light casts" if any(v.medium.glows for v in scene.volumes) else ""


def refuse(name: str, reason: str) -> None:
    """Raises ValueError when ``reason``, from ``applies``, is not empty."""
    if reason:
        raise ValueError(f"{name} does not apply: {reason}; use path_tracing or dielectric")


def counted(name: str, value: int, remedy: str, least: int = 1) -> int:
    """``value``, a whole number >= ``least``; ValueError otherwise."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} must be a whole number >= {least}, got {value!r}; {remedy}")
    return int(value)


def rays_at_once(samples: int) -> int:
    """Size of the tiles of rays with so many samples each, for memory that does not grow with either."""
    return min(TILE, max(1, POINTS // samples))


# --- media --------------------------------------------------------------------------------------------------


def media_interval(scene: Scene, origin: Array, direction: Array, hit: Array) -> tuple[Array, Array]:
    """Front and back depth (n,) of all media along rays that end at ``hit``; both 0 where a ray meets none."""
    front, back = np.full(len(direction), np.inf), np.zeros(len(direction))
    for volume in scene.volumes:
        near, far = geometry.interval(volume.domain, origin, direction)
        near, far = np.maximum(near, 0.0), np.minimum(far, hit)
        met = near < far
        front, back = np.where(met, np.minimum(front, near), front), np.where(met, np.maximum(back, far), back)
    met = front < back
    return np.where(met, front, 0.0), np.where(met, back, 0.0)


def extinction(scene: Scene, position: Array) -> Array:
    """Extinction (n, 3) of all media at positions (n, 3), in 1/m."""
    total = np.zeros((len(position), 3))
    for volume, rows, density in _densities(scene, position):
        total[rows] += density[:, None] * np.array(volume.medium.sigma_t)
    return total


def _densities(scene: Scene, position: Array) -> list[tuple[Volume, Array, Array]]:
    """Of each volume: itself, the rows (m,) of the positions in it, and the density (m,) there."""
    found = []
    for volume in scene.volumes:
        rows = np.flatnonzero(geometry.contains(volume.domain, position))
        found.append((volume, rows, optics.density_at(volume, position[rows])))
    return found


def optical_depth(scene: Scene, origin: Array, direction: Array, limit: Array | float, steps: int) -> Array:
    """Optical depth (n, 3) over [0, limit]: closed form where the density has one, ``steps`` midpoints per ray otherwise."""
    depth = np.zeros((len(direction), 3))
    for volume in scene.volumes:
        if optics.is_closed_form(volume):
            length = optics.density_depth(volume, origin, direction, limit)
        else:
            length = _marched_depth(volume, origin, direction, limit, steps)
        depth += length[:, None] * np.array(volume.medium.sigma_t)
    return depth


def _marched_depth(volume: Volume, origin: Array, direction: Array, limit: Array | float, steps: int) -> Array:
    near, far = geometry.interval(volume.domain, origin, direction)
    near, far = np.maximum(near, 0.0), np.minimum(far, limit)
    depth = np.zeros(len(direction))
    rows = np.flatnonzero(near < far)
    step = (far - near)[rows] / steps
    for k in range(steps):
        t = near[rows] + (k + 0.5) * step
        depth[rows] += step * optics.density_at(volume, origin[rows] + t[:, None] * direction[rows])
    return depth


# --- light --------------------------------------------------------------------------------------------------


def scattered_toward(scene: Scene, light, position: Array, direction: Array, depth: Callable,
                     octaves: Octaves = SINGLE) -> Array:
    """Source (n, 3) of one light at positions (n, 3), for eyes that look along ``direction``, in W m^-3 sr^-1.

        S = sum over media and octaves of b sigma_s p(c g, cos) E exp(-a tau), E 0 where a surface is in the way,

    with ``depth`` (origin, direction, limit) -> tau (n, 3). A position on the light itself counts as dark.
    """
    epsilon = 1e-7 * optics.scale_of(scene)
    value = np.zeros((len(position), 3))
    toward, distance, irradiance = optics.arriving(light, position)
    lit = np.flatnonzero((irradiance.max(axis=1) > 0.0) & (distance > epsilon))
    lit = lit[geometry.visible(scene.surfaces, position[lit], toward[lit], distance[lit], epsilon)]
    if not len(lit):
        return value
    position, toward, irradiance = position[lit], toward[lit], irradiance[lit]
    tau = depth(position, toward, distance[lit])
    cosine = np.clip(np.einsum("ni,ni->n", toward, direction[lit]), -1.0, 1.0)
    for volume, rows, density in _densities(scene, position):
        if not volume.medium.scatters:
            continue
        lobes = sum(b * phase_of_octave(volume.medium.phase, cosine[rows], c)[:, None] * np.exp(-a * tau[rows])
                    for b, a, c in octaves)
        value[lit[rows]] += np.array(volume.medium.sigma_s) * irradiance[rows] * lobes * density[:, None]
    return value


def phase_of_octave(phase: AnyPhase, cosine: Array, factor: float) -> Array:
    """The phase function with its mean cosine times ``factor``: lobes of g factor, others mixed with the isotropic one."""
    if isinstance(phase, Phase):
        return optics.phase_value(replace(phase, g0=phase.g0 * factor, g1=phase.g1 * factor), cosine)
    return factor * optics.phase_value(phase, cosine) + (1.0 - factor) * phase_functions.isotropic(cosine)


def source(scene: Scene, position: Array, direction: Array, light_steps: int,
           octaves: Octaves = SINGLE) -> tuple[Array, Array]:
    """Source (n, 3) of all lights, the media's ambient light included, and extinction (n, 3) at positions (n, 3)."""
    depth = partial(optical_depth, scene, steps=light_steps)
    value = np.zeros((len(position), 3))
    for light in scene.lights:
        value += scattered_toward(scene, light, position, direction, depth, octaves)
    if any(volume.medium.glows for volume in scene.volumes):
        for volume, rows, density in _densities(scene, position):
            value[rows] += np.array(volume.medium.sigma_s) * np.array(volume.medium.ambient) * density[:, None]
    return value, extinction(scene, position)


# --- along the ray ------------------------------------------------------------------------------------------


def integrate(emitted: Array, sigma_t: Array, length: Array) -> tuple[Array, Array]:
    """Radiance (n, k, 3) that each step sends to the start of the ray, and optical depth (n, k, 3) of each step.

    ``emitted`` source and ``sigma_t`` extinction (n, k, 3), ``length`` (n, k): the sum in the module's docstring.
    """
    depth = sigma_t * length[..., None]
    before = np.cumsum(np.concatenate([np.zeros_like(depth[:, :1]), depth[:, :-1]], axis=1), axis=1)
    return emitted * length[..., None] * mean_transmittance(depth) * np.exp(-before), depth


def mean_transmittance(depth: Array) -> Array:
    """Mean (1 - exp(-depth)) / depth of the transmittance over a step of this optical depth; 1 at 0."""
    safe = np.where(depth > 0.0, depth, 1.0)
    return np.where(depth > 0.0, -np.expm1(-safe) / safe, 1.0)


def nested_doubt(contribution: Array, length: Array) -> Array:
    """Estimated error (n, 3) of midpoint sums, from the samples alone: the middle one of every three, taken for all three.

    That is the midpoint rule of steps three times as long. Where the integrand is smooth its error is nine times that of
    all samples, so that their difference is eight times the error; where it jumps its standard error is three times.
    Half the difference covers both. Fewer than three samples know a quarter of their value.
    ``contribution`` (n, k, 3) of steps of ``length`` (n, k); those of length 0, at either end of a ray, do not count.
    """
    used = length > 0.0
    place = np.cumsum(used, axis=1) - 1
    trios = used.sum(axis=1, keepdims=True) // 3
    counted_in = used & (place < 3 * trios)
    around = np.pad(length, ((0, 0), (1, 1)))
    share = (around[:, :-2] + length + around[:, 2:]) / np.where(used, length, 1.0)
    weight = np.where(counted_in & (place % 3 == 1), share, 0.0) - counted_in
    difference = np.abs(np.einsum("nk,nkc->nc", weight, contribution))
    return np.where(trios > 0, difference / 2.0, np.abs(contribution).sum(axis=1) / 4.0)


def march(scene: Scene, origin: Array, direction: Array, hit: Array, steps: int, light_steps: int, octaves: Octaves = SINGLE,
          jitter: np.random.Generator | None = None) -> Column:
    """The media along rays up to ``hit``, in uniform steps between their front and back depth.

    Samples lie in the middle of the steps, or anywhere in them with ``jitter``. The doubt adds that of ``light_steps`` where
    a density has no closed-form optical depth: half as many are tried.
    """
    near, far = media_interval(scene, origin, direction, hit)
    column = Column(*np.zeros((4, len(direction), 3)))
    column.transmittance[:] = 1.0
    rows = np.flatnonzero(near < far)
    if not len(rows):
        return column
    offset = 0.5 if jitter is None else jitter.random((len(rows), steps))
    length = np.broadcast_to(((far - near)[rows] / steps)[:, None], (len(rows), steps))
    t = near[rows, None] + (np.arange(steps) + offset) * length
    d = np.repeat(direction[rows], steps, axis=0)
    position = np.repeat(origin[rows], steps, axis=0) + t.reshape(-1, 1) * d
    emitted, sigma_t = (x.reshape(len(rows), steps, 3) for x in source(scene, position, d, light_steps, octaves))
    contribution, depth = integrate(emitted, sigma_t, length)
    column.scattered[rows] = contribution.sum(axis=1)
    column.transmittance[rows] = np.exp(-depth.sum(axis=1))
    if jitter is None:
        column.scattered_doubt[rows] = nested_doubt(contribution, length)
        column.transmittance_doubt[rows] = column.transmittance[rows] * np.minimum(nested_doubt(depth, length), 1.0)
    else:  # The repeats know the spread. Source and transmittance are averaged apart, which leaves their covariance.
        change = np.abs(np.diff(emitted, axis=1, prepend=emitted[:, :1])) / np.maximum(emitted, 1e-300)
        column.scattered_doubt[rows] = (contribution * np.minimum(change, 1.0) * depth).sum(axis=1) / 12.0
    if scene.is_noisy:
        other, _ = source(scene, position, d, fewer(light_steps), octaves)
        coarse, _ = integrate(other.reshape(emitted.shape), sigma_t, length)
        column.scattered_doubt[rows] += np.abs(coarse - contribution).sum(axis=1)
    return column


def fewer(count: int) -> int:
    """Half of a number of steps, to compare with; 2 for 1."""
    return count // 2 if count > 1 else 2


def composed(scene: Scene, origin: Array, direction: Array, hit: Array, index: Array, column: Column,
             rng: np.random.Generator, light_steps: int) -> tuple[Array, Array]:
    """Radiance (n, 3) and its doubt: the surface or environment behind, through the media, and what these scatter."""
    epsilon = 1e-7 * optics.scale_of(scene)
    depth = partial(optical_depth, steps=light_steps)
    value, doubt = column.scattered, column.scattered_doubt
    if scene.surfaces or max(scene.environment) > 0.0:
        behind = single_scattering.surface_radiance(scene, origin, direction, hit, index, rng, epsilon, depth)
        value, doubt = value + column.transmittance * behind, doubt + column.transmittance_doubt * behind
    if max(scene.environment) > 0.0:
        value = value + single_scattering.environment_scattering(scene, origin, direction, hit, rng, epsilon, depth)
    return value, doubt


def dimming(scene: Scene, origin: Array, direction: Array, hit: Array, light_steps: int) -> tuple[Array, Array]:
    """Transmittance (n, 3) up to ``hit`` and its doubt, for techniques that do not march all of the media."""
    value = np.exp(-optical_depth(scene, origin, direction, hit, light_steps))
    if not scene.is_noisy:
        return value, np.zeros_like(value)
    return value, np.abs(value - np.exp(-optical_depth(scene, origin, direction, hit, fewer(light_steps))))


def render_gathered(name: str, gather: Callable, scene: Scene, width: int, height: int, slices: int, light_steps: int, *,
                    repeats: int, strata: int, seed: int, progress: Progress | None) -> Result:
    """Image of techniques that gather each light on their own and leave the dimming of what lies behind to ``dimming``.

    ``gather`` maps origins, directions (n, 3) and the distances (n,) to the surfaces to the light (n, 3) that all lights
    scatter into the rays, its doubt (n, 3) and the number of samples; ``slices`` of them a ray bound the tiles.
    """
    def radiance(origin: Array, direction: Array, rng: np.random.Generator) -> tuple[Array, Array, int]:
        hit, index = first_hit(scene, origin, direction)
        scattered, doubt, evaluations = gather(origin, direction, hit)
        transmittance, dimming_doubt = dimming(scene, origin, direction, hit, light_steps)
        column = Column(scattered, transmittance, doubt, dimming_doubt)
        return *composed(scene, origin, direction, hit, index, column, rng, light_steps), evaluations

    return render_rays(name, radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=max(scene.environment) > 0.0, progress=progress, tile=rays_at_once(slices))


def summed(parts: Iterable[tuple[Array, Array, int]], rays: int) -> tuple[Array, Array, int]:
    """Sum of light, doubt (rays, 3) each and samples over the lights."""
    scattered, doubt, evaluations = np.zeros((rays, 3)), np.zeros((rays, 3)), 0
    for value, error, count in parts:
        scattered += value
        doubt += error
        evaluations += count
    return scattered, doubt, evaluations


class Slabs(NamedTuple):
    """Pieces of rays between planes: the ray and slab of each (m,), the distances (m,) of its middle and its length."""

    ray: Array
    slab: Array
    middle: Array
    length: Array


def slabs(origin: Array, direction: Array, entry: Array, leave: Array, axis: Array, planes: Array) -> Slabs:
    """The parts of rays within [entry, leave] (n,) between neighbours of ``planes`` (k + 1,), ascending values of x . axis.

    A ray along the planes lies in one slab.
    """
    start, slope = origin @ axis, direction @ axis
    slope = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
    met = entry < leave
    entry, leave = np.where(met, entry, 0.0), np.where(met, leave, 0.0)
    cuts = np.clip((planes - start[:, None]) / slope[:, None], entry[:, None], leave[:, None])
    length = np.abs(np.diff(cuts, axis=1))
    ray, slab = np.nonzero(length > 0.0)
    return Slabs(ray, slab, (cuts[ray, slab] + cuts[ray, slab + 1]) / 2.0, length[ray, slab])


def first_hit(scene: Scene, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Distance (n,) of the first surface, inf where there is none, and its index (n,), -1 there."""
    return geometry.first_hit(scene.surfaces, origin, direction, 1e-7 * optics.scale_of(scene))


# --- screen and grids ---------------------------------------------------------------------------------------


def corners(shape: Shape) -> Array:
    """Corners (8, 3) of a box around the shape."""
    if isinstance(shape, Cone):
        half = shape.length / 2.0
        side = shape.length * np.tan(shape.half_angle)
        center = tuple(a + half * x for a, x in zip(shape.apex, shape.axis))
        return np.array(Box(center, (side, side, half), look_frame(shape.axis)).corners)
    if isinstance(shape, Hull):
        low, high = np.min(shape.corners, axis=0), np.max(shape.corners, axis=0)
        return np.array(Box(tuple((low + high) / 2.0), tuple((high - low) / 2.0)).corners)
    return np.array(Box(shape.center, shape.half, shape.axes).corners)


def media_corners(scene: Scene) -> Array:
    """Corners (8 m, 3) of boxes around the m media."""
    return np.concatenate([corners(volume.domain) for volume in scene.volumes] or [np.zeros((0, 3))])


def linear_weights(x: Array, count: int) -> tuple[Array, Array, Array]:
    """Cells (n,) below and above each coordinate and the weight of the upper one; cell i has its centre at i + 1/2.

    Beyond the outermost centres the value is that of the outermost cell.
    """
    x = np.clip(x - 0.5, 0.0, count - 1.0)
    low = np.minimum(x.astype(int), max(count - 2, 0))
    return low, np.minimum(low + 1, count - 1), x - low
