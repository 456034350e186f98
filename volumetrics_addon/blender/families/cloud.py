# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of clouds: noise or voxels, one lobe, two lobes or droplets, in full or by octaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import bpy

from ...scene import noise
from ...scene.model import Box, Ellipsoid, Shape
from .. import grid
from ..fields import Fields
from ..nodes import Tree, socket_of
from ..shaders import Outputs, Sockets, absorb_and_scatter, glow, one_lobe, scatter, two_lobes

# Mean cosine of the droplets' phase function as a polynomial in ln(diameter / um), within 2e-4 from 5 to 50 um.
MIE_MEAN_COSINE = (-0.00565461, 0.05183491, 0.77477403)


def outputs(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    extinction = inputs["extinction"]
    if fields.voxels:
        extinction = build.math("MULTIPLY", extinction, grid.voxels(build, shape, fields.cut))
    elif values["density"] == "noise":
        extinction = build.math("MULTIPLY", extinction, noise_density(build, inputs, values, shape))
    outputs = _by_phase(build, inputs, values, extinction, inputs["albedo"], None)
    if values["scattering"] == "octaves":
        factors = _octaves(build, inputs)
        dimmed, kept = build.math("MULTIPLY", extinction, factors["extinction"]), build.scale(inputs["albedo"], factors["albedo"])
        outputs |= {"Cycles Volume": _by_phase(build, inputs, values, dimmed, kept, factors)["Cycles Volume"]}
    if fields.glow:
        outputs["EEVEE Volume"] = glow(build, inputs["albedo"], extinction, fields.glow)
    return outputs


def _by_phase(build: Tree, inputs: Sockets, values: Mapping[str, Any], extinction: Any, albedo: Any,
              octave: Sockets | None) -> Outputs:
    """Shaders of the family's phase function, its mean cosines dimmed by the octave's where there is one."""
    def cosine(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        return build.math("MULTIPLY", socket, octave["phase"]) if octave else socket

    if values["phase"] == "mie":
        return _droplets(build, albedo, extinction, inputs["droplet_diameter"], octave)
    if values["phase"] == "hg":
        return one_lobe(build, albedo, extinction, cosine(inputs["g"]))
    return two_lobes(build, albedo, extinction, cosine(inputs["g"]), cosine(inputs["g_back"]), inputs["lobe_weight"])


def _octaves(build: Tree, inputs: Sockets) -> Sockets:
    """Factors of extinction, albedo and mean cosine along the ray that the path is on, see scene.model.Octaves.

    Cycles' ray depth counts a shadow ray as one event deeper than its path: both rays that leave an event have its number.
    """
    depth = socket_of(build.node("ShaderNodeLightPath").outputs, "Ray Depth")
    octave = build.math("MAXIMUM", build.math("SUBTRACT", depth, 1.0), 0.0)
    kept = build.math("DIVIDE", inputs["octave_contribution"], inputs["octave_extinction"])
    return {"octave": octave, "extinction": build.math("POWER", inputs["octave_extinction"], octave),
            "albedo": build.math("POWER", kept, octave), "phase": build.math("POWER", inputs["octave_phase"], octave)}


def _droplets(build: Tree, albedo: Any, extinction: Any, diameter: Any, octave: Sockets | None) -> Outputs:
    """Cycles has the fit to water droplets, EEVEE one lobe with its mean cosine; so have the octaves after the first."""
    log = build.math("LOGARITHM", diameter, math.e)
    square, slope, constant = MIE_MEAN_COSINE
    mean = build.math("MULTIPLY_ADD", build.math("MULTIPLY_ADD", log, square, slope), log, constant)

    def fit() -> bpy.types.NodeSocket:
        node = build.node("ShaderNodeVolumeScatter", {"Color": albedo, "Density": extinction}, phase="MIE")
        build.feed(socket_of(node.inputs, "Diameter"), diameter)
        if not octave:
            return node.outputs[0]
        lobe = scatter(build, albedo, extinction, build.math("MULTIPLY", mean, octave["phase"]))
        deeper = build.math("GREATER_THAN", octave["octave"], 0.5)
        return build.node("ShaderNodeMixShader", {0: deeper, 1: node.outputs[0], 2: lobe}).outputs[0]

    return {
        "Cycles Volume": absorb_and_scatter(build, albedo, extinction, fit),
        "EEVEE Volume": absorb_and_scatter(build, albedo, extinction, lambda: scatter(build, albedo, extinction, mean)),
    }


def noise_density(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Box | Ellipsoid) -> bpy.types.NodeSocket:
    """scene.model.NoiseShape as nodes; object coordinates are metres from the domain's centre."""
    position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    moved = build.vector("SUBTRACT", position, build.scale(inputs["wind"], inputs["time"]))
    moved = build.vector("DIVIDE", moved, build.combine(inputs["stretch"], 1.0, 1.0))
    offset = build.vector("MODULO", build.scale(noise.SEED_STEP, inputs["seed"]), (noise.SEED_PERIOD,) * 3)

    def coordinates(size: bpy.types.NodeSocket, rise: float) -> bpy.types.NodeSocket:
        lifted = build.vector("MULTIPLY_ADD", (0.0, 0.0, -rise), inputs["evolution"], offset)
        return build.vector("ADD", build.vector("DIVIDE", moved, size), lifted)

    perlin = build.node("ShaderNodeTexNoise", {
        "Vector": coordinates(inputs["noise_size"], noise.EVOLUTION_RISE), "Scale": 1.0, "Detail": inputs["noise_detail"],
        "Roughness": inputs["noise_roughness"], "Lacunarity": 2.0, "Distortion": 0.0,
    }, noise_dimensions="3D", noise_type="FBM", normalize=True)
    centred = build.math("MULTIPLY_ADD", perlin.outputs[0], 2.0, -1.0)
    margin = build.math("MULTIPLY_ADD", inputs["noise_strength"], centred, inputs["fill"])
    if values["billow_octaves"] > 0:
        bulge = _billows(build, coordinates(inputs["billow_size"], noise.BILLOW_RISE), values["billow_octaves"],
                         inputs["billow_roughness"])
        margin = build.math("MULTIPLY_ADD", inputs["billow_strength"], bulge, margin)
    # x and y from -1 to 1 across the domain, z from 0 to 1 up it.
    x, y, z = shape.half
    place = build.vector("MULTIPLY_ADD", position, (1.0 / x, 1.0 / y, 0.5 / z), (0.0, 0.0, 0.5))
    margin = build.math("SUBTRACT", build.math("MINIMUM", margin, 1.0), _outline(build, values["profile"], place))
    density = build.math("DIVIDE", margin, inputs["softness"], clamp=True)
    if values["base"] > 0.0:
        up = build.components(place)[2]
        floor = build.node("ShaderNodeMapRange", {"Value": up, "From Min": 0.0, "From Max": values["base"]},
                           interpolation_type="SMOOTHSTEP")
        density = build.math("MULTIPLY", density, floor.outputs[0])
    return density


def _outline(build: Tree, profile: str, place: Any) -> bpy.types.NodeSocket:
    """NoiseShape's distance from the middle of the body, at x and y from -1 to 1 and a height z from 0 to 1."""
    if profile == "dome":
        return build.scalar("LENGTH", place)
    if profile == "round":
        return build.scalar("LENGTH", build.vector("MULTIPLY_ADD", place, (1.0, 1.0, 2.0), (0.0, 0.0, -1.0)))
    x, y, up = build.components(place)
    across2 = build.math("MULTIPLY_ADD", x, x, build.math("MULTIPLY", y, y))

    def root_of_sum(height: Any, rest: Any) -> bpy.types.NodeSocket:
        return build.math("SQRT", build.math("MULTIPLY_ADD", height, height, rest))

    if profile == "layer":
        return root_of_sum(build.math("MULTIPLY_ADD", up, 2.0, -1.0), build.math("POWER", across2, 4.0))
    narrow = across2 if profile == "tower" else build.math("MULTIPLY", across2, noise.COLUMN_WIDTH**-2)
    column = build.math("SQRT", root_of_sum(narrow, build.math("POWER", up, 4.0)))
    if profile == "tower":
        return column
    level = build.math("MULTIPLY_ADD", up, 1.0 / noise.ANVIL_THICKNESS, -noise.ANVIL_HEIGHT / noise.ANVIL_THICKNESS)
    return build.math("MINIMUM", column, root_of_sum(level, across2))


def _billows(build: Tree, coordinates: Any, octaves: int, roughness: Any) -> bpy.types.NodeSocket:
    """NoiseShape's b: one texture an octave, since the texture's own octaves add distances, whose cones have tips.

    The sums of squares and of weights, powers of the roughness, are made from the last octave to the first.
    """
    total: Any = 0.0
    weights: Any = 0.0
    for octave in reversed(range(octaves)):
        cells = build.node("ShaderNodeTexVoronoi", {"Vector": coordinates, "Scale": 2.0**octave, "Detail": 0.0,
                                                    "Randomness": 1.0},
                           voronoi_dimensions="3D", feature="F1", distance="EUCLIDEAN", normalize=False)
        distance = socket_of(cells.outputs, "Distance")
        if octave == octaves - 1:
            total, weights = build.math("MULTIPLY", distance, distance), 1.0
        else:
            total = build.math("MULTIPLY_ADD", distance, distance, build.math("MULTIPLY", total, roughness))
            weights = build.math("MULTIPLY_ADD", weights, roughness, 1.0)
    mean = build.math("DIVIDE", total, weights) if octaves > 1 else total
    return build.math("SUBTRACT", noise.BILLOW_MEAN, mean)
