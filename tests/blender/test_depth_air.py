# SPDX-License-Identifier: GPL-3.0-or-later
"""Air in the compositor: its nodes against the formulas, under its own sky and before a user's."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import compat, items, render  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.reference import depth_air  # noqa: E402
from volumetrics_addon.scene import geometry  # noqa: E402


@pytest.mark.either
@pytest.mark.parametrize("name", ("clear-noon", "clear-sunset"))
@pytest.mark.parametrize("parameters", ({}, {"mie_extinction": 0.3, "base_height": 40.0, "rayleigh_scale_height": 7000.0}),
                         ids=("clear", "hazy"))
def test_nodes_follow_the_formula(name, parameters):
    """Looking up, nothing is sampled: one sample of Cycles is the formula at the centre of each pixel."""
    preset = load(name).changed({"realisation": "compositor", **parameters}, {"camera_target": [0.0, 1000.0, 900.0]})
    scene = verify.scene_of(preset)
    shown = render.render(preset, scene, "cycles", 12, 8, 1)
    assert shown.plan.compositor_fog
    expected = depth_air.render(scene, 12, 8, repeats=2, strata=0).image
    assert shown.images[0] == pytest.approx(expected, rel=2e-4)


@pytest.mark.either
def test_ground_in_both_engines():
    preset = load("clear-noon").changed({"realisation": "compositor"}, {"camera_target": [0.0, 1000.0, -1000.0], "field_of_view": 30.0})
    scene = verify.scene_of(preset)
    expected = depth_air.render(scene, 12, 8, strata=4).image
    for engine, samples in (("cycles", 64), ("eevee", 8)):
        assert render.render(preset, scene, engine, 12, 8, samples).images[0] == pytest.approx(expected, rel=0.03)


def test_eevee_composites_clear_air_by_itself():
    scene = verify.scene_of(load("clear-noon"), "eevee")
    assert scene.depth_fog is not None and verify.scene_of(load("clear-noon"), "cycles").depth_fog is None
    assert "8 slices" in verify.explain(scene, "eevee", load("clear-noon"))[0]


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, 0.0, 30.0), (1.5707963, 0.0, 0.0)
    camera.data.clip_end = 1e6
    scene.collection.objects.link(camera)
    scene.camera = camera
    wall = bpy.data.meshes.new("Wall")
    wall.from_pydata([(-1e5, 2e4, -1e5), (1e5, 2e4, -1e5), (1e5, 2e4, 3e3), (-1e5, 2e4, 3e3)], [], [(0, 1, 2, 3)])
    black = bpy.data.materials.new("Black")
    tree = compat.use_nodes(black)
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 0.0
    tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    wall.materials.append(black)
    scene.collection.objects.link(bpy.data.objects.new("Wall", wall))
    world = bpy.data.worlds.new("World")
    tree = compat.use_nodes(world)
    background = tree.nodes.new("ShaderNodeBackground")
    background.inputs["Color"].default_value = (0.2, 0.4, 0.6, 1.0)
    tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs[0])
    scene.world = world
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    return scene


def add_sun(scene):
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler, sun.data.energy = (0.7, 0.0, 0.3), 1.2
    scene.collection.objects.link(sun)
    return sun


@pytest.mark.either
def test_a_users_sky_stays_and_mountains_turn_blue(scene):
    sun = add_sun(scene)
    item = items.add_item(scene, "air", load("clear-noon").parameters | {"realisation": "compositor"}, "Air", orders=8)
    assert not item.objects
    image = render.render_built(scene, 4, 4)[0]
    assert image[0] == pytest.approx(np.tile((0.2, 0.4, 0.6), (4, 1)), rel=1e-4)
    # The wall: the formula for the lamp's light above the air, along the same rays.
    preset = load("clear-noon").changed({}, {"camera_location": [0, 0, 30], "camera_target": [0, 100, 30], "sun_elevation": 45.0})
    truth = verify.scene_of(preset)
    direction = tuple(-c for c in (sun.matrix_world.col[2][:3]))
    truth = type(truth)(truth.camera, (type(truth.lights[0])(direction, (1.0, 1.0, 1.0)),), volumes=truth.volumes,
                        surfaces=truth.surfaces, orders=8)
    view = depth_air.view_of(truth)
    closure = depth_air.closure_of(view.planet, 8, 1.0)
    lost = np.exp(depth_air.sun_depth(view.planet, np.zeros(1), np.array([-direction[2]]))[0])
    camera = type(truth.camera)((0.0, 0.0, 30.0), (0.0, 1.0, 0.0), scene.camera.data.angle_x)
    origin, rays = geometry.camera_rays(camera, 4, 4, np.array([0.5, 2.5]), np.array([3.5, 1.5]))
    light, _ = depth_air.march(truth, view, closure, origin, rays, 2e4 / rays[:, 1], depth_air.SLICES)
    expected = light * 1.2 * lost
    assert image[[3, 1], [0, 2]] == pytest.approx(expected, rel=2e-3)
    items.remove_item(scene, item)
    assert compat.present_compositing_tree(scene) is None


def test_air_needs_one_sun(scene):
    with pytest.raises(ValueError, match="the compositor's air has one sun, and the scene has 0; add a sun"):
        items.add_item(scene, "air", {"realisation": "compositor"}, "Air")
    assert not items.items(scene)
