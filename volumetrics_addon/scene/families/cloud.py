# SPDX-License-Identifier: GPL-3.0-or-later
"""From the values of a cloud to its volume."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..model import AnyPhase, Box, Ellipsoid, Homogeneous, Medium, MiePhase, NoiseShape, Octaves, Phase, Volume, scaled
from .item import Bounds, Item, scattering


def assemble(values: Mapping[str, Any], bounds: Bounds | None = None) -> Item:
    half = scaled(values["size"], 0.5)
    shape = {"ellipsoid": Ellipsoid, "box": Box}[values["domain"]](values["location"], half)
    phase: AnyPhase
    if values["phase"] == "mie":
        phase = MiePhase(values["droplet_diameter"])
    elif values["phase"] == "dual_hg":
        phase = Phase(values["g"], values["g_back"], values["lobe_weight"])
    else:
        phase = Phase(values["g"])
    density: Homogeneous | NoiseShape = Homogeneous()
    if values["density"] == "noise":
        density = NoiseShape(
            values["location"], half, values["noise_size"], values["noise_detail"], values["noise_roughness"],
            values["noise_strength"], values["fill"], values["softness"], values["seed"],
            drift=scaled(values["wind"], values["time"]),
            **{name: values[name] for name in ("profile", "billow_size", "billow_strength", "billow_octaves",
                                               "billow_roughness", "base", "stretch", "evolution")})
    octaves = None
    if values["scattering"] == "octaves":
        octaves = Octaves(values["octaves"], *(values[f"octave_{name}"] for name in ("extinction", "phase", "contribution")))
    sigma_s, sigma_a = scattering(values)
    return Item([Volume(shape, Medium(sigma_s, sigma_a, phase, density), octaves=octaves)])
