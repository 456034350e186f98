# SPDX-License-Identifier: GPL-3.0-or-later
"""What to take off the lights of an engine that dims them in part only: EEVEE.

It does not dim light on its way to surfaces. In media it dims a sun's by what lies within the picture's frustum alone, and the
sky's not at all, nor do bodies shadow the latter there. Shares are ratios of means over the picture, of the light that reaches the
camera over that which the engine would show, so that the mean of each kind of light is right:

* of a lamp on surfaces: sum(T_camera rho E cos V T_light) / sum(T_camera rho E cos V) over the surfaces that the picture shows,
  with the visibility V of the light from there;
* of a lamp in media: sum(T_camera sigma_s p E V T_light) / sum(T_camera sigma_s p E V T_engine) over points on the rays;
* of the sky: the same on surfaces and in media together, of which it has one share.

Where the scene follows more orders of scattering than one, the numerators are those of path tracing, all lamps together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..scene import geometry
from ..scene.bake import voxelized
from ..scene.model import Color, ExponentialAltitude, NoiseShape, Scene, Sun, Volume
from . import optics, path_tracing

Array = np.ndarray
SIZE = 32  # pixels along the longer side of the picture whose means these are
STRATA = 16  # of a ray, and directions to the sky from its end
PATHS, SURFACE_PATHS = 64, 16  # of each pixel, for many orders; of those that leave surfaces
NEAR = 10.0  # smallest distances before a surface at which the latter begin
VOXELS = 48  # along the longest side of noise
DARK: Color = (0.0, 0.0, 0.0)
WHOLE: Color = (1.0, 1.0, 1.0)
MOST = 100.0  # share; a light that single scattering hardly shows


@dataclass(frozen=True)
class Balance:
    """Shares of each lamp's light on surfaces and in media, and of the sky's in both; 1 where there is nothing to take off.

    With many orders of scattering they may be above 1."""

    surfaces: tuple[Color, ...]
    media: tuple[Color, ...]
    sky: Color = WHOLE


def applies(scene: Scene) -> str:
    """Empty where the shares can be told, otherwise the reason why not."""
    if scene.is_dielectric:
        return "the scene refracts"
    if any(isinstance(volume.medium.density, ExponentialAltitude) for volume in scene.volumes):
        return "the shares of a planet's air are other than its picture's mean"
    if not any(max(volume.medium.sigma_t) > 0.0 for volume in scene.volumes):
        return "nothing dims the light"
    return ""


def balance(scene: Scene, aspect: float = 1.0, seed: int = 0) -> Balance:
    """The shares for a picture whose width is ``aspect`` times its height. Dust counts with its mean density, noise in voxels.

    Raises ValueError where ``applies`` gives a reason.
    """
    if reason := applies(scene):
        raise ValueError(f"the light on surfaces cannot be balanced: {reason}")
    scene = replace(scene, volumes=tuple(map(_with_known_depth, scene.volumes)))
    width, height = max(1, round(SIZE * min(1.0, aspect))), max(1, round(SIZE / max(1.0, aspect)))
    rng, epsilon = np.random.default_rng(seed), 1e-7 * optics.scale_of(scene)
    y, x = (axis.ravel() + 0.5 for axis in np.mgrid[:height, :width])
    origin, direction = geometry.camera_rays(scene.camera, width, height, x, y)
    hit, index = geometry.first_hit(scene.surfaces, origin, direction, epsilon)
    lamps, sky = _on_surfaces(scene, origin, direction, hit, index, epsilon, rng)
    glow, sky_glow = _in_media(scene, width / height, origin, direction, hit, epsilon, rng)
    sky += sky_glow
    if scene.orders == 1:
        return Balance(tuple(map(_share, lamps)), tuple(map(_share, glow)), _share(sky))
    through = np.exp(-optics.optical_depth(scene, origin, direction, hit))
    by_sky = replace(scene, lights=(), surfaces=tuple(replace(surface, emission=DARK) for surface in scene.surfaces))
    by_lamps = replace(by_sky, lights=scene.lights, environment=DARK)

    def traced(part: Scene) -> Array:
        return path_tracing.render(part, width, height, repeats=1, strata=2, samples=PATHS, seed=seed).image.mean(axis=(0, 1))

    surfaces = media = of_sky = WHOLE
    if scene.lights:
        rows = np.flatnonzero(index >= 0)
        near = origin[rows] + np.maximum(hit[rows] - NEAR * epsilon, 0.0)[:, None] * direction[rows]
        leaving = sum(path_tracing.radiance(by_lamps, near, direction[rows], rng)[0] for _ in range(SURFACE_PATHS)) / SURFACE_PATHS
        seen = (leaving * through[rows]).sum(axis=0)
        surfaces = _share(np.stack([seen, lamps[:, 1].sum(axis=0)]))
        media = _share(np.stack([traced(by_lamps) * len(hit) - seen, glow[:, 1].sum(axis=0)]))
    if max(scene.environment) > 0.0:
        backdrop = (np.array(scene.environment) * through[index < 0]).sum(axis=0)
        of_sky = _share(np.stack([traced(by_sky) * len(hit) - backdrop, sky[1]]))
    return Balance((surfaces,) * len(scene.lights), (media,) * len(scene.lights), of_sky)


def _with_known_depth(volume: Volume) -> Volume:
    """The volume with a density whose depth along a ray has a closed form: dust evened out, noise in voxels."""
    if isinstance(volume.medium.density, NoiseShape):
        return voxelized(volume, VOXELS)
    return optics.evened(volume)


def _share(sums: Array) -> Color:
    """First over second (2, 3); 1 where there is nothing."""
    return tuple(float(min(part / whole, MOST)) if whole > 0.0 else 1.0 for part, whole in zip(*sums))


def _on_surfaces(scene: Scene, origin: Array, direction: Array, hit: Array, index: Array, epsilon: float,
                 rng: np.random.Generator) -> tuple[Array, Array]:
    """Radiance that arrives from surfaces, dimmed and undimmed on its way to them: (lights, 2, 3) and of the sky (2, 3)."""
    lamps, sky = np.zeros((len(scene.lights), 2, 3)), np.zeros((2, 3))
    through = np.exp(-optics.optical_depth(scene, origin, direction, hit))
    for i, surface in enumerate(scene.surfaces):
        rows = np.flatnonzero(index == i)
        if not len(rows) or max(surface.albedo) == 0.0:
            continue
        position = origin[rows] + hit[rows, None] * direction[rows]
        normal = geometry.normal(surface.shape, position)
        normal = np.where(np.einsum("ni,ni->n", normal, direction[rows])[:, None] > 0.0, -normal, normal)
        position = position + epsilon * normal
        seen = through[rows] * np.array(surface.albedo)

        def add(sums: Array, toward: Array, distance: Array | float, radiance: Array) -> None:
            clear = geometry.visible(scene.surfaces, position, toward, distance, epsilon)
            whole = seen * radiance * clear[:, None]
            sums[0] += (whole * np.exp(-optics.optical_depth(scene, position, toward, distance))).sum(axis=0)
            sums[1] += whole.sum(axis=0)

        for light, sums in zip(scene.lights, lamps):
            toward, distance, irradiance = optics.arriving(light, position)
            add(sums, toward, distance, irradiance * np.maximum(np.einsum("ni,ni->n", normal, toward), 0.0)[:, None] / np.pi)
        if max(scene.environment) > 0.0:
            for _ in range(STRATA):
                add(sky, optics.uniform_hemisphere_cosine(normal, rng), np.inf, np.array(scene.environment) / STRATA)
    return lamps, sky


def _in_media(scene: Scene, aspect: float, origin: Array, direction: Array, hit: Array, epsilon: float,
              rng: np.random.Generator) -> tuple[Array, Array]:
    """Radiance that media scatter towards the camera once, as it is and as the engine shows it: (lights, 2, 3), of the sky (2, 3)."""
    lamps, sky = np.zeros((len(scene.lights), 2, 3)), np.zeros((2, 3))
    for volume in scene.volumes:
        if not volume.medium.scatters:
            continue
        near, far, rows = geometry.crossed(volume.domain, origin, direction, hit)
        length, along = (far - near)[rows], direction[rows]
        for stratum in range(STRATA):
            t = near[rows] + (stratum + rng.random(len(rows))) / STRATA * length
            position = origin[rows] + t[:, None] * along
            weight = length * optics.density_at(volume, position) / STRATA
            seen = np.array(volume.medium.sigma_s) * weight[:, None] * np.exp(-optics.optical_depth(scene, origin[rows], along, t))
            for light, sums in zip(scene.lights, lamps):
                toward, distance, irradiance = optics.arriving(light, position)
                cosine = np.clip(np.einsum("ni,ni->n", toward, along), -1.0, 1.0)
                clear = geometry.visible(scene.surfaces, position, toward, distance, epsilon)
                whole = seen * irradiance * (optics.phase_value(volume.medium.phase, cosine) * clear)[:, None]
                dimmed = whole * np.exp(-optics.optical_depth(scene, position, toward, distance))
                sums[0] += dimmed.sum(axis=0)
                if isinstance(light, Sun):
                    dimmed = whole * np.exp(-_frustum_depth(scene, aspect, position, toward))
                sums[1] += dimmed.sum(axis=0)
            if max(scene.environment) > 0.0:
                toward = optics.sample_phase(volume.medium.phase, along, rng)
                clear = geometry.visible(scene.surfaces, position, toward, np.inf, epsilon)
                whole = seen * np.array(scene.environment)
                sky[0] += (whole * clear[:, None] * np.exp(-optics.optical_depth(scene, position, toward, np.inf))).sum(axis=0)
                sky[1] += whole.sum(axis=0)
    return lamps, sky


def _frustum_depth(scene: Scene, aspect: float, position: Array, toward: Array) -> Array:
    """Optical depth (n, 3) towards a sun of what lies in the frustum of a picture of this aspect."""
    camera = scene.camera
    right, up, ahead = geometry.view_axes(camera)
    wide = np.tan(camera.field_of_view / 2.0)
    low, high = np.zeros(len(position)), np.full(len(position), np.inf)
    offset = position - np.array(camera.position)
    for side in (right, -right, up * aspect, -up * aspect):
        plane = wide * ahead - side  # the product with an offset is >= 0 inside
        first, last = geometry.half_line(offset @ plane, toward @ plane)
        low, high = np.maximum(low, first), np.minimum(high, last)
    inside = low < high
    start = position + np.where(inside, low, 0.0)[:, None] * toward
    return optics.optical_depth(scene, start, toward, np.where(inside, high - low, 0.0))
