# SPDX-License-Identifier: GPL-3.0-or-later
"""One colour channel of a Scene, as a Scene in grey: what the engines render where lobes of different colours mix."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .body import Body
from .model import Color, Light, Medium, Projector, Scene, Sun, Surface, Volume

CHANNELS = range(3)


def mixes(medium: Medium, other: Medium) -> bool:
    """Whether two media that fill one place give each channel another mixture of their phase functions."""
    if medium.phase == other.phase:
        return False
    s, t = medium.sigma_s, other.sigma_s
    products = [(s[i] * t[j], s[j] * t[i]) for i in CHANNELS for j in CHANNELS if i < j]
    return any(abs(a - b) > 1e-9 * max(a, b) for a, b in products)


def channel(scene: Scene, index: int) -> Scene:
    """The Scene with every colour replaced by that channel of it: its picture has that channel's radiance in all three."""
    return replace(
        scene, environment=_grey(scene.environment, index), lights=tuple(_light(light, index) for light in scene.lights),
        volumes=tuple(_volume(volume, index) for volume in scene.volumes),
        surfaces=tuple(Surface(s.shape, _grey(s.albedo, index), _grey(s.emission, index)) for s in scene.surfaces))


def channel_body(body: Body, index: int) -> Body:
    values = {p.name: _grey(body.values[p.name], index) if p.kind == "color" else body.values[p.name]
              for p in body.family.parameters}
    return replace(body, values=values, volumes=tuple(_volume(volume, index) for volume in body.volumes))


def _grey(color: Color, index: int) -> Color:
    return (color[index],) * 3


def _volume(volume: Volume, index: int) -> Volume:
    medium = volume.medium
    colors = {name: _grey(getattr(medium, name), index) for name in ("sigma_s", "sigma_a", "ambient")}
    return replace(volume, medium=replace(medium, **colors))


def _light(light: Light, index: int) -> Light:
    match light:
        case Sun():
            return replace(light, irradiance=_grey(light.irradiance, index))
        case Projector():
            return replace(light, power=_grey(light.power, index), gobo=_plane(light.gobo, index))
    return replace(light, power=_grey(light.power, index))


def _plane(gobo: Any, index: int) -> Any:
    return gobo[..., index] if gobo is not None and len(gobo.shape) == 3 else gobo
