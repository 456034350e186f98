# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the 3D viewport."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from typing import Any

import bpy

from ..parameters.families import FAMILIES
from ..parameters.model import Parameter, ParameterError
from ..parameters.stage import STAGE
from .properties import ICONS, label, preset_named, values


class VOLUMETRICS_PT_main(bpy.types.Panel):
    bl_idname = "VOLUMETRICS_PT_main"
    bl_label = "Volumetrics"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Volumetrics"

    def draw(self, context: bpy.types.Context) -> None:
        from ..blender import items

        layout = self.layout
        settings = context.window_manager.volumetrics
        preset = preset_named(settings.preset)
        layout.prop(settings, "preset", text="")
        wrapped(layout, preset.description, context)
        row = layout.row()
        row.scale_y = 1.4
        row.operator("volumetrics.add", icon="ADD")
        header, body = layout.panel_prop(settings, "show_parameters")
        header.label(text="Parameters")
        if body:
            chosen = getattr(settings, preset.family)
            current = {parameter.name: getattr(chosen, parameter.name) for parameter in preset.group.parameters}
            for parameter in preset.group.parameters:
                if preset.group.applies(parameter.name, current):
                    _field(body, parameter, chosen, parameter.name)
            _field(body, STAGE["orders"], settings, "orders")
            _derived(body, preset.family, lambda: values(settings))
        for item in items.items(context.scene):
            _item(layout, item)


def wrapped(layout: bpy.types.UILayout, text: str, context: bpy.types.Context) -> None:
    """Text over as many lines as the width of the sidebar asks for; labels do not wrap by themselves."""
    letters = context.region.width / context.preferences.system.ui_scale / 7.0 - 8.0
    column = layout.column(align=True)
    column.active = False
    column.scale_y = 0.8
    for line in textwrap.wrap(text, max(16, int(letters))):
        column.label(text=line)


def _field(layout: bpy.types.UILayout, parameter: Parameter, owner: bpy.types.bpy_struct, name: str) -> None:
    """Label and value in two halves: Blender's own split leaves a label two fifths and cuts the longer ones off."""
    split = layout.split(factor=0.5)
    text = split.column()
    text.alignment = "RIGHT"
    text.label(text=label(parameter))
    split.column().prop(owner, name, text="")


def _item(layout: bpy.types.UILayout, item: bpy.types.Collection) -> None:
    """What was added, folded out into the parameters that stay live, and a button that removes it."""
    from ..blender import items

    family = items.record(item)["family"]
    header, body = layout.panel(f"volumetrics_{item.name}")
    header.label(text=item.name, icon=ICONS[family])
    header.operator("volumetrics.remove", text="", icon="TRASH", emboss=False).item = item.name
    node = items.live_node(item)
    if body and node is not None:
        if items.can_bake(item):
            body.operator("volumetrics.bake", icon="LIGHTPROBE_VOLUME").item = item.name
        shown = items.effective(item)
        for parameter, socket in zip(FAMILIES[family].live, node.inputs):
            if parameter.name in shown:
                _field(body, parameter, socket, "default_value")
        for note in items.notes(bpy.context.scene, item):
            wrapped(body, note, bpy.context)
        _derived(body, family, lambda: items.values_of(item))
        if items.can_bake_light(item):
            body.operator("volumetrics.bake_light", icon="RENDER_STILL").item = item.name


def _derived(layout: bpy.types.UILayout, family: str, values: Callable[[], dict[str, Any]]) -> None:
    """What the handles mean physically, in small grey rows; where a driver has left a value's limits, that."""
    from ..scene import derived

    column = layout.column(align=True)
    column.active = False
    column.scale_y = 0.7
    try:
        quantities = derived.derived(family, values())
    except ParameterError as error:
        column.label(text=str(error), icon="ERROR")
        return
    for quantity in quantities:
        split = column.split(factor=0.62)  # longer words than beside handles, and short numbers
        name = split.column()
        name.alignment = "RIGHT"
        name.label(text=quantity.label)
        split.column().label(text=derived.text(quantity))


CLASSES = (VOLUMETRICS_PT_main,)
