# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights, environment and camera of a user's own scene, read into the Scene's terms.

What the Scene has no word for is named in the warnings and left out: area lights, worlds that are not one colour. Nodes of
lights are not read, as EEVEE does not. A sun's angle and the radius of a lamp count as 0: their penumbrae are finer than the
voxels of baked light.
"""

from __future__ import annotations

import bpy
from mathutils import Vector

from ..scene.model import Camera, Color, Light, Point, Spot, Sun
from . import compat


def lights(scene: bpy.types.Scene) -> tuple[tuple[Light, ...], list[str]]:
    """The lights that the scene renders, and a warning for each that is left out."""
    found, warnings = [], []
    for candidate in scene.objects:
        if candidate.type != "LIGHT" or candidate.hide_render:
            continue
        data = candidate.data
        if data.type not in ("SUN", "POINT", "SPOT"):
            warnings.append(f"{candidate.name} is left out: {data.type.lower()} lights do not count; "
                            "use a sun, point or spot")
            continue
        factor = data.energy * 2.0 ** data.exposure
        color = tuple(c * t for c, t in zip(data.color, data.temperature_color)) if data.use_temperature else tuple(data.color)
        strength = tuple(factor * c for c in color)
        frame = candidate.matrix_world
        position = tuple(frame.translation)
        direction = tuple((frame.to_3x3() @ Vector((0.0, 0.0, -1.0))).normalized())
        match data.type:
            case "SUN":
                found.append(Sun(direction, strength))
            case "POINT":
                found.append(Point(position, strength))
            case "SPOT":
                found.append(Spot(position, direction, strength, data.spot_size, data.spot_blend))
    return tuple(found), warnings


def sun(scene: bpy.types.Scene) -> Sun:
    """The strongest sun of the scene. Raises ValueError where there is none."""
    suns = [light for light in lights(scene)[0] if isinstance(light, Sun)]
    if not suns:
        raise ValueError(f"{scene.name} has no sun whose light could come through; add a sun light and turn it towards the "
                         "opening")
    return max(suns, key=lambda light: max(light.irradiance))


def environment(scene: bpy.types.Scene) -> tuple[Color, list[str]]:
    """Radiance of the world where it is one colour; black with a warning where it is not."""
    world = scene.world
    if world is None:
        return (0.0, 0.0, 0.0), []
    plain = compat.current().use_nodes and not world.use_nodes
    if plain or world.node_tree is None or not world.node_tree.nodes:
        return tuple(world.color), []
    output = next((node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeOutputWorld"
                   and node.is_active_output), None)
    if output is None or not output.inputs["Surface"].links:
        return (0.0, 0.0, 0.0), []
    background = output.inputs["Surface"].links[0].from_node
    if background.bl_idname != "ShaderNodeBackground" or any(socket.is_linked for socket in background.inputs):
        return (0.0, 0.0, 0.0), [f"the world {world.name!r} is left out: only a Background of one colour counts"]
    strength = background.inputs["Strength"].default_value
    return tuple(strength * c for c in background.inputs["Color"].default_value[:3]), []


def camera(scene: bpy.types.Scene) -> Camera:
    """The scene's camera. Raises ValueError where there is none."""
    if scene.camera is None:
        raise ValueError("the scene has no camera, and baked light belongs to one point of view; add a camera")
    frame = scene.camera.matrix_world
    direction = (frame.to_3x3() @ Vector((0.0, 0.0, -1.0))).normalized()
    return Camera(tuple(frame.translation), tuple(direction), scene.camera.data.angle_x)
