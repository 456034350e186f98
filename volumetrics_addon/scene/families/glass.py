# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a glass to its volume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...parameters.glass import CUSTOM
from ...parameters.swatches import SWATCHES
from ..model import Box, Color, Dielectric, Ellipsoid, Medium, Volume, scaled, turned
from .item import Bounds, Item


def absorption(values: Mapping[str, Any]) -> Color:
    """Coefficients (1/m) per channel."""
    if values["swatch"] == CUSTOM:
        sigma = tuple(max(0.0, -math.log(c) / values["distance"]) for c in values["color"])
    else:
        sigma = SWATCHES[values["swatch"]].sigma_a
    return scaled(sigma, values["strength"])


def resolved(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values with a swatch written as the colour that it leaves over the length at which its strongest channel is 1/e."""
    if values["swatch"] == CUSTOM:
        return dict(values)
    sigma = SWATCHES[values["swatch"]].sigma_a
    distance = 1.0 / max(sigma)
    return {**values, "swatch": CUSTOM, "distance": distance, "color": tuple(math.exp(-s * distance) for s in sigma)}


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    shape = {"sphere": Ellipsoid, "block": Box, "shell": Ellipsoid}[values["shape"]](
        values["location"], scaled(values["size"], 0.5), turned(math.radians(values["rotation"])))
    boundary = Dielectric(values["ior"]) if values["refraction"] else None
    cavity = None
    if values["shape"] == "shell":
        inner = tuple(half - values["thickness"] for half in shape.half)
        if min(inner) <= 0.0:
            raise ValueError(f"thickness = {values['thickness']:g} m fills the hollow sphere of size {values['size']} m; keep it "
                             f"below half of the smallest size, {min(shape.half):g} m, or take the shape \"sphere\"")
        cavity = replace(shape, half=inner)
    return Item([Volume(shape, Medium((0.0, 0.0, 0.0), absorption(values)), boundary, cavity=cavity)])
