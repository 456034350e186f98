# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of height fog."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...parameters.fog import CONTRAST_DEPTH
from ...scene.families.fog import WISP_DETAIL, WISP_ROUGHNESS
from ...scene.model import Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import Outputs, Sockets, one_lobe
from .cloud import noise_density


def extinction(build: Tree, inputs: Sockets) -> Any:
    """The extinction at the base, live: CONTRAST_DEPTH / visibility where that is above 0; a division by 0 gives 0 in nodes."""
    seen = build.math("GREATER_THAN", inputs["visibility"], 0.0)
    return build.math("ADD", build.math("MULTIPLY", inputs["extinction"], build.math("SUBTRACT", 1.0, seen)),
                      build.math("DIVIDE", CONTRAST_DEPTH, inputs["visibility"]))


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    at_base = extinction(build, inputs)
    if values["profile"] == "slab":
        return one_lobe(build, inputs["albedo"], at_base, inputs["g"])
    if values["profile"] == "patch":
        carved = {**inputs, "softness": inputs["edge"], "fill": 1.0, "stretch": 1.0, "seed": 0.0, "evolution": 0.0,
                  "noise_detail": WISP_DETAIL, "noise_roughness": WISP_ROUGHNESS}
        density = noise_density(build, carved, {"profile": "round", "billow_octaves": 0, "base": 0.0}, shape)
        return one_lobe(build, inputs["albedo"], build.math("MULTIPLY", at_base, density), inputs["g"])
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    depth = build.math("SUBTRACT", inputs["base_height"], build.components(position)[2])

    def layer(extinction: Any, scale_height: str) -> Any:
        return build.math("MULTIPLY", extinction, build.math("EXPONENT", build.math("DIVIDE", depth, inputs[scale_height])))

    total = layer(at_base, "scale_height")
    if values["second_extinction"] > 0.0:
        total = build.math("ADD", total, layer(values["second_extinction"], "second_scale_height"))
    return one_lobe(build, inputs["albedo"], total, inputs["g"])
