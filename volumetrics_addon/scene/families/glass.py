# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a glass to its volume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...parameters.glass import CUSTOM, NONE
from ...parameters.swatches import SWATCHES
from ..model import (
    Box, Color, Cover, Dielectric, Ellipsoid, Medium, Sheet, Vector, Volume, scaled, turned,
)
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


def sheet(values: Mapping[str, Any]) -> Sheet:
    """What a thin pane of these values is, wherever it stands."""
    if values["coverage_pattern"] == NONE:
        return Sheet(values["thickness"])
    pattern = values["coverage_pattern"]
    drawn = {} if pattern == "uniform" else {"size": values["coverage_size"], "seed": values["coverage_seed"]}
    if pattern == "dirt":
        drawn["softness"] = values["coverage_softness"]
    if pattern == "lead":
        drawn["variation"] = values["color_variation"]
    return Sheet(values["thickness"], Cover(pattern, values["coverage"], values["coverage_color"], **drawn))


def flattened(half: Vector) -> Vector:
    """The half sizes of a pane: 0 along the smallest, y where they are equal."""
    axis = min((1, 0, 2), key=lambda k: half[k])
    return tuple(0.0 if k == axis else h for k, h in enumerate(half))


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    half = scaled(values["size"], 0.5)
    is_pane = values["shape"] == "sheet"
    shape = {"sphere": Ellipsoid, "block": Box, "shell": Ellipsoid, "sheet": Box}[values["shape"]](
        values["location"], flattened(half) if is_pane else half, turned(math.radians(values["rotation"])))
    boundary = Dielectric(values["ior"]) if values["refraction"] else None
    cavity = None
    if values["shape"] == "shell":
        inner = tuple(half - values["thickness"] for half in shape.half)
        if min(inner) <= 0.0:
            raise ValueError(f"thickness = {values['thickness']:g} m fills the hollow sphere of size {values['size']} m; keep it "
                             f"below half of the smallest size, {min(shape.half):g} m, or take the shape \"sphere\"")
        cavity = replace(shape, half=inner)
    return Item([Volume(shape, Medium((0.0, 0.0, 0.0), absorption(values)), boundary, cavity=cavity,
                        sheet=sheet(values) if is_pane else None)])
