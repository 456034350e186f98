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
    ONE, Index, absorption, incidence, index, inside, mirror, object_scale, one_minus, outside, reflectance, refracted, square,
    transmitted,
)
from ..nodes import Tree, socket_of
from ..shaders import ENGINES, Outputs, Sockets

Socket = bpy.types.NodeSocket
# Path in glass, and the shares R and T (a number or a vector each).
Body = tuple[Socket, Socket, Socket]

NO_AXIS = 1e-7  # added to a direction: what is across an axis comes to its planes late, where a division by zero would give 0
EDGE = 1e5  # half sides in the band at an edge where two faces are blended: wider than the rounding of floats


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
    ior, back = index(build, inputs["ior"]), refracted(build, geometry, inputs["ior"])
    inner = inside(build, cosine, ior)
    entrance = reflectance(build, cosine, inner, ior)
    if fields.measured:
        path, mirrored, through = _ball(build, sigma, entrance, chords.chord(build, back, build.math("DIVIDE", inner, ior.n)))
    else:
        position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
        path, mirrored, through = _BODIES[type(shape)](build, ior, shape, fields, sigma, entrance, position, back)
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


def _round(build: Tree, ior: Index, shape: Ellipsoid, fields: Fields, sigma: Socket, r: Socket, position: Socket,
           back: Socket) -> Body:
    """The chord 2 p.b / b.b of the unit ball along b, against the ray; p.b and b.b are products with b over the squared radii."""
    over = build.vector("MULTIPLY", back, tuple(half**-2 for half in shape.half))
    chord = build.math("DIVIDE", build.scalar("DOT_PRODUCT", position, over),
                       build.math("MULTIPLY", build.scalar("DOT_PRODUCT", back, over), 0.5))
    if fields.cavity is not None:
        return _shell(build, ior, fields.cavity, sigma, r, position, back, chord)
    return _ball(build, sigma, r, chord)


def _ball(build: Tree, sigma: Socket, r: Socket, chord: Socket) -> Body:
    return chord, r, _passed(build, sigma, r, chord)[0]


def _passed(build: Tree, sigma: Socket, r: Socket, chord: Socket) -> tuple[Socket, Socket]:
    """(1 - r)^2 t / (1 - r t), and r t."""
    t = transmitted(build, sigma, chord)
    mirrored = build.vector("MULTIPLY", t, r)
    entered = build.vector("MULTIPLY", t, square(build, one_minus(build, r)))
    return build.vector("DIVIDE", entered, build.vector("SUBTRACT", ONE, mirrored)), mirrored


def _shell(build: Tree, ior: Index, cavity: Ellipsoid, sigma: Socket, r: Socket, position: Socket, back: Socket,
           chord: Socket) -> Body:
    """Two walls of transmittance w = sqrt(t), t over the chord of the refracted line less its chord of the cavity.

    A wall, a plate between r and r', transmits a = (1 - r)(1 - r') w / (1 - r r' t); it mirrors b = r + c, with
    c = (1 - r)^2 r' t / (1 - r r' t), outwards and b' = r' + (1 - r')^2 r t / (1 - r r' t) into the cavity. Both walls:
    T = a^2 / (1 - b'^2), R = b + a^2 b' / (1 - b'^2). With the ball's T, B = (1 - r)^2 t / (1 - r t), these come to
    T = B (1 - r') / (1 + r' + (1 - 3 r') r t), R = r + B - T. Where the line misses the cavity or is totally reflected there,
    all of B leaves on the far side: T = B, R = r.
    """
    p, line = (build.vector("DIVIDE", v, cavity.half) for v in (position, back))
    # Squared sine of the line at the cavity: its least distance there, in radii.
    aside = build.vector("SUBTRACT", p, build.vector("PROJECT", p, line))
    sine2 = build.scalar("DOT_PRODUCT", aside, aside)
    half2 = build.math("DIVIDE", one_minus(build, sine2), build.scalar("DOT_PRODUCT", line, line))
    half = build.math("SQRT", half2)  # 0 beside the cavity
    path = build.math("MULTIPLY_ADD", half, -2.0, chord)
    outside2 = one_minus(build, build.math("MULTIPLY", sine2, ior.square))
    blocked, cosine = build.math("LESS_THAN", outside2, 0.0), build.math("SQRT", outside2)
    inner = reflectance(build, cosine, inside(build, cosine, ior), ior)
    leaves, mirrored = _passed(build, sigma, r, path)
    turns = build.vector("MULTIPLY_ADD", mirrored, build.math("MULTIPLY_ADD", inner, -3.0, 1.0), build.math("ADD", inner, 1.0))
    share = build.vector("MAXIMUM", build.vector("DIVIDE", one_minus(build, inner), turns), blocked)
    through = build.vector("MULTIPLY", leaves, share)
    return path, build.vector("SUBTRACT", build.vector("ADD", leaves, r), through), through


def _block(build: Tree, ior: Index, shape: Box, fields: Fields, sigma: Socket, r: Socket, position: Socket, back: Socket) -> Body:
    """Vectors hold the three axes: with b against the ray, the ways to the planes of the faces ahead are half / |b| + p / b.

    The leg after the path begins on a face: along its axis it is the way across, and along the others what was left.
    """
    back = build.vector("ADD", back, (NO_AXIS,) * 3)
    steep = build.vector("ABSOLUTE", back)
    across = build.vector("DIVIDE", tuple(2.0 * half for half in shape.half), steep)
    ahead = build.vector("MULTIPLY_ADD", across, (0.5,) * 3, build.vector("DIVIDE", position, back))
    path = build.least(ahead)
    left = build.vector("SUBTRACT", ahead, path)
    # 1 along the axis of the face that is reached, and 0 along the others.
    sharpness = EDGE / max(shape.half)
    face = build.vector("MAXIMUM", build.vector("MULTIPLY_ADD", left, (-sharpness,) * 3, ONE), (0.0,) * 3)
    more = build.least(build.vector("MULTIPLY_ADD", face, across, left))
    inner = build.math("MULTIPLY", build.scalar("DOT_PRODUCT", steep, face), ior.n)
    leaving = reflectance(build, outside(build, inner, ior), inner, ior)
    t, further = transmitted(build, sigma, path), transmitted(build, sigma, more)
    kept = build.vector("MULTIPLY_ADD", build.vector("SUBTRACT", further, ONE), leaving, ONE)  # 1 - r' + r' t'
    return path, r, build.vector("MULTIPLY", build.scale(t, one_minus(build, r)), kept)


_BODIES = {Ellipsoid: _round, Box: _block}
