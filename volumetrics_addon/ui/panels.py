# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the 3D viewport."""

from __future__ import annotations

import textwrap

import bpy

from ..parameters import preset as presets
from ..parameters.families import FAMILIES
from .properties import ICONS


class VOLUMETRICS_PT_main(bpy.types.Panel):
    bl_idname = "VOLUMETRICS_PT_main"
    bl_label = "Volumetrics"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Volumetrics"

    def draw(self, context: bpy.types.Context) -> None:
        from ..blender import items

        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.window_manager.volumetrics
        layout.prop(settings, "preset", text="")
        preset = presets.load(settings.preset)
        text = layout.column(align=True)
        text.scale_y = 0.8
        for line in textwrap.wrap(preset.description, max(20, int(context.region.width / 8))):
            text.label(text=line)
        row = layout.row()
        row.scale_y = 1.4
        row.operator("volumetrics.add", icon="ADD")
        if settings.loaded:
            self._parameters(layout, settings, preset)

        present = items.items(context.scene)
        if present:
            layout.separator()
            layout.label(text="In this scene")
        for item in present:
            box = layout.box()
            row = box.row()
            row.label(text=item.name, icon=ICONS[items.record(item)["family"]])
            row.operator("volumetrics.remove", text="", icon="X").item = item.name
            if context.object is not None and context.object.name in item.objects:
                self._live(box, item)

    def _parameters(self, layout: bpy.types.UILayout, settings, preset: presets.Preset) -> None:
        row = layout.row()
        row.use_property_split = False
        row.prop(settings, "show_parameters", emboss=False,
                 icon="DOWNARROW_HLT" if settings.show_parameters else "RIGHTARROW")
        if settings.show_parameters:
            column = layout.column()
            for parameter in FAMILIES[preset.family].parameters:
                column.prop(getattr(settings, preset.family), parameter.name)
            column.prop(settings, "orders")

    def _live(self, layout: bpy.types.UILayout, item: bpy.types.Collection) -> None:
        from ..blender import items

        node = items.live_node(item)
        if node is not None:
            for socket in node.inputs:
                layout.prop(socket, "default_value", text=socket.name)


CLASSES = (VOLUMETRICS_PT_main,)
