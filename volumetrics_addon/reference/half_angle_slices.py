# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices halfway between view and light: a light buffer is dimmed slice by slice while the eye gathers the light.

For each light the media are cut into ``slices`` slabs whose normal halves the angle between the direction of view and that
of the light, or of the reversed view where the two oppose each other: slabs in the order in which the light passes them
are then in front-to-back or back-to-front order for the eye, and both cross them at 45 degrees or less. A buffer of
``resolution`` x ``resolution`` light rays holds the light left at each plane between slabs; every slab dims it by its
extinction, and the eye's rays, attenuated slab by slab too, read it at their middle in the slab (Kniss, Premoze, Hansen,
Shirley and McPherson, A model for volume lighting and modeling, IEEE TVCG 2003; Ikits, Kniss, Lefohn and Hansen, GPU Gems,
chapter 39). Surfaces cast shadows by ray, not by the buffer, and are dimmed by the media's optical depth.

``blur`` > 0 (rad) is the papers' forward multiple scattering: what a slab scatters out of the light, its albedo times
what it takes, stays in the buffer, spread over a cone of this half angle.

Lights must stand where all their rays cross the slabs forward: suns, point lights outside the media, narrow spots.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ..scene import geometry
from ..scene.model import ExponentialAltitude, Point, Projector, Scene, Spot, Sun, look_frame
from . import marching, optics
from .result import Progress, Result

Array = np.ndarray

BIAS = ("Error of the slices and of the light buffer's resolution, second order where light and media are smooth. Without "
        "blur single scattering only; with it everything counts as scattered forwards: on balls of optical radius 2 the mean was "
        "0.3 (sun behind the camera) to 3.1 times (against the sun) the path-traced truth, of radius 8 0.1 to 25 times.")
SETTINGS = tuple({"slices": slices, "resolution": resolution}
                 for slices, resolution in ((4, 8), (8, 8), (16, 16), (32, 16), (64, 32), (128, 32), (256, 64)))

LEAST_COSINE = 0.15  # between the slabs' normal and every light ray
TAPS = 8  # directions over which the blur spreads


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    if reason := marching.applies(scene):
        return reason
    if reason := marching.glowing(scene):
        return reason
    if not scene.volumes:
        return ""
    if any(isinstance(volume.medium.density, ExponentialAltitude) for volume in scene.volumes):
        return "the air of a planet is a shell too thin for slices through all of it"
    for light in scene.lights:
        if isinstance(light, Projector):
            return "the light buffer holds no projected image"
        if _Buffer.rays_of(scene, light, np.array((0.0, 1.0)))[1].min() < LEAST_COSINE:
            return f"rays of a {type(light).__name__} light in or close to the media cross no common slices"
    return ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, slices: int = 64,
           resolution: int = 32, blur: float = 0.0, light_steps: int = marching.LIGHT_STEPS, seed: int = 0,
           progress: Progress | None = None) -> Result:
    """Image of the scene with ``slices`` slabs per light and light buffers of ``resolution`` squared.

    The stated error adds that of the slabs and the difference made by a light buffer of half the slabs and resolution.
    ``repeats`` and ``strata`` are those of ray_marching, ``light_steps`` act on surfaces behind media without closed-form
    optical depth. Raises ValueError when the integrator does not apply (see ``applies``), for fewer than one slice,
    resolutions below 2 and blurs outside [0, 1] rad.
    """
    marching.refuse("half_angle_slices", applies(scene))
    marching.counted("slices", slices, "use 16 for a preview, 128 for a reference")
    marching.counted("resolution", resolution, "use 16 for a preview, 64 for a reference", least=2)
    marching.counted("light_steps", light_steps, "use 8 for a preview, 64 for a reference")
    if not 0.0 <= blur <= 1.0:
        raise ValueError(f"blur must be in [0, 1] rad, got {blur!r}; 0 is single scattering, 0.2 a narrow cone")
    lights = scene.lights if scene.volumes else ()
    sizes = ((slices, resolution), (marching.fewer(slices), max(2, resolution // 2)))
    buffers = cache(lambda: [[_Buffer(scene, light, *size, blur) for size in sizes] for light in lights])

    def gather(origin: Array, direction: Array, hit: Array) -> tuple[Array, Array, int]:
        return marching.summed((_gathered(scene, light, *pair, origin, direction, hit) for light, pair in zip(lights, buffers())),
                               len(hit))

    return marching.render_gathered("half_angle_slices", gather, scene, width, height, slices, light_steps, repeats=repeats,
                                    strata=strata, seed=seed, progress=progress)


def half_vector(view: Array, travel: Array) -> Array:
    """Unit normal of the slabs: halfway between the light's direction of travel and the view, or the view reversed."""
    half = travel + (view if view @ travel >= 0.0 else -view)
    return half / np.linalg.norm(half)


def _gathered(scene: Scene, light, fine: _Buffer, coarse: _Buffer, origin: Array, direction: Array,
              hit: Array) -> tuple[Array, Array, int]:
    """Light (n, 3) scattered from the slabs into the rays, its doubt (n, 3) and the number of samples."""
    slices = len(fine.planes) - 1
    near, far = marching.media_interval(scene, origin, direction, hit)
    cut = marching.slabs(origin, direction, near, far, fine.normal, fine.planes)
    d = direction[cut.ray]
    position = origin[cut.ray] + cut.middle[:, None] * d
    # In the eye's order: a ray against the normal meets the last slab first.
    slab = np.where(d @ fine.normal >= 0.0, cut.slab, slices - 1 - cut.slab)

    def by_slab(values: Array) -> Array:
        table = np.zeros((len(direction), slices, *values.shape[1:]))
        table[cut.ray, slab] = values
        return table

    length, sigma_t = by_slab(cut.length), by_slab(marching.extinction(scene, position))
    value, other = (marching.integrate(by_slab(marching.scattered_toward(scene, light, position, d, buffer.depth)), sigma_t,
                                       length)[0] for buffer in (fine, coarse))
    return value.sum(axis=1), marching.nested_doubt(value, length) + np.abs((value - other).sum(axis=1)), len(cut.ray)


class _Buffer:
    """``left`` (slices + 1, resolution, resolution, 3): optical depth of the light at the planes between the slabs."""

    def __init__(self, scene: Scene, light, slices: int, resolution: int, blur: float):
        self.normal, cosine, self.frame, self.low, self.high, origin, direction = self.rays_of(
            scene, light, (np.arange(resolution) + 0.5) / resolution)
        self.light, self.resolution = light, resolution
        extent = marching.media_corners(scene) @ self.normal
        self.planes = np.linspace(extent.min(), extent.max(), slices + 1)
        sigma_s, sigma_t = np.zeros((2, len(direction), slices, 3))
        for volume in scene.volumes:
            near, far = geometry.interval(volume.domain, origin, direction)
            if not isinstance(light, Sun):
                near = np.maximum(near, 0.0)
            cut = marching.slabs(origin, direction, near, far, self.normal, self.planes)
            amount = cut.length * optics.density_at(volume, origin[cut.ray] + cut.middle[:, None] * direction[cut.ray])
            sigma_s[cut.ray, cut.slab] += amount[:, None] * np.array(volume.medium.sigma_s)
            sigma_t[cut.ray, cut.slab] += amount[:, None] * np.array(volume.medium.sigma_t)
        shape = (slices + 1, resolution, resolution, 3)
        if blur == 0.0:
            start = np.zeros((len(direction), 1, 3))
            self.left = np.concatenate([start, np.cumsum(sigma_t, axis=1)], axis=1).swapaxes(0, 1).reshape(shape)
            return
        taken = -np.expm1(-sigma_t)
        kept = taken * sigma_s / np.where(sigma_t > 0.0, sigma_t, 1.0)
        taken, kept = (x.swapaxes(0, 1).reshape(slices, *shape[1:]) for x in (taken, kept))
        width = np.tan(blur) * np.diff(self.planes)
        middle = (self.planes[:-1] + self.planes[1:]) / 2.0
        light_left = np.ones(shape)
        for k in range(slices):
            scattered = kept[k] * spread(light_left[k], width[k] / self._texel(middle[k]))
            light_left[k + 1] = light_left[k] * (1.0 - taken[k]) + scattered
        self.left = -np.log(np.maximum(light_left, 1e-300))

    @staticmethod
    def rays_of(scene: Scene, light: Sun | Point | Spot, grid: Array) -> tuple:
        """Normal of the slabs, cosines (n,) of the light rays to it, the light's axes, bounds of the buffer, the n rays.

        ``grid`` (k,) are the rays' positions in [0, 1] across the buffer, along either side.
        """
        corners = marching.media_corners(scene)
        view = geometry.view_axes(scene.camera)[2]
        center = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
        if isinstance(light, Point):
            offset = center - np.array(light.position)
            distance = np.linalg.norm(offset)
            travel = offset / distance if distance > 0.0 else view
        else:
            travel = np.array(light.direction)
        frame = np.array(look_frame(tuple(travel)))
        frame[2] = travel
        if isinstance(light, Sun):
            local = corners @ frame.T
            low, high = local[:, :2].min(axis=0), local[:, :2].max(axis=0)
            u, v = (low[k] + (high[k] - low[k]) * grid for k in (0, 1))
            y, x = (a.ravel() for a in np.meshgrid(v, u, indexing="ij"))
            origin = np.stack([x, y, np.zeros(len(x))], axis=1) @ frame
            direction = np.broadcast_to(travel, origin.shape)
        else:
            local = (corners - np.array(light.position)) @ frame.T
            # Corners behind the light leave the plane of its image: the widest angle stands for them.
            slope = local[:, :2] / np.maximum(local[:, 2:], 1e-3 * np.linalg.norm(local, axis=1, keepdims=True) + 1e-300)
            low, high = slope.min(axis=0), slope.max(axis=0)
            if isinstance(light, Spot):
                widest = np.tan(min(light.cone_angle / 2.0, np.radians(89.9)))
                low, high = np.clip(low, -widest, 0.0), np.clip(high, 0.0, widest)
            u, v = (low[k] + (high[k] - low[k]) * grid for k in (0, 1))
            y, x = (a.ravel() for a in np.meshgrid(v, u, indexing="ij"))
            direction = np.stack([x, y, np.ones(len(x))], axis=1) @ frame
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            origin = np.broadcast_to(np.array(light.position), direction.shape)
        normal = half_vector(view, travel)
        return normal, direction @ normal, frame, low, high, origin, direction

    def _texel(self, plane: float) -> float:
        """Mean width of a texel where the light crosses a plane between slabs."""
        width = float(np.mean(self.high - self.low)) / self.resolution
        if not isinstance(self.light, Sun):
            width *= abs(plane - np.array(self.light.position) @ self.normal)
        return max(width, 1e-300)

    def depth(self, position: Array, toward: Array, limit: Array) -> Array:
        """Optical depth (n, 3) of the light at positions, trilinear in the buffer's texels and planes."""
        if isinstance(self.light, Sun):
            at = (position @ self.frame.T)[:, :2]
        else:
            local = (position - np.array(self.light.position)) @ self.frame.T
            at = local[:, :2] / np.maximum(local[:, 2:], 1e-300)
        u, v = (np.clip((at - self.low) / np.maximum(self.high - self.low, 1e-300), 0.0, 1.0) * self.resolution).T
        step = self.planes[1] - self.planes[0]
        plane = (position @ self.normal - self.planes[0]) / max(step, 1e-300) + 0.5
        value = np.zeros((len(position), 3))
        rows, columns, planes = (((low, 1.0 - weight), (high, weight)) for low, high, weight in (
            marching.linear_weights(v, self.resolution), marching.linear_weights(u, self.resolution),
            marching.linear_weights(plane, len(self.planes))))
        for i, share_i in rows:
            for j, share_j in columns:
                for k, share_k in planes:
                    value += (share_i * share_j * share_k)[:, None] * self.left[k, i, j]
        return value


def spread(image: Array, radius: float) -> Array:
    """Mean (r, r, 3) of an image shifted by ``radius`` texels in the directions of the blur."""
    total = np.zeros(image.shape)
    cells = np.arange(len(image)) + 0.5
    for angle in 2.0 * np.pi * np.arange(TAPS) / TAPS:
        low, high, weight = marching.linear_weights(cells + radius * np.sin(angle), len(image))
        shifted = image[low] * (1.0 - weight)[:, None, None] + image[high] * weight[:, None, None]
        low, high, weight = marching.linear_weights(cells + radius * np.cos(angle), len(image))
        total += shifted[:, low] * (1.0 - weight)[:, None] + shifted[:, high] * weight[:, None]
    return total / TAPS
