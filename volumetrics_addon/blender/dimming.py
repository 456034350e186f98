# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of EEVEE, which does not dim light on its way to surfaces: they shine there with what is left of it.

Cycles, which dims it, ignores these factors of a lamp.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ..parameters.model import Group
from ..reference import optics
from ..scene.model import Color, Projector, Spot, Volume
from .nodes import read_live

ON_SURFACES = ("diffuse_factor", "specular_factor", "transmission_factor")
ALIKE = 0.01  # by which shares of the channels may differ to count as grey


def apply(lamp: bpy.types.Object, surfaces: Color, media: Color, collection: bpy.types.Collection) -> None:
    """Let a lamp shine with these shares of its light on surfaces and in media.

    Shares that are grey in the light's own colours are factors of the lamp. Others make two lamps of it, one for each.
    """
    data = lamp.data
    both = [_grey(share, data.color) for share in (surfaces, media)]
    if None not in both:
        for name in ON_SURFACES:
            setattr(data, name, both[0])
        data.volume_factor = both[1]
        return
    twin = lamp.copy()
    twin.data = data.copy()
    twin.name = twin.data.name = f"{lamp.name} in media"
    collection.objects.link(twin)
    data.volume_factor = 0.0
    for name in ON_SURFACES:
        setattr(twin.data, name, 0.0)
    for light, share in ((data, surfaces), (twin.data, media)):
        color = [c * s for c, s in zip(light.color, share)]
        strength = max(color)
        light.energy *= strength
        light.color = [c / strength for c in color] if strength > 0.0 else color


def _grey(share: Color, color: Color) -> float | None:
    """The share of a light of this colour as one number; None where its channels differ."""
    parts = [s for s, c in zip(share, color) if c > 0.0]
    if not parts:
        return 1.0
    middle = (min(parts) + max(parts)) / 2.0
    return middle if max(parts) - min(parts) <= ALIKE * middle else None


def follow(lamp: bpy.types.Object, source: Spot | Projector, distance: float, media: Sequence[Volume], material: bpy.types.Material,
           node: bpy.types.Node, family: Group) -> None:
    """Let a lamp shine on surfaces with exp(-extinction way), by drivers that need no permission to run Python.

    ``way`` (m) is that through the haze on the first ``distance`` of the beam, dust with its mean density; the extinction is the
    live parameter of the family's ``node`` in the material.
    """
    origin, direction = (np.array([vector], float) for vector in (source.position, source.direction))
    way = sum(float(optics.mean_depth(volume, origin, direction, distance)[0]) for volume in media)
    for name in ON_SURFACES:
        driver = lamp.data.driver_add(name).driver
        driver.type = "SCRIPTED"
        read_live(driver, "extinction", material, node, family)
        driver.expression = f"exp(-{way:.6g} * extinction)"
