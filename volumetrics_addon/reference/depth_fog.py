# SPDX-License-Identifier: GPL-3.0-or-later
"""Height fog in closed form from the depth of each pixel, as a compositor can make it: plane-parallel and without shadows.

A ray is cut at the fog's box; sun and sky reach it from straight above through fog that goes on sideways (see
physics.plane_parallel). What stands in the fog is lit as without it, times the share of the light that reaches a level floor at
its height through the fog. So shafts and shadows in the fog, the sides of the box and light from below are missing.

A depth fog has no height: its transmittance T follows from the distance, and its light is (1 - T) (radiance + albedo p E).
"""

from __future__ import annotations

import sys
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..physics import plane_parallel
from ..physics.transmittance import exp2_fog, exp_fog, height_optical_depth, linear_fog
from ..scene import geometry
from ..scene.describe import GREY
from ..scene.model import IDENTITY, Box, DepthFog, ExponentialHeight, Homogeneous, Phase, Scene, Sun
from . import optics, single_scattering
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = ("No shadows in the fog, and light through its sides or from below is left out: 1 % where fog lies around low things on open "
        "ground.")
SETTINGS = tuple({"elevations": count} for count in (1, 2, 3, 4, plane_parallel.ELEVATIONS, 8))


class Fog(NamedTuple):
    """The layers of a scene's fog: extinctions (1/m) at the bottom of its box and scale heights (m, infinite for a slab)."""

    layers: tuple[tuple[float, float], ...]
    albedo: tuple[float, float, float]
    g: float
    box: Box

    @property
    def base(self) -> float:
        return self.box.center[2] - self.box.half[2]

    @property
    def top(self) -> float:
        return self.box.center[2] + self.box.half[2]

    def depth_above(self, z: Array) -> Array:
        return sum(plane_parallel.vertical_depth(z, sigma, height, self.base, self.top) for sigma, height in self.layers)


def fog_of(scene: Scene) -> Fog | str:
    """The fog that the scene's volumes are, or the reason why they are none that has a closed form."""
    volumes = [volume for volume in scene.volumes if max(volume.medium.sigma_t) > 0.0]
    if not volumes:
        return "there is no fog"
    first, box = volumes[0].medium, volumes[0].domain
    if not isinstance(box, Box) or box.axes != IDENTITY:
        return "the fog does not lie in an upright box"
    layers = []
    base = box.center[2] - box.half[2]
    for volume in volumes:
        medium, sigma = volume.medium, volume.medium.sigma_t
        if volume.domain != box:
            return "the media lie in several domains"
        if volume.boundary is not None:
            return "the fog refracts"
        if not isinstance(medium.phase, Phase) or medium.phase.weight != 0.0 or medium.phase != first.phase:
            return "the fog's phase function is not one Henyey-Greenstein lobe"
        if max(sigma) - min(sigma) > GREY * max(sigma):
            return "the extinction has a colour"
        if not np.allclose(np.array(medium.sigma_s) * max(first.sigma_t), np.array(first.sigma_s) * max(sigma), rtol=GREY):
            return "the layers differ in albedo"
        match medium.density:
            case Homogeneous():
                layers.append((sigma[0], np.inf))
            case ExponentialHeight(height, foot):
                layers.append((sigma[0] * float(np.exp(-(base - foot) / height)), height))
            case _:
                return "the density depends on more than the height"
    albedo = tuple(s / t for s, t in zip(first.sigma_s, first.sigma_t))
    return Fog(tuple(layers), albedo, first.phase.g0, box)


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    if any(not isinstance(light, Sun) for light in scene.lights):
        return "a lamp lights the fog"
    if scene.depth_fog and scene.depth_fog.falloff:
        return "the scene has media beside its depth fog" if scene.volumes else ""
    if scene.orders != 1:
        return f"the scene follows {scene.orders} orders of scattering, this integrator one"
    if any(max(surface.emission) > 0.0 for surface in scene.surfaces):
        return "an emitting surface lights the fog"
    fog = fog_of(scene)
    return fog if isinstance(fog, str) else ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, seed: int = 0,
           elevations: int = plane_parallel.ELEVATIONS, progress: Progress | None = None) -> Result:
    """Image of the scene: repeats and strata as in single_scattering, the sky's light from so many elevations.

    Raises ValueError when the integrator does not apply.
    """
    if reason := applies(scene):
        raise ValueError(f"depth_fog does not apply: {reason}; use single_scattering")
    settings = scene.depth_fog or DepthFog()
    fog = None if settings.falloff else fog_of(scene)

    def radiance(origin: Array, direction: Array, rng) -> tuple[Array, Array, int]:
        value = composited(scene, settings, fog, origin, direction, rng, elevations)
        return value, np.zeros_like(value), len(value)

    return render_rays("depth_fog", radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=max(scene.environment) > 0.0, progress=progress)


@lru_cache(maxsize=64)
def loss(scene: Scene, size: int = 32, strata: int = 2) -> float:
    """Bound on the share of the picture's mean that the closed form misses: by ``size``^2 pixels of both, their noise added.

    Infinite where the integrator does not apply.
    """
    if applies(scene):
        return np.inf
    rough = [module.render(scene, size, size, repeats=4, strata=strata, seed=1)
             for module in (single_scattering, sys.modules[__name__])]
    difference = np.array([exact - formula for exact, formula in zip(*(result.repeats for result in rough))]).mean(axis=(1, 2, 3))
    return float((abs(difference.mean()) + 2.0 * difference.std(ddof=1) / len(difference) ** 0.5) / max(rough[0].image.mean(), 1e-300))


def composited(scene: Scene, settings: DepthFog, fog: Fog | None, origin: Array, direction: Array, rng: np.random.Generator,
               elevations: int = plane_parallel.ELEVATIONS) -> Array:
    """Radiance (n, 3) along rays (n, 3): what is seen without fog, dimmed, and the fog's own light."""
    epsilon = 1e-7 * optics.scale_of(scene)
    hit, index = geometry.first_hit(scene.surfaces, origin, direction, epsilon)
    clear = single_scattering.surface_radiance(scene, origin, direction, hit, index, rng, epsilon,
                                               depth=lambda scene, position, toward, limit: np.zeros((len(position), 3)))
    foggy = (hit <= settings.cutoff)[:, None]
    if fog is None:
        opacity = 1.0 - falloff(settings, hit)
        light = opacity[:, None] * (np.array(settings.radiance) + np.array(settings.albedo) * sunlight(scene, settings, settings.g, direction))
        seen = clear
    else:
        end = origin[:, 2] + np.where(np.isfinite(hit), hit, 0.0) * direction[:, 2]
        seen = clear * np.where((index >= 0)[:, None], lit_share(scene, fog, end, elevations), 1.0)
        tau, depth = along(fog, origin, direction, settings.start, hit)
        opacity, light = -np.expm1(-depth), airlight(scene, settings, fog, direction, tau, depth, elevations)
    share = np.minimum(1.0, settings.max_opacity / np.maximum(opacity, 1e-300))[:, None]
    return np.where(foggy, seen * (1.0 - opacity[:, None] * share) + light * share, clear)


def falloff(settings: DepthFog, distance: Array) -> Array:
    """Transmittance (n,) of a depth fog up to these distances, counted from its start."""
    distance = np.maximum(distance - settings.start, 0.0)
    match settings.falloff:
        case "linear":
            return linear_fog(distance, 0.0, settings.end - settings.start)
        case "exp":
            return exp_fog(distance, settings.density)
        case _:
            return exp2_fog(distance, settings.density)


def along(fog: Fog, origin: Array, direction: Array, start: float, hit: Array) -> tuple[Array, Array]:
    """Vertical depth (n,) above the rays' entries into the fog, and the optical depth (n,) from there to ``hit``."""
    near, far = geometry.interval(fog.box, origin, direction)
    near, far = np.maximum(near, start), np.minimum(far, hit)
    inside = far > near
    near, length = np.where(inside, near, 0.0), np.where(inside, far - near, 0.0)
    entry = np.clip(origin[:, 2] + near * direction[:, 2], fog.base, fog.top)
    depth = np.zeros(len(near))
    for sigma, height in fog.layers:
        depth += sigma * (length if np.isinf(height) else height_optical_depth(entry, direction[:, 2], length, 1.0, height, fog.base))
    return fog.depth_above(entry), depth


def sunlight(scene: Scene, settings: DepthFog, g: float, direction: Array, share=None) -> Array:
    """Sum (n, 3) over the suns above the horizon of phase function, irradiance and tint, times ``share`` of the sine of elevation."""
    value = np.zeros((len(direction), 3))
    for sun in scene.lights:
        mu0 = -sun.direction[2]
        if mu0 > 0.0:
            phase = optics.phase_value(Phase(g), np.clip(direction @ -np.array(sun.direction), -1.0, 1.0))
            value += (phase * (share(mu0) if share else 1.0))[:, None] * np.array(sun.irradiance) * np.array(settings.sun_tint)
    return value


def airlight(scene: Scene, settings: DepthFog, fog: Fog, direction: Array, tau: Array, depth: Array,
             elevations: int = plane_parallel.ELEVATIONS) -> Array:
    """Radiance (n, 3) that the fog scatters into rays of these depths."""
    mu = direction[:, 2]
    value = sunlight(scene, settings, fog.g, direction, lambda mu0: plane_parallel.single_scattering(tau, depth, mu, mu0))
    if max(scene.environment) > 0.0:
        value += plane_parallel.sky_light(tau, depth, mu, fog.g, elevations)[:, None] * np.array(scene.environment)
    return value * np.array(fog.albedo)


def lit_share(scene: Scene, fog: Fog, z: Array, elevations: int = plane_parallel.ELEVATIONS) -> Array:
    """Share (n, 3) of the light on an open level floor at height z that comes through the fog."""
    tau = fog.depth_above(z)
    clear, dimmed = np.zeros(3), np.zeros((len(z), 3))
    for sun in scene.lights:
        mu0 = -sun.direction[2]
        if mu0 > 0.0:
            clear = clear + mu0 * np.array(sun.irradiance)
            dimmed += (mu0 * np.exp(-tau / mu0))[:, None] * np.array(sun.irradiance)
    sky = np.pi * np.array(scene.environment)
    clear = clear + sky
    dimmed += plane_parallel.sky_transmittance(tau, elevations)[:, None] * sky
    return np.where(clear > 0.0, dimmed / np.where(clear > 0.0, clear, 1.0), 1.0)
