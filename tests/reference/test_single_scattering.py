# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadrature against closed forms and against a slow, literal integral of the textbook formula."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from volumetrics_addon.reference import optics, path_tracing, single_scattering
from volumetrics_addon.scene.model import (
    Box, Camera, Cone, Dielectric, Ellipsoid, ExponentialHeight, Homogeneous, Medium, NoiseShape, Phase, Point, Projector, Scene,
    Spot, Sun, Surface, Volume, normalized,
)

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(50.0))
HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
BLOCKER = Surface(Box((0.0, 0.0, 1.2), (0.4, 0.6, 0.1)), (0.0, 0.0, 0.0))


def hg(cosine, g):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def chord(box, origin, direction, limit):
    """Length inside the box within [0, limit], one axis at a time."""
    low, high = 0.0, limit
    for k in range(3):
        if direction[k] == 0.0:
            continue
        a, b = sorted(((s * box.half[k] + box.center[k] - origin[k]) / direction[k] for s in (-1, 1)))
        low, high = max(low, a), min(high, b)
    return max(0.0, high - low)


def literal(scene, origin, direction, light, channel):
    """Single scattering of one light in one homogeneous box, occluded by one ball or nothing, by adaptive quadrature."""
    volume = scene.volumes[0]
    sigma_s, sigma_t = volume.medium.sigma_s[channel], volume.medium.sigma_t[channel]

    def integrand(t):
        x = origin + t * direction
        if isinstance(light, Sun):
            toward, distance, irradiance = -np.array(light.direction), math.inf, light.irradiance[channel]
        else:
            offset = np.array(light.position) - x
            distance = math.hypot(*offset)
            toward = offset / distance
            irradiance = light.power[channel] / (4 * math.pi * distance**2)
            if isinstance(light, Spot):
                c = math.cos(light.cone_angle / 2)
                s = min(max((-(toward @ np.array(light.direction)) - c) / ((1 - c) * light.blend), 0.0), 1.0)
                irradiance *= s * s * (3 - 2 * s)
        for surface in scene.surfaces:
            if chord(surface.shape, x, toward, distance) > 0.0:
                return 0.0
        depth = sigma_t * (chord(volume.domain, origin, direction, t) + chord(volume.domain, x, toward, distance))
        return sigma_s * hg(toward @ direction, volume.medium.phase.g0) * irradiance * math.exp(-depth)

    near = (-volume.domain.half[1] - origin[1]) / direction[1]  # all rays enter through the face y = -2
    far = near + chord(volume.domain, origin, direction, math.inf)
    edges = np.linspace(near, far, 401)
    total = 0.0
    for a, b in zip(edges, edges[1:]):  # short pieces, so that no shadow edge is missed
        total += quad(integrand, a, b, epsabs=1e-12, epsrel=1e-9, limit=50)[0]
    return total


LIGHTS = {
    "sun": Sun(normalized((0.3, 0.2, -1.0)), (3.0, 2.0, 1.0)),
    "point": Point((0.5, -0.3, 1.7), (30.0, 20.0, 10.0)),
    "spot": Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4),
}


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")  # at the shadow edges of the literal formula
@pytest.mark.parametrize("blocked", [False, True], ids=["clear", "blocked"])
@pytest.mark.parametrize("kind", LIGHTS)
def test_equals_the_literal_integral(kind, blocked):
    light = LIGHTS[kind]
    scene = Scene(CAMERA, (light,), volumes=(Volume(BOX, HAZE),), surfaces=(BLOCKER,) if blocked else ())
    origin = np.array(CAMERA.position)
    directions = [normalized(d) for d in ((0.05, 1.0, 0.02), (-0.12, 1.0, -0.1))]
    value, _ = single_scattering.radiance(scene, np.tile(origin, (2, 1)), np.array(directions), np.random.default_rng(0))
    for row, direction in zip(value, directions):
        expected = literal(scene, origin, np.array(direction), light, 1)
        # The literal integral misses shadow edges by up to 1e-3 of a piece of 1/400 of the ray.
        assert row[1] == pytest.approx(expected, rel=2e-5 if blocked else 1e-7)


def test_sixteen_evaluations_reach_a_millionth():
    """A point light close to the rays in a thin to moderate medium, against 256 nodes: relative RMSE over the image.

    Rays that pass the light within a fortieth of their length take up to five sets of nodes; they are a few in a hundred.
    """
    rng = np.random.default_rng(1)
    count = 2000
    origin = np.tile(CAMERA.position, (count, 1))
    direction = rng.normal(size=(count, 3)) * (0.15, 0.0, 0.15) + (0.0, 1.0, 0.0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    inside = Ellipsoid((0.0, 0.0, 0.0), (3.0, 3.0, 3.0))
    scene = Scene(CAMERA, (Point((0.1, 0.2, 0.1), (10.0, 10.0, 10.0)),), volumes=(Volume(inside, HAZE),))
    sixteen, evaluations = single_scattering.radiance(scene, origin, direction, rng, 16)
    many, _ = single_scattering.radiance(scene, origin, direction, rng, 256)
    assert evaluations < 16 * count * 1.1
    assert math.sqrt(((sixteen - many) ** 2).mean()) < 1e-6 * many.mean()


def test_slab_seen_and_lit_along_its_normal():
    """Sun behind the camera through a slab: L = sigma_s p(-1) E (1 - exp(-2 sigma_t d)) / (2 sigma_t)."""
    sun = Sun((0.0, 1.0, 0.0), (5.0, 5.0, 5.0))
    scene = Scene(CAMERA, (sun,), volumes=(Volume(Box((0, 0, 0), (50.0, 1.5, 50.0)), HAZE),))
    value, _ = single_scattering.radiance(scene, np.array([CAMERA.position]), np.array([[0.0, 1.0, 0.0]]), np.random.default_rng(0))
    for c in range(3):
        sigma_t = HAZE.sigma_t[c]
        expected = HAZE.sigma_s[c] * hg(-1.0, 0.5) * 5.0 * -math.expm1(-2 * sigma_t * 3.0) / (2 * sigma_t)
        assert value[0, c] == pytest.approx(expected, rel=1e-12)


def test_surface_behind_the_medium():
    """A white wall facing sun and camera: E cos / pi attenuated both ways, plus nothing scattered."""
    absorber = Medium((0.0, 0.0, 0.0), (0.3, 0.2, 0.1))
    sun = Sun(normalized((0.0, 1.0, -1.0)), (math.pi, math.pi, math.pi))
    wall = Surface(Box((0.0, 3.0, 0.0), (50.0, 0.0, 50.0)), (1.0, 1.0, 1.0))
    scene = Scene(CAMERA, (sun,), volumes=(Volume(Box((0, 0, 0), (50.0, 1.0, 50.0)), absorber),), surfaces=(wall,))
    value, _ = single_scattering.radiance(scene, np.array([CAMERA.position]), np.array([[0.0, 1.0, 0.0]]), np.random.default_rng(0))
    for c, sigma in enumerate(absorber.sigma_a):
        assert value[0, c] == pytest.approx(math.sqrt(0.5) * math.exp(-sigma * 2 * (1 + math.sqrt(2))), rel=1e-12)


def test_height_fog_depth_against_quadrature():
    fog = Volume(Box((0, 0, 4.9), (30.0, 30.0, 5.0)), replace(HAZE, density=ExponentialHeight(1.3, 0.2)))
    rng = np.random.default_rng(6)
    origin, direction = rng.uniform(-6, 6, (20, 3)), rng.normal(size=(20, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    limit = rng.uniform(1.0, 40.0, 20)
    depth = optics.density_depth(fog, origin, direction, limit)
    for o, d, end, value in zip(origin, direction, limit, depth):
        def density(t):
            x = o + t * d
            inside = all(abs(x[k] - fog.domain.center[k]) <= fog.domain.half[k] for k in range(3))
            return math.exp(-(x[2] - 0.2) / 1.3) if inside else 0.0
        cuts = [0.0, end]
        for k in range(3):
            cuts += [(fog.domain.center[k] + s * fog.domain.half[k] - o[k]) / d[k] for s in (-1, 1)]
        cuts = sorted(min(max(c, 0.0), end) for c in cuts)
        expected = sum(quad(density, a, b)[0] for a, b in zip(cuts, cuts[1:]))
        assert value == pytest.approx(expected, rel=1e-9, abs=1e-12)


def scenes_for_the_path_tracer():
    fog = Medium((0.3, 0.3, 0.35), (0.1, 0.05, 0.02), Phase(0.6, -0.2, 0.3), ExponentialHeight(1.0, -1.0))
    floor = Surface(Box((0.0, 0.0, -1.0), (6.0, 6.0, 0.0)), (0.5, 0.4, 0.3))
    ball = Surface(Ellipsoid((0.4, 0.0, -0.3), (0.5, 0.5, 0.5)), (0.2, 0.5, 0.7))
    yield "fog", Scene(CAMERA, (LIGHTS["sun"],), (0.2, 0.3, 0.5), (Volume(Box((0, 0, 0.48), (4, 4, 1.5)), fog),), (floor, ball))
    beam = Cone((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), math.radians(27.0), 5.0)
    # The lamp stays out of the picture: next events close to it have a variance without bound.
    low = Camera((0.0, -6.0, -0.6), (0.0, 1.0, 0.0), math.radians(26.0))
    yield "spot", Scene(low, (LIGHTS["spot"],), volumes=(Volume(beam, HAZE),), surfaces=(floor, BLOCKER))
    yield "overlap", Scene(CAMERA, (LIGHTS["sun"],), (0.1, 0.1, 0.1),
                           (Volume(BOX, HAZE), Volume(Ellipsoid((1.0, 0.0, 0.5), (1.5, 1.0, 1.0)), replace(HAZE, phase=Phase(-0.3)))))


@pytest.mark.parametrize("name, scene", list(scenes_for_the_path_tracer()), ids=lambda value: value if isinstance(value, str) else "")
def test_path_tracing_of_one_order_agrees(name, scene):
    """Two integrators with nothing in common but the scene: means within four of their joint standard errors."""
    exact = single_scattering.render(scene, 12, 12, repeats=4, strata=4, seed=1)
    traced = path_tracing.render(scene, 12, 12, repeats=8, strata=10, seed=2)
    difference = traced.image.mean(axis=(0, 1)) - exact.image.mean(axis=(0, 1))
    spread = np.sqrt(sum(r.repeats.mean(axis=(1, 2)).var(axis=0, ddof=1) / len(r.repeats) for r in (exact, traced)))
    assert (np.abs(difference) < 4.5 * spread).all()
    assert (spread / exact.image.mean(axis=(0, 1)) < 0.02).all()  # the comparison is worth something


def test_refuses_what_it_cannot_render():
    volume = Volume(BOX, HAZE)
    cases = {
        "orders": Scene(CAMERA, volumes=(volume,), orders=2),
        "refracts": Scene(CAMERA, volumes=(replace(volume, boundary=Dielectric(1.5)),)),
        "exponential in height": Scene(CAMERA, volumes=(replace(volume, medium=replace(HAZE, density=NoiseShape(
            (0, 0, 0), (1, 1, 1), 1.0, 1.0, 0.5, 1.0, 0.5, 0.5, 0))),)),
        "emitting": Scene(CAMERA, volumes=(volume,), surfaces=(Surface(BOX, (0, 0, 0), (1, 1, 1)),)),
    }
    for word, scene in cases.items():
        with pytest.raises(ValueError, match=word):
            single_scattering.render(scene, 4, 4)


def test_states_an_error_that_covers_the_truth():
    """Many nodes and rays as the truth: the stated errors of a quick render cover it as a normal law does."""
    _, scene = next(scenes_for_the_path_tracer())
    truth = single_scattering.render(scene, 10, 10, repeats=16, strata=8, seed=3)
    quick = single_scattering.render(scene, 10, 10, repeats=16, strata=2, seed=4)
    z = (quick.image - truth.image) / np.sqrt(quick.error_estimate**2 + truth.error_estimate**2 + 1e-30)
    assert 0.7 < np.sqrt((z**2).mean()) < 1.4
    assert quick.systematic < 1e-3 * quick.image.mean()


GOBO = np.array([[0.0, 1.0, 0.3], [2.0, 0.5, 0.0], [0.2, 0.0, 1.5]])


def literal_projector(projector, x):
    """Irradiance of the rectangular projector with its gobo, in the plainest words."""
    forward = np.array(projector.direction)
    right = np.cross(forward, projector.up)
    right /= np.linalg.norm(right)
    offset = x - np.array(projector.position)
    depth = offset @ forward
    if not projector.near <= depth <= projector.far or depth <= 0.0:
        return 0.0
    u = offset @ right / depth / math.tan(projector.horizontal_fov / 2)
    v = offset @ np.cross(right, forward) / depth / math.tan(projector.vertical_fov / 2)
    edge = (1.0 - max(abs(u), abs(v))) / projector.blend
    if edge <= 0.0:
        return 0.0
    edge = min(edge, 1.0)
    column = min(max((u + 1.0) / 2.0 * 3.0 - 0.5, 0.0), 2.0)
    row = min(max((1.0 - v) / 2.0 * 3.0 - 0.5, 0.0), 2.0)
    i, j = min(int(row), 1), min(int(column), 1)
    a, b = row - i, column - j
    shown = ((1 - a) * ((1 - b) * GOBO[i, j] + b * GOBO[i, j + 1]) + a * ((1 - b) * GOBO[i + 1, j] + b * GOBO[i + 1, j + 1]))
    return edge * edge * (3.0 - 2.0 * edge) * shown / math.hypot(*offset) ** projector.falloff / (4.0 * math.pi)


@pytest.mark.parametrize("falloff", [0, 1, 2])
def test_projector_with_gobo_equals_the_literal_integral(falloff):
    projector = Projector((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (0.0, 1.0, 0.0), (90.0, 60.0, 30.0), 1.0, 0.7, 1.2,
                          4.5, falloff, 0.3, gobo=GOBO)
    scene = Scene(CAMERA, (projector,), volumes=(Volume(BOX, HAZE),))
    origin, direction = np.array(CAMERA.position), np.array(normalized((0.05, 1.0, 0.02)))
    value, _ = single_scattering.radiance(scene, origin[None], direction[None], np.random.default_rng(0))
    near, far = (4.0 / direction[1], 8.0 / direction[1])
    steps = 20000
    total = 0.0
    for k in range(steps):
        t = near + (far - near) * (k + 0.5) / steps
        x = origin + t * direction
        offset = np.array(projector.position) - x
        distance = math.hypot(*offset)
        depth = HAZE.sigma_t[0] * (t - near + chord(BOX, x, offset / distance, distance))
        total += literal_projector(projector, x) * hg(offset @ direction / distance, 0.5) * math.exp(-depth)
    expected = 90.0 * HAZE.sigma_s[0] * total * (far - near) / steps
    # Measured: 7e-10 to 8e-10, the midpoint sum's own error.
    assert expected > 0.0
    assert value[0, 0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("density", [Homogeneous(), ExponentialHeight(0.7, -1.0)], ids=["homogeneous", "height"])
def test_ambient_light(density):
    """In one medium the integral of sigma_s L T is the albedo times L (1 - T), whatever the density."""
    medium = replace(HAZE, density=density, ambient=(1.0, 1.0, 3.0))
    scene = Scene(CAMERA, (), volumes=(Volume(BOX, medium),))
    origin, direction = np.array([CAMERA.position]), np.array([normalized((0.1, 1.0, 0.07))])
    value, _ = single_scattering.radiance(scene, origin, direction, np.random.default_rng(0))
    transmittance = np.exp(-optics.optical_depth(scene, origin, direction, np.inf))
    albedo = np.array(medium.sigma_s) / np.array(medium.sigma_t)
    np.testing.assert_allclose(value, albedo * (1.0, 1.0, 3.0) * (1.0 - transmittance), rtol=1e-12)
