# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a fog to its volume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..model import Box, ExponentialHeight, Medium, Phase, Volume, add, scaled, subtract
from .item import Bounds, Item, scattering


def assemble(values: Mapping[str, Any], bounds: Bounds | None) -> Item:
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
    sigma_s, sigma_a = scattering(values)
    return Item([Volume(box, Medium(sigma_s, sigma_a, Phase(values["g"]), ExponentialHeight(scale_height, base)))])
