# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of an air to its volumes and ground."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..model import (
    Box, Ellipsoid, ExponentialAltitude, Medium, Phase, RayleighPhase, Surface, Volume, scaled,
)
from .item import Bounds, Item, scattering

PER_KILOMETRE = 1e-3  # 1/km in 1/m


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    """Molecules and aerosol around a planet whose ground passes through (0, 0, base height)."""
    radius = values["planet_radius"]
    center = (0.0, 0.0, values["base_height"] - radius)
    domain = Ellipsoid(center, (radius + values["thickness"],) * 3)
    molecules = scaled(values["rayleigh_color"], PER_KILOMETRE * values["rayleigh_scattering"])
    sigma_s, sigma_a = scattering({"extinction": PER_KILOMETRE * values["mie_extinction"], "albedo": values["mie_albedo"]})
    media = (
        Medium(molecules, (0.0, 0.0, 0.0), RayleighPhase(), ExponentialAltitude(center, radius, values["rayleigh_scale_height"])),
        Medium(sigma_s, sigma_a, Phase(values["mie_g"]), ExponentialAltitude(center, radius, values["mie_scale_height"])),
    )
    ground = Surface(Ellipsoid(center, (radius,) * 3), values["ground_albedo"])
    return Item([Volume(domain, medium) for medium in media], surfaces=[ground])


def domain(values: Mapping[str, Any]) -> Box:
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
