# SPDX-License-Identifier: GPL-3.0-or-later
"""The quadrature of ``single_scattering`` compiled with numba: the same nodes, one ray at a time.

Importing this module needs numba. Without surfaces and with lights at points it finds the lit intervals itself
(``in_scattering``); otherwise it sums over intervals that the NumPy twin has found (``integrate``). Media are homogeneous
or fall off with height: their optical depths are closed forms.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..scene import geometry
from ..scene.model import ExponentialHeight, Homogeneous, Hull, Point, Projector, Scene, Spot
from .path_kernel import (
    along, arriving, compiled, dot, interval, mean_over_height, minus, nappe_interval, phase_value, scaled, times, vector,
)
from .path_scene import (
    COLOR, DARK, DENSITY, FULL, HEIGHT, HOMOGENEOUS, LIGHT, LIGHTS, PARAMETERS, PHASE, POSITION, SIGMA_S, SIGMA_T, SUN, TOWARD,
    TWO_LOBES, VOLUME, VOLUMES, flatten,
)

INF = math.inf
MAX_VOLUMES = 16
CHUNK = 256  # rays or intervals of one work item


def supports(scene: Scene) -> bool:
    """Whether all optical depths of the scene are closed forms here and all lights are known."""
    return (all(isinstance(v.medium.density, (Homogeneous, ExponentialHeight)) and not isinstance(v.domain, Hull)
                for v in scene.volumes)
            and len(scene.volumes) <= MAX_VOLUMES and not any(isinstance(light, Projector) for light in scene.lights))


def finds_intervals(scene: Scene) -> bool:
    """Whether nothing casts a shadow and every light stands at a point inside every volume: no kinks to look for."""
    if scene.surfaces or not supports(scene):
        return False
    for light in scene.lights:
        if not isinstance(light, (Point, Spot)):
            return False
        for volume in scene.volumes:
            near, far = geometry.interval(volume.domain, np.array([light.position]), np.array([[0.0, 0.0, 1.0]]))
            if not near[0] <= 0.0 <= far[0]:
                return False
    return True


class Kernel:
    """A scene made ready for the compiled loops. Raises ValueError when it is not supported (see ``supports``)."""

    def __init__(self, scene: Scene):
        if not supports(scene):
            raise ValueError("the compiled quadrature knows homogeneous media and height fog under suns, point and spot lights; "
                             "use the NumPy twin")
        self._numbers = flatten(scene)
        self.finds_intervals = finds_intervals(scene)

    def in_scattering(self, origin, direction, rule, piece_depth, near_light, near_light_breaks, value) -> int:
        """Add the in-scattered radiance along the rays to ``value`` (n, 3); returns the evaluations."""
        return in_scattering(self._numbers, origin, direction, *rule, piece_depth, near_light, near_light_breaks, value)

    def integrate(self, light_index, volume_index, origin, direction, ray, low, high, rule):
        """In-scattered radiance (m, 3) of one light in one volume over the intervals (m,) of the rays with these indices."""
        return integrate(self._numbers, light_index, volume_index, origin, direction, ray, low, high, *rule)


@compiled
def length_of(scene, v, start, direction, near, far):
    """Integral of the density over [near, far] of a ray, all of it inside the volume."""
    if far <= near:
        return 0.0
    if scene[v + DENSITY] == HOMOGENEOUS:
        return far - near
    return (far - near) * mean_over_height(scene, v + PARAMETERS, start[2] + near * direction[2], direction[2] * (far - near))


@compiled
def strengthen(depth, sigma_t, length):
    return depth[0] + sigma_t[0] * length, depth[1] + sigma_t[1] * length, depth[2] + sigma_t[2] * length


@compiled
def scattered(scene, light, v, spans, inside, origin, direction, t):
    """sigma_s rho p E T T (three channels) at the distance t along the ray, in volume v."""
    position = along(origin, direction, t)
    toward, distance, irradiance = arriving(scene, light, position)
    depth = (0.0, 0.0, 0.0)
    for i in range(int(scene[VOLUMES])):
        other = int(scene[VOLUMES + 1]) + i * VOLUME
        sigma_t = vector(scene, other + SIGMA_T)
        depth = strengthen(depth, sigma_t, length_of(scene, other, origin, direction, spans[i, 0], min(spans[i, 1], t)))
        if inside and other == v:
            near, far = 0.0, distance
        else:
            near, far = interval(scene, other, position, toward)
            near, far = max(near, 0.0), min(far, distance)
        depth = strengthen(depth, sigma_t, length_of(scene, other, position, toward, near, far))
    value = phase_value(scene, v, min(1.0, max(-1.0, dot(toward, direction))))
    if scene[v + DENSITY] == HEIGHT:
        at = v + PARAMETERS
        value *= math.exp(-(position[2] - scene[at + 1]) / scene[at])
    if depth[0] == depth[1] == depth[2]:
        weight = value * math.exp(-depth[0])
        attenuated = (weight, weight, weight)
    else:
        attenuated = value * math.exp(-depth[0]), value * math.exp(-depth[1]), value * math.exp(-depth[2])
    return times(times(attenuated, irradiance), vector(scene, v + SIGMA_S))


@compiled
def panel(scene, light, v, spans, inside, origin, direction, low, high, nodes, weights):
    """Integral of ``scattered`` over [low, high], in t for a sun, in s = tan(theta / 2) for a light at a point."""
    total = (0.0, 0.0, 0.0)
    if scene[light + SUN] == 1.0:
        half, middle = (high - low) / 2.0, (high + low) / 2.0
        for k in range(len(nodes)):
            value = scattered(scene, light, v, spans, inside, origin, direction, middle + half * nodes[k])
            total = along(total, value, half * weights[k])
        return total
    foot, height = closest_approach(scene, light, origin, direction)
    height = max(height, 1e-9 * max(high - low, 1e-9))
    start, end = half_angle(low - foot, height), half_angle(high - foot, height)
    half, middle = (end - start) / 2.0, (end + start) / 2.0
    for k in range(len(nodes)):
        s = middle + half * nodes[k]
        inverse = 1.0 / (1.0 - s * s)
        value = scattered(scene, light, v, spans, inside, origin, direction, foot + 2.0 * height * s * inverse)
        total = along(total, value, half * weights[k] * 2.0 * height * (1.0 + s * s) * inverse * inverse)
    return total


@compiled
def enclosed_panel(scene, light, v, near, foot, height, ahead, slope, low, high, nodes, weights, cosines, values, lengths):
    """``panel`` for a light inside the only volume, which is homogeneous.

    With d = D (1 + s^2) / (1 - s^2) the irradiance's 1 / d^2 cancels against dt, and the cosine is -2 s / (1 + s^2). What
    has no call in it runs in loops of its own over scratch arrays, so that it is done for several nodes at a time.
    """
    height = max(height, 1e-9 * max(high - low, 1e-9))
    start, end = half_angle(low - foot, height), half_angle(high - foot, height)
    half, middle = (end - start) / 2.0, (end + start) / 2.0
    for k in range(len(nodes)):
        s = middle + half * nodes[k]
        square = s * s
        both = 1.0 / ((1.0 - square) * (1.0 + square))
        stretch, squeeze = height * both * (1.0 + square), both * (1.0 - square)
        cosines[k] = -2.0 * s * squeeze
        values[k] = weights[k] * squeeze
        lengths[k] = stretch * (1.0 + square + 2.0 * s)
    one_lobe = scene[v + PHASE] == TWO_LOBES and scene[v + PHASE + 3] == 0.0
    if one_lobe:
        g = scene[v + PHASE + 1]
        gap = 1.0 - abs(g)
        strength, twice = gap * (1.0 + abs(g)) / (4.0 * math.pi), 2.0 * g
        peak = gap * gap + 2.0 * abs(g)
        for k in range(len(nodes)):
            denominator = max(gap * gap, peak - twice * cosines[k])
            values[k] *= strength / (denominator * math.sqrt(denominator))
    else:
        for k in range(len(nodes)):
            values[k] *= phase_value(scene, v, min(1.0, max(-1.0, cosines[k])))
    dark, full = scene[light + DARK], scene[light + FULL]
    if dark >= -1.0:
        for k in range(len(nodes)):
            s = middle + half * nodes[k]
            inverse = 1.0 / (1.0 - s * s)
            cosine = (ahead + (foot + 2.0 * height * s * inverse) * slope) / (height * (1.0 + s * s) * inverse)
            if cosine < full:
                x = max(0.0, cosine - dark) / (full - dark)
                values[k] *= x * x * (3.0 - 2.0 * x)
    sigma_t = vector(scene, v + SIGMA_T)
    before = foot - near
    red, green, blue = 0.0, 0.0, 0.0
    for k in range(len(nodes)):
        red += values[k] * math.exp(-sigma_t[0] * (before + lengths[k]))
    if sigma_t[0] == sigma_t[1] == sigma_t[2]:
        green, blue = red, red
    else:
        for k in range(len(nodes)):
            green += values[k] * math.exp(-sigma_t[1] * (before + lengths[k]))
            blue += values[k] * math.exp(-sigma_t[2] * (before + lengths[k]))
    return scaled(times(times((red, green, blue), vector(scene, light + COLOR)), vector(scene, v + SIGMA_S)), 2.0 * half / height)


@compiled
def closest_approach(scene, light, origin, direction):
    offset = minus(vector(scene, light + POSITION), origin)
    foot = dot(offset, direction)
    across = minus(offset, scaled(direction, foot))
    return foot, math.sqrt(dot(across, across))


@compiled
def half_angle(a, height):
    """tan(theta / 2) of the angle under which the light sees the position a metres from its foot."""
    return a / (height + math.sqrt(a * a + height * height))


@compiled
def measure_spans(scene, origin, direction, limit, spans):
    """Where the ray runs through each volume, within [0, limit]."""
    for i in range(int(scene[VOLUMES])):
        near, far = interval(scene, int(scene[VOLUMES + 1]) + i * VOLUME, origin, direction)
        spans[i, 0], spans[i, 1] = max(near, 0.0), min(far, limit)


@compiled
def insert(breaks, count, value):
    """Put the value in its place among the first ``count`` sorted breaks, unless it lies outside them."""
    if not breaks[0] < value < breaks[count - 1]:
        return count
    k = count
    while breaks[k - 1] > value:
        breaks[k] = breaks[k - 1]
        k -= 1
    breaks[k] = value
    return count + 1


@compiled
def lit_breaks(scene, light, i, spans, origin, direction, foot, height, near_light, near_light_breaks, breaks):
    """Sorted ends of the pieces of the ray on which the light in volume i is smooth; returns how many there are."""
    low, high = spans[i, 0], spans[i, 1]
    inner_low, inner_high = INF, INF
    if scene[light + DARK] >= -1.0:
        local, axis = minus(origin, vector(scene, light + POSITION)), vector(scene, light + TOWARD)
        dark, full = scene[light + DARK], scene[light + FULL]
        near, far = nappe_interval(local, direction, axis, dark * dark)
        low, high = max(low, near), min(high, far)
        inner_low, inner_high = nappe_interval(local, direction, axis, full * full)
    if not low < high:
        return 0
    breaks[0], breaks[1] = low, high
    count = 2
    if scene[light + DARK] >= -1.0:
        count = insert(breaks, insert(breaks, count, inner_low), inner_high)
    for k in range(int(scene[VOLUMES])):
        if k != i:
            count = insert(breaks, insert(breaks, count, spans[k, 0]), spans[k, 1])
    if height < near_light * (high - low):
        for factor in near_light_breaks:
            count = insert(breaks, count, foot + factor * height)
    return count


@numba.njit(fastmath={"contract", "arcp", "nsz", "afn", "reassoc"}, error_model="numpy", cache=True, parallel=True)
def in_scattering(scene, origin, direction, nodes, weights, piece_depth, near_light, near_light_breaks, value):
    rays = len(direction)
    evaluations = 0
    alone = scene[VOLUMES] == 1.0 and scene[int(scene[VOLUMES + 1]) + DENSITY] == HOMOGENEOUS
    for chunk in numba.prange((rays + CHUNK - 1) // CHUNK):
        spans = np.empty((MAX_VOLUMES, 2))
        breaks = np.empty(2 * MAX_VOLUMES + 8 + len(near_light_breaks))
        cosines, values, lengths = np.empty(len(nodes)), np.empty(len(nodes)), np.empty(len(nodes))
        panels = 0
        for ray in range(chunk * CHUNK, min(rays, (chunk + 1) * CHUNK)):
            o = (origin[ray, 0], origin[ray, 1], origin[ray, 2])
            d = (direction[ray, 0], direction[ray, 1], direction[ray, 2])
            measure_spans(scene, o, d, INF, spans)
            total = (0.0, 0.0, 0.0)
            for light_index in range(int(scene[LIGHTS])):
                light = int(scene[LIGHTS + 1]) + light_index * LIGHT
                foot, height = closest_approach(scene, light, o, d)
                axis = vector(scene, light + TOWARD)
                ahead, slope = dot(minus(o, vector(scene, light + POSITION)), axis), dot(d, axis)
                for i in range(int(scene[VOLUMES])):
                    v = int(scene[VOLUMES + 1]) + i * VOLUME
                    if scene[v + SIGMA_S] + scene[v + SIGMA_S + 1] + scene[v + SIGMA_S + 2] == 0.0:
                        continue
                    count = lit_breaks(scene, light, i, spans, o, d, foot, height, near_light, near_light_breaks, breaks)
                    for k in range(count - 1):
                        low, high = breaks[k], breaks[k + 1]
                        sigma = max(scene[v + SIGMA_T], max(scene[v + SIGMA_T + 1], scene[v + SIGMA_T + 2]))
                        pieces = min(64, max(1, math.ceil(sigma * length_of(scene, v, o, d, low, high) / piece_depth)))
                        step = (high - low) / pieces
                        for piece in range(pieces):
                            start, end = low + piece * step, low + (piece + 1) * step
                            if alone:
                                part = enclosed_panel(scene, light, v, spans[0, 0], foot, height, ahead, slope, start, end, nodes,
                                                      weights, cosines, values, lengths)
                            else:
                                part = panel(scene, light, v, spans, True, o, d, start, end, nodes, weights)
                            total = along(total, part, 1.0)
                        panels += pieces
            value[ray, 0] += total[0]
            value[ray, 1] += total[1]
            value[ray, 2] += total[2]
        evaluations += panels * len(nodes)
    return evaluations


@numba.njit(fastmath={"contract", "arcp", "nsz", "afn", "reassoc"}, error_model="numpy", cache=True, parallel=True)
def integrate(scene, light_index, volume_index, origin, direction, ray, low, high, nodes, weights):
    result = np.empty((len(ray), 3))
    light = int(scene[LIGHTS + 1]) + light_index * LIGHT
    v = int(scene[VOLUMES + 1]) + volume_index * VOLUME
    for chunk in numba.prange((len(ray) + CHUNK - 1) // CHUNK):
        spans = np.empty((MAX_VOLUMES, 2))
        for k in range(chunk * CHUNK, min(len(ray), (chunk + 1) * CHUNK)):
            r = ray[k]
            o = (origin[r, 0], origin[r, 1], origin[r, 2])
            d = (direction[r, 0], direction[r, 1], direction[r, 2])
            measure_spans(scene, o, d, INF, spans)
            part = panel(scene, light, v, spans, False, o, d, low[k], high[k], nodes, weights)
            result[k, 0], result[k, 1], result[k, 2] = part
    return result
