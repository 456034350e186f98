# SPDX-License-Identifier: GPL-3.0-or-later
"""Compositor nodes of air from the depth of each pixel: the formulas of reference.depth_air as a node group.

Coefficients and scale heights are live; light scattered more than once is that of the air as it was when the group was made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import bpy

from ..physics.chapman import ERFCX
from ..reference.depth_air import DEGREE, SLICES, UPWARD, Closure, closure_of, planet_of_media
from ..scene.body import Body
from ..scene.families.air import PER_KILOMETRE
from .composited import NOTHING, Socket, choose, henyey_greenstein, sun_of, tree_of, vector_sum, view_of, with_alpha
from .nodes import Tree


def group(body: Body, orders: int, keep_background: bool, name: str) -> bpy.types.NodeTree:
    """The node group for the body's build-time values, under one sun; without ``keep_background`` it makes the sky too."""
    planet = planet_of_media([volume.medium for volume in body.volumes], body.volumes[0].domain, body.values["ground_albedo"])
    closure = closure_of(planet, orders, 1.0)
    return tree_of(body.family, 1, name, lambda build, inputs: _picture(build, inputs, body, closure, keep_background))


class _Constituent:
    """Molecules or aerosol: coefficients at the ground, density and way to the sun, as nodes."""

    def __init__(self, build: Tree, scattering: Socket, extinction: Socket, height: Socket, radius: float):
        self.build, self.scattering, self.extinction, self.height = build, scattering, extinction, height
        x = build.math("DIVIDE", radius, height)
        self.level = build.math("MULTIPLY", build.math("SQRT", build.math("MULTIPLY", x, math.pi / 2.0)), ERFCX)
        self.slope = build.math("MULTIPLY", build.math("SQRT", build.math("MULTIPLY", x, math.pi / 2.0)), ERFCX - 1.0)
        self.square = build.math("MULTIPLY", x, math.pi / 2.0)

    def density(self, altitude: Socket) -> Socket:
        build = self.build
        return build.math("EXPONENT", build.math("MULTIPLY", build.math("DIVIDE", altitude, self.height), -1.0))

    def sun_depth(self, density: Socket, mu_s: Socket) -> Socket:
        """Optical depth towards the sun, a vector: H rho Ch."""
        build = self.build
        root = build.math("SQRT", build.math("MULTIPLY_ADD", build.math("MULTIPLY", mu_s, mu_s), self.square, ERFCX * ERFCX))
        way = build.math("DIVIDE", self.level, build.math("MULTIPLY_ADD", mu_s, self.slope, root))
        return build.scale(self.extinction, build.math("MULTIPLY", build.math("MULTIPLY", self.height, density), way))


def exponential(build: Tree, vector: Socket, sign: float) -> Socket:
    """exp(sign v) of each component, whose power is at most 80."""
    powers = [build.math("MINIMUM", build.math("MULTIPLY", c, sign), 80.0) for c in build.components(vector)]
    return build.combine(*(build.math("EXPONENT", power) for power in powers))


def _picture(build: Tree, inputs: Mapping[str, Socket], body: Body, closure: Closure, keep_background: bool) -> Socket:
    image, view = inputs["Image"], view_of(build, inputs)
    values = body.values
    radius, top = values["planet_radius"], values["thickness"]
    travel, irradiance = sun_of(build, inputs, 0)
    nu = build.math("MULTIPLY", build.scalar("DOT_PRODUCT", view.direction, travel), -1.0)

    rayleigh = build.scale(inputs["rayleigh_color"], build.math("MULTIPLY", inputs["rayleigh_scattering"], PER_KILOMETRE))
    mie = build.math("MULTIPLY", inputs["mie_extinction"], PER_KILOMETRE)
    molecules = _Constituent(build, rayleigh, rayleigh, inputs["rayleigh_scale_height"], radius)
    aerosol = _Constituent(build, build.scale(inputs["mie_albedo"], mie), build.combine(mie, mie, mie), inputs["mie_scale_height"],
                           radius)
    square = build.math("MULTIPLY", nu, nu)
    phases = (build.math("MULTIPLY_ADD", square, 3.0 / (16.0 * math.pi), 3.0 / (16.0 * math.pi)),
              henyey_greenstein(build, inputs["mie_g"], nu))

    # Altitude and zenith of the camera, in the form that keeps the digits of a position near the ground's origin.
    place = build.vector("SUBTRACT", view.origin, (0.0, 0.0, values["base_height"]))
    upward = build.vector("ADD", place, (0.0, 0.0, radius))
    start = build.scalar("LENGTH", upward)
    rise = build.math("MULTIPLY_ADD", build.components(place)[2], 2.0 * radius, build.scalar("DOT_PRODUCT", place, place))
    altitude = build.math("MAXIMUM", build.math("DIVIDE", rise, build.math("ADD", start, radius)), 0.0)
    zenith = build.vector("NORMALIZE", upward)
    mu = build.scalar("DOT_PRODUCT", zenith, view.direction)
    mu_s = build.math("MULTIPLY", build.scalar("DOT_PRODUCT", zenith, travel), -1.0)
    bend = build.math("DIVIDE", build.math("SUBTRACT", 0.5, build.math("MULTIPLY", build.math("MULTIPLY", mu, mu), 0.5)), start)

    # A ray that nothing stops ends with the air, or on the ground that nobody has built.
    above = build.math("MAXIMUM", build.math("SUBTRACT", top, altitude), 0.0)
    steep = build.math("MULTIPLY", mu, mu)
    leave = build.math("SQRT", build.math("MULTIPLY_ADD", build.math("MULTIPLY", above, bend), 4.0, steep))
    leave = build.math("DIVIDE", build.math("MULTIPLY", above, 2.0), build.math("ADD", mu, leave))
    under = build.math("SUBTRACT", steep, build.math("MULTIPLY", build.math("MULTIPLY", altitude, bend), 4.0))
    meets = build.math("MULTIPLY", build.math("LESS_THAN", mu, 0.0), build.math("GREATER_THAN", under, 0.0))
    meets = build.math("MULTIPLY", meets, build.math("SUBTRACT", 1.0, view.hit))
    ground = build.math("SUBTRACT", build.math("SQRT", build.math("MAXIMUM", under, 0.0)), mu)
    ground = build.math("DIVIDE", build.math("MULTIPLY", altitude, 2.0), build.math("MAXIMUM", ground, 1e-9))
    end = choose(build, meets, build.math("MINIMUM", ground, NOTHING), leave)
    end = build.math("MINIMUM", end, view.distance)

    light, clear = None, None
    for k in range(SLICES):
        low, high = (edge * edge / SLICES**2 for edge in (k, k + 1))
        s = build.math("MULTIPLY", end, (low + high) / 2.0)
        size = build.math("MULTIPLY", end, high - low)
        climb = build.math("MULTIPLY", s, build.math("MULTIPLY_ADD", s, bend, mu))
        h = build.math("MAXIMUM", build.math("ADD", altitude, climb), 0.0)
        sun = build.math("DIVIDE", build.math("MULTIPLY_ADD", s, nu, build.math("MULTIPLY", start, mu_s)),
                         build.math("ADD", start, build.math("SUBTRACT", h, altitude)))
        lit = build.math("GREATER_THAN", sun, 0.0)
        sun = build.math("MINIMUM", build.math("MAXIMUM", sun, 0.0), 1.0)
        densities = [part.density(h) for part in (molecules, aerosol)]
        scattered = [build.scale(part.scattering, density) for part, density in zip((molecules, aerosol), densities)]
        extinct = vector_sum(build, [build.scale(part.extinction, density) for part, density in zip((molecules, aerosol), densities)])
        depth = vector_sum(build, [part.sun_depth(density, sun) for part, density in zip((molecules, aerosol), densities)])
        arriving = build.scale(exponential(build, depth, -1.0), lit)
        single = vector_sum(build, [build.scale(amount, phase) for amount, phase in zip(scattered, phases)])
        source = build.vector("ADD", build.vector("MULTIPLY", single, arriving),
                              build.vector("MULTIPLY", _closure(build, closure, h, sun), vector_sum(build, scattered)))
        passed = exponential(build, build.scale(extinct, size), -1.0)
        # A slice without extinction is as long as it is.
        mean = build.vector("DIVIDE", build.vector("SUBTRACT", (1.0, 1.0, 1.0), passed), build.vector("MAXIMUM", extinct, (1e-12,) * 3))
        part = build.vector("MULTIPLY", source, mean)
        light = part if light is None else build.vector("ADD", light, build.vector("MULTIPLY", part, clear))
        clear = passed if clear is None else build.vector("MULTIPLY", clear, passed)

    # The lamp is the sun as it arrives at the ground; above the air it is brighter and less red.
    level = build.math("MINIMUM", build.math("MAXIMUM", build.math("MULTIPLY", build.components(travel)[2], -1.0), 0.0), 1.0)
    lost = vector_sum(build, [part.sun_depth(1.0, level) for part in (molecules, aerosol)])
    full = build.vector("MULTIPLY", irradiance, exponential(build, lost, 1.0))
    light = build.vector("MULTIPLY", light, full)

    seen = build.vector("MULTIPLY", image, clear)
    opaque = build.scalar("DOT_PRODUCT", clear, (1.0 / 3.0,) * 3)
    if not keep_background:
        return with_alpha(build, image, build.vector("ADD", seen, light), build.math("MULTIPLY", opaque, view.hit))
    color = build.vector("ADD", build.scale(build.vector("ADD", seen, light), view.hit),
                         build.scale(image, build.math("SUBTRACT", 1.0, view.hit)))
    return with_alpha(build, image, color, choose(build, view.hit, opaque, 1.0))


def _closure(build: Tree, closure: Closure, altitude: Socket, mu_s: Socket) -> Socket:
    """reference.depth_air.Closure: Horner in the root of the sun's cosine, then in the mass of air below."""
    if not closure.terms.any():
        return build.combine(0.0, 0.0, 0.0)
    root = build.math("SQRT", mu_s)
    x = build.combine(root, root, root)
    mass = build.math("SUBTRACT", 1.0, build.math("EXPONENT", build.math("MULTIPLY", altitude, -1.0 / closure.height)))
    u = build.combine(mass, mass, mass)

    def horner(variable: Socket, terms: list) -> Socket:
        value = terms[-1]
        for term in reversed(terms[:-1]):
            value = build.node("ShaderNodeVectorMath", {0: value, 1: variable, 2: term}, operation="MULTIPLY_ADD").outputs[0]
        return value

    rows = [horner(x, [tuple(map(float, closure.terms[i, j])) for j in range(DEGREE + 1)]) for i in range(UPWARD + 1)]
    return build.vector("MAXIMUM", horner(u, rows), (0.0, 0.0, 0.0))
