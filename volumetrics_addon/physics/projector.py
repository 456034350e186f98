# SPDX-License-Identifier: GPL-3.0-or-later
"""Projector light: a point that shines through a frustum and an image, as a slide projector in haze.

In the light's frame (right, up, forward) a point (x, y, z) is seen at

    u = (x / z) / tan(horizontal_fov / 2),  v = (y / z) / tan(vertical_fov / 2)

and is lit where near <= z <= far, z > 0 and r <= 1, with r = max(|u|, |v|), or sqrt(u^2 + v^2)
where the frustum is elliptic. The soft edge is a factor smoothstep((1 - r) / blend), the gobo an
image over u, v in [-1, 1]: column 0 at u = -1, row 0 at the top, v = +1; bilinear between the
centres of its pixels, constant beyond the outer ones. With d the distance to the light,

    irradiance = intensity / d^falloff * soft edge * gobo,  falloff 0, 1 or 2.

Arguments all functions share: light_position (..., 3) in metres; the light's unit direction and an
``up`` (..., 3) that need only be not parallel to it, right = direction x up; full angles of view
horizontal_fov and vertical_fov in (0, pi) radians; 0 <= near <= far metres along the light's
direction, far may be infinite; intensity >= 0 in W m^(falloff - 2), which is W/sr for falloff 2;
blend in [0, 1], 0 a hard edge; gobo (rows, columns) of values >= 0, or (rows, columns, 3), which
adds a last axis of 3 to the result. Leading shapes broadcast; falloff, gobo and elliptic are one for
all. ValueError for NaN and for arguments out of range.

Light volumes of shadow-mapped projectors: Dobashi, Yamamoto and Nishita, Interactive rendering of
atmospheric scattering effects using graphics hardware, Graphics Hardware 2002.
"""

from typing import NamedTuple

import numpy as np

from . import airlight, checks

_EPSILON = float(np.finfo(np.float64).eps)
# Within so many roundings a ray counts as parallel to a face of the frustum, or as within it.
_PARALLEL_ROUNDINGS = 8
# So many metres from the light a ray has reached its vanishing point in the image.
_FAR = 1e100
# Beyond this optical depth from the light nothing is left of the strongest light that a float can hold.
_BLACK_DEPTH = 1500.0
# Rays are integrated in tiles of about so many integrand values.
_TILE = 1 << 20


class ProjectorInterval(NamedTuple):
    """Part of each ray inside a projector's frustum, in metres along the ray.

    entry, exit: >= 0, exit may be infinite; entry = inf and exit = -inf where the ray misses it.
    full_entry, full_exit: the part inside the soft edge, r <= 1 - blend, likewise.
    """

    entry: np.ndarray
    exit: np.ndarray
    full_entry: np.ndarray
    full_exit: np.ndarray


def projector_irradiance(
    position,
    light_position,
    direction,
    up,
    intensity,
    horizontal_fov,
    vertical_fov,
    near=0.0,
    far=np.inf,
    falloff=2,
    blend=0.0,
    gobo=None,
    elliptic=False,
):
    """Unattenuated irradiance at ``position`` (..., 3), in metres, on a surface that faces the light.

    In W/m^2; formula and arguments are the module's. The light's own position counts as the middle
    of the image if near is 0, so that falloff 1 and 2 are infinite there.
    """
    position = checks.vector("position", position, "metres")
    light_position = checks.vector("light_position", light_position, "metres")
    intensity, falloff = _intensity(intensity), _falloff(falloff)
    gobo, channels = _gobo(gobo)
    lens = _lens(direction, up, horizontal_fov, vertical_fov, near, far, blend)
    offset = position - light_position
    d = airlight._length_of(offset)
    at_light = d == 0
    # From the light itself: the middle of the image.
    unit = np.where(at_light[..., np.newaxis], lens.forward, offset / np.where(at_light, 1.0, d)[..., np.newaxis])
    u, v, ahead = _image(*_homogeneous(unit, lens))
    depth = np.sum(offset * lens.forward, axis=-1)
    lit = ahead & (_radius(u, v, elliptic) <= 1) & (depth >= lens.near) & (depth <= lens.far)
    strength = intensity * np.where(lit, _soft_edge(u, v, lens.blend, elliptic), 0.0)
    with np.errstate(over="ignore", divide="ignore"):
        reach = np.where(strength > 0, d, 1.0)
        for _ in range(falloff):
            strength = strength / reach
    if gobo is None:
        return strength[()]
    shown = _sample(gobo, u[..., np.newaxis], v[..., np.newaxis], np.arange(gobo.shape[2]))
    return airlight._times(strength[..., np.newaxis], shown).reshape(strength.shape + channels)[()]


def projector_interval(
    origin,
    direction,
    light_position,
    light_direction,
    up,
    horizontal_fov,
    vertical_fov,
    near=0.0,
    far=np.inf,
    blend=0.0,
    elliptic=False,
):
    """ProjectorInterval of the rays from ``origin`` (..., 3) along the unit vector ``direction`` (..., 3).

    The frustum is the intersection of six half-spaces, or, if elliptic, of a quadric cone with the
    two of near and far. Its faces belong to it: rays within them, along an edge or touching the cone
    count as inside to rounding. Further arguments are the module's.
    """
    lens = _lens(light_direction, up, horizontal_fov, vertical_fov, near, far, blend)
    shape, ray, parts = airlight._rays(
        origin, direction, np.inf, light_position, 1.0, 0.0, 0.0, lambda *way: _line(*way, lens)
    )
    frustum = _Frustum(*parts)
    ends = []
    for scale in (1.0, 1 - frustum.blend):
        low, high = _inside(frustum, scale, elliptic)
        low = np.maximum(low, ray.near)
        missed = low > high
        ends += [np.where(missed, np.inf, np.maximum(low + ray.foot, 0.0)), np.where(missed, -np.inf, high + ray.foot)]
    return ProjectorInterval(*(x.reshape(shape)[()] for x in ends))


def projector_breaks(
    origin,
    direction,
    light_position,
    light_direction,
    up,
    horizontal_fov,
    vertical_fov,
    near=0.0,
    far=np.inf,
    falloff=2,
    blend=0.0,
    gobo=None,
    elliptic=False,
):
    """Positions (..., k) along rays, in metres and unsorted, where the irradiance is not smooth.

    They hold entry and exit of the frustum (see projector_interval, whose arguments these are), the ends and creases
    of the soft edge, and the lines between the gobo's pixel centres. A ray that misses the frustum has none that
    are finite or none inside it.
    """
    lens = _lens(light_direction, up, horizontal_fov, vertical_fov, near, far, blend)
    shape, ray, parts = airlight._rays(
        origin, direction, np.inf, light_position, 1.0, 0.0, 0.0, lambda *way: _line(*way, lens)
    )
    frustum = _Frustum(*parts)
    low, high = _inside(frustum, 1.0, elliptic)
    light = _Light(frustum, None, _falloff(falloff), elliptic, _gobo(gobo)[0])
    breaks = _creases(light, np.maximum(low, ray.near), high) + ray.foot[:, np.newaxis]
    return breaks.reshape(*shape, breaks.shape[-1])


def projector_airlight(
    origin,
    direction,
    distance,
    light_position,
    light_direction,
    up,
    intensity,
    horizontal_fov,
    vertical_fov,
    sigma_s,
    sigma_t,
    phase,
    near=0.0,
    far=np.inf,
    falloff=2,
    blend=0.0,
    gobo=None,
    elliptic=False,
    ambient=0.0,
    order=16,
    adaptive=False,
    rtol=1e-8,
):
    """Airlight of a projector in an infinite homogeneous medium, and of an ambient radiance in it.

        L = sigma_s integral of p E(t) exp(-sigma_t (t + d)) dt + sigma_s ambient (1 - exp(-sigma_t distance)) / sigma_t

    with E the unattenuated irradiance. Rays, media, phase, order, adaptive and rtol are those of
    ``airlight.point_light``, the light's arguments the module's. ambient >= 0, W m^-2 sr^-1, reaches
    every point of the medium from all sides, undimmed. A gobo of colour takes one medium for its
    three channels; where sigma differs by channel, call once for each with gobo[..., channel].

    A ray is cut where it enters and leaves the frustum and its soft edge, passes a crease of that edge,
    and at every line of the gobo's pixel centres, all in closed form; pieces in the dark are left
    out, the others take ``order`` and order // 2 evaluations each, in a variable that absorbs
    1 / d^falloff. Rays are worked through in tiles of bounded memory.

    Infinite where the ray meets the light, lit, for falloff 1 and 2; and for falloff 0 and 1 where
    nothing ends the lit part of the ray: without extinction, distance and far infinite.
    """
    intensity, falloff = _intensity(intensity), _falloff(falloff)
    gobo, channels = _gobo(gobo)
    distance = airlight._length("distance", distance)
    ambient = checks.nonnegative("ambient", ambient, "W m^-2 sr^-1", "use a positive radiance")
    lens = _lens(light_direction, up, horizontal_fov, vertical_fov, near, far, blend)
    sigma_s, sigma_t = airlight._coefficients(sigma_s, sigma_t)
    shape, ray, parts = airlight._rays(
        origin, direction, distance, light_position, intensity, sigma_s, sigma_t,
        lambda *way: (sigma_s * ambient, distance, *_line(*way, lens)),
    )  # fmt: skip
    repeats = 1 if gobo is None else gobo.shape[2]
    ray = airlight._Ray(*(np.repeat(x, repeats) for x in ray))
    source, distance, *parts = (np.repeat(x, repeats) for x in parts)
    channel = np.arange(len(source)) % repeats
    light = _Light(_Frustum(*parts), channel, falloff, elliptic, gobo)

    pieces = 8 if gobo is None else 8 + sum(gobo.shape[:2])
    tile = max(1, _TILE // (pieces * airlight._order(order)))
    # One empty tile where there are no rays: arguments are checked all the same.
    sums = []
    for start in range(0, max(len(source), 1), tile):
        here = slice(start, start + tile)
        part = light._replace(frustum=_Frustum(*(x[here] for x in light.frustum)), channel=channel[here])
        sums.append(_integrate(airlight._Ray(*(x[here] for x in ray)), part, phase, order, adaptive, rtol))
    value, error, evaluations = (np.concatenate(x) for x in zip(*sums))

    glow = airlight._times(source, airlight._decay_path(ray.sigma_t, distance))
    error += 16 * _EPSILON * np.where(np.isfinite(glow), glow, 0.0)
    return airlight.Airlight(*(x.reshape(shape + channels)[()] for x in (value + glow, error, evaluations)))


# --- the light's frame ---------------------------------------------------------


class _Lens(NamedTuple):
    """Axes (..., 3) and cosines and sines of half the angles of view."""

    right: np.ndarray
    upward: np.ndarray
    forward: np.ndarray
    horizontal: tuple[np.ndarray, np.ndarray]
    vertical: tuple[np.ndarray, np.ndarray]
    near: np.ndarray
    far: np.ndarray
    blend: np.ndarray


class _Frustum(NamedTuple):
    """Lines (flattened) in homogeneous image coordinates, u = U / W and v = V / W, at the foot and per metre."""

    u0: np.ndarray
    v0: np.ndarray
    w0: np.ndarray
    u1: np.ndarray
    v1: np.ndarray
    w1: np.ndarray
    z0: np.ndarray  # depth along the light's direction, m
    z1: np.ndarray
    near: np.ndarray
    far: np.ndarray
    blend: np.ndarray


class _Light(NamedTuple):
    frustum: _Frustum
    channel: np.ndarray  # of the gobo, for each ray
    falloff: int
    elliptic: bool
    gobo: np.ndarray | None  # (rows, columns, channels)


def _lens(direction, up, horizontal_fov, vertical_fov, near, far, blend):
    forward = checks.unit_vector("direction of the light", direction)
    up = checks.vector("up", up, "direction components")
    size = np.max(np.abs(up), axis=-1, keepdims=True)
    right = np.cross(forward, up / np.where(size > 0, size, 1.0))
    length = airlight._length_of(right)[..., np.newaxis]
    checks.checked(
        "sine of the angle between up and direction, about",
        length,
        lambda x: x > 1e-9,
        "> 1e-9",
        "choose up across the light's direction, such as (0, 0, 1) for a level one",
    )
    right = right / length
    near = checks.nonnegative("near", near, "metres", "0 lights from the light's position on")
    far = checks.nonnegative_or_infinite("far", far, "metres", "infinity for no end")
    checks.checked("far - near", far - near, lambda x: x >= 0, ">= 0 metres", "let far lie behind near")
    return _Lens(
        right,
        np.cross(right, forward),
        forward,
        _half_angle("horizontal_fov", horizontal_fov),
        _half_angle("vertical_fov", vertical_fov),
        near,
        far,
        checks.fraction("blend", blend),
    )


def _half_angle(name, fov):
    fov = checks.checked(
        name, fov, lambda x: (x > 0) & (x < np.pi), "in (0, pi) radians", "give the full angle of view"
    )
    return np.cos(fov / 2), np.sin(fov / 2)


def _homogeneous(vector, lens):
    """(U, V, W) of vectors (..., 3), scaled so that no angle of view makes them overflow."""
    (cos_h, sin_h), (cos_v, sin_v) = lens.horizontal, lens.vertical
    larger = np.maximum(sin_h, sin_v)
    x, y, z = (np.sum(vector * axis, axis=-1) for axis in (lens.right, lens.upward, lens.forward))
    return x * cos_h * (sin_v / larger), y * cos_v * (sin_h / larger), z * np.minimum(sin_h, sin_v)


def _line(direction, to_foot, lens):
    """The members of _Frustum for rays along direction with the light's foot at to_foot."""
    start, step = _homogeneous(to_foot, lens), _homogeneous(direction, lens)
    z0, z1 = (np.sum(vector * lens.forward, axis=-1) for vector in (to_foot, direction))
    return *start, *step, z0, z1, lens.near, lens.far, lens.blend


def _image(across, upward, ahead):
    """u and v, and whether the point lies before the light; the middle where it does not."""
    front = ahead > 0
    with np.errstate(over="ignore"):
        return *(np.where(front, x, 0.0) / np.where(front, ahead, 1.0) for x in (across, upward)), front


def _radius(u, v, elliptic):
    return np.hypot(u, v) if elliptic else np.maximum(np.abs(u), np.abs(v))


def _soft_edge(u, v, blend, elliptic):
    with np.errstate(over="ignore"):
        x = (1 - _radius(u, v, elliptic)) / np.where(blend > 0, blend, 1.0)
    x = np.where(blend > 0, np.clip(x, 0.0, 1.0), 1.0)
    return x * x * (3 - 2 * x)


def _sample(gobo, u, v, channel):
    """The gobo at (u, v), bilinear between the centres of its pixels."""
    rows, columns, _ = gobo.shape
    left, right, along = _neighbours(u, columns)
    above, below, down = _neighbours(-v, rows)
    top = gobo[above, left, channel] * (1 - along) + gobo[above, right, channel] * along
    bottom = gobo[below, left, channel] * (1 - along) + gobo[below, right, channel] * along
    return top * (1 - down) + bottom * down


def _neighbours(u, count):
    """Indices of the pixels before and after u in [-1, 1], and the way from the one to the other."""
    place = np.clip((u + 1) / 2 * count - 0.5, 0.0, count - 1)
    before = place.astype(np.intp)
    return before, np.minimum(before + 1, count - 1), place - before


# --- the ray in the frustum ----------------------------------------------------


def _inside(frustum, scale, elliptic):
    """Interval (low, high), from the foot of the light, with r <= scale and near <= z <= far."""
    u0, v0, w0, u1, v1, w1, z0, z1, near, far, _ = frustum
    bounds = [_half_line(z0 - near, z1, near), _half_line(far - z0, -z1, z0)]
    if elliptic:
        bounds.append(_cone(u0, v0, w0, u1, v1, w1, scale))
    else:
        size0, size1 = np.abs(u0) + np.abs(v0) + np.abs(w0), np.abs(u1) + np.abs(v1) + np.abs(w1)
        for x0, x1 in ((u0, u1), (-u0, -u1), (v0, v1), (-v0, -v1)):
            bounds.append(_half_line(scale * w0 - x0, scale * w1 - x1, size0, size1))
    lows, highs = zip(*bounds)
    return np.maximum.reduce(lows), np.minimum.reduce(highs)


def _half_line(n0, n1, size0, size1=1.0):
    """Where n0 + n1 a >= 0, for terms whose parts are of the given sizes."""
    n1 = np.where(np.abs(n1) <= _PARALLEL_ROUNDINGS * _EPSILON * size1, 0.0, n1)
    with np.errstate(over="ignore"):
        crossing = -n0 / np.where(n1 == 0, 1.0, n1)
    outside = (n1 == 0) & (n0 < -_PARALLEL_ROUNDINGS * _EPSILON * size0)
    low = np.where(n1 > 0, crossing, np.where(outside, np.inf, -np.inf))
    return low, np.where(n1 < 0, crossing, np.where(outside, -np.inf, np.inf))


def _cone(u0, v0, w0, u1, v1, w1, scale):
    """Where u^2 + v^2 <= (scale w)^2 and w >= 0, the quadratic q2 a^2 + 2 q1 a + q0 <= 0.

    Its discriminant is a sum of three squared determinants: it does not cancel close to the apex.
    """
    size = np.maximum(np.maximum(np.abs(u0), np.abs(v0)), np.abs(w0))
    size = np.where(size > 0, size, 1.0)
    u0, v0, w0 = u0 / size, v0 / size, w0 / size
    c0, c1 = scale * w0, scale * w1
    slack = _PARALLEL_ROUNDINGS * _EPSILON
    along = np.hypot(u1, v1)
    q2 = (along - np.abs(c1)) * (along + np.abs(c1))
    q2 = np.where(np.abs(q2) <= slack * c1 * c1, 0.0, q2)
    q1 = u0 * u1 + v0 * v1 - c0 * c1
    q1 = np.where(np.abs(q1) <= slack * (np.abs(u0 * u1) + np.abs(v0 * v1) + np.abs(c0 * c1)), 0.0, q1)
    q0 = u0 * u0 + v0 * v0 - c0 * c0
    squares = (u0 * c1 - u1 * c0) ** 2, (v0 * c1 - v1 * c0) ** 2, (u0 * v1 - u1 * v0) ** 2
    discriminant = squares[0] + squares[1] - squares[2]
    touches = discriminant >= -slack * (squares[0] + squares[1] + squares[2])

    q = -(q1 + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), q1))
    with np.errstate(over="ignore"):
        one = q / np.where(q2 == 0, 1.0, q2)
        # Parallel to the cone there is only this one.
        other = q0 / np.where(q == 0, 1.0, q)
        apex = -w0 / np.where(w1 == 0, 1.0, w1)
        one, other, apex = one * size, other * size, apex * size
    first, last = np.minimum(one, other), np.maximum(one, other)

    # Along the cone: from one end on, forwards or backwards.
    end = np.where(q2 < 0, np.where(w1 > 0, last, first), np.where(q1 == 0, apex, other))
    low, high = np.where(w1 > 0, end, -np.inf), np.where(w1 > 0, np.inf, end)
    across = q2 > 0
    behind = np.where(across, w0 * q2 < w1 * q1, w1 * q1 > 0)
    outside = np.where(across, ~touches | behind, (q2 == 0) & (behind | ((q1 == 0) & (q0 > slack))))
    low, high = np.where(across, first, low), np.where(across, last, high)
    return np.where(outside, np.inf, low), np.where(outside, -np.inf, high)


def _creases(light, low, high):
    """Positions (rays, n), unsorted, where the integrand is not smooth between low and high."""
    frustum, gobo = light.frustum, light.gobo
    u0, v0, w0, u1, v1, w1 = frustum[:6]
    lines = []
    if np.any(frustum.blend > 0):
        full = _inside(frustum, 1 - frustum.blend, light.elliptic)
        lines += [np.where(full[0] <= full[1], x, low) for x in full]
        if light.elliptic:
            # Closest to the middle of the image: the soft edge has a crease there if the ray passes close by.
            lines.append(_crossing(w0 * (u0 * u1 + v0 * v1) - w1 * (u0 * u0 + v0 * v0),
                                   w0 * (u1 * u1 + v1 * v1) - w1 * (u0 * u1 + v0 * v1)))
        else:
            lines += [_crossing(u0 - v0, u1 - v1), _crossing(u0 + v0, u1 + v1)]
    if light.falloff < 2:
        # The light changes side here, within the distance of the light from the ray.
        lines.append(np.zeros_like(low))
    breaks = [np.stack([low, high, *lines], axis=-1)]
    if gobo is not None:
        for count, x0, x1 in ((gobo.shape[1], u0, u1), (gobo.shape[0], v0, v1)):
            centres = (2 * np.arange(count) + 1) / count - 1
            start, step, w_start, w_step = (x[:, np.newaxis] for x in (x0, x1, w0, w1))
            breaks.append(_crossing(start - centres * w_start, step - centres * w_step))
    return np.concatenate(breaks, axis=-1)


def _crossing(start, step):
    """Where start + step a = 0; infinite or 0 if nowhere."""
    with np.errstate(over="ignore"):
        return -start / np.where(step == 0, 1.0, step)


# --- quadrature ----------------------------------------------------------------


def _integrate(ray, light, phase, order, adaptive, rtol):
    """Flat value, error and evaluations of the light's part."""
    low, high = _inside(light.frustum, 1.0, light.elliptic)
    low = np.maximum(low, ray.near)
    high = np.maximum(np.minimum(high, ray.far), low)
    missed = ~(low < high)
    low, high = np.where(missed, 0.0, low), np.where(missed, 0.0, high)

    def emission(a, d, index):
        u0, v0, w0, u1, v1, w1 = (x[index] for x in light.frustum[:6])
        u, v, _ = _image(u0 + a * u1, v0 + a * v1, w0 + a * w1)
        u, v = np.clip(u, -1.0, 1.0), np.clip(v, -1.0, 1.0)
        value = _soft_edge(u, v, light.frustum.blend[index], light.elliptic)
        return value if light.gobo is None else value * _sample(light.gobo, u, v, light.channel[index])

    infinite = touching = np.zeros(low.shape, dtype=bool)
    if light.falloff > 0:
        one, index = np.ones_like(low), np.arange(len(low))
        at_light = (low <= airlight._ON_THE_LINE) & (high >= -airlight._ON_THE_LINE)
        touching = (ray.height == 0) & (ray.strength > 0) & at_light
        for side, from_light, to_light in ((one, high, low), (-one, -low, -high)):
            reaches = touching & (to_light <= airlight._ON_THE_LINE) & (from_light > airlight._ON_THE_LINE)
            seen = emission(side, one, index) * airlight._phase_value(phase, -side)
            infinite = infinite | (reaches & (seen > 0))

    breaks = np.sort(np.clip(_creases(light, low, high), low[:, np.newaxis], high[:, np.newaxis]), axis=-1)
    measure = _MEASURES[light.falloff]
    # On a piece the image is quadratic in its place between the ends: dark at three points, it is dark.
    height, index = ray.height[:, np.newaxis], np.arange(len(low))[:, np.newaxis]
    start, end = np.minimum(breaks[:, :-1], _FAR), np.where(breaks[:, 1:] > _FAR, np.inf, breaks[:, 1:])
    middle = airlight._middle(start, end, height)
    lit = sum(emission(np.minimum(a, _FAR), None, index) for a in (start, middle, end)) > 0
    # From the light on the image does not change: what touches it is infinite there, or dark.
    wanted = lit & (~touching & (ray.strength > 0))[:, np.newaxis]
    wanted &= airlight._times(ray.sigma_t[:, np.newaxis], np.maximum(breaks[:, :-1], 0.0)) <= _BLACK_DEPTH
    panels = airlight._panels(ray, breaks, wanted)
    if light.falloff < 2:
        index, _, end = panels
        infinite[index[np.isinf(end)]] = True
        panels = [x[~infinite[index]] for x in panels]
    value, error, evaluations = airlight._sum_panels(ray, panels, measure, emission, phase, order, adaptive, rtol)
    return np.where(infinite, np.inf, value), error, evaluations


def _even_positions(offset, middle, low, high, height):
    return np.clip(middle[:, np.newaxis] + offset, low[:, np.newaxis], high[:, np.newaxis])


def _log_width(low, high, height):
    """Integral of da / d over [low, high], asinh(high / height) - asinh(low / height)."""
    mirrored = low < -high
    low, high = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    d_low, d_high = np.hypot(low, height), np.hypot(high, height)
    both = d_low + d_high
    slope = (low + high) / np.where(both > 0, both, 1.0)
    base = airlight._tangent(low, height)
    with np.errstate(over="ignore"):
        return np.log1p((high - low) * (1 + slope) / np.where(base > 0, base, 1.0))


def _log_middle(low, high, height):
    ahead, behind = (
        np.sqrt(airlight._tangent(s * low, height)) * np.sqrt(airlight._tangent(s * high, height)) for s in (1, -1)
    )
    return (ahead - behind) / 2


def _log_positions(offset, middle, low, high, height):
    ahead, behind = (airlight._tangent(s * middle, height)[:, np.newaxis] for s in (1, -1))
    with np.errstate(over="ignore"):
        growth = np.exp(offset)
        a = (airlight._times(ahead, growth) - behind / growth) / 2
    return np.clip(a, low[:, np.newaxis], high[:, np.newaxis])


# What absorbs 1 / d^falloff: the way, its logarithm, the angle seen from the light.
_MEASURES = (
    airlight._Measure(lambda low, high, _: high - low, lambda low, high, _: low + (high - low) / 2, _even_positions),
    airlight._Measure(_log_width, _log_middle, _log_positions),
    airlight._EQUIANGULAR,
)


# --- arguments -------------------------------------------------------------------


def _intensity(intensity):
    return checks.nonnegative("intensity", intensity, "W m^(falloff - 2)", "use a positive intensity")


def _falloff(falloff):
    if falloff not in (0, 1, 2):
        raise ValueError(f"falloff must be 0, 1 or 2, got {falloff!r}; 2 is that of a point")
    return int(falloff)


def _gobo(gobo):
    """Image (rows, columns, channels), and the axis (3,) that it adds to results; None and () without."""
    if gobo is None:
        return None, ()
    gobo = checks.nonnegative("gobo", gobo, "(share of the light)", "use a linear image")
    if gobo.size == 0 or not (gobo.ndim == 2 or gobo.shape[2:] == (3,)):
        raise ValueError(
            f"gobo must have shape (rows, columns) or (rows, columns, 3), got {gobo.shape}; drop an alpha channel"
        )
    return gobo.reshape(*gobo.shape[:2], -1), gobo.shape[2:]
