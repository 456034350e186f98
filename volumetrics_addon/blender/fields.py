# SPDX-License-Identifier: GPL-3.0-or-later
"""What the material of a volume reads from arrays."""

from __future__ import annotations

from dataclasses import dataclass

from ..scene.model import Grid, Volume
from . import grid, light


@dataclass(frozen=True)
class Fields:
    """Density from ``voxels``, which the nodes ``cut`` at the domain, and in EEVEE the ``glow`` of scattered light."""

    voxels: bool = False
    cut: bool = False
    glow: light.Picture | None = None


def fields_of(volume: Volume, glow: light.Picture | None = None) -> Fields:
    if not isinstance(volume.medium.density, Grid):
        return Fields(glow=glow)
    return Fields(True, grid.needs_cut(volume), glow)
