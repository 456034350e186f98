# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns as nodes: the same values as the formula at every point, and live in the user's own scene."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import compat, items, objects, render, settings  # noqa: E402
from volumetrics_addon.blender.nodes import Tree  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402
from volumetrics_addon.scene import assemble, gobo  # noqa: E402
from volumetrics_addon.verify import reference_of  # noqa: E402

PIXELS = 24
BEAM = {"light": "projector", "location": [0, 0, 6], "target": [0, 0, 0], "length": 6.0, "extinction": 0.2, "blocker": "none",
        "horizontal_fov": 44.0, "vertical_fov": 30.0, "gobo_count": 5, "gobo_seed": 3}
PLACED = {"gobo_softness": 0.3, "gobo_scale": 0.8, "gobo_rotation": 25.0, "gobo_drift_right": 0.4,
          "gobo_drift_up": -0.15, "gobo_time": 7.5}


def item_of(changes):
    """An item in an empty scene, and the group of its gobo."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    item = items.add_item(bpy.context.scene, "godray", BEAM | changes, "Beam")
    (light,) = assemble.ASSEMBLERS["godray"](items.values_of(item), None).lights
    return item, light, bpy.data.node_groups["Beam gobo"]


def shown(group, aspect):
    """What the group gives at the pixels' centres of a picture of the frustum, by Cycles on a plane."""
    scene = bpy.context.scene
    material = bpy.data.materials.new("Screen")
    tree = Tree(compat.use_nodes(material))
    position = tree.node("ShaderNodeNewGeometry").outputs[0]
    node = tree.node("ShaderNodeGroup", {0: position}, node_tree=group)
    emission = tree.node("ShaderNodeEmission", {"Color": node.outputs[0], "Strength": 1.0})
    tree.feed(tree.node("ShaderNodeOutputMaterial").inputs[0], emission.outputs[0])
    bpy.ops.mesh.primitive_plane_add(size=100.0)
    bpy.context.object.data.materials.append(material)
    for part in scene.objects:
        part.hide_render = part is not bpy.context.object
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale, data.sensor_fit = "ORTHO", 2.0 * aspect, "HORIZONTAL"
    scene.camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(scene.camera)
    scene.camera.location.z = 3.0
    scene.render.engine = "CYCLES"
    settings.apply(scene, {"cycles.samples": 1, "cycles.use_denoising": False, "cycles.use_adaptive_sampling": False,
                           "cycles.device": "CPU", "cycles.pixel_filter_type": "GAUSSIAN", "cycles.filter_width": 0.01})
    return render.render_built(scene, round(PIXELS * aspect), PIXELS)[0]


def expected(values, aspect, shape):
    """scene.gobo's formula at the same centres."""
    rows, columns = shape[:2]
    u = aspect * ((np.arange(columns) + 0.5) / columns * 2 - 1)
    v = (1 - (np.arange(rows) + 0.5) / rows * 2) * aspect * rows / columns  # pixels are square
    u, v = np.meshgrid(u, v)
    angle = math.radians(values["gobo_rotation"])
    x, y = np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u
    x, y = (axis / values["gobo_scale"] - values["gobo_time"] * values[f"gobo_drift_{way}"] for axis, way in ((x, "right"), (y, "up")))
    value = gobo.PATTERNS[values["gobo"]](x * values["gobo_count"] / 2, y * values["gobo_count"] / 2, values["gobo_softness"],
                                          values["gobo_seed"], values["gobo_time"])
    return value if value.ndim == 3 else np.repeat(value[..., None], 3, axis=2)


@pytest.mark.parametrize("pattern", gobo.PATTERNS)
def test_nodes_equal_the_formula_and_follow_their_sockets(pattern):
    item, light, group = item_of({"gobo": pattern})
    node, live = items.live_node(item), FAMILIES["godray"].live
    for name, value in PLACED.items():
        index = [parameter.name for parameter in live].index(name)
        node.inputs[index].default_value = math.radians(value) if name == "gobo_rotation" else value
    bpy.context.view_layer.update()
    values = items.values_of(item)
    assert {name: values[name] for name in PLACED} == pytest.approx(PLACED)
    aspect = math.tan(light.horizontal_fov / 2) / math.tan(light.vertical_fov / 2)
    image = shown(group, aspect)
    difference = np.abs(image - expected(values, aspect, image.shape))
    assert difference.max() < 1e-3  # 3e-4 measured, with a pixel filter of a hundredth of a pixel
    assert image.std() > 0.1


@pytest.mark.either
def test_a_keyframe_moves_the_light():
    """The light of an animated item in Cycles against the reference with a fine picture of the pattern at that time."""
    changes = {"gobo": "blinds", "gobo_count": 3, "gobo_softness": 0.5, "gobo_drift_up": 0.3333}
    item, light, _ = item_of(changes)
    scene, node = bpy.context.scene, items.live_node(item)
    socket = next(s for s in node.inputs if s.name == "Gobo time")
    for frame, time in ((1, 0.0), (5, 1.0)):
        socket.default_value = time
        socket.keyframe_insert("default_value", frame=frame)
    images = {}
    for frame, time in ((1, 0.0), (5, 1.0)):
        values = FAMILIES["godray"].check(BEAM | changes | {"gobo_time": time, "gobo_resolution": 256})
        stage = STAGE.check({"camera_location": [1, -9, 2.5], "camera_target": [0, 0, 1.6], "field_of_view": 20.0})
        described = assemble.scene("godray", values, stage, ())
        scene.frame_set(frame)
        if scene.camera is None:
            scene.camera = objects.camera(described.camera, (0.01, 100.0), "Camera", scene.collection)
            scene.render.engine = "CYCLES"
            settings.apply(scene, {"cycles.samples": 512, "cycles.use_denoising": False, "cycles.use_adaptive_sampling": False,
                                   "cycles.device": "CPU", "cycles.pixel_filter_type": "BOX"})
        images[frame] = render.render_built(scene, 12, 12)[0]
        truth = reference_of(described, 12, 12, repeats=2, samples=4).image
        assert np.abs(images[frame] - truth).mean() < 0.03 * truth.mean()
    assert np.abs(images[1] - images[5]).mean() > 0.15 * images[1].mean()  # so that a picture that stands still is found out
