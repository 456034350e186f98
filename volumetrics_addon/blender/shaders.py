# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of which the families make their shaders."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import bpy

from . import light
from .nodes import Tree

Sockets = Mapping[str, bpy.types.NodeSocket]
Outputs = dict[str, bpy.types.NodeSocket]

ENGINES = {"Cycles": "CYCLES", "EEVEE": "EEVEE"}  # output prefix -> target of the material output


def absorb_and_scatter(build: Tree, albedo: Any, extinction: Any, scattered: Callable[[], bpy.types.NodeSocket]) -> Any:
    """sigma_s = albedo extinction from the scatter node, sigma_a = (1 - albedo) extinction from the absorption node."""
    absorption = build.node("ShaderNodeVolumeAbsorption", {"Color": albedo, "Density": extinction})
    return build.shader_sum(scattered(), absorption.outputs[0])


def scatter(build: Tree, albedo: Any, extinction: Any, g: Any) -> bpy.types.NodeSocket:
    node = build.node("ShaderNodeVolumeScatter", {"Color": albedo, "Density": extinction, "Anisotropy": g},
                      phase="HENYEY_GREENSTEIN")
    return node.outputs[0]


def one_lobe(build: Tree, albedo: Any, extinction: Any, g: Any) -> Outputs:
    shader = absorb_and_scatter(build, albedo, extinction, lambda: scatter(build, albedo, extinction, g))
    return {f"{engine} Volume": shader for engine in ENGINES}


def two_lobes(build: Tree, albedo: Any, extinction: Any, g0: Any, g1: Any, weight: Any) -> Outputs:
    def both() -> bpy.types.NodeSocket:
        lobes = {1: scatter(build, albedo, extinction, g0), 2: scatter(build, albedo, extinction, g1)}
        return build.node("ShaderNodeMixShader", {0: weight, **lobes}).outputs[0]

    mean = build.math("MULTIPLY_ADD", weight, build.math("SUBTRACT", g1, g0), g0)
    return {
        "Cycles Volume": absorb_and_scatter(build, albedo, extinction, both),
        "EEVEE Volume": absorb_and_scatter(build, albedo, extinction, lambda: scatter(build, albedo, extinction, mean)),
    }


def glow(build: Tree, albedo: Any, extinction: Any, picture: light.Picture) -> bpy.types.NodeSocket:
    """The source sigma_s J as emission, dimmed by all of the extinction: nothing is left for the engine to scatter."""
    color = build.vector("MULTIPLY", albedo, light.radiance(build, picture))
    emission = build.node("ShaderNodeEmission", {"Color": color, "Strength": extinction})
    absorption = build.node("ShaderNodeVolumeAbsorption", {"Color": (0.0, 0.0, 0.0, 1.0), "Density": extinction})
    return build.shader_sum(absorption.outputs[0], emission.outputs[0])
