# SPDX-License-Identifier: GPL-3.0-or-later
"""A Scene in another unit of length: numbers change, the picture does not.

Lengths are multiplied by a factor, coefficients (1/m) divided by it, powers of local lights multiplied by its square, since
their light falls with the square of the distance. Irradiance, radiance, angles and shares stay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..parameters.model import Group
from .body import Body
from .model import (
    Box, Camera, Cone, Density, DepthFog, Dust, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Homogeneous, Hull, Light,
    Medium, NoiseShape, Point, Projector, Scene, Shape, Sheet, Spot, Sun, Volume, scaled as times,
)

# Power of the length in each unit that parameters are declared in.
DIMENSIONS = {"": 0, "deg": 0, "m": 1, "1/m": -1, "1/km": -1, "W": 2, "m/s": 1, "s": 0, "1/s": 0, "um": 0, "W/m2": 0,
              "W/(m2 sr)": 0}


def scaled(scene: Scene, factor: float) -> Scene:
    """The Scene with lengths multiplied by ``factor``: with 0.001 in kilometres. Raises ValueError unless factor > 0."""
    if not (factor > 0.0 and math.isfinite(factor)):
        raise ValueError(f"the factor of a unit must be > 0 and finite, got {factor}; 0.001 makes kilometres of metres")
    camera = scene.camera
    return replace(
        scene, camera=Camera(times(camera.position, factor), camera.direction, camera.field_of_view),
        lights=tuple(_light(light, factor) for light in scene.lights),
        volumes=tuple(_volume(volume, factor) for volume in scene.volumes),
        surfaces=tuple(replace(surface, shape=_shape(surface.shape, factor)) for surface in scene.surfaces),
        depth_fog=scene.depth_fog and _depth_fog(scene.depth_fog, factor))


def scaled_body(body: Body, factor: float) -> Body:
    """The Body with lengths multiplied by ``factor``; its family declares the same parameters with scaled limits."""
    return Body(_group(body.family, factor), _values(body.family, body.values, factor),
                tuple(_volume(volume, factor) for volume in body.volumes), body.domain and _shape(body.domain, factor))


def _values(group: Group, values: Mapping[str, Any], factor: float) -> dict[str, Any]:
    return {p.name: _times(values[p.name], factor ** DIMENSIONS[p.unit]) for p in group.parameters}


def _group(group: Group, factor: float) -> Group:
    return replace(group, parameters=tuple(
        replace(p, **{name: _times(getattr(p, name), factor ** DIMENSIONS[p.unit])
                      for name in ("default", "minimum", "maximum", "soft_minimum", "soft_maximum")})
        for p in group.parameters))


def _times(value: Any, factor: float) -> Any:
    if factor == 1.0 or value is None:  # choices, switches and whole numbers have no length
        return value
    return times(value, factor) if isinstance(value, tuple) else value * factor


def _shape(shape: Shape, factor: float) -> Shape:
    match shape:
        case Box() | Ellipsoid():
            return replace(shape, center=times(shape.center, factor), half=times(shape.half, factor))
        case Cone():
            return replace(shape, apex=times(shape.apex, factor), length=shape.length * factor)
        case Hull():
            return Hull(tuple(times(corner, factor) for corner in shape.corners), shape.faces)


def _volume(volume: Volume, factor: float) -> Volume:
    medium = volume.medium
    sheet = volume.sheet
    if sheet is not None:
        cover = sheet.cover and replace(sheet.cover, size=sheet.cover.size * factor)
        sheet = Sheet(sheet.thickness * factor, cover)
    return replace(volume, domain=_shape(volume.domain, factor), cavity=volume.cavity and _shape(volume.cavity, factor),
                   sheet=sheet, medium=Medium(times(medium.sigma_s, 1.0 / factor), times(medium.sigma_a, 1.0 / factor),
                                              medium.phase, _density(medium.density, factor), medium.ambient))


def _depth_fog(fog: DepthFog, factor: float) -> DepthFog:
    return replace(fog, start=fog.start * factor, cutoff=fog.cutoff * factor, end=fog.end * factor, density=fog.density / factor)


def _density(density: Density, factor: float) -> Density:
    match density:
        case Homogeneous():
            return density
        case ExponentialHeight():
            return ExponentialHeight(density.scale_height * factor, density.base_height * factor)
        case NoiseShape():
            return replace(density, center=times(density.center, factor), half=times(density.half, factor),
                           noise_size=density.noise_size * factor, billow_size=density.billow_size * factor,
                           drift=times(density.drift, factor))
        case Dust():
            return replace(density, size=density.size * factor, drift=times(density.drift, factor))
        case ExponentialAltitude():
            return ExponentialAltitude(times(density.center, factor), density.radius * factor, density.scale_height * factor)
        case Grid():
            return Grid(density.values, times(density.low, factor), times(density.high, factor))


def _light(light: Light, factor: float) -> Light:
    match light:
        case Sun():
            return light
        case Point() | Spot():
            return replace(light, position=times(light.position, factor), power=times(light.power, factor**2))
        case Projector():
            return replace(light, position=times(light.position, factor), power=times(light.power, factor**light.falloff),
                           near=light.near * factor, far=light.far * factor)
