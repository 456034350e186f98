# SPDX-License-Identifier: GPL-3.0-or-later
"""Transmittance and path lengths: how much light gets through.

Lengths in metres, extinction sigma_t per metre, optical depth and transmittance
without unit. All arguments broadcast, computation is float64. Lengths along a
ray may be infinite. Every function raises ValueError for NaN and for arguments
out of range. A value beyond the range of float64 becomes 0 or infinity.
"""

import numpy as np

from . import checks


def beer_lambert(sigma_t, distance):
    """Transmittance exp(-sigma_t * distance) of a homogeneous medium (Beer-Lambert).

    sigma_t finite and >= 0 per metre; distance >= 0 metres, or infinite. No medium
    over an infinite distance (0 * inf) transmits everything.
    """
    return _transmitted(_depth(_extinction(sigma_t), _distance(distance)))


def extinction_from_color(color, distance):
    """Extinction -ln(color) / distance per metre that leaves ``color`` after ``distance``.

    color in (0, 1] per channel; distance finite and > 0 metres. Black (0) would
    take an infinite extinction and raises ValueError.
    """
    color = checks.checked(
        "color",
        color,
        lambda x: (x > 0) & (x <= 1),
        "in (0, 1]",
        "black takes infinite extinction, use a dark value such as 0.001",
    )
    distance = checks.positive(
        "distance", distance, "metres", "give the distance at which the colour is reached"
    )
    with np.errstate(over="ignore"):
        sigma_t = np.abs(np.log(color)) / distance
    return checks.finite(
        "extinction", sigma_t, "per metre", "use a longer distance for this colour"
    )[()]


# --- exponential height fog --------------------------------------------------


def height_optical_depth(z, dir_z, distance, sigma_0, scale_height, base_height=0.0):
    """Optical depth of extinction sigma_0 exp(-(z - base_height) / scale_height) along a ray.

    Integral over t in [0, distance] at heights z + t dir_z:
    sigma_0 exp(-low / H) * d * (1 - exp(-x)) / x, with x = d |dir_z| / H and low
    the height of the lower end over the base. Started from the lower end all
    factors stay bounded, for horizontal rays (x -> 0) as well as for steep ones.

    z and base_height in metres; dir_z in [-1, 1], the vertical part of the unit
    direction; distance >= 0, may be infinite; sigma_0 >= 0 per metre, the
    extinction at base_height; scale_height > 0 metres. Upwards an infinite ray
    has the finite depth sigma_0 exp(-h / H) H / dir_z; level or downwards its
    depth is infinite. The fog goes on below base_height and gets denser there.
    """
    z = checks.finite("z", z, "metres")
    dir_z = checks.cosine("dir_z", dir_z)
    distance = _distance(distance)
    sigma_0 = checks.nonnegative("sigma_0", sigma_0, "per metre", "use a positive extinction")
    scale_height = checks.positive(
        "scale_height", scale_height, "metres", "for uniform fog use beer_lambert"
    )
    base_height = checks.finite("base_height", base_height, "metres")

    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        low = z - base_height + _times(np.minimum(dir_z, 0.0), distance)
        log_path = _log_falloff_path(np.abs(dir_z), distance, scale_height)
        # One exponential of a sum: a product of an enormous density and a tiny
        # path would overflow before it shrinks.
        depth = np.exp(-low / scale_height + np.log(sigma_0) + log_path)
    # Where one term of the sum is infinite it decides, whatever the others are.
    depth = np.where(log_path == np.inf, np.inf, depth)
    return np.where((sigma_0 == 0) | (log_path == -np.inf), 0.0, depth)[()]


def height_transmittance(z, dir_z, distance, sigma_0, scale_height, base_height=0.0):
    """Transmittance exp(-height_optical_depth(...)) of exponential height fog; same arguments."""
    return _transmitted(
        height_optical_depth(z, dir_z, distance, sigma_0, scale_height, base_height)
    )


def _log_falloff_path(slope, distance, scale_height):
    """ln of the integral of exp(-t slope / H) over t in [0, distance]."""
    drop = _times(slope, distance) / scale_height
    steep = drop > 1
    # (1 - exp(-x)) / x, whose limit at 0 is 1.
    gentle_drop = np.where(steep | (drop == 0), 1.0, drop)
    mean = np.where(drop == 0, 1.0, -np.expm1(-gentle_drop) / gentle_drop)
    gentle = np.log(distance) + np.log(mean)
    whole = np.log(scale_height) - np.log(np.where(steep, slope, 1.0))
    return np.where(steep, whole + np.log1p(-np.exp(-np.where(steep, drop, 1.0))), gentle)


# --- depth fogs --------------------------------------------------------------


def linear_fog(depth, start, end):
    """Transmittance of linear depth fog, (end - depth) / (end - start) clamped to [0, 1].

    depth >= 0 metres, may be infinite; start < end in metres.
    Source: OpenGL 1.0, GL_LINEAR.
    """
    depth = _distance(depth, "depth")
    start = checks.finite("start", start, "metres")
    end = checks.finite("end", end, "metres")
    with np.errstate(over="ignore"):
        width = checks.positive(
            "end - start", end - start, "metres", "let the fog end behind its start"
        )
        return np.clip((end - depth) / width, 0.0, 1.0)


def exp_fog(depth, density):
    """Transmittance of exponential depth fog, exp(-density * depth).

    depth >= 0 metres, may be infinite; density >= 0 per metre.
    Source: OpenGL 1.0, GL_EXP.
    """
    return _transmitted(_depth(_density(density), _distance(depth, "depth")))


def exp2_fog(depth, density):
    """Transmittance of squared exponential depth fog, exp(-(density * depth)^2).

    depth >= 0 metres, may be infinite; density >= 0 per metre.
    Source: OpenGL 1.0, GL_EXP2.
    """
    product = _depth(_density(density), _distance(depth, "depth"))
    with np.errstate(over="ignore"):
        return _transmitted(product * product)


def coverage_blend(coverage, transmittance):
    """Transmittance behind a layer that is opaque over the share ``coverage``: (1 - coverage) T.

    coverage, the opaque share, and transmittance of what lies in the gaps, both in [0, 1].
    """
    coverage = checks.fraction("coverage", coverage)
    transmittance = checks.fraction("transmittance", transmittance)
    return (1 - coverage) * transmittance


# --- slabs, plates and shells ------------------------------------------------


def slab_path_length(z, dir_z, distance, bottom, top):
    """Length of a ray within the horizontal slab bottom <= height <= top, in metres.

    z: starting height in metres; dir_z in [-1, 1]; distance >= 0, may be infinite;
    bottom <= top, which may be -inf and +inf. It is the least of four lengths:
    the ray, the rest of it behind the entry, the way to the exit, and the whole
    crossing (top - bottom) / |dir_z|, the last of which keeps thin slabs exact
    from far away.
    """
    z = checks.finite("z", z, "metres")
    dir_z = checks.cosine("dir_z", dir_z)
    distance = _distance(distance)
    bottom, top = _slab(bottom, top)

    slope = np.abs(dir_z)
    level = slope == 0
    divisor = np.where(level, 1.0, slope)
    upwards = dir_z > 0
    with np.errstate(over="ignore", invalid="ignore"):
        entry = np.where(upwards, bottom - z, z - top) / divisor
        leave = np.where(upwards, top - z, z - bottom) / divisor
        crossing = (top - bottom) / divisor
        behind_entry = np.where(entry < distance, distance - entry, 0.0)
    inclined = np.minimum(np.minimum(distance, behind_entry), np.minimum(leave, crossing))
    along = np.where((z >= bottom) & (z <= top), distance, 0.0)
    return np.where(level, along, np.maximum(inclined, 0.0))[()]


def slab_optical_depth(sigma_t, z, dir_z, distance, bottom, top):
    """Optical depth sigma_t * slab_path_length(...) of a ray through a homogeneous slab.

    sigma_t finite and >= 0 per metre; the rest as in slab_path_length.
    """
    return _depth(_extinction(sigma_t), slab_path_length(z, dir_z, distance, bottom, top))


def plate_path_length(cos_theta, thickness, ior=1.0):
    """Path inside a plane plate, thickness * n / sqrt((n - 1)(n + 1) + cos^2), in metres.

    cos_theta in [-1, 1]: cosine between ray and normal outside the plate, either
    side; inside, Snell's law holds. thickness >= 0 metres; ior n in [1, 1000] relative to
    the outside. Infinite only for n = 1 at grazing incidence.
    """
    c = checks.cosine("cos_theta", cos_theta)
    thickness = checks.nonnegative("thickness", thickness, "metres", "use a positive thickness")
    n = _index(ior)
    cosine_times_n = np.hypot(np.sqrt(n - 1) * np.sqrt(n + 1), c)
    with np.errstate(over="ignore", divide="ignore"):
        stretch = n / cosine_times_n
        return _times(thickness, stretch)[()]


def shell_path_length(impact_parameter, outer_radius, inner_radius, ior=1.0):
    """Path inside the wall of a hollow sphere against the ray's impact parameter b, in metres.

    The wall between inner_radius r and outer_radius R has index n in [1, 1000]; outside
    and cavity have index 1. One pass without partial reflections:

        path = 2 (sqrt(R^2 - q^2) - sqrt(max(r^2 - q^2, 0))),   q = b / n.

    Snell's law at R turns the ray into a line of impact parameter q = b / n.
    - q >= r: the line misses the cavity, a chord of the outer sphere.
    - b < r: it meets the cavity with sine q / r, leaves into it with sine b / r,
      crosses and enters the wall on the far side at the same angle.
    - q < r <= b: that sine would exceed 1. The ray is totally reflected at the
      cavity and leaves by a way as long as the way in.
    The last two have the same two stretches in the wall, hence one formula. No
    ray is trapped: it meets R from inside with sine b / (n R), below the critical
    1 / n. The difference of roots is taken as (R^2 - r^2) / sum for thin walls.

    impact_parameter >= 0; 0 <= inner_radius <= outer_radius; metres. b > R misses
    and gives 0; b = R counts as touching (the limit from inside).
    """
    b = checks.nonnegative("impact_parameter", impact_parameter, "metres", "use its size")
    outer = checks.nonnegative("outer_radius", outer_radius, "metres", "use a positive radius")
    inner = checks.nonnegative("inner_radius", inner_radius, "metres", "use a positive radius")
    n = _index(ior)
    b, outer, inner, n = np.broadcast_arrays(b, outer, inner, n)
    checks.checked(
        "inner_radius",
        inner,
        lambda r: r <= outer,
        "at most outer_radius",
        "swap the radii",
    )
    hits = b <= outer
    b = np.where(hits, b, 0.0)
    outer_root = _half_chord(outer, b, n)
    inner_root = _half_chord(inner, b, n)
    total = outer_root + inner_root
    crossing = (outer - inner) * ((outer + inner) / np.where(total > 0, total, 1.0))
    length = 2 * np.where(inner_root > 0, crossing, outer_root)
    return np.where(hits, length, 0.0)[()]


def _half_chord(radius, b, n):
    """sqrt(radius^2 - (b/n)^2), 0 if b/n is larger; exact differences for n close to 1."""
    gap = (radius * (n - 1) + (radius - b)) / n
    return np.sqrt(np.maximum(gap, 0.0)) * np.sqrt(radius + b / n)


# --- estimation --------------------------------------------------------------


def ratio_tracking(density_function, majorant, distance, rng):
    """Unbiased random estimate of exp(-integral of sigma_t over [0, distance]).

    Tentative collisions are drawn with the rate ``majorant`` and each multiplies
    the estimate by 1 - sigma_t / majorant, which stays in [0, 1].

    density_function(t): extinction per metre at the distances t along the rays;
    it receives an array of the shape of majorant and distance broadcast, so that
    it may be different for each ray, and must stay in [0, majorant].
    majorant >= 0 per metre and distance >= 0 metres, both finite; rng: a
    numpy.random.Generator. The time grows as the largest majorant * distance.
    Returns one estimate per ray. Raises ValueError where the majorant is exceeded.
    Source: Novak, Selle and Jarosz, Residual ratio tracking, SIGGRAPH Asia 2014.
    """
    majorant = checks.nonnegative("majorant", majorant, "per metre", "bound the extinction")
    distance = checks.nonnegative("distance", distance, "metres", "cut the ray at the medium")
    majorant, distance = np.broadcast_arrays(majorant, distance)
    estimate = np.ones(majorant.shape)
    t = np.zeros(majorant.shape)
    active = (majorant > 0) & (distance > 0)
    while np.any(active):
        step = rng.standard_exponential(majorant.shape)
        with np.errstate(over="ignore"):
            t = t + step / np.where(active, majorant, 1.0)
        active = active & (t < distance)
        sigma_t = checks.nonnegative(
            "density_function(t)", density_function(np.minimum(t, distance)), "per metre", "use a positive extinction"
        )
        bound = majorant * (1 + 4 * np.finfo(np.float64).eps)
        checks.checked(
            "density_function(t)",
            np.where(active, sigma_t, 0.0),
            lambda x: x <= bound,
            "at most the majorant",
            "raise the majorant",
        )
        passed = 1 - np.where(active, sigma_t, 0.0) / np.where(active, majorant, 1.0)
        estimate = estimate * np.maximum(passed, 0.0)
        active = active & (estimate > 0)
    return estimate[()]


# --- shared ------------------------------------------------------------------


def _times(a, b):
    """a * b with 0 * inf = 0: nothing over an infinite distance is nothing."""
    nothing = (a == 0) | (b == 0)
    return np.where(nothing, 0.0, np.where(nothing, 1.0, a) * np.where(nothing, 1.0, b))


def _depth(sigma_t, distance):
    with np.errstate(over="ignore"):
        return _times(sigma_t, distance)[()]


def _transmitted(depth):
    with np.errstate(under="ignore"):
        return np.exp(-depth)


def _extinction(sigma_t):
    return checks.nonnegative("sigma_t", sigma_t, "per metre", "use a positive extinction")


def _density(density):
    return checks.nonnegative("density", density, "per metre", "use a positive density")


def _distance(distance, name="distance"):
    return checks.nonnegative_or_infinite(
        name, distance, "metres", "measure along the ray from its start"
    )


def _index(ior):
    return checks.checked(
        "ior",
        ior,
        lambda x: (x >= 1) & (x <= 1000),
        "in [1, 1000]",
        "give the index relative to the outside; 1 bends nothing",
    )


def _slab(bottom, top):
    bottom = checks.checked(
        "bottom", bottom, lambda x: x < np.inf, "a height in metres or -inf", "use -inf for none"
    )
    top = checks.checked(
        "top", top, lambda x: x > -np.inf, "a height in metres or +inf", "use +inf for none"
    )
    bottom, top = np.broadcast_arrays(bottom, top)
    checks.checked("bottom", bottom, lambda x: x <= top, "at most top", "swap bottom and top")
    return bottom, top
