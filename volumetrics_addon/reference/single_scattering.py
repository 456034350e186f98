# SPDX-License-Identifier: GPL-3.0-or-later
"""Single scattering by quadrature.

L = integral of sigma_s rho p(cos) E(x) T(light, x) T(x, camera) dt, for each ray and each sun, point and spot light,
with Gauss-Legendre nodes on the intervals where the medium is lit: the light's cone and the shadows of convex bodies
are found, not sampled. For point and spot lights the nodes are placed in the angle seen from the light (equiangular
substitution t = t0 + D tan(theta), Kulla and Fajardo 2012), which takes the 1/d^2 peak out of the integrand.
The sums over the nodes are compiled where numba is installed (``quadrature_kernel``); the NumPy twin is below.

The uniform environment, which arrives from all sides, is estimated with one direction drawn from the phase function
per ray: its weight is a transmittance, so its variance is small and is part of the stated error.
"""

from __future__ import annotations

import numpy as np

from ..physics.projector import projector_breaks, projector_interval
from ..physics.quadrature import gauss_legendre
from ..scene import geometry
from ..scene.model import Box, ExponentialHeight, Homogeneous, Projector, Scene, Spot, Sun
from . import optics
from .frame import render_rays
from .result import Progress, Result

Array = np.ndarray

BIAS = "None up to the order of the quadrature, in single scattering; orders beyond the first are refused."
SETTINGS = tuple({"order": order} for order in (2, 4, 6, 8, 12, 16, 24, 32))

TILE = 1 << 16
# A ray that passes the light closer than this share of its lit interval is cut at these multiples of that distance:
# 16 nodes then keep 1e-6 down to a ten-thousandth of the interval, where one set of nodes keeps 1e-4.
NEAR_LIGHT = 1.0 / 40.0
NEAR_LIGHT_BREAKS = (-200.0, -8.0, 8.0, 200.0)
DOUBT_STRIDE = 16  # one ray in so many is integrated again to state the error, for its neighbours too
EDGES = 1e-8  # relative error from the rounding of the lit intervals' ends
# Between two lines of a gobo's pixels the integrand is nearly a quadratic: with so many nodes 1e-9 on 64 pixels.
GOBO_ORDER = 4
MAX_PIECE_DEPTH = 4.0  # longest optical depth over which one set of nodes is trusted


def applies(scene: Scene) -> str:
    """Empty when the integrator can render the scene, otherwise the reason why not."""
    if scene.orders != 1:
        return f"the scene follows {scene.orders} orders of scattering, this integrator one"
    if scene.is_dielectric:
        return "the scene refracts"
    if not all(isinstance(volume.medium.density, (Homogeneous, ExponentialHeight)) for volume in scene.volumes):
        return "a density of the scene is neither homogeneous nor exponential in height"
    if any(volume.medium.scatters for volume in scene.volumes) and any(max(s.emission) > 0.0 for s in scene.surfaces):
        return "an emitting surface lights a scattering medium"
    if any(max(s.emission) > 0.0 for s in scene.surfaces) and any(max(s.albedo) > 0.0 for s in scene.surfaces):
        return "an emitting surface lights another surface"
    return ""


def render(scene: Scene, width: int, height: int, *, repeats: int = 8, strata: int = 2, order: int = 16, seed: int = 0,
           progress: Progress | None = None) -> Result:
    """Image of the scene in single scattering.

    Each of ``repeats`` equally distributed images averages strata^2 jittered rays per pixel (``strata`` 0: one through its
    centre); ``order`` is the number of Gauss nodes per lit interval. Raises ValueError when the integrator does not
    apply (see ``applies``).
    """
    if reason := applies(scene):
        raise ValueError(f"single_scattering does not apply: {reason}; use path_tracing or dielectric")

    kernel = kernel_of(scene)

    def stated(origin: Array, direction: Array, rng) -> tuple[Array, Array, int]:
        value, evaluations = radiance(scene, origin, direction, rng, order, kernel)
        doubt, more = quadrature_error(scene, origin[::DOUBT_STRIDE], direction[::DOUBT_STRIDE], order, kernel)
        return value, np.repeat(doubt, DOUBT_STRIDE, axis=0)[: len(value)], evaluations + more

    return render_rays("single_scattering", stated, scene, width, height, repeats=repeats, strata=strata, seed=seed,
                       random=max(scene.environment) > 0.0, progress=progress, tile=TILE)


def quadrature_error(scene: Scene, origin: Array, direction: Array, order: int, kernel=None) -> tuple[Array, int]:
    """Estimated absolute error (n, 3) of the in-scattered radiance with ``order`` nodes, and the evaluations spent.

    Gauss' rule converges geometrically where the integrand is analytic: with d the relative difference between the
    rules of n and n/2 points the error of the former is about d^2. d^1.5 leaves room for kinks that were not cut out.
    """
    hit, _ = geometry.first_hit(scene.surfaces, origin, direction, 1e-7 * optics.scale_of(scene))
    (fine, count), (coarse, more) = (in_scattering(scene, origin, direction, hit, n, kernel)
                                     for n in (order, max(1, order // 2)))
    difference = np.abs(fine - coarse)
    relative = difference / np.maximum(np.maximum(fine, coarse), 1e-300)
    return difference * np.sqrt(np.minimum(relative, 1.0)) + EDGES * fine, count + more


def radiance(scene: Scene, origin: Array, direction: Array, rng: np.random.Generator, order: int = 16,
             kernel=None) -> tuple[Array, int]:
    """Radiance (n, 3) arriving along rays (n, 3), and the number of in-scatter evaluations."""
    epsilon = 1e-7 * optics.scale_of(scene)
    hit, index = geometry.first_hit(scene.surfaces, origin, direction, epsilon)
    value, evaluations = in_scattering(scene, origin, direction, hit, order, kernel)
    if scene.surfaces or max(scene.environment) > 0.0:
        behind = surface_radiance(scene, origin, direction, hit, index, rng, epsilon)
        value += behind * np.exp(-optics.optical_depth(scene, origin, direction, hit))
    if any(volume.medium.glows for volume in scene.volumes):
        value += _ambient_scattering(scene, origin, direction, hit, order)
    if max(scene.environment) > 0.0:
        value += environment_scattering(scene, origin, direction, hit, rng, epsilon)
    return value, evaluations


def surface_radiance(scene: Scene, origin: Array, direction: Array, hit: Array, index: Array, rng, epsilon: float,
                     depth=optics.optical_depth) -> Array:
    """Radiance (n, 3) that leaves the first surface, or the environment's where there is none.

    ``depth`` is the function of scene, origins, directions and limits that gives the optical depth towards the light.
    """
    value = np.tile(np.array(scene.environment, float), (len(direction), 1))
    for i, surface in enumerate(scene.surfaces):
        rows = np.flatnonzero(index == i)
        if not len(rows):
            continue
        value[rows] = np.array(surface.emission)
        if max(surface.albedo) > 0.0:
            position = origin[rows] + hit[rows, None] * direction[rows]
            value[rows] += np.array(surface.albedo) * _irradiance(scene, surface, position, direction[rows], rng, epsilon, depth)
    return value


def _irradiance(scene: Scene, surface, position: Array, direction: Array, rng, epsilon: float, depth) -> Array:
    """Irradiance / pi (n, 3) on the side of the surface that faces the ray."""
    normal = geometry.normal(surface.shape, position)
    normal = np.where(np.einsum("ni,ni->n", normal, direction)[:, None] > 0.0, -normal, normal)
    position = position + epsilon * normal
    total = np.zeros((len(position), 3))
    for light in scene.lights:
        toward, distance, irradiance = optics.arriving(light, position)
        cosine = np.maximum(np.einsum("ni,ni->n", normal, toward), 0.0)
        clear = geometry.visible(scene.surfaces, position, toward, distance, epsilon)
        transmittance = np.exp(-depth(scene, position, toward, distance))
        total += irradiance * transmittance * (cosine * clear / np.pi)[:, None]
    if max(scene.environment) > 0.0:
        toward = optics.uniform_hemisphere_cosine(normal, rng)
        clear = geometry.visible(scene.surfaces, position, toward, np.inf, epsilon)
        total += np.exp(-depth(scene, position, toward, np.inf)) * clear[:, None] * np.array(scene.environment)
    return total


def in_scattering(scene: Scene, origin: Array, direction: Array, hit: Array, order: int, kernel=None) -> tuple[Array, int]:
    """In-scattered radiance (n, 3) of all delta lights, and the number of evaluations.

    ``kernel`` sums over the nodes (see ``kernel_of``); without one the NumPy twin does.
    """
    value = np.zeros((len(direction), 3))
    rule = gauss_legendre(order)
    if kernel and kernel.finds_intervals:
        return value, kernel.in_scattering(origin, direction, rule, MAX_PIECE_DEPTH, NEAR_LIGHT, NEAR_LIGHT_BREAKS, value)
    evaluations = 0
    media = [volume for volume in scene.volumes if max(volume.medium.sigma_t) > 0.0]
    for light_index, light in enumerate(scene.lights):
        for volume_index, volume in enumerate(media):
            if not volume.medium.scatters:
                continue
            ray, low, high = _lit_intervals(scene, light, volume, origin, direction, hit)
            if not len(ray):
                continue
            if getattr(light, "gobo", None) is not None and max(light.gobo.shape[:2]) >= 16:
                sums = _integrate(scene, light, volume, origin[ray], direction[ray], low, high,
                                  *gauss_legendre(min(order, GOBO_ORDER)))
            elif kernel:
                sums = kernel.integrate(light_index, volume_index, origin, direction, ray, low, high, rule)
            else:
                sums = _integrate(scene, light, volume, origin[ray], direction[ray], low, high, *rule)
            for channel in range(3):
                value[:, channel] += np.bincount(ray, sums[:, channel], len(value))
            evaluations += order * len(ray)
    return value, evaluations


def _integrate(scene: Scene, light, volume, origin: Array, direction: Array, low: Array, high: Array, nodes: Array,
               weights: Array) -> Array:
    """In-scattered radiance (m, 3) of one light in one volume on the intervals (m,) of rays (m, 3)."""
    t, weight = _gauss(light, origin, direction, low, high, nodes, weights)
    flat = np.repeat(np.arange(len(low)), len(nodes))
    t, weight = t.ravel(), weight.ravel()
    position = origin[flat] + t[:, None] * direction[flat]
    toward, distance, irradiance = optics.arriving(light, position)
    depth = optics.optical_depth(scene, origin[flat], direction[flat], t)
    depth += optics.optical_depth(scene, position, toward, distance)
    cosine = np.clip(np.einsum("ni,ni->n", toward, direction[flat]), -1.0, 1.0)
    scalar = weight * optics.phase_value(volume.medium.phase, cosine) * optics.density_at(volume, position)
    contribution = np.array(volume.medium.sigma_s) * irradiance * np.exp(-depth) * scalar[:, None]
    return contribution.reshape(len(low), len(nodes), 3).sum(axis=1)


def kernel_of(scene: Scene):
    """The scene made ready for the compiled sums, where numba is installed and they support it; otherwise None."""
    try:
        from .quadrature_kernel import Kernel, supports
    except ImportError:
        return None
    return Kernel(scene) if supports(scene) else None


def _lit_intervals(scene: Scene, light, volume, origin: Array, direction: Array, hit: Array) -> tuple[Array, Array, Array]:
    """The parts of the rays where the volume is lit: ray index (m,), entry and exit (m,)."""
    near, far = geometry.interval(volume.domain, origin, direction)
    near, far = np.maximum(near, 0.0), np.minimum(far, hit)
    breaks = [near, far]
    if isinstance(light, Spot):
        local = origin - np.array(light.position)
        c = np.cos(light.cone_angle / 2.0)
        axis = np.array(light.direction)
        outer = geometry.nappe_interval(local, direction, axis, c * c)
        near, far = np.maximum(near, outer[0]), np.minimum(far, outer[1])
        inner = c + (1.0 - c) * light.blend
        breaks = [near, far, *geometry.nappe_interval(local, direction, axis, inner * inner)]
    elif isinstance(light, Projector):
        inside = projector_interval(origin, direction, light_direction=light.direction, **optics.frustum_of(light))
        near, far = np.maximum(near, inside.entry), np.minimum(far, inside.exit)
        breaks = [near, far]
    reaching = np.flatnonzero(near < far)
    origin, direction, near, far = origin[reaching], direction[reaching], near[reaching], far[reaching]
    breaks = [values[reaching] for values in breaks]
    if isinstance(light, Projector) and len(reaching):
        breaks += list(projector_breaks(origin, direction, light_direction=light.direction, falloff=light.falloff,
                                        gobo=light.gobo, **optics.frustum_of(light)).T)
    for other in scene.volumes:
        if other is not volume:
            breaks += geometry.interval(other.domain, origin, direction)
    parallel = isinstance(light, Sun)
    if parallel:
        for other in scene.volumes:
            breaks += _exit_face_changes(other.domain, origin, direction, light)
    else:
        t0, distance = _closest_approach(light, origin, direction)
        close = distance < NEAR_LIGHT * (far - near)
        breaks += [np.where(close, t0 + factor * distance, near) for factor in NEAR_LIGHT_BREAKS]
    source = np.array(light.direction if parallel else light.position)
    shadows = [geometry.shadow_interval(surface, origin, direction, source, parallel) for surface in scene.surfaces]
    shadows = [(low, high) for low, high in shadows if (np.maximum(low, near) < np.minimum(high, far)).any()]
    for shadow in shadows:
        breaks += shadow
    edges = np.sort(np.clip(np.stack(breaks, axis=1), near[:, None], far[:, None]), axis=1)
    low, high = edges[:, :-1], edges[:, 1:]
    lit = high - low > 1e-12 * np.maximum(1.0, np.abs(high))
    middle = (low + high) / 2.0
    for shadow_low, shadow_high in shadows:
        lit &= ~((shadow_low[:, None] < middle) & (middle < shadow_high[:, None]))
    row, column = np.nonzero(lit)
    ray, low, high = reaching[row], low[row, column], high[row, column]
    which, low, high = _pieces(volume, origin[row], direction[row], low, high)
    return ray[which], low, high


def _pieces(volume, origin: Array, direction: Array, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Intervals (m,) cut where they are optically long, so that every set of nodes sees a smooth integrand."""
    depth = max(volume.medium.sigma_t) * optics.density_depth(volume, origin + low[:, None] * direction, direction, high - low)
    pieces = np.clip(np.ceil(depth / MAX_PIECE_DEPTH), 1, 64).astype(int)
    which = np.repeat(np.arange(len(low)), pieces)
    step = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    size = (high - low)[which] / pieces[which]
    return which, low[which] + step * size, low[which] + (step + 1) * size


def _ambient_scattering(scene: Scene, origin: Array, direction: Array, hit: Array, order: int) -> Array:
    """Radiance (n, 3) that the media scatter out of their ambient light: integral of sigma_s rho L_a T(t) dt."""
    value = np.zeros((len(direction), 3))
    nodes, weights = gauss_legendre(order)
    for volume in scene.volumes:
        if not volume.medium.glows:
            continue
        near, far, ray = geometry.crossed(volume.domain, origin, direction, hit)
        ends = [end[ray] for other in scene.volumes for end in geometry.interval(other.domain, origin, direction)]
        edges = np.sort(np.clip(np.stack(ends, axis=1), near[ray, None], far[ray, None]), axis=1)
        row, column = np.nonzero(np.diff(edges, axis=1) > 0.0)
        ray, low, high = ray[row], edges[row, column], edges[row, column + 1]
        which, low, high = _pieces(volume, origin[ray], direction[ray], low, high)
        ray, half = ray[which], (high - low) / 2.0
        for node, weight in zip(nodes, weights):
            t = (low + high) / 2.0 + node * half
            rho = optics.density_at(volume, origin[ray] + t[:, None] * direction[ray])
            reaching = np.exp(-optics.optical_depth(scene, origin[ray], direction[ray], t)) * (weight * half * rho)[:, None]
            np.add.at(value, ray, reaching * np.array(volume.medium.sigma_s) * np.array(volume.medium.ambient))
    return value


def _exit_face_changes(shape, origin: Array, direction: Array, sun: Sun) -> list[Array]:
    """Where along the rays (n,) sunlight begins to come in through another face of a box: there its depth has a kink.

    Towards the sun the faces are s_k(t) = (sign(w_k) h_k - p_k - t d_k) / w_k away, each linear in t; the kinks are
    where two of them are equal.
    """
    if not isinstance(shape, Box):
        return []
    axes = np.array(shape.axes)
    p, d, w = (origin - np.array(shape.center)) @ axes.T, direction @ axes.T, -axes @ np.array(sun.direction)
    faces = [((np.copysign(shape.half[k], w[k]) - p[:, k]) / w[k], -d[:, k] / w[k]) for k in range(3) if abs(w[k]) > 1e-12]
    changes = []
    for i, (start, slope) in enumerate(faces):
        for other_start, other_slope in faces[:i]:
            closing = slope - other_slope
            changes.append(np.where(closing == 0.0, np.inf, (other_start - start) / np.where(closing == 0.0, 1.0, closing)))
    return changes


def _closest_approach(light, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Position t0 (n,) along each ray that is nearest to the light, and its distance D (n,) there."""
    offset = np.array(light.position) - origin
    t0 = np.einsum("ni,ni->n", offset, direction)
    return t0, np.linalg.norm(offset - t0[:, None] * direction, axis=1)


def _gauss(light, origin: Array, direction: Array, low: Array, high: Array, nodes: Array, weights: Array) -> tuple[Array, Array]:
    """Positions and weights (m, order) on [low, high]: in t for parallel light, equiangular for a light at a point.

    With s = tan(theta / 2) the substitution needs no trigonometry: t - t0 = 2 D s / (1 - s^2). Its poles at +-i are far
    enough from [-1, 1] for Gauss' rule to converge as 2.4^(-2 order).
    """
    if isinstance(light, Sun):
        half = (high - low)[:, None] / 2.0
        return (low + high)[:, None] / 2.0 + half * nodes, half * weights
    t0, distance = _closest_approach(light, origin, direction)
    distance = np.maximum(distance, 1e-9 * np.maximum(high - low, 1e-9))
    start, end = ((a - t0) / (distance + np.hypot(a - t0, distance)) for a in (low, high))
    half = (end - start)[:, None] / 2.0
    s = (start + end)[:, None] / 2.0 + half * nodes
    inverse = 1.0 / (1.0 - s * s)
    twice = 2.0 * distance[:, None]
    return t0[:, None] + twice * s * inverse, half * weights * twice * (1.0 + s * s) * inverse**2


def environment_scattering(scene: Scene, origin: Array, direction: Array, hit: Array, rng, epsilon: float,
                           depth=optics.optical_depth) -> Array:
    """One-sample estimate (n, 3) of the environment's single scattering; ``depth`` as in ``surface_radiance``."""
    value = np.zeros((len(direction), 3))
    if max(scene.environment) == 0.0:
        return value
    for volume in scene.volumes:
        if not volume.medium.scatters:
            continue
        near, far, rows = geometry.crossed(volume.domain, origin, direction, hit)
        if not len(rows):
            continue
        o, d = origin[rows], direction[rows]
        length = (far - near)[rows]
        t = near[rows] + rng.random(len(rows)) * length
        position = o + t[:, None] * d
        toward = optics.sample_phase(volume.medium.phase, d, rng)
        clear = geometry.visible(scene.surfaces, position, toward, np.inf, epsilon)
        attenuation = np.exp(-depth(scene, o, d, t) - depth(scene, position, toward, np.inf))
        scalar = length * clear * optics.density_at(volume, position)
        value[rows] += np.array(volume.medium.sigma_s) * np.array(scene.environment) * attenuation * scalar[:, None]
    return value
