# SPDX-License-Identifier: GPL-3.0-or-later
"""Air from the depth of each pixel, as a compositor can make it: a few slices along the ray, each with a constant source.

The way to the sun is the Chapman function's, light scattered more than once the isotropic closure of UniformScattering, fitted by
polynomials. Bodies and ground are lit by the sun that has come through the air and by a sky of one radiance, as a picture without
air shows them (``at_ground``). Slices as in Hillaire, EGSR 2020; shafts and the sun below the horizon are missing.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..physics.atmosphere import Component, Planet, TransmittanceTable, UniformScattering
from ..physics.chapman import chapman
from ..scene import geometry
from ..scene.model import Color, Ellipsoid, Medium, Scene
from . import optics, planet, single_scattering
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = ("One source a slice, light scattered more than once is made isotropic, bodies cast no shadow into the air: clear skies -2 % to "
        "-4 %, haze and dust -11 % to +9 %, by the channel.")
SLICES = 8
SETTINGS = tuple({"slices": count} for count in (2, 4, SLICES, 16, 32))
DEGREE, UPWARD = 4, 2  # of the closure's polynomial: in the root of the sun's zenith cosine, and in the mass of air below
FITTED, LIGHTEST = 33, 0.98  # of both, up to this share of the mass


@dataclass(frozen=True)
class Closure:
    """Light scattered more than once, for unit irradiance: a polynomial in x = mu_s^(1/2) and u = 1 - exp(-altitude / height).

    ``terms`` (UPWARD + 1, DEGREE + 1, 3) from the constants upwards; ``irradiance`` is what the sky sends to the ground, at the
    sun's present elevation.
    """

    terms: Array
    height: float
    irradiance: Array

    def __call__(self, altitude: Array, mu_s: Array) -> Array:
        x = np.sqrt(np.maximum(mu_s, 0.0))[..., None] ** np.arange(DEGREE + 1)
        u = (-np.expm1(-altitude / self.height))[..., None] ** np.arange(UPWARD + 1)
        return np.maximum(np.einsum("...u,...x,uxc->...c", u, x, self.terms), 0.0)


def closure_of(body: Planet, orders: int, mu_s: float) -> Closure:
    """The closure of a planet's air, fitted over the sun's elevations and evenly over the mass of the air."""
    depth = np.array([np.sum(c.sigma_s) * c.scale_height for c in body.components])
    nothing = np.zeros((UPWARD + 1, DEGREE + 1, 3))
    if not depth.any():
        return Closure(nothing, 1.0, np.zeros(3))
    height = float(depth @ np.array([c.scale_height for c in body.components]) / depth.sum())
    uniform = UniformScattering(body, min(max(orders, 2), 1000), TransmittanceTable(body))
    irradiance = uniform.irradiance(np.array([mu_s]))[0]
    if orders < 2:
        return Closure(nothing, height, irradiance)
    x, u = (a.ravel() for a in np.meshgrid(np.linspace(0.0, 1.0, FITTED), np.linspace(0.0, LIGHTEST, FITTED)))
    altitude = np.minimum(-height * np.log1p(-u), body.top - body.radius)
    basis = (u[:, None, None] ** np.arange(UPWARD + 1)[:, None] * x[:, None, None] ** np.arange(DEGREE + 1)).reshape(len(x), -1)
    terms = np.linalg.lstsq(basis, uniform(body.radius + altitude, x**2), rcond=None)[0]
    return Closure(terms.reshape(UPWARD + 1, DEGREE + 1, 3), height, irradiance)


def planet_of_media(media: Sequence[Medium], domain: Ellipsoid, albedo: Color) -> Planet:
    """The planet whose air these media are, up to the end of the domain around it."""
    components = tuple(Component(m.sigma_s, m.sigma_a, m.density.scale_height, partial(optics.phase_value, m.phase)) for m in media)
    return Planet(media[0].density.radius, domain.half[0], components, albedo)


def view_of(scene: Scene) -> planet.View | str:
    """The planet of the scene without whatever else stands on it, or the reason why there is none."""
    ground = [s for s in scene.surfaces if isinstance(s.shape, Ellipsoid) and any(
        getattr(v.medium.density, "center", None) == s.shape.center and getattr(v.medium.density, "radius", None) == s.shape.half[0]
        for v in scene.volumes)]
    view = planet.planet_of(replace(scene, surfaces=tuple(ground)))
    if isinstance(view, str):
        return view
    if any(max(surface.emission) > 0.0 for surface in scene.surfaces):
        return "an emitting surface lights the air"
    if np.linalg.norm(np.subtract(scene.camera.position, view.center)) > view.planet.top:
        return "the camera is above the air"
    if scene.lights[0].direction[2] > -1e-3:
        return "the sun is not above the horizon"
    return view


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    view = view_of(scene)
    return view if isinstance(view, str) else ""


def below_air(scene: Scene) -> Scene:
    """``at_ground`` of the scene by itself. Raises ValueError where the integrator does not apply."""
    if reason := applies(scene):
        raise ValueError(f"air in the compositor does not apply: {reason}; choose the volume as realisation")
    view = view_of(scene)
    return at_ground(scene, view, closure_of(view.planet, scene.orders, -scene.lights[0].direction[2]))


def at_ground(scene: Scene, view: planet.View, closure: Closure) -> Scene:
    """The scene without its air: the sun as it arrives at the ground, and the sky as an environment of one radiance."""
    sun = scene.lights[0]
    passed = np.exp(-sun_depth(view.planet, np.zeros(1), np.array([-sun.direction[2]]))[0])
    irradiance = tuple(float(e * t) for e, t in zip(sun.irradiance, passed))
    sky = tuple(float(v) for v in closure.irradiance * np.array(sun.irradiance) / np.pi)
    return replace(scene, lights=(replace(sun, irradiance=irradiance),), environment=sky, volumes=(), depth_fog=None)


def sun_depth(body: Planet, altitude: Array, mu_s: Array) -> Array:
    """Optical depth (n, 3) of the air towards the sun at these altitudes."""
    depth = np.zeros((len(altitude), 3))
    for c in body.components:
        way = c.scale_height * np.exp(-altitude / c.scale_height) * chapman(body.radius / c.scale_height, np.clip(mu_s, 0.0, 1.0))
        depth += way[:, None] * (np.array(c.sigma_s) + np.array(c.sigma_a))
    return depth


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, seed: int = 0, slices: int = SLICES,
           progress: Progress | None = None) -> Result:
    """Image of the scene: repeats and strata as in single_scattering, ``slices`` >= 1 along each ray.

    The error estimate of a pixel is the difference to half as many slices. Raises ValueError when the integrator does not apply.
    """
    if reason := applies(scene):
        raise ValueError(f"depth_air does not apply: {reason}; use path_tracing")
    started = time.perf_counter()
    view = view_of(scene)
    closure = closure_of(view.planet, scene.orders, -scene.lights[0].direction[2])
    bare = at_ground(scene, view, closure)

    def radiance(origin: Array, direction: Array, rng) -> tuple[Array, Array, int]:
        value = composited(scene, bare, view, closure, origin, direction, np.random.default_rng(rng.integers(1 << 62)), slices)
        return value[0], np.abs(value[1]), slices * len(origin)

    result = render_rays("depth_air", radiance, scene, width, height, repeats=repeats, strata=strata, seed=seed, random=True,
                         progress=progress)
    return replace(result, seconds=time.perf_counter() - started)


def composited(scene: Scene, bare: Scene, view: planet.View, closure: Closure, origin: Array, direction: Array,
               rng: np.random.Generator, slices: int = SLICES) -> tuple[Array, Array]:
    """Radiance (n, 3) along rays (n, 3), and its difference to half as many slices."""
    epsilon = 1e-7 * optics.scale_of(replace(scene, volumes=(), surfaces=tuple(
        s for s in scene.surfaces if s is not view.ground)) if len(scene.surfaces) > 1 else scene)
    hit, index = geometry.first_hit(bare.surfaces, origin, direction, epsilon)
    seen = single_scattering.surface_radiance(bare, origin, direction, hit, index, rng, epsilon,
                                              depth=lambda scene, position, toward, limit: np.zeros((len(position), 3)))
    seen *= (index >= 0)[:, None]
    values = []
    for count in (slices, max(1, slices // 2)):
        light, passed = march(scene, view, closure, origin, direction, hit, count)
        values.append(light + seen * passed)
    return values[0], values[0] - values[1]


def march(scene: Scene, view: planet.View, closure: Closure, origin: Array, direction: Array, hit: Array,
          slices: int) -> tuple[Array, Array]:
    """In-scattered radiance and transmittance (n, 3) up to ``hit`` or to the end of the air, slices growing with the distance."""
    body = view.planet
    offset = origin - view.center
    start = np.linalg.norm(offset, axis=1)
    altitude = start - body.radius
    mu = np.einsum("ni,ni->n", offset, direction) / start
    mu_s, nu = offset @ view.toward / start, direction @ view.toward
    bend = (1.0 - mu * mu) / (2.0 * start)
    above = np.maximum(body.top - body.radius - altitude, 0.0)
    end = np.minimum(hit, 2.0 * above / (mu + np.sqrt(mu * mu + 4.0 * above * bend)))
    phases = body.phases(np.clip(nu, -1.0, 1.0))
    light, clear = np.zeros((len(end), 3)), np.ones((len(end), 3))
    for k in range(slices):
        low, high = (edge * edge / slices**2 for edge in (k, k + 1))
        s, size = (low + high) / 2.0 * end, (high - low) * end
        h = np.maximum(altitude + s * (mu + s * bend), 0.0)
        sun = np.clip((start * mu_s + s * nu) / (start + h - altitude), -1.0, 1.0)
        each = body.density(body.radius + h)[:, :, None] * body.scattering
        extinction = body.density(body.radius + h) @ body.extinction
        lit = np.exp(-sun_depth(body, h, sun)) * (sun > 0.0)[:, None]
        source = np.einsum("ncx,nc->nx", each, phases) * lit + closure(h, sun) * each.sum(axis=1)
        depth = extinction * size[:, None]
        passed = np.exp(-depth)
        light += source * clear * np.where(depth > 1e-9, -np.expm1(-depth) / np.maximum(extinction, 1e-300), size[:, None])
        clear = clear * passed
    return light * view.irradiance, clear
