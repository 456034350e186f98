# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's own scene as the planner sees it: plain data in the scene's units, W and radians, without Blender.

What is unknown is written so that no rule can be wrong about it: an extinction of infinity, an albedo of 1, a feature of 0, and
``moves`` for whatever may not stay where it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..scene.model import Vector


@dataclass(frozen=True)
class Range:
    """Bounds of a value over a domain, and of its change over a unit of length: a rate of 0 is the same everywhere."""

    low: float
    high: float
    rate: float = 0.0

    @property
    def is_constant(self) -> bool:
        return self.low == self.high


ANY, UNKNOWN = Range(-math.inf, math.inf), Range(-math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class Substance:
    """Bounds of what a volume material does anywhere in its domain.

    ``extinction`` (1/m) is that of the densest channel. ``albedo`` bounds the single-scattering albedo of all channels, ``g`` the
    magnitude of the mean cosine. ``feature`` (m) is the smallest distance over which the density changes by much, 0 where unknown.
    """

    extinction: Range = Range(0.0, math.inf)
    albedo: float = 1.0
    g: float = 1.0
    emits: bool = True
    textured: bool = True
    feature: float = 0.0


@dataclass(frozen=True)
class Medium:
    """An object, or the world (no ``corners``), that holds a medium. ``corners`` are the eight of its bounding box."""

    name: str
    material: str
    substance: Substance
    corners: tuple[Vector, ...] = ()
    moves: bool = False
    has_surface: bool = False
    voxels: bool = False
    sampling: str = "MULTIPLE_IMPORTANCE"
    step_rate: float = 1.0
    step: float = 0.0  # the length (m) of a step of ray marching at rate 1
    editable: bool = True
    shared: bool = False  # whether objects that are not listed here have the material too


@dataclass(frozen=True)
class Lamp:
    """A light: ``power`` (W, a sun W/m^2) of its strongest channel, ``radius`` (m) of what shines, a spot's full ``cone`` (rad).

    The power is infinite where it is not known. ``is_linked``: the user has chosen what receives it; such a lamp is left alone.
    """

    name: str
    kind: str
    power: float
    position: Vector = (0.0, 0.0, 0.0)
    direction: Vector = (0.0, 0.0, -1.0)
    radius: float = 0.0
    cone: float = 0.0
    moves: bool = False
    is_linked: bool = False
    editable: bool = True
    volume_factor: float = 1.0
    is_hit: bool = False  # whether rays that come upon it by chance count: Cycles' multiple importance sampling


@dataclass(frozen=True)
class View:
    """A perspective camera: half extents of the picture at distance 1 around the (shifted) axis."""

    position: Vector
    right: Vector
    up: Vector
    back: Vector
    low: tuple[float, float]
    high: tuple[float, float]
    clip_end: float
    moves: bool = False

    def point(self, x: float, y: float, depth: float) -> Vector:
        """Of the picture's plane at this depth; x and y in units of the depth."""
        return tuple(p + depth * (x * r + y * u - b)
                     for p, r, u, b in zip(self.position, self.right, self.up, self.back))


@dataclass(frozen=True)
class Solids:
    """Everything else that is rendered: the corners of a box around what of it is in the picture (none where nothing is), whether
    any of it may move, and whether any in the picture mirrors or refracts what is around it."""

    corners: tuple[Vector, ...] = ()
    moves: bool = False
    reflects: bool = False


@dataclass(frozen=True)
class Survey:
    """Of each lamp, over places in the picture and on light paths to it: its unshaded light there, the tests whether something is
    in the way that were drawn in proportion to it, and how many got through. Of media that few paths or none came upon: how many
    paths were traced, and how many met the medium's box, on their way or on that to a lamp."""

    lamps: Mapping[str, tuple[float, int, int]]
    places: int
    media: Mapping[str, tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class Noise:
    """What a pilot has measured of a picture of Cycles: the variance of one sample, its mean over pixels and channels, and the mean
    brightness, the sum of the channels; ``pieces``: the variance over the brightness, of equal pieces of the picture."""

    variance: float
    brightness: float
    pieces: tuple[float, ...]


@dataclass(frozen=True)
class Cells:
    """What a pilot tells of EEVEE, relative RMSE: ``error``, by which the scene's own cells are off finer ones, rather too little; and
    ``noise``, of which n samples have 1 / sqrt(n) from eight on, rather too much. Seconds are those of a sample with either."""

    error: float
    noise: float
    own_seconds: float
    finer_seconds: float


@dataclass(frozen=True)
class Observed:
    """The scene: settings by path are read as they are asked for in ``settings``.

    ``solids`` is None where all media are in the picture, and nobody needs to know. ``faces`` are flat, convex and opaque; ``room``
    holds the corners of the bounding box of a closed, convex and opaque mesh around the camera.
    """

    engine: str
    settings: Mapping[str, Any]
    view: View | None = None
    media: tuple[Medium, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    solids: Solids | None = None
    environment: float = 0.0  # bound of the world's radiance, its strongest channel; infinite where it is a picture
    sky_rate: float = 0.0  # bound of its change over a radian; 0 for one colour, infinite where nothing is known
    aimed_sky: bool = True  # whether rays are aimed at the world, where it is not of one colour
    world: str = ""  # name of the world where the map of its brightness may be changed
    probe: tuple[str, int] | None = None  # the world, and the width of EEVEE's map of its light, where that may be changed
    sky_shadows: bool = False  # whether EEVEE draws shadow maps for a sun in that world, where it finds none
    survey: Survey | None = None
    faces: tuple[tuple[Vector, ...], ...] = ()
    room: tuple[Vector, ...] = ()
    frames: int = 1
    has_emitters: bool = False  # meshes that shine
    has_surfaces: bool = False
    mirrors: bool = True  # whether any surface mirrors or refracts what is around it
    touches: bool = True  # whether a face of a medium's box may lie in a surface: rays then lose count of what they are in
    has_instances: bool = False  # of objects that hold media or lights and are not listed
    unused_passes: tuple[tuple[str, str], ...] = ()  # view layer and path
    pixels: float = 0.0  # of a picture
    viewport: float = 0.0  # pixels of the largest 3D viewport that shows media
    samples: float = 0.0  # of a pixel, at most
    paths: float = 0.0  # camera paths of a picture: its pixels times the samples that they are expected to take
    noise: Noise | None = None  # where a pilot was rendered
    cells: Cells | None = None  # where a pilot in EEVEE had all its shadows
    dithers: bool = True  # whether EEVEE takes samples for more than edges, shadows and media: blur, traced rays, transparency
    null_scattering: bool = True  # whether the engine has it beside ray marching
