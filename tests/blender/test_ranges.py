# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of nodes against what Cycles evaluates: the value at many points, and its change between neighbours."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import build, compat, ranges, render  # noqa: E402
from volumetrics_addon.plan.observed import Range  # noqa: E402

SIZE = 3.0  # of the plane, and of the picture
PIXELS = 96
SHIFT = 8.0  # added before rendering, which knows no negative light


def chain(tree, nodes):
    """Nodes one after another, each fed by the one before: (type, properties, inputs); the last one's output."""
    last = None
    for kind, properties, inputs in nodes:
        node = tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for key, value in inputs.items():
            socket = ranges._input(node, key)
            if value == "last":
                tree.links.new(last, socket)
            else:
                socket.default_value = value
        if kind == "ShaderNodeValToRGB":
            for element, (place, value) in zip(node.color_ramp.elements, ((0.4, 0.1), (0.6, 0.9))):
                element.position, element.color = place, (value, value, value, 1.0)
        last = next(socket for socket in node.outputs if socket.enabled and socket.name not in ("Normal", "Color")) \
            if kind.startswith("ShaderNodeTex") and kind != "ShaderNodeTexCoord" else node.outputs[0]
        if kind == "ShaderNodeTexCoord":
            last = node.outputs["Object"]
        if kind == "ShaderNodeMix":
            last = next(socket for socket in node.outputs if socket.enabled)
    return last


COORDINATES = ("ShaderNodeTexCoord", {}, {})
NOISE = ("ShaderNodeTexNoise", {}, {"Vector": "last", "Scale": 1.7, "Detail": 0.0})
CHAINS = {
    "value": [("ShaderNodeValue", {}, {})],
    "noise": [COORDINATES, NOISE],
    "mapped noise": [COORDINATES, ("ShaderNodeMapping", {}, {"Vector": "last", "Scale": (0.5, 2.0, 1.0)}), NOISE],
    "ramp": [COORDINATES, NOISE, ("ShaderNodeValToRGB", {}, {0: "last"})],
    "product": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "MULTIPLY"}, {0: "last", 1: -5.0})],
    "sum and clamp": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "MULTIPLY_ADD"}, {0: "last", 1: 6.0, 2: -2.7}),
                      ("ShaderNodeClamp", {}, {"Value": "last"})],
    "power": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "POWER"}, {0: "last", 1: 3.0})],
    "root": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "SQRT"}, {0: "last"})],
    "exponential": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "EXPONENT"}, {0: "last"})],
    "quotient": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "ADD"}, {0: "last", 1: 0.5}),
                 ("ShaderNodeMath", {"operation": "DIVIDE"}, {0: 1.5, 1: "last"})],
    "map range": [COORDINATES, NOISE, ("ShaderNodeMapRange", {}, {"Value": "last", "From Min": 0.3, "From Max": 0.8, "To Max": 4.0})],
    "smoothstep": [COORDINATES, NOISE, ("ShaderNodeMapRange", {"interpolation_type": "SMOOTHSTEP"},
                                        {"Value": "last", "From Min": 0.3, "From Max": 0.8, "To Min": 2.0, "To Max": -1.0})],
    "mix": [COORDINATES, NOISE, ("ShaderNodeMix", {}, {"Factor": "last", "A": 3.0, "B": -1.0})],
    "invert": [COORDINATES, NOISE, ("ShaderNodeInvert", {}, {"Color": "last"})],
    "voronoi": [COORDINATES, ("ShaderNodeTexVoronoi", {}, {"Vector": "last", "Scale": 1.3})],
    "gradient": [COORDINATES, ("ShaderNodeTexGradient", {}, {"Vector": "last"})],
    "height": [COORDINATES, ("ShaderNodeSeparateXYZ", {}, {"Vector": "last"}),
               ("ShaderNodeMapRange", {}, {"Value": "last", "From Min": -1.0, "From Max": 1.0, "To Min": 2.0, "To Max": 0.0})],
    "square": [COORDINATES, ("ShaderNodeSeparateXYZ", {}, {"Vector": "last"}),
               ("ShaderNodeMath", {"operation": "ABSOLUTE"}, {0: "last"}), ("ShaderNodeMath", {"operation": "POWER"}, {0: "last", 1: 2.0})],
    "less than": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "LESS_THAN"}, {0: "last", 1: 0.5})],
    "absolute": [COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "SUBTRACT"}, {0: "last", 1: 0.5}),
                 ("ShaderNodeMath", {"operation": "ABSOLUTE"}, {0: "last"})],
}


def plane(nodes):
    """A plane that shines with what the nodes give, plus SHIFT; the scene, and the socket that they feed."""
    scene = bpy.data.scenes.new("ranges")
    mesh = bpy.data.meshes.new("ranges")
    h = SIZE / 2.0
    mesh.from_pydata([(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("ranges")
    tree = compat.use_nodes(material)
    mesh.materials.append(material)
    shown = bpy.data.objects.new("ranges", mesh)
    scene.collection.objects.link(shown)
    camera = bpy.data.cameras.new("ranges")
    camera.type, camera.ortho_scale = "ORTHO", SIZE
    scene.camera = bpy.data.objects.new("ranges camera", camera)
    scene.camera.location = (0.0, 0.0, 2.0)
    scene.collection.objects.link(scene.camera)
    socket = chain(tree, nodes)
    add = tree.nodes.new("ShaderNodeMath")
    tree.links.new(socket, add.inputs[0])
    add.inputs[1].default_value = SHIFT
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(add.outputs[0], emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.pixel_filter_type = 1, False, "BOX"
    scene.cycles.filter_width = 0.01  # the first sample of a pixel is at its centre
    return scene, add.inputs[0]


@pytest.mark.parametrize("name", CHAINS)
def test_values_and_slopes_are_within_the_bounds(name):
    with build.temporary():
        scene, socket = plane(CHAINS[name])
        half = SIZE / 2.0
        bound = ranges.Reader((SIZE, SIZE, SIZE), local=Range(-half, half), world=Range(-half, half)).of(socket)
        values = render.render_built(scene, PIXELS, PIXELS)[0].mean(axis=-1) - SHIFT
    assert bound.low - 1e-5 <= values.min() and values.max() <= bound.high + 1e-5
    steepest = max(np.abs(np.diff(values, axis=k)).max() for k in (0, 1)) / (SIZE / PIXELS)
    # Noise goes once from end to end in a period: at its steepest, three times as fast.
    assert steepest <= 3.0 * bound.rate + 1e-3
    assert (bound.rate > 0.0) == (np.ptp(values) > 1e-5)
    if math.isfinite(bound.rate) and bound.rate > 0.0:
        assert steepest >= bound.rate / 20.0  # a bound that says something


def test_what_no_texture_reaches_is_constant():
    with build.temporary():
        scene, socket = plane([COORDINATES, NOISE, ("ShaderNodeMath", {"operation": "MULTIPLY"}, {0: "last", 1: 0.0})])
        assert ranges.Reader().of(socket) == Range(0.0, 0.0, 0.0)


def test_unknown_textures_are_unknown():
    with build.temporary():
        scene, socket = plane([COORDINATES, ("ShaderNodeTexMagic", {}, {"Vector": "last"})])
        assert ranges.Reader().of(socket).rate == math.inf


def test_keyframes_make_a_value_unknown():
    with build.temporary():
        scene, socket = plane([("ShaderNodeValue", {}, {})])
        node = socket.links[0].from_node
        node.outputs[0].default_value = 0.25
        assert ranges.Reader().of(socket) == Range(0.25, 0.25)
        socket.id_data.nodes["Emission"].inputs["Strength"].keyframe_insert("default_value", frame=1)
        assert ranges.Reader().of(socket) == Range(0.25, 0.25)  # of another node
        node.outputs[0].keyframe_insert("default_value", frame=1)
        assert ranges.Reader().of(socket) == Range(-math.inf, math.inf)
        node.outputs[0].keyframe_delete("default_value", frame=1)
        assert ranges.Reader().of(socket) == Range(0.25, 0.25)
        node.outputs[0].driver_add("default_value").driver.expression = "frame"
        assert ranges.Reader().of(socket) == Range(-math.inf, math.inf)


def test_groups_and_reroutes_are_followed():
    """A group that doubles what it is given, twice nested, behind a reroute."""
    with build.temporary():
        inner = bpy.data.node_groups.new("double", "ShaderNodeTree")
        inner.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketFloat")
        inner.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketFloat")
        enter, leave, double = (inner.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeMath"))
        double.operation = "MULTIPLY"
        double.inputs[1].default_value = 2.0
        inner.links.new(enter.outputs[0], double.inputs[0])
        inner.links.new(double.outputs[0], leave.inputs[0])
        outer = inner.copy()
        nested = outer.nodes.new("ShaderNodeGroup")
        nested.node_tree = inner
        doubled = next(node for node in outer.nodes if node.bl_idname == "ShaderNodeMath")
        outer.links.new(doubled.outputs[0], nested.inputs[0])
        outer.links.new(nested.outputs[0], next(n for n in outer.nodes if n.bl_idname == "NodeGroupOutput").inputs[0])

        scene, socket = plane([("ShaderNodeValue", {}, {})])
        tree, value = socket.id_data, socket.links[0].from_node
        group, reroute = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("NodeReroute")
        group.node_tree = outer
        value.outputs[0].default_value = 0.75
        tree.links.new(value.outputs[0], group.inputs[0])
        tree.links.new(group.outputs[0], reroute.inputs[0])
        tree.links.new(reroute.outputs[0], socket)
        assert ranges.Reader().of(socket) == Range(3.0, 3.0)
        tree.links.remove(group.inputs[0].links[0])
        group.inputs[0].default_value = 0.5
        assert ranges.Reader().of(socket) == Range(2.0, 2.0)
