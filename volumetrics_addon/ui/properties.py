# SPDX-License-Identifier: GPL-3.0-or-later
"""UI properties, derived from the declared parameters.

They live on the window manager, so that a file without items keeps no trace of the add-on.
"""

import math
from functools import lru_cache
from typing import Any

import bpy

from ..parameters import preset as presets
from ..parameters.families import FAMILIES
from ..parameters.model import Group, Parameter, decimal
from ..parameters.stage import STAGE

ICONS = {"cloud": "OUTLINER_OB_VOLUME", "glass": "MATSPHERE", "fog": "MOD_OCEAN", "godray": "LIGHT_SPOT",
         "air": "WORLD"}


# Units that Blender shows by itself, in the units of the scene.
SUBTYPES = {"m": "DISTANCE", "deg": "ANGLE", "W": "POWER", "m/s": "VELOCITY"}


def label(parameter: Parameter) -> str:
    """The parameter's label, with its unit where Blender does not show it."""
    return f"{parameter.label} ({parameter.unit})" if parameter.unit and parameter.unit not in SUBTYPES else parameter.label


def _factor(parameter: Parameter) -> float:
    """What Blender stores for one of the declared unit: angles in radians."""
    return math.radians(1.0) if parameter.unit == "deg" else 1.0


def _property(parameter: Parameter) -> Any:
    """The Blender property of a parameter, with its limits, slider range, unit and description."""
    # Blender ends every description with a full stop of its own.
    common = {"name": label(parameter), "description": parameter.description.removesuffix(".")}
    if parameter.kind == "choice":
        items = [(name, label, "") for name, label in parameter.choices]
        return bpy.props.EnumProperty(**common, items=items, default=parameter.default)
    if parameter.kind == "bool":
        return bpy.props.BoolProperty(**common, default=parameter.default)
    if parameter.kind in ("text", "path"):
        return bpy.props.StringProperty(**common, default=parameter.default, maxlen=int(parameter.maximum),
                                        subtype="FILE_PATH" if parameter.kind == "path" else "NONE")
    low, high = parameter.soft_range
    limits = {"min": parameter.minimum, "max": parameter.maximum, "soft_min": low, "soft_max": high}
    if parameter.kind == "int":
        return bpy.props.IntProperty(**common, **{name: int(value) for name, value in limits.items()},
                                     default=parameter.default)
    common |= {name: value * _factor(parameter) for name, value in limits.items()}
    if parameter.kind == "float":
        return bpy.props.FloatProperty(**common, default=parameter.default * _factor(parameter), precision=3,
                                       subtype=SUBTYPES.get(parameter.unit, "NONE"))
    if parameter.kind == "color":
        subtype = "COLOR"
    elif parameter.unit == "m":
        subtype = "XYZ_LENGTH" if parameter.name == "size" else "TRANSLATION"
    else:
        subtype = SUBTYPES[parameter.unit]
    return bpy.props.FloatVectorProperty(**common, default=parameter.default, size=3, subtype=subtype)


def _property_group(group: Group) -> type:
    annotations = {parameter.name: _property(parameter) for parameter in group.parameters}
    return type(f"VOLUMETRICS_PG_{group.name}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})


FAMILY_CLASSES = {name: _property_group(group) for name, group in FAMILIES.items()}


# Panels are drawn at every move of the mouse; the presets that come with the add-on never change.
preset_named = lru_cache(presets.load)


@lru_cache(maxsize=1)
def _preset_items() -> list[tuple[str, str, str, str, int]]:
    """Blender keeps no reference to enum texts, so the list has to live as long as the add-on."""
    loaded = [preset_named(name) for name in presets.names()]
    loaded.sort(key=lambda preset: (list(FAMILIES).index(preset.family), preset.label))
    return [(preset.name, preset.label, preset.description, ICONS[preset.family], index)
            for index, preset in enumerate(loaded)]


def load_preset(settings: bpy.types.PropertyGroup) -> None:
    """Fill the family's properties from the chosen preset."""
    preset = preset_named(settings.preset)
    target = getattr(settings, preset.family)
    for parameter in preset.group.parameters:
        value = preset.parameters[parameter.name]
        setattr(target, parameter.name, value * _factor(parameter) if parameter.kind == "float" else value)
    settings.orders = preset.stage["orders"]
    settings.loaded = True


def values(settings: bpy.types.PropertyGroup) -> dict[str, Any]:
    """The parameters as set in the UI, in the declaration's canonical types."""
    family = preset_named(settings.preset).group
    target = getattr(settings, family.name)
    result = {}
    for parameter in family.parameters:
        value = getattr(target, parameter.name)
        match parameter.kind:
            case "float":
                value = decimal(value / _factor(parameter))
            case "color" | "vector":
                value = tuple(map(decimal, value))
        result[parameter.name] = value
    return result


class VolumetricsSettings(bpy.types.PropertyGroup):
    preset: bpy.props.EnumProperty(
        name="Preset", description="What to add to the scene", items=lambda self, context: _preset_items(),
        update=lambda self, context: load_preset(self),
    )
    loaded: bpy.props.BoolProperty(
        name="Loaded", description="The parameters below are those of the chosen preset", options={"HIDDEN"})
    orders: _property(STAGE["orders"])
    show_parameters: bpy.props.BoolProperty(
        name="Parameters", description="Change the preset before it is added",
        update=lambda self, context: None if self.loaded else load_preset(self),
    )


VolumetricsSettings.__annotations__.update(
    {name: bpy.props.PointerProperty(type=cls) for name, cls in FAMILY_CLASSES.items()})

CLASSES = (*FAMILY_CLASSES.values(), VolumetricsSettings)
