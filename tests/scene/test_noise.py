# SPDX-License-Identifier: GPL-3.0-or-later
"""Our noise against Blender's own, evaluated by Geometry Nodes on the same points."""

import numpy as np
import pytest

from volumetrics_addon.scene import noise
from volumetrics_addon.scene.model import NoiseShape

bpy = pytest.importorskip("bpy")


def blender_noise(points, detail, roughness):
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata(points.tolist(), [], [])
    carrier = bpy.data.objects.new("points", mesh)
    bpy.context.scene.collection.objects.link(carrier)
    tree = bpy.data.node_groups.new("noise", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    entry, leave = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    store, texture = tree.nodes.new("GeometryNodeStoreNamedAttribute"), tree.nodes.new("ShaderNodeTexNoise")
    store.inputs["Name"].default_value = "noise"
    for name, value in (("Scale", 1.0), ("Detail", detail), ("Roughness", roughness), ("Lacunarity", 2.0)):
        texture.inputs[name].default_value = value
    tree.links.new(tree.nodes.new("GeometryNodeInputPosition").outputs[0], texture.inputs["Vector"])
    tree.links.new(entry.outputs[0], store.inputs[0])
    tree.links.new(texture.outputs[0], next(s for s in store.inputs if s.name == "Value" and s.enabled))
    tree.links.new(store.outputs[0], leave.inputs[0])
    carrier.modifiers.new("noise", "NODES").node_group = tree
    evaluated = carrier.evaluated_get(bpy.context.evaluated_depsgraph_get())
    values = np.empty(len(points), np.float32)
    evaluated.data.attributes["noise"].data.foreach_get("value", values)
    bpy.data.objects.remove(carrier)
    bpy.data.meshes.remove(mesh)
    bpy.data.node_groups.remove(tree)
    return values


@pytest.mark.parametrize("detail, roughness", [(0.0, 0.5), (4.0, 0.55), (3.5, 0.7), (8.0, 1.0)])
def test_equals_blenders_noise(detail, roughness):
    # Coordinates exact in float32, as Blender holds them; 0.2 float32 ulp of 60 x 2^8 is the finest octave's error.
    points = np.random.default_rng(2).uniform(-60.0, 60.0, (4000, 3)).astype(np.float32)
    ours = noise.fractal_noise(*points.T.astype(float), detail, roughness)
    np.testing.assert_allclose(ours, blender_noise(points, detail, roughness), atol=5e-7)
    assert ours.std() > 0.02


def test_compiled_and_numpy_twins_agree():
    points = np.random.default_rng(4).uniform(-9.0, 9.0, (3, 1000))
    np.testing.assert_allclose(noise.fractal_noise(*points, 3.25, 0.6), noise.numpy_noise(*points, 3.25, 0.6), rtol=1e-13)


def test_density_of_the_smooth_body():
    body = NoiseShape((1.0, 0.0, 0.0), (2.0, 1.0, 1.0), 1.0, 2.0, 0.5, 0.0, 0.5, 0.25, 3)
    # r = 0, 0.375, 0.5, 1 along x: (0.5 - r) / 0.25 clamped
    positions = np.array([[1.0, 0, 0], [1.75, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    np.testing.assert_allclose(noise.density(body, positions), [1.0, 0.5, 0.0, 0.0], atol=1e-12)


def test_seeds_are_exact_in_float32():
    for seed in (1, 17, 4999, 9999):
        step = np.array(noise.SEED_STEP) * seed
        assert (step.astype(np.float32).astype(float) == step).all()
