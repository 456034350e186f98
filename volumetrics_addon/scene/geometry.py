# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against the Scene's convex shapes, in float64 NumPy.

Rays are ``origin + t direction`` with unit directions, arrays of shape (n, 3).
"""

from __future__ import annotations

import numpy as np

from .model import Box, Camera, Cone, Ellipsoid, Hull, Shape, Surface, look_frame, scaled

Array = np.ndarray


def camera_rays(camera: Camera, width: int, height: int, x: Array, y: Array) -> tuple[Array, Array]:
    """Origins and unit directions through raster positions; x in [0, width] from the left, y in [0, height] from the top."""
    right, up, back = look_frame(camera.direction)
    pixel = 2.0 * np.tan(camera.field_of_view / 2.0) / width
    offset_x, offset_y = (x - width / 2.0) * pixel, (height / 2.0 - y) * pixel
    inverse = 1.0 / np.sqrt(offset_x * offset_x + offset_y * offset_y + 1.0)
    offset_x *= inverse
    offset_y *= inverse
    direction = np.empty((len(x), 3))
    for k in range(3):
        direction[:, k] = offset_x * right[k] + offset_y * up[k] - inverse * back[k]
    return np.broadcast_to(np.array(camera.position), direction.shape), direction


def view_axes(camera: Camera) -> Array:
    """Rows: right, up and forward of the camera."""
    right, up, back = look_frame(camera.direction)
    return np.array((right, up, scaled(back, -1.0)))


def raster(camera: Camera, width: int, height: int, direction: Array) -> tuple[Array, Array]:
    """Raster positions x, y (n,) of directions (n, 3) in front of the camera: the inverse of ``camera_rays``."""
    x, y, z = view_axes(camera) @ direction.T
    pixel = 2.0 * np.tan(camera.field_of_view / 2.0) / width
    return width / 2.0 + x / z / pixel, height / 2.0 - y / z / pixel


def _local(shape: Box | Ellipsoid, origin: Array, direction: Array) -> tuple[Array, Array]:
    axes = np.array(shape.axes)
    return (origin - np.array(shape.center)) @ axes.T, direction @ axes.T


def interval(shape: Shape, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Entry and exit (n,) of the whole line through a convex shape; entry > exit where the line misses it."""
    match shape:
        case Box():
            return _box_interval(shape, origin, direction)
        case Ellipsoid():
            p, d = _local(shape, origin, direction)
            half = np.array(shape.half)
            return _sphere_interval(p / half, d / half)
        case Cone():
            return _cone_interval(shape, origin, direction)
        case Hull():
            near, far = np.full(len(direction), -np.inf), np.full(len(direction), np.inf)
            for point, outward in shape.planes:
                low, high = half_line((np.array(point) - origin) @ np.array(outward), direction @ -np.array(outward))
                near, far = np.maximum(near, low), np.minimum(far, high)
            return near, far
    raise TypeError(f"{shape!r} is not a shape of the Scene")


def _box_interval(box: Box, origin: Array, direction: Array) -> tuple[Array, Array]:
    p, d = _local(box, origin, direction)
    half = np.array(box.half)
    parallel = d == 0.0
    safe = np.where(parallel, 1.0, d)
    t0, t1 = (-half - p) / safe, (half - p) / safe
    inside = np.abs(p) <= half
    near = np.where(parallel, np.where(inside, -np.inf, np.inf), np.minimum(t0, t1))
    far = np.where(parallel, np.where(inside, np.inf, -np.inf), np.maximum(t0, t1))
    return near.max(axis=-1), far.min(axis=-1)


def _sphere_interval(p: Array, d: Array) -> tuple[Array, Array]:
    """Unit sphere. The closest approach is found first, so that distant small spheres keep their digits."""
    dd = np.einsum("...i,...i", d, d)
    middle = -np.einsum("...i,...i", p, d) / dd
    closest = p + middle[..., None] * d
    discriminant = (1.0 - np.einsum("...i,...i", closest, closest)) / dd
    root = np.sqrt(np.maximum(discriminant, 0.0))
    hit = discriminant >= 0.0
    return np.where(hit, middle - root, np.inf), np.where(hit, middle + root, -np.inf)


def _cone_interval(cone: Cone, origin: Array, direction: Array) -> tuple[Array, Array]:
    """One nappe of the cone (a convex set), clipped by the plane of its flat end."""
    axis, cos2 = np.array(cone.axis), np.cos(cone.half_angle) ** 2
    near, far = nappe_interval(origin - np.array(cone.apex), direction, axis, cos2)
    height, slope = (origin - np.array(cone.apex)) @ axis, direction @ axis
    low, high = half_line(cone.length - height, -slope)
    return np.maximum(near, low), np.minimum(far, high)


def nappe_interval(p: Array, d: Array, axis: Array, cos2: float) -> tuple[Array, Array]:
    """The part of each line inside the infinite cone {x : x . axis >= |x| cos}, apex at the origin.

    ``axis`` is (3,) or (n, 3), ``cos2`` the squared cosine of the half angle (below a right angle). Empty where entry > exit.
    """
    axis = np.broadcast_to(axis, p.shape)
    pa, da = np.einsum("ni,ni->n", p, axis), np.einsum("ni,ni->n", d, axis)
    # f(t) = (x . axis)^2 - cos2 |x|^2 >= 0 inside either nappe
    a = da * da - cos2 * np.einsum("ni,ni->n", d, d)
    b = pa * da - cos2 * np.einsum("ni,ni->n", p, d)
    c = pa * pa - cos2 * np.einsum("ni,ni->n", p, p)
    discriminant = b * b - a * c
    root = np.sqrt(np.maximum(discriminant, 0.0))
    q = -(b + np.where(b >= 0.0, root, -root))
    with np.errstate(divide="ignore", invalid="ignore"):
        r0, r1 = q / a, c / q
    r0, r1 = np.where(np.isfinite(r0), r0, np.inf), np.where(np.isfinite(r1), r1, np.inf)
    low, high = np.minimum(r0, r1), np.maximum(r0, r1)
    # a < 0: between the roots; a > 0: beyond one of them. The nappe is where x . axis > 0.
    between = (a < 0.0) & (discriminant > 0.0)
    middle_positive = np.where(between, pa + np.where(between, (low + high) / 2, 0.0) * da > 0.0, False)
    near = np.where(middle_positive, low, np.inf)
    far = np.where(middle_positive, high, -np.inf)
    beyond = a >= 0.0
    forward = beyond & (da > 0.0)
    backward = beyond & (da < 0.0)
    # With a > 0 the line meets both nappes (or the one twice removed): the forward part starts at the larger root.
    with np.errstate(invalid="ignore"):
        apex_side = np.where(da != 0.0, -pa / np.where(da == 0.0, 1.0, da), 0.0)
    single = discriminant <= 0.0
    near = np.where(forward, np.where(single, apex_side, high), np.where(backward, -np.inf, near))
    far = np.where(forward, np.inf, np.where(backward, np.where(single, apex_side, low), far))
    return near, far


def lowest(shape: Shape) -> float:
    """Smallest z of a shape."""
    match shape:
        case Box():
            return min(corner[2] for corner in shape.corners)
        case Ellipsoid():
            return shape.center[2] - float(np.hypot.reduce([h * axis[2] for h, axis in zip(shape.half, shape.axes)]))
        case Cone():
            radius = shape.length * np.tan(shape.half_angle)
            rim = shape.apex[2] + shape.length * shape.axis[2] - radius * np.sqrt(max(0.0, 1.0 - shape.axis[2] ** 2))
            return float(min(shape.apex[2], rim))
        case Hull():
            return min(corner[2] for corner in shape.corners)
    raise TypeError(f"{shape!r} is not a shape of the Scene")


def half_line(value: Array, slope: Array) -> tuple[Array, Array]:
    """The t with value + slope t >= 0, as an interval."""
    safe = np.where(slope == 0.0, 1.0, slope)
    root = -value / safe
    low = np.where(slope > 0.0, root, np.where((slope == 0.0) & (value < 0.0), np.inf, -np.inf))
    high = np.where(slope < 0.0, root, np.where((slope == 0.0) & (value < 0.0), -np.inf, np.inf))
    return low, high


def normal(shape: Box | Ellipsoid, position: Array) -> Array:
    """Outward unit normal (n, 3) at positions on the shape."""
    axes, half = np.array(shape.axes), np.array(shape.half)
    p = (position - np.array(shape.center)) @ axes.T
    if isinstance(shape, Ellipsoid):
        local = p / half**2
    else:
        # The face is the one whose plane the position is nearest to, measured in metres.
        face = np.argmin(np.abs(np.abs(p) - half), axis=-1)
        local = np.zeros_like(p)
        rows = np.arange(len(p))
        local[rows, face] = np.where(p[rows, face] >= 0.0, 1.0, -1.0)
    outward = local @ axes
    return outward / np.linalg.norm(outward, axis=-1, keepdims=True)


def first_hit(surfaces: tuple[Surface, ...], origin: Array, direction: Array, epsilon: float) -> tuple[Array, Array]:
    """Distance to the nearest surface (inf: none) and its index (-1: none), beyond ``epsilon``."""
    distance = np.full(len(direction), np.inf)
    index = np.full(len(direction), -1)
    for i, surface in enumerate(surfaces):
        near, far = interval(surface.shape, origin, direction)
        t = np.where(near > epsilon, near, far)
        closer = (near <= far) & (t > epsilon) & (t < distance)
        distance[closer], index[closer] = t[closer], i
    return distance, index


def visible(surfaces: tuple[Surface, ...], origin: Array, direction: Array, distance: Array | float, epsilon: float) -> Array:
    """Whether nothing opaque lies within (epsilon, distance - epsilon)."""
    clear = np.ones(len(direction), bool)
    for surface in surfaces:
        near, far = interval(surface.shape, origin, direction)
        t = np.where(near > epsilon, near, far)
        clear &= ~((near <= far) & (t > epsilon) & (t < distance - epsilon))
    return clear


def shadow_interval(surface: Surface, origin: Array, direction: Array, light: Array, parallel: bool) -> tuple[Array, Array]:
    """The part of each line that a convex body puts in shadow, as an interval (empty where entry > exit).

    ``light`` is the position of a point light, or the direction of travel of parallel light. The shadow of a convex
    body is convex, so a line meets it in one interval; it is found, not sampled.
    """
    if isinstance(surface.shape, Box):
        return _box_shadow(surface.shape, origin, direction, light, parallel)
    return _ellipsoid_shadow(surface.shape, origin, direction, light, parallel)


def _box_shadow(box: Box, origin: Array, direction: Array, light: Array, parallel: bool) -> tuple[Array, Array]:
    """Union of the shadows of the faces towards the light: each is bounded by the face and by the planes through the light
    and an edge of it."""
    center, axes, half = np.array(box.center), np.array(box.axes), np.array(box.half)
    if not parallel and (np.abs(axes @ (light - center)) < half).all():
        return np.full(len(direction), -np.inf), np.full(len(direction), np.inf)  # the light is inside the body
    near = np.full(len(direction), np.inf)
    far = np.full(len(direction), -np.inf)
    for k in range(3):
        if half[(k + 1) % 3] == 0.0 or half[(k + 2) % 3] == 0.0:
            continue  # the edge of a plane
        u, v = axes[(k + 1) % 3] * half[(k + 1) % 3], axes[(k + 2) % 3] * half[(k + 2) % 3]
        for sign in (1.0, -1.0)[: 1 if half[k] == 0.0 else 2]:
            middle = center + sign * half[k] * axes[k]
            away = light if parallel else middle - light
            toward = float(away @ axes[k])
            if abs(toward) <= 1e-12 * np.linalg.norm(away):
                continue  # edge-on to the light: no shadow of its own
            if half[k] > 0.0 and toward * sign > 0.0:
                continue  # turned away from the light: in the shadow of the others
            low, high = half_line((origin - middle) @ axes[k] * np.sign(toward), direction @ axes[k] * np.sign(toward))
            corners = (middle + u + v, middle - u + v, middle - u - v, middle + u - v)
            for first, second in zip(corners, corners[1:] + corners[:1]):
                plane = np.cross(light if parallel else first - light, second - first)
                inside = np.sign(plane @ (middle - first))
                l, h = half_line((origin - first) @ plane * inside, direction @ plane * inside)
                low, high = np.maximum(low, l), np.minimum(high, h)
            lit = low < high
            near = np.where(lit, np.minimum(near, low), near)
            far = np.where(lit, np.maximum(far, high), far)
    return near, far


def _ellipsoid_shadow(shape: Ellipsoid, origin: Array, direction: Array, light: Array, parallel: bool) -> tuple[Array, Array]:
    """In the space where the ellipsoid is the unit sphere: tangent cylinder or cone beyond the terminator, and the body."""
    p, d = _local(shape, origin, direction)
    half, axes = np.array(shape.half), np.array(shape.axes)
    p, d = p / half, d / half
    near, far = _sphere_interval(p, d)
    if parallel:
        travel = (axes @ light) / half
        travel /= np.linalg.norm(travel)
        flat_p, flat_d = p - np.outer(p @ travel, travel), d - np.outer(d @ travel, travel)
        dd = np.einsum("ni,ni->n", flat_d, flat_d)
        along = dd < 1e-300
        side = _sphere_interval(flat_p, np.where(along[:, None], travel, flat_d))
        inside = np.einsum("ni,ni->n", flat_p, flat_p) < 1.0
        side = tuple(np.where(along, np.where(inside, limit, -limit), value)
                     for value, limit in zip(side, (-np.inf, np.inf)))
        beyond = half_line(p @ travel, d @ travel)  # the terminator's plane passes through the centre
    else:
        source = (axes @ (light - np.array(shape.center))) / half
        reach = float(source @ source)
        if reach <= 1.0:
            return np.full(len(d), -np.inf), np.full(len(d), np.inf)  # the light is inside the body
        travel = -source / np.sqrt(reach)
        side = nappe_interval(p - source, d, travel, 1.0 - 1.0 / reach)
        beyond = half_line(p @ travel + 1.0 / np.sqrt(reach), d @ travel)
    low, high = np.maximum(side[0], beyond[0]), np.minimum(side[1], beyond[1])
    shaded = low < high
    body = near < far
    return (np.minimum(np.where(shaded, low, np.inf), np.where(body, near, np.inf)),
            np.maximum(np.where(shaded, high, -np.inf), np.where(body, far, -np.inf)))


def crossed(shape: Shape, origin: Array, direction: Array, hit: Array) -> tuple[Array, Array, Array]:
    """Entry and exit (n,) of rays into a convex shape before they end at ``hit`` (n,), and the rows (m,) of those that cross it."""
    near, far = interval(shape, origin, direction)
    near, far = np.maximum(near, 0.0), np.minimum(far, hit)
    return near, far, np.flatnonzero(near < far)


def contains(shape: Shape, position: Array) -> Array:
    """Whether positions (n, 3) lie in the shape."""
    match shape:
        case Box():
            return (np.abs((position - np.array(shape.center)) @ np.array(shape.axes).T) <= np.array(shape.half)).all(axis=1)
        case Ellipsoid():
            local = (position - np.array(shape.center)) @ np.array(shape.axes).T / np.array(shape.half)
            return np.einsum("ni,ni->n", local, local) <= 1.0
        case Cone():
            offset = position - np.array(shape.apex)
            height = offset @ np.array(shape.axis)
            return (height >= np.linalg.norm(offset, axis=1) * np.cos(shape.half_angle)) & (height <= shape.length)
        case Hull():
            return np.all([(position - np.array(point)) @ np.array(outward) <= 0.0 for point, outward in shape.planes], axis=0)
    raise TypeError(f"{shape!r} is not a shape of the Scene")
