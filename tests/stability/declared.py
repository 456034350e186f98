# SPDX-License-Identifier: GPL-3.0-or-later
"""What every public function of ``physics`` accepts and promises, declared once.

A kind of argument knows its extremes, an ordinary value, and what must be refused; a ``Function`` names the kind of each
argument and what may be claimed of the result. The tests derive all their cases from ``FUNCTIONS``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from math import inf, nan, pi

import numpy as np

from volumetrics_addon.physics import (
    airlight, ambient_table, atmosphere, chapman, grid, opacity_map, phase, phase_fit, plane_parallel, preetham, projector,
    quadrature, slab,
    summed_area, transfer_function, transmittance,
)  # fmt: skip

TINY, ALMOST = 5e-324, 1 - 1e-16  # smallest positive number, largest below 1
LADDER = (0.0, TINY, 1e-308, 1e-30, 1e-3, 1.0, 1e3, 1e30)


# --- kinds of arguments ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Interval:
    """Numbers from low to high; ``open`` lists the ends that do not belong to it."""

    low: float
    high: float
    values: tuple[float, ...]
    usual: float
    open: tuple[float, ...] = ()
    shape = ()

    def holds(self, x):
        return (x >= self.low) & (x <= self.high) & ~np.isin(x, self.open)

    @property
    def invalid(self):
        """(value, how an error quotes it) outside the interval."""
        beyond = (nan, -inf, inf, self.low - 1, self.low - 1e-3, self.high + 1e-3, self.high + 1, *self.open)
        return tuple((x, repr(float(x))) for x in dict.fromkeys(beyond) if not self.holds(x))


@dataclass(frozen=True)
class Vector:
    """Triples (or tuples of another length) of numbers."""

    values: tuple[tuple[float, ...], ...]
    usual: tuple[float, ...]
    refused: tuple = ()

    @property
    def shape(self):
        return (len(self.usual),)

    @property
    def invalid(self):
        rest = self.usual[1:]
        return (((nan, *rest), "nan"), ((inf, *rest), "inf"), ((-inf, *rest), "-inf"), *self.refused)


@dataclass(frozen=True)
class Choice:
    """One for all elements of a call: settings, functions, images."""

    values: tuple
    usual: object
    invalid: tuple = ()  # (value, how an error quotes it)


def positive(values=LADDER[1:], usual=1.0):
    return Interval(0.0, inf, values, usual, open=(0.0, inf))


def finite(values, usual=0.0):
    return Interval(-inf, inf, values, usual, open=(-inf, inf))


COSINE = Interval(-1.0, 1.0, (-1.0, -ALMOST, -0.5, -1e-300, 0.0, 1e-300, 0.5, ALMOST, 1.0), 0.3)
UP = Interval(0.0, 1.0, (0.0, 1e-300, 1e-16, 0.5, ALMOST, 1.0), 0.3)
ASYMMETRY = Interval(
    -1.0, 1.0, (-ALMOST, -1 + 1e-12, -0.5, -1e-300, 0.0, 1e-300, 0.5, 1 - 1e-12, ALMOST), 0.4, open=(-1.0, 1.0)
)
FRACTION = Interval(0.0, 1.0, (0.0, TINY, 1e-30, 1e-16, 0.5, ALMOST, 1.0), 0.4)
SIGMA = Interval(0.0, inf, LADDER, 1.0, open=(inf,))
DISTANCE = Interval(0.0, inf, (*LADDER, inf), 1.0)
LENGTH = Interval(0.0, inf, LADDER, 1.0, open=(inf,))
HEIGHT = finite((-1e30, -1e3, -1.0, -1e-30, 0.0, TINY, 1e-3, 1.0, 1e3, 1e30))
IOR = Interval(1.0, 1000.0, (1.0, 1 + 3e-16, 1 + 1e-8, 1.33, 2.4, 1000.0), 1.5)
ORDER = Choice((2, 3, 16), 8, ((1, "1"), (0, "0"), (2.5, "2.5"), ("8", "'8'")))

WRONG_SHAPES = (((0.0, 1.0), "(2,)"), (1.0, "()"))
POSITION = Vector(
    (
        (0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0),
        (0.5, 0.0, 0.0),
        (-1.0, 0.0, 0.0),
        (2.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.5, 1e-12, 0.0),
        (0.5, 0.0, 1e-300),
        (TINY, 0.0, 0.0),
        (0.0, 0.0, -1.0),
        (1e3, -1e3, 1e-3),
        (1e30, 0.0, 0.0),
        (0.0, 1e30, -1e30),
        (1e100, 1e100, 1e100),
    ),
    (0.3, 0.2, 0.1),
    WRONG_SHAPES,
)
AXES = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
DIRECTION = Vector(
    (*AXES, (1.0, 1e-300, -1e-300), (1e-300, 0.0, -1.0), (1.0, 1e-12, 0.0), (0.6, 0.8, 0.0), (0.0, 0.6, -0.8)),
    (0.48, 0.6, -0.64),
    (*WRONG_SHAPES, ((0.0, 0.0, 0.0), "0.0"), ((2.0, 0.0, 0.0), "2.0")),
)


def isotropic(cos_theta):
    return phase.isotropic(cos_theta)


def sharp(cos_theta):
    return phase.henyey_greenstein(cos_theta, 1 - 1e-6)


PHASE = Choice((isotropic, sharp), isotropic, ((lambda c: -1.0 + 0 * c, "-1.0"), (lambda c: nan + 0 * c, "nan")))


# --- claims about results --------------------------------------------------------------------------------------


def never(**_):
    return False


@dataclass(frozen=True)
class Claim:
    """No NaN, within [low, high]; infinite wherever ``infinite`` says and, beyond the range of float64, where ``may`` does.

    Both take the call's arguments by name and give booleans. ``trailing``: axes the result has beyond the broadcast ones,
    None where they depend on the arguments.
    """

    low: float = 0.0
    high: float = inf
    infinite: Callable = never
    may: Callable = never
    trailing: tuple[int, ...] | None = ()


def always(**_):
    return True


NONNEGATIVE, SHARE, SIGNED_SHARE, REAL = Claim(), Claim(0.0, 1.0), Claim(-1.0, 1.0), Claim(-inf)
ANY = Claim(-inf, may=always)


@dataclass(frozen=True)
class Function:
    """A public function: the kinds of its arguments, the claims of its results, and how it is called.

    ``valid`` tells which combinations of valid arguments are accepted; all others must raise ValueError. ``call`` stands
    for the function where its result is an object, and may take further arguments to ask that. ``limit`` bounds the
    combinations tried, ``rounding`` is how far results may depend on the shape of a call (relative; BLAS and einsum sum
    in an order of their own). ``unchecked``: why arguments out of range are not refused. ``names``: what errors call
    arguments where that is not the argument's own name.
    """

    function: Callable
    arguments: dict
    claim: Claim | dict[str, Claim] | tuple[Claim, ...]
    valid: Callable | None = None
    call: Callable | None = None
    limit: int = 20_000
    rounding: float = 0.0
    unchecked: str = ""
    further: tuple[str, ...] = ()
    names: dict[str, str] = field(default_factory=dict)

    def __call__(self, **arguments):
        return (self.call or self.function)(**arguments)


# --- predicates ------------------------------------------------------------------------------------------------


def log_of(x):
    with np.errstate(divide="ignore"):
        return np.log(x)


LARGEST = np.log(np.finfo(np.float64).max)


def height_depth_overflows(z, dir_z, distance, sigma_0, scale_height, base_height):
    """ln(sigma_0) - low / H + ln(length) beyond float64, length the smaller of the ray and the way to fall by 1/e."""
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        down = np.where((dir_z < 0) & (distance > 0), -dir_z * distance, 0.0)
        log_length = np.minimum(log_of(distance), log_of(scale_height) - log_of(np.abs(dir_z)))
        log_depth = log_of(sigma_0) + (base_height - z + down) / scale_height + log_length
        endless = np.isinf(distance) & (dir_z <= 0) & (sigma_0 > 0)
        return endless | ((sigma_0 > 0) & (distance > 0) & (log_depth > LARGEST))


def light_on_ray(origin, direction, distance, light_position, intensity, sigma_s, **_):
    """The light's distance from the line below 1e-150 m and its foot on the ray, to as much; the ray has a length."""
    offset = light_position - origin
    across = np.abs(np.cross(offset, direction)).max(axis=-1)
    foot = np.sum(offset * direction, axis=-1)
    return (across < 1e-150) & (foot >= -1e-150) & (foot <= distance + 1e-150) & (distance > 0) & (sigma_s * intensity > 0)


def light_on_long_ray(distance, **arguments):
    """The same for rays longer than 1e-150 m, the lengths below which the integrals do not tell apart."""
    return light_on_ray(distance=distance, **arguments) & (distance > 1e-150)


def sun_overflows(distance, irradiance, sigma_s, sigma_t, sun_distance, sun_distance_slope, **_):
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        rate = np.abs(sigma_t * (1 + sun_distance_slope))
        path = np.where(rate > 0, np.minimum(distance, 1 / rate), distance)
        return (sigma_s * irradiance > 0) & (log_of(sigma_s * irradiance) + log_of(path) + 30 > LARGEST)


def sun_stays_outside(distance, sun_distance, sun_distance_slope, **_):
    with np.errstate(invalid="ignore"):
        way = np.where(sun_distance_slope == 0, 0.0, sun_distance_slope * np.where(sun_distance_slope == 0, 0.0, distance))
        # No way at all has no slope, and what comes from infinitely far cannot come nearer.
        return np.where(np.isinf(sun_distance), ~np.isinf(way) | (way > 0), sun_distance + way >= 0)


# --- the table -------------------------------------------------------------------------------------------------

U = {"u": FRACTION}
C = {"cos_theta": COSINE}
G = {"g": ASYMMETRY}
LOBES = {"g0": ASYMMETRY, "g1": ASYMMETRY, "weight": FRACTION}
K = {"k": ASYMMETRY}
ALPHA = {"alpha": Interval(0.0, inf, (0.0, TINY, 1e-30, 1.0, 250.0, 1e30), 1.0, open=(inf,))}
DROPLET = {
    "droplet_diameter": Interval(
        0.0,
        50.0,
        (TINY, 1e-30, 1e-3, 0.1, 0.1 + 1e-16, 1.4999999999999998, 1.5, 4.999999999999999, 5.0, 20.0, 50.0),
        10.0,
        open=(0.0,),
    )
}
PARTICLES = {
    "backscatter": Interval(0.0, 0.5, (TINY, 1e-308, 1e-30, 1e-3, 0.25, 0.4999999999999999), 0.02, open=(0.0, 0.5)),
    "ior": Interval(1.0, 1000.0, (1 + 3e-16, 1 + 1e-8, 1.05, 1.33, 2.0, 1000.0), 1.1, open=(1.0,)),
}

PHASE_FUNCTIONS = {
    "isotropic": Function(phase.isotropic, C, Claim(1 / (4 * pi), 1 / (4 * pi))),
    "sample_isotropic": Function(phase.sample_isotropic, U, SIGNED_SHARE),
    "mean_cosine_isotropic": Function(phase.mean_cosine_isotropic, {}, Claim(0.0, 0.0)),
    "rayleigh": Function(phase.rayleigh, C, Claim(3 / (16 * pi) - 1e-16, 3 / (8 * pi) + 1e-16)),
    "sample_rayleigh": Function(phase.sample_rayleigh, U, SIGNED_SHARE),
    "mean_cosine_rayleigh": Function(phase.mean_cosine_rayleigh, {}, Claim(0.0, 0.0)),
    "henyey_greenstein": Function(phase.henyey_greenstein, C | G, NONNEGATIVE),
    "sample_henyey_greenstein": Function(phase.sample_henyey_greenstein, U | G, SIGNED_SHARE),
    "mean_cosine_henyey_greenstein": Function(phase.mean_cosine_henyey_greenstein, G, SIGNED_SHARE),
    "dual_henyey_greenstein": Function(phase.dual_henyey_greenstein, C | LOBES, NONNEGATIVE),
    "sample_dual_henyey_greenstein": Function(phase.sample_dual_henyey_greenstein, U | LOBES, SIGNED_SHARE),
    "mean_cosine_dual_henyey_greenstein": Function(phase.mean_cosine_dual_henyey_greenstein, LOBES, SIGNED_SHARE),
    "schlick": Function(phase.schlick, C | K, NONNEGATIVE),
    "schlick_k": Function(phase.schlick_k, G, SIGNED_SHARE, valid=lambda g: np.abs(1.55 * g - 0.55 * g**3) < 1),
    "sample_schlick": Function(phase.sample_schlick, U | K, SIGNED_SHARE),
    "mean_cosine_schlick": Function(phase.mean_cosine_schlick, K, SIGNED_SHARE),
    "draine": Function(phase.draine, C | G | ALPHA, NONNEGATIVE),
    "sample_draine": Function(phase.sample_draine, U | G | ALPHA, SIGNED_SHARE),
    "mean_cosine_draine": Function(phase.mean_cosine_draine, G | ALPHA, SIGNED_SHARE),
    "cornette_shanks": Function(phase.cornette_shanks, C | G, NONNEGATIVE),
    "sample_cornette_shanks": Function(phase.sample_cornette_shanks, U | G, SIGNED_SHARE),
    "mean_cosine_cornette_shanks": Function(phase.mean_cosine_cornette_shanks, G, SIGNED_SHARE),
    "mie_fit_parameters": Function(phase.mie_fit_parameters, DROPLET, (SIGNED_SHARE, SIGNED_SHARE, NONNEGATIVE, SHARE)),
    "mie_fit": Function(phase.mie_fit, C | DROPLET, NONNEGATIVE),
    "sample_mie_fit": Function(phase.sample_mie_fit, U | DROPLET, SIGNED_SHARE),
    "mean_cosine_mie_fit": Function(phase.mean_cosine_mie_fit, DROPLET, SIGNED_SHARE),
    "fournier_forand": Function(phase.fournier_forand, C | PARTICLES, Claim(infinite=lambda cos_theta, **_: cos_theta == 1)),
    "sample_fournier_forand": Function(phase.sample_fournier_forand, U | PARTICLES, SIGNED_SHARE),
    "mean_cosine_fournier_forand": Function(phase.mean_cosine_fournier_forand, PARTICLES, SIGNED_SHARE),
}

RAY = {"z": HEIGHT, "dir_z": COSINE, "distance": DISTANCE}
FOG = RAY | {"sigma_0": SIGMA, "scale_height": positive(), "base_height": HEIGHT}
DEPTH_FOG = {"depth": DISTANCE, "density": SIGMA}
LAYER = {
    "bottom": Interval(-inf, inf, (-inf, *HEIGHT.values), 0.0, open=(inf,)),
    "top": Interval(-inf, inf, (*HEIGHT.values, inf), 2.0, open=(-inf,)),
}


def layered(bottom, top, **_):
    return bottom <= top


def wide_enough(start, end, **_):
    return end > start


TRANSMITTANCES = {
    "beer_lambert": Function(transmittance.beer_lambert, {"sigma_t": SIGMA, "distance": DISTANCE}, SHARE),
    "extinction_from_color": Function(
        transmittance.extinction_from_color,
        {"color": Interval(0.0, 1.0, (TINY, 1e-308, 1e-30, 0.5, ALMOST, 1.0), 0.5, open=(0.0,)), "distance": positive()},
        NONNEGATIVE,
        valid=lambda color, distance: (color == 1) | (log_of(np.abs(log_of(color))) - log_of(distance) < LARGEST),
    ),
    "height_optical_depth": Function(transmittance.height_optical_depth, FOG, Claim(infinite=height_depth_overflows)),
    "height_transmittance": Function(transmittance.height_transmittance, FOG, SHARE),
    "linear_fog": Function(
        transmittance.linear_fog,
        {"depth": DISTANCE, "start": HEIGHT, "end": finite(HEIGHT.values, 2.0)},
        SHARE,
        valid=wide_enough,
    ),
    "exp_fog": Function(transmittance.exp_fog, DEPTH_FOG, SHARE),
    "exp2_fog": Function(transmittance.exp2_fog, DEPTH_FOG, SHARE),
    "coverage_blend": Function(transmittance.coverage_blend, {"coverage": FRACTION, "transmittance": FRACTION}, SHARE),
    "slab_path_length": Function(
        transmittance.slab_path_length,
        RAY | LAYER,
        # An infinite ray so level that it meets the layer beyond float64 may miss it.
        Claim(
            infinite=lambda z, dir_z, distance, bottom, top: (
                np.isinf(distance)
                & ((dir_z == 0) | (np.abs(dir_z) > 1e-270))
                & (
                    ((dir_z == 0) & (bottom <= z) & (z <= top))
                    | ((dir_z > 0) & (top == inf))
                    | ((dir_z < 0) & (bottom == -inf))
                )
            ),
            may=lambda dir_z, distance, **_: np.isinf(distance) & (np.abs(dir_z) <= 1e-270),
        ),
        valid=layered,
    ),
    "slab_optical_depth": Function(
        transmittance.slab_optical_depth,
        {"sigma_t": SIGMA} | RAY | LAYER,
        Claim(may=lambda distance, **_: np.isinf(distance)),
        valid=layered,
    ),
    "plate_path_length": Function(
        transmittance.plate_path_length,
        {"cos_theta": COSINE, "thickness": LENGTH, "ior": IOR},
        Claim(
            infinite=lambda cos_theta, thickness, ior: (
                (ior == 1) & (thickness > 0) & ((cos_theta == 0) | (log_of(thickness) - log_of(np.abs(cos_theta)) > LARGEST))
            )
        ),
    ),
    "shell_path_length": Function(
        transmittance.shell_path_length,
        {
            "impact_parameter": LENGTH,
            "outer_radius": Interval(0.0, inf, LADDER, 2.0, open=(inf,)),
            "inner_radius": LENGTH,
            "ior": IOR,
        },
        NONNEGATIVE,
        valid=lambda outer_radius, inner_radius, **_: inner_radius <= outer_radius,
    ),
    "ratio_tracking": Function(
        transmittance.ratio_tracking,
        {
            "density_function": Choice(
                (lambda t: np.zeros(np.shape(t)), lambda t: np.full(np.shape(t), TINY)),
                lambda t: np.zeros(np.shape(t)),
                ((lambda t: -1.0 + 0 * t, "-1.0"), (lambda t: 2.0 + 0 * t, "2.0")),
            ),
            "majorant": Interval(0.0, inf, (0.0, TINY, 1e-308, 1e-30, 1e-3, 1.0), 1.0, open=(inf,)),
            "distance": Interval(0.0, inf, (0.0, TINY, 1e-30, 1.0, 1e3), 100.0, open=(inf,)),
        },
        SHARE,
        call=lambda **a: transmittance.ratio_tracking(**a, rng=np.random.default_rng(1)),
    ),
}

RAYS = {"origin": POSITION, "direction": DIRECTION, "distance": DISTANCE}
MEDIUM = {"sigma_s": SIGMA, "sigma_t": SIGMA}
RULE = {"phase": PHASE, "order": ORDER}
TOLERANCE = {
    "adaptive": Choice((False,), False),
    "rtol": Choice((1e-8,), 1e-8, ((0.0, "0.0"), (-1.0, "-1.0"), (nan, "nan"))),
}
LAMP = {"light_position": POSITION, "intensity": SIGMA}


def airlight_of(infinite=never, may=never):
    return {"value": Claim(infinite=infinite, may=may), "error_estimate": NONNEGATIVE, "evaluations": NONNEGATIVE}


def descends(top, origin, sun_direction, **_):
    return (sun_direction[..., 2] < 0) & (top - origin[..., 2] >= 0)


AIRLIGHTS = {
    "point_light": Function(
        airlight.point_light,
        RAYS | LAMP | MEDIUM | RULE | TOLERANCE,
        airlight_of(light_on_long_ray, light_on_ray),
        limit=6000,
    ),
    "spot_light": Function(
        airlight.spot_light,
        RAYS
        | LAMP
        | MEDIUM
        | RULE
        | TOLERANCE
        | {
            "spot_direction": DIRECTION,
            "cone_angle": Interval(0.0, pi, (TINY, 1e-300, 1e-12, 1e-3, 1.0, 3.1415, pi), 1.0, open=(0.0,)),
            "blend": FRACTION,
        },
        airlight_of(may=light_on_ray),
        limit=6000,
    ),
    "sun": Function(
        airlight.sun,
        RAYS
        | MEDIUM
        | {
            "phase": PHASE,
            "sun_direction": DIRECTION,
            "irradiance": SIGMA,
            "sun_distance": DISTANCE,
            "sun_distance_slope": finite((-1.0, -1e-30, 0.0, 1e-300, 1e3, 1e30)),
        },
        airlight_of(may=sun_overflows),
        valid=sun_stays_outside,
    ),
    "sun_distance_below": Function(
        airlight.sun_distance_below,
        {"top": finite(HEIGHT.values, 2.0), "origin": POSITION, "direction": DIRECTION, "sun_direction": DIRECTION},
        (
            Claim(may=lambda sun_direction, **_: sun_direction[..., 2] > -1e-200),
            Claim(-inf, may=lambda sun_direction, **_: sun_direction[..., 2] > -1e-200),
        ),
        valid=descends,
    ),
    "point_light_without_extinction": Function(
        airlight.point_light_without_extinction,
        RAYS | LAMP | {"sigma_s": SIGMA},
        airlight_of(light_on_long_ray, light_on_ray),
    ),
}

ALBEDO = FRACTION
THICKNESS = Interval(0.0, inf, (0.0, TINY, 1e-308, 1e-30, 1e-3, 1.0, 50.0, 1e3, 1e30, inf), 1.0)
LOBE = Choice(
    (0.0, 0.5, -0.5, 1 - 1e-12, -1 + 1e-12, 1e-300, phase.rayleigh),
    0.5,
    ((1.0, "1.0"), (nan, "nan"), (lambda c: 1.0 + 0 * c, "12.56"), (lambda c: -1.0 + 0 * c, "-1.0")),
)
POINTS = Choice((3, 8), 8, ((2, "2"), (2.5, "2.5"), (1000, "1000")))
SLABS = {
    "adding_doubling": Function(
        slab.adding_doubling,
        {
            "phase": LOBE,
            "albedo": ALBEDO,
            "tau": THICKNESS,
            "ior": Interval(1.0, 10.0, (1.0, 1 + 3e-16, 1 + 1e-8, 1.33, 10.0), 1.4),
            "quadrature": POINTS,
        },
        {name: SHARE for name in ("reflectance", "transmittance", "diffuse_reflectance", "diffuse_transmittance")}
        | {"error_estimate": NONNEGATIVE},
        limit=420,
    ),
    "slab_radiance": Function(
        slab.slab_radiance,
        {
            "phase": LOBE,
            "albedo": ALBEDO,
            "tau": THICKNESS,
            "mu0": Interval(0.0, 1.0, (TINY, 1e-300, 1e-16, 1e-3, 0.5, ALMOST, 1.0), 0.6, open=(0.0,)),
            "mu": COSINE,
            "azimuth": finite((-1e30, -pi, 0.0, 1e-300, 1.0, pi, 1e3), 1.0),
            "quadrature": POINTS,
        },
        {"value": NONNEGATIVE, "error_estimate": NONNEGATIVE},
        limit=140,
        rounding=1e-9,
    ),
    "h_function": Function(slab.h_function, {"albedo": ALBEDO, "mu": FRACTION}, Claim(1.0, 2.9078105291), rounding=1e-13),
}

# --- planets -----------------------------------------------------------------------------------------------------

AIR = atmosphere.Component((5.8e-6, 13.5e-6, 33.1e-6), (0.0, 0.0, 0.0), 8000.0, phase.rayleigh)
HAZE = atmosphere.Component((4e-6,) * 3, (4e-7,) * 3, 1200.0, partial(phase.henyey_greenstein, g=0.8))
GROUND, TOP = 6.36e6, 6.42e6
EARTH = atmosphere.Planet(GROUND, TOP, (AIR, HAZE), (0.1, 0.2, 0.3))


@cache
def tables():
    clear = atmosphere.transmittance_table(EARTH, 8, 32)
    return {
        "transmittance": clear,
        "scattering": atmosphere.ScatteringTables(EARTH, 3, 4, 6, clear),
        "uniform": atmosphere.UniformScattering(EARTH, 4, clear, 6, 6),
    }


def asked(table, method="__call__"):
    return lambda **a: getattr(tables()[table], method)(**a)


BETWEEN = Interval(
    GROUND, TOP, (GROUND, np.nextafter(GROUND, inf), GROUND + 1.0, GROUND + 8e3, np.nextafter(TOP, 0.0), TOP), GROUND + 1e3
)
POSITIVE = Interval(0.0, inf, BETWEEN.values, BETWEEN.usual, open=(0.0, inf))  # what lies outside counts as its edge
ABOVE = Interval(0.0, inf, BETWEEN.values, BETWEEN.usual, open=(inf,))
RADIUS = Interval(0.0, inf, (0.0, TINY, 1.0, 1e3, GROUND - 1.0, *BETWEEN.values, 1e30), GROUND + 1e3, open=(inf,))
CURVED = {
    "radius": RADIUS,
    "mu": COSINE,
    "distance": DISTANCE,
    "sigma_0": SIGMA,
    "scale_height": positive((1e-3, 1.0, 1e3, 8000.0, 1e30), 8000.0),
    "planet_radius": positive((1e-3, 1.0, GROUND, 1e30), GROUND),
}
SCALAR_TABLE = np.arange(12.0).reshape(3, 4)
COLOR = {"trailing": (3,)}
PER_COMPONENT = Claim(trailing=(2,))
UNCHECKED = "an inner step of functions that have checked already"


def not_too_flat(radius, scale_height, **_):
    return radius / scale_height <= 1e12


ATMOSPHERES = {
    "rayleigh_coefficient": Function(
        atmosphere.rayleigh_coefficient,
        {
            "wavelength": positive((1e-30, 1e-9, 5.5e-7, 1.0, 1e30), 5.5e-7),
            "refractive_index": Interval(1.0, inf, (1.0, 1 + 3e-16, 1.00029, 1e3), 1.00029, open=(inf,)),
            "number_density": positive((1e-30, 1.0, 2.5e25, 1e30), 2.5e25),
            "king_factor": Interval(1.0, inf, (1.0, 1.05, 1e30), 1.05, open=(inf,)),
        },
        NONNEGATIVE,
    ),
    "optical_depth": Function(atmosphere.optical_depth, CURVED, Claim(may=always), valid=not_too_flat, rounding=1e-14),
    "transmittance": Function(atmosphere.transmittance, CURVED, SHARE, valid=not_too_flat, rounding=1e-13),
    "ground_distance": Function(
        atmosphere.ground_distance,
        {
            "radius": positive((TINY, 1.0, 1e3, *BETWEEN.values, 1e30), GROUND),
            "mu": COSINE,
            "planet_radius": positive((TINY, 1.0, 1e3, GROUND, 1e30), GROUND),
        },
        Claim(infinite=lambda radius, mu, planet_radius: (mu >= 0) | (np.sqrt(1 - mu * mu) > planet_radius / radius)),
        valid=lambda radius, planet_radius, **_: radius >= planet_radius,
    ),
    "top_distance": Function(
        atmosphere.top_distance,
        {
            "radius": positive((TINY, 1.0, 1e3, *BETWEEN.values, 1e30), GROUND),
            "mu": COSINE,
            "top_radius": positive((TINY, 1.0, 1e3, TOP, 1e30), TOP),
        },
        NONNEGATIVE,
        valid=lambda radius, top_radius, **_: radius <= top_radius,
    ),
    "Planet.density": Function(EARTH.density, {"radius": POSITIVE}, Claim(0.0, 1.0, trailing=(2,))),
    "Planet.phases": Function(EARTH.phases, C, PER_COMPONENT),
    "Planet.paths": Function(
        EARTH.paths, {"radius": ABOVE, "mu": COSINE, "distance": DISTANCE}, Claim(may=always, trailing=(2,)), rounding=1e-14
    ),
    "Planet.transmittance": Function(
        EARTH.transmittance, {"radius": ABOVE, "mu": COSINE, "distance": DISTANCE}, Claim(0.0, 1.0, **COLOR), rounding=1e-13
    ),
    "Planet.attenuation": Function(
        EARTH.attenuation,
        {"paths": Vector(tuple((a, b) for a in (*LADDER, inf) for b in (*LADDER, inf)), (1.0, 1.0))},
        Claim(0.0, 1.0, **COLOR),
        rounding=1e-13,
        unchecked=UNCHECKED,
    ),
    "Planet.horizon": Function(EARTH.horizon, {"radius": POSITIVE}, Claim(-1.0, 0.0)),
    "Planet.sunlight": Function(
        EARTH.sunlight, {"radius": POSITIVE, "mu_s": COSINE}, Claim(0.0, 1.0, **COLOR), rounding=1e-13
    ),
    "ray_nodes": Function(
        atmosphere.ray_nodes,
        {
            "planet": Choice((EARTH,), EARTH),
            "radius": BETWEEN,
            "mu": COSINE,
            "low": Interval(0.0, 0.0, (0.0,), 0.0),
            "high": Interval(0.0, 1e5, (0.0, TINY, 1e-30, 1.0, 1e5), 1.0),
            "order": Choice((3, 16), 8),
        },
        (Claim(trailing=None), Claim(trailing=None)),
        rounding=1e-13,
        unchecked=UNCHECKED,
    ),
    "TransmittanceTable.__call__": Function(
        asked("transmittance"),
        {"radius": POSITIVE, "mu": COSINE},
        Claim(0.0, 1.0, **COLOR),
        rounding=1e-13,
    ),
    "TransmittanceTable.interpolation_error": Function(asked("transmittance", "interpolation_error"), {}, SHARE),
    "transmittance_table": Function(
        atmosphere.transmittance_table,
        {
            "planet": Choice((EARTH,), EARTH),
            "radii": Choice((2, 3), 3, ((1, "1"),)),
            "cosines": Choice((2, 5), 3, ((1, "1"),)),
        },
        Claim(0.0, 1.0, **COLOR),
        call=lambda **a: atmosphere.transmittance_table(**a)(GROUND, 0.5),
    ),
    "interpolated": Function(
        lambda x, y: atmosphere.interpolated(SCALAR_TABLE, np.broadcast_arrays(x, y)),
        {
            "x": Interval(-inf, inf, (-1e30, -1.0, 0.0, TINY, 0.5, 1e30), 0.5),
            "y": Interval(-inf, inf, (-1e30, -1.0, 0.0, TINY, 0.5, 1e30), 0.5),
        },
        Claim(0.0, 11.0),
        unchecked=UNCHECKED,
    ),
    "ScatteringTables.source": Function(
        asked("scattering", "source"),
        {"radius": POSITIVE, "mu": COSINE, "mu_s": COSINE, "nu": COSINE},
        Claim(**COLOR),
        limit=4000,
        rounding=1e-13,
    ),
    "ScatteringTables.irradiance": Function(
        asked("scattering", "irradiance"), {"mu_s": COSINE}, Claim(**COLOR), rounding=1e-13
    ),
    "scattering_tables": Function(
        atmosphere.scattering_tables,
        {"planet": Choice((EARTH,), EARTH), "orders": Choice((1, 2), 1, ((0, "0"),)), "size": Choice((4,), 4, ((3, "3"),))},
        Claim(**COLOR),
        call=lambda **a: atmosphere.scattering_tables(**a).irradiance(np.float64(0.5)),
    ),
    "UniformScattering.irradiance": Function(
        asked("uniform", "irradiance"), {"mu_s": COSINE}, Claim(**COLOR), rounding=1e-13
    ),
    "UniformScattering.__call__": Function(
        asked("uniform"), {"radius": POSITIVE, "mu_s": COSINE}, Claim(**COLOR), rounding=1e-13
    ),
}

SKY = {
    "cos_theta": UP,
    "cos_gamma": COSINE,
    "sun_zenith": Interval(0.0, pi / 2, (0.0, TINY, 1e-16, 0.7, 1.57, pi / 2), 0.7),
    "turbidity": Interval(2.0, 10.0, (2.0, 3.3, 10.0), 3.0),
}
SKIES = {
    "preetham_xyy": Function(preetham.preetham_xyy, SKY, Claim(**COLOR), rounding=1e-13),
    "preetham_sky": Function(preetham.preetham_sky, SKY, Claim(**COLOR), rounding=1e-13),
}

# --- grids and opacity maps --------------------------------------------------------------------------------------

CELLS = Choice(
    (
        np.ones((1, 1, 1)),
        np.zeros((2, 3, 1)),
        np.full((2, 2, 2), TINY),
        np.array([0.0, 1e30, 1e-308, 1.0] * 6).reshape(2, 3, 4),
    ),
    np.ones((2, 2, 2)),
    (
        (np.full((2, 2, 2), nan), "nan"),
        (np.full((2, 2, 2), -1.0), "-1.0"),
        (np.full((2, 2, 2), inf), "inf"),
        (np.ones((2, 2)), "(2, 2)"),
        (np.ones((0, 2, 2)), "(0, 2, 2)"),
    ),
)
BOX = {
    "values": CELLS,
    "low": Choice(
        ((-1.0, -1.0, -1.0), (0.0, 0.0, 0.0), (-1e12, -1e-12, -1e-30)),
        (-1.0, -1.0, -1.0),
        (((nan, 0.0, 0.0), "nan"), ((0.0, 0.0), "(2,)")),
    ),
    "high": Choice(
        ((1.0, 1.0, 1.0), (1e-100, 1.0, 1e30)),
        (1.0, 1.0, 1.0),
        (((inf, 1.0, 1.0), "inf"), ((1.0,), "(1,)"), ((-2.0, 1.0, 1.0), "-0.5")),
    ),
    "nearest": Choice((False, True), False),
}
GRIDS = {
    "grid_density": Function(grid.grid_density, BOX | {"position": POSITION}, Claim(0.0, 1e30)),
    "grid_optical_depth": Function(grid.grid_optical_depth, BOX | RAYS | {"sigma_t": SIGMA}, NONNEGATIVE),
    "grid_transmittance": Function(grid.grid_transmittance, BOX | RAYS | {"sigma_t": SIGMA}, SHARE),
}

PROFILE = Vector(
    (
        (0.0,) * 4,
        (TINY,) * 4,
        (1e-308,) * 4,
        (1e-30,) * 4,
        (1.0,) * 4,
        (1e30,) * 4,
        (0.0, 1e30, 0.0, 0.0),
        (1e3, 0.0, 0.0, 1e-3),
        (0.0, 0.0, 0.0, 1e30),
    ),
    (1.0, 0.5, 0.0, 2.0),
    (((-1.0, 0.0, 0.0, 0.0), "-1.0"), (1.0, "()")),
)
COUNT = Choice((1, 2, 7), 3, ((0, "0"), (1.5, "1.5")))
SLICES = Choice((4,), 4)


def mapped(function, **setting):
    """The map's transmittance at a depth, and its stated error."""
    ((name, kind),) = setting.items()

    def ask(extinction, length, depth, slices, **setting):
        result = function(extinction, length, slices=slices, **setting)
        value = result.transmittance(depth)
        return value, result.error_estimate + np.zeros(np.shape(value)), result.numbers + np.zeros(np.shape(value))

    return Function(
        function,
        {"extinction": PROFILE, "length": positive(), "depth": DISTANCE, "slices": SLICES, name: kind},
        (SHARE, NONNEGATIVE, NONNEGATIVE),
        call=ask,
        rounding=1e-13,
        further=("depth",),
    )


OPACITY_MAPS = {
    "extinction_volume": mapped(opacity_map.extinction_volume, count=COUNT),
    "deep_shadow_map": mapped(
        opacity_map.deep_shadow_map,
        tolerance=Choice((TINY, 1e-30, 1e-3, 0.5, ALMOST), 0.01, ((0.0, "0.0"), (1.0, "1.0"), (nan, "nan"))),
    ),
    "fourier_opacity_map": mapped(
        opacity_map.fourier_opacity_map, frequencies=Choice((0, 1, 5), 3, ((-1, "-1"), (1.5, "1.5")))
    ),
    "dct_opacity_map": mapped(opacity_map.dct_opacity_map, count=COUNT),
    "OpacityMap.transmittance": Function(
        opacity_map.extinction_volume([1.0, 0.0, 1e30, 1e-308], 3.0, 4).transmittance, {"depth": DISTANCE}, SHARE
    ),
}

# --- fits ----------------------------------------------------------------------------------------------------------

EVENLY = np.linspace(-1.0, 1.0, 41)
FIT = {
    "g0": SIGNED_SHARE,
    "g1": SIGNED_SHARE,
    "weight": SHARE,
    "residual": NONNEGATIVE,
    "mean_cosine": SIGNED_SHARE,
    "given_mean_cosine": SIGNED_SHARE,
    "norm": NONNEGATIVE,
    "given_norm": NONNEGATIVE,
}
FLAG = Choice((False, True), False)
PHASE_FITS = {
    "fit_dual_henyey_greenstein": Function(
        phase_fit.fit_dual_henyey_greenstein,
        {
            "cos_theta": Choice((EVENLY,), EVENLY, ((np.full(41, nan), "nan"), (2 * EVENLY, "-2.0"), (EVENLY[:3], "(3,)"))),
            "value": Choice(
                (
                    np.ones(41),
                    np.full(41, TINY),
                    np.full(41, 1e300),
                    1e-300 * (1 + EVENLY**2),
                    phase.henyey_greenstein(EVENLY, 0.999),
                    phase.henyey_greenstein(EVENLY, -0.999),
                    np.where(EVENLY > 0.99, 1.0, 1e-30),
                ),
                np.ones(41),
                ((np.zeros(41), "0.0"), (np.full(41, nan), "nan"), (np.full(41, inf), "inf"), (np.ones(3), "(3,)")),
            ),
            "logarithmic": FLAG,
            "keep_mean_cosine": FLAG,
            "free_norm": FLAG,
        },
        FIT,
        # Two lobes can keep no mean cosine that the table does not resolve.
        valid=lambda cos_theta, value, keep_mean_cosine, **_: (
            not keep_mean_cosine or abs(np.average(cos_theta, weights=value / value.max())) < 0.5
        ),
    )
}

# --- projectors ------------------------------------------------------------------------------------------------------

ANGLE = Interval(0.0, pi, (1e-300, 1e-12, 1e-3, 1.0, 3.1415, np.nextafter(pi, 0.0)), 1.0, open=(0.0, pi))
LENS = {
    "up": Vector(
        ((0.0, 0.0, 1.0), (0.0, 1e-30, 1.0), (1e30, 1.0, 1e30), (0.0, 1.0, 1.0)),
        (0.1, 0.2, 1.0),
        (*WRONG_SHAPES, ((0.0, 0.0, 0.0), "0.0")),
    ),
    "horizontal_fov": ANGLE,
    "vertical_fov": ANGLE,
    "near": Interval(0.0, inf, (0.0, TINY, 1e-3, 1.0, 1e30), 0.0, open=(inf,)),
    "far": Interval(0.0, inf, (0.0, TINY, 1.0, 1e30, inf), inf),
    "blend": FRACTION,
    "elliptic": FLAG,
}
FALLOFF = Choice((0, 1, 2), 2, ((3, "3"), (1.5, "1.5"), (-1, "-1")))
GOBO = Choice(
    (None, np.ones((1, 1)), np.array([[0.0, 1e30], [TINY, 1.0]])),
    None,
    ((np.full((2, 2), nan), "nan"), (np.full((2, 2), -1.0), "-1.0"), (np.ones(3), "(3,)"), (np.ones((0, 2)), "(0, 2)")),
)
IMAGE = {"falloff": FALLOFF, "gobo": GOBO}
OF_THE_LIGHT = {"light_direction": "direction of the light"}
AIMED = {"light_position": POSITION, "light_direction": DIRECTION}


def across(axis):
    def valid(up, near, far, **arguments):
        aim = arguments[axis]
        size = np.max(np.abs(up), axis=-1, keepdims=True)
        sine = np.linalg.norm(np.cross(aim, up / np.where(size > 0, size, 1.0)), axis=-1)
        return (sine > 1e-9) & (near <= far)

    return valid


PROJECTORS = {
    "projector_irradiance": Function(
        projector.projector_irradiance,
        {"position": POSITION, "light_position": POSITION, "direction": DIRECTION, "intensity": SIGMA} | LENS | IMAGE,
        Claim(
            may=lambda position, light_position, falloff, **_: (
                (falloff > 0) & (np.abs(position - light_position).max(axis=-1) < 1e-120)
            )
        ),
        valid=across("direction"),
        limit=12_000,
    ),
    "projector_interval": Function(
        projector.projector_interval,
        {"origin": POSITION, "direction": DIRECTION} | AIMED | LENS,
        {
            "entry": Claim(may=always),
            "exit": Claim(-inf, may=always),
            "full_entry": Claim(may=always),
            "full_exit": Claim(-inf, may=always),
        },
        valid=across("light_direction"),
        names=OF_THE_LIGHT,
    ),
    "projector_breaks": Function(
        projector.projector_breaks,
        {"origin": POSITION, "direction": DIRECTION} | AIMED | LENS | IMAGE,
        Claim(-inf, may=always, trailing=None),
        valid=across("light_direction"),
        names=OF_THE_LIGHT,
    ),
    "projector_airlight": Function(
        projector.projector_airlight,
        RAYS | AIMED | {"intensity": SIGMA, "ambient": SIGMA} | MEDIUM | RULE | TOLERANCE | LENS | IMAGE,
        airlight_of(
            may=lambda distance, sigma_t, falloff, **a: (
                ((falloff > 0) & light_on_ray(distance=distance, **a)) | (np.isinf(distance) & (sigma_t < 1e-200))
            )
        ),
        valid=across("light_direction"),
        names=OF_THE_LIGHT,
        limit=5000,
    ),
}

# --- tables of volumes, transfer functions -----------------------------------------------------------------------------

BALLS = {"tau": THICKNESS, "g": ASYMMETRY, "albedo": ALBEDO}


def of_the_table(method):
    return lambda **a: getattr(ambient_table.load(), method)(**a)


AMBIENT_TABLES = {
    "AmbientTable.scattered": Function(of_the_table("scattered"), C | BALLS, NONNEGATIVE),
    "AmbientTable.radiance": Function(of_the_table("radiance"), C | BALLS, NONNEGATIVE),
    "AmbientTable.furnace": Function(of_the_table("furnace"), BALLS, SHARE),
    "AmbientTable.relative_error": Function(of_the_table("relative_error"), C | BALLS, NONNEGATIVE),
}

VOXELS = Choice((*CELLS.values, -CELLS.values[-1]), CELLS.usual, tuple(x for x in CELLS.invalid if x[1] != "-1.0"))
CORNER = Vector(
    (
        (-1e30, -1e30, -1e30),
        (-1.0, -1.0, -1.0),
        (-0.5, -1e-12, 0.0),
        (0.0, 0.0, 0.0),
        (TINY, TINY, TINY),
        (1e-308, 1e-30, 1e-3),
        (0.5, 0.25, 1.0),
        (1.0, 1.0, 1.0),
        (2.0, 3.0, 1e30),
        (1e100, 1e100, 1e100),
    ),
    (-0.5, -0.5, -0.5),
    WRONG_SHAPES,
)
SUMMED_AREAS = {
    "SummedArea.mean_in_box": Function(
        lambda values, low, high: summed_area.SummedArea(values, (-1.0,) * 3, (1.0,) * 3).mean_in_box(low, high),
        {"values": VOXELS, "low": CORNER, "high": Vector(CORNER.values, (0.5, 0.75, 1.5), WRONG_SHAPES)},
        Claim(-1e30, 1e30),
        valid=lambda low, high, **_: np.all(high > low, axis=-1),
    ),
    "SummedArea.mean_in_ball": Function(
        lambda values, center, radius: summed_area.SummedArea(
            values, (-1.0, -1e12, -1e-12), (1.0, 1e12, 1e-12)
        ).mean_in_ball(center, radius),
        {"values": VOXELS, "center": CORNER, "radius": positive()},
        Claim(-1e30, 1e30),
    ),
}

SCALAR = finite((-1e30, -1.0, -1e-30, 0.0, TINY, 0.5, 1.0, 1 + 1e-12, 1e30), 0.3)
RAMP = transfer_function.TransferFunction1D(
    [-1.0, 0.0, 1.0, 1 + 1e-12], np.outer([0.0, 1e30, 1e-308, 1.0], [1.0, 0.5, 0.0]), [0.0, TINY, 1e30, 1.0]
)
MAP = transfer_function.TransferFunction2D(
    [-1.0, 1.0], [0.0, 1e-30, 1.0], np.full((2, 3, 3), 1e30), [[0.0, 1.0, 1e30], [TINY, 0.0, 1e-308]]
)
LIGHT_AND_DEPTH = (Claim(**COLOR), NONNEGATIVE)
TRANSFER_FUNCTIONS = {
    "TransferFunction1D.__call__": Function(RAMP.__call__, {"scalar": SCALAR}, LIGHT_AND_DEPTH),
    "TransferFunction1D.segment": Function(
        RAMP.segment, {"front": SCALAR, "back": SCALAR, "length": LENGTH}, LIGHT_AND_DEPTH
    ),
    "TransferFunction1D.preintegrated": Function(
        RAMP.preintegrated,
        {
            "scalar": Choice(
                (np.array([-1e30, 0.0, 1e-300, 1e30]),),
                np.array([0.0, 1.0]),
                ((np.array([1.0, 0.0]), "-1.0"), (np.array([0.0, nan]), "nan"), (np.ones((2, 2)), "(2, 2)")),
            ),
            "length": Choice((0.0, TINY, 1.0, 1e30), 1.0, ((-1.0, "-1.0"), (nan, "nan"), (inf, "inf"))),
        },
        (Claim(trailing=(4, 4, 3)), Claim(trailing=(4, 4))),
    ),
    "TransferFunction2D.__call__": Function(MAP.__call__, {"scalar": SCALAR, "gradient": SIGMA}, LIGHT_AND_DEPTH),
    "gradient_magnitude": Function(
        transfer_function.gradient_magnitude,
        {
            "values": Choice(
                (np.zeros((1, 1, 1)), np.zeros((2, 3, 4)), CELLS.values[-1], 1e-300 * CELLS.values[-1]),
                CELLS.usual,
                VOXELS.invalid,
            ),
            "low": Choice(((-1.0,) * 3, (0.0,) * 3), (-1.0,) * 3, (((nan, 0.0, 0.0), "nan"),)),
            "high": Choice(
                ((1.0,) * 3, (1e-30, 1.0, 1e30)), (1.0,) * 3, (((-1.0, 1.0, 1.0), "0.0"), ((inf, 1.0, 1.0), "inf"))
            ),
        },
        Claim(trailing=None),
        names={"low": "high - low", "high": "high - low"},
    ),
}

QUADRATURES = {
    "gauss_legendre": Function(
        quadrature.gauss_legendre,
        {
            "order": Choice((1, 2, 16, 64), 8, ((0, "0"), (-3, "-3"))),
            "low": Choice((-1.0, 0.0), -1.0),
            "high": Choice((0.5, 1.0), 1.0),
        },
        (Claim(-1.0, 1.0, trailing=None), Claim(0.0, 2.0, trailing=None)),
    ),
}

# Depths above a ray's start and along it, and directions; the ray has to end within the medium.
PLANE = {"tau": LENGTH, "depth": LENGTH, "mu": COSINE}
ELEVATIONS = Choice((1, 5, 8), 5, ((0, "0"),))


def ends_inside(tau, depth, mu, **_):
    return tau - mu * depth >= -1e-6 * np.maximum(tau, 1.0)


PLANE_PARALLELS = {
    "vertical_depth": Function(
        plane_parallel.vertical_depth,
        {"z": HEIGHT, "sigma_t": SIGMA, "scale_height": Interval(0.0, inf, (*LADDER[1:], inf), 1.0, open=(0.0,)), "base": HEIGHT,
         "top": finite(HEIGHT.values, 2.0)},
        NONNEGATIVE,
        valid=lambda base, top, **_: top > base,
    ),
    "single_scattering": Function(
        plane_parallel.single_scattering,
        PLANE | {"mu0": Interval(0.0, 1.0, (TINY, 1e-300, 1e-16, 0.5, ALMOST, 1.0), 0.4, open=(0.0,))},
        NONNEGATIVE, valid=ends_inside),
    "sky_light": Function(plane_parallel.sky_light, PLANE | G | {"elevations": ELEVATIONS}, NONNEGATIVE, valid=ends_inside,
                          rounding=1e-12, names={"elevations": "order"}),
    "sky_transmittance": Function(plane_parallel.sky_transmittance, {"tau": LENGTH, "elevations": ELEVATIONS}, SHARE,
                                  names={"elevations": "order"}),
}
CHAPMANS = {"chapman": Function(chapman.chapman, {"x": positive(), "mu": UP}, NONNEGATIVE)}


FUNCTIONS: dict[str, Function] = {
    f"{module}.{name}": function
    for module, functions in (
        ("phase", PHASE_FUNCTIONS),
        ("transmittance", TRANSMITTANCES),
        ("airlight", AIRLIGHTS),
        ("slab", SLABS),
        ("atmosphere", ATMOSPHERES),
        ("preetham", SKIES),
        ("quadrature", QUADRATURES),
        ("grid", GRIDS),
        ("opacity_map", OPACITY_MAPS),
        ("phase_fit", PHASE_FITS),
        ("projector", PROJECTORS),
        ("ambient_table", AMBIENT_TABLES),
        ("summed_area", SUMMED_AREAS),
        ("transfer_function", TRANSFER_FUNCTIONS),
        ("plane_parallel", PLANE_PARALLELS),
        ("chapman", CHAPMANS),
    )
    for name, function in functions.items()
}

# Public names that no case is derived from, with the reason.
EXCEPTED: dict[str, str] = {
    "ambient_table.load": "reads a file; all cases of AmbientTable read the one that is shipped",
    "ambient_table.AmbientTable.save": "writes a file; its own tests read it back",
    "ambient_table.build": "takes minutes; its result is the shipped table",
    "ambient_table.ratio": "Monte Carlo inside build, over arguments that build itself has chosen",
}
