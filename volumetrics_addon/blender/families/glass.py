# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of glass that follows Beer-Lambert.

Cycles takes the absorption as a volume. EEVEE loses a volume inside a refracting surface and shows the front of a body alone;
its surface gets the share of light that is mirrored there, R, and the share that comes through the whole body, T, from closed
forms along the refracted path. With r the reflectance at the entrance and t the transmittance of the whole path in glass:

* ball: all inner chords are equal, R = r, T = (1 - r)^2 t / (1 - r t);
* block: r' at the face where the path ends, what is mirrored there leaves after one more leg of transmittance t':
  R = r, T = (1 - r) ((1 - r') t + r' t t'), without Fresnel losses on that leg;
* shell: its two walls are plates between r and r', the reflectance at the cavity; see ``_shell``;
* mesh of the user's own: as the ball, over a way inside that was measured (see ``chords``).

Ball and shell are exact under uniform light; elsewhere the light of inner reflections comes from the wrong direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ...scene.model import Box, Ellipsoid, Shape
from .. import chords, pane
from ..fields import Fields
from ..interface import (
    ONE, absorption, incidence, inner_cosine, mirror, object_scale, one_minus, reflectance, refracted, square, transmitted,
)
from ..nodes import Tree, socket_of
from ..shaders import ENGINES, Outputs, Sockets

Socket = bpy.types.NodeSocket
# Path in glass, and the shares R and T (a number or a vector each).
Body = tuple[Socket, Socket, Socket]


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    """Absorption sigma_a = -ln(color) strength / distance; Cycles takes it as a volume, EEVEE as a tint where it refracts.

    A thin pane is a surface alone; see ``pane``.
    """
    if values["shape"] == "sheet":
        return pane.outputs(build, inputs, values, tuple(k for k in range(3) if shape.half[k] > 0.0), fields.cover)
    sigma = absorption(build, inputs)
    volume = _volume(build, sigma)
    if not values["refraction"]:
        return {f"{engine} Volume": volume for engine in ENGINES}
    surface = build.node("ShaderNodeBsdfGlass", {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.0, "IOR": inputs["ior"]})
    geometry, cosine = incidence(build)
    direction, position = refracted(build, geometry, inputs["ior"]), socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    entrance = reflectance(build, cosine, inputs["ior"])
    if fields.measured:
        way = chords.chord(build, direction, inner_cosine(build, cosine, inputs["ior"]))
        path, mirrored, through = _ball(build, sigma, entrance, way)
    else:
        path, mirrored, through = _BODIES[type(shape)](build, inputs["ior"], shape, fields, sigma, entrance, position, direction)
    # The tint of EEVEE's refraction acts on the way in and on the way out.
    tint = build.vector("POWER", through, (0.5,) * 3)
    shader = build.shader_sum(
        build.node("ShaderNodeBsdfRefraction", {"Color": tint, "Roughness": 0.0, "IOR": inputs["ior"]}).outputs[0],
        mirror(build, mirrored))
    # EEVEE multiplies the thickness by the object's scale.
    return {"Cycles Surface": surface.outputs[0], "Cycles Volume": volume, "EEVEE Surface": shader,
            "EEVEE Thickness": build.math("DIVIDE", path, object_scale(build))}


def _volume(build: Tree, sigma: Socket) -> Socket:
    parts = build.components(sigma)
    largest = build.math("MAXIMUM", build.math("MAXIMUM", parts[0], parts[1]), parts[2])
    color = build.vector("SUBTRACT", ONE, build.vector("DIVIDE", sigma, largest))
    return build.node("ShaderNodeVolumeAbsorption", {"Color": color, "Density": largest}).outputs[0]


def _round(build: Tree, ior: Any, shape: Ellipsoid, fields: Fields, sigma: Socket, r: Socket, position: Socket,
           direction: Socket) -> Body:
    p, d = (build.vector("DIVIDE", v, shape.half) for v in (position, direction))
    chord = build.math("MULTIPLY", -2.0, build.math("DIVIDE", build.scalar("DOT_PRODUCT", p, d),
                                                    build.scalar("DOT_PRODUCT", d, d)))
    if fields.cavity is not None:
        return _shell(build, ior, fields.cavity, sigma, r, position, direction, chord)
    return _ball(build, sigma, r, chord)


def _ball(build: Tree, sigma: Socket, r: Socket, chord: Socket) -> Body:
    """T = (1 - r)^2 t / (1 - r t)."""
    t = transmitted(build, sigma, chord)
    lost = build.vector("SUBTRACT", ONE, build.vector("MULTIPLY", t, r))
    return chord, r, build.vector("DIVIDE", build.vector("MULTIPLY", t, square(build, one_minus(build, r))), lost)


def _shell(build: Tree, ior: Any, cavity: Ellipsoid, sigma: Socket, r: Socket, position: Socket, direction: Socket,
           chord: Socket) -> Body:
    """Two walls of transmittance w = sqrt(t), t over the chord of the refracted line less its chord of the cavity.

    A wall, a plate between r and r', transmits a = (1 - r)(1 - r') w / (1 - r r' t); it mirrors b = r + c, with
    c = (1 - r)^2 r' t / (1 - r r' t), outwards and b' = r' + (1 - r')^2 r t / (1 - r r' t) into the cavity. Both walls:
    T = a^2 / (1 - b'^2), R = b + a^2 b' / (1 - b'^2). Where the line misses the cavity or is totally reflected there, r' = 1
    and c leaves on the far side: T = c, R = r.
    """
    p, d = (build.vector("DIVIDE", v, cavity.half) for v in (position, direction))
    dd, pd = build.scalar("DOT_PRODUCT", d, d), build.scalar("DOT_PRODUCT", p, d)
    # Squared sine of the line at the cavity: its least distance there, in radii.
    sine2 = build.math("SUBTRACT", build.scalar("DOT_PRODUCT", p, p), build.math("DIVIDE", square(build, pd), dd))
    half = build.math("SQRT", build.math("DIVIDE", build.math("MAXIMUM", one_minus(build, sine2), 0.0), dd))
    path = build.math("MULTIPLY_ADD", half, -2.0, chord)
    inner, blocked = _leaving(build, build.math("MULTIPLY", sine2, square(build, ior)), ior)
    enters, leaves = square(build, one_minus(build, r)), square(build, one_minus(build, inner))
    t = transmitted(build, sigma, path)
    turns = build.vector("SUBTRACT", ONE, build.scale(t, build.math("MULTIPLY", r, inner)))  # 1 - r r' t
    once = build.vector("DIVIDE", t, turns)
    a2 = build.vector("DIVIDE", build.scale(once, build.math("MULTIPLY", enters, leaves)), turns)
    c = build.scale(once, build.math("MULTIPLY", enters, inner))
    back = build.vector("ADD", build.scale(once, build.math("MULTIPLY", leaves, r)), inner)
    # A division by zero gives 0, as a does.
    crossed = build.vector("DIVIDE", a2, build.vector("SUBTRACT", ONE, build.vector("MULTIPLY", back, back)))
    far = build.scale(c, blocked)
    near = build.vector("ADD", build.vector("SUBTRACT", c, far), r)
    return path, build.vector("MULTIPLY_ADD", crossed, back, near), build.vector("ADD", crossed, far)


def _block(build: Tree, ior: Any, shape: Box, fields: Fields, sigma: Socket, r: Socket, position: Socket,
           direction: Socket) -> Body:
    far = _to_planes(build, shape, position, direction)
    path, faces = _nearest(build, far), _face(build, far)
    reached = build.vector("MULTIPLY_ADD", direction, build.combine(path, path, path), position)
    turned = build.vector("MULTIPLY", direction, build.vector("MULTIPLY_ADD", faces, (-2.0,) * 3, ONE))
    more = _nearest(build, _to_planes(build, shape, reached, turned))
    inside2 = square(build, build.scalar("DOT_PRODUCT", build.vector("ABSOLUTE", direction), faces))
    leaving, _ = _leaving(build, build.math("MULTIPLY", one_minus(build, inside2), square(build, ior)), ior)
    t, further = transmitted(build, sigma, path), transmitted(build, sigma, more)
    kept = build.vector("MULTIPLY_ADD", build.vector("SUBTRACT", further, ONE), leaving, ONE)  # 1 - r' + r' t'
    return path, r, build.vector("MULTIPLY", build.scale(t, one_minus(build, r)), kept)


def _leaving(build: Tree, sine2: Socket, ior: Any) -> tuple[Socket, Socket]:
    """Reflectance from inside, by the squared sine outside, and whether it is total (1 or 0)."""
    outside2 = one_minus(build, sine2)
    total = build.math("LESS_THAN", outside2, 0.0)
    partial = reflectance(build, build.math("SQRT", build.math("MAXIMUM", outside2, 0.0)), ior)
    return build.math("MAXIMUM", partial, total), total


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
    second = build.math("MULTIPLY", one_minus(build, first), build.math("LESS_THAN", far[1], far[2]))
    return build.combine(first, second, build.math("SUBTRACT", one_minus(build, first), second))


_BODIES = {Ellipsoid: _round, Box: _block}
