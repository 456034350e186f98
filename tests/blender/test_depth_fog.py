# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog in the compositor: its nodes against the formulas, in a preset's own scene and in a user's."""

import json
import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import compat, compositing, items, render  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402
from volumetrics_addon.reference import depth_fog  # noqa: E402

STAGE_VALUES = {"camera_location": [0, 0, 3], "camera_target": [2, 20, 3.5], "field_of_view": 60.0, "sun_irradiance": 3.0,
                "sun_color": [1.0, 0.9, 0.7], "sun_elevation": 25.0, "sun_azimuth": 30.0, "environment_color": [0.5, 0.7, 1.0],
                "environment_radiance": 0.6}
FOG = {"realisation": "compositor", "extinction": 0.05, "scale_height": 3.0, "margin": 300.0, "g": 0.5}
CASES = {
    "layers": ({"second_extinction": 0.01, "second_scale_height": 9.0, "visibility": 60.0}, {}),
    "slab": ({"profile": "slab", "slab_height": 8.0}, {"aspect": 0.5}),
    "from above": ({}, {"camera_location": [0, 0, 90], "camera_target": [0, 40, 0]}),
    "from below": ({"base_height": 5.0}, {"camera_target": [0, 20, 9]}),
    "night": ({}, {"sun_elevation": -10.0}),
    "sun alone": ({"g": -0.3}, {"environment_radiance": 0.0}),
    "sky alone": ({"g": 0.8}, {"sun_irradiance": 0.0}),
    "artist": ({"start": 7.0, "max_opacity": 0.4, "sun_tint": [1.0, 0.5, 0.2]}, {}),
    "linear": ({"profile": "linear", "start": 2.0, "end": 1e5, "max_opacity": 0.7}, {}),
    "exp": ({"profile": "exp"}, {}),
    "exp2": ({"profile": "exp2", "cutoff_distance": 50.0}, {}),
}


def preset(values, stage=(), props=()):
    return Preset("test", "fog", "Test", "", FAMILIES["fog"].check(FOG | values), STAGE.check(STAGE_VALUES | dict(stage)), props)


@pytest.mark.parametrize("name", CASES)
def test_nodes_follow_the_formula_before_the_sky(name):
    """Before a uniform sky nothing is sampled: one sample of Cycles is the formula at the centre of each pixel."""
    chosen = preset(*CASES[name])
    scene = verify.scene_of(chosen)
    width, height = verify.image_size(chosen, 12)
    shown = render.render(chosen, scene, "cycles", width, height, 1)
    assert shown.plan.compositor_fog and any(decision.rule == "compositor fog" for decision in shown.plan.decisions)
    expected = depth_fog.render(scene, width, height, repeats=2, strata=0).image
    assert shown.images[0] == pytest.approx(expected, rel=2e-5, abs=1e-6)


GROUND = {"shape": "box", "location": (0.0, 0.0, 0.0), "size": (2000.0, 2000.0, 0.0), "rotation": 0.0, "albedo": (0.3, 0.25, 0.2),
          "emission": (0.0, 0.0, 0.0)}


@pytest.mark.either
def test_ground_in_both_engines():
    """Light on the ground and the way to it, by the sun: each engine's depth gives the formula's picture."""
    chosen = preset({}, {"environment_radiance": 0.0, "camera_target": [2, 20, -13]}, (GROUND,))
    scene = verify.scene_of(chosen)
    expected = depth_fog.render(scene, 16, 16, repeats=2, strata=8).image
    # The depth is that of some point in the pixel.
    fine = depth_fog.render(scene, 16 * 8, 16 * 8, strata=0).image.reshape(16, 8, 16, 8, 3)
    low, high = 0.98 * fine.min(axis=(1, 3)), 1.02 * fine.max(axis=(1, 3))
    for engine, samples in (("cycles", 64), ("eevee", 16)):
        shown = render.render(chosen, scene, engine, 16, 16, samples).images[0]
        assert ((low <= shown) & (shown <= high)).all()
        assert shown.mean() == pytest.approx(expected.mean(), rel=0.01)


def test_what_no_volume_can_show_is_composited_by_itself():
    for values in ({"start": 5.0}, {"max_opacity": 0.5}, {"sun_tint": [1.0, 0.5, 0.5]}, {"cutoff_distance": 100.0}):
        scene = verify.scene_of(preset(values | {"realisation": "automatic"}))
        assert scene.depth_fog is not None and not scene.has_light_transport
    assert verify.scene_of(preset({"realisation": "automatic"})).depth_fog is None
    assert verify.scene_of(preset({"start": 5.0, "realisation": "volume"})).depth_fog is None


def test_a_depth_fog_has_no_volume():
    with pytest.raises(ValueError, match="profile 'exp' knows the distance alone and has no volume; choose the compositor"):
        verify.scene_of(preset({"profile": "exp", "realisation": "volume"}))


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (1.0, -8.0, 2.0), (1.3, 0.2, 0.4)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler, sun.data.energy, sun.data.color = (0.9, 0.1, 0.5), 4.0, (1.0, 0.5, 0.25)
    for thing in (camera, sun):
        scene.collection.objects.link(thing)
    scene.camera = camera
    world = bpy.data.worlds.new("World")
    tree = compat.use_nodes(world)
    background = tree.nodes.new("ShaderNodeBackground")
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (0.2, 0.4, 0.6, 1.0), 0.5
    tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs[0])
    scene.world = world
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x, scene.render.resolution_y = 12, 8
    return scene


def inputs_of(scene, item):
    """Values of the fog's inputs as Blender evaluates them at the current frame."""
    scene.frame_set(scene.frame_current)
    return {socket.name: socket.default_value if isinstance(socket.default_value, float) else np.array(socket.default_value)
            for socket in items.live_node(item).inputs}


@pytest.mark.parametrize("fit", ("AUTO", "HORIZONTAL", "VERTICAL"))
@pytest.mark.parametrize("size", ((12, 8, 1.0), (8, 12, 1.0), (10, 10, 2.0)))
def test_the_fog_sees_what_the_camera_sees(scene, fit, size):
    item = items.add_item(scene, "fog", FOG, "Fog")
    data = scene.camera.data
    data.sensor_fit, data.sensor_height, data.shift_x, data.shift_y, data.lens = fit, 20.0, 0.1, -0.2, 30.0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.pixel_aspect_y = size
    values = inputs_of(scene, item)
    frame = [scene.camera.matrix_world @ corner for corner in data.view_frame(scene=scene)]  # right top, right bottom, left bottom, left top
    half_width, half_height, side = values["Picture"]
    for corner, (u, v) in zip(frame, ((1, 1), (1, -1), (-1, -1), (-1, 1))):
        ray = (values["Camera right"] * (u * half_width + side * values["Lens shift"][0])
               + values["Camera up"] * (v * half_height + side * values["Lens shift"][1]) - values["Camera back"])
        expected = np.array(corner) - np.array(scene.camera.matrix_world.translation)
        assert ray / np.linalg.norm(ray) == pytest.approx(expected / np.linalg.norm(expected), abs=1e-5)
    assert values["Camera location"] == pytest.approx(scene.camera.matrix_world.translation, abs=1e-6)


def test_the_fog_follows_the_sun(scene):
    item = items.add_item(scene, "fog", FOG, "Fog")
    sun = scene.objects["Sun"]
    sun.data.keyframe_insert("energy", frame=1)
    sun.data.energy = 8.0
    sun.data.keyframe_insert("energy", frame=5)
    scene.frame_set(5)
    values = inputs_of(scene, item)
    assert values["Sun 1 irradiance"] == pytest.approx([8000.0, 4000.0, 2000.0])  # mW/m2
    assert values["Sun 1 direction"] == pytest.approx(-np.array(sun.matrix_world.col[2])[:3], abs=1e-6)
    assert values["Sky radiance"] == pytest.approx([0.1, 0.2, 0.3])
    for driver in items.live_node(item).id_data.animation_data.drivers:
        assert driver.driver.is_valid and driver.driver.is_simple_expression and len(driver.driver.expression) < 256


def links(tree):
    return {(link.from_node.name, link.from_socket.name, link.to_node.name, link.to_socket.name) for link in tree.links}


def test_added_rendered_and_removed(scene, tmp_path):
    counts = {name: len(getattr(bpy.data, name)) for name in ("node_groups", "collections", "objects", "materials")}
    scene.render.use_compositing = False
    bare = render.render_built(scene, 12, 8)
    first = items.add_item(scene, "fog", FOG, "Fog")
    foggy = render.render_built(scene, 12, 8)
    assert np.abs(foggy - bare).max() > 0.01
    items.live_node(first).inputs["Extinction"].default_value = 0.0
    assert render.render_built(scene, 12, 8) == pytest.approx(bare, rel=1e-5)  # the socket is live
    items.live_node(first).inputs["Extinction"].default_value = 0.2
    assert items.values_of(first)["extinction"] == 0.2
    second = items.add_item(scene, "fog", FOG | {"profile": "exp"}, "Depth fog")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "fog.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "fog.blend"))
    scene = bpy.context.scene
    first, second = items.items(scene)
    assert items.values_of(first)["extinction"] == 0.2
    items.remove_item(scene, first)
    assert items.live_node(second) is not None and scene.view_layers[0].use_pass_z
    items.remove_item(scene, second)
    assert compat.present_compositing_tree(scene) is None and not scene.view_layers[0].use_pass_z
    assert not scene.render.use_compositing
    assert counts == {name: len(getattr(bpy.data, name)) for name in counts}
    assert render.render_built(scene, 12, 8) == pytest.approx(bare, rel=1e-6)


def test_a_users_compositor_is_kept(scene):
    tree = compat.compositing_tree(scene)
    layers, output = tree.nodes
    if layers.bl_idname != "CompositorNodeRLayers":
        layers, output = output, layers
    blur = tree.nodes.new("CompositorNodeBlur")
    tree.links.new(layers.outputs["Image"], blur.inputs["Image"])
    tree.links.new(blur.outputs[0], output.inputs[0])
    before = links(tree)
    item = items.add_item(scene, "fog", FOG, "Fog")
    node = items.live_node(item)
    assert blur.inputs["Image"].links[0].from_node == node and node.inputs["Image"].links[0].from_node == layers
    items.remove_item(scene, item)
    assert links(tree) == before and compat.present_compositing_tree(scene) == tree


def test_refused(scene):
    scene.camera.data.type = "ORTHO"
    with pytest.raises(ValueError, match="needs a perspective camera, and Camera is none"):
        items.add_item(scene, "fog", FOG, "Fog")
    scene.camera = None
    with pytest.raises(ValueError, match="the scene has none; add a camera"):
        items.add_item(scene, "fog", FOG, "Fog")
    assert not items.items(scene) and compat.present_compositing_tree(scene) is None


def test_lamps_are_named(scene):
    scene.collection.objects.link(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT")))
    item = items.add_item(scene, "fog", FOG, "Fog")
    assert items.warnings(scene, item) == ["point lights do not shine into the compositor's fog; choose the volume for them"]
    assert compositing.STATE in items.live_node(item) and json.loads(items.live_node(item)[compositing.STATE])["had"] is False
    assert math.isclose(items.live_node(item).inputs["Anisotropy g"].default_value, 0.5)


def test_the_compositor_is_offered_where_only_suns_shine(scene):
    item = items.add_item(scene, "fog", FOG | {"realisation": "volume"}, "Fog")
    assert items.notes(scene, item) == [items.COMPOSITOR_WOULD_DO]
    scene.collection.objects.link(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT")))
    assert items.notes(scene, item) == []
