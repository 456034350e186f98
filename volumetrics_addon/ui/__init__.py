# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and operators; no logic."""

from __future__ import annotations

import bpy

from . import glass, operators, panels, plan, properties, shafts

_MODULES = (properties, operators, panels, shafts, glass, plan)
_command = None


def _run_command(argv: list[str]) -> int:
    from ..cli.main import main

    return main(argv, "blender --command volumetrics")


def register() -> None:
    global _command
    for module in _MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
    bpy.types.WindowManager.volumetrics = bpy.props.PointerProperty(type=properties.VolumetricsSettings)
    bpy.types.WindowManager.volumetrics_plan = bpy.props.PointerProperty(type=plan.VolumetricsPlan)
    _command = bpy.utils.register_cli_command("volumetrics", _run_command)


def unregister() -> None:
    global _command
    bpy.utils.unregister_cli_command(_command)
    _command = None
    for manager in bpy.data.window_managers:  # the values outlive the property
        manager.property_unset("volumetrics")
        manager.property_unset("volumetrics_plan")
    del bpy.types.WindowManager.volumetrics, bpy.types.WindowManager.volumetrics_plan
    for module in reversed(_MODULES):
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)
