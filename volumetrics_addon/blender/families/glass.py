# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of glass that follows Beer-Lambert.

Cycles takes the absorption as a volume. EEVEE loses a volume inside a refracting surface and shows the front of a body alone;
its surface gets the share of light that is mirrored there, R, and the share that comes through the whole body, T, from closed
forms along the refracted path. With r the reflectance at the entrance and t the transmittance of the whole path in glass:

* ball: all inner chords are equal, R = r, T = (1 - r)^2 t / (1 - r t);
* block: r' at the face where the path ends, what is mirrored there leaves after one more leg of transmittance t':
  R = r, T = (1 - r) ((1 - r') t + r' t t'), without Fresnel losses on that leg;
* shell: its two walls are plates between r and r', the reflectance at the cavity; see ``_shell``.

Ball and shell are exact under uniform light; elsewhere the light of inner reflections comes from the wrong direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy

from ...scene.model import Box, Ellipsoid, Shape
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import ENGINES, Outputs, Sockets

Socket = bpy.types.NodeSocket


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    """Absorption sigma_a = -ln(color) strength / distance; Cycles takes it as a volume, EEVEE as a tint where it refracts."""
    sigma = absorption(build, inputs)
    volume = _volume(build, sigma)
    if not values["refraction"]:
        return {f"{engine} Volume": volume for engine in ENGINES}
    surface = build.node("ShaderNodeBsdfGlass", {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.0, "IOR": inputs["ior"]})
    geometry = build.node("ShaderNodeNewGeometry")
    cosine, direction, position = _refracted(build, geometry, inputs["ior"])
    entrance = reflectance(build, cosine, inputs["ior"])
    path, mirrored, through = _BODIES[type(shape)](build, inputs["ior"], shape, fields, sigma, entrance, position, direction)
    # The tint of EEVEE's refraction acts on the way in and on the way out.
    tint = build.node("ShaderNodeCombineColor", {i: build.math("SQRT", part) for i, part in enumerate(through)})
    mirror = build.node("ShaderNodeCombineColor", dict(enumerate(mirrored)))
    shader = build.shader_sum(
        build.node("ShaderNodeBsdfRefraction", {"Color": tint.outputs[0], "Roughness": 0.0, "IOR": inputs["ior"]}).outputs[0],
        build.node("ShaderNodeBsdfAnisotropic", {"Color": mirror.outputs[0], "Roughness": 0.0}).outputs[0])
    return {"Cycles Surface": surface.outputs[0], "Cycles Volume": volume, "EEVEE Surface": shader, "EEVEE Thickness": path}


def absorption(build: Tree, inputs: Sockets) -> list[Socket]:
    """Coefficients (1/m) of the three channels."""
    channels = build.node("ShaderNodeSeparateColor", {0: inputs["color"]}).outputs
    scale = build.math("DIVIDE", inputs["strength"], build.math("MULTIPLY", inputs["distance"], -1.0))
    return [build.math("MULTIPLY", build.math("LOGARITHM", channel, math.e), scale) for channel in channels]


def _volume(build: Tree, sigma: list[Socket]) -> Socket:
    largest = build.math("MAXIMUM", build.math("MAXIMUM", sigma[0], sigma[1]), sigma[2])
    kept = [build.math("SUBTRACT", 1.0, build.math("DIVIDE", value, largest)) for value in sigma]
    color = build.node("ShaderNodeCombineColor", dict(enumerate(kept))).outputs[0]
    return build.node("ShaderNodeVolumeAbsorption", {"Color": color, "Density": largest}).outputs[0]


def transmitted(build: Tree, sigma: list[Socket], path: Any) -> list[Socket]:
    back = build.math("MULTIPLY", path, -1.0)
    return [build.math("EXPONENT", build.math("MULTIPLY", value, back)) for value in sigma]


def inner_cosine(build: Tree, cosine: Any, ior: Any) -> Socket:
    """Cosine inside glass of a ray with this cosine outside: sqrt(1 - (1 - c^2) / n^2)."""
    sine2 = build.math("DIVIDE", _one_minus(build, _square(build, cosine)), _square(build, ior))
    return build.math("SQRT", build.math("MAXIMUM", _one_minus(build, sine2), 0.0))


def reflectance(build: Tree, cosine: Any, ior: Any) -> Socket:
    """Fresnel's reflectance of unpolarised light, from the cosine outside the glass: the same from either side."""
    inside = inner_cosine(build, cosine, ior)
    pairs = ((cosine, build.math("MULTIPLY", ior, inside)), (build.math("MULTIPLY", ior, cosine), inside))
    parts = [_square(build, build.math("DIVIDE", build.math("SUBTRACT", a, b), build.math("ADD", a, b))) for a, b in pairs]
    return build.math("MULTIPLY", build.math("ADD", *parts), 0.5)


def _refracted(build: Tree, geometry: bpy.types.Node, ior: Any) -> tuple[Socket, Socket, Socket]:
    """Cosine of the ray that comes in, its refracted direction in object space (m), and where it enters there."""
    incoming, normal = socket_of(geometry.outputs, "Incoming"), socket_of(geometry.outputs, "Normal")
    cosine = build.math("ABSOLUTE", build.scalar("DOT_PRODUCT", incoming, normal))
    node = build.node("ShaderNodeVectorMath", {0: build.scale(incoming, -1.0), 1: normal,
                                               "Scale": build.math("DIVIDE", 1.0, ior)}, operation="REFRACT")
    direction = build.node("ShaderNodeVectorTransform", {0: socket_of(node.outputs, "Vector")}, vector_type="VECTOR",
                           convert_from="WORLD", convert_to="OBJECT").outputs[0]
    return cosine, direction, socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")


def _round(build: Tree, ior: Any, shape: Ellipsoid, fields: Fields, sigma: list[Socket], r: Socket, position: Socket,
           direction: Socket) -> tuple[Socket, list[Socket], list[Socket]]:
    if fields.cavity is not None:
        return _shell(build, ior, shape, fields.cavity, sigma, r, position, direction)
    p, d = (build.vector("DIVIDE", v, shape.half) for v in (position, direction))
    path = build.math("MULTIPLY", -2.0, build.math("DIVIDE", build.scalar("DOT_PRODUCT", p, d),
                                                   build.scalar("DOT_PRODUCT", d, d)))
    enters = _one_minus(build, r)
    return path, [r] * 3, [build.math("DIVIDE", build.math("MULTIPLY", _square(build, enters), t),
                                      _one_minus(build, build.math("MULTIPLY", r, t)))
                           for t in transmitted(build, sigma, path)]


def _shell(build: Tree, ior: Any, shape: Ellipsoid, cavity: Ellipsoid, sigma: list[Socket], r: Socket, position: Socket,
           direction: Socket) -> tuple[Socket, list[Socket], list[Socket]]:
    """Two walls of transmittance w = sqrt(t), t over the chord of the refracted line less its chord of the cavity.

    A wall, a plate between r and r', transmits a = (1 - r)(1 - r') w / (1 - r r' t); it mirrors b = r + c, with
    c = (1 - r)^2 r' t / (1 - r r' t), outwards and b' = r' + (1 - r')^2 r t / (1 - r r' t) into the cavity. Both walls:
    T = a^2 / (1 - b'^2), R = b + a^2 b' / (1 - b'^2). Where the line misses the cavity or is totally reflected there, r' = 1
    and c leaves on the far side: T = c, R = r.
    """
    p, d = (build.vector("DIVIDE", v, shape.half) for v in (position, direction))
    chord = build.math("MULTIPLY", -2.0, build.math("DIVIDE", build.scalar("DOT_PRODUCT", p, d),
                                                    build.scalar("DOT_PRODUCT", d, d)))
    p, d = (build.vector("DIVIDE", v, cavity.half) for v in (position, direction))
    dd, pd = build.scalar("DOT_PRODUCT", d, d), build.scalar("DOT_PRODUCT", p, d)
    # Squared sine of the line at the cavity: its least distance there, in radii.
    sine2 = build.math("SUBTRACT", build.scalar("DOT_PRODUCT", p, p), build.math("DIVIDE", _square(build, pd), dd))
    half = build.math("SQRT", build.math("DIVIDE", build.math("MAXIMUM", _one_minus(build, sine2), 0.0), dd))
    path = build.math("MULTIPLY_ADD", half, -2.0, chord)
    outside2 = _one_minus(build, build.math("MULTIPLY", sine2, _square(build, ior)))  # squared cosine in the cavity
    blocked = build.math("LESS_THAN", outside2, 0.0)
    inner = reflectance(build, build.math("SQRT", build.math("MAXIMUM", outside2, 0.0)), ior)
    inner = build.math("MAXIMUM", inner, blocked)
    enters, leaves = _one_minus(build, r), _one_minus(build, inner)
    mirrored, through = [], []
    for t in transmitted(build, sigma, path):
        turns = _one_minus(build, build.math("MULTIPLY", build.math("MULTIPLY", r, inner), t))
        a2 = build.math("DIVIDE", build.math("MULTIPLY", _square(build, build.math("MULTIPLY", enters, leaves)), t),
                        _square(build, turns))
        c = build.math("DIVIDE", build.math("MULTIPLY", build.math("MULTIPLY", _square(build, enters), inner), t), turns)
        back = build.math("ADD", inner, build.math("DIVIDE", build.math(
            "MULTIPLY", build.math("MULTIPLY", _square(build, leaves), r), t), turns))
        crossed = build.math("DIVIDE", a2, _one_minus(build, _square(build, back)))  # a division by zero gives 0, as a does
        far = build.math("MULTIPLY", c, blocked)
        through.append(build.math("ADD", crossed, far))
        near = build.math("ADD", build.math("SUBTRACT", c, far), build.math("MULTIPLY", crossed, back))
        mirrored.append(build.math("ADD", r, near))
    return path, mirrored, through


def _block(build: Tree, ior: Any, shape: Box, fields: Fields, sigma: list[Socket], r: Socket, position: Socket,
           direction: Socket) -> tuple[Socket, list[Socket], list[Socket]]:
    far = _to_planes(build, shape, position, direction)
    path, faces = _nearest(build, far), _face(build, far)
    reached = build.vector("MULTIPLY_ADD", direction, build.combine(path, path, path), position)
    turned = build.vector("MULTIPLY", direction, build.vector("MULTIPLY_ADD", faces, (-2.0,) * 3, (1.0,) * 3))
    more = _nearest(build, _to_planes(build, shape, reached, turned))
    inside2 = _square(build, build.scalar("DOT_PRODUCT", build.vector("ABSOLUTE", direction), faces))
    outside2 = _one_minus(build, build.math("MULTIPLY", _one_minus(build, inside2), _square(build, ior)))
    leaving = build.math("MAXIMUM", reflectance(build, build.math("SQRT", build.math("MAXIMUM", outside2, 0.0)), ior),
                         build.math("LESS_THAN", outside2, 0.0))
    enters = _one_minus(build, r)
    through = []
    for t, further in zip(transmitted(build, sigma, path), transmitted(build, sigma, more)):
        kept = build.math("MULTIPLY_ADD", leaving, build.math("SUBTRACT", further, 1.0), 1.0)  # 1 - r' + r' t'
        through.append(build.math("MULTIPLY", build.math("MULTIPLY", enters, t), kept))
    return path, [r] * 3, through


def _to_planes(build: Tree, shape: Box, position: Any, direction: Any) -> list[Socket]:
    """Ways (m) from a position in the box to the planes of the faces ahead, one for each axis."""
    reach = build.vector("SUBTRACT", build.vector("MULTIPLY", build.vector("SIGN", direction), shape.half), position)
    # A division by zero gives 0 in shader nodes; such an axis is never left.
    return [build.math("ADD", t, build.math("MULTIPLY", build.math("LESS_THAN", build.math("ABSOLUTE", d), 1e-6), 1e9))
            for t, d in zip(build.components(build.vector("DIVIDE", reach, direction)), build.components(direction))]


def _nearest(build: Tree, far: list[Socket]) -> Socket:
    return build.math("MINIMUM", build.math("MINIMUM", far[0], far[1]), far[2])


def _face(build: Tree, far: list[Socket]) -> Socket:
    """A vector that is 1 along the axis of the nearest plane, and 0 along the others."""
    first = build.math("LESS_THAN", far[0], build.math("MINIMUM", far[1], far[2]))
    second = build.math("MULTIPLY", _one_minus(build, first), build.math("LESS_THAN", far[1], far[2]))
    return build.combine(first, second, build.math("SUBTRACT", _one_minus(build, first), second))


_BODIES = {Ellipsoid: _round, Box: _block}


def _one_minus(build: Tree, value: Any) -> Socket:
    return build.math("SUBTRACT", 1.0, value)


def _square(build: Tree, value: Any) -> Socket:
    return build.math("MULTIPLY", value, value)
