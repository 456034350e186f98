# SPDX-License-Identifier: GPL-3.0-or-later
"""Our noise against Blender's own, evaluated by Geometry Nodes on the same points."""

from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.scene import noise
from volumetrics_addon.scene.model import CELL_HASHES, PROFILES, Dust, NoiseShape

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import compat  # noqa: E402


def evaluated_by_blender(points, texture, **inputs):
    """The first output of a texture node at the points (n, 3)."""
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata(points.tolist(), [], [])
    carrier = bpy.data.objects.new("points", mesh)
    bpy.context.scene.collection.objects.link(carrier)
    tree = bpy.data.node_groups.new("noise", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    entry, leave = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    store, texture = tree.nodes.new("GeometryNodeStoreNamedAttribute"), tree.nodes.new(texture)
    store.inputs["Name"].default_value = "noise"
    for name, value in inputs.items():
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
    theirs = evaluated_by_blender(points, "ShaderNodeTexNoise", Scale=1.0, Detail=detail, Roughness=roughness, Lacunarity=2.0)
    np.testing.assert_allclose(ours, theirs, atol=5e-7)
    assert ours.std() > 0.02


def test_billows_equal_blenders_cells():
    """The margin of a body without noise is fill - r + 0.37 - F1^2 in units of the softness."""
    points = np.random.default_rng(3).uniform(-60.0, 60.0, (4000, 3)).astype(np.float32)
    body = NoiseShape((0.0, 0.0, 0.0), (100.0, 100.0, 100.0), 1.0, 0.0, 0.5, 0.0, 0.5, 0.25, 0, billow_strength=1.0,
                      billow_octaves=1, billow_size=1.0, cell_hash=compat.current().cell_hash)
    distance = evaluated_by_blender(points, "ShaderNodeTexVoronoi", Scale=1.0, Randomness=1.0).astype(float)
    expected = (0.5 - np.linalg.norm(points / 100.0, axis=1) + 0.37 - distance**2) / 0.25
    # Offsets from coordinates of 60 have 60 x 6e-8 = 4e-6 of float32's rounding, times 2 F1 / softness.
    np.testing.assert_allclose(noise.margin(body, points), expected, atol=5e-5)
    assert 0.3 < (distance**2).mean() < 0.4 and distance.std() > 0.1


@pytest.mark.parametrize("profile, inside, edge", [
    ("round", (0, 0, 0), (0.6, 0, 0.8)), ("dome", (0, 0, -1), (0.6, 0, 0.6)), ("tower", (0, 0, -1), (0, 0, 1)),
    ("anvil", (0, 0, -1), (0.6, 0, -1)), ("anvil", (0, 0, 0.6), (0.6, 0, 0.6 + 0.32)), ("layer", (0, 0, 0), (0, 0, 1))])
def test_profiles(profile, inside, edge):
    """Their distances are 0 in the middle and 1 at the edge, where the margin is fill - 1 over the softness."""
    body = NoiseShape((1.0, 2.0, 3.0), (10.0, 20.0, 30.0), 1.0, 0.0, 0.5, 0.0, 0.75, 0.25, 0, profile=profile)
    positions = np.array([inside, edge]) * body.half + body.center
    np.testing.assert_allclose(noise.margin(body, positions), (3.0, -1.0), atol=1e-12)
    # However much is filled, nothing is left at the edge.
    np.testing.assert_allclose(noise.margin(replace(body, fill=9.0), positions), (4.0, 0.0), atol=1e-12)


def test_a_flat_base_is_a_smoothstep():
    body = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 5.0), 1.0, 0.0, 0.5, 0.0, 2.0, 0.1, 0, base=0.2)
    z = np.array([-5.0, -4.5, -4.0, -3.0, 0.0])  # heights of 0, 0.05, 0.1, 0.2 and 0.5 of the domain's
    np.testing.assert_allclose(noise.density(body, np.stack([0 * z, 0 * z, z], axis=1)), [0, 0.15625, 0.5, 1, 1], atol=1e-12)


def test_wind_carries_the_noise_and_evolution_parts_it():
    body = NoiseShape((0.0, 0.0, 0.0), (1e9, 1e9, 1e9), 2.0, 3.0, 0.5, 1.0, 0.5, 1.0, 4, billow_strength=0.7, billow_octaves=2,
                      billow_size=3.0)
    points = np.random.default_rng(6).uniform(-9.0, 9.0, (500, 3))
    shift = np.array((1.5, -2.0, 0.25))
    still = noise.margin(body, points)
    np.testing.assert_allclose(noise.margin(replace(body, drift=tuple(shift)), points + shift), still, atol=1e-6)
    np.testing.assert_allclose(noise.margin(replace(body, stretch=4.0), points * (4, 1, 1)), still, atol=1e-6)
    older = replace(body, evolution=0.4)
    perlin = replace(older, billow_octaves=0), replace(body, billow_octaves=0)
    np.testing.assert_allclose(noise.margin(perlin[0], points + (0, 0, 0.8)), noise.margin(perlin[1], points), atol=1e-6)
    billows = replace(older, noise_strength=0.0), replace(body, noise_strength=0.0)
    np.testing.assert_allclose(noise.margin(billows[0], points + (0, 0, 3.0)), noise.margin(billows[1], points), atol=1e-6)


SHAPES = {profile: NoiseShape((1.0, 0.0, 0.0), (9.0, 7.0, 5.0), 3.0, 2.5, 0.5, 0.6, 0.7, 0.1, 3, profile=profile,
                              billow_size=2.0, billow_strength=0.8, billow_octaves=3, base=0.05, evolution=0.3,
                              drift=(3.0, 4.0, 5.0), stretch=1.5) for profile in PROFILES}


@pytest.mark.parametrize("cell_hash", CELL_HASHES)
@pytest.mark.parametrize("profile", PROFILES)
def test_compiled_and_numpy_shapes_agree(profile, cell_hash):
    points = np.random.default_rng(5).uniform(-9.0, 9.0, (1000, 3))
    shape = replace(SHAPES[profile], cell_hash=cell_hash)
    density = noise.density(shape, points)
    plain = noise.numpy_evaluator()[2](np.array(noise.numbers(shape)), points)
    np.testing.assert_allclose(density, plain, rtol=1e-12, atol=1e-13)
    assert 0.02 < density.mean() < 0.9 and density.min() == 0.0 and density.max() == 1.0


def test_compiled_and_numpy_twins_agree():
    points = np.random.default_rng(4).uniform(-9.0, 9.0, (3, 1000))
    np.testing.assert_allclose(noise.fractal_noise(*points, 3.25, 0.6), noise.numpy_evaluator()[0](*points, 3.25, 0.6), rtol=1e-13)


def test_density_of_the_smooth_body():
    body = NoiseShape((1.0, 0.0, 0.0), (2.0, 1.0, 1.0), 1.0, 2.0, 0.5, 0.0, 0.5, 0.25, 3)
    # r = 0, 0.375, 0.5, 1 along x: (0.5 - r) / 0.25 clamped
    positions = np.array([[1.0, 0, 0], [1.75, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    np.testing.assert_allclose(noise.density(body, positions), [1.0, 0.5, 0.0, 0.0], atol=1e-12)


def test_seeds_are_exact_in_float32():
    for seed in (1, 17, 4999, 9999):
        step = np.array(noise.SEED_STEP) * seed
        assert (step.astype(np.float32).astype(float) == step).all()


@pytest.mark.parametrize("strength", [0.5, 1.0, 3.0])
def test_dust_is_blenders_noise(strength):
    """max(0, 1 + strength (2 n - 1)) of the engines' own noise at the drifted, scaled and shifted points."""
    points = np.random.default_rng(9).uniform(-9.0, 9.0, (4000, 3))
    dust = Dust(strength, 0.5, 7, (3.0, -1.0, 0.25))
    moved = ((points - (3.0, -1.0, 0.25)) / 0.5 + np.mod(7 * np.array((13.25, 78.5, 37.75)), 100.0)).astype(np.float32)
    n = evaluated_by_blender(moved, "ShaderNodeTexNoise", Scale=1.0, Detail=2.0, Roughness=0.5, Lacunarity=2.0).astype(float)
    expected = np.maximum(0.0, 1.0 + strength * (2.0 * n - 1.0))
    density = noise.dust_density(dust, points)
    # Coordinates up to 140 in float32: an error of 8e-6 in each, times slopes of the noise up to 4.
    np.testing.assert_allclose(density, expected, atol=strength * 1e-4)
    assert 0.0 <= density.min() and density.max() <= dust.largest and density.std() > 0.1 * strength
    if strength <= 1.0:
        assert density.mean() == pytest.approx(1.0, abs=0.05)


def test_compiled_and_numpy_dust_agree():
    dust, points = Dust(2.0, 0.7, 3, (1.0, 2.0, 3.0)), np.random.default_rng(5).uniform(-9.0, 9.0, (500, 3))
    formula = noise.implementation(lambda function: function)[3]
    expected = formula(np.array(noise.dust_numbers(dust)), 0, *points.T)
    np.testing.assert_allclose(noise.dust_density(dust, points), expected, rtol=1e-9, atol=1e-12)
