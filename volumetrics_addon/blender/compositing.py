# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog and air in a scene's compositor: put between the Render Layers node and what it feeds, and taken out again.

What the fog knows of the camera and the suns follows them by drivers, which need no permission to run Python: they are what
Blender calls simple expressions.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import bpy

from ..scene.body import Body
from ..scene.model import Color
from . import compat, depth_air, depth_fog
from .composited import MILLI
from .nodes import arrange, socket_of, socket_value

STATE = "volumetrics_compositing"  # on the fog's node: what was there before
# Half the width and the height of the picture one metre before the camera, from lens and sensor, and the whole of the side along
# which a lens shift counts; fit 1 is horizontal, 2 vertical, 0 the longer side. Blender cuts expressions after 255 letters.
_WIDE = "(fit == 1 or fit == 0 and w * rx >= h * ry)"
_HALVES = (f"(sh * w * rx / h / ry if fit == 2 else sw if {_WIDE} else sw * w * rx / h / ry) / 2 / lens",
           f"(sh if fit == 2 else sw * h * ry / w / rx if {_WIDE} else sw) / 2 / lens",
           "(sh if fit == 2 else sw) / lens")
_LENS = {"lens": "lens", "sw": "sensor_width", "sh": "sensor_height", "fit": "sensor_fit"}
# Columns of the matrix of a unit quaternion.
_AXES = {"x": ("1 - 2 * (qy * qy + qz * qz)", "2 * (qx * qy + qz * qw)", "2 * (qx * qz - qy * qw)"),
         "y": ("2 * (qx * qy - qz * qw)", "1 - 2 * (qx * qx + qz * qz)", "2 * (qy * qz + qx * qw)"),
         "z": ("2 * (qx * qz + qy * qw)", "2 * (qy * qz - qx * qw)", "1 - 2 * (qx * qx + qy * qy)")}


def check(scene: bpy.types.Scene) -> None:
    """Raises ValueError where a depth says nothing of the distance, with the remedy."""
    if scene.camera is None:
        raise ValueError("the compositor's fog belongs to a camera, and the scene has none; add a camera")
    if scene.camera.type != "CAMERA" or scene.camera.data.type != "PERSP":
        raise ValueError(f"the compositor's fog needs a perspective camera, and {scene.camera.name} is none; change its type, or choose "
                         "the volume")


def add(scene: bpy.types.Scene, body: Body, suns: Sequence[bpy.types.Object], sky: Color, name: str, orders: int = 1,
        keep_background: bool = False) -> bpy.types.Node:
    """The body's fog or air in the scene's compositor. Returns the node with its live parameters.

    A sky of one radiance lights fog; air makes its own sky, unless the background is kept. Raises ValueError as ``check`` does,
    where the scene's compositor shows no Render Layers of the scene, and where air has not one sun.
    """
    check(scene)
    if body.family.name == "air" and len(suns) != 1:
        raise ValueError(f"the compositor's air has one sun, and the scene has {len(suns)}; add a sun, hide the others, "
                         "or choose the volume")
    family, values = body.family, body.values
    had = compat.compositing_state(scene)
    tree = compat.compositing_tree(scene)
    layers = next((node for node in tree.nodes if node.bl_idname == "CompositorNodeRLayers" and node.scene in (scene, None)
                   and node.outputs["Image"].links), None)
    if layers is None:
        compat.restore_compositing(scene, had)
        raise ValueError("the scene's compositor shows no Render Layers of this scene; link one to the output")
    view_layer = scene.view_layers[layers.layer] if layers.layer in scene.view_layers else scene.view_layers[0]
    depth_before, view_layer.use_pass_z = view_layer.use_pass_z, True
    node = tree.nodes.new("CompositorNodeGroup")
    if family.name == "air":
        node.node_tree = depth_air.group(body, orders, keep_background, name)
    else:
        node.node_tree = depth_fog.group(values, body.domain, len(suns), max(sky) > 0.0, name)
    node.name = node.label = name
    node.width = 240
    node.location = layers.location
    node.location.x += 320.0
    inputs = {parameter.name: socket for parameter, socket in zip(family.live, node.inputs)}
    for parameter in family.live:
        inputs[parameter.name].default_value = socket_value(parameter, values[parameter.name])
    inputs |= {socket.name: socket for socket in list(node.inputs)[len(family.live):]}
    for link in list(layers.outputs["Image"].links):
        tree.links.new(node.outputs[0], link.to_socket)
    tree.links.new(layers.outputs["Image"], inputs["Image"])
    tree.links.new(layers.outputs["Depth"], inputs["Depth"])
    inputs["Sky radiance"].default_value = sky
    _follow_camera(scene, inputs)
    for index, sun in enumerate(suns):
        _follow_sun(sun, inputs[f"Sun {index + 1} direction"], inputs[f"Sun {index + 1} irradiance"])
    node[STATE] = json.dumps({"had": had, "layer": view_layer.name, "depth": depth_before})
    if not had:
        arrange(tree)
    return node


def node_of(identity: str, tag: str) -> bpy.types.Node | None:
    """The fog's node whose group carries this tag, in whatever scene."""
    for scene in bpy.data.scenes:
        tree = compat.present_compositing_tree(scene)
        for node in tree.nodes if tree else ():
            if node.bl_idname == "CompositorNodeGroup" and node.node_tree and node.node_tree.get(tag) == identity:
                return node
    return None


def remove(scene: bpy.types.Scene, node: bpy.types.Node) -> None:
    """Take the fog's node out, link what it stood between, and bring back pass and compositor where nothing else needs them."""
    tree, state = node.id_data, json.loads(node[STATE])
    for socket in node.inputs:
        socket.driver_remove("default_value")
    if node.inputs["Image"].links:
        source = node.inputs["Image"].links[0].from_socket
        for link in list(node.outputs[0].links):
            tree.links.new(source, link.to_socket)
    tree.nodes.remove(node)
    others = [other for other in tree.nodes if STATE in other]
    if others:  # whoever is left goes back to what the first one found
        first = json.loads(others[0][STATE])
        others[0][STATE] = json.dumps(first | {"had": state["had"] and first["had"], "depth": state["depth"] and first["depth"]})
        return
    depth_is_used = any(output.links for other in tree.nodes if other.bl_idname == "CompositorNodeRLayers"
                        for output in other.outputs if output.name == "Depth")
    if state["layer"] in scene.view_layers and not depth_is_used:
        scene.view_layers[state["layer"]].use_pass_z = state["depth"]
    if not state["had"] and {other.bl_idname for other in tree.nodes} <= compat.PLAIN_COMPOSITING:
        compat.restore_compositing(scene, state["had"])


def _drive(socket: bpy.types.NodeSocket, component: int, expression: str, variables: Mapping[str, tuple]) -> None:
    """A driver on a component of the socket. Variables: (ID type, ID, path) of a property, or (object, channel) of a transform."""
    driver = socket.driver_add("default_value", component).driver if component >= 0 else socket.driver_add("default_value").driver
    driver.type = "SCRIPTED"
    for name, source in variables.items():
        variable = driver.variables.new()
        variable.name = name
        target = variable.targets[0]
        if len(source) == 3:
            target.id_type, target.id, target.data_path = source
        else:
            variable.type = "TRANSFORMS"
            target.id, target.transform_type = source
            target.rotation_mode = "QUATERNION"
            target.transform_space = "WORLD_SPACE"
    driver.expression = expression


def _turn(holder: bpy.types.Object) -> dict[str, tuple]:
    return {f"q{axis}": (holder, f"ROT_{axis.upper()}") for axis in "wxyz"}


def _follow_camera(scene: bpy.types.Scene, inputs: Mapping[str, bpy.types.NodeSocket]) -> None:
    camera = scene.camera
    lens = {name: ("CAMERA", camera.data, path) for name, path in _LENS.items()}
    lens |= {name: ("SCENE", scene, f"render.{path}") for name, path in
             (("w", "resolution_x"), ("h", "resolution_y"), ("rx", "pixel_aspect_x"), ("ry", "pixel_aspect_y"))}
    for index, letter in enumerate("XYZ"):
        _drive(inputs["Camera location"], index, "p", {"p": (camera, f"LOC_{letter}")})
        for name, axis in (("Camera right", "x"), ("Camera up", "y"), ("Camera back", "z")):
            _drive(inputs[name], index, _AXES[axis][index], _turn(camera))
        _drive(inputs["Picture"], index, _HALVES[index], lens)
    for index, letter in enumerate("xy"):
        _drive(inputs["Lens shift"], index, "shift", {"shift": ("CAMERA", camera.data, f"shift_{letter}")})
    _drive(inputs["Farthest depth"], -1, "0.999 * end", {"end": ("CAMERA", camera.data, "clip_end")})


def _follow_sun(sun: bpy.types.Object, direction: bpy.types.NodeSocket, irradiance: bpy.types.NodeSocket) -> None:
    for index in range(3):
        _drive(direction, index, f"-({_AXES['z'][index]})", _turn(sun))
        _drive(irradiance, index, f"energy * color * pow(2, exposure) / {MILLI}", {
            "energy": ("LIGHT", sun.data, "energy"), "exposure": ("LIGHT", sun.data, "exposure"),
            "color": ("LIGHT", sun.data, f"color[{index}]")})
