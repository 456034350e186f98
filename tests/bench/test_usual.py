# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of users build and render in both engines, and keep Blender's start-up settings."""

import bpy
import numpy as np
import pytest

from volumetrics_addon.bench import usual
from volumetrics_addon.blender import compat, render

NAMES = [scene.name for scene in usual.SCENES]
BOUNCES = {"max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces"}


def settings(block):
    return {p.identifier: getattr(block, p.identifier) for p in block.bl_rna.properties
            if p.type in ("BOOLEAN", "INT", "FLOAT", "ENUM", "STRING") and not getattr(p, "is_array", False)}


def shown(name, engine, size=(16, 9)):
    scene = usual.by_name(name).build()
    scene.render.engine = engine
    scene.cycles.samples = scene.eevee.taa_render_samples = 1
    scene.cycles.use_denoising = False
    return scene, lambda: render.render_built(scene, *size)[0]


def test_there_are_a_dozen_and_more():
    assert len(NAMES) >= 12 and len(set(NAMES)) == len(NAMES)
    assert all(scene.title and scene.fill.__doc__ for scene in usual.SCENES)
    with pytest.raises(ValueError, match="no scene 'fog'; the scenes are foggy-street"):
        usual.by_name("fog")


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_keeps_the_settings_of_the_start_up_file(name):
    """Whatever the plan gains, it gains over what Blender starts with: only bounces are set, as tutorials do."""
    bpy.ops.wm.read_factory_settings(use_empty=False)
    start = {kind: settings(getattr(bpy.context.scene, kind)) for kind in ("cycles", "eevee")}
    assert len(start["cycles"]) > 80 and len(start["eevee"]) > 25
    scene = usual.by_name(name).build()
    for kind, values in start.items():
        changed = {key for key, value in settings(getattr(scene, kind)).items() if value != values[key]}
        assert changed <= BOUNCES, changed
    trees = [slot.material.node_tree for o in scene.objects for slot in o.material_slots] + [scene.world.node_tree]
    assert any("Volume" in node.bl_idname for tree in trees for node in tree.nodes)


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_renders_in_cycles(name):
    scene, picture = shown(name, "CYCLES")
    if compat.current().volume_biased:
        scene.cycles.volume_biased = True  # the octrees of null-scattering take ten seconds
    seen = picture()
    assert np.isfinite(seen).all() and 1e-3 < seen.mean() < 5.0
    assert seen.std() > 0.02 * seen.mean()  # something is to be seen


@pytest.mark.sweep
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("engine", ["CYCLES", "EEVEE"])
def test_a_scene_renders_as_it_is(name, engine):
    _, picture = shown(name, engine if engine == "CYCLES" else compat.current().eevee, (48, 27))
    seen = picture()
    assert np.isfinite(seen).all() and 1e-3 < seen.mean() < 5.0
    assert seen.std() > 0.02 * seen.mean()


def test_building_again_gives_the_same_scene():
    def placed():
        scene = usual.by_name("ruins").build()
        return {o.name: tuple(map(tuple, o.matrix_world)) for o in scene.objects}
    assert placed() == placed()
