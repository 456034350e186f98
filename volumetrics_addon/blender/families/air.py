# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of a planet's air."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ...scene.families.air import PER_KILOMETRE
from ...scene.model import Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import Outputs, Sockets, scatter


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    """Molecules and aerosol for Cycles; for EEVEE one lobe with the mean cosine of both at each altitude."""
    altitude = _altitude(build, values["planet_radius"], values["base_height"])

    def coefficient(at_ground: str, scale_height: str) -> bpy.types.NodeSocket:
        depth = build.math("MULTIPLY", build.math("DIVIDE", altitude, inputs[scale_height]), -1.0)
        ground = build.math("MULTIPLY", inputs[at_ground], PER_KILOMETRE)
        return build.math("MULTIPLY", ground, build.math("EXPONENT", depth))

    rayleigh = coefficient("rayleigh_scattering", "rayleigh_scale_height")
    mie = coefficient("mie_extinction", "mie_scale_height")
    molecules = build.node("ShaderNodeVolumeScatter", {"Color": inputs["rayleigh_color"], "Density": rayleigh}, phase="RAYLEIGH")
    aerosol = scatter(build, inputs["mie_albedo"], mie, inputs["mie_g"])
    absorption = build.node("ShaderNodeVolumeAbsorption", {"Color": inputs["mie_albedo"], "Density": mie}).outputs[0]

    # A colour of at most 1 times a density: the share of each in the sum of both.
    parts = [build.scale(inputs["rayleigh_color"], rayleigh), build.scale(inputs["mie_albedo"], mie)]
    total = build.math("ADD", rayleigh, mie)
    color = build.scale(build.vector("ADD", *parts), build.math("DIVIDE", 1.0, total))
    amounts = [build.scalar("DOT_PRODUCT", part, (1.0 / 3.0,) * 3) for part in parts]
    g = build.math("MULTIPLY", inputs["mie_g"], build.math("DIVIDE", amounts[1], build.math("ADD", *amounts)))
    return {"Cycles Volume": build.shader_sum(molecules.outputs[0], aerosol, absorption),
            "EEVEE Volume": build.shader_sum(scatter(build, color, total, g), absorption)}


def _altitude(build: Tree, radius: float, base: float) -> bpy.types.NodeSocket:
    """Altitude above the planet's ground, 0 below it.

    h = |p - center| - R cancels in float32, to half a metre on the Earth. With p counted from the ground at the origin,
    h = (p.p + 2 R z) / (sqrt(x^2 + y^2 + (R + z)^2) + R), which keeps the digits of p.
    """
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    offset = build.vector("SUBTRACT", position, (0.0, 0.0, base))
    z = build.components(offset)[2]
    above = build.math("MULTIPLY_ADD", z, 2.0 * radius, build.scalar("DOT_PRODUCT", offset, offset))
    distance = build.scalar("LENGTH", build.vector("ADD", offset, (0.0, 0.0, radius)))
    return build.math("MAXIMUM", build.math("DIVIDE", above, build.math("ADD", distance, radius)), 0.0)
