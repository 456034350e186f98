# SPDX-License-Identifier: GPL-3.0-or-later
"""Add, remove and bake, each one undo step."""

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

        item = _named(self, context)
        if item is None:
            return {"CANCELLED"}
        items.remove_item(context.scene, item)
        return {"FINISHED"}


class VOLUMETRICS_OT_bake(bpy.types.Operator):
    bl_idname = "volumetrics.bake"
    bl_label = "Bake into voxels"
    bl_description = ("Turn the noise as it is now into voxels, which Cycles renders many times sooner; what shapes the cloud is "
                      "fixed then, colour and scattering stay live")
    bl_options = {"REGISTER", "UNDO"}

    item: bpy.props.StringProperty(name="Item", description="Name of the item's collection", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..blender import items

        item = _named(self, context)
        if item is None:
            return {"CANCELLED"}
        try:
            items.bake_item(context.scene, item)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def _named(operator: bpy.types.Operator, context: bpy.types.Context) -> bpy.types.Collection | None:
    """The item that the operator names; reports an error where there is none."""
    from ..blender import items

    for candidate in items.items(context.scene):
        if candidate.name == operator.item:
            return candidate
    operator.report({"ERROR"}, f"the scene has no item named {operator.item!r}; it may have been renamed or removed")
    return None


CLASSES = (VOLUMETRICS_OT_add, VOLUMETRICS_OT_remove, VOLUMETRICS_OT_bake)
