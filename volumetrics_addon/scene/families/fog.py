# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a fog to its volumes: one for each layer, all in one domain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...parameters.fog import CONTRAST_DEPTH, DEPTH_FOGS, FAR
from ..model import (
    Box, DepthFog, Density, Ellipsoid, ExponentialHeight, Homogeneous, Medium, NoiseShape, Phase, Volume, add, scaled, subtract,
)
from .item import Bounds, Item, scattering

WISP_DETAIL, WISP_ROUGHNESS = 3.0, 0.5  # octaves of a patch's noise


def extinction(values: Mapping[str, Any]) -> float:
    """Extinction (1/m) at the base: the parameter, or CONTRAST_DEPTH / visibility where there is a visibility."""
    return CONTRAST_DEPTH / values["visibility"] if values["visibility"] > 0.0 else values["extinction"]


def assemble(values: Mapping[str, Any], bounds: Bounds | None) -> Item:
    """Box over the bounds plus the margin, from just below the base up to the top of the slab or the height of the cutoff density."""
    if values["profile"] in DEPTH_FOGS:
        if values["realisation"] == "volume":
            raise ValueError(f"profile {values['profile']!r} knows the distance alone and has no volume; choose the compositor as "
                             "realisation, or the profile 'exponential' or 'slab'")
        return Item([])
    if values["profile"] == "patch":
        return Item([_patch(values)])
    if bounds is None:
        raise ValueError("height fog is fitted to the scene; give the bounds of its objects and camera")
    margin, base = values["margin"], values["base_height"]
    layers: list[tuple[float, Density]]
    if values["profile"] == "slab":
        top, layers = base + values["slab_height"], [(extinction(values), Homogeneous())]
    else:
        layers = [(extinction(values), ExponentialHeight(values["scale_height"], base))]
        if values["second_extinction"] > 0.0:
            layers.append((values["second_extinction"], ExponentialHeight(values["second_scale_height"], base)))
        top = base + max(density.scale_height for _, density in layers) * -math.log(values["cutoff"])
    # One hundredth below the base, so that a floor at base height never coincides with the domain's face.
    bottom = base - 0.01 * (top - base)
    low = (bounds.low[0] - margin, bounds.low[1] - margin, bottom)
    high = (bounds.high[0] + margin, bounds.high[1] + margin, top)
    box = Box(scaled(add(low, high), 0.5), scaled(subtract(high, low), 0.5))
    media = [Medium(*scattering({**values, "extinction": sigma}), Phase(values["g"]), density) for sigma, density in layers]
    return Item([Volume(box, medium) for medium in media])


def _patch(values: Mapping[str, Any]) -> Volume:
    """An ellipsoid of fog that thins out towards its edge, with wisps carved from it."""
    if values["realisation"] == "compositor":
        raise ValueError("the light of a patch has no closed form for the compositor; choose the volume as realisation")
    half = scaled(values["size"], 0.5)
    density = NoiseShape(values["location"], half, values["noise_size"], WISP_DETAIL, WISP_ROUGHNESS, values["noise_strength"], 1.0,
                         values["edge"], 0, drift=scaled(values["wind"], values["time"]))
    return Volume(Ellipsoid(values["location"], half),
                  Medium(*scattering({**values, "extinction": extinction(values)}), Phase(values["g"]), density))


def depth_fog(values: Mapping[str, Any]) -> DepthFog:
    """The fog as the compositor makes it. Raises ValueError where a linear fog ends before it starts."""
    cutoff = values["cutoff_distance"] if values["cutoff_distance"] < FAR else math.inf
    common = DepthFog(values["start"], cutoff, values["max_opacity"], values["sun_tint"])
    if values["profile"] not in DEPTH_FOGS:
        return common
    return replace(common, falloff=values["profile"], end=values["end"], density=extinction(values), albedo=values["albedo"],
                   g=values["g"], radiance=scaled(values["far_color"], values["far_radiance"]))
