# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of the haze in a beam."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...scene.model import Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import Outputs, Sockets, one_lobe


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    extinction = inputs["extinction"]
    haze = one_lobe(build, inputs["albedo"], extinction, inputs["g"])
    # The ambient light scattered once is emission. Cycles' rays go on after their last event and would meet it there again.
    color = build.vector("MULTIPLY", inputs["albedo"], inputs["ambient_color"])
    strength = build.math("MULTIPLY", extinction, inputs["ambient"])
    seen = socket_of(build.node("ShaderNodeLightPath").outputs, "Is Camera Ray")
    strengths = {"Cycles Volume": build.math("MULTIPLY", strength, seen), "EEVEE Volume": strength}
    return {label: build.shader_sum(shader, build.node("ShaderNodeEmission", {"Color": color, "Strength": strengths[label]}).outputs[0])
            for label, shader in haze.items()}
