# SPDX-License-Identifier: GPL-3.0-or-later
"""What the scene does not need: a list of rules with their bounds and gains, each with a switch; apply and restore."""

from __future__ import annotations

import bpy

from ..plan.catalogue import RULES, TARGET
from .operators import UndoStep
from .panels import VOLUMETRICS_PT_main, wrapped


class VolumetricsAdvice(bpy.types.PropertyGroup):
    """A rule as it applies to the scene; the name is the rule's."""

    use: bpy.props.BoolProperty(name="Use", description="Leave out what this rule finds", default=True)
    reason: bpy.props.StringProperty(name="Reason")
    figures: bpy.props.StringProperty(name="Figures")


class VolumetricsPlan(bpy.types.PropertyGroup):
    error: bpy.props.FloatProperty(name="Error", description="What all rules together may change of the picture, in percent of its light",
                                   default=100.0 * TARGET, min=1e-4, max=50.0, soft_max=5.0, precision=2, subtype="PERCENTAGE")
    pilot: bpy.props.BoolProperty(name="Render a pilot", default=False, description="Render small pictures that tell how noisy the large "
                                  "one will be, and set the noise threshold by it, in Cycles with adaptive sampling on. In EEVEE "
                                  "three of few samples, which tell whether large pictures may have finer cells")
    advice: bpy.props.CollectionProperty(type=VolumetricsAdvice)
    scene: bpy.props.StringProperty(name="Scene", description="For which the advice was found")


def find(context: bpy.types.Context) -> list:
    """The advice for the scene, listed in the panel; rules that were switched off stay so. Raises ValueError for another engine."""
    from ..blender import compat
    from ..blender import tuning as of_scene
    from ..plan import tuning

    state = context.window_manager.volumetrics_plan
    off = switched_off(context)
    advice = of_scene.plan(context.scene, state.error / 100.0, pilot=state.pilot)
    engine = compat.engine_of(context.scene)
    state.advice.clear()
    for found in advice:
        entry = state.advice.add()
        entry.name, entry.reason, entry.figures = found.rule.name, found.reason, tuning.figures(found, engine)
        entry.use = found.rule.name not in off
    state.scene = context.scene.name
    return advice


def switched_off(context: bpy.types.Context) -> set[str]:
    return {entry.name for entry in context.window_manager.volumetrics_plan.advice if not entry.use}


class VOLUMETRICS_OT_plan(UndoStep, bpy.types.Operator):
    bl_idname = "volumetrics.plan"
    bl_label = "Find savings"
    bl_description = "List what this scene does not need, media that are not of this add-on included; changes nothing"
    bl_options = {"REGISTER"}

    def act(self, context: bpy.types.Context) -> None:
        if not find(context):
            self.report({"INFO"}, "Every rule was tried, and the scene needs all it has")


class VOLUMETRICS_OT_plan_apply(UndoStep, bpy.types.Operator):
    bl_idname = "volumetrics.plan_apply"
    bl_label = "Apply"
    bl_description = "Change the render settings and lamps as the rules say that are switched on; materials stay as they are"

    def act(self, context: bpy.types.Context) -> None:
        from ..blender import tuning as of_scene

        of_scene.restore(context.scene)  # what an earlier plan has left out is looked at again
        state = context.window_manager.volumetrics_plan
        advice = of_scene.plan(context.scene, state.error / 100.0, switched_off(context), pilot=state.pilot, again=False)
        if not advice:
            self.report({"INFO"}, "No rule that is switched on finds anything to leave out")
        of_scene.apply(context.scene, advice)


class VOLUMETRICS_OT_plan_restore(UndoStep, bpy.types.Operator):
    bl_idname = "volumetrics.plan_restore"
    bl_label = "Restore"
    bl_description = "Bring back every value that a plan has changed in this scene, but for those changed since"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        from ..blender import tuning as of_scene

        return of_scene.is_applied(context.scene)

    def act(self, context: bpy.types.Context) -> None:
        from ..blender import tuning as of_scene

        of_scene.restore(context.scene)


class VOLUMETRICS_PT_plan(bpy.types.Panel):
    bl_idname = "VOLUMETRICS_PT_plan"
    bl_label = "What this scene does not need"
    bl_parent_id = VOLUMETRICS_PT_main.bl_idname
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Volumetrics"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        state, layout = context.window_manager.volumetrics_plan, self.layout
        layout.prop(state, "error")
        layout.prop(state, "pilot")
        layout.operator("volumetrics.plan", icon="VIEWZOOM")
        if state.scene != context.scene.name:
            return
        for entry in state.advice:
            if entry.name not in RULES:
                continue
            box = layout.box()
            box.prop(entry, "use", text=entry.name.capitalize())
            wrapped(box, entry.figures, context)
            wrapped(box, entry.reason, context)
        row = layout.row()
        row.operator("volumetrics.plan_apply", icon="CHECKMARK")
        row.operator("volumetrics.plan_restore", icon="LOOP_BACK")


CLASSES = (VolumetricsAdvice, VolumetricsPlan, VOLUMETRICS_OT_plan, VOLUMETRICS_OT_plan_apply, VOLUMETRICS_OT_plan_restore,
           VOLUMETRICS_PT_plan)
