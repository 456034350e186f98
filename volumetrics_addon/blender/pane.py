# SPDX-License-Identifier: GPL-3.0-or-later
"""A thin pane in the engines: one surface that lets light through, mirrors it and may be covered.

Both engines have the same nodes. What comes through goes on in its direction, tinted by a Transparent BSDF, so that Cycles'
lamps shine through; the closed form of the plate (see reference.dielectric.plate) gives the shares. EEVEE blends the surface over
what is behind it: its dithered transparency is grey. It has no screen-space reflection there, only the world's light, and its
shadows are grey.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy

from ..scene import pane
from ..scene.model import Volume
from . import images
from .interface import ONE, absorption, incidence, index, inside, mirror, one_minus, reflectance, square, transmitted
from .nodes import Tree, socket_of
from .shaders import ENGINES, Outputs, Sockets

Socket = bpy.types.NodeSocket


def picture(volume: Volume, name: str) -> bpy.types.Image | None:
    """Where what covers the pane lies, as an image packed into the file; None where it lies everywhere alike."""
    cover = volume.sheet.cover
    if cover is None or cover.pattern == "uniform":
        return None
    return images.packed(pane.picture(cover, *pane.size_of(volume)), name)


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], axes: tuple[int, int],
            image: bpy.types.Image | None) -> Outputs:
    """The surface of a pane that extends along two axes of its object."""
    pattern = values["coverage_pattern"]
    sigma, place = absorption(build, inputs), None
    if image is not None:
        place = _place(build, axes)
        if pattern == "lead":
            sigma = _turned(build, sigma, inputs["color_variation"], _looked_up(build, image, place, "Closest")[1])
    _, cosine = incidence(build)
    shader = _glass(build, inputs, values, sigma, cosine)
    if pattern != "none":
        share = inputs["coverage"]
        if image is not None:
            softness = inputs["coverage_softness"] if pattern == "dirt" else None
            share = _share(build, share, softness, _looked_up(build, image, place, "Linear")[0])
        cover = build.node("ShaderNodeBsdfDiffuse", {"Color": inputs["coverage_color"], "Roughness": 0.0})
        shader = build.node("ShaderNodeMixShader", {0: share, 1: shader, 2: cover.outputs[0]}).outputs[0]
    return {f"{engine} Surface": shader for engine in ENGINES}


def _glass(build: Tree, inputs: Sockets, values: Mapping[str, Any], sigma: Socket, cosine: Socket) -> Socket:
    """T = (1 - r)^2 t / (1 - r^2 t^2), R = r (1 + t T); without refraction T = t, R = 0."""
    if not values["refraction"]:
        path = build.math("DIVIDE", values["thickness"], build.math("MAXIMUM", cosine, 1e-6))
        return build.node("ShaderNodeBsdfTransparent", {"Color": transmitted(build, sigma, path)}).outputs[0]
    ior = index(build, inputs["ior"])
    inner = inside(build, cosine, ior)
    t = transmitted(build, sigma, build.math("DIVIDE", build.math("MULTIPLY", ior.n, values["thickness"]), inner))
    r = reflectance(build, cosine, inner, ior)
    rt = build.scale(t, r)
    through = build.vector("DIVIDE", build.scale(t, square(build, one_minus(build, r))),
                           build.vector("SUBTRACT", ONE, build.vector("MULTIPLY", rt, rt)))
    mirrored = build.scale(build.vector("MULTIPLY_ADD", t, through, ONE), r)
    return build.shader_sum(build.node("ShaderNodeBsdfTransparent", {"Color": through}).outputs[0], mirror(build, mirrored))


def _place(build: Tree, axes: tuple[int, int]) -> Socket:
    """Coordinates in [0, 1] along the two axes of the pane: of its bounding box."""
    parts = build.components(socket_of(build.node("ShaderNodeTexCoord").outputs, "Generated"))
    return build.combine(parts[axes[0]], parts[axes[1]], 0.0)


def _looked_up(build: Tree, image: bpy.types.Image, place: Socket, interpolation: str) -> Any:
    node = build.node("ShaderNodeTexImage", {"Vector": place}, image=image, interpolation=interpolation, extension="EXTEND")
    return build.node("ShaderNodeSeparateColor", {0: socket_of(node.outputs, "Color")}).outputs


def _share(build: Tree, coverage: Socket, softness: Socket | None, rank: Socket) -> Socket:
    """clamp(1/2 + (c - u) / w, 0, 1) with w = 2 softness min(c, 1 - c), without softness the sharpest; see scene.pane."""
    difference = build.math("SUBTRACT", coverage, rank)
    if softness is None:
        return build.math("MULTIPLY_ADD", difference, 1.0 / pane.SHARPEST, 0.5, clamp=True)
    spread = build.math("MULTIPLY", build.math("MINIMUM", coverage, one_minus(build, coverage)),
                        build.math("MULTIPLY", softness, 2.0))
    return build.math("ADD", build.math("DIVIDE", difference, build.math("MAXIMUM", spread, pane.SHARPEST)), 0.5, clamp=True)


def _turned(build: Tree, sigma: Socket, variation: Socket, number: Socket) -> Socket:
    """Absorption turned about the grey axis by 2 pi variation (number - 1/2), what falls below 0 cut off."""
    angle = build.math("MULTIPLY", build.math("MULTIPLY_ADD", number, 2.0 * math.pi, -math.pi), variation)
    node = build.node("ShaderNodeVectorRotate", {"Vector": sigma, "Axis": ONE, "Angle": angle}, rotation_type="AXIS_ANGLE")
    return build.vector("MAXIMUM", node.outputs[0], (0.0,) * 3)
