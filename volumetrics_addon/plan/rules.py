# SPDX-License-Identifier: GPL-3.0-or-later
"""From a Scene to engine settings. Plain data in, plain data out: no Blender.

Settings are written for the newest Blender; ``has_null_scattering`` tells whether the engine has null-scattering beside
ray marching (Blender 5 and later).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

from ..scene.body import Body
from ..scene.channels import mixes
from ..scene.model import (
    Box, Cone, Dust, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Homogeneous, Hull, Light, NoiseShape, Projector,
    Scene, Shape, Sun, Vector, Volume,
)
from .catalogue import BY_NAME, PRESET_RULES
from .model import CYCLES, EEVEE, Plan

# Ray marching steps by this share of the medium's smallest feature; 0 leaves the engine its
# default, which in Blender 5 is unbiased null-scattering. Measured by scripts/step_bias.py on Blender 5.2:
# fog 0.000 % +- 0.17 % in 3.6 s at 0.3, +0.12 % at 1, +0.23 % at 2, null-scattering 15.4 s at 1.5 times the noise;
# cumulus -0.00 % +- 0.74 % in 23 s at 0.25, -0.06 % in 14 s at 0.5, null-scattering 51 s at the same noise.
MARCHING_STEP = 0.3
# Optical depth of a step through fog at its base, at most: a fog with steps of 0.45 came out +0.36 % [+0.27 %, +0.45 %], with this
# +0.02 % [-0.19 %, +0.23 %].
FOG_DEPTH = 0.25
# Camera paths from which a fog is quicker by null-scattering: its octree takes 2.5 s of a core before a picture, then a path takes
# half the time of marching at the same error (morning-valley, 32 pixels, 2.1 s and 1.0 s for a thousand samples).
FOG_PATHS = 8e5
VOXELS_PER_FEATURE = 2.0  # a grid of voxels changes by much over so many of them
# Optical depth of a step through voxels, at most: Blender 5 marches them with a transmittance too high by about 1.7 % of
# this (0.6 % at 0.36, 0.08 % at 0.045); 4.5 by less than 1e-5.
THICKEST_STEP = 0.15
# Optical depth of a step through noise, at most: cirrus came out -0.6 % +- 0.2 % with steps of 1.25.
NOISE_DEPTH = 0.5
# Voxels are marched however thick they are: by null-scattering a sample of the storm takes a tenth of the time, but pictures of
# thick clouds come out too bright in Blender 5.2: congestus +1.1 % [+0.3 %, +1.8 %], stratocumulus +2.8 % [+1.6 %, +4.0 %].
# Air is thin and smooth along a ray, and takes longer steps: scale heights, and optical depth at the ground. Measured on Blender
# 5.2 in single scattering: noon -0.04 % +- 0.06 % and sunset -0.03 % +- 0.10 % in 11 s and 24 s at 3 scale heights of the
# aerosol, the same within the noise in 23 s and 59 s at 1; null-scattering +0.41 % +- 0.06 % and -0.04 % +- 0.20 % in 150 s for
# half the samples. The depth of a medium of vertical depth 0.1 comes out 0.1 % (grazing) to 1.4 % (steep) low with steps of 3 of
# its scale heights, 0.01 % to 0.2 % with 1.
AIR_STEP, AIR_DEPTH = 2.0, 0.1
# Seconds of one core for a lookup of voxels in a step, the same for noise in lookups, and seconds to bake: a voxel of Perlin noise
# as a whole, each octave of cells, and whatever their number. Scattering events of a path: the optical depth across the domain,
# of which noise fills a quarter, and at most so many beyond the first.
LOOKUP, PERLIN_LOOKUPS, BILLOW_LOOKUPS = 5e-8, 3.5, 4.0
BAKED_VOXEL, BAKED_BILLOW, BAKED_ONCE = 4.5e-7, 2e-7, 0.1
FILLED, MOST_EVENTS = 0.25, 7.0
LIGHT_LAYERS, MOST_LIGHT = 8, 128  # voxels of baked light across a domain's shortest side, and along its longest at most
MOST_SAMPLES = 1 << 24  # that Cycles counts
GLASS_BOUNCES = 64  # interfaces followed through refracting solids
EEVEE_DEFAULT_THRESHOLD = 0.01
EEVEE_COEFFICIENT = 1e-4  # 1/m; below, EEVEE loses more than 5 % of a medium, and below 1e-5 all of it
EEVEE_SLICES = 128  # froxel slices along the view


def extent(shape: Shape) -> tuple[float, float, float]:
    """Size of the shape's bounding box along its own axes."""
    match shape:
        case Box() | Ellipsoid():
            return tuple(2.0 * h for h in shape.half)
        case Cone():
            width = 2.0 * shape.length * math.tan(shape.half_angle)
            return (width, width, shape.length)
        case Hull():
            return tuple(max(values) - min(values) for values in zip(*shape.corners))


def reach(scene: Scene, position: Vector) -> float:
    """Bound (m) on the distance from a position to the farthest point of the scene's media and bodies."""
    farthest = 0.0
    for shape in [volume.domain for volume in scene.volumes] + [surface.shape for surface in scene.surfaces]:
        if isinstance(shape, Cone):
            farthest = max(farthest, math.dist(position, shape.apex) + shape.length / math.cos(shape.half_angle))
        elif isinstance(shape, Hull):
            farthest = max(farthest, *(math.dist(position, corner) for corner in shape.corners))
        else:
            farthest = max(farthest, math.dist(position, shape.center) + math.hypot(*shape.half))
    return farthest


@dataclass(frozen=True)
class Cost:
    """Estimated processor time (s) of a representation: once for a scene, and for each camera path."""

    once: float
    path: float

    def of(self, paths: float) -> float:
        return self.once + paths * self.path


def representation_costs(volume: Volume, resolution: int) -> dict[str, Cost]:
    """What Cycles takes to render a volume of noise as ``nodes`` and as ``voxels``, of these along its longest side.

    A path's steps are its length through the domain over the length of a step, times the scattering events, whose number
    follows the optical depth; a step costs a lookup of voxels, or the noise at its octaves. Times were measured on two cores
    (Blender 5.2, ten presets): the ratio of both representations, which is what decides, holds within a factor of 2.1, for one
    of them 2.6 (``scripts/bench_clouds.py`` has rows of both).
    """
    noise, size = volume.medium.density, extent(volume.domain)
    mean, longest = sum(size) / 3.0, max(size)
    billows = noise.billow_octaves if noise.billow_strength != 0.0 else 0
    thickest = max(volume.medium.sigma_t)
    events = 1.0 + min(FILLED * min(size) * thickest, MOST_EVENTS)
    voxel = longest / resolution
    voxel_step = min(MARCHING_STEP * VOXELS_PER_FEATURE * voxel, THICKEST_STEP / max(thickest, 1e-300))
    count = math.prod(math.ceil(side / voxel) for side in size)
    lookup, evaluation = LOOKUP, LOOKUP * (PERLIN_LOOKUPS + BILLOW_LOOKUPS * billows)
    return {"nodes": Cost(0.0, evaluation * events * mean / _step(volume)),
            "voxels": Cost(BAKED_ONCE + count * (BAKED_VOXEL + BAKED_BILLOW * billows), lookup * events * mean / voxel_step)}


def is_baked(values: Mapping[str, Any], volume: Volume | None = None, engine: str = CYCLES, paths: float = 0.0) -> bool:
    """Whether a family's density becomes voxels, from its ``representation``.

    Left to the plan, Cycles renders a picture of so many camera paths from what takes less time, and EEVEE has voxels. A scene
    of the user's own keeps nodes, which stay live: it has no ``volume`` here.
    """
    if values.get("density") != "noise":
        return False
    if values["representation"] == "automatic" and volume is not None and isinstance(volume.medium.density, NoiseShape):
        if engine != CYCLES:
            return True
        costs = representation_costs(volume, values["resolution"])
        return costs["voxels"].of(paths) < costs["nodes"].of(paths)
    return values["representation"] == "baked"


def explain_representation(volumes: Sequence[Volume], values: Mapping[str, Any], paths: float, result: Plan) -> None:
    """Add to the plan how the volumes of noise are represented, and the estimates behind the choice."""
    for volume in volumes:
        if isinstance(volume.medium.density, NoiseShape):
            seconds = {name: cost.of(paths) for name, cost in representation_costs(volume, values["resolution"]).items()}
            chosen, other = sorted(seconds, key=seconds.get)
            result.decide("representation", chosen, f"an estimated {seconds[chosen]:.2g} s of one core, baking included, instead "
                          f"of {seconds[other]:.2g} s with {other}")


def light_threshold(scene: Scene) -> float:
    """EEVEE's light threshold at which every local light reaches through the scene.

    EEVEE multiplies a light by (1 - (d / R)^4)^2 with R = sqrt(power / (100 threshold)), and lets nothing nearer to it
    than about R / 4000 cast a shadow: a tiny threshold loses the blockers of a gobo. R = 8 times the scene's reach
    dims the farthest point by 2 / 8^4 = 0.05 %.
    """
    thresholds = [max(light.power) / 100.0 / (8.0 * max(reach(scene, light.position), 1e-6)) ** 2
                  for light in scene.lights if not isinstance(light, Sun)]
    return max(1e-12, min(thresholds, default=EEVEE_DEFAULT_THRESHOLD))


def plan(scene: Scene, bodies: Sequence[Body], engine: str, samples: int, *, has_null_scattering: bool = True,
         seed: int = 0, paths: float = 0.0, without: Collection[str] = ()) -> Plan:
    """Everything that has to be set for the engine to render the Scene's light transport, and nothing else.

    ``bodies`` holds the scene's volumes as the objects that the engine shows; ``paths`` counts the camera paths of a picture, its
    pixels times their samples; ``without`` names rules that are switched off.
    Raises ValueError for a name of no rule, and for one that is switched by a parameter instead.
    """
    check_names(without)
    result = Plan(engine, samples, without=frozenset(without))
    if scene.depth_fog is not None:
        result.compositor_fog = True
        result.decide("compositor fog", "the fog is a pass of the compositor, and no volume is rendered",
                      "its light has a closed form in the depth of a pixel")
        scene, bodies = replace(scene, volumes=(), depth_fog=None), ()
    if engine == CYCLES:
        _cycles(scene, bodies, result, has_null_scattering, seed, paths)
    else:
        _eevee(scene, bodies, result)
    if result.compositor_fog:
        # A graphics card may not be there, and half floats end at 65504 m.
        result.settings |= {"render.use_compositing": True, "render.compositor_device": "CPU", "render.compositor_precision": "FULL"}
    result.channels_apart = result.may("channels apart") and any(
        mixes(a.medium, b.medium) for body in bodies for a, b in combinations(body.volumes, 2))
    if result.channels_apart:
        result.decide("channels apart", "one render in grey for each channel",
                      "where lobes of different colours mix, the engines give all channels the mixture of their mean")
    return result


def check_names(without: Collection[str]) -> None:
    """Raises ValueError where a name is not that of a rule of presets that is switched off by name."""
    for name in without:
        rule = PRESET_RULES.get(name)
        if rule is None:
            raise ValueError(f"there is no rule {name!r}; the rules of presets are {', '.join(PRESET_RULES)}")
        if rule.switch != BY_NAME:
            raise ValueError(f"the rule {name!r} is not switched off by name; " +
                             (f"use {rule.switch}" if rule.switch else "it leaves out what would change nothing"))


def sample_settings(engine: str, samples: int, first_included: bool = False) -> dict[str, Any]:
    """What makes a picture of so many samples of a pixel.

    Cycles puts the first sample of every pixel at its centre: a picture of n samples is off by an n-th of what centres miss,
    -0.9 % in the emerald sphere on 16 pixels at n = 16. The second stretch of the sequence is as well stratified.
    ``first_included``: for the compositor's fog, whose depth is that of the first sample.
    """
    if engine != CYCLES:
        return {"eevee.taa_render_samples": samples}
    if first_included:
        return {"cycles.use_sample_subset": False, "cycles.samples": samples}
    return {"cycles.use_sample_subset": True, "cycles.sample_offset": min(samples, MOST_SAMPLES - samples),
            "cycles.sample_subset_length": samples, "cycles.samples": min(2 * samples, MOST_SAMPLES)}


def _cycles(scene: Scene, bodies: Sequence[Body], result: Plan, has_null_scattering: bool, seed: int, paths: float) -> None:
    bounces = scene.engine_orders - 1
    glass = GLASS_BOUNCES if scene.is_dielectric else 0
    if scene.engine_orders < scene.orders:
        result.decide("octaves", f"{scene.engine_orders} scattering events instead of {scene.orders}",
                      "the media's octaves stand for the orders beyond: measured bias up to 2 % where clouds are thin or small, "
                      "-11 % to -17 % where their optical depth is above 10")
    diffuse = max(bounces, glass)  # beside panes the reference follows all of them
    result.decide("bounces", f"volume bounces {bounces}, diffuse bounces {diffuse}, glass bounces {glass}",
                  f"the scene follows {scene.engine_orders} order(s) of scattering")
    result.settings.update({
        "cycles.device": "CPU",
        **sample_settings(CYCLES, result.samples, result.compositor_fog),
        "cycles.seed": seed,
        "cycles.use_animated_seed": False,
        "cycles.sampling_pattern": "TABULATED_SOBOL",
        "cycles.use_adaptive_sampling": False,
        "cycles.use_denoising": False,
        "cycles.time_limit": 0.0,
        "cycles.sample_clamp_direct": 0.0,
        "cycles.sample_clamp_indirect": 0.0,
        "cycles.light_sampling_threshold": 0.0,
        "cycles.use_light_tree": len(scene.lights) > 2,
        "cycles.use_guiding": False,
        "cycles.max_bounces": max(bounces, glass),
        "cycles.volume_bounces": bounces,
        "cycles.diffuse_bounces": diffuse,
        "cycles.glossy_bounces": glass,
        "cycles.transmission_bounces": glass,
        "cycles.transparent_max_bounces": 128,
        "cycles.min_light_bounces": 0,
        "cycles.min_transparent_bounces": 0,
        "cycles.caustics_reflective": True,
        "cycles.caustics_refractive": True,
        "cycles.blur_glossy": 0.0,
        "cycles.use_fast_gi": False,
        "cycles.pixel_filter_type": "BOX",
        "cycles.film_exposure": 1.0,
        "cycles.film_transparent_glass": False,
        "cycles.use_auto_tile": False,
        "cycles.volume_max_steps": 65536,
        "cycles.volume_step_rate": 1.0,
    })
    fog = all(isinstance(volume.medium.density, (ExponentialHeight, Homogeneous)) for body in bodies for volume in body.volumes)
    amortized = fog and paths > FOG_PATHS and result.may("null-scattering")
    unbiased = has_null_scattering and (not result.may("ray marching") or amortized)
    if unbiased and amortized and any(map(_step, (volume for body in bodies for volume in body.volumes))):
        result.decide("null-scattering", "no steps of ray marching",
                      f"{paths:.2g} camera paths are more than the {FOG_PATHS:.0e} from which the octree of a fog pays")
    steps = [0.0 if unbiased else min(map(_step, body.volumes)) for body in bodies]
    marched = any(steps)
    if has_null_scattering:
        result.settings["cycles.volume_biased"] = marched
    if marched:
        result.decide("ray marching", f"steps of {min(filter(None, steps)):g} m",
                      "a heterogeneous medium reaches the same error sooner than by null-scattering")
    for body, step in zip(bodies, steps):
        homogeneous = isinstance(body.volumes[0].medium.density, Homogeneous)
        settings = {"homogeneous_volume": homogeneous, "volume_sampling": _sampling(scene), "volume_step_rate": 1.0}
        density = body.volumes[0].medium.density
        if isinstance(density, Grid):
            result.decide("voxels", " x ".join(map(str, density.values.shape)), "the density is baked")
        if homogeneous:
            result.decide("analytic path", "no density is sampled", "the medium is homogeneous")
        elif step > 0.0:
            settings["volume_step_rate"] = max(1e-3, step / _engine_step(body))
        result.volume_settings.append(settings)


def _step(volume: Volume) -> float:
    """Length (m) of a step of ray marching; 0 for a medium that needs none or gets none."""
    match volume.medium.density:
        case ExponentialHeight() as density:
            return min(MARCHING_STEP * density.scale_height, FOG_DEPTH / max(max(volume.medium.sigma_t), 1e-300))
        case NoiseShape() as density:
            # The softness turns the slope of the noise into an edge.
            size = density.noise_size
            if density.billow_octaves > 0 and density.billow_strength != 0.0:
                size = min(size, density.billow_size)
            return min(MARCHING_STEP * size * min(1.0, density.softness), NOISE_DEPTH / max(max(volume.medium.sigma_t), 1e-300))
        case Dust() as density:
            return min(MARCHING_STEP * density.size, NOISE_DEPTH / max(max(volume.medium.sigma_t) * density.largest, 1e-300))
        case Grid() as density:
            thickest = max(volume.medium.sigma_t) * float(density.values.max())
            return min(MARCHING_STEP * VOXELS_PER_FEATURE * _voxel(density), THICKEST_STEP / max(thickest, 1e-300))
        case ExponentialAltitude() as density:
            thickest = max(max(volume.medium.sigma_t), 1e-300)
            return min(AIR_STEP * density.scale_height, AIR_DEPTH / thickest)
    return 0.0


def _voxel(density: Grid) -> float:
    """Smallest side (m) of a voxel."""
    return min((high - low) / n for low, high, n in zip(density.low, density.high, density.values.shape))


def _engine_step(body: Body) -> float:
    """Step (m) of Cycles' ray marching at rate 1: a voxel of a grid, otherwise a tenth of the bounding box's mean extent."""
    density = body.volumes[0].medium.density
    if isinstance(density, Grid):
        return _voxel(density)
    return 0.1 * sum(extent(body.domain)) / 3.0


def _sampling(scene: Scene) -> str:
    """Equiangular sampling where a light stands at a point, distance sampling for parallel light, both where both are."""
    local = any(not isinstance(light, Sun) for light in scene.lights)
    distant = any(isinstance(light, Sun) for light in scene.lights) or max(scene.environment) > 0.0
    if scene.orders > 1 or (local and distant):
        return "MULTIPLE_IMPORTANCE"
    return "EQUIANGULAR" if local else "DISTANCE"


def _eevee(scene: Scene, bodies: Sequence[Body], result: Plan) -> None:
    result.settings.update({
        **sample_settings(EEVEE, result.samples),
        "eevee.use_taa_reprojection": False,
        "eevee.volumetric_tile_size": "2",
        "eevee.volumetric_samples": EEVEE_SLICES,
        "eevee.volumetric_sample_distribution": 0.8,
        "eevee.volumetric_ray_depth": 16,
        "eevee.volumetric_light_clamp": 0.0,
        "eevee.use_volumetric_shadows": True,
        "eevee.volumetric_shadow_samples": 32,
        "eevee.use_volume_custom_range": False,
        "eevee.clamp_surface_direct": 0.0,
        "eevee.clamp_surface_indirect": 0.0,
        "eevee.clamp_volume_direct": 0.0,
        "eevee.clamp_volume_indirect": 0.0,
        "eevee.light_threshold": light_threshold(scene),
        "eevee.use_shadows": True,
        "eevee.shadow_ray_count": 1,
        "eevee.shadow_step_count": 6,
        "eevee.shadow_resolution_scale": 1.0,
        "eevee.use_raytracing": scene.is_dielectric or not result.may("screen tracing"),
        "eevee.use_fast_gi": False,
        "render.filter_size": 1.0,
    })
    if result.settings["eevee.use_raytracing"]:
        result.settings["eevee.ray_tracing_options.resolution_scale"] = "1"
        result.settings["eevee.ray_tracing_options.use_denoise"] = False
        result.settings["eevee.ray_tracing_options.screen_trace_quality"] = 1.0
    else:
        result.decide("screen tracing", "off", "nothing refracts")
    scattering = any(volume.medium.scatters for volume in scene.volumes)
    result.light_enclosure = scattering and result.may("light enclosure") and any(not isinstance(light, Sun) for light in scene.lights)
    if result.light_enclosure:
        result.decide("light enclosure", "an empty volume box around lights and media",
                      "EEVEE shadows the medium only inside the bounds of its volumes")
    result.unit = eevee_unit(scene) if result.may("unit of length") else 1.0
    if result.unit != 1.0:
        result.decide("unit of length", f"{result.unit:g} m", "EEVEE stores the media in 11-bit floats, which lose coefficients "
                      "below 1e-5 per unit")
    result.volume_settings = [{} for _ in bodies]


def eevee_unit(scene: Scene) -> float:
    """Metres in the unit of length in which EEVEE keeps the media's coefficients; 1 where it keeps them in metres.

    The strongest coefficient is then 1 to 10 per unit, unless the scene is so small that it would measure less than a unit.
    """
    coefficients = [sigma for volume in scene.volumes for sigma in volume.medium.sigma_t if sigma > 0.0]
    if not coefficients or min(coefficients) >= EEVEE_COEFFICIENT:
        return 1.0
    size = max(2.0 * reach(scene, scene.camera.position), 1e-300)
    return max(1.0, 10.0 ** math.floor(math.log10(min(10.0 / max(coefficients), size))))


def compositor_loss_allowed(engine: str) -> float:
    """Largest share of the picture's mean that fog in the compositor may miss before a volume takes its place by itself.

    Cycles' volumes have no bias, so the compositor's must be below the 0.2 % that plans may add. EEVEE's own fog misses up to 5 %, and
    more in its pattern.
    """
    return {CYCLES: 0.002, EEVEE: 0.05}[engine]


def eevee_lights(lights: Sequence[Light]) -> str:
    """What EEVEE cannot do of these lights; empty where it can do all."""
    if any(isinstance(light, Projector) and (light.falloff != 2 or light.near > 0.0 or math.isfinite(light.far))
           for light in lights):
        return "EEVEE's lights fall off with the square of the distance and have no near or far end"
    return ""


def light_resolution(volume: Volume, values: Mapping[str, Any]) -> int:
    """Voxels of baked light along the longest side: as many as are asked for, and more where the domain is flat.

    Across its shortest side a layer is lit above and dark below: two voxels (stratus, 32 along its length) mix the two and came
    out 37 % too bright, eight 3 %.
    """
    longest, shortest = max(extent(volume.domain)), min(extent(volume.domain))
    wanted = LIGHT_LAYERS * longest / max(shortest, 1e-300)
    return max(values["light_resolution"], min(MOST_LIGHT, math.ceil(wanted)))


def bakes_light(scene: Scene, volume: Volume, values: Mapping[str, Any]) -> str:
    """Why EEVEE shows baked light in the volume, described by these values; empty where it scatters by itself.

    Measured on the cumulus in Blender 5.2, 64 pixels wide, against path tracing: EEVEE's own scattering with the mean cosine
    -30.6 %, relative RMSE 57 %; with the best single g, 0.15, -24 %, 47 %; all orders baked on 32 voxels -0.8 %, 8 %; orders
    from the second on baked, the first EEVEE's own, +1.3 %, 8 %.
    """
    if values.get("eevee_light") != "baked" or scene.orders < 2 or scene.is_dielectric or not volume.medium.scatters:
        return ""
    return f"EEVEE scatters once, the scene follows {scene.orders} orders"


def participation(scene: Scene, present: Callable[[str, Any], Any]) -> dict[str, Any]:
    """What a user's own scene needs so that the media take part: values by path.

    ``present`` gives the user's value of a path, or the default where there is none. Bounce limits and resolutions are
    raised where they are lower and never lowered; nothing else of the user's render settings is touched.
    """
    bounces = scene.engine_orders - 1
    glass = GLASS_BOUNCES if scene.is_dielectric else 0
    at_least = {
        "cycles.max_bounces": max(bounces, glass),
        "cycles.volume_bounces": bounces,
        "cycles.transmission_bounces": glass,
        "cycles.glossy_bounces": glass,
        "eevee.volumetric_samples": EEVEE_SLICES if any(v.medium.scatters for v in scene.volumes) else 1,
    }
    settings: dict[str, Any] = {path: max(value, present(path, value)) for path, value in at_least.items()}
    settings["eevee.use_volumetric_shadows"] = True
    settings["eevee.clamp_volume_indirect"] = 0.0
    threshold = light_threshold(scene)
    settings["eevee.light_threshold"] = min(threshold, present("eevee.light_threshold", threshold))
    if scene.is_dielectric:
        settings["eevee.use_raytracing"] = True
    return settings
