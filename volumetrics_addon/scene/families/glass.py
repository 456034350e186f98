# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a glass to its volume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..model import Box, Dielectric, Ellipsoid, Medium, Volume, scaled, turned
from .item import Bounds, Item


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    shape = {"sphere": Ellipsoid, "block": Box}[values["shape"]](
        values["location"], scaled(values["size"], 0.5), turned(math.radians(values["rotation"])))
    sigma_a = tuple(max(0.0, -math.log(c) / values["distance"]) for c in values["color"])
    boundary = Dielectric(values["ior"]) if values["refraction"] else None
    return Item([Volume(shape, Medium((0.0, 0.0, 0.0), sigma_a), boundary)])
