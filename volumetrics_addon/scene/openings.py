# SPDX-License-Identifier: GPL-3.0-or-later
"""Sunlight through openings: convex polygons, and the prisms that the light fills behind them.

A polygon is a tuple of corners in order. Standard library only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from .model import Hull, Vector, add, cross, normalized, scaled, subtract, swept

FLAT = 1e-4  # sine of the angle within which planes and edges count as parallel
GRAZING = 0.02  # sine of the angle between sun and opening below which no shaft is made: 1.1 degrees
BEGIN = 1e-3  # share of its length after which a shaft begins: a pane may stand in the opening
BELOW = 0.01  # share of its height by which a shaft reaches below the floor: faces that coincide are ambiguous
APART = 0.995  # of their size, about their middle: parts of one opening, which do not touch then


def dot(a: Vector, b: Vector) -> float:
    return sum(x * y for x, y in zip(a, b))


def middle(polygon: Sequence[Vector]) -> Vector:
    return scaled(tuple(map(sum, zip(*polygon))), 1.0 / len(polygon))


def area(polygon: Sequence[Vector]) -> Vector:
    """Newell's sum: the polygon's normal, as long as its area."""
    total = (0.0, 0.0, 0.0)
    for a, b in zip(polygon, (*polygon[1:], polygon[0])):
        total = add(total, cross(subtract(a, polygon[0]), subtract(b, polygon[0])))
    return scaled(total, 0.5)


def is_convex(polygon: Sequence[Vector]) -> bool:
    """Whether a flat polygon turns one way all around, and once; corners may lie on a straight side."""
    normal = area(polygon)
    if len(polygon) < 3 or math.hypot(*normal) == 0.0:
        return False
    normal, turned = normalized(normal), 0.0
    sides = [subtract(b, a) for a, b in zip(polygon, (*polygon[1:], polygon[0]))]
    for first, second in zip(sides, (*sides[1:], sides[0])):
        sine, cosine = dot(cross(first, second), normal), dot(first, second)
        if sine < -FLAT * math.hypot(*first) * math.hypot(*second):
            return False
        turned += math.atan2(sine, cosine)
    return abs(turned - 2.0 * math.pi) < 1.0


def convex_parts(polygons: Sequence[tuple[int, ...]], points: Sequence[Vector], direction: Vector) -> list[tuple[Vector, ...]]:
    """Convex polygons that cover the given ones, with neighbours in one plane joined where they make a convex one.

    ``polygons`` are convex, as indices of ``points``; all become counterclockwise seen by one who looks against ``direction``.
    Parts that still share a side are drawn in a little, so that they stay apart.
    """
    loops = [tuple(p) if dot(area([points[i] for i in p]), direction) > 0.0 else tuple(reversed(p)) for p in polygons]
    loops = [loop for group in _planes(loops, points) for loop in _convex(group, points)]
    sides = {side for loop in loops for side in _sides(loop)}
    parts = []
    for loop in loops:
        part = _straightened([points[i] for i in loop])
        if any((b, a) in sides for a, b in _sides(loop)):
            center = middle(part)
            part = tuple(add(center, scaled(subtract(corner, center), APART)) for corner in part)
        parts.append(part)
    return parts


def _planes(loops: list[tuple[int, ...]], points: Sequence[Vector]) -> list[list[tuple[int, ...]]]:
    """The loops in groups, each of neighbours that lie in one plane."""
    owner = {side: k for k, loop in enumerate(loops) for side in _sides(loop)}
    left, groups = dict.fromkeys(range(len(loops))), []
    while left:
        group = [next(iter(left))]
        del left[group[0]]
        for k in group:  # grows meanwhile
            for a, b in _sides(loops[k]):
                other = owner.get((b, a))
                union = _union(loops[k], loops[other], a, b) if other in left else ()
                if union and is_flat([points[i] for i in union]):
                    del left[other]
                    group.append(other)
        groups.append([loops[k] for k in group])
    return groups


def _convex(loops: list[tuple[int, ...]], points: Sequence[Vector]) -> list[tuple[int, ...]]:
    """Convex loops that cover the given ones of one plane: the outline of all, where it is one, else pairs as they come."""
    if _fits(outline := _outline(loops), points):
        return [outline]
    loops, joined = list(loops), True
    while joined:
        joined = False
        owner = {side: k for k, loop in enumerate(loops) if loop for side in _sides(loop)}
        for k in range(len(loops)):
            for a, b in _sides(loops[k]):
                other = owner.get((b, a))
                if other is None or other == k or not loops[other] or (a, b) not in _sides(loops[k]):
                    continue
                if _fits(union := _union(loops[k], loops[other], a, b), points):
                    loops[k], loops[other], joined = union, (), True
                    owner.update({side: k for side in _sides(union)})
    return [loop for loop in loops if loop]


def _fits(loop: tuple[int, ...], points: Sequence[Vector]) -> bool:
    corners = [points[i] for i in loop]
    return bool(loop) and is_flat(corners) and is_convex(corners)


def _outline(loops: list[tuple[int, ...]]) -> tuple[int, ...]:
    """The loop around all; empty where there are several, or sides that more than two share."""
    sides = [side for loop in loops for side in _sides(loop)]
    have = set(sides)
    rim = [(a, b) for a, b in sides if (b, a) not in have]
    after = dict(rim)
    if len(have) < len(sides) or len(after) < len(rim) or not rim:
        return ()
    loop = [rim[0][0]]
    while (corner := after[loop[-1]]) != loop[0]:
        loop.append(corner)
    return tuple(loop) if len(loop) == len(rim) else ()


def _sides(loop: tuple[int, ...]) -> list[tuple[int, int]]:
    return list(zip(loop, (*loop[1:], *loop[:1])))


def _union(first: tuple[int, ...], second: tuple[int, ...], a: int, b: int) -> tuple[int, ...]:
    """The loop around both, which share the side from a to b; empty where they do not make one simple loop."""
    i, j = first.index(b), second.index(a)
    # From b around the first to a, then from a around the second to b.
    loop = [*first[i:], *first[:i], *(second[j:] + second[:j])[1:-1]]
    k = 0
    while k < len(loop) and len(loop) > 2:  # further sides that both share are spikes: there and back
        if loop[k - 1] == loop[(k + 1) % len(loop)]:
            for index in sorted((k, (k + 1) % len(loop)), reverse=True):
                del loop[index]
            k = 0
        else:
            k += 1
    return tuple(loop) if len(loop) > 2 and len(set(loop)) == len(loop) else ()


def is_flat(polygon: Sequence[Vector]) -> bool:
    """Whether all corners lie in one plane."""
    total = area(polygon)
    if math.hypot(*total) == 0.0:
        return False
    normal, size = normalized(total), max(math.dist(polygon[0], corner) for corner in polygon)
    return all(abs(dot(subtract(corner, polygon[0]), normal)) <= FLAT * size for corner in polygon)


def _straightened(polygon: list[Vector]) -> tuple[Vector, ...]:
    """Without the corners that lie on a straight side."""
    kept = []
    for before, corner, after in zip((polygon[-1], *polygon[:-1]), polygon, (*polygon[1:], polygon[0])):
        first, second = subtract(corner, before), subtract(after, corner)
        if math.hypot(*cross(first, second)) > FLAT * math.hypot(*first) * math.hypot(*second):
            kept.append(corner)
    return tuple(kept)


def sine_of(polygon: Sequence[Vector], direction: Vector) -> float:
    """Sine of the angle between the sunlight and the plane of the polygon."""
    return abs(dot(normalized(area(polygon)), direction))


def shaft(polygon: Sequence[Vector], direction: Vector, *, length: float | None = None, floor: float | None = None) -> Hull:
    """The prism that light along the unit ``direction`` fills behind a convex opening.

    It ends after ``length`` (m), parallel to the opening, or just below the level ``floor``. Raises ValueError for light along
    the opening, light that does not fall, and an opening that reaches below the floor.
    """
    normal = normalized(area(polygon))
    facing = dot(normal, direction)
    if abs(facing) < GRAZING:
        raise ValueError(f"the sun shines along the opening, {math.degrees(math.asin(abs(facing))):.1f} degrees from its plane (at "
                         f"least {math.degrees(GRAZING):.1f} are needed); turn the sun or choose another opening")
    if facing < 0.0:
        polygon, normal, facing = tuple(reversed(polygon)), scaled(normal, -1.0), -facing
    # Into one plane, along the light: what passes stays the same.
    center = middle(polygon)
    flat = [add(corner, scaled(direction, dot(subtract(center, corner), normal) / facing)) for corner in polygon]
    if floor is None:
        ends = [add(corner, scaled(direction, length)) for corner in flat]
    else:
        lowest, highest = (f(corner[2] for corner in flat) for f in (min, max))
        if direction[2] > -GRAZING:
            raise ValueError(f"the light does not fall to the floor: its direction is {direction}; let the sun shine downwards, or "
                             "end the shaft after a length")
        if lowest < floor - 1e-6 * max(1.0, abs(floor), highest - lowest) or highest <= floor:
            raise ValueError(f"the opening reaches down to {lowest:g} m, below the floor at {floor:g} m; lower the floor")
        level = floor - BELOW * (highest - floor)
        ends = [add(corner, scaled(direction, (level - corner[2]) / direction[2])) for corner in flat]
    begin = BEGIN * max(math.dist(a, b) for a, b in zip(flat, ends))
    return swept(tuple(add(corner, scaled(direction, begin)) for corner in flat), tuple(ends))
