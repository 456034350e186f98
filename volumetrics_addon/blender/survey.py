# SPDX-License-Identifier: GPL-3.0-or-later
"""Which lamps light what a camera sees: light paths of the scene, traced among its opaque bodies, as counts with known confidence.

Paths begin in the picture and go on from what they meet, off surfaces and in media, twice. At the places on their way the
irradiance of every lamp is known as if nothing stood in between; tests with probability in proportion to it look whether something
does. A lamp with U of unshaded light over all places, M tests and k that get through gives U k / M; with k = 0 it gives at most
3 U / M with 95 % confidence (the rule of three).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Vector

from ..plan.observed import Lamp, Medium, Survey, View

PATHS = 384
MEDIA_PATHS = 8000  # where media may be left out that none of the first has met
PILOT, TESTS = 12, 6000  # shadow rays of each lamp to begin with, and of the lamps together that seem to give nothing
BOUNCES = 2
MOST_PASSED = 32  # faces that let light through, one behind the other
ALBEDO = 0.8  # of every surface, and the share that goes on in a medium
EPSILON = 1e-4


class Tracer:
    """Rays among the opaque bodies of a scene; ``opaque`` names those that let no light through."""

    def __init__(self, scene: bpy.types.Scene, layer: bpy.types.ViewLayer, opaque: set[str]):
        self.scene, self.graph, self.opaque = scene, layer.depsgraph, opaque

    def hit(self, origin: Vector, direction: Vector, reach: float) -> tuple[float, Vector] | None:
        """Distance and normal of the first opaque face, or None."""
        start, gone = origin, 0.0
        for _ in range(MOST_PASSED):
            found, place, normal, _, body, _ = self.scene.ray_cast(self.graph, start, direction, distance=reach - gone)
            if not found:
                return None
            gone = (place - origin).length
            if body.name in self.opaque:
                return gone, normal
            start = place + direction * (EPSILON * max(1.0, gone))
            if gone >= reach:
                return None
        return None


def survey(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, view: View, lamps: Sequence[Lamp], media: Sequence[Medium],
           opaque: set[str], mirrors: bool, size: float, seed: int = 0, spare: set[str] = frozenset()) -> Survey:
    """The light that each lamp gives to what the view shows, and whether paths meet the media named in ``spare``.

    ``size`` is that of the scene, ``mirrors`` whether anything mirrors.
    """
    rng = np.random.default_rng(seed)
    tracer = Tracer(scene, layer, opaque)
    meetings = _Meetings(tracer, lamps, [medium for medium in media if medium.name in spare], size, rng)
    places, weights, normals = _places(tracer, view, media, mirrors, size, rng, PATHS, meetings)
    if meetings.unmet():
        _places(tracer, view, media, mirrors, size, rng, MEDIA_PATHS, meetings)
    unshaded = np.stack([_irradiance(lamp, places, normals) * weights for lamp in lamps]) if len(places) else np.zeros((len(lamps), 0))
    tests = [[float(light.sum()), 0, 0] for light in unshaded]
    for lamp, light, entry in zip(lamps, unshaded, tests):
        _test(tracer, lamp, light, places, size, PILOT, entry, rng)
    dark = [index for index, (light, _, through) in enumerate(tests) if light > 0.0 and through <= PILOT // 4]
    total = sum(tests[index][0] for index in dark)
    for index in dark:
        _test(tracer, lamps[index], unshaded[index], places, size, math.ceil(TESTS * tests[index][0] / total), tests[index], rng)
    return Survey({lamp.name: tuple(entry) for lamp, entry in zip(lamps, tests)}, len(places), meetings.counts())


class _Meetings:
    """Counts the paths that meet the boxes of media, on their own way or on that from one of their places to a lamp."""

    def __init__(self, tracer: Tracer, lamps: Sequence[Lamp], media: Sequence[Medium], size: float, rng: np.random.Generator):
        self.tracer, self.lamps, self.size, self.rng = tracer, lamps, size, rng
        self.boxes = {medium.name: (np.min(medium.corners, axis=0), np.max(medium.corners, axis=0)) for medium in media}
        self.met = dict.fromkeys(self.boxes, 0)
        self.paths = 0

    def unmet(self) -> list[str]:
        return [name for name, count in self.met.items() if count == 0]

    def counts(self) -> dict[str, tuple[int, int]]:
        return {name: (self.paths, count) for name, count in self.met.items()}

    def add(self, segments: Sequence[tuple[Vector, Vector, float]], places: Sequence[Vector]) -> None:
        """A path by its segments (origin, direction, length), and one of its places for a shadow ray."""
        self.paths += 1
        waiting = self.unmet()
        if not waiting:
            return
        segments = list(segments)
        if places and self.lamps:
            origin = places[int(self.rng.integers(len(places)))]
            lamp = self.lamps[int(self.rng.integers(len(self.lamps)))]
            toward, reach = _toward(lamp, origin, self.size, self.rng)
            if reach > 0.0 and self.tracer.hit(origin, toward, reach * (1.0 - EPSILON)) is None:
                segments.append((origin, toward, reach))
        for name in waiting:
            for origin, direction, length in segments:
                near, far = _span(self.boxes[name], origin, direction, length)
                if far > near:
                    self.met[name] += 1
                    break


def _places(tracer: Tracer, view: View, media: Sequence[Medium], mirrors: bool, size: float, rng: np.random.Generator, paths: int,
            meetings: _Meetings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) along paths, their weights, and the normals of surfaces there (zero in a medium)."""
    boxes = [(np.min(m.corners, axis=0), np.max(m.corners, axis=0)) if m.corners else None for m in media]
    places, weights, normals = [], [], []
    columns = max(1, round(math.sqrt(paths * (view.high[0] - view.low[0]) / max(view.high[1] - view.low[1], 1e-9))))
    rows = max(1, round(paths / columns))
    for index in range(columns * rows):
        u = (index % columns + rng.random()) / columns
        v = (index // columns + rng.random()) / rows
        x, y = (low + share * (high - low) for low, high, share in zip(view.low, view.high, (u, v)))
        origin = Vector(view.position)
        direction = (Vector(view.point(x, y, 1.0)) - origin).normalized()
        weight, segments, first = 1.0, [], len(places)
        for _ in range(BOUNCES + 1):
            found = tracer.hit(origin, direction, size)
            end = found[0] if found else size
            segments.append((origin, direction, end))
            inside = _inside(boxes, media, origin, direction, end, rng)
            if inside is not None:
                share, along = inside
                places.append(origin + direction * along)
                weights.append(weight * share)
                normals.append((0.0, 0.0, 0.0))
            # Onwards from the medium or from the surface, by what is more likely.
            if inside is not None and (found is None or rng.random() < inside[0]):
                origin, direction = places[-1], _sphere(rng)
            elif found is not None:
                normal = found[1] if found[1].dot(direction) < 0.0 else -found[1]
                origin = origin + direction * (end - EPSILON * max(1.0, end))
                places.append(origin)
                weights.append(weight)
                normals.append(tuple(normal))
                mirrored = mirrors and rng.random() < 0.5
                direction = direction.reflect(normal) if mirrored else _hemisphere(normal, rng)
            else:
                break
            weight *= ALBEDO
        meetings.add(segments, places[first:])
    return np.array(places, float).reshape(-1, 3), np.array(weights), np.array(normals, float).reshape(-1, 3)


def _inside(boxes: Sequence, media: Sequence[Medium], origin: Vector, direction: Vector, end: float,
            rng: np.random.Generator) -> tuple[float, float] | None:
    """The chance of scattering along a ray, and a distance in a medium on it; None where it meets none."""
    spans, depth = [], 0.0
    for box, medium in zip(boxes, media):
        near, far = (0.0, end) if box is None else _span(box, origin, direction, end)
        if far > near:
            spans.append((near, far))
            depth += min(medium.substance.extinction.high * (far - near), 50.0)
    if not spans or depth == 0.0:
        return None
    near, far = spans[int(rng.integers(len(spans)))]
    return -math.expm1(-depth), near + (far - near) * rng.random()


def _span(box: tuple, origin: Vector, direction: Vector, end: float) -> tuple[float, float]:
    near, far = 0.0, end
    for low, high, o, d in zip(*box, origin, direction):
        if abs(d) < 1e-12:
            if not low <= o <= high:
                return 0.0, 0.0
            continue
        a, b = sorted(((low - o) / d, (high - o) / d))
        near, far = max(near, a), min(far, b)
    return near, far


def _sphere(rng: np.random.Generator) -> Vector:
    return Vector(rng.normal(size=3)).normalized()


def _hemisphere(normal: Vector, rng: np.random.Generator) -> Vector:
    """Cosine-distributed about the normal."""
    direction = normal + _sphere(rng)
    return direction.normalized() if direction.length > 1e-6 else normal.copy()


def _irradiance(lamp: Lamp, places: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The lamp's largest unshaded irradiance at places (n, 3), whatever point of it shines; faces that turn away get none."""
    if lamp.kind == "SUN":
        toward = np.broadcast_to(-np.array(lamp.direction), places.shape)
        light = np.full(len(places), lamp.power)
        spread = math.sin(min(lamp.radius, 1.5))
    else:
        toward = np.array(lamp.position) - places
        distance = np.linalg.norm(toward, axis=1)
        toward = toward / np.maximum(distance, 1e-12)[:, None]
        peak = lamp.power / math.pi if lamp.kind == "AREA" else lamp.power / (4.0 * math.pi)
        light = peak / np.maximum(np.maximum(distance - lamp.radius, lamp.radius), 1e-4) ** 2
        spread = np.minimum(1.0, lamp.radius / np.maximum(distance, 1e-12))
        if lamp.kind == "SPOT" and lamp.cone < math.pi:
            along = -(toward @ np.array(lamp.direction))
            wide = np.arccos(np.clip(along, -1.0, 1.0)) - np.arcsin(spread)
            light = np.where(wide <= 0.5 * lamp.cone, light, 0.0)
    cosine = (toward * normals).sum(axis=1)
    in_medium = ~normals.any(axis=1)
    return light * np.where(in_medium, 1.0, np.clip(cosine + spread, 0.0, 1.0))


def _test(tracer: Tracer, lamp: Lamp, light: np.ndarray, places: np.ndarray, size: float, count: int, entry: list,
          rng: np.random.Generator) -> None:
    """Shadow rays to places drawn in proportion to the lamp's light there; adds to [U, M, k]."""
    if entry[0] <= 0.0:
        return
    edges = np.cumsum(light)
    drawn = np.minimum(np.searchsorted(edges, (np.arange(count) + rng.random(count)) / count * edges[-1]), len(places) - 1)
    for index in drawn:
        origin = Vector(places[index])
        toward, reach = _toward(lamp, origin, size, rng)
        if reach > 0.0 and tracer.hit(origin, toward, reach * (1.0 - EPSILON)) is not None:
            continue
        entry[2] += 1
    entry[1] += count


def _toward(lamp: Lamp, origin: Vector, size: float, rng: np.random.Generator) -> tuple[Vector, float]:
    """Direction and distance to a random point of what shines."""
    if lamp.kind == "SUN":
        return (-Vector(lamp.direction) + math.tan(min(lamp.radius, 1.5)) * rng.random() * _sphere(rng)).normalized(), size
    toward = Vector(lamp.position) + lamp.radius * rng.random() * _sphere(rng) - origin
    return toward.normalized(), toward.length
