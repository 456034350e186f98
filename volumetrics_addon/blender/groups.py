# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups: one builder per family, the source of truth for both engines.

Every group has the family's live parameters as inputs. Its outputs are one shader per engine: ``Cycles Volume`` and
``EEVEE Volume``, and where the family has a surface ``Cycles Surface``, ``EEVEE Surface`` and ``EEVEE Thickness``. EEVEE knows one
Henyey-Greenstein lobe per froxel and adds the g of added scatter nodes, so it gets a single lobe with the mean cosine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ..parameters.families import FAMILIES
from ..scene.model import Box, Ellipsoid, Grid, Shape, Volume
from ..scene.noise import SEED_PERIOD, SEED_STEP
from . import grid, light
from .compat import use_nodes
from .nodes import Tree, add_input, arrange, prune, socket_of, socket_value

Sockets = Mapping[str, bpy.types.NodeSocket]
Outputs = dict[str, bpy.types.NodeSocket]

ENGINES = {"Cycles": "CYCLES", "EEVEE": "EEVEE"}  # output prefix -> target of the material output


@dataclass(frozen=True)
class Fields:
    """What the material of a volume reads from arrays: its density from ``voxels``, which the nodes ``cut`` at the domain, and
    in EEVEE the ``glow`` of its scattered light."""

    voxels: bool = False
    cut: bool = False
    glow: light.Picture | None = None


def fields_of(volume: Volume, glow: light.Picture | None = None) -> Fields:
    if not isinstance(volume.medium.density, Grid):
        return Fields(glow=glow)
    return Fields(True, grid.needs_cut(volume), glow)


def group(family: str, values: Mapping[str, Any], shape: Shape, name: str, fields: Fields = Fields()) -> bpy.types.NodeTree:
    """The node group of a family for these build-time values; live values are set on the node that uses it."""
    declared = FAMILIES[family]
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for parameter in declared.live:
        add_input(tree, parameter)
    build = Tree(tree)
    entry = build.node("NodeGroupInput")
    inputs = {parameter.name: entry.outputs[index] for index, parameter in enumerate(declared.live)}
    outputs = BUILDERS[family](build, inputs, values, shape, fields)
    for label, socket in outputs.items():
        kind = "NodeSocketShader" if socket.type == "SHADER" else "NodeSocketFloat"
        tree.interface.new_socket(label, in_out="OUTPUT", socket_type=kind)
    leave = build.node("NodeGroupOutput")
    for index, shader in enumerate(outputs.values()):
        build.feed(leave.inputs[index], shader)
    if fields.glow:  # what EEVEE would have scattered
        prune(tree)
    arrange(tree)
    return tree


def material(family: str, values: Mapping[str, Any], shape: Shape, name: str,
             fields: Fields = Fields()) -> bpy.types.Material:
    """A material with the family's group and one Material Output per engine."""
    result = bpy.data.materials.new(name)
    build = Tree(use_nodes(result))
    node = build.node("ShaderNodeGroup", node_tree=group(family, values, shape, name, fields))
    node.width = 240
    for index, parameter in enumerate(FAMILIES[family].live):
        node.inputs[index].default_value = socket_value(parameter, values[parameter.name])
    for prefix, target in ENGINES.items():
        output = build.node("ShaderNodeOutputMaterial", target=target)
        for socket in node.outputs:
            if socket.name.startswith(prefix):
                build.feed(socket_of(output.inputs, socket.name.removeprefix(prefix + " ")), socket)
    if any(socket.name == "EEVEE Surface" for socket in node.outputs):
        result.surface_render_method = "DITHERED"
        result.use_raytrace_refraction = True
        result.thickness_mode = "SPHERE" if isinstance(shape, Ellipsoid) else "SLAB"
    arrange(build.tree)
    return result


# --- parts --------------------------------------------------------------------------------------------------


def _absorb_and_scatter(build: Tree, albedo: Any, extinction: Any, scatter: Callable[[], bpy.types.NodeSocket]) -> Any:
    """sigma_s = albedo extinction from the scatter node, sigma_a = (1 - albedo) extinction from the absorption node."""
    absorption = build.node("ShaderNodeVolumeAbsorption", {"Color": albedo, "Density": extinction})
    return build.shader_sum(scatter(), absorption.outputs[0])


def _scatter(build: Tree, albedo: Any, extinction: Any, g: Any) -> bpy.types.NodeSocket:
    node = build.node("ShaderNodeVolumeScatter", {"Color": albedo, "Density": extinction, "Anisotropy": g},
                      phase="HENYEY_GREENSTEIN")
    return node.outputs[0]


def _one_lobe(build: Tree, albedo: Any, extinction: Any, g: Any) -> Outputs:
    shader = _absorb_and_scatter(build, albedo, extinction, lambda: _scatter(build, albedo, extinction, g))
    return {f"{engine} Volume": shader for engine in ENGINES}


def _two_lobes(build: Tree, albedo: Any, extinction: Any, g0: Any, g1: Any, weight: Any) -> Outputs:
    def both() -> bpy.types.NodeSocket:
        lobes = {1: _scatter(build, albedo, extinction, g0), 2: _scatter(build, albedo, extinction, g1)}
        return build.node("ShaderNodeMixShader", {0: weight, **lobes}).outputs[0]

    mean = build.math("MULTIPLY_ADD", weight, build.math("SUBTRACT", g1, g0), g0)
    return {
        "Cycles Volume": _absorb_and_scatter(build, albedo, extinction, both),
        "EEVEE Volume": _absorb_and_scatter(build, albedo, extinction, lambda: _scatter(build, albedo, extinction, mean)),
    }


def _glow(build: Tree, albedo: Any, extinction: Any, glow: light.Picture) -> bpy.types.NodeSocket:
    """The source sigma_s J as emission, dimmed by all of the extinction: nothing is left for the engine to scatter."""
    color = build.vector("MULTIPLY", albedo, light.radiance(build, glow))
    emission = build.node("ShaderNodeEmission", {"Color": color, "Strength": extinction})
    absorption = build.node("ShaderNodeVolumeAbsorption", {"Color": (0.0, 0.0, 0.0, 1.0), "Density": extinction})
    return build.shader_sum(absorption.outputs[0], emission.outputs[0])


def _noise_density(build: Tree, inputs: Sockets, shape: Box | Ellipsoid) -> bpy.types.NodeSocket:
    """scene.model.NoiseShape as nodes; object coordinates are metres from the domain's centre."""
    position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    radius = build.scalar("LENGTH", build.vector("DIVIDE", position, shape.half))
    offset = build.vector("MODULO", build.scale(SEED_STEP, inputs["seed"]), (SEED_PERIOD,) * 3)
    scaled = build.scale(position, build.math("DIVIDE", 1.0, inputs["noise_size"]))
    noise = build.node("ShaderNodeTexNoise", {
        "Vector": build.vector("ADD", scaled, offset), "Scale": 1.0, "Detail": inputs["noise_detail"],
        "Roughness": inputs["noise_roughness"], "Lacunarity": 2.0, "Distortion": 0.0,
    }, noise_dimensions="3D", noise_type="FBM", normalize=True)
    centred = build.math("MULTIPLY_ADD", noise.outputs[0], 2.0, -1.0)
    carved = build.math("MULTIPLY_ADD", inputs["noise_strength"], centred, build.math("SUBTRACT", inputs["fill"], radius))
    return build.math("DIVIDE", carved, inputs["softness"], clamp=True)


# --- families -----------------------------------------------------------------------------------------------


def _cloud(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    extinction = inputs["extinction"]
    if fields.voxels:
        extinction = build.math("MULTIPLY", extinction, grid.voxels(build, shape, fields.cut))
    elif values["density"] == "noise":
        extinction = build.math("MULTIPLY", extinction, _noise_density(build, inputs, shape))
    if values["phase"] == "hg":
        outputs = _one_lobe(build, inputs["albedo"], extinction, inputs["g"])
    else:
        outputs = _two_lobes(build, inputs["albedo"], extinction, inputs["g"], inputs["g_back"], inputs["lobe_weight"])
    if fields.glow:
        outputs["EEVEE Volume"] = _glow(build, inputs["albedo"], extinction, fields.glow)
    return outputs


def _fog(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    depth = build.math("DIVIDE", build.math("SUBTRACT", inputs["base_height"], build.components(position)[2]),
                       inputs["scale_height"])
    extinction = build.math("MULTIPLY", inputs["extinction"], build.math("EXPONENT", depth))
    return _one_lobe(build, inputs["albedo"], extinction, inputs["g"])


def _godray(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    return _one_lobe(build, inputs["albedo"], inputs["extinction"], inputs["g"])


def _glass(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
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


BUILDERS: dict[str, Callable[..., Outputs]] = {"cloud": _cloud, "glass": _glass, "fog": _fog, "godray": _godray}
