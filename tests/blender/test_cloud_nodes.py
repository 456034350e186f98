# SPDX-License-Identifier: GPL-3.0-or-later
"""The density of a cloud as the engine's nodes have it, against the one that the references integrate."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import build, compat, objects, render  # noqa: E402
from volumetrics_addon.blender.families import cloud  # noqa: E402
from volumetrics_addon.blender.compat import use_nodes  # noqa: E402
from volumetrics_addon.blender.nodes import Tree, add_input, socket_of, socket_value  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.plan.rules import plan  # noqa: E402
from volumetrics_addon.scene import assemble, noise  # noqa: E402
from volumetrics_addon.scene.model import PROFILES, Box, Camera, Scene  # noqa: E402

CLOUD = FAMILIES["cloud"]
SIZE = 24  # pixels


def slice_by_cycles(values, half):
    """The density on the cut y = 0 of a domain at the origin, from an emission shader on a plane: (SIZE, SIZE)."""
    tree = bpy.data.node_groups.new("density", "ShaderNodeTree")
    for parameter in CLOUD.live:
        add_input(tree, parameter)
    inner = Tree(tree)
    entry = inner.node("NodeGroupInput")
    inputs = {parameter.name: entry.outputs[index] for index, parameter in enumerate(CLOUD.live)}
    tree.interface.new_socket("Density", in_out="OUTPUT", socket_type="NodeSocketFloat")
    inner.feed(inner.node("NodeGroupOutput").inputs[0], cloud.noise_density(inner, inputs, values, Box((0, 0, 0), half)))
    material = bpy.data.materials.new("density")
    outer = Tree(use_nodes(material))
    node = outer.node("ShaderNodeGroup", node_tree=tree)
    for index, parameter in enumerate(CLOUD.live):
        node.inputs[index].default_value = socket_value(parameter, values[parameter.name])
    emission = outer.node("ShaderNodeEmission", {"Color": (1, 1, 1, 1), "Strength": node.outputs[0]})
    outer.feed(socket_of(outer.node("ShaderNodeOutputMaterial").inputs, "Surface"), emission.outputs[0])
    scene = Scene(Camera((0.0, -100.0, 0.0), (0.0, 1.0, 0.0), 2 * math.atan(half[0] / 100.0)))
    built = build.build(scene, [], plan(scene, [], "cycles", 1, has_null_scattering=compat.current().volume_biased), "density")
    objects.body(Box((0, 0, 0), (half[0], 0.0, half[2])), "cut", material, built.collection)
    built.camera.data.clip_end, built.camera.data.clip_start = 200.0, 1.0
    built.cycles.pixel_filter_type, built.cycles.filter_width = "GAUSSIAN", 0.01
    built.cycles.use_sample_subset, built.cycles.samples = False, 1  # the first sample, at the centre
    built.render.resolution_x = built.render.resolution_y = SIZE
    return built


@pytest.mark.parametrize("profile", PROFILES)
def test_nodes_equal_the_field(profile, tmp_path):
    half = (9.0, 7.0, 9.0)
    values = CLOUD.check({
        "location": (0.0, 0.0, 0.0), "size": tuple(2 * h for h in half), "domain": "box", "profile": profile, "noise_size": 6.0,
        "noise_detail": 2.5, "noise_strength": 0.6, "fill": 0.7, "softness": 0.8, "billow_size": 5.0, "billow_strength": 0.8,
        "billow_octaves": 3, "billow_roughness": 0.6, "base": 0.2, "stretch": 1.5, "wind": (0.5, 0.25, -0.125), "time": 4.0,
        "evolution": 0.3, "seed": 7})
    with build.temporary():
        built = slice_by_cycles(values, half)
        compat.select_exr(built.render.image_settings)
        built.render.filepath = str(tmp_path / "cut.exr")
        bpy.ops.render.render(write_still=True, scene=built.name)
        image = render.read_image(tmp_path / "cut.exr")[..., 0]
    shape = replace(assemble.ASSEMBLERS["cloud"](values).volumes[0].medium.density, cell_hash=compat.current().cell_hash)
    step = (np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0
    x, z = np.meshgrid(half[0] * step, -half[2] * step)
    expected = noise.density(shape, np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)).reshape(SIZE, SIZE)
    assert expected.std() > 0.1
    # A pixel's ray starts up to 0.01 pixels off its centre; the steepest slope is about 2 over a metre.
    np.testing.assert_allclose(image, expected, atol=0.02)
    assert np.abs(image - expected).mean() < 2e-3


def test_eevee_gets_the_mean_cosine_of_the_droplets():
    from volumetrics_addon.physics.phase import mean_cosine_mie_fit

    diameter = np.geomspace(5.0, 50.0, 50)
    np.testing.assert_allclose(np.polyval(cloud.MIE_MEAN_COSINE, np.log(diameter)), mean_cosine_mie_fit(diameter), atol=2e-4)


def test_droplets_scatter_as_the_reference_says():
    """Single scattering of the sun by homogeneous droplets, at the angle that the camera sees."""
    from volumetrics_addon import verify
    from volumetrics_addon.parameters.preset import Preset
    from volumetrics_addon.parameters.stage import STAGE

    values = CLOUD.check({"location": (0.0, 0.0, 0.0), "size": (4.0, 4.0, 4.0), "domain": "box", "density": "homogeneous",
                          "phase": "mie", "droplet_diameter": 8.0, "extinction": 0.2})
    stage = STAGE.check({"camera_location": [0, -9, 0], "camera_target": [0, 0, 0], "field_of_view": 20, "sun_irradiance": 3.0,
                         "sun_azimuth": 20.0, "sun_elevation": 10.0})
    result = verify.verify(Preset("test", "cloud", "Test", "", values, stage, ()), "cycles", 12, 256, repeats=8,
                           reference_samples=16)
    low, high = result.comparison.mean_relative_interval
    assert -5e-4 < high and low < 5e-4 and high - low < 4e-3
