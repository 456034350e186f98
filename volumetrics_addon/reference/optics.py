# SPDX-License-Identifier: GPL-3.0-or-later
"""What the integrators share: optical depths through volumes, lights, surface lighting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..physics import atmosphere, grid, projector
from ..physics import phase as phase_functions
from ..physics.transmittance import height_optical_depth
from ..scene import geometry, noise
from ..scene.model import (
    AnyPhase, Dust, ExponentialAltitude, ExponentialHeight, Grid, Homogeneous, Hull, MiePhase, NoiseShape, Projector, RayleighPhase, Scene,
    Spot, Sun, Volume,
)

Array = np.ndarray

# Far below the base of an exponential density, more than this is no more opaque, and products of it would overflow.
DENSEST = 1e100


def scale_of(scene: Scene) -> float:
    """A length that stands for the scene (m), for tolerances on distances."""
    sizes = [1e-3]
    for item in (*scene.volumes, *scene.surfaces):
        shape = item.domain if isinstance(item, Volume) else item.shape
        if isinstance(shape, Hull):
            sizes.append(max(max(values) - min(values) for values in zip(*shape.corners)) / 2.0)
        else:
            sizes.append(max(shape.half) if hasattr(shape, "half") else shape.length)
    return max(sizes)


def phase_value(phase: AnyPhase, cos_theta: Array) -> Array:
    """Value per steradian of a phase function at cosines between -1 and 1."""
    match phase:
        case RayleighPhase():
            return phase_functions.rayleigh(cos_theta)
        case MiePhase():
            return phase_functions.mie_fit(cos_theta, phase.droplet_diameter)
    if phase.weight == 0.0:
        return phase_functions.henyey_greenstein(cos_theta, phase.g0)
    return phase_functions.dual_henyey_greenstein(cos_theta, phase.g0, phase.g1, phase.weight)


def is_closed_form(volume: Volume) -> bool:
    """Whether the density's integral along a ray is known to rounding, without sampling."""
    return not isinstance(volume.medium.density, (NoiseShape, Dust))


def density_at(volume: Volume, position: Array) -> Array:
    """Density (n,) at positions (n, 3) inside the domain."""
    match volume.medium.density:
        case ExponentialHeight() as density:
            return density_of_altitude(position[:, 2] - density.base_height, density.scale_height)
        case ExponentialAltitude() as density:
            radius = np.linalg.norm(position - np.array(density.center), axis=1)
            return density_of_altitude(radius - density.radius, density.scale_height)
        case NoiseShape() as density:
            return noise.density(density, position)
        case Dust() as density:
            return noise.dust_density(density, position)
        case Grid() as density:
            return grid.grid_density(density.values, density.low, density.high, position)
    return np.ones(len(position))


def density_of_altitude(altitude: Array, scale_height: float) -> Array:
    """exp(-altitude / scale_height), at most DENSEST."""
    return np.exp(np.minimum(-altitude / scale_height, np.log(DENSEST)))


def density_depth(volume: Volume, origin: Array, direction: Array, limit: Array | float) -> Array:
    """Integral (n,) of the density along each ray over [0, limit] within the domain; unit: metres.

    Raises ValueError for densities that have to be sampled (see ``is_closed_form``).
    """
    near, far = geometry.interval(volume.domain, origin, direction)
    near, far = np.maximum(near, 0.0), np.minimum(far, limit)
    length = np.maximum(far - near, 0.0)
    if volume.cavity is not None:
        near, far = geometry.interval(volume.cavity, origin, direction)
        length = length - np.maximum(np.minimum(far, limit) - np.maximum(near, 0.0), 0.0)
    density = volume.medium.density
    if isinstance(density, (NoiseShape, Dust)):
        raise ValueError(f"the optical depth of noise has no closed form, got a {type(density).__name__}; sample it, or march it")
    if isinstance(density, (ExponentialHeight, ExponentialAltitude, Grid)):
        start = origin + np.where(length > 0.0, near, 0.0)[:, None] * direction
    match density:
        case ExponentialHeight():
            height = np.where(length > 0.0, start[:, 2], 0.0)
            return height_optical_depth(height, direction[:, 2], length, 1.0, density.scale_height, density.base_height)
        case ExponentialAltitude():
            offset = start - np.array(density.center)
            radius = np.linalg.norm(offset, axis=1)
            mu = np.einsum("ni,ni->n", offset, direction) / np.maximum(radius, 1e-300)
            return atmosphere.optical_depth(radius, np.clip(mu, -1.0, 1.0), length, 1.0, density.scale_height, density.radius)
        case Grid():
            return grid.grid_optical_depth(density.values, density.low, density.high, start, direction, length)
    return length


def mean_depth(volume: Volume, origin: Array, direction: Array, limit: Array | float) -> Array:
    """As ``density_depth``, where dust has its mean density, 1."""
    return density_depth(evened(volume), origin, direction, limit)


def evened(volume: Volume) -> Volume:
    """The volume with its mean density in place of dust."""
    medium = volume.medium
    return replace(volume, medium=replace(medium, density=Homogeneous())) if isinstance(medium.density, Dust) else volume


def optical_depth(scene: Scene, origin: Array, direction: Array, limit: Array | float) -> Array:
    """Optical depth (n, 3) of all volumes along each ray over [0, limit]; infinite where a density grows without end."""
    depth = np.zeros((len(direction), 3))
    for volume in scene.volumes:
        if max(volume.medium.sigma_t) == 0.0:
            continue
        length = density_depth(volume, origin, direction, limit)
        for channel, sigma_t in enumerate(volume.medium.sigma_t):
            if sigma_t > 0.0:
                depth[:, channel] += length * sigma_t
    return depth


def spot_factor(spot: Spot, cos_angle: Array) -> Array:
    """The spot's smooth edge: 1 inside, 0 outside the cone."""
    c = np.cos(spot.cone_angle / 2.0)
    if spot.blend == 0.0:
        return (cos_angle >= c).astype(float)
    s = np.clip((cos_angle - c) / ((1.0 - c) * spot.blend), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def arriving(light, position: Array) -> tuple[Array, Array, Array]:
    """Direction towards the light (n, 3), distance (n,) and unattenuated irradiance (n, 3) facing it, at positions."""
    if isinstance(light, Sun):
        toward = np.broadcast_to(-np.array(light.direction), position.shape)
        return toward, np.full(len(position), np.inf), np.broadcast_to(np.array(light.irradiance), position.shape)
    if isinstance(light, Projector):
        offset = np.array(light.position) - position
        distance = np.linalg.norm(offset, axis=1)
        intensity = projector.projector_irradiance(
            position, direction=light.direction, intensity=1.0 / (4.0 * np.pi), falloff=light.falloff, gobo=light.gobo,
            **frustum_of(light))
        intensity = intensity if intensity.ndim == 2 else intensity[:, None]
        return offset / np.maximum(distance, 1e-300)[:, None], distance, intensity * np.array(light.power)
    offset = np.array(light.position) - position
    squared = np.einsum("ni,ni->n", offset, offset)
    distance = np.sqrt(squared)
    toward = offset / np.maximum(distance, 1e-300)[:, None]
    intensity = np.array(light.power) / (4.0 * np.pi) / np.maximum(squared, 1e-300)[:, None]
    if isinstance(light, Spot):
        intensity = intensity * spot_factor(light, -(toward @ np.array(light.direction)))[:, None]
    return toward, distance, intensity


def frustum_of(light: Projector) -> dict:
    """The keyword arguments by which physics.projector knows the shape of the light."""
    return {"light_position": light.position, "up": light.up, "horizontal_fov": light.horizontal_fov,
            "vertical_fov": light.vertical_fov, "near": light.near, "far": light.far, "blend": light.blend,
            "elliptic": light.elliptic}


def uniform_hemisphere_cosine(normal: Array, rng: np.random.Generator) -> Array:
    """Directions (n, 3) around unit normals with density cos / pi: the normal plus a point of the unit sphere."""
    sphere = uniform_sphere(len(normal), rng)
    direction = normal + sphere
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.where(length > 1e-9, direction / np.maximum(length, 1e-9), normal)


def uniform_sphere(count: int, rng: np.random.Generator) -> Array:
    z, angle = 2.0 * rng.random(count) - 1.0, 2.0 * np.pi * rng.random(count)
    r = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def turned_by(direction: Array, cos_theta: Array, angle: Array) -> Array:
    """Unit directions at the given polar cosine and azimuth around ``direction`` (branchless basis of Duff et al. 2017)."""
    x, y, z = direction.T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=1)
    sine = np.sqrt(np.maximum(0.0, 1.0 - cos_theta**2))
    result = ((sine * np.cos(angle))[:, None] * tangent + (sine * np.sin(angle))[:, None] * bitangent
              + cos_theta[:, None] * direction)
    return result / np.linalg.norm(result, axis=1, keepdims=True)


def sample_phase(phase: AnyPhase, direction: Array, rng: np.random.Generator) -> Array:
    """Scattered directions (n, 3) distributed as the phase function around ``direction``."""
    u = rng.random(len(direction))
    match phase:
        case RayleighPhase():
            cos_theta = phase_functions.sample_rayleigh(u)
        case MiePhase():
            cos_theta = phase_functions.sample_mie_fit(u, phase.droplet_diameter)
        case _:
            cos_theta = phase_functions.sample_dual_henyey_greenstein(u, phase.g0, phase.g1, phase.weight)
    return turned_by(direction, cos_theta, 2.0 * np.pi * rng.random(len(direction)))
