# SPDX-License-Identifier: GPL-3.0-or-later
"""A Scene as one array of numbers, for the compiled path tracer.

A volume's density is bounded cell by cell: exponential media in layers or shells by formula, noise and grids in a coarse
lattice of cells over the domain.
"""

from __future__ import annotations

import numpy as np

from ..physics.phase import mie_fit_parameters
from ..scene import geometry, noise
from ..scene.model import (
    Box, Cone, Dust, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Homogeneous, Hull, MiePhase, NoiseShape, Phase, Point,
    Projector, RayleighPhase, Scene, Shape, Sun, Volume,
)
from . import optics

Array = np.ndarray

BOX, ELLIPSOID, CONE = range(3)
HOMOGENEOUS, HEIGHT, ALTITUDE, NOISE, GRID, DUST = range(6)
TWO_LOBES, RAYLEIGH, MIE = range(3)

# Of both twins: from this order of scattering on, paths below this weight end by chance.
ROULETTE_START = 16
ROULETTE_THRESHOLD = 0.1

RESOLUTION = 32  # majorant cells along the longest side of a domain
PROBES = 3  # noise is probed at this many points along each side of a cell
PROBE_MARGIN = 1.5  # times the largest error of interpolation between probes, added to the bounds
LAYER = 0.5  # thickness of layers and shells of exponential media, in scale heights


# A scene is one array of numbers, and its parts are known by the index of their first number. The header:
VOLUMES, SURFACES, LIGHTS, ENVIRONMENT, EPSILON = 0, 2, 4, 6, 9  # the first three: count and index of the first
HEADER = 10
# A volume and a surface begin with a shape: its kind, then CENTER, HALF, AXES, or APEX, AXIS, COS2, LENGTH of a cone.
CENTER, HALF, AXES = 1, 4, 7
APEX, AXIS, COS2, LENGTH = 1, 4, 7, 8
SHAPE = 16
ALBEDO, EMISSION, SURFACE = 16, 19, 22
DENSITY_NUMBERS = 28
SIGMA_T, SIGMA_S, DENSITY, PARAMETERS, PHASE, MEAN = 16, 19, 22, 23, 22 + DENSITY_NUMBERS, 27 + DENSITY_NUMBERS
VOXELS, CELLS, LOW, SIZE, VOLUME = MEAN + 1, MEAN + 5, MEAN + 9, MEAN + 12, MEAN + 15
SUN, POSITION, TOWARD, COLOR, DARK, FULL, LIGHT = 0, 1, 4, 7, 10, 11, 12


def unsupported(scene: Scene) -> str:
    """Empty when the compiled path tracer can render the scene, otherwise the reason why not."""
    if any(isinstance(light, Projector) for light in scene.lights):
        return "it has a projector"
    if any(isinstance(volume.domain, Hull) for volume in scene.volumes):
        return "a medium fills a polyhedron"
    return "a medium has ambient light" if any(volume.medium.glows for volume in scene.volumes) else ""


def flatten(scene: Scene) -> Array:
    """The numbers of a scene. Raises ValueError for one that is not supported (see ``unsupported``)."""
    if reason := unsupported(scene):
        raise ValueError(f"the compiled path tracer cannot render the scene: {reason}; use kernel=\"numpy\"")
    volumes = [volume for volume in scene.volumes if max(volume.medium.sigma_t) > 0.0]
    majorants = [_majorants(volume) for volume in volumes]
    grids = [np.asarray(v.medium.density.values, float) if isinstance(v.medium.density, Grid) else np.zeros((0, 0, 0))
             for v in volumes]
    surfaces = HEADER + VOLUME * len(volumes)
    lights = surfaces + SURFACE * len(scene.surfaces)
    arrays = [*grids, *(bounds for bounds, _, _ in majorants)]
    starts = lights + LIGHT * len(scene.lights) + np.cumsum([0, *(array.size for array in arrays)])
    places = [(*array.shape, start) for array, start in zip(arrays, starts)]
    rows = [(HEADER, (len(volumes), HEADER, len(scene.surfaces), surfaces, len(scene.lights), lights, *scene.environment,
                      1e-7 * optics.scale_of(scene)))]
    for i, (volume, (bounds, low, size)) in enumerate(zip(volumes, majorants)):
        medium = volume.medium
        mean = float(bounds.mean()) * sum(medium.sigma_t) / 3.0
        rows += [(SHAPE, _shape(volume.domain)), (3, medium.sigma_t), (3, medium.sigma_s), (DENSITY_NUMBERS, _density(volume)),
                 (5, _phase(medium.phase)), (1, (mean,)), (4, places[i]), (4, places[len(volumes) + i]), (3, low), (3, size)]
    rows += [row for s in scene.surfaces for row in ((SHAPE, _shape(s.shape)), (3, s.albedo), (3, s.emission))]
    rows += [(LIGHT, _light(light)) for light in scene.lights]
    return np.concatenate([*(np.pad(np.array(row, float), (0, size - len(row))) for size, row in rows),
                           *(array.ravel() for array in arrays)])


def _shape(shape: Shape) -> tuple:
    if isinstance(shape, Cone):
        return CONE, *shape.apex, *shape.axis, np.cos(shape.half_angle) ** 2, shape.length
    axes = (component for axis in shape.axes for component in axis)
    return BOX if isinstance(shape, Box) else ELLIPSOID, *shape.center, *shape.half, *axes


def _phase(phase) -> tuple:
    match phase:
        case RayleighPhase():
            return (RAYLEIGH,)
        case MiePhase():
            g, g_draine, alpha, weight = mie_fit_parameters(phase.droplet_diameter)
            return MIE, g, g_draine, weight, alpha
        case Phase():
            return TWO_LOBES, phase.g0, phase.g1, phase.weight
    raise TypeError(f"{phase!r} is not a phase function of the Scene")


def _density(volume: Volume) -> tuple:
    match volume.medium.density:
        case Homogeneous():
            return (HOMOGENEOUS,)
        case ExponentialHeight(scale_height, base_height):
            return HEIGHT, scale_height, base_height
        case ExponentialAltitude(center, radius, scale_height):
            return ALTITUDE, scale_height, radius, *center
        case NoiseShape() as shape:
            return NOISE, *noise.numbers(shape)
        case Dust() as dust:
            return DUST, *noise.dust_numbers(dust)
        case Grid() as density:
            return GRID, *density.low, *density.high
    raise TypeError(f"{volume.medium.density!r} is not a density of the Scene")


def _light(light) -> tuple:
    if isinstance(light, Sun):
        return 1.0, *light.direction, *(-component for component in light.direction), *light.irradiance
    intensity = np.array(light.power) / (4.0 * np.pi)
    if isinstance(light, Point):
        return 0.0, *light.position, 0.0, 0.0, 1.0, *intensity, -2.0, -2.0
    dark = np.cos(light.cone_angle / 2.0)
    return 0.0, *light.position, *light.direction, *intensity, dark, dark + (1.0 - dark) * light.blend


def bounding_box(shape: Shape) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the axis-aligned box around a shape."""
    if isinstance(shape, Cone):
        apex, axis = np.array(shape.apex), np.array(shape.axis)
        end = apex + shape.length * axis
        radius = shape.length * np.tan(shape.half_angle) * np.sqrt(np.maximum(0.0, 1.0 - axis**2))
        return np.minimum(apex, end - radius), np.maximum(apex, end + radius)
    if isinstance(shape, Hull):
        return np.min(shape.corners, axis=0), np.max(shape.corners, axis=0)
    axes = np.array(shape.axes) * np.array(shape.half)[:, None]
    reach = np.linalg.norm(axes, axis=0) if isinstance(shape, Ellipsoid) else np.abs(axes).sum(axis=0)
    return np.array(shape.center) - reach, np.array(shape.center) + reach


def _majorants(volume: Volume) -> tuple[Array, Array, Array]:
    """Bounds (nx, ny, nz) of the density in a lattice of cells over the domain, its lowest corner and the cells' size."""
    low, high = bounding_box(volume.domain)
    density = volume.medium.density
    if isinstance(density, Grid):
        low, high = np.maximum(low, density.low), np.minimum(high, density.high)
    # A little wider than the domain, so that rounding leaves no point of it outside the cells.
    low, high = low - 1e-5 * (high - low), high + 1e-5 * (high - low)
    extent = np.maximum(high - low, 1e-300)
    counts = np.maximum(1, np.ceil(RESOLUTION * extent / extent.max() - 1e-9)).astype(int)
    match density:
        case NoiseShape():
            return _noise_bounds(density, low, extent, counts), low, extent / counts
        case Grid():
            return _grid_bounds(density, low, extent, counts), low, extent / counts
        case Dust():
            return np.full((1, 1, 1), density.largest), low, extent
        case ExponentialHeight() | ExponentialAltitude():
            # One number stands for the mean; the layers' bounds follow from the formula.
            position = low + extent * np.random.default_rng(0).random((256, 3))
            near, far = geometry.interval(volume.domain, position, np.tile((0.0, 0.0, 1.0), (256, 1)))
            position = position[(near < 0.0) & (far > 0.0)]
            if isinstance(density, ExponentialAltitude):
                position = position[np.linalg.norm(position - np.array(density.center), axis=1) >= density.radius]
            mean = float(optics.density_at(volume, position).mean()) if len(position) else 1.0
            return np.full((1, 1, 1), mean), low, extent
    return np.ones((1, 1, 1)), low, extent


def _noise_bounds(shape: NoiseShape, low: Array, extent: Array, counts: Array) -> Array:
    """Largest of PROBES^3 points of each cell, its faces included, plus a margin for what lies between them."""
    axes = [start + length * np.arange(n * (PROBES - 1) + 1) / (n * (PROBES - 1))
            for start, length, n in zip(low, extent, counts)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    value = noise.margin(shape, position).reshape([len(axis) for axis in axes])
    # Between probes a smooth function exceeds their interpolation by at most an eighth of its second difference.
    edges = [[(1, 1) if along == axis else (0, 0) for along in range(3)] for axis in range(3)]
    bend = sum(np.pad(np.abs(np.diff(value, 2, axis=axis)), edges[axis], "edge") for axis in range(3)) / 8.0
    return np.clip(_pooled(value) + PROBE_MARGIN * _pooled(bend), 0.0, 1.0)


def _pooled(values: Array) -> Array:
    """Largest value of each cell of PROBES points a side, neighbours sharing their faces."""
    step = PROBES - 1
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        inner = values[:-1].reshape(-1, step, *values.shape[1:]).max(axis=1)
        values = np.moveaxis(np.maximum(inner, values[step::step]), 0, axis)
    return values


def _grid_bounds(density: Grid, low: Array, extent: Array, counts: Array) -> Array:
    """Largest voxel that reaches into each cell: trilinear interpolation never exceeds its voxels."""
    values = np.asarray(density.values, float)
    voxel = (np.array(density.high) - np.array(density.low)) / values.shape
    for axis in range(3):
        edges = low[axis] + extent[axis] * np.arange(counts[axis] + 1) / counts[axis]
        position = (edges - density.low[axis]) / voxel[axis] - 0.5
        first = np.clip(np.floor(position[:-1] - 1e-6), 0, values.shape[axis] - 1).astype(int)
        last = np.clip(np.ceil(position[1:] + 1e-6), 0, values.shape[axis] - 1).astype(int)
        values = np.moveaxis(values, axis, 0)
        values = np.moveaxis(np.stack([values[i:j + 1].max(axis=0) for i, j in zip(first, last)]), 0, axis)
    return values
