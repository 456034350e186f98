# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of light at smooth interfaces and in what absorbs between them. Vectors hold the three channels.

Blender goes through a whole tree at each change of it, so a tree of half as many nodes is built in a quarter of the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import bpy

from .nodes import Tree, socket_of
from .shaders import Sockets

Socket = bpy.types.NodeSocket

ONE = (1.0,) * 3
INVERSE_E = (math.exp(-1.0),) * 3
DIAGONAL = (3.0**-0.5,) * 3


def absorption(build: Tree, inputs: Sockets) -> Socket:
    """Coefficients -ln(color) strength / distance (per unit of length) of the channels, a vector."""
    channels = build.node("ShaderNodeSeparateColor", {0: inputs["color"]}).outputs
    depths = build.combine(*(build.math("LOGARITHM", channel, INVERSE_E[0]) for channel in channels))
    return build.scale(depths, build.math("DIVIDE", inputs["strength"], inputs["distance"]))


def transmitted(build: Tree, sigma: Socket, path: Any) -> Socket:
    """exp(-sigma path) of the channels, a vector."""
    return build.vector("POWER", INVERSE_E, build.scale(sigma, path))


@dataclass(frozen=True)
class Index:
    """An index of refraction n, and n^2 and n^2 - 1, which both sides of every interface need."""

    n: Any
    square: Socket
    excess: Socket


def index(build: Tree, ior: Any) -> Index:
    return Index(ior, square(build, ior), build.math("MULTIPLY_ADD", ior, ior, -1.0))


def inside(build: Tree, cosine: Any, ior: Index) -> Socket:
    """n times the cosine inside glass of a ray with the cosine c outside: sqrt(c^2 + n^2 - 1)."""
    return build.math("SQRT", build.math("MULTIPLY_ADD", cosine, cosine, ior.excess))


def outside(build: Tree, inner: Any, ior: Index) -> Socket:
    """The cosine outside, from n times the one inside: sqrt(g^2 - (n^2 - 1)), and 0 where reflection is total.

    The square root of a negative number is 0 in shader nodes.
    """
    return build.math("SQRT", build.math("SUBTRACT", square(build, inner), ior.excess))


def reflectance(build: Tree, cosine: Any, inner: Any, ior: Index) -> Socket:
    """Fresnel's reflectance of unpolarised light, the same from either side: ((c - g) / (c + g))^2 and
    ((n^2 c - g) / (n^2 c + g))^2, halved, from the cosine c outside and g, n times the one inside.

    The polarisations are two lanes of a vector, whose third is 0.
    """
    lanes = build.combine(cosine, build.math("MULTIPLY", ior.square, cosine), inner)
    parts = build.vector("DIVIDE", build.vector("SUBTRACT", lanes, inner), build.vector("ADD", lanes, inner))
    return build.math("MULTIPLY", build.scalar("DOT_PRODUCT", parts, parts), 0.5)


def incidence(build: Tree) -> tuple[bpy.types.Node, Socket]:
    """The geometry node, and the cosine of the ray that comes in, positive from either side."""
    geometry = build.node("ShaderNodeNewGeometry")
    incoming, normal = socket_of(geometry.outputs, "Incoming"), socket_of(geometry.outputs, "Normal")
    return geometry, build.math("ABSOLUTE", build.scalar("DOT_PRODUCT", incoming, normal))


def refracted(build: Tree, geometry: bpy.types.Node, ior: Any) -> Socket:
    """Where the refracted ray comes from, in the object's coordinates: against its direction, as Incoming is against the view."""
    incoming, normal = socket_of(geometry.outputs, "Incoming"), socket_of(geometry.outputs, "Normal")
    node = build.node("ShaderNodeVectorMath", {0: incoming, 1: build.scale(normal, -1.0),
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
