# SPDX-License-Identifier: GPL-3.0-or-later
"""UI properties, derived from the declared parameters.

They live on the window manager, so that a file without items keeps no trace of the add-on.
"""

from functools import lru_cache
from typing import Any

import bpy

from ..parameters import preset as presets
from ..parameters.families import FAMILIES
from ..parameters.model import Group, Parameter

ICONS = {"cloud": "OUTLINER_OB_VOLUME", "glass": "MATSPHERE", "fog": "MOD_OCEAN", "godray": "LIGHT_SPOT"}


def _property(parameter: Parameter) -> Any:
    """The Blender property of a parameter, with its limits, slider range, unit and description."""
    unit = f" ({parameter.unit})" if parameter.unit and parameter.unit != "m" else ""
    common = {"name": parameter.label + unit, "description": parameter.description, "default": parameter.default}
    if parameter.kind == "choice":
        common["items"] = [(name, label, "") for name, label in parameter.choices]
        return bpy.props.EnumProperty(**common)
    if parameter.kind == "bool":
        return bpy.props.BoolProperty(**common)
    number = int if parameter.kind == "int" else float
    low, high = parameter.soft_range
    limits = {"min": parameter.minimum, "max": parameter.maximum, "soft_min": low, "soft_max": high}
    common |= {name: number(value) for name, value in limits.items() if value is not None}
    if parameter.kind == "int":
        return bpy.props.IntProperty(**common)
    if parameter.kind == "float":
        return bpy.props.FloatProperty(**common, precision=4, subtype="DISTANCE" if parameter.unit == "m" else "NONE")
    subtype = "COLOR" if parameter.kind == "color" else "XYZ_LENGTH" if parameter.name == "size" else "TRANSLATION"
    return bpy.props.FloatVectorProperty(**common, size=3, subtype=subtype)


def _property_group(group: Group) -> type:
    annotations = {parameter.name: _property(parameter) for parameter in group.parameters}
    return type(f"VOLUMETRICS_PG_{group.name}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})


FAMILY_CLASSES = {name: _property_group(group) for name, group in FAMILIES.items()}


@lru_cache(maxsize=1)
def _preset_items() -> list[tuple[str, str, str, str, int]]:
    """Blender keeps no reference to enum texts, so the list has to live as long as the add-on."""
    loaded = [presets.load(name) for name in presets.names()]
    loaded.sort(key=lambda preset: (list(FAMILIES).index(preset.family), preset.label))
    return [(preset.name, preset.label, preset.description, ICONS[preset.family], index)
            for index, preset in enumerate(loaded)]


def load_preset(settings: bpy.types.PropertyGroup) -> None:
    """Fill the family's properties from the chosen preset."""
    preset = presets.load(settings.preset)
    target = getattr(settings, preset.family)
    for name, value in preset.parameters.items():
        setattr(target, name, value)
    settings.orders = preset.stage["orders"]
    settings.loaded = settings.preset


def values(settings: bpy.types.PropertyGroup) -> dict[str, Any]:
    """The parameters as set in the UI, in the declaration's canonical types."""
    family = presets.load(settings.preset).group
    target = getattr(settings, family.name)
    result = {}
    for parameter in family.parameters:
        value = getattr(target, parameter.name)
        result[parameter.name] = tuple(value) if parameter.kind in ("color", "vector") else value
    return result


class VolumetricsSettings(bpy.types.PropertyGroup):
    preset: bpy.props.EnumProperty(
        name="Preset", description="What to add to the scene", items=lambda self, context: _preset_items(),
        update=lambda self, context: load_preset(self),
    )
    loaded: bpy.props.StringProperty(options={"HIDDEN"})
    orders: bpy.props.IntProperty(
        name="Scattering orders", description="Orders of scattering that Cycles follows; 1 is single scattering",
        default=1, min=1, max=1024)
    show_parameters: bpy.props.BoolProperty(name="Parameters", default=False)
    __annotations__ |= {name: bpy.props.PointerProperty(type=cls) for name, cls in FAMILY_CLASSES.items()}


CLASSES = (*FAMILY_CLASSES.values(), VolumetricsSettings)
