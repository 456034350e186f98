# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a godray to its light, haze and blockers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..model import (
    Box, Cone, Density, Dust, Homogeneous, Hull, Light, Medium, Phase, Projector, Shape, Spot, Sun, Surface, Vector, Volume, add,
    cross, look_frame, normalized, scaled, subtract, swept,
)
from ..openings import shaft
from .item import Bounds, Item, scattering

# The haze cone is this much wider than the light's cone, so that the domain's faceted mantle stays in the dark.
CONE_CLEARANCE = 1.03
NEAREST = 1e-3  # share of its length at which the haze of a frustum begins, where it would begin in a point
APART_SPACING = 1.01  # of the width of openings side by side
BEAM_BAR, OPENING_BAR = 1.2, 1.0  # length of bars over the beam's width, so that no light slips round, and over the opening's
THINNEST = 0.01  # m: Blender 5 cannot hold thinner meshes of a medium that varies
NEVER = 1e6  # m: a far end at the parameter's limit is none
FALLOFF = {"quadratic": 2, "linear": 1, "constant": 0}


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    """Lights, the haze that they light, and bars in their way. Raises ValueError where the values contradict one another."""
    if values["light"] == "sun":
        return _shafts(values)
    apex, axis = values["location"], normalized(subtract(values["target"], values["location"]))
    power, length = scaled(values["color"], values["power"]), values["length"]
    right, up, back = look_frame(axis)
    near = 0.0
    if values["light"] == "projector":
        c, s = (f(math.radians(values["roll"])) for f in (math.cos, math.sin))
        right, up = add(scaled(right, c), scaled(up, s)), add(scaled(right, -s), scaled(up, c))
        near = values["near"]
        if near >= min(length, values["far"]):
            raise ValueError(f"near must be < length and far, got near {near:g} m, length {length:g} m and far {values['far']:g} m; "
                             "let the haze reach farther")
        first: Light = _projector(values, apex, axis, up, power)
        slopes = tuple(math.tan(math.radians(values[name]) / 2) for name in ("horizontal_fov", "vertical_fov"))
        half_angle = math.atan(max(slopes))
    else:
        half_angle = math.radians(values["cone_angle"]) / 2
        first = Spot(apex, axis, power, 2 * half_angle, values["blend"])
        slopes = (math.tan(half_angle),) * 2
    steps = [values["spacing"] * (index - (values["count"] - 1) / 2) for index in range(values["count"])]
    lights = [replace(first, position=add(apex, scaled(right, step))) for step in steps]

    wide = min(half_angle * CONE_CLEARANCE, math.radians(85.0))
    domain: Shape
    if values["domain"] == "box" or len(lights) > 1:
        spread = (math.tan(wide),) * 2 if values["light"] == "spot" else tuple(CONE_CLEARANCE * slope for slope in slopes)
        sides = tuple(length * slope for slope in spread)
        middle = add(apex, scaled(axis, (near + length) / 2))
        domain = Box(middle, (sides[0] + max(steps), sides[1], (length - near) / 2), (right, up, back))
    elif values["light"] == "spot" or (values["frustum"] == "elliptic" and slopes[0] == slopes[1] and near == 0.0):
        domain = Cone(apex, axis, wide, length)
    else:
        wider = tuple(CONE_CLEARANCE * slope for slope in slopes)
        domain = _frustum(apex, (right, up, axis), wider, near or NEAREST * length, length)
    bars = _blockers(values, apex, axis, half_angle)
    return Item([_volume(values, domain)], lights, [Surface(box, (0.0, 0.0, 0.0)) for box in bars])


def _haze(values: Mapping[str, Any]) -> Medium:
    density: Density = Homogeneous()
    if values["dust_strength"] > 0.0:
        drift = scaled(values["dust_drift"], values["dust_time"])
        density = Dust(values["dust_strength"], values["dust_size"], values["dust_seed"], drift)
    return Medium(*scattering(values), Phase(values["g"]), density, scaled(values["ambient_color"], values["ambient"]))


def _volume(values: Mapping[str, Any], domain: Shape) -> Volume:
    """The haze in a domain. Raises ValueError for dust in one that is too thin for the engines."""
    if values["dust_strength"] > 0.0 and thickness(domain) < THINNEST:
        raise ValueError(f"dust needs a volume at least {THINNEST:g} m thick, got {thickness(domain):g} m; let the beam be wider "
                         "and longer, or set dust_strength to 0")
    return Volume(domain, _haze(values))


def thickness(shape: Shape) -> float:
    """Smallest side (m) of the box around a shape along its own axes; for a polyhedron along the world's."""
    match shape:
        case Hull():
            return min(max(along) - min(along) for along in zip(*shape.corners))
        case Cone():
            return min(shape.length, 2.0 * shape.length * math.tan(shape.half_angle))
    return 2.0 * min(shape.half)


def shafts(values: Mapping[str, Any], polygons: Iterable[Sequence[Vector]], direction: Vector) -> list[Volume]:
    """The haze that sunlight along ``direction`` fills behind convex openings. Raises ValueError as openings.shaft."""
    end = {"floor": values["floor_height"]} if values["shaft_end"] == "floor" else {"length": values["length"]}
    return [_volume(values, shaft(polygon, direction, **end)) for polygon in polygons]


def _shafts(values: Mapping[str, Any]) -> Item:
    """Rectangular openings side by side, their bars, and the sun where it is not the scene's."""
    direction = normalized(subtract(values["target"], values["location"]))
    azimuth, tilt = math.radians(values["opening_azimuth"]), math.radians(values["opening_tilt"])
    facing = (math.sin(azimuth), math.cos(azimuth), 0.0)
    right = (math.cos(azimuth), -math.sin(azimuth), 0.0)
    up = add(scaled((0.0, 0.0, 1.0), math.cos(tilt)), scaled(facing, math.sin(tilt)))
    size = values["opening_width"], values["opening_height"]
    if values["count"] > 1 and values["spacing"] < APART_SPACING * size[0]:
        raise ValueError(f"spacing must be >= {APART_SPACING:g} times opening_width, got {values['spacing']:g} m for openings of "
                         f"{size[0]:g} m; volumes that touch are ambiguous")
    across, along = scaled(right, size[0] / 2), scaled(up, size[1] / 2)
    polygons, bars = [], []
    for index in range(values["count"]):
        middle = add(values["location"], scaled(right, values["spacing"] * (index - (values["count"] - 1) / 2)))
        polygons.append([add(middle, add(scaled(across, x), scaled(along, y))) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        bars += _bars(values, middle, (right, up, cross(right, up)), size, OPENING_BAR)
    lights = [Sun(direction, scaled(values["color"], values["irradiance"]))] if values["irradiance"] > 0.0 else []
    return Item(shafts(values, polygons, direction), lights, [Surface(box, (0.0, 0.0, 0.0)) for box in bars])


def _frustum(apex: Vector, axes: tuple[Vector, Vector, Vector], slopes: tuple[float, ...], near: float, far: float) -> Hull:
    """The part of a pyramid between two distances along the last of its axes (right, up, forward)."""
    right, up, forward = axes

    def rectangle(distance: float) -> tuple[Vector, ...]:
        middle = add(apex, scaled(forward, distance))
        return tuple(add(middle, add(scaled(right, x * slopes[0] * distance), scaled(up, y * slopes[1] * distance)))
                     for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1)))

    return swept(rectangle(near), rectangle(far))


def _projector(values: Mapping[str, Any], apex: Vector, axis: Vector, up: Vector, power: Vector) -> Projector:
    horizontal, vertical = math.radians(values["horizontal_fov"]), math.radians(values["vertical_fov"])
    image = _gobo(values, math.tan(horizontal / 2) / math.tan(vertical / 2)) if values["gobo"] != "none" else None
    far = values["far"] if values["far"] < NEVER else math.inf
    return Projector(apex, axis, up, power, horizontal, vertical, values["near"], far, FALLOFF[values["falloff"]],
                     values["blend"], values["frustum"] == "elliptic", image)


def _gobo(values: Mapping[str, Any], aspect: float) -> Any:
    """The picture (rows, columns, 3) in the projector's light."""
    from .. import gobo  # numpy, only where there is something to draw

    placed = {"aspect": aspect, "resolution": values["gobo_resolution"], "scale": values["gobo_scale"],
              "rotation": math.radians(values["gobo_rotation"]),
              "drift": tuple(-values["gobo_time"] * values[f"gobo_drift_{way}"] for way in ("right", "up"))}
    if values["gobo"] == "image":
        from ...blender import pictures  # files are Blender's matter: engines and references then show the same pixels

        return gobo.resampled(pictures.read("gobo_image", values["gobo_image"]), **placed)
    return gobo.picture(values["gobo"], count=values["gobo_count"], softness=values["gobo_softness"], time=values["gobo_time"],
                        seed=values["gobo_seed"], **placed)


def _blockers(values: Mapping[str, Any], apex: Vector, axis: Vector, half_angle: float) -> list[Box]:
    """Bars in a plane across the beam. Count and fill are over the beam's width at that distance."""
    distance = values["blocker_distance"]
    width = 2 * distance * math.tan(half_angle)
    return _bars(values, add(apex, scaled(axis, distance)), look_frame(axis), (width, width), BEAM_BAR)


def _bars(values: Mapping[str, Any], center: Vector, axes: tuple[Vector, Vector, Vector], size: tuple[float, float],
          reach: float) -> list[Box]:
    """Flat bars over ``size`` along the first two axes, ``reach`` times as long as it."""
    if values["blocker"] == "none":
        return []
    right, up, back = axes
    c, s = (f(math.radians(values["blocker_rotation"])) for f in (math.cos, math.sin))
    across = add(scaled(right, c), scaled(up, s))
    along = add(scaled(right, -s), scaled(up, c))
    boxes = []
    directions = ((across, along, size), (along, across, size[::-1]))
    for first, second, (width, length) in directions[: 2 if values["blocker"] == "window" else 1]:
        pitch = width / values["blocker_count"]
        bar = (pitch * values["blocker_fill"] / 2, length * reach / 2, 0.0)
        for index in range(values["blocker_count"]):
            offset = (index + 0.5) * pitch - width / 2
            boxes.append(Box(add(center, scaled(first, offset)), bar, (first, second, back)))
    return boxes
