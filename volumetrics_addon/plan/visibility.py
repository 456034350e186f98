# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera can see and a lamp can shade, by convex hulls of few points. Standard library only; never wrong, at times too careful.

A set of points stands for its convex hull.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

from ..scene.model import Vector, add, cross, scaled, subtract
from .observed import View

TURNS = 64  # of the search for a separating plane
FAR = 1e3  # how many sizes of the scene a sun is away


def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def corners(low: Vector, high: Vector) -> tuple[Vector, ...]:
    """The eight corners of a box along the axes."""
    return tuple(product(*zip(low, high)))


def bounds(points: Sequence[Vector]) -> tuple[Vector, Vector]:
    columns = tuple(zip(*points))
    return tuple(map(min, columns)), tuple(map(max, columns))


def diagonal(points: Sequence[Vector]) -> float:
    """Longest straight way through the bounding box of the points."""
    return math.dist(*bounds(points))


def distance(a: Sequence[Vector], b: Sequence[Vector], enough: float = math.inf) -> float:
    """A lower bound of the distance between two hulls, as soon as it is above ``enough``; 0 where they may touch.

    At least that of their bounding boxes; and the search for the vector of least length of their difference (Frank and Wolfe 1956;
    Gilbert 1966): where every difference of points has a part along v of at least h > 0, a slab of that thickness lies between them.
    """
    (low_a, high_a), (low_b, high_b) = bounds(a), bounds(b)
    largest = math.hypot(*(max(l - k, m - h, 0.0) for l, h, m, k in zip(low_a, high_a, low_b, high_b)))
    v = subtract(a[0], b[0])
    for _ in range(TURNS):
        length = math.hypot(*v)
        if length == 0.0 or largest > enough:
            return largest
        x, y, z = v
        nearest = subtract(min(a, key=lambda p: p[0] * x + p[1] * y + p[2] * z), max(b, key=lambda p: p[0] * x + p[1] * y + p[2] * z))
        height = dot(nearest, v) / length
        largest = max(largest, height)
        if height >= length * (1.0 - 1e-6):
            return largest
        toward = subtract(nearest, v)
        share = min(1.0, max(0.0, -dot(v, toward) / dot(toward, toward)))
        v = add(v, scaled(toward, share))
    return largest


def apart(a: Sequence[Vector], b: Sequence[Vector]) -> bool:
    """Whether a plane surely lies between two hulls."""
    return distance(a, b, 0.0) > 0.0


def box_distance(a: Sequence[Vector], point: Vector) -> tuple[float, float]:
    """Least and largest distance of a point from the bounding box of the points."""
    low, high = bounds(a)
    least = math.hypot(*(max(l - p, 0.0, p - h) for p, l, h in zip(point, low, high)))
    return least, math.hypot(*(max(abs(p - l), abs(p - h)) for p, l, h in zip(point, low, high)))


def pyramid(view: View, near: float, far: float) -> tuple[Vector, ...]:
    """The corners of what the camera sees between two depths."""
    return tuple(view.point(x, y, depth) for depth in ((near, far) if near > 0.0 else (far,))
                 for x in (view.low[0], view.high[0]) for y in (view.low[1], view.high[1])
                 ) + (() if near > 0.0 else (view.position,))


def depths(view: View, points: Sequence[Vector]) -> tuple[float, float]:
    """Least and largest depth of the points along the camera's axis."""
    along = [-dot(subtract(point, view.position), view.back) for point in points]
    return min(along), max(along)


def in_frame(view: View, points: Sequence[Vector], far: float = math.inf) -> bool:
    """Whether some of the hull may be in the picture, nearer than the depth ``far``."""
    local = [tuple(dot(subtract(point, view.position), axis) for axis in (view.right, view.up, view.back)) for point in points]
    sides = [*(lambda p, k=k: p[k] + view.high[k] * p[2] for k in (0, 1)), *(lambda p, k=k: -p[k] - view.low[k] * p[2] for k in (0, 1)),
             lambda p: p[2], lambda p: -p[2] - min(far, view.clip_end)]
    return not any(all(side(p) > 0.0 for p in local) for side in sides)


def filled_depth(view: View, face: Sequence[Vector]) -> float:
    """The largest depth at which a flat convex face fills the picture; infinite where it does not."""
    normal = max((cross(subtract(face[i], face[0]), subtract(face[i + 1], face[0])) for i in range(1, len(face) - 1)),
                 key=lambda n: dot(n, n))
    result = 0.0
    for x, y in product((view.low[0], view.high[0]), (view.low[1], view.high[1])):
        ray = subtract(view.point(x, y, 1.0), view.position)
        slope = dot(ray, normal)
        depth = dot(subtract(face[0], view.position), normal) / slope if slope else 0.0
        if depth <= 0.0:
            return math.inf
        hit = add(view.position, scaled(ray, depth))
        if any(dot(cross(subtract(b, a), subtract(hit, a)), normal) < 0.0 for a, b in zip(face, (*face[1:], face[0]))):
            return math.inf
        result = max(result, depth)
    return result


def cut(view: View, points: Sequence[Vector], far: float) -> tuple[Sequence[Vector], ...]:
    """Hulls that each hold the part of the points' hull that is in the picture: their own, and the view between their depths."""
    low, high = depths(view, points)
    return points, pyramid(view, max(low, 0.0), min(high, far, view.clip_end))


def solid_angle_share(points: Sequence[Vector], away: float) -> float:
    """Bound on the share of the sphere that the points' bounding sphere covers from anywhere so far ``away`` from their hull."""
    radius = 0.5 * diagonal(points)
    if away <= radius:
        return 0.5
    return 0.5 * (1.0 - math.sqrt(1.0 - (radius / away) ** 2))  # the sphere's middle is in the hull, and no nearer
