# SPDX-License-Identifier: GPL-3.0-or-later
"""What an artist's handles mean physically: quantities in closed form that follow from the values of a family.

Shown beside the handles in the panel, by ``volumetrics show`` and to scripts. Standard library only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from ..parameters.fog import CONTRAST_DEPTH, DEPTH_FOGS
from .families import air, fog, glass
from .families.godray import FALLOFF
from .model import Color, scaled, subtract

NEARBY = 100.0  # m
UNLIMITED = "unlimited"


class Quantity(NamedTuple):
    """``value``: a number, or one for each channel; ``unit``: SI, "" for a number without dimension."""

    label: str
    value: float | Color
    unit: str = ""


def derived(family: str, values: Mapping[str, Any]) -> list[Quantity]:
    """The quantities of a family beside these checked values of all its parameters.

    What would be infinite (the visibility in clear air) is ``inf``; a quantity that the values leave undefined is left out.
    """
    return list(_FAMILIES[family](values))


def text(quantity: Quantity) -> str:
    """Value and unit for people: three digits, lengths in mm, m or km, equal channels once."""
    value, unit = quantity.value, quantity.unit
    parts = value if isinstance(value, tuple) else (value,)
    if unit == "m":
        shortest = min(map(abs, parts))
        factor, unit = (1e-3, "km") if 1e3 <= shortest < math.inf else (1e3, "mm") if 0.0 < shortest < 0.1 else (1.0, "m")
        parts = tuple(part * factor for part in parts)
    elif unit == "1/m" and 0.0 < max(parts) < 1e-3:
        parts, unit = tuple(part * 1e3 for part in parts), "1/km"
    words = list(map(_digits, parts))
    if len(set(words)) == 1:
        words = words[:1]
    return " ".join(filter(None, (", ".join(words), unit if words != [UNLIMITED] else "")))


def _digits(value: float) -> str:
    if math.isinf(value):
        return UNLIMITED
    if value == 0.0 or 1e-3 <= abs(value) < 999.5:
        return f"{value:.3g}"
    return f"{value:.0f}" if 999.5 <= abs(value) < 1e5 else f"{value:.2g}"


def _inverse(sigma: float) -> float:
    return 1.0 / sigma if sigma > 0.0 else math.inf


def _decay(depths: Iterable[float]) -> Color:
    return tuple(math.exp(-depth) for depth in depths)


def _events(albedo: Color) -> Color:
    """Mean number of events up to an absorption in an infinite medium: 1 / (1 - albedo)."""
    return tuple(_inverse(1.0 - part) for part in albedo)


def _fog(values: Mapping[str, Any]) -> Iterable[Quantity]:
    sigma, profile = fog.extinction(values), values["profile"]
    if profile in DEPTH_FOGS:
        yield from _depth_fog(values, sigma)
        return
    second = values["second_extinction"] if profile == "exponential" else 0.0
    if values["visibility"] > 0.0:
        yield Quantity("Extinction at the base", sigma, "1/m")
    else:
        yield Quantity("Visibility at the base", CONTRAST_DEPTH * _inverse(sigma + second), "m")
    if profile == "exponential":
        heights = [values["scale_height"]] + ([values["second_scale_height"]] if second > 0.0 else [])
        height = max(heights) * -math.log(values["cutoff"])
        up = sum(extinction * h * -math.expm1(-height / h) for extinction, h in zip((sigma, second), heights))
    else:
        height = values["slab_height"] if profile == "slab" else values["size"][2]
        up = sigma * height
    yield Quantity("Height of the fog", height, "m")
    yield Quantity("Optical depth, densest" if profile == "patch" else "Optical depth straight up", up)
    yield Quantity(f"Transmittance over {NEARBY:g} m", math.exp(-NEARBY * (sigma + second)))


def _depth_fog(values: Mapping[str, Any], sigma: float) -> Iterable[Quantity]:
    """Of physics.transmittance: linear_fog, exp_fog and exp2_fog, from the start on."""
    start = values["start"]
    if values["profile"] == "linear":
        half, nearly = ((1.0 - share) * start + share * values["end"] for share in (0.5, 0.98))
    else:
        power = {"exp": 1.0, "exp2": 0.5}[values["profile"]]
        half, nearly = (start + _inverse(sigma) * depth**power for depth in (math.log(2.0), CONTRAST_DEPTH))
        yield Quantity("Density", sigma, "1/m")
    yield Quantity("Half hidden at", half, "m")
    yield Quantity("98 % hidden at", nearly, "m")
    yield Quantity("Radiance far away", scaled(values["far_color"], values["far_radiance"]), "W/(m2 sr)")


def _glass(values: Mapping[str, Any]) -> Iterable[Quantity]:
    sigma = glass.absorption(values)
    yield Quantity("Absorption", sigma, "1/m")
    yield Quantity("Depth of 1/e", tuple(map(_inverse, sigma)), "m")
    if values["shape"] == "shell":
        yield Quantity("Transmittance, two walls", _decay(scaled(sigma, 2.0 * values["thickness"])))
    elif values["shape"] == "sheet":
        yield Quantity("Transmittance face on", _decay(scaled(sigma, values["thickness"])))
    else:
        yield Quantity("Transmittance, thinnest way", _decay(scaled(sigma, min(values["size"]))))
    if values["refraction"]:
        yield Quantity("Reflectance face on", ((values["ior"] - 1.0) / (values["ior"] + 1.0)) ** 2)


def _cloud(values: Mapping[str, Any]) -> Iterable[Quantity]:
    sigma = values["extinction"]
    yield Quantity("Mean free path", _inverse(sigma), "m")
    if values["phase"] != "mie":
        weight = values["lobe_weight"] if values["phase"] == "dual_hg" else 0.0
        cosine = (1.0 - weight) * values["g"] + weight * values["g_back"]
        yield Quantity("Mean cosine", cosine)
        yield Quantity("Transport mean free path", _inverse(sigma * (1.0 - cosine)), "m")
    yield Quantity("Optical depth, densest, x y z", scaled(values["size"], sigma))
    yield Quantity("Mean events of a path", _events(values["albedo"]))


def _sunshaft(values: Mapping[str, Any]) -> Iterable[Quantity]:
    """Sunlight from the middle of an opening along the way to the target, down to the floor or over the length."""
    way, length = subtract(values["target"], values["location"]), values["length"]
    if values["shaft_end"] == "floor":
        drop, height = -way[2], values["location"][2] - values["floor_height"]
        length = math.hypot(*way) * height / drop if drop > 0.0 and height >= 0.0 else math.inf
    depth = values["extinction"] * length if values["extinction"] > 0.0 else 0.0
    yield Quantity("Length of the shaft", length, "m")
    yield Quantity("Visibility in the haze", CONTRAST_DEPTH * _inverse(values["extinction"]), "m")
    yield Quantity("Optical depth of the shaft", depth)
    yield Quantity("Irradiance at its end", scaled(values["color"], values["irradiance"] * math.exp(-depth)), "W/m2")


def _godray(values: Mapping[str, Any]) -> Iterable[Quantity]:
    if values["light"] == "sun":
        yield from _sunshaft(values)
        return
    length, near = values["length"], 0.0
    distance = math.hypot(*subtract(values["target"], values["location"]))
    lit, falloff = True, 2
    if values["light"] == "projector":
        near, falloff = values["near"], FALLOFF[values["falloff"]]
        lit = near <= distance <= values["far"]
        sides = [2.0 * length * math.tan(math.radians(values[f"{side}_fov"]) / 2.0) for side in ("horizontal", "vertical")]
        yield Quantity("Beam's width at the end", sides[0], "m")
        yield Quantity("Beam's height at the end", sides[1], "m")
    else:
        yield Quantity("Beam's radius at the end", length * math.tan(math.radians(values["cone_angle"]) / 2.0), "m")
    intensity = scaled(values["color"], values["power"] / (4.0 * math.pi))
    yield Quantity("Intensity", intensity, "W/sr")
    yield Quantity("Visibility in the haze", CONTRAST_DEPTH * _inverse(values["extinction"]), "m")
    yield Quantity("Optical depth of the beam", values["extinction"] * max(0.0, length - near))
    if (way := distance**falloff) > 0.0:  # else the light stands in its target
        depth = values["extinction"] * max(0.0, min(distance, length) - near)
        yield Quantity("Irradiance at the target", scaled(intensity, math.exp(-depth) / way if lit else 0.0), "W/m2")


def _air(values: Mapping[str, Any]) -> Iterable[Quantity]:
    molecules = scaled(values["rayleigh_color"], air.PER_KILOMETRE * values["rayleigh_scattering"])
    aerosol = air.PER_KILOMETRE * values["mie_extinction"]
    high, low = (scale * -math.expm1(-values["thickness"] / scale)
                 for scale in (values["rayleigh_scale_height"], values["mie_scale_height"]))
    total = tuple(sigma + aerosol for sigma in molecules)
    yield Quantity("Molecules straight up", scaled(molecules, high))
    yield Quantity("Aerosol straight up", aerosol * low)
    yield Quantity("Overhead sun kept", _decay(sigma * high + aerosol * low for sigma in molecules))
    yield Quantity("Visibility at the ground", CONTRAST_DEPTH * _inverse(total[1]), "m")
    yield Quantity("Air hides 1 - 1/e after", tuple(map(_inverse, total)), "m")


_FAMILIES: dict[str, Callable[[Mapping[str, Any]], Iterable[Quantity]]] = {
    "cloud": _cloud, "glass": _glass, "fog": _fog, "godray": _godray, "air": _air}
