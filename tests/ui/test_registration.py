# SPDX-License-Identifier: GPL-3.0-or-later
"""Enabling and disabling leaves no trace, costs no import, and the UI says what the declarations say."""

import json
import math
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

import volumetrics_addon
from volumetrics_addon import ui
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.parameters.stage import STAGE
from volumetrics_addon.ui import glass, operators, panels, properties

ROOT = Path(__file__).resolve().parent.parent.parent
CLASSES = tuple(cls for module in (properties, operators, panels, glass) for cls in module.CLASSES)


def traces():
    """Everything that an add-on could leave behind."""
    collections = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    handlers = [name for name in dir(bpy.app.handlers) if isinstance(getattr(bpy.app.handlers, name), list)]
    assert len(collections) > 30 and len(handlers) > 20
    return {
        "types": set(dir(bpy.types)),
        "panels": {cls.__name__ for cls in bpy.types.Panel.__subclasses__() if cls.is_registered},
        "operators": {cls.__name__ for cls in bpy.types.Operator.__subclasses__() if cls.is_registered},
        "properties": {name: set(getattr(bpy.types, name).bl_rna.properties.keys())
                       for name in ("WindowManager", "Scene", "Object", "Collection", "Material", "Node", "ID")},
        "handlers": {name: list(getattr(bpy.app.handlers, name)) for name in handlers},
        "data": {name: sorted(block.name for block in getattr(bpy.data, name)) for name in collections},
        "keys": {block.name: set(block.keys()) for block in (*bpy.data.window_managers, *bpy.data.scenes)},
        "registered": [cls.is_registered for cls in CLASSES],
        "command": ui._command,
    }


@pytest.fixture
def enabled():
    volumetrics_addon.register()
    yield bpy.context.window_manager.volumetrics
    volumetrics_addon.unregister()


def test_enable_and_disable_twice_leaves_nothing():
    before = traces()
    assert not any(before["registered"]) and before["command"] is None
    for _ in range(2):
        volumetrics_addon.register()
        while_enabled = traces()
        assert all(while_enabled["registered"]) and while_enabled["command"] is not None
        assert "volumetrics" in while_enabled["properties"]["WindowManager"]
        assert "VOLUMETRICS_OT_add" in while_enabled["operators"] - before["operators"]
        assert while_enabled["data"] == before["data"] and while_enabled["handlers"] == before["handlers"]
        volumetrics_addon.unregister()
        assert traces() == before


def test_disabling_forgets_what_the_panel_held():
    before = traces()
    volumetrics_addon.register()
    settings = bpy.context.window_manager.volumetrics
    settings.preset = "cumulus"
    settings.cloud.extinction = 0.125
    volumetrics_addon.unregister()
    assert traces() == before
    volumetrics_addon.register()
    settings = bpy.context.window_manager.volumetrics
    assert not settings.loaded and settings.cloud.extinction != 0.125
    volumetrics_addon.unregister()


def test_a_failing_registration_is_not_hidden(monkeypatch):
    volumetrics_addon.register()
    try:
        with pytest.raises(ValueError):
            volumetrics_addon.register()
    finally:
        volumetrics_addon.unregister()


def test_registering_imports_declarations_only():
    code = """
import sys, json, bpy
before = set(sys.modules)
import volumetrics_addon
imported = sorted(set(sys.modules) - before)
volumetrics_addon.register()
print("RESULT" + json.dumps([imported, sorted(set(sys.modules) - before)]))
volumetrics_addon.unregister()
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    imported, registered = json.loads(done.stdout.partition("RESULT")[2])
    assert imported == ["volumetrics_addon"]
    assert not {name.partition(".")[0] for name in registered} & {"numpy", "numba", "scipy", "bmesh", "argparse"}
    mine = [name.removeprefix("volumetrics_addon.") for name in registered if name.startswith("volumetrics_addon.")]
    assert {"ui", "ui.panels", "parameters.families"} <= set(mine)
    declared = {"plan", "plan.catalogue", "plan.model"}
    assert all(name.startswith(("ui", "parameters")) or name in declared for name in mine), mine


# --- what the UI shows -----------------------------------------------------------------------------------------


MIRRORED = [pytest.param(family, parameter, id=f"{family}.{parameter.name}")
            for family, group in FAMILIES.items() for parameter in group.parameters]


@pytest.mark.parametrize(("family", "parameter"), [*MIRRORED, pytest.param(None, STAGE["orders"], id="orders")])
def test_property_mirrors_its_declaration(enabled, family, parameter):
    owner = getattr(enabled, family) if family else enabled
    shown = owner.bl_rna.properties[parameter.name]
    assert shown.name.startswith(parameter.label)
    assert shown.description == parameter.description.removesuffix(".")  # Blender writes the full stop
    native = {"m": "LENGTH", "deg": "ROTATION", "W": "POWER", "m/s": "VELOCITY"}  # the others are written into the label
    assert (parameter.unit in native) == (shown.unit in native.values())
    assert parameter.unit in native or shown.name.endswith(f"({parameter.unit})" if parameter.unit else parameter.label)
    factor = math.radians(1.0) if parameter.unit == "deg" else 1.0
    value = getattr(owner, parameter.name)
    match parameter.kind:
        case "choice":
            assert [(item.identifier, item.name) for item in shown.enum_items] == list(parameter.choices)
            assert value == parameter.default
        case "bool":
            assert value is parameter.default
        case "path":
            # Blender counts the end of the text too.
            assert (value, shown.subtype, shown.length_max) == (parameter.default, "FILE_PATH", parameter.maximum + 1)
        case _:
            low, high = parameter.soft_range
            limits = (shown.hard_min, shown.hard_max, shown.soft_min, shown.soft_max)
            declared = np.array((parameter.minimum, parameter.maximum, low, high))
            assert np.allclose(limits, factor * declared, rtol=1e-6, atol=0.0)
            assert np.allclose(np.array(value), factor * np.array(parameter.default), rtol=1e-6, atol=0.0)
            assert not parameter.unit or shown.unit == native.get(parameter.unit, "NONE")
            if parameter.kind == "color":
                assert shown.subtype == "COLOR"


def test_every_parameter_is_mirrored(enabled):
    assert len(MIRRORED) >= 45
    for family, group in FAMILIES.items():
        shown = [name for name in getattr(enabled, family).bl_rna.properties.keys() if name not in ("rna_type", "name")]
        assert shown == [parameter.name for parameter in group.parameters]


def test_preset_menu_lists_every_preset_by_family(enabled):
    items = properties._preset_items()
    assert sorted(item[0] for item in items) == names()
    families = [load(item[0]).family for item in items]
    assert families == sorted(families, key=list(FAMILIES).index)
    icons = set(bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys())
    for index, (name, label, description, icon, number) in enumerate(items):
        assert (label, description, number) == (load(name).label, load(name).description, index)
        assert icon in icons


@pytest.mark.parametrize("name", names())
def test_choosing_a_preset_fills_in_its_values(enabled, name):
    """The values come back as they were written, although a property holds a float32."""
    preset = load(name)
    enabled.preset = name
    assert enabled.loaded and enabled.orders == preset.stage["orders"]
    read = preset.group.check(properties.values(enabled))
    for key, value in preset.parameters.items():
        if isinstance(value, (float, tuple)):
            assert np.allclose(read[key], value, rtol=1e-7, atol=0.0), key
        else:
            assert read[key] == value, key


@pytest.mark.parametrize(("family", "parameter"), MIRRORED)
def test_a_slider_at_its_end_is_allowed(enabled, family, parameter):
    """float32(0.999) lies above 0.999, and float32(1e-6) below 1e-6."""
    if parameter.kind in ("bool", "choice", "path"):
        return
    enabled.preset = next(name for name in names() if load(name).family == family)
    owner = getattr(enabled, family)
    for limit in (parameter.minimum, parameter.maximum):
        end = int(limit) if parameter.kind == "int" else limit
        stored = math.radians(end) if parameter.unit == "deg" else end
        setattr(owner, parameter.name, stored if parameter.kind in ("int", "float") else (stored,) * 3)
        read = properties.values(enabled)[parameter.name]
        assert parameter.check(read) == read and np.all(np.array(read) == end)


def test_unfolding_the_parameters_loads_the_preset(enabled, capfd):
    first = load(enabled.preset)
    assert not enabled.loaded
    enabled.show_parameters = True
    assert enabled.loaded
    assert first.group.check(properties.values(enabled)) == first.parameters
    getattr(enabled, first.family).location = (1.0, 2.0, 3.0)
    enabled.show_parameters = False
    enabled.show_parameters = True  # what was changed stays
    assert properties.values(enabled)["location"] == (1.0, 2.0, 3.0)
    assert capfd.readouterr().err == ""  # where Blender writes what goes wrong in a callback


def test_operators_are_undo_steps_with_words(enabled):
    ours = [cls for cls in CLASSES if issubclass(cls, bpy.types.Operator)]
    assert len(ours) >= len(operators.CLASSES) + 3
    for cls in ours:
        assert {"REGISTER", "UNDO"} <= cls.bl_options
        assert cls.bl_label and cls.bl_description
        registered = getattr(bpy.ops.volumetrics, cls.bl_idname.partition(".")[2]).get_rna_type()
        assert (registered.name, registered.description) == (cls.bl_label, cls.bl_description)


def test_panel_stands_in_the_sidebar(enabled):
    (panel,) = panels.CLASSES
    assert (panel.bl_space_type, panel.bl_region_type, panel.bl_category) == ("VIEW_3D", "UI", "Volumetrics")
