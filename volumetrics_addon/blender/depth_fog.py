# SPDX-License-Identifier: GPL-3.0-or-later
"""Compositor nodes of fog in closed form, from the depth of each pixel: the formulas of reference.depth_fog as a node group.

All is float32; where a difference would lose its digits a series or the larger end takes its place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import bpy

from ..parameters.families import FAMILIES
from ..parameters.fog import DEPTH_FOGS, FAR
from ..physics.plane_parallel import ELEVATIONS, MOMENTS
from ..physics.quadrature import gauss_legendre
from ..scene.model import Box
from .composited import Socket, choose, henyey_greenstein, sun_of, total, tree_of, vector_sum, view_of, with_alpha
from .families.fog import extinction
from .nodes import Tree

GENTLE = 1e-3  # below, (1 - exp(-x)) / x is 1 - x / 2 within 2e-7
LOWEST_SUN = 1e-3  # sine of the elevation down to which a sun shines into the fog


def group(values: Mapping[str, Any], box: Box | None, suns: int, sky: bool, name: str) -> bpy.types.NodeTree:
    """The node group for these build-time values, so many suns and a uniform sky or none; ``box`` holds a height fog.

    A depth fog, by profile, has no box. Live values and the frame are set on the node that uses it.
    """
    return tree_of(FAMILIES["fog"], suns, name, lambda build, inputs: _picture(build, inputs, values, box, suns, sky))


class _Fog:
    """Optical depths of a height fog in its box, as nodes."""

    def __init__(self, build: Tree, inputs: Mapping[str, Socket], values: Mapping[str, Any], box: Box):
        self.build, self.box = build, box
        self.bottom, self.top = box.center[2] - box.half[2], box.center[2] + box.half[2]
        sigma = extinction(build, inputs)
        self.layers: list[tuple[Socket, Socket | None]]
        if values["profile"] == "slab":
            self.layers = [(sigma, None)]
        else:
            self.layers = [(sigma, inputs["scale_height"])]
            if values["second_extinction"] > 0.0:
                self.layers.append((values["second_extinction"], inputs["second_scale_height"]))
        self.base = inputs["base_height"]
        self._above_top = [None if height is None else self._vertical(self.top, sigma, height) for sigma, height in self.layers]

    def density(self, z: Socket, height: Socket) -> Socket:
        drop = self.build.math("DIVIDE", self.build.math("SUBTRACT", self.base, z), height)
        return self.build.math("EXPONENT", self.build.math("MINIMUM", drop, 80.0))

    def _vertical(self, z: Socket, sigma: Socket, height: Socket) -> Socket:
        return self.build.math("MULTIPLY", self.build.math("MULTIPLY", sigma, height), self.density(z, height))

    def above(self, z: Socket) -> Socket:
        """Vertical optical depth above z."""
        build = self.build
        z = build.math("MINIMUM", build.math("MAXIMUM", z, self.bottom), self.top)
        parts = []
        for (sigma, height), rest in zip(self.layers, self._above_top):
            if height is None:
                parts.append(build.math("MULTIPLY", sigma, build.math("SUBTRACT", self.top, z)))
            else:
                parts.append(build.math("MAXIMUM", build.math("SUBTRACT", self._vertical(z, sigma, height), rest), 0.0))
        return total(build, parts)

    def along(self, z: Socket, mu: Socket, length: Socket) -> Socket:
        """Optical depth of a way of this length from height z: sigma exp(-(lower end) / H) length (1 - exp(-x)) / x."""
        build = self.build
        low = build.math("MULTIPLY_ADD", build.math("MINIMUM", mu, 0.0), length, z)
        low = build.math("MAXIMUM", low, self.bottom)
        slope = build.math("ABSOLUTE", mu)
        parts = []
        for sigma, height in self.layers:
            part = build.math("MULTIPLY", sigma, length)
            if height is not None:
                x = build.math("DIVIDE", build.math("MULTIPLY", length, slope), height)
                part = build.math("MULTIPLY", build.math("MULTIPLY", part, self.density(low, height)), mean_decay(build, x))
            parts.append(part)
        return total(build, parts)

    def interval(self, origin: Socket, direction: Socket) -> tuple[Socket, Socket]:
        """Distances at which a ray enters and leaves the box."""
        build, box = self.build, self.box
        low, high = (tuple(c + sign * h for c, h in zip(box.center, box.half)) for sign in (-1.0, 1.0))
        nears, fars = [], []
        for axis, (start, way) in enumerate(zip(build.components(origin), build.components(direction))):
            # A ray in parallel to a face divides by a way too short to matter.
            small = build.math("LESS_THAN", build.math("ABSOLUTE", way), 1e-9)
            way = build.math("MULTIPLY_ADD", small, 2e-9, way)
            a, b = (build.math("DIVIDE", build.math("SUBTRACT", side[axis], start), way) for side in (low, high))
            nears.append(build.math("MINIMUM", a, b))
            fars.append(build.math("MAXIMUM", a, b))
        near = build.math("MAXIMUM", build.math("MAXIMUM", nears[0], nears[1]), nears[2])
        return near, build.math("MINIMUM", build.math("MINIMUM", fars[0], fars[1]), fars[2])


def mean_decay(build: Tree, x: Socket) -> Socket:
    """(1 - exp(-x)) / x for x >= 0."""
    divided = build.math("DIVIDE", build.math("SUBTRACT", 1.0, build.math("EXPONENT", build.math("MULTIPLY", x, -1.0))), x)
    return choose(build, build.math("LESS_THAN", x, GENTLE), build.math("MULTIPLY_ADD", x, -0.5, 1.0), divided)


def scattered(build: Tree, tau: Socket, depth: Socket, mu: Socket, mu0: Socket) -> Socket:
    """plane_parallel.single_scattering."""
    x = build.math("MULTIPLY", depth, build.math("SUBTRACT", 1.0, build.math("DIVIDE", mu, mu0)))
    exponent = build.math("SUBTRACT", build.math("MAXIMUM", build.math("MULTIPLY", x, -1.0), 0.0), build.math("DIVIDE", tau, mu0))
    mean = mean_decay(build, build.math("ABSOLUTE", x))
    return build.math("MULTIPLY", build.math("MULTIPLY", depth, mean), build.math("EXPONENT", exponent))


def sky_light(build: Tree, tau: Socket, depth: Socket, mu: Socket, g: Socket) -> Socket:
    """plane_parallel.sky_light: Gauss nodes over the elevations, moments of the phase function three to a vector."""
    power, legendre = [None, g], [None, mu]
    for order in range(2, MOMENTS + 1):
        power.append(build.math("MULTIPLY", power[-1], g))
    peak = power.pop()
    for n in range(2, MOMENTS):  # n P_n = (2 n - 1) mu P_(n-1) - (n - 1) P_(n-2)
        before = build.math("MULTIPLY", legendre[-2], -(n - 1) / n) if n > 2 else -(n - 1) / n
        legendre.append(build.math("MULTIPLY_ADD", build.math("MULTIPLY", legendre[-1], mu), (2 * n - 1) / n, before))
    strengths = [build.math("MULTIPLY", build.math("SUBTRACT", power[n] if n else 1.0, peak), n + 0.5) for n in range(MOMENTS)]
    terms = [build.math("MULTIPLY", strengths[n], legendre[n]) if n else strengths[0] for n in range(MOMENTS)]
    triples = [build.combine(*terms[n : n + 3]) for n in range(0, MOMENTS, 3)]
    parts = []
    for mu0, weight in zip(*gauss_legendre(ELEVATIONS, 0.0, 1.0)):
        own = [legendre_polynomial(n, mu0) * weight for n in range(MOMENTS)]
        phase = total(build, [build.scalar("DOT_PRODUCT", triple, tuple(own[3 * k : 3 * k + 3])) for k, triple in enumerate(triples)])
        parts.append(build.math("MULTIPLY", phase, scattered(build, tau, depth, mu, float(mu0))))
    # The forward peak shines along the ray, from above the horizon.
    upward = build.math("GREATER_THAN", mu, 0.0)
    way = build.math("DIVIDE", build.math("MULTIPLY", tau, -1.0), build.math("MAXIMUM", mu, 1e-6))
    forward = build.math("MULTIPLY", build.math("MULTIPLY", depth, upward), build.math("EXPONENT", build.math("MAXIMUM", way, -80.0)))
    return build.math("MAXIMUM", total(build, [*parts, build.math("MULTIPLY", peak, forward)]), 0.0)


def legendre_polynomial(n: int, x: float) -> float:
    before, value = 0.0, 1.0
    for k in range(n):
        before, value = value, ((2 * k + 1) * x * value - k * before) / (k + 1)
    return value


def _sky_transmittance(build: Tree, tau: Socket) -> Socket:
    parts = []
    for mu0, weight in zip(*gauss_legendre(ELEVATIONS, 0.0, 1.0)):
        parts.append(build.math("MULTIPLY", build.math("EXPONENT", build.math("MULTIPLY", tau, -1.0 / mu0)), 2.0 * weight * mu0))
    return total(build, parts)


def _picture(build: Tree, inputs: Mapping[str, Socket], values: Mapping[str, Any], box: Box | None, suns: int, sky: bool) -> Socket:
    image, view = inputs["Image"], view_of(build, inputs)
    origin, direction, mu, hit, distance = view.origin, view.direction, view.mu, view.hit, view.distance

    lights = []  # of each sun: whether it is up, sine of its elevation, phase function and irradiance
    for index in range(suns):
        travel, irradiance = sun_of(build, inputs, index)
        mu0 = build.math("MULTIPLY", build.components(travel)[2], -1.0)
        up = build.math("GREATER_THAN", mu0, LOWEST_SUN)
        mu0 = build.math("MAXIMUM", mu0, LOWEST_SUN)
        cosine = build.math("MULTIPLY", build.scalar("DOT_PRODUCT", direction, travel), -1.0)
        phase = build.math("MULTIPLY", up, henyey_greenstein(build, inputs["g"], cosine))
        lights.append((up, mu0, phase, irradiance))

    if values["profile"] in DEPTH_FOGS:
        opacity = _depth_opacity(build, inputs, values["profile"], distance)
        light = [build.scale(build.vector("MULTIPLY", irradiance, inputs["sun_tint"]), phase) for _, _, phase, irradiance in lights]
        far = build.scale(inputs["far_color"], inputs["far_radiance"])
        if light:
            far = build.vector("ADD", far, build.vector("MULTIPLY", inputs["albedo"], vector_sum(build, light)))
        airlight, lit = build.scale(far, opacity), None
    else:
        fog = _Fog(build, inputs, values, box)
        near, leave = fog.interval(origin, direction)
        near = build.math("MAXIMUM", near, inputs["start"])
        length = build.math("MAXIMUM", build.math("SUBTRACT", build.math("MINIMUM", leave, distance), near), 0.0)
        z = build.components(origin)[2]
        entry = build.math("MULTIPLY_ADD", near, mu, z)
        entry = build.math("MINIMUM", build.math("MAXIMUM", entry, fog.bottom), fog.top)
        tau, depth = fog.above(entry), fog.along(entry, mu, length)
        opacity = build.math("SUBTRACT", 1.0, build.math("EXPONENT", build.math("MULTIPLY", depth, -1.0)))
        light = [build.scale(build.vector("MULTIPLY", irradiance, inputs["sun_tint"]),
                             build.math("MULTIPLY", phase, scattered(build, tau, depth, mu, mu0))) for _, mu0, phase, irradiance in lights]
        if sky:
            light.append(build.scale(inputs["Sky radiance"], sky_light(build, tau, depth, mu, inputs["g"])))
        airlight = build.vector("MULTIPLY", inputs["albedo"], vector_sum(build, light)) if light else (0.0, 0.0, 0.0)
        end = build.math("MULTIPLY_ADD", distance, mu, z)
        lit = _lit_share(build, fog.above(end), lights, inputs["Sky radiance"] if sky else None, hit)

    foggy = build.math("SUBTRACT", 1.0, build.math("MULTIPLY", build.math("LESS_THAN", inputs["cutoff_distance"], 0.999 * FAR),
                                                   build.math("GREATER_THAN", distance, inputs["cutoff_distance"])))
    share = build.math("MINIMUM", build.math("DIVIDE", inputs["max_opacity"], build.math("MAXIMUM", opacity, 1e-9)), 1.0)
    share = build.math("MULTIPLY", share, foggy)
    passed = build.math("MULTIPLY_ADD", build.math("MULTIPLY", opacity, share), -1.0, 1.0)
    seen = image
    if lit is not None:
        white = build.scale((1.0, 1.0, 1.0), build.math("SUBTRACT", 1.0, foggy))
        seen = build.vector("MULTIPLY", image, build.vector("ADD", build.scale(lit, foggy), white))
    return with_alpha(build, image, build.vector("ADD", build.scale(seen, passed), build.scale(airlight, share)), passed)


def _depth_opacity(build: Tree, inputs: Mapping[str, Socket], profile: str, distance: Socket) -> Socket:
    behind = build.math("MAXIMUM", build.math("SUBTRACT", distance, inputs["start"]), 0.0)
    if profile == "linear":
        width = build.math("MAXIMUM", build.math("SUBTRACT", inputs["end"], inputs["start"]), 1e-6)
        return build.math("MINIMUM", build.math("DIVIDE", behind, width), 1.0)
    depth = build.math("MULTIPLY", extinction(build, inputs), behind)
    if profile == "exp2":
        depth = build.math("MINIMUM", depth, 1e3)
        depth = build.math("MULTIPLY", depth, depth)
    return build.math("SUBTRACT", 1.0, build.math("EXPONENT", build.math("MULTIPLY", depth, -1.0)))


def _lit_share(build: Tree, tau: Socket, lights: Sequence[tuple], sky: Socket | None, hit: Socket) -> Socket | None:
    """depth_fog.lit_share per channel where there is a surface, 1 before the background."""
    clear, dimmed = [], []
    for up, mu0, _, irradiance in lights:
        level = build.math("MULTIPLY", up, mu0)
        clear.append(build.scale(irradiance, level))
        passed = build.math("EXPONENT", build.math("MULTIPLY", build.math("DIVIDE", tau, mu0), -1.0))
        dimmed.append(build.scale(irradiance, build.math("MULTIPLY", level, passed)))
    if sky is not None:
        clear.append(build.scale(sky, math.pi))
        dimmed.append(build.scale(sky, build.math("MULTIPLY", _sky_transmittance(build, tau), math.pi)))
    if not clear:
        return None
    whole = build.vector("MAXIMUM", vector_sum(build, clear), (1e-20,) * 3)
    share = build.vector("DIVIDE", build.vector("MAXIMUM", vector_sum(build, dimmed), (0.0,) * 3), whole)
    background = build.scale((1.0, 1.0, 1.0), build.math("SUBTRACT", 1.0, hit))
    return build.vector("ADD", build.scale(share, hit), background)
