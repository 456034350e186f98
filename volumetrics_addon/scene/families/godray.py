# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a godray to its light, haze and blockers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..model import Box, Cone, Medium, Phase, Shape, Spot, Surface, Vector, Volume, add, look_frame, normalized, scaled, subtract
from .item import Bounds, Item, scattering

# The haze cone is this much wider than the light's cone, so that the domain's faceted mantle stays in the dark.
CONE_CLEARANCE = 1.03


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    apex, axis = values["location"], normalized(subtract(values["target"], values["location"]))
    half_angle, length = math.radians(values["cone_angle"]) / 2, values["length"]
    spot = Spot(apex, axis, scaled(values["color"], values["power"]), 2 * half_angle, values["blend"])
    right, up, back = look_frame(axis)
    wide = min(half_angle * CONE_CLEARANCE, math.radians(85.0))
    domain: Shape
    if values["domain"] == "cone":
        domain = Cone(apex, axis, wide, length)
    else:
        radius = length * math.tan(wide)
        domain = Box(add(apex, scaled(axis, length / 2)), (radius, radius, length / 2), (right, up, back))
    sigma_s, sigma_a = scattering(values)
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
