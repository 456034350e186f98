# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of light at smooth interfaces and in what absorbs between them. Vectors hold the three channels."""

from __future__ import annotations

import math
from typing import Any

import bpy

from .nodes import Tree, socket_of
from .shaders import Sockets

Socket = bpy.types.NodeSocket

E = (math.e,) * 3
ONE = (1.0,) * 3
DIAGONAL = (3.0**-0.5,) * 3


def absorption(build: Tree, inputs: Sockets) -> Socket:
    """Coefficients -ln(color) strength / distance (per unit of length) of the channels, a vector."""
    channels = build.node("ShaderNodeSeparateColor", {0: inputs["color"]}).outputs
    depths = build.combine(*(build.math("LOGARITHM", channel, math.e) for channel in channels))
    return build.scale(depths, build.math("DIVIDE", inputs["strength"], build.math("MULTIPLY", inputs["distance"], -1.0)))


def transmitted(build: Tree, sigma: Socket, path: Any) -> Socket:
    """exp(-sigma path) of the channels, a vector."""
    return build.vector("POWER", E, build.scale(sigma, build.math("MULTIPLY", path, -1.0)))


def inner_cosine(build: Tree, cosine: Any, ior: Any) -> Socket:
    """Cosine inside glass of a ray with this cosine outside: sqrt(1 - (1 - c^2) / n^2)."""
    sine2 = build.math("DIVIDE", one_minus(build, square(build, cosine)), square(build, ior))
    return build.math("SQRT", build.math("MAXIMUM", one_minus(build, sine2), 0.0))


def reflectance(build: Tree, cosine: Any, ior: Any, inside: Any = None) -> Socket:
    """Fresnel's reflectance of unpolarised light, from the cosine outside the glass: the same from either side."""
    inside = inside or inner_cosine(build, cosine, ior)
    pairs = ((cosine, build.math("MULTIPLY", ior, inside)), (build.math("MULTIPLY", ior, cosine), inside))
    parts = [square(build, build.math("DIVIDE", build.math("SUBTRACT", a, b), build.math("ADD", a, b))) for a, b in pairs]
    return build.math("MULTIPLY", build.math("ADD", *parts), 0.5)


def incidence(build: Tree) -> tuple[bpy.types.Node, Socket]:
    """The geometry node, and the cosine of the ray that comes in, positive from either side."""
    geometry = build.node("ShaderNodeNewGeometry")
    incoming, normal = socket_of(geometry.outputs, "Incoming"), socket_of(geometry.outputs, "Normal")
    return geometry, build.math("ABSOLUTE", build.scalar("DOT_PRODUCT", incoming, normal))


def refracted(build: Tree, geometry: bpy.types.Node, ior: Any) -> Socket:
    """Direction of the refracted ray in the object's coordinates."""
    incoming, normal = socket_of(geometry.outputs, "Incoming"), socket_of(geometry.outputs, "Normal")
    node = build.node("ShaderNodeVectorMath", {0: build.scale(incoming, -1.0), 1: normal,
                                               "Scale": build.math("DIVIDE", 1.0, ior)}, operation="REFRACT")
    return build.node("ShaderNodeVectorTransform", {0: socket_of(node.outputs, "Vector")}, vector_type="VECTOR",
                      convert_from="WORLD", convert_to="OBJECT").outputs[0]


def object_scale(build: Tree) -> Socket:
    """Scale of the object: the length that its diagonal of length 1 has in the world."""
    node = build.node("ShaderNodeVectorTransform", {0: DIAGONAL}, vector_type="VECTOR", convert_from="OBJECT", convert_to="WORLD")
    return build.scalar("LENGTH", node.outputs[0])


def mirror(build: Tree, color: Any) -> Socket:
    """A sharp mirror of this colour."""
    return build.node("ShaderNodeBsdfAnisotropic", {"Color": color, "Roughness": 0.0}).outputs[0]


def one_minus(build: Tree, value: Any) -> Socket:
    return build.math("SUBTRACT", 1.0, value)


def square(build: Tree, value: Any) -> Socket:
    return build.math("MULTIPLY", value, value)
