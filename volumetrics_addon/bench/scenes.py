# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of the benchmark, each with the integrator that knows its truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..parameters.preset import load
from ..scene import assemble
from ..scene.model import (
    Box, Camera, Ellipsoid, ExponentialAltitude, Medium, NoiseShape, Phase, Point, RayleighPhase, Scene, Sun, Surface, Volume,
    normalized, subtract,
)

EARTH_RADIUS = 6_360_000.0
ATMOSPHERE_TOP = 6_420_000.0
RAYLEIGH = (5.802e-6, 13.558e-6, 33.1e-6)  # at 680, 550 and 440 nm, Bruneton and Neyret 2008
MIE_SCATTERING, MIE_ABSORPTION = 3.996e-6, 4.40e-7
SUN_IRRADIANCE = (1.5, 1.5, 1.5)  # about that of the sun in each of the three bands, W m^-2 nm^-1


@dataclass(frozen=True)
class BenchScene:
    """A scene, what it shows, and the integrator and settings that give its truth at pixel centres."""

    name: str
    title: str
    make: Callable[[], Scene]
    truth: str
    truth_settings: Mapping[str, Any] = field(default_factory=dict)


def _preset(name: str, **changes: Any) -> Callable[[], Scene]:
    def make() -> Scene:
        preset = load(name)
        return replace(assemble.scene(preset.family, preset.parameters, preset.stage, preset.props), **changes)
    return make


def _looking(position, target, field_of_view: float) -> Camera:
    return Camera(position, normalized(subtract(target, position)), math.radians(field_of_view))


def _street_lamp() -> Scene:
    fog = Medium((0.05, 0.05, 0.05), (0.005, 0.005, 0.005), Phase(0.6))
    return Scene(_looking((0.0, -12.0, 2.0), (0.0, 0.0, 4.0), 50.0), (Point((0.0, 0.0, 5.0), (4000.0, 3200.0, 2000.0)),),
                 volumes=(Volume(Box((0.0, 0.0, 10.0), (40.0, 40.0, 10.0)), fog),))


def _noise_cloud(extinction: float, orders: int) -> Scene:
    half = (150.0, 150.0, 90.0)
    shape = NoiseShape((0.0, 0.0, 0.0), half, 90.0, 3.0, 0.5, 0.8, 0.62, 0.35, 3)
    albedo = 0.999
    medium = Medium((extinction * albedo,) * 3, (extinction * (1.0 - albedo),) * 3, Phase(0.8, -0.2, 0.2), shape)
    sun = Sun(assemble.sun_direction(math.radians(40.0), math.radians(60.0)), (3.0, 2.9, 2.7))
    return Scene(_looking((0.0, -480.0, -40.0), (0.0, 0.0, 0.0), 42.0), (sun,), (0.15, 0.2, 0.3),
                 (Volume(Ellipsoid((0.0, 0.0, 0.0), half), medium),), orders=orders)


def _slab() -> Scene:
    medium = Medium((1.98, 1.9, 1.6), (0.02, 0.1, 0.4), Phase(0.75))
    sun = Sun(assemble.sun_direction(math.radians(50.0), math.radians(30.0)), (3.0, 3.0, 3.0))
    return Scene(_looking((0.0, -30.0, 20.0), (0.0, 0.0, 0.0), 30.0), (sun,), volumes=(
        Volume(Box((0.0, 0.0, 0.0), (200.0, 200.0, 1.0)), medium),), orders=256)


def planet_scene(camera: Camera, sun_elevation: float, orders: int, mie: float = 1.0) -> Scene:
    """Earth with molecules (scale height 8500 m) and aerosol (1200 m) under a sun at this elevation (rad)."""
    center = (0.0, 0.0, -EARTH_RADIUS)
    top = Ellipsoid(center, (ATMOSPHERE_TOP,) * 3)
    air = Medium(RAYLEIGH, (0.0, 0.0, 0.0), RayleighPhase(), ExponentialAltitude(center, EARTH_RADIUS, 8500.0))
    aerosol = Medium((mie * MIE_SCATTERING,) * 3, (mie * MIE_ABSORPTION,) * 3, Phase(0.76),
                     ExponentialAltitude(center, EARTH_RADIUS, 1200.0))
    sun = Sun(assemble.sun_direction(sun_elevation, math.radians(20.0)), SUN_IRRADIANCE)
    return Scene(camera, (sun,), volumes=(Volume(top, air), Volume(top, aerosol)),
                 surfaces=(Surface(Ellipsoid(center, (EARTH_RADIUS,) * 3), (0.1, 0.1, 0.1)),), orders=orders)


def _sky(sun_elevation: float) -> Callable[[], Scene]:
    camera = _looking((0.0, 0.0, 100.0), (0.0, 1000.0, 420.0), 75.0)
    return lambda: planet_scene(camera, math.radians(sun_elevation), 8)


EXACT = {"order": 64}
TRACED: Mapping[str, Any] = {"samples": 512, "repeats": 8}
# Path tracing agrees with these tables to its own noise, which takes hours to fall to theirs.
TABLES: Mapping[str, Any] = {"resolution": 20, "orders": 8, "order": 32}

SCENES: tuple[BenchScene, ...] = (
    BenchScene("street-lamp", "Point light in fog", _street_lamp, "single_scattering", EXACT),
    BenchScene("spot-streaks", "Spot through slats", _preset("theatre-slats"), "single_scattering", EXACT),
    BenchScene("spot-gobo", "Spot with a window gobo", _preset("window-light"), "single_scattering", EXACT),
    BenchScene("valley-fog", "Height fog at grazing angles", _preset("morning-valley", environment=(0.0, 0.0, 0.0)),
               "single_scattering", EXACT),
    BenchScene("thin-cloud", "Thin cloud", lambda: _noise_cloud(0.008, 16), "path_tracing", TRACED),
    BenchScene("dense-cloud", "Dense cloud", lambda: _noise_cloud(0.08, 256), "path_tracing", TRACED),
    BenchScene("slab", "Slab of optical depth 4", _slab, "path_tracing", TRACED),
    BenchScene("sky-noon", "Sky at noon", _sky(60.0), "sky_tables", TABLES),
    BenchScene("sky-sunset", "Sky at sunset", _sky(2.0), "sky_tables", TABLES),
    BenchScene("glass", "Glass ball on a light table", _preset("emerald-sphere"), "dielectric", {"cut": 1e-10}),
)


def by_name(name: str) -> BenchScene:
    """The scene of that name. Raises ValueError for an unknown one."""
    for scene in SCENES:
        if scene.name == name:
            return scene
    raise ValueError(f"there is no benchmark scene {name!r}; the scenes are {', '.join(s.name for s in SCENES)}")
