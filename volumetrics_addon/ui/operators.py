# SPDX-License-Identifier: GPL-3.0-or-later
"""Add, remove and bake, each one undo step."""

from __future__ import annotations

import bpy


class UndoStep:
    """An operator that acts in one undo step, and tells what it refuses."""

    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.act(context)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


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
        for text in items.warnings(context.scene, item):
            self.report({"WARNING"}, text)
        if item.objects:  # fog in the compositor has none
            for selected in list(context.view_layer.objects.selected):
                selected.select_set(False)
            for added in item.objects:
                added.select_set(True)
            context.view_layer.objects.active = item.objects[0]
        return {"FINISHED"}


class _OfItem:
    """An operator on one item of the scene, by the name of its collection."""

    bl_options = {"REGISTER", "UNDO"}

    item: bpy.props.StringProperty(name="Item", description="Name of the item's collection", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..blender import items

        for candidate in items.items(context.scene):
            if candidate.name == self.item:
                try:
                    warnings = self.act(context.scene, candidate) or ()
                except ValueError as error:
                    self.report({"ERROR"}, str(error))
                    return {"CANCELLED"}
                for warning in warnings:
                    self.report({"WARNING"}, warning)
                return {"FINISHED"}
        self.report({"ERROR"}, f"the scene has no item named {self.item!r}; it may have been renamed or removed")
        return {"CANCELLED"}


class VOLUMETRICS_OT_remove(_OfItem, bpy.types.Operator):
    bl_idname = "volumetrics.remove"
    bl_label = "Remove"
    bl_description = "Remove what was added and bring back the settings it changed"

    def act(self, scene: bpy.types.Scene, item: bpy.types.Collection) -> None:
        from ..blender import items

        items.remove_item(scene, item)


class VOLUMETRICS_OT_bake(_OfItem, bpy.types.Operator):
    bl_idname = "volumetrics.bake"
    bl_label = "Bake into voxels"
    bl_description = ("Turn the noise as it is now into voxels, which Cycles renders sooner; what shapes the cloud is fixed then, "
                      "colour and scattering stay live")

    def act(self, scene: bpy.types.Scene, item: bpy.types.Collection) -> None:
        from ..blender import items

        items.bake_item(scene, item)


class VOLUMETRICS_OT_bake_light(_OfItem, bpy.types.Operator):
    bl_idname = "volumetrics.bake_light"
    bl_label = "Bake light"
    bl_description = ("Bake all orders of scattering for EEVEE, for the scene's lights, world and camera as they are now; "
                      "bake again after moving them")

    def act(self, scene: bpy.types.Scene, item: bpy.types.Collection) -> list[str]:
        from ..blender import items

        return items.bake_light(scene, item)


CLASSES = (VOLUMETRICS_OT_add, VOLUMETRICS_OT_remove, VOLUMETRICS_OT_bake, VOLUMETRICS_OT_bake_light)
