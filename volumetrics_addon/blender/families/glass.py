# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of glass that follows Beer-Lambert."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy

from ...scene.model import Ellipsoid, Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import ENGINES, Outputs, Sockets


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    """Absorption sigma_a = -ln(color) / distance; Cycles takes it as a volume, EEVEE as a tint where it refracts.

    A volume inside a refracting surface is lost in EEVEE. Its surface is tinted instead with the square root (the tint
    acts on the way in and on the way out) of the transmittance over the refracted path to the far side, which is exact
    for a path without inner reflection.
    """
    channels = build.node("ShaderNodeSeparateColor", {0: inputs["color"]}).outputs
    log = [build.math("LOGARITHM", channel, math.e) for channel in channels]
    sigma = [build.math("DIVIDE", value, build.math("MULTIPLY", inputs["distance"], -1.0)) for value in log]
    largest = build.math("MAXIMUM", build.math("MAXIMUM", sigma[0], sigma[1]), sigma[2])
    kept = [build.math("SUBTRACT", 1.0, build.math("DIVIDE", value, largest)) for value in sigma]
    color = build.node("ShaderNodeCombineColor", dict(enumerate(kept))).outputs[0]
    volume = build.node("ShaderNodeVolumeAbsorption", {"Color": color, "Density": largest}).outputs[0]
    if not values["refraction"]:
        return {f"{engine} Volume": volume for engine in ENGINES}
    surface = build.node("ShaderNodeBsdfGlass", {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.0, "IOR": inputs["ior"]})
    path = _refracted_path(build, inputs["ior"], shape)
    half_path = build.math("MULTIPLY", path, -0.5)
    tint = build.node("ShaderNodeCombineColor",
                      {i: build.math("EXPONENT", build.math("MULTIPLY", value, half_path)) for i, value in enumerate(sigma)})
    tinted = build.node("ShaderNodeBsdfGlass", {"Color": tint.outputs[0], "Roughness": 0.0, "IOR": inputs["ior"]})
    return {"Cycles Surface": surface.outputs[0], "Cycles Volume": volume, "EEVEE Surface": tinted.outputs[0],
            "EEVEE Thickness": path}


def _refracted_path(build: Tree, ior: Any, shape: Shape) -> bpy.types.NodeSocket:
    """Length of the refracted ray from the surface to the far side of the box or ellipsoid."""
    geometry = build.node("ShaderNodeNewGeometry")
    incident = build.scale(socket_of(geometry.outputs, "Incoming"), -1.0)
    node = build.node("ShaderNodeVectorMath", {0: incident, 1: socket_of(geometry.outputs, "Normal"),
                                               "Scale": build.math("DIVIDE", 1.0, ior)}, operation="REFRACT")
    refracted = socket_of(node.outputs, "Vector")
    direction = build.node("ShaderNodeVectorTransform", {0: refracted}, vector_type="VECTOR", convert_from="WORLD",
                           convert_to="OBJECT").outputs[0]
    position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    if isinstance(shape, Ellipsoid):
        p, d = (build.vector("DIVIDE", v, shape.half) for v in (position, direction))
        return build.math("MULTIPLY", -2.0, build.math("DIVIDE", build.scalar("DOT_PRODUCT", p, d),
                                                       build.scalar("DOT_PRODUCT", d, d)))
    reach = build.vector("SUBTRACT", build.vector("MULTIPLY", build.vector("SIGN", direction), shape.half), position)
    x, y, z = build.components(build.vector("DIVIDE", reach, direction))
    # A division by zero gives 0 in shader nodes; such an axis is never left.
    far = [build.math("ADD", t, build.math("MULTIPLY", build.math("LESS_THAN", build.math("ABSOLUTE", d), 1e-6), 1e9))
           for t, d in zip((x, y, z), build.components(direction))]
    return build.math("MINIMUM", build.math("MINIMUM", far[0], far[1]), far[2])
