# SPDX-License-Identifier: GPL-3.0-or-later
"""A grid of scattered light as an image that EEVEE's material looks up, trilinearly, by position.

Neither engine can read a second grid of another resolution, and a medium of nodes has no grid at all; an image serves both,
in every version. Its tiles are the layers of the grid from below to above, row by row.

The nodes look up the eight texels around a position and interpolate by themselves. With the image's own interpolation
EEVEE takes a coarser level of its mipmap, by how far the coordinates are apart from one froxel to the next: J of one layer
is then mixed with that of others (measured on the cumulus: -20 % instead of -0.8 %, and in ten times the time on a CPU).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..scene.model import Vector, subtract
from . import images
from .nodes import Tree, socket_of

if TYPE_CHECKING:
    from ..reference.light_grid import LightGrid


@dataclass(frozen=True)
class Picture:
    """An image of a grid of ``shape``, whose lowest corner lies at ``low`` from the object's origin."""

    image: bpy.types.Image
    shape: tuple[int, int, int]
    low: Vector
    cell: float


def picture(light: LightGrid, origin: Vector, name: str) -> Picture:
    """The layers of the grid side by side, linear and packed into the file, for an object at ``origin``."""
    nx, ny, nz = light.values.shape[:3]
    columns = math.ceil(math.sqrt(nz * ny / nx))
    rows = math.ceil(nz / columns)
    pixels = np.zeros((rows, ny, columns, nx, 3), np.float32)
    for k in range(nz):
        pixels[k // columns, :, k % columns] = light.values[:, :, k].transpose(1, 0, 2)
    image = images.packed(pixels.reshape(rows * ny, columns * nx, 3), name)
    return Picture(image, (nx, ny, nz), subtract(light.low, origin), light.cell)


def radiance(build: Tree, picture: Picture) -> bpy.types.NodeSocket:
    """Vector socket with the grid's value at the object's coordinates."""
    (nx, ny, nz), cell = picture.shape, picture.cell
    width, height = picture.image.size
    columns = width // nx
    position = socket_of(build.node("ShaderNodeTexCoord").outputs, "Object")
    first = tuple(corner + cell / 2.0 for corner in picture.low)
    place = build.vector("DIVIDE", build.vector("SUBTRACT", position, first), (cell,) * 3)
    place = build.vector("MINIMUM", build.vector("MAXIMUM", place, (0.0,) * 3), (nx - 1.0, ny - 1.0, nz - 1.0))
    sides, parts = [], []
    for coordinate, count in zip(build.components(place), (nx, ny, nz)):
        below = build.math("FLOOR", coordinate)
        sides.append((below, build.math("MINIMUM", build.math("ADD", below, 1.0), count - 1.0)))
        parts.append(build.math("SUBTRACT", coordinate, below))
    across = [build.math("ADD", i, 0.5) for i in sides[0]]
    along = [build.math("ADD", j, 0.5) for j in sides[1]]
    tiles = []
    for k in sides[2]:
        row = build.math("FLOOR", build.math("DIVIDE", build.math("ADD", k, 0.5), float(columns)))
        tiles.append((build.math("MULTIPLY_ADD", row, -float(columns), k), row))

    def texel(i: int, j: int, k: int) -> bpy.types.NodeSocket:
        u = build.math("MULTIPLY_ADD", tiles[k][0], float(nx), across[i])
        v = build.math("MULTIPLY_ADD", tiles[k][1], float(ny), along[j])
        place = build.vector("DIVIDE", build.combine(u, v, 0.0), (float(width), float(height), 1.0))
        node = build.node("ShaderNodeTexImage", {"Vector": place}, image=picture.image, interpolation="Closest",
                          extension="EXTEND")
        return socket_of(node.outputs, "Color")

    def between(low: bpy.types.NodeSocket, high: bpy.types.NodeSocket, part: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        return build.node("ShaderNodeVectorMath", {0: build.vector("SUBTRACT", high, low), 1: build.combine(part, part, part),
                                                   2: low}, operation="MULTIPLY_ADD").outputs[0]

    rows = [[between(texel(0, j, k), texel(1, j, k), parts[0]) for j in (0, 1)] for k in (0, 1)]
    return between(*(between(*row, parts[1]) for row in rows), parts[2])
