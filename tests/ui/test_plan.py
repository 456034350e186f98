# SPDX-License-Identifier: GPL-3.0-or-later
"""Savings found, switched, applied and brought back from the panel."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest

from volumetrics_addon.bench import usual
from volumetrics_addon.blender import compat, pilot, tuning
from volumetrics_addon.ui.plan import VOLUMETRICS_PT_plan


@pytest.fixture
def state(extension):
    bpy.ops.wm.read_factory_settings()
    scene = bpy.context.scene
    scene.render.engine, scene.frame_end = "CYCLES", 24
    material = bpy.data.materials.new("haze")
    tree = compat.use_nodes(material)
    shader, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    bpy.data.objects["Cube"].material_slots[0].material = material
    scene.cycles.volume_bounces = 100
    state = bpy.context.window_manager.volumetrics_plan
    state.advice.clear()
    state.property_unset("error")
    state.property_unset("pilot")
    yield state
    state.advice.clear()


def drawn():
    """The settings of the panel itself."""
    return [call.args[1] for call in draw().prop.call_args_list]


def labels():
    layout = draw()
    box = layout.box.return_value
    return ([call.kwargs["text"] for call in box.prop.call_args_list],
            " ".join(call.kwargs["text"] for call in box.column.return_value.label.call_args_list))


def draw():
    layout = MagicMock()
    context = SimpleNamespace(window_manager=bpy.context.window_manager, scene=bpy.context.scene, preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
                              region=SimpleNamespace(width=400))
    VOLUMETRICS_PT_plan.draw(SimpleNamespace(layout=layout), context)
    return layout


def test_finding_changes_nothing_and_lists_the_rules(state):
    scene = bpy.context.scene
    assert labels() == ([], "")
    assert bpy.ops.volumetrics.plan() == {"FINISHED"}
    assert [entry.name for entry in state.advice] == ["bounces", "sampling", "light tree", "persistent data"]
    names, words = labels()
    assert names == ["Bounces", "Sampling", "Light tree", "Persistent data"]
    assert "changes 0.0" in words and "same picture" in words and "instead of 100: of the light" in words
    assert scene.cycles.volume_bounces == 100 and not tuning.is_applied(scene)


def test_a_pilot_is_rendered_where_it_is_asked_for(state, monkeypatch):
    """With the pilot a noise threshold is found, applied and brought back; applying takes what finding has measured, unless the scene
    has changed. Both engines have pilots."""
    measured, measure = [], pilot.measure
    monkeypatch.setattr(pilot, "measure", lambda *arguments: measured.append(arguments) or measure(*arguments))
    usual.by_name("spot-haze").build()
    scene, state = bpy.context.scene, bpy.context.window_manager.volumetrics_plan
    scene.render.engine, scene.cycles.samples = "CYCLES", 256
    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    assert "pilot" in drawn()
    for wanted in (False, True):
        state.pilot = wanted
        assert bpy.ops.volumetrics.plan() == {"FINISHED"}
        assert ("noise threshold" in state.advice) == wanted
    assert scene.cycles.adaptive_threshold == pytest.approx(0.01)
    assert bpy.ops.volumetrics.plan_apply() == {"FINISHED"} and scene.cycles.adaptive_threshold > 0.0105
    assert bpy.ops.volumetrics.plan_apply() == {"FINISHED"} and len(measured) == 1
    assert bpy.ops.volumetrics.plan_restore() == {"FINISHED"}
    assert scene.cycles.adaptive_threshold == pytest.approx(0.01)
    next(lamp for lamp in scene.objects if lamp.type == "LIGHT").location.x += 0.1
    assert bpy.ops.volumetrics.plan_apply() == {"FINISHED"} and len(measured) == 2
    scene.render.engine = compat.current().eevee
    assert "pilot" in drawn()


def test_rules_switched_off_stay_off(state):
    scene = bpy.context.scene
    bpy.ops.volumetrics.plan()
    state.advice["light tree"].use = False
    assert bpy.ops.volumetrics.plan_apply() == {"FINISHED"}
    assert scene.cycles.use_light_tree and scene.cycles.volume_bounces < 100 and scene.render.use_persistent_data
    assert not state.advice["light tree"].use
    assert bpy.ops.volumetrics.plan_restore() == {"FINISHED"}
    assert scene.cycles.volume_bounces == 100 and not scene.render.use_persistent_data
    assert not bpy.ops.volumetrics.plan_restore.poll()


def test_applying_twice_keeps_the_users_values(state):
    scene = bpy.context.scene
    bpy.ops.volumetrics.plan_apply()
    few = scene.cycles.volume_bounces
    state.error = 20.0
    bpy.ops.volumetrics.plan_apply()
    assert scene.cycles.volume_bounces < few
    bpy.ops.volumetrics.plan_restore()
    assert scene.cycles.volume_bounces == 100


def test_one_step_undoes_it(state):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.volumetrics.plan_apply()
    bpy.ops.ed.undo_push(message="plan")
    assert tuning.is_applied(bpy.context.scene)
    bpy.ops.ed.undo()
    assert not tuning.is_applied(bpy.context.scene) and bpy.context.scene.cycles.volume_bounces == 100


def test_another_engine_is_refused(state):
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
    for operator in (bpy.ops.volumetrics.plan, bpy.ops.volumetrics.plan_apply):
        with pytest.raises(RuntimeError, match="has no samples"):
            operator()


def test_all_rules_switched_off_change_nothing(state):
    bpy.ops.volumetrics.plan()
    for entry in state.advice:
        entry.use = False
    bpy.context.scene.cycles.volume_bounces = 50
    assert bpy.ops.volumetrics.plan_apply() == {"FINISHED"}
    assert bpy.context.scene.cycles.volume_bounces == 50
    assert not tuning.is_applied(bpy.context.scene)
