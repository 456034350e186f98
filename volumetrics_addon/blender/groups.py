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

from ..parameters.model import Group
from ..scene import noise
from ..scene.assemble import PER_KILOMETRE
from ..scene.model import Box, Ellipsoid, Grid, Shape, Volume
from . import grid, light
from .compat import use_nodes
from .nodes import Tree, add_input, arrange, prune, socket_of, socket_value

Sockets = Mapping[str, bpy.types.NodeSocket]
Outputs = dict[str, bpy.types.NodeSocket]

# Mean cosine of the droplets' phase function as a polynomial in ln(diameter / um), within 2e-4 from 5 to 50 um.
MIE_MEAN_COSINE = (-0.00565461, 0.05183491, 0.77477403)

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


def group(family: Group, values: Mapping[str, Any], shape: Shape, name: str, fields: Fields = Fields()) -> bpy.types.NodeTree:
    """The node group of a family for these build-time values; live values are set on the node that uses it."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for parameter in family.live:
        add_input(tree, parameter)
    build = Tree(tree)
    entry = build.node("NodeGroupInput")
    inputs = {parameter.name: entry.outputs[index] for index, parameter in enumerate(family.live)}
    outputs = BUILDERS[family.name](build, inputs, values, shape, fields)
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


def material(family: Group, values: Mapping[str, Any], shape: Shape, name: str,
             fields: Fields = Fields()) -> bpy.types.Material:
    """A material with the family's group and one Material Output per engine."""
    result = bpy.data.materials.new(name)
    build = Tree(use_nodes(result))
    node = build.node("ShaderNodeGroup", node_tree=group(family, values, shape, name, fields))
    node.width = 240
    for index, parameter in enumerate(family.live):
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
        lobe = _scatter(build, albedo, extinction, build.math("MULTIPLY", mean, octave["phase"]))
        deeper = build.math("GREATER_THAN", octave["octave"], 0.5)
        return build.node("ShaderNodeMixShader", {0: deeper, 1: node.outputs[0], 2: lobe}).outputs[0]

    return {
        "Cycles Volume": _absorb_and_scatter(build, albedo, extinction, fit),
        "EEVEE Volume": _absorb_and_scatter(build, albedo, extinction, lambda: _scatter(build, albedo, extinction, mean)),
    }


def _noise_density(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Box | Ellipsoid) -> bpy.types.NodeSocket:
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


# --- families -----------------------------------------------------------------------------------------------


def _cloud(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    extinction = inputs["extinction"]
    if fields.voxels:
        extinction = build.math("MULTIPLY", extinction, grid.voxels(build, shape, fields.cut))
    elif values["density"] == "noise":
        extinction = build.math("MULTIPLY", extinction, _noise_density(build, inputs, values, shape))
    outputs = _by_phase(build, inputs, values, extinction, inputs["albedo"], None)
    if values["scattering"] == "octaves":
        factors = _octaves(build, inputs)
        dimmed, kept = build.math("MULTIPLY", extinction, factors["extinction"]), build.scale(inputs["albedo"], factors["albedo"])
        outputs |= {"Cycles Volume": _by_phase(build, inputs, values, dimmed, kept, factors)["Cycles Volume"]}
    if fields.glow:
        outputs["EEVEE Volume"] = _glow(build, inputs["albedo"], extinction, fields.glow)
    return outputs


def _by_phase(build: Tree, inputs: Sockets, values: Mapping[str, Any], extinction: Any, albedo: Any,
              octave: Sockets | None) -> Outputs:
    """Shaders of the family's phase function, its mean cosines dimmed by the octave's where there is one."""
    def cosine(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        return build.math("MULTIPLY", socket, octave["phase"]) if octave else socket

    if values["phase"] == "mie":
        return _droplets(build, albedo, extinction, inputs["droplet_diameter"], octave)
    if values["phase"] == "hg":
        return _one_lobe(build, albedo, extinction, cosine(inputs["g"]))
    return _two_lobes(build, albedo, extinction, cosine(inputs["g"]), cosine(inputs["g_back"]), inputs["lobe_weight"])


def _octaves(build: Tree, inputs: Sockets) -> Sockets:
    """Factors of extinction, albedo and mean cosine along the ray that the path is on, see scene.model.Octaves.

    Cycles' ray depth counts a shadow ray as one event deeper than its path: both rays that leave an event have its number.
    """
    depth = socket_of(build.node("ShaderNodeLightPath").outputs, "Ray Depth")
    octave = build.math("MAXIMUM", build.math("SUBTRACT", depth, 1.0), 0.0)
    kept = build.math("DIVIDE", inputs["octave_contribution"], inputs["octave_extinction"])
    return {"octave": octave, "extinction": build.math("POWER", inputs["octave_extinction"], octave),
            "albedo": build.math("POWER", kept, octave), "phase": build.math("POWER", inputs["octave_phase"], octave)}


def _fog(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    depth = build.math("DIVIDE", build.math("SUBTRACT", inputs["base_height"], build.components(position)[2]),
                       inputs["scale_height"])
    extinction = build.math("MULTIPLY", inputs["extinction"], build.math("EXPONENT", depth))
    return _one_lobe(build, inputs["albedo"], extinction, inputs["g"])


def _air(build: Tree, inputs: Sockets, values: Mapping[str, Any], shape: Shape, fields: Fields) -> Outputs:
    """Molecules and aerosol for Cycles; for EEVEE one lobe with the mean cosine of both at each altitude."""
    altitude = _altitude(build, values["planet_radius"], values["base_height"])

    def coefficient(at_ground: str, scale_height: str) -> bpy.types.NodeSocket:
        depth = build.math("MULTIPLY", build.math("DIVIDE", altitude, inputs[scale_height]), -1.0)
        ground = build.math("MULTIPLY", inputs[at_ground], PER_KILOMETRE)
        return build.math("MULTIPLY", ground, build.math("EXPONENT", depth))

    rayleigh = coefficient("rayleigh_scattering", "rayleigh_scale_height")
    mie = coefficient("mie_extinction", "mie_scale_height")
    molecules = build.node("ShaderNodeVolumeScatter", {"Color": inputs["rayleigh_color"], "Density": rayleigh}, phase="RAYLEIGH")
    aerosol = _scatter(build, inputs["mie_albedo"], mie, inputs["mie_g"])
    absorption = build.node("ShaderNodeVolumeAbsorption", {"Color": inputs["mie_albedo"], "Density": mie}).outputs[0]

    # A colour of at most 1 times a density: the share of each in the sum of both.
    parts = [build.scale(inputs["rayleigh_color"], rayleigh), build.scale(inputs["mie_albedo"], mie)]
    total = build.math("ADD", rayleigh, mie)
    color = build.scale(build.vector("ADD", *parts), build.math("DIVIDE", 1.0, total))
    amounts = [build.scalar("DOT_PRODUCT", part, (1.0 / 3.0,) * 3) for part in parts]
    g = build.math("MULTIPLY", inputs["mie_g"], build.math("DIVIDE", amounts[1], build.math("ADD", *amounts)))
    return {"Cycles Volume": build.shader_sum(molecules.outputs[0], aerosol, absorption),
            "EEVEE Volume": build.shader_sum(_scatter(build, color, total, g), absorption)}


def _altitude(build: Tree, radius: float, base: float) -> bpy.types.NodeSocket:
    """Altitude above the planet's ground, 0 below it.

    h = |p - center| - R cancels in float32, to half a metre on the Earth. With p counted from the ground at the origin,
    h = (p.p + 2 R z) / (sqrt(x^2 + y^2 + (R + z)^2) + R), which keeps the digits of p.
    """
    position = socket_of(build.node("ShaderNodeNewGeometry").outputs, "Position")
    offset = build.vector("SUBTRACT", position, (0.0, 0.0, base))
    z = build.components(offset)[2]
    above = build.math("MULTIPLY_ADD", z, 2.0 * radius, build.scalar("DOT_PRODUCT", offset, offset))
    distance = build.scalar("LENGTH", build.vector("ADD", offset, (0.0, 0.0, radius)))
    return build.math("MAXIMUM", build.math("DIVIDE", above, build.math("ADD", distance, radius)), 0.0)


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


BUILDERS: dict[str, Callable[..., Outputs]] = {"cloud": _cloud, "glass": _glass, "fog": _fog, "godray": _godray,
                                           "air": _air}
