# SPDX-License-Identifier: GPL-3.0-or-later
"""Airlight: single scattering along rays in an infinite homogeneous medium.

No occluders and no boundaries. Rays start at ``origin`` (..., 3) in metres, run
along the unit vector ``direction`` (..., 3) for ``distance`` metres, which may
be infinite. sigma_s and sigma_t are scattering and extinction per metre;
``phase`` maps an array of cos_theta, of any shape, to values per steradian.
The leading shapes of all arguments broadcast to the shape of the result; for
colour give the rays a trailing axis of length 1 before the 3 components.

Point and spot lights are integrated in the angle under which the light sees the
ray (equiangular), which absorbs the inverse square of the distance exactly:

    L = sigma_s / D * integral of p(-sin theta) I exp(-sigma_t (t + d)) d(theta),

with D the distance of the light from the ray's line, a = D tan(theta) the
position along the ray seen from the foot of the perpendicular, and d the
distance to the light. Source: Kulla and Fajardo, Importance sampling techniques
for path tracing in participating media, EGSR 2012.

All functions raise ValueError for NaN and for arguments out of range.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from . import checks
from .quadrature import gauss_legendre

# Beyond this optical depth behind its start nothing of a ray is seen:
# exp(-45) is 3e-20.
_OPAQUE_DEPTH = 45.0
_MAX_HALVINGS = 48
_MAX_EVALUATIONS = 20_000  # for each ray
# Positions beyond so many metres count as infinite, lights closer to the line of a
# ray than so many as on it: the squares of all others stay within float64.
_FAR = 1e150
_ON_THE_LINE = 1e-150
# The difference to the rule of half as many points, times this, is the error
# estimate; where convergence is only algebraic the difference alone falls short.
_DOUBT_FACTOR = 2.0
# Halving goes on until the estimate is below this share of the tolerance. Two rules
# agree by chance now and then: over 5000 cases a quarter kept all errors within it.
_SAFETY = 0.25
_EPSILON = float(np.finfo(np.float64).eps)


class Airlight(NamedTuple):
    """Radiance of single scattering with its own error.

    value: radiance, W m^-2 sr^-1 for intensities in W/sr and irradiances in W/m^2.
    error_estimate: estimated absolute error of value, same shape: of the quadrature
    and of its rounding, not of the given positions' own last digits.
    evaluations: integrand evaluations spent on each ray, same shape.
    """

    value: np.ndarray
    error_estimate: np.ndarray
    evaluations: np.ndarray


def point_light(
    origin,
    direction,
    distance,
    light_position,
    intensity,
    sigma_s,
    sigma_t,
    phase,
    order=16,
    adaptive=False,
    rtol=1e-8,
):
    """Airlight of a point light, L = integral of sigma_s p I / d^2 exp(-sigma_t (t + d)) dt.

    light_position (..., 3) in metres; intensity >= 0 in W/sr; the rest as in the
    module's docstring. Gauss-Legendre of ``order`` points in the equiangular
    variable; the error estimate compares with the rule of half as many points. With
    ``adaptive`` panels are halved until the estimate is well below rtol * value, or
    down to rounding, or 20,000 evaluations are spent; else it is one panel a ray.
    What was not reached shows in the error estimate. 16 points reach 1e-6 for smooth
    phase functions where the optical depth is moderate; sharp lobes, and lights
    very close to the ray in a dense medium, want ``adaptive``.

    A light exactly on the ray (within 1e-150 m) makes the integral infinite, as does
    one at its start: the value is then infinity, and its error estimate 0.
    """
    shape, ray, _ = _rays(origin, direction, distance, light_position, intensity, sigma_s, sigma_t)
    breaks = np.stack([ray.near, ray.far], axis=-1)
    return _integrate(ray, breaks, _uniform_emission, phase, order, adaptive, rtol, shape)


def spot_light(
    origin,
    direction,
    distance,
    light_position,
    intensity,
    sigma_s,
    sigma_t,
    phase,
    spot_direction,
    cone_angle,
    blend=0.0,
    order=16,
    adaptive=False,
    rtol=1e-8,
):
    """Airlight of a spot light: a point light whose intensity falls off towards its cone's edge.

    The intensity at the angle gamma from spot_direction, a unit vector (..., 3)
    along which the light travels, is intensity * smoothstep(x) with
    x = clamp((cos gamma - c) / ((1 - c) blend)) and c = cos(cone_angle / 2).
    cone_angle in (0, pi], the full angle in radians; blend in [0, 1], 0 a hard edge.

    Seen from the light, the cone lights one interval of angles of the ray. It is
    found in closed form, as is the interval of full intensity; each of the up to
    three intervals is integrated on its own, as in point_light.
    """
    spot_direction = checks.unit_vector("spot_direction", spot_direction)
    cone_angle = checks.checked(
        "cone_angle",
        cone_angle,
        lambda x: (x > 0) & (x <= np.pi),
        "in (0, pi] radians",
        "give the full angle of the cone",
    )
    blend = checks.fraction("blend", blend)

    def cone(direction, to_foot):
        length = _length_of(to_foot)
        across = np.sum(to_foot * spot_direction, axis=-1) / np.where(length > 0, length, 1.0)
        edge = np.cos(cone_angle / 2)
        along = np.sum(spot_direction * direction, axis=-1)
        return along, across, edge, edge + (1 - edge) * blend

    shape, ray, parts = _rays(
        origin, direction, distance, light_position, intensity, sigma_s, sigma_t, cone
    )
    spot = _Spot(*parts)
    breaks = np.clip(_cone_breaks(ray, spot), ray.near[:, np.newaxis], ray.far[:, np.newaxis])

    def emission(a, d, index):
        return _spot_falloff(_cone_cosine(a, d, ray.height[index], spot, index), spot, index)

    return _integrate(ray, breaks, emission, phase, order, adaptive, rtol, shape)


def sun(
    origin,
    direction,
    distance,
    sun_direction,
    irradiance,
    sigma_s,
    sigma_t,
    phase,
    sun_distance=0.0,
    sun_distance_slope=0.0,
):
    """Airlight of parallel light, in closed form where its way through the medium is linear.

    The light reaches the point at t along the ray after s(t) = s0 + s1 t metres
    in the medium, s0 = sun_distance and s1 = sun_distance_slope:

        L = sigma_s p E exp(-sigma_t s0) (1 - exp(-k distance)) / k,  k = sigma_t (1 + s1).

    sun_direction: unit vector (..., 3) along which the light travels; irradiance
    >= 0 in W/m^2, perpendicular to it; sun_distance >= 0 metres, may be infinite:
    an array, or a callable of the position (..., 3) that is asked at the origin;
    s(t) must not become negative along the ray. Under a level upper boundary,
    sun_distance_below gives both. Without extinction, or with k = 0, an infinite
    ray has infinite radiance.
    """
    origin = checks.vector("origin", origin, "metres")
    direction = checks.unit_vector("direction", direction)
    sun_direction = checks.unit_vector("sun_direction", sun_direction)
    s0 = sun_distance(origin) if callable(sun_distance) else sun_distance
    s0 = _length("sun_distance", s0)
    s1 = checks.finite("sun_distance_slope", sun_distance_slope, "metres per metre")
    distance = _length("distance", distance)
    irradiance = checks.nonnegative("irradiance", irradiance, "W/m^2", "use a positive one")
    sigma_s, sigma_t = _coefficients(sigma_s, sigma_t)

    cos_theta = np.clip(-np.sum(direction * sun_direction, axis=-1), -1.0, 1.0)
    density = _phase_value(phase, cos_theta)
    density, distance, irradiance, sigma_s, sigma_t, s0, s1, _ = np.broadcast_arrays(
        density, distance, irradiance, sigma_s, sigma_t, s0, s1, origin[..., 0]
    )
    with np.errstate(invalid="ignore"):
        s_end = s0 + _times(s1, distance)
    slack = 16 * _EPSILON * (s0 + _times(np.abs(s1), distance))
    checks.checked(
        "sun_distance along the ray",
        s_end,
        lambda s: (s >= -slack) & (s > -np.inf),
        ">= 0 metres",
        "end the ray where it leaves the medium",
    )
    rate = sigma_t * (1 + s1)
    # The decay starts from the brighter end; towards it the factor is at most 1.
    from_start = rate >= 0
    depth = np.where(
        from_start,
        _times(sigma_t, s0),
        _times(sigma_t, np.where(from_start, 0.0, distance + np.maximum(s_end, 0.0))),
    )
    path = _decay_path(np.abs(rate), distance)
    with np.errstate(over="ignore"):
        strength = _times(_times(sigma_s * irradiance, density), np.exp(-depth))
        value = _times(strength, path)
    # One rounding a factor, and the exponent's own.
    relative = _EPSILON * (16 + 2 * np.where(value > 0, depth, 0.0))
    error = np.where(np.isfinite(value), value, 0.0) * relative
    return Airlight(value[()], error[()], np.ones(value.shape, dtype=np.int64)[()])


def sun_distance_below(top, origin, direction, sun_direction):
    """(sun_distance, slope) for ``sun`` in a medium that ends level at the height ``top``.

    top in metres; origin (..., 3) below it; direction and sun_direction unit
    vectors (..., 3), the latter along the light's travel, downwards (z < 0).
    s0 = (top - z) / -sun_z and s1 = dir_z / sun_z.
    """
    origin = checks.vector("origin", origin, "metres")
    direction = checks.unit_vector("direction", direction)
    sun_direction = checks.unit_vector("sun_direction", sun_direction)
    descent = checks.checked(
        "downward part of sun_direction",
        -sun_direction[..., 2],
        lambda x: x > 0,
        "> 0",
        "let the light travel downwards, with negative z",
    )
    depth = checks.nonnegative(
        "depth of origin below top",
        checks.finite("top", top, "metres") - origin[..., 2],
        "metres",
        "start the ray inside the medium",
    )
    with np.errstate(over="ignore"):
        return depth / descent, -direction[..., 2] / descent


def point_light_without_extinction(
    origin, direction, distance, light_position, intensity, sigma_s
):
    """Airlight of an isotropically scattered point light for sigma_t = 0, in closed form.

    L = sigma_s I / (4 pi) * (angle under which the light sees the ray) / D, the
    limit of a thin medium. Arguments as in point_light.
    """
    shape, ray, _ = _rays(origin, direction, distance, light_position, intensity, sigma_s, 0.0)
    touching = _touches_light(ray)
    angle = _angle_over_height(ray.near, ray.far, np.where(touching, 1.0, ray.height))
    lit = (ray.strength > 0) & (ray.near < ray.far)
    value = np.where(lit, ray.strength / (4 * np.pi) * angle, 0.0)
    value = np.where(touching & lit, np.inf, value)
    error = np.where(touching, 0.0, 16 * _EPSILON * np.where(touching, 0.0, value))
    zero = np.zeros(value.shape, dtype=np.int64)
    return Airlight(*(x.reshape(shape)[()] for x in (value, error, zero)))


# --- rays seen from the light ------------------------------------------------


class _Ray(NamedTuple):
    """Rays (flattened) in the light's coordinates: a counts metres from the foot of the light."""

    foot: np.ndarray  # t of the point closest to the light, m
    height: np.ndarray  # D, distance of the light from the line, m
    near: np.ndarray  # a of the ray's start, m
    far: np.ndarray  # a of its end, m
    strength: np.ndarray  # sigma_s * intensity
    sigma_t: np.ndarray


class _Measure(NamedTuple):
    """A variable of integration along the ray; each function takes the height last."""

    width: Callable  # its increase from low to high
    middle: Callable  # position halfway between low and high
    positions: Callable  # positions at offsets (panels, nodes) from the middle, within low and high


class _Spot(NamedTuple):
    along: np.ndarray  # cosine between spot axis and ray
    across: np.ndarray  # cosine between spot axis and the way from light to foot
    edge: np.ndarray  # cosine at which the cone ends
    full: np.ndarray  # cosine from which on it is fully lit


def _rays(origin, direction, distance, position, intensity, sigma_s, sigma_t, parts=None):
    """Shape of the result, rays, and further arrays of the light, all flattened.

    ``parts`` maps the unit direction and the way from the light to its foot (..., 3),
    zero for a light on the line, to such arrays.
    """
    origin = checks.vector("origin", origin, "metres")
    position = checks.vector("light_position", position, "metres")
    direction = checks.unit_vector("direction", direction)
    distance = _length("distance", distance)
    intensity = checks.nonnegative("intensity", intensity, "W/sr", "use a positive intensity")
    sigma_s, sigma_t = _coefficients(sigma_s, sigma_t)

    to_light = position - origin
    foot = np.sum(to_light * direction, axis=-1)
    height = _length_of(np.cross(to_light, direction))
    height = np.where(height < _ON_THE_LINE, 0.0, height)
    rays = [foot, height, distance, sigma_s * intensity, sigma_t]
    if parts is not None:
        to_foot = foot[..., np.newaxis] * direction - to_light
        rays += parts(direction, np.where(height[..., np.newaxis] > 0, to_foot, 0.0))

    rays = np.broadcast_arrays(*rays)
    shape = rays[0].shape
    foot, height, distance, strength, sigma_t, *parts = (x.ravel() for x in rays)
    return shape, _Ray(foot, height, -foot, distance - foot, strength, sigma_t), parts


def _length_of(vector):
    """Euclidean length; the squares of tiny vectors would vanish."""
    return np.hypot(np.hypot(vector[..., 0], vector[..., 1]), vector[..., 2])


def _touches_light(ray):
    at_light = (ray.near <= _ON_THE_LINE) & (ray.far >= -_ON_THE_LINE)
    return (ray.height == 0) & at_light


def _angle_over_height(low, high, height):
    """Angle under which the light sees [low, high], divided by the height; finite at height 0."""
    endless = np.isinf(high)
    end = np.where(endless, 1.0, high)
    scale = np.maximum(np.maximum(np.abs(low), np.abs(end)), height)
    scale = np.where(scale > 0, scale, 1.0)
    length = np.where(endless, 1.0, (end - low) / scale)
    x = np.where(endless, low, height * (height / scale) + (low / scale) * end)
    y = height * length
    flat = y == 0
    angle = np.arctan2(y, x) / np.where(flat, 1.0, y)
    level = np.where(flat, 1 / np.where(flat & (x > 0), x, 1.0), angle)
    return length * level


def _middle(low, high, height):
    """The position that halves the angle under which the light sees [low, high]."""
    endless = np.isinf(high)
    end = np.where(endless, 0.0, high)
    from_low, from_end = np.hypot(low, height), np.hypot(end, height)
    total = np.where(from_low + from_end > 0, from_low + from_end, 1.0)
    same_side = low * (from_end / total) + end * (from_low / total)
    # Opposite signs cancel; their difference of squares does not.
    # The share below is at most 1, and no product on the way to it overflows.
    crosses = (low < 0) & (end > 0)
    crossed = np.where(crosses, end * from_low - low * from_end, 0.0)
    share = np.where(crosses, height * (end - low), 0.0) / np.where(crossed > 0, crossed, 1.0)
    halved = np.where(crosses, height * ((end + low) / total) * share, same_side)
    return np.where(endless, _tangent(low, height), halved)


def _tangent(a, height):
    """a + hypot(a, height) without cancellation for negative a."""
    d = np.hypot(a, height)
    behind = a < 0
    return np.where(behind, height * (height / np.where(behind, d - a, 1.0)), a + d)


# --- spot cone ---------------------------------------------------------------


def _cone_breaks(ray, spot):
    """Positions (rays, 4): cone entered, fully lit, fully lit no more, cone left.

    With theta the light's angle to the ray, cos gamma = rho cos(theta - axis), so
    that each limiting cosine bounds one interval around the axis.
    """
    rho = np.hypot(spot.along, spot.across)
    axis = np.arctan2(spot.along, spot.across)
    half = [_half_width(limit, rho) for limit in (spot.edge, spot.full)]
    angles = np.stack([axis - half[0], axis - half[1], axis + half[1], axis + half[0]], axis=-1)
    ahead, behind = angles >= np.pi / 2, angles <= -np.pi / 2
    inner = ray.height[:, np.newaxis] * np.tan(np.where(ahead | behind, 0.0, angles))
    return np.where(ahead, np.inf, np.where(behind, -np.inf, inner))


def _half_width(limit, rho):
    unreached = limit >= rho
    return np.where(unreached, 0.0, np.arccos(limit / np.where(unreached, 1.0, rho) * ~unreached))


def _cone_cosine(a, d, height, spot, index):
    return (height * spot.across[index] + a * spot.along[index]) / d


def _spot_falloff(cosine, spot, index):
    edge, full = spot.edge[index], spot.full[index]
    hard = full <= edge
    x = np.where(hard, cosine >= edge, (cosine - edge) / np.where(hard, 1.0, full - edge))
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)


def _uniform_emission(a, d, index):
    return 1.0


# --- quadrature --------------------------------------------------------------


def _integrate(ray, breaks, emission, phase, order, adaptive, rtol, shape):
    """Sum the panels between neighbouring breaks (rays, n), in the angle seen from the light."""
    touching = _touches_light(ray)
    infinite = touching & _lit_at_light(ray, emission, phase)
    panels = _panels(ray, breaks, (~touching & (ray.strength > 0))[:, np.newaxis])
    value, error, evaluations = _sum_panels(
        ray, panels, _EQUIANGULAR, emission, phase, order, adaptive, rtol
    )
    value = np.where(infinite, np.inf, value)
    return Airlight(*(x.reshape(shape)[()] for x in (value, error, evaluations)))


def _sum_panels(ray, panels, measure, emission, phase, order, adaptive, rtol):
    """Value, error and evaluations of each ray: its panels' sum, halving them if adaptive."""
    order = _order(order)
    rtol = checks.positive("rtol", rtol, "(relative)", "use such as 1e-8")
    count = len(ray.foot)
    value, error = np.zeros(count), np.zeros(count)
    evaluations = np.zeros(count, dtype=np.int64)
    index, low, high = panels
    for halving in range(_MAX_HALVINGS + 1):
        if index.size == 0:
            break
        part, doubt, floor, middle = _panel_sums(
            ray, index, low, high, measure, emission, phase, order
        )
        evaluations += np.bincount(index, minlength=count) * (order + _check_order(order))
        here = np.bincount(index, part, count)
        total = value + here
        if adaptive and halving < _MAX_HALVINGS:
            doubtful = error + np.bincount(index, doubt, count)
            allowed = _SAFETY * rtol * total
            share = allowed / (4 * np.maximum(np.bincount(index, minlength=count), 1))
            split = (doubtful > allowed)[index] & (doubt > np.maximum(share[index], floor))
            split &= (low < middle) & (middle < high) & (evaluations < _MAX_EVALUATIONS)[index]
        else:
            split = np.zeros(index.shape, dtype=bool)
        done = ~split
        value += np.bincount(index[done], part[done], count)
        error += np.bincount(index[done], (doubt + floor)[done], count)
        index, low, middle, high = (x[split] for x in (index, low, middle, high))
        index = np.concatenate([index, index])
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return value, error, evaluations


def _panels(ray, breaks, wanted):
    """Flat (ray index, low, high) of the wanted panels, cut where the medium is opaque."""
    low, high = breaks[:, :-1], breaks[:, 1:]
    index = np.broadcast_to(np.arange(len(breaks))[:, np.newaxis], low.shape)
    keep = (low < high) & wanted
    index, low, high = index[keep], low[keep], high[keep]
    start = np.full(len(breaks), np.inf)
    np.minimum.at(start, index, low)
    high = np.minimum(high, _visible_end(start[index], ray.height[index], ray.sigma_t[index]))
    high = np.where(high > _FAR, np.inf, high)
    keep = low < high
    return index[keep], low[keep], high[keep]


def _visible_end(start, height, sigma_t):
    """Position at which the way from the light to the eye is _OPAQUE_DEPTH longer than at start."""
    clear = sigma_t == 0
    with np.errstate(over="ignore"):
        reach = _tangent(start, height) + _OPAQUE_DEPTH / np.where(clear, 1.0, sigma_t)
    return np.where(clear, np.inf, (reach - height * (height / reach)) / 2)


def _panel_sums(ray, index, low, high, measure, emission, phase, order):
    """Integral over each panel, its doubt, its rounding, and the panel's middle."""
    height = ray.height[index]
    middle = measure.middle(low, high, height)
    width = measure.width(low, high, height)
    scale = _times(ray.strength[index], width)
    fades_late = _fades_late(low, middle, high, height, ray.sigma_t[index])[:, np.newaxis]

    def rule(points):
        nodes, weights = gauss_legendre(points, -0.5, 0.5)
        # Squared towards the far end: a late fading wants its nodes there.
        rest = 0.5 - nodes
        nodes = np.where(fades_late, 0.5 - rest * rest, nodes)
        weights = np.where(fades_late, 2 * rest, 1.0) * weights
        a = measure.positions(width[:, np.newaxis] * nodes, middle, low, high, height)
        integrand, rounding = _integrand(ray, a, index, emission, phase)
        terms = integrand * weights
        sums = np.sum(terms, axis=-1), np.sum(terms * rounding, axis=-1)
        return tuple(_times(scale, total) for total in sums)

    fine, floor = rule(order)
    coarse, _ = rule(_check_order(order))
    return fine, _DOUBT_FACTOR * np.abs(fine - coarse), floor, middle


def _fades_late(low, middle, high, height, sigma_t):
    """Whether the light fades mostly within the second half of the panel's angle.

    A light close to the ray sees all the far part of it, where the medium
    absorbs, under a small angle: exp(-sigma_t D tan(...)) then drops in a layer
    of width sigma_t D, which evenly spread nodes miss.
    """
    start, halfway = _tangent(low, height), _tangent(middle, height)
    end = _tangent(np.where(np.isinf(high), middle, high), height)
    drop = sigma_t * (end - start)
    return (drop > 0.01) & (sigma_t * (halfway - start) < 0.2 * drop)


def _positions(offset, middle, low, high, height):
    """Positions whose angle seen from the light differs from the middle's by height * offset."""
    middle, low, high, height = (x[:, np.newaxis] for x in (middle, low, high, height))
    turn = height * offset
    flat = turn == 0
    tangent = np.tan(turn)
    over_height = np.where(flat, offset, offset * (tangent / np.where(flat, 1.0, turn)))
    a = (middle + height * tangent) / (1 - middle * over_height)
    return np.clip(a, low, high)


_EQUIANGULAR = _Measure(_angle_over_height, _middle, _positions)


def _integrand(ray, a, index, emission, phase):
    """Phase, emission and attenuation at the positions a (panels, nodes), and their rounding."""
    index = index[:, np.newaxis]
    height = ray.height[index]
    d = np.hypot(a, height)
    depth = _times(ray.sigma_t[index], ray.foot[index] + _tangent(a, height))
    density = _phase_value(phase, np.clip(-a / np.where(d > 0, d, 1.0), -1.0, 1.0))
    value = density * emission(a, d, index) * np.exp(-np.maximum(depth, 0.0))
    return value, _EPSILON * (16 + 2 * np.abs(depth))


def _lit_at_light(ray, emission, phase):
    """Whether rays through the light see light scattered right before or behind it."""
    index = np.arange(len(ray.foot))
    one = np.ones(len(ray.foot))
    before = emission(-one, one, index) * _phase_value(phase, one)
    behind = emission(one, one, index) * _phase_value(phase, -one)
    # A ray that touches the light with its start has its length behind it.
    lit = ((ray.near < -_ON_THE_LINE) & (before > 0)) | ((ray.far > _ON_THE_LINE) & (behind > 0))
    return lit & (ray.strength > 0) & (ray.near < ray.far)


def _check_order(order):
    """Points of the rule that the error estimate compares with."""
    return order // 2


# --- shared ------------------------------------------------------------------


def _decay_path(rate, distance):
    """Integral of exp(-rate t) over t in [0, distance]."""
    depth = _times(rate, distance)
    steep = depth > 1
    level = np.where(steep | (depth == 0), 1.0, depth)
    gentle = distance * np.where(depth == 0, 1.0, -np.expm1(-level) / level)
    with np.errstate(over="ignore"):
        return np.where(steep, -np.expm1(-depth) / np.where(steep, rate, 1.0), gentle)


def _times(a, b):
    """a * b with 0 * inf = 0."""
    nothing = (a == 0) | (b == 0)
    with np.errstate(over="ignore"):
        return np.where(nothing, 0.0, np.where(nothing, 1.0, a) * np.where(nothing, 1.0, b))


def _phase_value(phase, cos_theta):
    return checks.checked(
        "phase(cos_theta)",
        phase(cos_theta),
        lambda p: p >= 0,
        ">= 0 per steradian",
        "pass a phase function of cos_theta",
    )


def _coefficients(sigma_s, sigma_t):
    return (
        checks.nonnegative("sigma_s", sigma_s, "per metre", "use a positive coefficient"),
        checks.nonnegative("sigma_t", sigma_t, "per metre", "use a positive extinction"),
    )


def _length(name, value):
    return checks.nonnegative_or_infinite(
        name, value, "metres", "measure along the ray from its start"
    )


def _order(order):
    if not isinstance(order, (int, np.integer)) or order < 2:
        raise ValueError(f"order must be an integer >= 2, got {order!r}; 16 is usual")
    return int(order)
