# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of the haze in a beam."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...scene import noise
from ...scene.model import Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import Outputs, Sockets, one_lobe


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    extinction = inputs["extinction"]
    if values["dust_strength"] > 0.0:
        extinction = build.math("MULTIPLY", extinction, dust(build, inputs, values))
    haze = one_lobe(build, inputs["albedo"], extinction, inputs["g"])
    # The ambient light scattered once is emission. Cycles' rays go on after their last event and would meet it there again.
    color = build.vector("MULTIPLY", inputs["albedo"], inputs["ambient_color"])
    strength = build.math("MULTIPLY", extinction, inputs["ambient"])
    seen = socket_of(build.node("ShaderNodeLightPath").outputs, "Is Camera Ray")
    strengths = {"Cycles Volume": build.math("MULTIPLY", strength, seen), "EEVEE Volume": strength}
    glows = {label: build.node("ShaderNodeEmission", {"Color": color, "Strength": strengths[label]}).outputs[0] for label in haze}
    return {label: build.shader_sum(shader, glows[label]) for label, shader in haze.items()}


def dust(build: Tree, inputs: Sockets, values: Mapping[str, Any]) -> Any:
    """scene.model.Dust as nodes: swathes that stay in the world where the beam moves through them."""
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    moved = build.vector("SUBTRACT", position, build.scale(inputs["dust_drift"], inputs["dust_time"]))
    place = build.vector("ADD", build.scale(moved, build.math("DIVIDE", 1.0, inputs["dust_size"])),
                         tuple(noise.seed_offset(values["dust_seed"])))
    perlin = build.node("ShaderNodeTexNoise", {
        "Vector": place, "Scale": 1.0, "Detail": noise.DUST_DETAIL, "Roughness": noise.DUST_ROUGHNESS, "Lacunarity": 2.0,
        "Distortion": 0.0}, noise_dimensions="3D", noise_type="FBM", normalize=True)
    strength = values["dust_strength"]
    return build.math("MAXIMUM", build.math("MULTIPLY_ADD", perlin.outputs[0], 2.0 * strength, 1.0 - strength), 0.0)
