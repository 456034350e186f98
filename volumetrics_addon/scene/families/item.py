# SPDX-License-Identifier: GPL-3.0-or-later
"""What a family makes: volumes, lights and bodies; and what a fitted domain is fitted to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ..model import Color, Light, Surface, Vector, Volume, scaled


class Item:
    """What one family adds to a scene: volumes, lights and opaque bodies."""

    def __init__(self, volumes: Iterable[Volume], lights: Iterable[Light] = (), surfaces: Iterable[Surface] = ()):
        self.volumes, self.lights, self.surfaces = tuple(volumes), tuple(lights), tuple(surfaces)


class Bounds:
    """Axis-aligned bounds of the points that a fitted domain has to cover."""

    def __init__(self, points: Iterable[Vector]):
        points = list(points)
        if not points:
            raise ValueError("there is nothing to fit the fog to; add a camera or an object to the scene")
        self.low = tuple(min(p[i] for p in points) for i in range(3))
        self.high = tuple(max(p[i] for p in points) for i in range(3))


def scattering(values: Mapping[str, Any]) -> tuple[Color, Color]:
    """(sigma_s, sigma_a) from extinction and albedo."""
    extinction, albedo = values["extinction"], values["albedo"]
    return scaled(albedo, extinction), tuple(extinction * (1.0 - a) for a in albedo)
