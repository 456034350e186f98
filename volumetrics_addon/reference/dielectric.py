# SPDX-License-Identifier: GPL-3.0-or-later
"""Refracting, absorbing bodies, solid or hollow, by following every reflected and refracted ray.

Smooth interfaces with Fresnel reflectance for unpolarised light, Beer-Lambert inside, emitting surfaces and a uniform
environment outside. The tree of rays is cut where a ray carries less than a given share of a pixel; what is cut, times the
brightest radiance in the scene, is the systematic part of the stated error.
"""

from __future__ import annotations

import numpy as np

from ..scene import geometry
from ..scene.model import Scene
from . import optics
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = "None beyond the rays that carry less than a stated share of a pixel."
SETTINGS = tuple({"cut": 10.0**-exponent} for exponent in range(1, 8))

CUT = 1e-6
MAX_DEPTH = 64


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    if any(volume.medium.scatters for volume in scene.volumes):
        return "a medium of the scene scatters"
    if any(max(surface.albedo) > 0.0 for surface in scene.surfaces):
        return "a diffuse surface is lit through glass; give it emission and albedo 0"
    if not all(optics.is_closed_form(volume) for volume in scene.volumes):
        return "a density of the scene has no closed-form optical depth"
    return ""


def fresnel(cos_incident: Array, ior: Array) -> tuple[Array, Array]:
    """Reflectance for unpolarised light and the cosine of the refracted ray, both (n,).

    ``cos_incident`` in [0, 1] on the incident side, ``ior`` the refracted side's index over the incident side's.
    R = (r_s^2 + r_p^2) / 2; 1 and 0 beyond the critical angle. Source: Born and Wolf, Principles of Optics, 1.5.
    """
    sine2 = np.maximum(0.0, 1.0 - cos_incident**2) / ior**2
    cos_refracted = np.sqrt(np.maximum(0.0, 1.0 - sine2))
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (cos_incident - ior * cos_refracted) / (cos_incident + ior * cos_refracted)
        p = (ior * cos_incident - cos_refracted) / (ior * cos_incident + cos_refracted)
    reflectance = (s * s + p * p) / 2.0
    # At cos = 0 with ior = 1 both quotients are 0 / 0: nothing bends, nothing is reflected.
    reflectance = np.where(np.isnan(reflectance), 0.0, reflectance)
    total = sine2 >= 1.0
    total &= ior < 1.0
    return np.where(total, 1.0, reflectance), np.where(total, 0.0, cos_refracted)


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, cut: float = CUT,
           seed: int = 0, progress: Progress | None = None) -> Result:
    """Image of the scene through glass; each of ``repeats`` images averages strata^2 jittered rays per pixel.

    Rays that carry less than ``cut`` of a pixel are not followed; the error states what they could have brought.

    Raises ValueError when the integrator does not apply (see ``applies``).
    """
    if reason := applies(scene):
        raise ValueError(f"dielectric does not apply: {reason}")
    return render_rays("dielectric", lambda origin, direction, rng: radiance(scene, origin, direction, cut), scene, width,
                       height, repeats=repeats, strata=strata, seed=seed, random=False, progress=progress)


def radiance(scene: Scene, origin: Array, direction: Array, cut: float = CUT) -> tuple[Array, Array, int]:
    """Radiance (n, 3), the radiance that the cut rays could have carried at most, and the rays followed."""
    epsilon = 1e-7 * optics.scale_of(scene)
    solids = [volume for volume in scene.volumes if volume.boundary is not None]
    # (shape, medium within, medium around it, index within over index around); media: -1 air, i the glass of solid i, and its
    # cavity, which is air too, n + i.
    interfaces = [(volume.domain, i, -1, volume.boundary.ior) for i, volume in enumerate(solids)]
    interfaces += [(volume.cavity, len(solids) + i, i, 1.0 / volume.boundary.ior)
                   for i, volume in enumerate(solids) if volume.cavity]
    tinted = Scene(scene.camera, volumes=tuple(v for v in scene.volumes if v.boundary is None))
    environment = np.array(scene.environment)
    brightest = max([max(scene.environment), *(max(s.emission) for s in scene.surfaces)])
    value = np.zeros((len(direction), 3))
    ray = np.arange(len(direction))
    throughput = np.ones((len(direction), 3))
    inside = np.full(len(direction), -1)
    lost, followed = np.zeros((len(direction), 3)), 0
    for depth in range(MAX_DEPTH):
        if not len(ray):
            break
        followed += len(ray)
        surface_t, surface = geometry.first_hit(scene.surfaces, origin, direction, epsilon)
        solid_t = np.full(len(ray), np.inf)
        solid = np.full(len(ray), -1)
        for i, (shape, within, without, _) in enumerate(interfaces):
            near, far = geometry.interval(shape, origin, direction)
            t = np.where(inside == within, far, np.where((inside == without) & (near > epsilon), near, np.inf))
            t = np.where((near < far) & (t > -epsilon), np.maximum(t, 0.0), np.inf)
            closer = t < solid_t
            solid_t[closer], solid[closer] = t[closer], i
        distance = np.minimum(surface_t, solid_t)
        throughput = throughput * np.exp(-optics.optical_depth(tinted, origin, direction, distance))
        for i, volume in enumerate(solids):
            rows = inside == i
            throughput[rows] *= np.exp(-distance[rows, None] * np.array(volume.medium.sigma_t))
        ends = surface_t <= solid_t  # also true where both are infinite
        for i in range(-1, len(scene.surfaces)):
            rows = np.flatnonzero(ends & (surface == i))
            emitted = environment if i < 0 else np.array(scene.surfaces[i].emission)
            np.add.at(value, ray[rows], throughput[rows] * emitted)
        rows = np.flatnonzero(~ends)
        position = origin[rows] + distance[rows, None] * direction[rows]
        children = []
        for i, (shape, within, without, index) in enumerate(interfaces):
            mine = solid[rows] == i
            at, d = position[mine], direction[rows][mine]
            n = geometry.normal(shape, at)
            cosine = np.einsum("ni,ni->n", n, d)
            leaving = cosine > 0.0
            n = np.where(leaving[:, None], -n, n)
            cosine = np.minimum(np.abs(cosine), 1.0)
            ior = np.where(leaving, 1.0 / index, index)
            reflectance, cos_refracted = fresnel(cosine, ior)
            carried, source = throughput[rows][mine], ray[rows][mine]
            was = inside[rows][mine]
            reflected = d + 2.0 * cosine[:, None] * n
            refracted = d / ior[:, None] + (cosine / ior - cos_refracted)[:, None] * n
            children.append((source, at, reflected, carried * reflectance[:, None], was))
            children.append((source, at, refracted, carried * (1.0 - reflectance)[:, None], np.where(leaving, without, within)))
        if not children:
            break
        ray, origin, direction, throughput, inside = (np.concatenate(parts) for parts in zip(*children))
        direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-300)
        keep = throughput.max(axis=1) > cut
        np.add.at(lost, ray[~keep], throughput[~keep] * brightest)
        ray, origin, direction, throughput, inside = (a[keep] for a in (ray, origin, direction, throughput, inside))
    else:
        np.add.at(lost, ray, throughput * brightest)
    return value, lost, followed
