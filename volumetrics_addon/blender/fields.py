# SPDX-License-Identifier: GPL-3.0-or-later
"""What the material of a volume reads from arrays."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..scene.model import Ellipsoid, Grid, Volume
from . import grid, light, pane


@dataclass(frozen=True)
class Fields:
    """Density from ``voxels``, which the nodes ``cut`` at the domain, and in EEVEE the ``glow`` of scattered light. The
    ``cavity`` of a hollow body bounds the path through its wall, and ``cover`` pictures what lies on a pane.
    ``measured``: the way through the body is in attributes of its mesh (see chords).
    """

    voxels: bool = False
    cut: bool = False
    glow: light.Picture | None = None
    cavity: Ellipsoid | None = None
    cover: bpy.types.Image | None = None
    measured: bool = False


def fields_of(volume: Volume, glow: light.Picture | None = None) -> Fields:
    if volume.sheet is not None:
        return Fields(cover=pane.picture(volume, "Pane"))
    if not isinstance(volume.medium.density, Grid):
        return Fields(glow=glow, cavity=volume.cavity)
    return Fields(True, grid.needs_cut(volume), glow)
