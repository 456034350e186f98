# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass on a mesh of the user's own, from the panel."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest

import volumetrics_addon
from volumetrics_addon.blender import chords, items, mesh_glass
from volumetrics_addon.ui.glass import VOLUMETRICS_PT_glass


@pytest.fixture
def panel():
    volumetrics_addon.register()
    bpy.ops.wm.read_factory_settings()  # a cube, active
    panel = bpy.context.window_manager.volumetrics
    panel.preset = "amber-bottle"
    yield panel
    bpy.ops.wm.read_factory_settings()
    volumetrics_addon.unregister()


def buttons():
    """Names of the operators that the panel shows for the active object, and how many values."""
    layout = MagicMock()
    VOLUMETRICS_PT_glass.draw(SimpleNamespace(layout=layout), bpy.context)
    return [call.args[0] for call in layout.operator.call_args_list], layout.split.call_count


def test_put_on_measured_and_taken_away(panel):
    cube = bpy.context.object
    former = cube.active_material
    assert buttons() == (["volumetrics.glass_apply"], 0)
    assert bpy.ops.volumetrics.glass_apply() == {"FINISHED"}
    assert mesh_glass.has_glass(cube) and items.record(cube)["values"]["swatch"] == "amber"
    assert buttons() == (["volumetrics.glass_apply", "volumetrics.glass_measure", "volumetrics.glass_remove"], 2)  # strength, IOR
    assert bpy.ops.volumetrics.glass_measure() == {"FINISHED"}
    assert bpy.ops.volumetrics.glass_remove() == {"FINISHED"}
    assert cube.active_material == former and not mesh_glass.has_glass(cube) and buttons()[0] == ["volumetrics.glass_apply"]


def test_a_pane_on_a_plane(panel):
    panel.preset = "stained-glass"
    bpy.ops.mesh.primitive_plane_add()
    assert bpy.ops.volumetrics.glass_apply() == {"FINISHED"}
    assert "volumetrics.glass_measure" not in buttons()[0]
    names = [socket.name for socket in items.live_node_of([bpy.context.object]).inputs]
    assert "Coverage" in names and buttons()[1] == 7  # colour, distance, strength, IOR, coverage and its colour, variation


def test_errors_are_told(panel):
    with pytest.raises(RuntimeError, match="not of glass"):
        bpy.ops.volumetrics.glass_remove()
    with pytest.raises(RuntimeError, match="nothing to measure"):
        bpy.ops.volumetrics.glass_measure()
    bpy.ops.mesh.primitive_plane_add()
    with pytest.raises(RuntimeError, match="not watertight: 4 of its 4 edges"):
        bpy.ops.volumetrics.glass_apply()
    panel.preset = "cumulus"
    assert not bpy.ops.volumetrics.glass_apply.poll()


def test_undo_takes_all_of_it_back(panel):
    """Materials, attributes and what the object remembers are one state of the file."""
    former = bpy.context.object.active_material.name
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.volumetrics.glass_apply() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="glass")
    bpy.ops.ed.undo()
    cube = bpy.data.objects["Cube"]
    assert cube.active_material.name == former and not cube.keys() and chords.LENGTH not in cube.data.attributes
    bpy.ops.ed.redo()
    cube = bpy.data.objects["Cube"]
    assert mesh_glass.has_glass(cube) and chords.LENGTH in cube.data.attributes
