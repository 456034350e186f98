# SPDX-License-Identifier: GPL-3.0-or-later
"""From a volume of the Scene back to a family and its parameters: the way any Scene reaches the engines.

The inverse of assemble, as far as the families reach: what none of them can express is refused with the reason.
"""

from __future__ import annotations

import math
from typing import Any

from ..parameters.families import FAMILIES
from .model import Box, Ellipsoid, ExponentialHeight, Grid, Homogeneous, Medium, NoiseShape, Phase, Scene, Volume

GREY = 1e-9  # relative difference of the extinction between channels that counts as none


def describe(volume: Volume) -> tuple[str, dict[str, Any]]:
    """Family and values of a volume. Raises ValueError when no family can express it."""
    medium = volume.medium
    if volume.boundary is not None or (not medium.scatters and isinstance(medium.density, Homogeneous)):
        return "glass", _values("glass", _glass(volume))
    if not isinstance(medium.phase, Phase):
        raise ValueError(f"the phase function {medium.phase} has no nodes in every engine; use one or two HG lobes")
    if isinstance(medium.density, ExponentialHeight):
        if medium.phase.weight > 0.0:
            raise ValueError(f"height fog has one HG lobe, got {medium.phase}; set the weight of the second to 0")
        return "fog", _values("fog", {"scale_height": medium.density.scale_height,
                                      "base_height": medium.density.base_height, **_scattering(medium)})
    if not isinstance(medium.density, (Homogeneous, NoiseShape, Grid)):
        raise ValueError(f"no family has the density {type(medium.density).__name__}; use a homogeneous medium, noise, voxels "
                         "or height fog")
    return "cloud", _values("cloud", _cloud(volume))


def describe_scene(scene: Scene) -> list[tuple[str, dict[str, Any]]]:
    """Family and values of each volume. Raises ValueError with the reason when the engines cannot show the scene."""
    for light in scene.lights:
        if type(light).__name__ == "Projector":
            raise ValueError("the engines' lights carry no frustum and no gobo image; use a spot with blockers")
    return [describe(volume) for volume in scene.volumes]


def _values(family: str, values: dict[str, Any]) -> dict[str, Any]:
    return {parameter.name: values.get(parameter.name, parameter.default) for parameter in FAMILIES[family].parameters}


def _scattering(medium: Medium) -> dict[str, Any]:
    """Extinction, which the families have in grey, and albedo; the g of a single lobe."""
    extinction = max(medium.sigma_t)
    if extinction - min(medium.sigma_t) > GREY * extinction:
        raise ValueError(f"sigma_t must be the same in all channels for a scattering medium, got {medium.sigma_t} per metre; "
                         "colour the albedo instead")
    return {"extinction": extinction, "albedo": tuple(s / extinction for s in medium.sigma_s), "g": medium.phase.g0}


def _glass(volume: Volume) -> dict[str, Any]:
    if not isinstance(volume.medium.density, Homogeneous) or not isinstance(volume.domain, (Box, Ellipsoid)):
        raise ValueError("an absorbing body must be a homogeneous box or ellipsoid, "
                         f"got {volume.medium.density} in {type(volume.domain).__name__}")
    boundary = volume.boundary
    # The distance at which the strongest absorption leaves 1/e keeps every colour well inside its limits.
    strongest = max(volume.medium.sigma_a)
    distance = 1.0 / strongest if strongest > 0.0 else 1.0
    return {"shape": "sphere" if isinstance(volume.domain, Ellipsoid) else "block", "distance": distance,
            "color": tuple(math.exp(-s * distance) for s in volume.medium.sigma_a),
            "refraction": boundary is not None, "ior": boundary.ior if boundary else 1.0}


def _cloud(volume: Volume) -> dict[str, Any]:
    medium, shape = volume.medium, volume.medium.density
    values = {"phase": "dual_hg" if medium.phase.weight > 0.0 else "hg", "g_back": medium.phase.g1,
              "lobe_weight": medium.phase.weight, "density": "homogeneous", **_scattering(medium)}
    if isinstance(shape, Homogeneous):  # its light is as sharp as the shadows and cones of the lights: too sharp for a coarse grid
        values["eevee_light"] = "scatter"
    if isinstance(shape, NoiseShape):
        if shape.center != volume.domain.center or shape.half != volume.domain.half:
            raise ValueError(f"noise must be centred in its domain and as large, got {shape.center} and {shape.half} in "
                             f"{volume.domain}")
        values |= {"density": "noise", "noise_size": shape.noise_size, "noise_detail": shape.detail,
                   "noise_roughness": shape.roughness, "noise_strength": shape.noise_strength, "fill": shape.fill,
                   "softness": shape.softness, "seed": shape.seed}
    return values
