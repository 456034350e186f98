# SPDX-License-Identifier: GPL-3.0-or-later
"""From the volumes of the Scene back to families and their parameters: the way any Scene reaches the engines.

The inverse of assemble, as far as the families reach: what none of them can express is refused with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..parameters.families import FAMILIES
from .assemble import body
from .body import Body
from .families.air import PER_KILOMETRE
from .model import (
    Box, Camera, Cover, Dust, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Homogeneous, Medium, MiePhase, NoiseShape, Phase,
    RayleighPhase, Scene, Volume,
)

GREY = 1e-9  # relative difference of the extinction between channels that counts as none


def describe(volume: Volume) -> tuple[str, dict[str, Any]]:
    """Family and values of a volume. Raises ValueError when no family can express it."""
    medium = volume.medium
    if medium.glows or isinstance(medium.density, Dust):
        return "godray", _values("godray", _haze(medium))
    if volume.has_surface or (not medium.scatters and isinstance(medium.density, Homogeneous)):
        return "glass", _values("glass", _glass(volume))
    if not isinstance(medium.phase, (Phase, MiePhase)):
        raise ValueError(f"the phase function {medium.phase} has no nodes in every engine; use water droplets or one or two "
                         "HG lobes")
    if isinstance(medium.density, ExponentialHeight):
        if not isinstance(medium.phase, Phase) or medium.phase.weight > 0.0:
            raise ValueError(f"height fog has one HG lobe, got {medium.phase}; take a Phase with weight 0")
        return "fog", _values("fog", {"scale_height": medium.density.scale_height,
                                      "base_height": medium.density.base_height, **_scattering(medium)})
    if not isinstance(medium.density, (Homogeneous, NoiseShape, Grid)):
        raise ValueError(f"no family has the density {type(medium.density).__name__}; use a homogeneous medium, noise, voxels, "
                         "height fog or air")
    return "cloud", _values("cloud", _cloud(volume))


def describe_scene(scene: Scene) -> list[Body]:
    """What the engines have to show. Raises ValueError with the reason when they cannot show the scene."""
    layers = _fog_layers(scene.volumes)
    air = [volume for volume in scene.volumes if isinstance(volume.medium.density, ExponentialAltitude)]
    bodies = [body(*describe(volume), (volume,)) for volume in scene.volumes if volume not in air and volume not in sum(layers, ())]
    for first, second in layers:
        family, values = describe(first)
        other = describe(second)[1]
        values |= {"second_extinction": other["extinction"], "second_scale_height": other["scale_height"]}
        bodies.append(body(family, values, (first, second)))
    if air:
        bodies.append(body("air", describe_air(air, scene.camera), air))
    return bodies


def _fog_layers(volumes: Sequence[Volume]) -> list[tuple[Volume, Volume]]:
    """Pairs of height fogs that are two layers of one: in one domain, above one base, with one albedo and phase function."""
    def shared(volume: Volume) -> tuple | None:
        medium = volume.medium
        if volume.boundary is not None or not isinstance(medium.density, ExponentialHeight) or min(medium.sigma_t) <= 0.0:
            return None
        albedo = tuple(round(s / t, 9) for s, t in zip(medium.sigma_s, medium.sigma_t))
        return volume.domain, medium.density.base_height, albedo, medium.phase

    pairs, waiting = [], {}
    for volume in volumes:
        key = shared(volume)
        if key in waiting:
            pairs.append((waiting.pop(key), volume))
        elif key is not None:
            waiting[key] = volume
    return pairs


def describe_air(volumes: Sequence[Volume], camera: Camera) -> dict[str, Any]:
    """Values of the air that these volumes are, as far as this camera sees it. Raises ValueError when they are none."""
    first = volumes[0]
    center, radius = first.medium.density.center, first.medium.density.radius
    for volume in volumes:
        if (volume.medium.density.center, volume.medium.density.radius) != (center, radius) or volume.domain != first.domain:
            raise ValueError("the air's media must surround one planet in one domain; give them the same")
    sphere = isinstance(first.domain, Ellipsoid) and first.domain.center == center and len(set(first.domain.half)) == 1
    if not sphere or first.domain.half[0] <= radius:
        raise ValueError(f"air must end in a sphere around the planet, above its ground, got {first.domain}")
    if center[0] != 0.0 or center[1] != 0.0:
        raise ValueError(f"the planet's centre must be below the origin, got {center}; move the scene")
    molecules = [v.medium for v in volumes if isinstance(v.medium.phase, RayleighPhase)]
    aerosol = [v.medium for v in volumes if isinstance(v.medium.phase, Phase)]
    if len(molecules) > 1 or len(aerosol) > 1 or len(molecules) + len(aerosol) < len(volumes):
        raise ValueError(f"air is molecules and one aerosol with an HG lobe, got {len(volumes)} media with the phase functions "
                         f"{[v.medium.phase for v in volumes]}")
    top, thickness = first.domain.half[0], first.domain.half[0] - radius
    eye = math.dist(camera.position, center)
    # From the camera's farthest ground to where the line that grazes it leaves the air.
    reach = math.hypot(*camera.position[:2]) + math.sqrt(max(0.0, eye**2 - radius**2)) + math.sqrt(top**2 - radius**2)
    values = {"planet_radius": radius, "base_height": center[2] + radius, "thickness": thickness, "reach": reach,
              "rayleigh_scattering": 0.0, "mie_extinction": 0.0}
    for medium in molecules:
        if max(medium.sigma_a) > 0.0:
            raise ValueError(f"molecules do not absorb, got sigma_a {medium.sigma_a} per metre; give it to the aerosol")
        strongest = max(medium.sigma_s)
        values |= {"rayleigh_scattering": strongest / PER_KILOMETRE, "rayleigh_scale_height": medium.density.scale_height}
        if strongest > 0.0:
            values["rayleigh_color"] = tuple(s / strongest for s in medium.sigma_s)
    for medium in aerosol:
        if medium.phase.weight > 0.0:
            raise ValueError(f"aerosol has one HG lobe, got {medium.phase}; set the weight of the second to 0")
        values["mie_scale_height"] = medium.density.scale_height
        if max(medium.sigma_t) > 0.0:
            grey = _scattering(medium)
            values |= {"mie_extinction": grey["extinction"] / PER_KILOMETRE, "mie_albedo": grey["albedo"], "mie_g": grey["g"]}
    return _values("air", values)


def _values(family: str, values: dict[str, Any]) -> dict[str, Any]:
    return {parameter.name: values.get(parameter.name, parameter.default) for parameter in FAMILIES[family].parameters}


def _scattering(medium: Medium) -> dict[str, Any]:
    """Extinction, which the families have in grey, and albedo; the g of a single lobe."""
    extinction = max(medium.sigma_t)
    if extinction - min(medium.sigma_t) > GREY * extinction:
        raise ValueError(f"sigma_t must be the same in all channels for a scattering medium, got {medium.sigma_t} per metre; "
                         "colour the albedo instead")
    return {"extinction": extinction, "albedo": tuple(s / extinction for s in medium.sigma_s),
            **({"g": medium.phase.g0} if isinstance(medium.phase, Phase) else {})}


def _haze(medium: Medium) -> dict[str, Any]:
    if not isinstance(medium.density, (Homogeneous, Dust)) or not isinstance(medium.phase, Phase) or medium.phase.weight > 0.0:
        raise ValueError(f"ambient light is that of haze with one HG lobe, homogeneous or dusty, got {medium}; set it to 0")
    values, strongest = _scattering(medium), max(medium.ambient)
    if strongest > 0.0:
        values |= {"ambient": strongest, "ambient_color": tuple(a / strongest for a in medium.ambient)}
    if isinstance(medium.density, Dust):
        dust = medium.density
        values |= {"dust_strength": dust.strength, "dust_size": dust.size, "dust_seed": dust.seed, "dust_drift": dust.drift, "dust_time": 1.0}
    return values


def _glass(volume: Volume) -> dict[str, Any]:
    if not isinstance(volume.medium.density, Homogeneous) or not isinstance(volume.domain, (Box, Ellipsoid)):
        raise ValueError("an absorbing body must be a homogeneous box or ellipsoid, "
                         f"got {volume.medium.density} in {type(volume.domain).__name__}")
    boundary, shape = volume.boundary, "sphere" if isinstance(volume.domain, Ellipsoid) else "block"
    hollow: dict[str, Any] = {}
    if volume.cavity is not None:
        walls = [outer - inner for outer, inner in zip(volume.domain.half, volume.cavity.half)]
        if max(walls) - min(walls) > GREY * max(volume.domain.half):
            raise ValueError(f"the wall of a hollow body must be equally thick along its axes, got {walls} m")
        shape, hollow = "shell", {"thickness": walls[0]}
    if volume.sheet is not None:
        shape, hollow = "sheet", {"thickness": volume.sheet.thickness, **_cover(volume.sheet.cover)}
    # The distance at which the strongest absorption leaves 1/e keeps every colour well inside its limits.
    strongest = max(volume.medium.sigma_a)
    distance = 1.0 / strongest if strongest > 0.0 else 1.0
    return {"shape": shape, **hollow, "distance": distance,
            "color": tuple(math.exp(-s * distance) for s in volume.medium.sigma_a),
            "refraction": boundary is not None, "ior": boundary.ior if boundary else 1.0}


def _cover(cover: Cover | None) -> dict[str, Any]:
    if cover is None:
        return {}
    return {"coverage_pattern": cover.pattern, "coverage": cover.coverage, "coverage_color": cover.albedo,
            "coverage_size": cover.size, "coverage_softness": cover.softness, "color_variation": cover.variation,
            "coverage_seed": cover.seed}


def _cloud(volume: Volume) -> dict[str, Any]:
    medium, shape = volume.medium, volume.medium.density
    values = {"density": "homogeneous", **_scattering(medium)}
    if volume.octaves:
        values |= {"scattering": "octaves", "octaves": volume.octaves.count, "octave_extinction": volume.octaves.extinction,
                   "octave_phase": volume.octaves.phase, "octave_contribution": volume.octaves.contribution}
    if isinstance(medium.phase, MiePhase):
        values |= {"phase": "mie", "droplet_diameter": medium.phase.droplet_diameter}
    else:
        values |= {"phase": "dual_hg" if medium.phase.weight > 0.0 else "hg", "g_back": medium.phase.g1,
                   "lobe_weight": medium.phase.weight}
    if isinstance(shape, Homogeneous):  # its light is as sharp as the shadows and cones of the lights: too sharp for a coarse grid
        values["eevee_light"] = "scatter"
    if isinstance(shape, NoiseShape):
        if shape.center != volume.domain.center or shape.half != volume.domain.half:
            raise ValueError(f"noise must be centred in its domain and as large, got {shape.center} and {shape.half} in "
                             f"{volume.domain}")
        values |= {"density": "noise", "noise_size": shape.noise_size, "noise_detail": shape.detail,
                   "noise_roughness": shape.roughness, "noise_strength": shape.noise_strength, "wind": shape.drift, "time": 1.0,
                   **{name: getattr(shape, name) for name in ("fill", "softness", "seed", "profile", "billow_size",
                                                              "billow_strength", "billow_octaves", "billow_roughness", "base",
                                                              "stretch", "evolution")}}
    return values
