# SPDX-License-Identifier: GPL-3.0-or-later
"""Keyframes and drivers move every live parameter of a user's scene, the picture and the panel with it, without new nodes."""

import math

import bpy
import numpy as np
import pytest
from mathutils import Vector

from volumetrics_addon.blender import compat, items, objects, render
from volumetrics_addon.blender.nodes import socket_value
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load
from volumetrics_addon.ui import panels

PRESETS = {"cloud": "ember-smoke", "glass": "emerald-sphere", "fog": "morning-valley", "godray": "theatre-slats",
           "air": "clear-noon"}
LIVE = [(family, parameter) for family, group in FAMILIES.items() for parameter in group.live]
FRAMES = (1, 11)


def enabling(family, name, values):
    """The values, changed so that the parameter's socket has an effect: its rules, and those of what they name."""
    group, values = FAMILIES[family], dict(values)
    waiting = [group[name].when, group[name].live_when]
    while waiting:
        if not (rule := waiting.pop()):
            continue
        other, *effective = rule
        holds = values[other] in effective if effective else values[other]
        if not holds or values[other] == "automatic":  # which is a volume in a scene of the user's own
            values[other] = effective[0] if effective else {"bool": True, "int": 2, "float": 0.02}[group[other].kind]
        waiting.append(group[other].when)
    if "time" in values:  # without wind it moves nothing
        values |= {"time": values["time"] or 3.0, "wind": tuple(0.1 * values["noise_size"] * part for part in (1.0, 0.5, 0.0))}
    if family == "godray":  # neither does a drift without time, nor has a colour effect without light
        values |= {"ambient": values["ambient"] or 0.5, "dust_time": 2.0, "dust_drift": (0.3, 0.2, 0.1), "gobo_time": 1.0,
                   "gobo_drift_right": 0.3, "dust_strength": min(1.0, 50.0 * values["dust_strength"])}
    if family == "cloud":
        values |= {"octaves": 3, "billow_size": 0.15}  # bulges larger than the cloud change little
    if values.get("profile") == "patch":
        values |= {"extinction": 0.5}  # thick enough that its wisps are seen
    assert group.reacts(name, values), (name, values)
    return values


def ends(parameter, base):
    """Two values within the limits, far enough apart to be seen."""
    if parameter.kind == "color":
        return tuple(0.2 * part + 0.01 for part in base), tuple(min(1.0, 0.8 * part + 0.15) for part in base)
    if parameter.kind == "vector":
        return (0.0, 0.0, 0.0), (1.0, 0.7, 0.4)
    if parameter.kind == "int":
        return 1, 7
    if parameter.unit == "m" and base == parameter.maximum:  # infinitely far, and before the wall
        return 20.0, base
    low, high = parameter.soft_range
    if parameter.maximum == 1.0 and low == 0.0:
        return 0.1 * base, 0.9 if base < 0.7 else base
    if low >= 0.0 and base > 0.0:
        return max(parameter.minimum, base * 0.5), min(high, base * 2.0) if base < high else 0.75 * base
    return max(low, -0.4), min(high, 0.57)  # a window of four panes is as it was after a drift of 1


def scene_of(family, values):
    """A user's scene with the item alone, a sun and a camera that sees it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    stage = load(PRESETS[family]).stage
    eye = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    eye.location = stage["camera_location"]
    eye.rotation_euler = (Vector(stage["camera_target"]) - eye.location).to_track_quat("-Z", "Y").to_euler()
    eye.data.angle = math.radians(stage["field_of_view"])
    eye.data.clip_end = 1e7
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy = 5.0
    light.rotation_euler = (0.8, 0.2, 0.3)
    for added in (eye, light):
        scene.collection.objects.link(added)
    if family == "fog":  # a wall across the lower half of the view, to which it is fitted
        bpy.ops.mesh.primitive_cube_add(location=(0.0, 20.0, -6.0), scale=(40.0, 1.0, 10.0))
    scene.camera = eye
    scene.world = objects.world((0.05, 0.05, 0.05), "World")
    return scene, items.add_item(scene, family, values, "Item", orders=3 if family == "cloud" else 1)


def contexts():
    """(family, values, live parameters) so that every live parameter reacts beside the values of a context."""
    result = []
    for family, group in FAMILIES.items():
        found = {}
        for parameter in group.live:
            values = enabling(family, parameter.name, load(PRESETS[family]).parameters)
            found.setdefault(repr(sorted(values.items())), (family, values, []))[2].append(parameter)
        result += found.values()
    return result


CONTEXTS = contexts()
IDS = [f"{family}-{parameters[0].name}" for family, _, parameters in CONTEXTS]


def socket_of(item, parameter):
    node = items.live_node(item)
    return node.inputs[[p.name for p in FAMILIES[items.record(item)["family"]].live].index(parameter.name)]


def still(socket):
    """Take the keyframes away; drivers of the compositor's own stay."""
    for frame in FRAMES:
        socket.keyframe_delete("default_value", frame=frame)


def written(parameter, value):
    """As the socket holds it: colours with alpha, angles in radians."""
    return socket_value(parameter, value)


def evaluated(item, parameter):
    """The value that the engines get, of the evaluated copy of the material."""
    socket = socket_of(item, parameter)
    if items.record(item).get("compositor"):  # the compositor reads the tree itself
        return socket.default_value if parameter.kind in ("int", "float") else tuple(socket.default_value)
    tree = next(o.material_slots[0].material for o in item.objects for slot in o.material_slots
                if slot.material.node_tree == socket.id_data)
    node = tree.evaluated_get(bpy.context.evaluated_depsgraph_get()).node_tree.nodes[socket.node.name]
    value = node.inputs[list(socket.node.inputs).index(socket)].default_value
    return value if parameter.kind in ("int", "float") else tuple(value)


def trees():
    """Everything that nodes are made of, by name, and the number of nodes in each."""
    found = {tree.name: len(tree.nodes) for tree in bpy.data.node_groups}
    return found | {material.name: len(material.node_tree.nodes) for material in bpy.data.materials if material.node_tree}


def linked_through(node, index):
    """Names of the group's outputs that its input leads to."""
    tree = node.node_tree
    entry = next(n for n in tree.nodes if n.bl_idname == "NodeGroupInput")
    seen, waiting, reached = set(), [entry.outputs[index]], set()
    while waiting:
        for link in waiting.pop().links:
            if link.to_node.bl_idname == "NodeGroupOutput":
                reached.add(link.to_socket.name)
            elif link.to_node not in seen:
                seen.add(link.to_node)
                waiting += link.to_node.outputs
    return reached


def read_by_drivers(node, index):
    """Whether drivers elsewhere, such as those of a light's nodes, read the node's input."""
    path = f"{node.path_from_id()}.inputs[{index}].default_value"
    holders = [*bpy.data.objects, *bpy.data.lights, *bpy.data.materials, *bpy.data.node_groups]
    holders += [block.node_tree for block in (*bpy.data.lights, *bpy.data.materials) if block.node_tree]
    return any(path in target.data_path for block in holders if block.animation_data
               for curve in block.animation_data.drivers for variable in curve.driver.variables for target in variable.targets)


def picture(scene, frame):
    scene.frame_set(frame)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed, scene.cycles.use_denoising = 32, 1, False
    scene.cycles.use_adaptive_sampling = False
    if compat.current().volume_biased:  # marched, as the item's material is set up for: no octree for each picture
        scene.cycles.volume_biased = True
    return render.render_built(scene, 6, 6)[0]


@pytest.mark.parametrize(("family", "values", "parameters"), CONTEXTS, ids=IDS)
def test_keyframes_and_drivers_reach_the_engines(family, values, parameters):
    scene, item = scene_of(family, values)
    node, before = items.live_node(item), trees()
    scene["strength"] = 0.0
    for parameter in parameters:
        socket = socket_of(item, parameter)
        used = {output.name for output in node.outputs if output.is_linked}
        index = list(node.inputs).index(socket)
        assert linked_through(node, index) & used or read_by_drivers(node, index), parameter.name
        low, high = ends(parameter, values[parameter.name])
        kept = socket.default_value if parameter.kind in ("int", "float") else tuple(socket.default_value)
        for frame, value in zip(FRAMES, (low, high)):
            socket.default_value = written(parameter, value)
            socket.keyframe_insert("default_value", frame=frame)
        for frame, value in zip(FRAMES, (low, high)):
            scene.frame_set(frame)
            assert evaluated(item, parameter) == pytest.approx(written(parameter, value), rel=1e-6), parameter.name
            assert items.values_of(item)[parameter.name] == pytest.approx(value, rel=1e-6)
        still(socket)
        curves = socket.driver_add("default_value")
        for component, curve in enumerate(curves if isinstance(curves, list) else [curves]):
            a, b = (v if parameter.kind in ("int", "float") else v[component]
                    for v in (written(parameter, low), written(parameter, high)))
            curve.driver.expression = f"{a} + {b - a} * (frame - {FRAMES[0]}) / {FRAMES[1] - FRAMES[0]}"
        for frame, value in zip(FRAMES, (low, high)):
            scene.frame_set(frame)
            assert evaluated(item, parameter) == pytest.approx(written(parameter, value), rel=1e-5, abs=1e-6), parameter.name
        socket.driver_remove("default_value")
        socket.default_value = kept
    assert items.live_node(item) == node and trees() == before


def test_every_live_parameter_has_a_context():
    assert [(f, p.name) for f, _, parameters in CONTEXTS for p in parameters] and len(LIVE) >= 40
    assert {(f, p.name) for f, _, parameters in CONTEXTS for p in parameters} == {(f, p.name) for f, p in LIVE}


@pytest.mark.parametrize(("family", "values", "parameters"), CONTEXTS, ids=IDS)
def test_the_picture_follows(family, values, parameters):
    scene, item = scene_of(family, values)
    for parameter in parameters:
        socket = socket_of(item, parameter)
        kept = socket.default_value if parameter.kind in ("int", "float") else tuple(socket.default_value)
        for frame, value in zip(FRAMES, ends(parameter, values[parameter.name])):
            socket.default_value = written(parameter, value)
            socket.keyframe_insert("default_value", frame=frame)
        first, last = (picture(scene, frame) for frame in FRAMES)
        # The same seed: without an effect the two are equal to the last bit.
        assert np.abs(last - first).mean() > 2e-3 * first.mean() > 0.0, parameter.name
        still(socket)
        socket.default_value = kept


def test_every_animated_socket_survives_save_and_load(tmp_path):
    """One file with an item of each family, every socket that reacts keyed."""
    expected = {}
    scene, first = scene_of("glass", load(PRESETS["glass"]).parameters)
    items.remove_item(scene, first)
    for family in FAMILIES:
        values = load(PRESETS[family]).parameters
        item = items.add_item(scene, family, values, family)
        for name in items.effective(item):
            parameter = FAMILIES[family][name]
            socket = socket_of(item, parameter)
            expected[family, name] = ends(parameter, values[name])
            for frame, value in zip(FRAMES, expected[family, name]):
                socket.default_value = written(parameter, value)
                socket.keyframe_insert("default_value", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "all.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "all.blend"))
    scene = bpy.context.scene
    found = {items.record(item)["family"]: item for item in items.items(scene)}
    assert set(found) == set(FAMILIES) and len(expected) >= 25
    for index, frame in enumerate(FRAMES):
        scene.frame_set(frame)
        for (family, name), values in expected.items():
            parameter = FAMILIES[family][name]
            assert evaluated(found[family], parameter) == pytest.approx(written(parameter, values[index]), rel=1e-6), name


def test_the_base_of_a_slab_is_built_and_not_live():
    values = {**load("morning-valley").parameters, "profile": "slab", "base_height": 1.5}
    scene, item = scene_of("fog", values)
    assert "base_height" not in items.effective(item)
    socket_of(item, FAMILIES["fog"]["base_height"]).default_value = 9.0
    assert items.values_of(item)["base_height"] == 1.5
    low = min((o.matrix_world @ Vector(c)).z for o in item.objects for c in o.bound_box)
    assert low == pytest.approx(1.5 - 0.01 * values["slab_height"], rel=1e-5)


class Rows:
    """A layout that keeps the words that are drawn in it."""

    def __init__(self, words=None):
        self.words = [] if words is None else words

    def label(self, text="", icon="NONE"):
        self.words.append(text)

    def column(self, align=False):
        return Rows(self.words)

    def split(self, factor=0.0):
        return Rows(self.words)


def drawn(item):
    rows = Rows()
    panels._derived(rows, items.record(item)["family"], lambda: items.values_of(item))
    return rows.words


def test_derived_rows_follow_keyframes():
    scene, item = scene_of("cloud", load(PRESETS["cloud"]).parameters)
    socket = socket_of(item, FAMILIES["cloud"]["extinction"])
    for frame, value in zip(FRAMES, (0.5, 0.04)):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    for frame, shown in zip(FRAMES, ("2 m", "25 m")):
        scene.frame_set(frame)
        assert drawn(item)[:2] == ["Mean free path", shown]


def test_derived_rows_name_a_driver_beyond_the_limits():
    scene, item = scene_of("cloud", load(PRESETS["cloud"]).parameters)
    socket_of(item, FAMILIES["cloud"]["extinction"]).driver_add("default_value").driver.expression = "-frame"
    scene.frame_set(3)
    (message,) = drawn(item)
    assert message.startswith("extinction = -3.0 is not allowed")
