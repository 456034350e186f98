# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass on a mesh of the user's own: operators of one undo step each, and their panel."""

from __future__ import annotations

import bpy

from ..parameters.families import FAMILIES
from .operators import UndoStep
from .panels import VOLUMETRICS_PT_main, _field
from .properties import ICONS, preset_named


class _OnMesh(UndoStep):
    """An operator on the active object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT"


class VOLUMETRICS_OT_glass_apply(_OnMesh, bpy.types.Operator):
    bl_idname = "volumetrics.glass_apply"
    bl_label = "Glass on selected object"
    bl_description = "Make the active mesh of the glass chosen above: a thin pane, or a body that fills the closed mesh"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if preset_named(context.window_manager.volumetrics.preset).family != "glass":
            cls.poll_message_set("Choose a preset of glass first")
            return False
        return context.mode == "OBJECT"

    def act(self, context: bpy.types.Context) -> None:
        from ..blender import mesh_glass
        from . import properties

        settings = context.window_manager.volumetrics
        if not settings.loaded:
            properties.load_preset(settings)
        mesh_glass.apply(context.scene, context.active_object, properties.values(settings), preset_named(settings.preset).label)


class VOLUMETRICS_OT_glass_measure(_OnMesh, bpy.types.Operator):
    bl_idname = "volumetrics.glass_measure"
    bl_label = "Measure thickness"
    bl_description = "Measure for EEVEE how far light goes through the mesh, after its shape or proportions have changed"

    def act(self, context: bpy.types.Context) -> None:
        from ..blender import mesh_glass

        mesh_glass.measure(context.scene, context.active_object)


class VOLUMETRICS_OT_glass_remove(_OnMesh, bpy.types.Operator):
    bl_idname = "volumetrics.glass_remove"
    bl_label = "Remove glass"
    bl_description = "Bring back the materials that the active object had before it was made of glass"

    def act(self, context: bpy.types.Context) -> None:
        from ..blender import mesh_glass

        if not mesh_glass.has_glass(context.active_object):
            raise ValueError("the active object is not of glass; select one that is")
        mesh_glass.remove(context.scene, context.active_object)


class VOLUMETRICS_PT_glass(bpy.types.Panel):
    bl_idname = "VOLUMETRICS_PT_glass"
    bl_label = "Glass on your own mesh"
    bl_parent_id = VOLUMETRICS_PT_main.bl_idname
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Volumetrics"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.active_object is not None and context.active_object.type == "MESH"

    def draw(self, context: bpy.types.Context) -> None:
        from ..blender import items, mesh_glass

        target = context.active_object
        self.layout.operator("volumetrics.glass_apply", icon=ICONS["glass"])
        node = items.live_node_of([target])
        if not mesh_glass.has_glass(target) or node is None:
            return
        shown = items.record(target)["values"]
        for parameter, socket in zip(FAMILIES["glass"].live, node.inputs):
            if FAMILIES["glass"].applies(parameter.name, shown):
                _field(self.layout, parameter, socket, "default_value")
        if mesh_glass.is_measured(target):
            self.layout.operator("volumetrics.glass_measure", icon="MOD_THICKNESS")
        self.layout.operator("volumetrics.glass_remove", icon="TRASH")


CLASSES = (VOLUMETRICS_OT_glass_apply, VOLUMETRICS_OT_glass_measure, VOLUMETRICS_OT_glass_remove, VOLUMETRICS_PT_glass)
