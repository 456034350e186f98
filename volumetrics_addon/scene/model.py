# SPDX-License-Identifier: GPL-3.0-or-later
"""The Scene: the hub that presets make and that every engine and integrator consumes.

Frozen dataclasses of plain numbers in SI units: metres, radians, W m^-2 sr^-1, extinction in 1/m. Colours are
linear Rec.709 triples. Standard library only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

Vector = tuple[float, float, float]
Color = tuple[float, float, float]

IDENTITY: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def add(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scaled(a: Vector, factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def normalized(a: Vector) -> Vector:
    """a / |a|. Raises ValueError for the zero vector, which has no direction."""
    length = math.hypot(*a)
    if length == 0.0:
        raise ValueError(f"{a} has no direction; keep position and target apart")
    return scaled(a, 1.0 / length)


def look_frame(direction: Vector) -> tuple[Vector, Vector, Vector]:
    """Orthonormal (right, up, back) of a camera or light that looks along ``direction``, z up where it can be."""
    back = scaled(normalized(direction), -1.0)
    reference = (0.0, 1.0, 0.0) if abs(back[2]) > 1.0 - 1e-9 else (0.0, 0.0, 1.0)
    right = normalized(cross(reference, back))
    return right, cross(back, right), back


def turned(angle: float) -> tuple[Vector, Vector, Vector]:
    """Axes of a body rotated by ``angle`` (rad) about z."""
    c, s = math.cos(angle), math.sin(angle)
    return (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)


# --- shapes (all convex) ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Box:
    """Box with half sizes ``half`` along its orthonormal ``axes``. A half size of 0 makes a plane."""

    center: Vector
    half: Vector
    axes: tuple[Vector, Vector, Vector] = IDENTITY

    @property
    def corners(self) -> tuple[Vector, ...]:
        return tuple(
            add(self.center, tuple(sum(sign * self.half[k] * self.axes[k][i] for k, sign in enumerate(signs))
                                   for i in range(3)))
            for signs in ((x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)))


@dataclass(frozen=True)
class Ellipsoid:
    """Ellipsoid with radii ``half`` along its orthonormal ``axes``."""

    center: Vector
    half: Vector
    axes: tuple[Vector, Vector, Vector] = IDENTITY


@dataclass(frozen=True)
class Cone:
    """Circular cone from ``apex`` along the unit ``axis``, cut flat at the distance ``length``."""

    apex: Vector
    axis: Vector
    half_angle: float
    length: float


@dataclass(frozen=True)
class Hull:
    """Convex polyhedron: ``corners``, and ``faces`` as indices of corners, counterclockwise seen from outside."""

    corners: tuple[Vector, ...]
    faces: tuple[tuple[int, ...], ...]

    @property
    def planes(self) -> tuple[tuple[Vector, Vector], ...]:
        """A point and the unit outward normal of each face, by Newell's sum: the face's corners need not be exactly in a plane."""
        result = []
        for face in self.faces:
            points = [self.corners[index] for index in face]
            total = (0.0, 0.0, 0.0)
            for a, b in zip(points, points[1:] + points[:1]):
                total = add(total, cross(subtract(a, points[0]), subtract(b, points[0])))
            result.append((points[0], normalized(total)))
        return tuple(result)


def swept(first: tuple[Vector, ...], last: tuple[Vector, ...]) -> Hull:
    """The hull between two convex polygons of equally many corners, both counterclockwise seen from the side of ``last``.

    The polygons lie in planes and corresponding sides are parallel: prisms, skewed ones too, and frusta.
    """
    n = len(first)
    sides = [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)]
    return Hull((*first, *last), (tuple(reversed(range(n))), *sides, tuple(range(n, 2 * n))))


Shape = Box | Ellipsoid | Cone | Hull


# --- medium -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Homogeneous:
    """Density 1 everywhere in the domain."""


@dataclass(frozen=True)
class ExponentialHeight:
    """Density exp(-(z - base_height) / scale_height)."""

    scale_height: float
    base_height: float


PROFILES = ("round", "dome", "tower", "anvil", "layer")
CELL_HASHES = ("pcg3d", "lookup3")


@dataclass(frozen=True)
class NoiseShape:
    """A cloud: billows and wisps cut from a smooth body by fractal Perlin noise and by cells.

    density = clamp(min(fill - d + noise_strength (2 n - 1) + billow_strength b, 1 - d) / softness, 0, 1) s, with

    * d the distance from the body's middle, 1 at the faces of the domain, by ``profile``. With q = (p - center) / half,
      r^2 = qx^2 + qy^2 and the height u = (qz + 1) / 2 over the domain's floor: round (r^2 + qz^2)^1/2, dome
      (r^2 + u^2)^1/2, tower (r^4 + u^4)^1/4, layer (r^8 + qz^2)^1/2, and anvil a narrow tower under a flat round top;
    * n the normalised fractal noise in [0, 1] and b = 0.37 - the weighted mean of F1^2 over ``billow_octaves``, F1 the
      distance to the nearest random point: bulges with creases between them. Both at
      (p - center - drift) / (stretch, 1, 1) / size + offset(seed), lifted by ``evolution`` at speeds of their own;
      ``cell_hash`` tells which random points: those of Blender 5 and later, or of Blender before;
    * s a smoothstep of u / base: a flat floor that fades over this share of the height; 1 where base is 0.
    """

    center: Vector
    half: Vector
    noise_size: float
    detail: float
    roughness: float
    noise_strength: float
    fill: float
    softness: float
    seed: int
    profile: str = PROFILES[0]
    billow_size: float = 1.0
    billow_strength: float = 0.0
    billow_octaves: int = 0
    billow_roughness: float = 0.5
    base: float = 0.0
    stretch: float = 1.0
    drift: Vector = (0.0, 0.0, 0.0)
    evolution: float = 0.0
    cell_hash: str = CELL_HASHES[0]


@dataclass(frozen=True)
class Dust:
    """Drifting haze: density max(0, 1 + strength (2 n - 1)), with n the normalised fractal noise in [0, 1].

    It is taken at (p - drift) / size + offset(seed).
    Its mean is near 1 while strength <= 1; a larger one leaves clear air between the swathes.
    """

    strength: float
    size: float
    seed: int = 0
    drift: Vector = (0.0, 0.0, 0.0)

    @property
    def largest(self) -> float:
        """Bound of the density."""
        return 1.0 + self.strength


@dataclass(frozen=True)
class ExponentialAltitude:
    """Density exp(-(|p - center| - radius) / scale_height): a planet's atmosphere, 1 at the ground."""

    center: Vector
    radius: float
    scale_height: float


@dataclass(frozen=True, eq=False)
class Grid:
    """Trilinear voxels: ``values`` (nx, ny, nz), a float array >= 0 sampled at the cell centres of the box, 0 outside it."""

    values: Any
    low: Vector
    high: Vector


Density = Homogeneous | ExponentialHeight | NoiseShape | Dust | ExponentialAltitude | Grid


@dataclass(frozen=True)
class Phase:
    """(1 - weight) HG(g0) + weight HG(g1), per steradian; weight 0 is a single lobe."""

    g0: float
    g1: float = 0.0
    weight: float = 0.0

    @property
    def mean_cosine(self) -> float:
        return (1.0 - self.weight) * self.g0 + self.weight * self.g1


@dataclass(frozen=True)
class RayleighPhase:
    """Molecules: 3 / (16 pi) (1 + cos^2)."""

    mean_cosine = 0.0


@dataclass(frozen=True)
class MiePhase:
    """The HG + Draine fit to water droplets of this diameter (micrometres, 5 to 50)."""

    droplet_diameter: float


AnyPhase = Phase | RayleighPhase | MiePhase


@dataclass(frozen=True)
class Medium:
    """Scattering and absorption coefficients (1/m, per channel) where the density is 1.

    ``ambient`` is a radiance that reaches every point of the medium from all sides, unshadowed and undimmed, and is scattered
    once: it stands for all light that has come from elsewhere, so its further orders are in it.
    """

    sigma_s: Color
    sigma_a: Color
    phase: AnyPhase = Phase(0.0)
    density: Density = Homogeneous()
    ambient: Color = (0.0, 0.0, 0.0)

    @property
    def sigma_t(self) -> Color:
        return add(self.sigma_s, self.sigma_a)

    @property
    def scatters(self) -> bool:
        return max(self.sigma_s) > 0.0

    @property
    def glows(self) -> bool:
        """Whether ambient light is scattered."""
        return any(s * a > 0.0 for s, a in zip(self.sigma_s, self.ambient))


@dataclass(frozen=True)
class Octaves:
    """Multiple scattering made short for an engine; the references follow the full transport instead.

    A ray that leaves the path's event number d + 1, and the event at its end, belong to octave d (the camera's ray to octave
    0): there the extinction is multiplied by extinction^d, the mean cosine by phase^d and the scattering coefficient by
    contribution^d. Single scattering stays exact. After ``count`` events the path ends. contribution <= extinction keeps the
    energy. In the spirit of Wrenninge, Kulla and Lundqvist, Oz: The Great and Volumetric (2013).
    """

    count: int
    extinction: float
    phase: float
    contribution: float

    def __post_init__(self) -> None:
        if self.contribution > self.extinction:
            raise ValueError(f"octave_contribution must be <= octave_extinction, got {self.contribution:g} > "
                             f"{self.extinction:g}; more would be scattered than is lost")


@dataclass(frozen=True)
class Dielectric:
    """Smooth interface with this index of refraction inside and 1 outside."""

    ior: float


MOST_CELLS = 128  # of a cover across a pane: its picture has 1024 pixels


@dataclass(frozen=True)
class Cover:
    """What lies opaque on a pane (``pattern``: uniform, dirt or lead): Lambert of ``albedo`` over the share ``coverage`` of its area, where ``scene.pane`` tells.

    ``size`` (m) is that of a cell between leads or of a speck of dirt, ``softness`` how gradually dirt begins, in [0, 1].
    ``variation`` turns the colour of the glass from cell to cell, by up to so many halves of the colour circle either way.
    """

    pattern: str
    coverage: float
    albedo: Color
    size: float = 1.0
    softness: float = 0.0
    variation: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Sheet:
    """A pane drawn as a plane: its ``thickness`` (m) counts for the light that crosses it, not for its place."""

    thickness: float
    cover: Cover | None = None


@dataclass(frozen=True)
class Volume:
    """A medium in a domain, with or without a refracting boundary. ``octaves`` is for the engines alone.

    ``cavity`` is an ellipsoid inside the domain that holds nothing: the body is a hollow shell, whose inner surface refracts
    as the outer one does. Only homogeneous media that absorb have one.

    With a ``sheet`` the domain is a plane, a box of which one half size is 0, and stands for a pane of that thickness. Light
    goes on where it was going, dimmed as by the whole plate, and what the plate mirrors leaves from the plane.
    """

    domain: Shape
    medium: Medium
    boundary: Dielectric | None = None
    octaves: Octaves | None = None
    cavity: Ellipsoid | None = None
    sheet: Sheet | None = None

    @property
    def has_surface(self) -> bool:
        """Whether light meets something at the faces of the domain, rather than only within it."""
        return self.boundary is not None or self.sheet is not None

    def __post_init__(self) -> None:
        if self.sheet is not None:
            flat = isinstance(self.domain, Box) and sum(half == 0.0 for half in self.domain.half) == 1
            if not flat or self.cavity is not None:
                raise ValueError(f"a pane's domain is a box of which one half size is 0, got {self.domain}; set one to 0")
            if self.medium.scatters or not isinstance(self.medium.density, Homogeneous):
                raise ValueError(f"only a homogeneous medium that absorbs may be a pane, got {self.medium}; model its thickness")
            cover, longer = self.sheet.cover, 2.0 * max(self.domain.half)
            if cover is not None and cover.pattern != "uniform" and longer > (1.0 + 1e-9) * MOST_CELLS * cover.size:
                raise ValueError(f"coverage_size = {cover.size:g} m is too small for a pane of {longer:g} m: more than "
                                 f"{MOST_CELLS} cells lie across it; make it at least {longer / MOST_CELLS:.3g} m")
        if self.cavity is None:
            return
        if self.medium.scatters or not isinstance(self.medium.density, Homogeneous):
            raise ValueError(f"only a homogeneous medium that absorbs may be hollow, got {self.medium}; leave the cavity out")
        inner, outer = self.cavity, self.domain
        if not isinstance(outer, Ellipsoid) or (inner.center, inner.axes) != (outer.center, outer.axes) or any(
                not 0.0 < i < o for i, o in zip(inner.half, outer.half)):
            raise ValueError(f"a cavity must be a smaller ellipsoid at the centre of an ellipsoid, got {inner} in {outer}; make "
                             "the wall thinner than half of the smallest size")


# --- lights, surfaces, camera -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sun:
    """Parallel light travelling along the unit ``direction`` with the given perpendicular irradiance."""

    direction: Vector
    irradiance: Color


@dataclass(frozen=True)
class Point:
    """Isotropic point light of radiant intensity power / (4 pi)."""

    position: Vector
    power: Color


@dataclass(frozen=True)
class Spot:
    """Point light with a cone: intensity power / (4 pi) (not renormalised) times a smoothstep over the blend.

    ``cone_angle`` is the full angle in radians. Inside, s = clamp((cos - c) / ((1 - c) blend)), c = cos(cone_angle / 2),
    and the factor is s^2 (3 - 2 s); blend 0 is a hard edge.
    """

    position: Vector
    direction: Vector
    power: Color
    cone_angle: float
    blend: float


@dataclass(frozen=True, eq=False)
class Projector:
    """Light from a point through a frustum, as a slide projector: intensity power / (4 pi) over distance^falloff.

    ``horizontal_fov`` and ``vertical_fov`` are full angles in radians, ``near`` and ``far`` distances along
    ``direction`` (m). ``blend`` softens the edge as a share of the half width, ``elliptic`` rounds the frustum.
    ``gobo`` is an image (rows, columns[, 3]) >= 0 in the light's way.
    """

    position: Vector
    direction: Vector
    up: Vector
    power: Color
    horizontal_fov: float
    vertical_fov: float
    near: float = 0.0
    far: float = math.inf
    falloff: int = 2
    blend: float = 0.0
    elliptic: bool = False
    gobo: Any = None


Light = Sun | Point | Spot | Projector


@dataclass(frozen=True)
class Surface:
    """Opaque Lambert body, lit and seen from both sides, that may also emit (radiance)."""

    shape: Box | Ellipsoid
    albedo: Color
    emission: Color = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Camera:
    """Perspective camera; ``field_of_view`` is horizontal, in radians."""

    position: Vector
    direction: Vector
    field_of_view: float


@dataclass(frozen=True)
class DepthFog:
    """Fog as a compositor makes it, in closed form from the depth of each pixel (reference.depth_fog has the formulas).

    Without ``falloff`` it shows the scene's volumes, which are height fog; a depth fog by ``falloff`` knows the distance alone:
    with ``density`` (1/m), ``albedo`` and ``g``, full at ``end`` (linear), fading to ``radiance``. The rest has no counterpart in a
    volume: fog begins at ``start`` and spares what is beyond ``cutoff`` (m), hides ``max_opacity`` at most, and the sun's light in
    it is tinted.
    """

    start: float = 0.0
    cutoff: float = math.inf
    max_opacity: float = 1.0
    sun_tint: Color = (1.0, 1.0, 1.0)
    falloff: str = ""
    end: float = math.inf
    density: float = 0.0
    albedo: Color = (1.0, 1.0, 1.0)
    g: float = 0.0
    radiance: Color = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.falloff == "linear" and self.end <= self.start:
            raise ValueError(f"end must be > start, got end {self.end:g} m and start {self.start:g} m; let the fog end behind its start")

    @property
    def is_physical(self) -> bool:
        """Whether it stands for a volume, so that light transport is its truth."""
        return self == DepthFog()


@dataclass(frozen=True)
class Scene:
    """Everything an integrator or an engine needs. ``orders`` counts scattering events (1: single scattering).

    With ``depth_fog`` the engines show the volumes, or a fog by distance, in their compositor.
    """

    camera: Camera
    lights: tuple[Light, ...] = ()
    environment: Color = (0.0, 0.0, 0.0)
    volumes: tuple[Volume, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    orders: int = 1
    depth_fog: DepthFog | None = None

    @property
    def has_light_transport(self) -> bool:
        """Whether the picture is that of light in media and on bodies: not with a fog that no medium makes."""
        return self.depth_fog is None or self.depth_fog.is_physical

    @property
    def is_dielectric(self) -> bool:
        """Whether light meets interfaces, panes or cavities, which only the integrator of glass follows."""
        return any(volume.has_surface or volume.cavity is not None for volume in self.volumes)

    @property
    def engine_orders(self) -> int:
        """Orders of scattering that an engine has to follow: fewer where every scattering medium has octaves."""
        counts = [v.octaves.count if v.octaves else self.orders for v in self.volumes if v.medium.scatters]
        return min(self.orders, max(counts, default=self.orders))

    @property
    def is_noisy(self) -> bool:
        return any(isinstance(volume.medium.density, (NoiseShape, Dust)) for volume in self.volumes)
