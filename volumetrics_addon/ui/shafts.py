# SPDX-License-Identifier: GPL-3.0-or-later
"""Shafts of sunlight from the faces of a mesh: the operator and its place in the sidebar."""

import bpy


class VOLUMETRICS_OT_shafts(bpy.types.Operator):
    bl_idname = "volumetrics.shafts"
    bl_label = "Shafts from faces"
    bl_description = ("Fill the sunlight behind the selected faces with haze, in Object Mode behind all faces of the active mesh; "
                      "the faces themselves have to let the light through")
    bl_options = {"REGISTER", "UNDO"}

    end: bpy.props.EnumProperty(name="End", description="Where the shafts end",
                                items=(("floor", "Floor", "On a level floor"), ("length", "Length", "After a length")))
    floor_height: bpy.props.FloatProperty(name="Floor height", description="Height of the floor on which the light falls",
                                          subtype="DISTANCE", soft_min=-100.0, soft_max=100.0)
    length: bpy.props.FloatProperty(name="Length", description="How far the shafts reach along the light", default=8.0, min=0.01,
                                    max=1e5, subtype="DISTANCE")
    extinction: bpy.props.FloatProperty(name="Extinction (1/m)", description="Density of the haze, which stays live", default=0.05,
                                        min=0.0, max=1e5, soft_max=1.0, precision=3)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode in {"OBJECT", "EDIT_MESH"}

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(self, "end")
        self.layout.prop(self, "floor_height" if self.end == "floor" else "length")
        self.layout.prop(self, "extinction")

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..blender import shafts

        editing = context.mode == "EDIT_MESH"
        if editing:  # objects are made in Object Mode, so that one step undoes all of it
            bpy.ops.object.mode_set(mode="OBJECT")
        try:
            item, warnings = shafts.add_shafts(context.scene, context.view_layer.objects.active, editing, {
                "shaft_end": self.end, "floor_height": self.floor_height, "length": self.length, "extinction": self.extinction})
        except ValueError as error:
            if editing:
                bpy.ops.object.mode_set(mode="EDIT")
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for warning in warnings:
            self.report({"WARNING"}, warning)
        return {"FINISHED"}


class VOLUMETRICS_PT_shafts(bpy.types.Panel):
    bl_idname = "VOLUMETRICS_PT_shafts"
    bl_label = "Shafts from faces"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Volumetrics"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        body = context.active_object
        is_mesh = body is not None and body.type == "MESH"
        self.layout.label(text=f"Faces of {body.name}" if is_mesh else "Select the faces of a window")
        self.layout.operator("volumetrics.shafts", icon="LIGHT_SUN")


CLASSES = (VOLUMETRICS_OT_shafts, VOLUMETRICS_PT_shafts)
