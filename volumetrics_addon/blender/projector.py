# SPDX-License-Identifier: GPL-3.0-or-later
"""A projector in the engines.

Cycles evaluates nodes of a light: a spot whose cone holds the frustum is multiplied by the frustum's mask and the gobo, looked up
by the direction from the light. EEVEE ignores nodes of lights; there a plane stands close before the light and lets through
what the same mask lets through. EEVEE's shadows know how much passes, not which colour: a coloured gobo becomes three lights
of one channel each, whose masks block that light alone (shadow linking). What EEVEE cannot do: a falloff other than the
square, and a near or far end other than that of the haze.
"""

from __future__ import annotations

import math

import bpy

from ..plan.model import CYCLES, EEVEE
from ..scene.model import Box, Projector, Spot, Vector, add as plus, cross, normalized, scaled
from . import compat, gobo, objects
from .nodes import Tree, arrange, socket_of

MASK_DISTANCE = 0.02  # of the light's reach: beyond EEVEE's nearest shadow caster (see plan.rules.light_threshold)
CONE_MARGIN = math.radians(0.5)  # by which the spot's cone is wider than the corners of the frustum
Gobo = bpy.types.Image | bpy.types.NodeTree | None
AHEAD = (0.0, 0.0, -1.0)  # the way that a light looks
CHANNELS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def axes(light: Projector) -> tuple[Vector, Vector, Vector]:
    """(right, up, back) of the frustum, orthonormal."""
    right = normalized(cross(light.direction, light.up))
    return right, cross(right, light.direction), scaled(light.direction, -1.0)


def slopes(light: Projector) -> tuple[float, float]:
    return math.tan(light.horizontal_fov / 2.0), math.tan(light.vertical_fov / 2.0)


def cone_angle(light: Projector) -> float:
    """Full angle of the narrowest cone around the frustum, with a margin."""
    wide, high = slopes(light)
    return 2.0 * (math.atan(max(wide, high) if light.elliptic else math.hypot(wide, high)) + CONE_MARGIN)


def is_colored(light: Projector) -> bool:
    """Whether the gobo passes its colours unequally."""
    return light.gobo is not None and light.gobo.ndim == 3 and bool((light.gobo != light.gobo[..., :1]).any())


def add(light: Projector, name: str, collection: bpy.types.Collection, engine: str | None = None, reach: float = 0.0,
        live: bpy.types.NodeTree | None = None) -> list[bpy.types.Object]:
    """The lamps of the projector for one engine, or for both where ``engine`` is None. Its mask stands at a share of ``reach`` (m).

    Its gobo is ``live``, a group of blender.gobo, or else the light's picture.
    """
    image = live or (gobo.packed(f"{name} gobo", light.gobo[::-1]) if light.gobo is not None else None)
    apart = engine != CYCLES and is_colored(light)
    powers = [tuple(p * c for p, c in zip(light.power, channel)) for channel in CHANNELS] if apart else [light.power]
    lamps, masks = [], []
    for index, power in enumerate(powers):
        part = f"{name} {'RGB'[index]}" if apart else name
        lamp = objects.light(Spot(light.position, light.direction, power, cone_angle(light), 0.0), part, collection, axes(light))
        if engine != EEVEE and not lamps:
            _light_nodes(lamp.data, light, image)
        elif engine != EEVEE:
            _take_nodes(lamp, lamps[0].data)
        lamps.append(lamp)
        if engine != CYCLES:
            masks.append(_mask(light, image, index, part, collection, reach, masks[0] if masks else None))
    if apart:
        for lamp in lamps:
            others = bpy.data.collections.new(f"{lamp.name} passes")
            for mask, owner in zip(masks, lamps):
                if owner is not lamp:
                    others.objects.link(mask)
            for entry in others.collection_objects:
                entry.light_linking.link_state = "EXCLUDE"
            lamp.light_linking.blocker_collection = others
    return lamps


def transmission(build: Tree, light: Projector, image: Gobo, direction: bpy.types.NodeSocket) -> tuple:
    """The frustum's soft edge (a number), and the gobo's colour or None, along a direction in the light's frame.

    The place (u, v) in the frustum is a vector; so is the gobo's.
    """
    wide, high = slopes(light)
    ahead = build.math("MAXIMUM", build.scalar("DOT_PRODUCT", direction, AHEAD), 1e-9)
    uv = build.vector("DIVIDE", build.vector("MULTIPLY", direction, (1.0 / wide, 1.0 / high, 0.0)), ahead)
    if light.elliptic:
        radius = build.scalar("LENGTH", uv)
    else:
        u, v, _ = build.components(build.vector("ABSOLUTE", uv))
        radius = build.math("MAXIMUM", u, v)
    if light.blend > 0.0:
        edge = build.node("ShaderNodeMapRange", {"Value": radius, "From Min": 1.0 - light.blend, "From Max": 1.0, "To Min": 1.0,
                                                 "To Max": 0.0}, interpolation_type="SMOOTHSTEP").outputs[0]
    else:
        edge = build.math("LESS_THAN", radius, 1.0)
    if image is None:
        return edge, None
    if isinstance(image, bpy.types.NodeTree):
        node = build.node("ShaderNodeGroup", {0: build.vector("MULTIPLY", uv, (wide / high, 1.0, 0.0))}, node_tree=image)
        return edge, node.outputs[0]
    place = build.vector("MULTIPLY_ADD", uv, (0.5,) * 3, (0.5, 0.5, 0.0))
    node = build.node("ShaderNodeTexImage", {"Vector": place}, image=image, interpolation="Linear", extension="EXTEND")
    return edge, socket_of(node.outputs, "Color")


def _light_nodes(data: bpy.types.Light, light: Projector, image: Gobo) -> None:
    tree = compat.use_nodes(data)
    tree.nodes.clear()
    build = Tree(tree)
    direction = socket_of(build.node("ShaderNodeTexCoord").outputs, "Normal")
    strength, color = transmission(build, light, image, direction)
    if light.near > 0.0 or math.isfinite(light.far):
        way = socket_of(build.node("ShaderNodeLightPath").outputs, "Ray Length")
        depth = build.math("MULTIPLY", way, build.scalar("DOT_PRODUCT", direction, AHEAD))
        if light.near > 0.0:
            strength = build.math("MULTIPLY", strength, build.math("GREATER_THAN", depth, light.near))
        if math.isfinite(light.far):
            strength = build.math("MULTIPLY", strength, build.math("LESS_THAN", depth, light.far))
    if light.falloff < 2:
        falloff = build.node("ShaderNodeLightFalloff", {"Strength": strength})
        strength = socket_of(falloff.outputs, {0: "Constant", 1: "Linear"}[light.falloff])
    emission = build.node("ShaderNodeEmission", {"Color": color if color else (1.0, 1.0, 1.0, 1.0), "Strength": strength})
    build.feed(build.node("ShaderNodeOutputLight").inputs[0], emission.outputs[0])
    arrange(tree)


def _take_nodes(lamp: bpy.types.Object, other: bpy.types.Light) -> None:
    """Give a lamp the nodes of another channel's: quicker than to build them again."""
    own, lamp.data = lamp.data, other.copy()
    lamp.data.energy, lamp.data.color = own.energy, own.color
    name = own.name
    bpy.data.lights.remove(own)
    lamp.data.name = name


def _mask(light: Projector, image: Gobo, channel: int, name: str, collection: bpy.types.Collection, reach: float,
          first: bpy.types.Object | None = None) -> bpy.types.Object:
    """A plane before the light that lets through the mask in EEVEE's shadows; Cycles sees it as clear.

    ``first``: the mask of another channel of the same light.
    """
    distance = max(MASK_DISTANCE * reach, 1e-3)
    half = 1.1 * distance * math.tan(cone_angle(light) / 2.0)
    if first is None:
        material = _mask_material(light, image, channel, distance, f"{name} mask")
    else:
        material = _of_channel(first.material_slots[0].material, channel, f"{name} mask")
    plane = Box(plus(light.position, scaled(light.direction, distance)), (half, half, 0.0), axes(light))
    result = objects.body(plane, f"{name} mask", material, collection)
    for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter"):
        setattr(result, f"visible_{ray}", False)
    return result


def _of_channel(other: bpy.types.Material, channel: int, name: str) -> bpy.types.Material:
    """The mask of another channel turned to this one: quicker than to build its nodes again."""
    material = other.copy()
    material.name = name
    tree = material.node_tree
    part = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeSeparateColor")
    link = next(link for link in tree.links if link.from_node == part)
    tree.links.new(part.outputs[channel], link.to_socket)
    return material


def _mask_material(light: Projector, image: Gobo, channel: int, distance: float, name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    build = Tree(compat.use_nodes(material))
    position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    passed, color = transmission(build, light, image, build.vector("ADD", position, (0.0, 0.0, -distance)))
    if color:
        passed = build.math("MULTIPLY", passed, build.node("ShaderNodeSeparateColor", {0: color}).outputs[channel])
    opaque = build.node("ShaderNodeBsdfDiffuse", {"Color": (0.0, 0.0, 0.0, 1.0)})
    clear = build.node("ShaderNodeBsdfTransparent", {"Color": (1.0, 1.0, 1.0, 1.0)})
    mixed = build.node("ShaderNodeMixShader", {0: passed, 1: opaque.outputs[0], 2: clear.outputs[0]})
    for target, shader in (("EEVEE", mixed), ("CYCLES", clear)):
        build.feed(socket_of(build.node("ShaderNodeOutputMaterial", target=target).inputs, "Surface"), shader.outputs[0])
    material.surface_render_method = "DITHERED"
    arrange(build.tree)
    return material
