# SPDX-License-Identifier: GPL-3.0-or-later
"""Add and remove, each one undo step."""

import bpy


class VOLUMETRICS_OT_add(bpy.types.Operator):
    bl_idname = "volumetrics.add"
    bl_label = "Add preset"
    bl_description = "Add the preset at the 3D cursor; fog is fitted to the scene and its camera"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..blender import items
        from . import properties

        settings = context.window_manager.volumetrics
        if not settings.loaded:
            properties.load_preset(settings)
        preset = properties.preset_named(settings.preset)
        try:
            item = items.add_item(context.scene, preset.family, properties.values(settings), preset.label, settings.orders,
                                  tuple(context.scene.cursor.location))
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for selected in list(context.view_layer.objects.selected):
            selected.select_set(False)
        for added in item.objects:
            added.select_set(True)
        context.view_layer.objects.active = item.objects[0]
        return {"FINISHED"}


class VOLUMETRICS_OT_remove(bpy.types.Operator):
    bl_idname = "volumetrics.remove"
    bl_label = "Remove"
    bl_description = "Remove what was added and bring back the settings it changed"
    bl_options = {"REGISTER", "UNDO"}

    item: bpy.props.StringProperty(name="Item", description="Name of the item's collection", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..blender import items

        for candidate in items.items(context.scene):
            if candidate.name == self.item:
                items.remove_item(context.scene, candidate)
                return {"FINISHED"}
        self.report({"ERROR"}, f"the scene has no item named {self.item!r}; it may have been renamed or removed")
        return {"CANCELLED"}


CLASSES = (VOLUMETRICS_OT_add, VOLUMETRICS_OT_remove)
