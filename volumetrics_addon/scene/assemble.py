# SPDX-License-Identifier: GPL-3.0-or-later
"""From checked parameters to a Scene. One function per family, one for the stage."""

from __future__ import annotations

import math
from typing import Any, Iterable, Mapping

from ..parameters.families import FAMILIES
from .body import Body
from .model import (
    AnyPhase, Box, Camera, Color, Cone, Dielectric, Ellipsoid, ExponentialAltitude, ExponentialHeight, Homogeneous, Light, Medium,
    MiePhase, NoiseShape, Octaves, Phase, RayleighPhase, Scene, Shape, Spot, Sun, Surface, Vector, Volume, add, look_frame,
    normalized, scaled, subtract, turned,
)

PER_KILOMETRE = 1e-3  # 1/km in 1/m

# The haze cone is this much wider than the light's cone, so that the domain's faceted mantle stays in the dark.
CONE_CLEARANCE = 1.03


class Item:
    """What one family adds to a scene: volumes, lights and opaque bodies."""

    def __init__(self, volumes: Iterable[Volume], lights: Iterable[Light] = (), surfaces: Iterable[Surface] = ()):
        self.volumes, self.lights, self.surfaces = tuple(volumes), tuple(lights), tuple(surfaces)


def _times(a: Color, factor: float) -> Color:
    return scaled(a, factor)


def _scattering(values: Mapping[str, Any]) -> tuple[Color, Color]:
    """(sigma_s, sigma_a) from extinction and albedo."""
    extinction, albedo = values["extinction"], values["albedo"]
    return _times(albedo, extinction), tuple(extinction * (1.0 - a) for a in albedo)


def cloud(values: Mapping[str, Any], bounds: "Bounds | None" = None) -> Item:
    half = scaled(values["size"], 0.5)
    shape = {"ellipsoid": Ellipsoid, "box": Box}[values["domain"]](values["location"], half)
    phase: AnyPhase
    if values["phase"] == "mie":
        phase = MiePhase(values["droplet_diameter"])
    elif values["phase"] == "dual_hg":
        phase = Phase(values["g"], values["g_back"], values["lobe_weight"])
    else:
        phase = Phase(values["g"])
    density: Homogeneous | NoiseShape = Homogeneous()
    if values["density"] == "noise":
        density = NoiseShape(
            values["location"], half, values["noise_size"], values["noise_detail"], values["noise_roughness"],
            values["noise_strength"], values["fill"], values["softness"], values["seed"],
            drift=scaled(values["wind"], values["time"]),
            **{name: values[name] for name in ("profile", "billow_size", "billow_strength", "billow_octaves",
                                               "billow_roughness", "base", "stretch", "evolution")})
    octaves = None
    if values["scattering"] == "octaves":
        octaves = Octaves(values["octaves"], *(values[f"octave_{name}"] for name in ("extinction", "phase", "contribution")))
    sigma_s, sigma_a = _scattering(values)
    return Item([Volume(shape, Medium(sigma_s, sigma_a, phase, density), octaves=octaves)])


def glass(values: Mapping[str, Any], bounds: "Bounds | None" = None) -> Item:
    shape = {"sphere": Ellipsoid, "block": Box}[values["shape"]](
        values["location"], scaled(values["size"], 0.5), turned(math.radians(values["rotation"])))
    sigma_a = tuple(max(0.0, -math.log(c) / values["distance"]) for c in values["color"])
    boundary = Dielectric(values["ior"]) if values["refraction"] else None
    return Item([Volume(shape, Medium((0.0, 0.0, 0.0), sigma_a), boundary)])


class Bounds:
    """Axis-aligned bounds of the points that a fitted domain has to cover."""

    def __init__(self, points: Iterable[Vector]):
        points = list(points)
        if not points:
            raise ValueError("there is nothing to fit the fog to; add a camera or an object to the scene")
        self.low = tuple(min(p[i] for p in points) for i in range(3))
        self.high = tuple(max(p[i] for p in points) for i in range(3))


def fog(values: Mapping[str, Any], bounds: Bounds | None) -> Item:
    """Box over the bounds plus the margin, from just below the base up to the height of the cutoff density."""
    if bounds is None:
        raise ValueError("height fog is fitted to the scene; give the bounds of its objects and camera")
    margin, scale_height, base = values["margin"], values["scale_height"], values["base_height"]
    top = base + scale_height * -math.log(values["cutoff"])
    # One hundredth below the base, so that a floor at base height never coincides with the domain's face.
    bottom = base - 0.01 * (top - base)
    low = (bounds.low[0] - margin, bounds.low[1] - margin, bottom)
    high = (bounds.high[0] + margin, bounds.high[1] + margin, top)
    box = Box(scaled(add(low, high), 0.5), scaled(subtract(high, low), 0.5))
    sigma_s, sigma_a = _scattering(values)
    return Item([Volume(box, Medium(sigma_s, sigma_a, Phase(values["g"]), ExponentialHeight(scale_height, base)))])


def godray(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    apex, axis = values["location"], normalized(subtract(values["target"], values["location"]))
    half_angle, length = math.radians(values["cone_angle"]) / 2, values["length"]
    spot = Spot(apex, axis, _times(values["color"], values["power"]), 2 * half_angle, values["blend"])
    right, up, back = look_frame(axis)
    wide = min(half_angle * CONE_CLEARANCE, math.radians(85.0))
    domain: Shape
    if values["domain"] == "cone":
        domain = Cone(apex, axis, wide, length)
    else:
        radius = length * math.tan(wide)
        domain = Box(add(apex, scaled(axis, length / 2)), (radius, radius, length / 2), (right, up, back))
    sigma_s, sigma_a = _scattering(values)
    volume = Volume(domain, Medium(sigma_s, sigma_a, Phase(values["g"])))
    return Item([volume], [spot], [Surface(box, (0.0, 0.0, 0.0)) for box in _blockers(values, apex, axis, half_angle)])


def _blockers(values: Mapping[str, Any], apex: Vector, axis: Vector, half_angle: float) -> list[Box]:
    """Bars in a plane across the beam. Count and fill are over the beam's width at that distance."""
    if values["blocker"] == "none":
        return []
    distance = values["blocker_distance"]
    width = 2 * distance * math.tan(half_angle)
    right, up, back = look_frame(axis)
    c, s = (f(math.radians(values["blocker_rotation"])) for f in (math.cos, math.sin))
    across = add(scaled(right, c), scaled(up, s))
    along = add(scaled(right, -s), scaled(up, c))
    center = add(apex, scaled(axis, distance))
    pitch = width / values["blocker_count"]
    bar = (pitch * values["blocker_fill"] / 2, width * 0.6, 0.0)  # longer than the beam is wide: no light slips round
    boxes = []
    for first, second in ((across, along), (along, across))[: 2 if values["blocker"] == "window" else 1]:
        for index in range(values["blocker_count"]):
            offset = (index + 0.5) * pitch - width / 2
            boxes.append(Box(add(center, scaled(first, offset)), bar, (first, second, back)))
    return boxes


def air(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    """Molecules and aerosol around a planet whose ground passes through (0, 0, base height)."""
    radius = values["planet_radius"]
    center = (0.0, 0.0, values["base_height"] - radius)
    domain = Ellipsoid(center, (radius + values["thickness"],) * 3)
    molecules = _times(values["rayleigh_color"], PER_KILOMETRE * values["rayleigh_scattering"])
    sigma_s, sigma_a = _scattering({"extinction": PER_KILOMETRE * values["mie_extinction"], "albedo": values["mie_albedo"]})
    media = (
        Medium(molecules, (0.0, 0.0, 0.0), RayleighPhase(), ExponentialAltitude(center, radius, values["rayleigh_scale_height"])),
        Medium(sigma_s, sigma_a, Phase(values["mie_g"]), ExponentialAltitude(center, radius, values["mie_scale_height"])),
    )
    ground = Surface(Ellipsoid(center, (radius,) * 3), values["ground_albedo"])
    return Item([Volume(domain, medium) for medium in media], surfaces=[ground])


def air_domain(values: Mapping[str, Any]) -> Box:
    """The part of the air that the engines follow: ``reach`` to all sides of the origin, down to the ground there."""
    radius, base, reach = values["planet_radius"], values["base_height"], values["reach"]
    top = base + values["thickness"]
    if reach < radius:
        # 1 - sqrt(1 - x^2) in the form that keeps its digits.
        share = reach / radius
        bottom = base - radius * share * share / (1.0 + math.sqrt(1.0 - share * share))
    else:
        bottom, reach = base - 2.0 * radius - values["thickness"], min(reach, radius + values["thickness"])
    return Box((0.0, 0.0, (top + bottom) / 2), (reach, reach, (top - bottom) / 2))


ASSEMBLERS = {"cloud": cloud, "glass": glass, "fog": fog, "godray": godray, "air": air}


def body(family: str, values: Mapping[str, Any], volumes: Iterable[Volume]) -> Body:
    """The volumes of a family, all in one domain, as the one object that the engines show."""
    volumes = tuple(volumes)
    domains = {volume.domain for volume in volumes}
    if len(domains) != 1:
        raise ValueError(f"a body has one domain, got {len(domains)} in {len(volumes)} volumes; make a body of each")
    domain = air_domain(values) if family == "air" else domains.pop()
    return Body(FAMILIES[family], values, volumes, domain)


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
        lights = (Sun(direction, _times(stage["sun_color"], stage["sun_irradiance"])), *lights)
    return Scene(
        camera, lights, _times(stage["environment_color"], stage["environment_radiance"]), item.volumes,
        surfaces + item.surfaces, stage["orders"])
