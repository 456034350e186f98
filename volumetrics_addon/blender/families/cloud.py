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
    local = build.components(build.vector("DIVIDE", position, shape.half))
    moved = build.vector("SUBTRACT", position, build.scale(inputs["wind"], inputs["time"]))
    moved = build.vector("DIVIDE", moved, build.combine(inputs["stretch"], 1.0, 1.0))
    offset = build.vector("MODULO", build.scale(noise.SEED_STEP, inputs["seed"]), (noise.SEED_PERIOD,) * 3)

    def coordinates(size: bpy.types.NodeSocket, rise: float) -> bpy.types.NodeSocket:
        lifted = build.combine(0.0, 0.0, build.math("MULTIPLY", inputs["evolution"], -rise))
        scaled = build.scale(moved, build.math("DIVIDE", 1.0, size))
        return build.vector("ADD", build.vector("ADD", scaled, offset), lifted)

    perlin = build.node("ShaderNodeTexNoise", {
        "Vector": coordinates(inputs["noise_size"], noise.EVOLUTION_RISE), "Scale": 1.0, "Detail": inputs["noise_detail"],
        "Roughness": inputs["noise_roughness"], "Lacunarity": 2.0, "Distortion": 0.0,
    }, noise_dimensions="3D", noise_type="FBM", normalize=True)
    centred = build.math("MULTIPLY_ADD", perlin.outputs[0], 2.0, -1.0)
    distance = _outline(build, values["profile"], *local)
    body = build.math("SUBTRACT", inputs["fill"], distance)
    margin = build.math("MULTIPLY_ADD", inputs["noise_strength"], centred, body)
    if values["billow_octaves"] > 0:
        bulge = _billows(build, coordinates(inputs["billow_size"], noise.BILLOW_RISE), values["billow_octaves"],
                         inputs["billow_roughness"])
        margin = build.math("MULTIPLY_ADD", inputs["billow_strength"], bulge, margin)
    margin = build.math("MINIMUM", margin, build.math("SUBTRACT", 1.0, distance))
    density = build.math("DIVIDE", margin, inputs["softness"], clamp=True)
    if values["base"] > 0.0:
        up = build.math("MULTIPLY_ADD", local[2], 0.5, 0.5)
        floor = build.node("ShaderNodeMapRange", {"Value": up, "From Min": 0.0, "From Max": values["base"]},
                           interpolation_type="SMOOTHSTEP")
        density = build.math("MULTIPLY", density, floor.outputs[0])
    return density


def _outline(build: Tree, profile: str, x: Any, y: Any, z: Any) -> bpy.types.NodeSocket:
    """NoiseShape's distance from the middle of the body."""
    def power(value: Any, exponent: float) -> bpy.types.NodeSocket:
        return build.math("POWER", value, exponent)

    def root_of_sum(*terms: Any, exponent: float = 0.5) -> bpy.types.NodeSocket:
        return power(build.math("ADD", *terms), exponent)

    across = build.math("MULTIPLY_ADD", x, x, build.math("MULTIPLY", y, y))
    if profile in ("round", "layer"):
        flat = across if profile == "round" else power(across, 4.0)
        return root_of_sum(flat, build.math("MULTIPLY", z, z))
    up = build.math("MULTIPLY_ADD", z, 0.5, 0.5)
    if profile == "dome":
        return root_of_sum(across, build.math("MULTIPLY", up, up))
    narrow = across if profile == "tower" else build.math("DIVIDE", across, noise.COLUMN_WIDTH**2)
    column = root_of_sum(build.math("MULTIPLY", narrow, narrow), power(up, 4.0), exponent=0.25)
    if profile == "tower":
        return column
    level = build.math("DIVIDE", build.math("SUBTRACT", up, noise.ANVIL_HEIGHT), noise.ANVIL_THICKNESS)
    return build.math("MINIMUM", column, root_of_sum(across, build.math("MULTIPLY", level, level)))


def _billows(build: Tree, coordinates: Any, octaves: int, roughness: Any) -> bpy.types.NodeSocket:
    """NoiseShape's b: one texture an octave, since the texture's own octaves add distances, whose cones have tips."""
    total: Any = None
    weight: Any = 1.0
    weights: Any = 0.0
    for octave in range(octaves):
        cells = build.node("ShaderNodeTexVoronoi", {"Vector": coordinates, "Scale": 2.0**octave, "Detail": 0.0,
                                                    "Randomness": 1.0},
                           voronoi_dimensions="3D", feature="F1", distance="EUCLIDEAN", normalize=False)
        distance = socket_of(cells.outputs, "Distance")
        squared = build.math("MULTIPLY", distance, distance)
        if octave == 0:
            total, weights = squared, 1.0
        else:
            weight = build.math("MULTIPLY", weight, roughness) if octave > 1 else roughness
            total = build.math("MULTIPLY_ADD", weight, squared, total)
            weights = build.math("ADD", weights, weight)
    mean = build.math("DIVIDE", total, weights) if octaves > 1 else total
    return build.math("SUBTRACT", noise.BILLOW_MEAN, mean)
