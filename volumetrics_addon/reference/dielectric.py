# SPDX-License-Identifier: GPL-3.0-or-later
"""Refracting, absorbing bodies, solid or hollow, and thin panes, by following every reflected and refracted ray.

Smooth interfaces with Fresnel reflectance for unpolarised light, Beer-Lambert inside, emitting surfaces and a uniform
environment outside. The tree of rays is cut where a ray carries less than a given share of a pixel; what is cut, times the
brightest radiance in the scene, is the systematic part of the stated error.

A thin pane is one event: all orders of reflection between its faces are summed in closed form (``plate``). Light goes on in
its direction, so that lamps shine straight through panes on diffuse surfaces and on what covers a pane: there one ray goes on
in a random direction, and lamps are added at once. What a pane mirrors of a lamp onto such a surface is left out: no ray finds
it.
"""

from __future__ import annotations

import numpy as np

from ..physics.transmittance import beer_lambert, plate_path_length
from ..scene import geometry, pane
from ..scene.model import Scene, Sun, Volume
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
    panes = [volume for volume in scene.volumes if volume.sheet]
    if _is_diffuse(scene) and (not panes or any(v.sheet is None and (v.boundary or v.cavity) for v in scene.volumes)):
        return "a diffuse surface is lit through glass; give it emission and albedo 0, or take thin panes"
    if not all(optics.is_closed_form(volume) for volume in scene.volumes):
        return "a density of the scene has no closed-form optical depth"
    return ""


def _is_diffuse(scene: Scene) -> bool:
    covers = [volume.sheet.cover for volume in scene.volumes if volume.sheet and volume.sheet.cover]
    return any(max(body.albedo) > 0.0 for body in (*scene.surfaces, *covers))


def plate(cosine: Array, thickness: float, sigma: Array, ior: float | None) -> tuple[Array, Array]:
    """Shares (n, 3) of light that a plane plate mirrors and lets through, all orders of reflection between its faces together.

    ``cosine`` (n,) of the ray outside, ``sigma`` (n, 3) per metre. With r of one face and t over the path in glass,
    T = (1 - r)^2 t / (1 - r^2 t^2) and R = r (1 + t T); without an ``ior`` the path is straight and nothing is mirrored.
    It is the geometric series over the bounces, of intensities: panes are thicker than light is coherent.
    """
    t = beer_lambert(sigma, plate_path_length(cosine, thickness, ior or 1.0)[:, None])
    if ior is None:
        return np.zeros_like(t), t
    r = fresnel(cosine, np.full(cosine.shape, ior))[0][:, None]
    # At grazing incidence r = 1 and nothing passes, clear or not.
    through = np.where(r < 1.0, (1.0 - r) ** 2 * t / np.where(r < 1.0, 1.0 - (r * t) ** 2, 1.0), 0.0)
    return r * (1.0 + t * through), through


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
    return render_rays("dielectric", lambda origin, direction, rng: radiance(scene, origin, direction, cut, rng), scene, width,
                       height, repeats=repeats, strata=strata, seed=seed, random=_is_diffuse(scene), progress=progress)


def radiance(scene: Scene, origin: Array, direction: Array, cut: float = CUT,
             rng: np.random.Generator | None = None) -> tuple[Array, Array, int]:
    """Radiance (n, 3), the radiance that the cut rays could have carried at most, and the rays followed.

    ``rng`` is needed where something is diffuse; the radiance is then a random estimate.
    """
    epsilon = 1e-7 * optics.scale_of(scene)
    panes = [volume for volume in scene.volumes if volume.sheet is not None]
    solids = [volume for volume in scene.volumes if volume.boundary is not None and volume.sheet is None]
    # (shape, medium within, medium around it, index within over index around); media: -1 air, i the glass of solid i, and its
    # cavity, which is air too, n + i.
    interfaces = [(volume.domain, i, -1, volume.boundary.ior) for i, volume in enumerate(solids)]
    interfaces += [(volume.cavity, len(solids) + i, i, 1.0 / volume.boundary.ior)
                   for i, volume in enumerate(solids) if volume.cavity]
    tinted = Scene(scene.camera, volumes=tuple(v for v in scene.volumes if not v.has_surface))
    environment = np.array(scene.environment)
    brightest = max([max(scene.environment), *(max(s.emission) for s in scene.surfaces),
                     *(max(light.irradiance) / np.pi for light in scene.lights if isinstance(light, Sun))])

    def scattered(at: Array, facing: Array, gaze: Array, carried: Array, source: Array, medium: Array) -> tuple:
        """Light of the lamps, added at once, and one ray on from a Lambert surface; ``carried`` counts its albedo."""
        facing = np.where(np.einsum("ni,ni->n", facing, gaze)[:, None] > 0.0, -facing, facing)
        for light in scene.lights:
            toward, reach, irradiance = optics.arriving(light, at)
            cosine = np.maximum(np.einsum("ni,ni->n", facing, toward), 0.0)
            seen = geometry.visible(scene.surfaces, at, toward, reach, epsilon) & (cosine > 0.0)
            arriving = irradiance * _straight(panes, at, toward, reach, epsilon) * (cosine * seen / np.pi)[:, None]
            np.add.at(value, source, carried * arriving * np.exp(-optics.optical_depth(tinted, at, toward, reach)))
        return source, at, optics.uniform_hemisphere_cosine(facing, rng), carried, medium

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
        pane_t, which = _first_pane(panes, origin, direction, epsilon)
        closer = pane_t < solid_t
        solid_t[closer], solid[closer] = pane_t[closer], len(interfaces) + which[closer]
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
        children = []
        for i, body in enumerate(scene.surfaces):
            rows = np.flatnonzero(ends & (surface == i))
            if max(body.albedo) > 0.0 and len(rows):
                at = origin[rows] + distance[rows, None] * direction[rows]
                children.append(scattered(at, geometry.normal(body.shape, at), direction[rows],
                                          throughput[rows] * np.array(body.albedo), ray[rows], inside[rows]))
        rows = np.flatnonzero(~ends)
        position = origin[rows] + distance[rows, None] * direction[rows]
        for i, volume in enumerate(panes, len(interfaces)):
            mine = solid[rows] == i
            if not mine.any():
                continue
            at, d, carried = position[mine], direction[rows][mine], throughput[rows][mine]
            source, was = ray[rows][mine], inside[rows][mine]
            n = np.broadcast_to(pane.normal_of(volume), at.shape)
            cosine = np.einsum("ni,ni->n", n, d)
            opaque, mirrored, through = _pane(volume, at, np.abs(cosine))
            children.append((source, at, d, carried * through, was))
            if volume.boundary is not None:
                children.append((source, at, d - 2.0 * cosine[:, None] * n, carried * mirrored, was))
            if volume.sheet.cover is not None and max(volume.sheet.cover.albedo) > 0.0:
                carried = carried * opaque[:, None] * np.array(volume.sheet.cover.albedo)
                rows_hit = opaque > 0.0
                children.append(scattered(*(a[rows_hit] for a in (at, n, d, carried, source, was))))
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


def _first_pane(panes: list[Volume], origin: Array, direction: Array, epsilon: float) -> tuple[Array, Array]:
    """Distance (n,) to the nearest pane (inf: none) and its index."""
    distance, index = np.full(len(direction), np.inf), np.full(len(direction), -1)
    for i, volume in enumerate(panes):
        near, far = geometry.interval(volume.domain, origin, direction)
        closer = (near <= far) & (near > epsilon) & (near < distance)
        distance[closer], index[closer] = near[closer], i
    return distance, index


def _pane(volume: Volume, position: Array, cosine: Array) -> tuple[Array, Array, Array]:
    """Opaque share (n,) of a pane where rays meet it, and the shares (n, 3) that it mirrors and lets through."""
    opaque, sigma = pane.looked_up(volume, position)
    mirrored, through = plate(np.minimum(cosine, 1.0), volume.sheet.thickness, sigma, volume.boundary and volume.boundary.ior)
    clear = (1.0 - opaque)[:, None]
    return opaque, clear * mirrored, clear * through


def _straight(panes: list[Volume], position: Array, toward: Array, reach: Array, epsilon: float) -> Array:
    """Share (n, 3) of the light of a lamp that comes straight through all panes on its way."""
    result = np.ones_like(position)
    for volume in panes:
        near, far = geometry.interval(volume.domain, position, toward)
        rows = np.flatnonzero((near <= far) & (near > epsilon) & (near < reach - epsilon))
        if len(rows):
            cosine = np.abs(toward[rows] @ pane.normal_of(volume))
            result[rows] *= _pane(volume, position[rows] + near[rows, None] * toward[rows], cosine)[2]
    return result
