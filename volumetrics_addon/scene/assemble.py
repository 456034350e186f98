# SPDX-License-Identifier: GPL-3.0-or-later
"""From checked parameters to a Scene: a family's item on its stage."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from ..parameters.families import FAMILIES
from ..parameters.fog import DEPTH_FOGS, LAYERS
from .body import Body
from .families import ASSEMBLERS, air, fog, glass
from .families.item import Bounds
from .model import (
    Box, Camera, DepthFog, Ellipsoid, Light, Scene, Shape, Sun, Surface, Vector, Volume, normalized, scaled, subtract, turned,
)


def body(family: str, values: Mapping[str, Any], volumes: Iterable[Volume]) -> Body:
    """The volumes of a family, all in one domain, as the one object that the engines show; a depth fog has none."""
    volumes = tuple(volumes)
    if family == "fog" and values["profile"] in DEPTH_FOGS:
        return Body(FAMILIES[family], values, (), None)
    domains = {volume.domain for volume in volumes}
    if len(domains) != 1:
        raise ValueError(f"a body has one domain, got {len(domains)} in {len(volumes)} volumes; make a body of each")
    domain = air.domain(values) if family == "air" else domains.pop()
    return Body(FAMILIES[family], glass.resolved(values) if family == "glass" else values, volumes, domain)


def is_composited(values: Mapping[str, Any]) -> bool:
    """Whether the medium has to be made in the compositor: as chosen, or as no volume can show it."""
    if values.get("realisation") == "compositor" or values.get("profile") in DEPTH_FOGS:
        return True
    return values.get("realisation") == "automatic" and values.get("profile") in LAYERS[1:] and not fog.depth_fog(values).is_physical


def depth_fog(family: str, values: Mapping[str, Any]) -> DepthFog:
    """How the compositor makes the family's medium. Raises ValueError where the values contradict one another."""
    return fog.depth_fog(values) if family == "fog" else DepthFog()


def bodies(family: str, values: Mapping[str, Any], volumes: Iterable[Volume]) -> list[Body]:
    """The bodies of a family: one for each domain; a depth fog is one without."""
    if family == "fog" and values["profile"] in DEPTH_FOGS:
        return [body(family, values, volumes)]
    by_domain: dict[Shape, list[Volume]] = {}
    for volume in volumes:
        by_domain.setdefault(volume.domain, []).append(volume)
    return [body(family, values, together) for together in by_domain.values()]


def prop(values: Mapping[str, Any]) -> Surface:
    shape = {"box": Box, "sphere": Ellipsoid}[values["shape"]](
        values["location"], scaled(values["size"], 0.5), turned(math.radians(values["rotation"])))
    return Surface(shape, values["albedo"], values["emission"])


def sun_direction(elevation: float, azimuth: float) -> Vector:
    """Direction of travel of sunlight (unit), from elevation and azimuth in radians (north = +y, east = +x)."""
    return (-math.cos(elevation) * math.sin(azimuth), -math.cos(elevation) * math.cos(azimuth), -math.sin(elevation))


def scene(family: str, parameters: Mapping[str, Any], stage: Mapping[str, Any],
          props: Iterable[Mapping[str, Any]]) -> Scene:
    """The Scene of a preset. All values must have passed their declarations.

    Raises ValueError where the values contradict one another (a camera that looks at itself, a light at its target).
    """
    surfaces = tuple(prop(values) for values in props)
    direction = normalized(subtract(stage["camera_target"], stage["camera_location"]))
    camera = Camera(stage["camera_location"], direction, math.radians(stage["field_of_view"]))
    bounds = Bounds([camera.position, *(corner for surface in surfaces
                                        for corner in Box(surface.shape.center, surface.shape.half,
                                                          surface.shape.axes).corners)])
    item = ASSEMBLERS[family](parameters, bounds)
    lights: tuple[Light, ...] = item.lights
    if stage["sun_irradiance"] > 0.0:
        direction = sun_direction(math.radians(stage["sun_elevation"]), math.radians(stage["sun_azimuth"]))
        lights = (Sun(direction, scaled(stage["sun_color"], stage["sun_irradiance"])), *lights)
    return Scene(
        camera, lights, scaled(stage["environment_color"], stage["environment_radiance"]), item.volumes,
        surfaces + item.surfaces, stage["orders"], depth_fog(family, parameters) if is_composited(parameters) else None)
