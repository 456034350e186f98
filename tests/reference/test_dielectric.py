# SPDX-License-Identifier: GPL-3.0-or-later
"""Refraction against closed forms: Fresnel, the plate, the ball."""

import math

import numpy as np
import pytest

from volumetrics_addon.reference import dielectric
from volumetrics_addon.scene.model import (
    Box, Camera, Cover, Dielectric, Ellipsoid, Medium, Point, Scene, Sheet, Sun, Surface, Volume, normalized, turned,
)

CAMERA = Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(40.0))
SIGMA = (1.2, 0.4, 0.0)


def solid(shape, ior=1.5, sigma=SIGMA):
    return Volume(shape, Medium((0.0, 0.0, 0.0), sigma), Dielectric(ior))


def reflectance(cosine, n):
    """Fresnel's equations with both angles, as in a textbook."""
    inside = math.asin(math.sin(math.acos(cosine)) / n)
    outside = math.acos(cosine)
    if outside == 0.0:
        return ((n - 1) / (n + 1)) ** 2
    s = (math.sin(outside - inside) / math.sin(outside + inside)) ** 2
    p = (math.tan(outside - inside) / math.tan(outside + inside)) ** 2
    return (s + p) / 2


@pytest.mark.parametrize("cosine", [1.0, 0.9, 0.5, 0.1, 0.01])
@pytest.mark.parametrize("ior", [1.1, 1.5, 2.4])
def test_fresnel(cosine, ior):
    r, refracted = dielectric.fresnel(np.array([cosine]), np.array([ior]))
    assert r[0] == pytest.approx(reflectance(cosine, ior), rel=1e-9)
    assert refracted[0] == pytest.approx(math.cos(math.asin(math.sin(math.acos(cosine)) / ior)), rel=1e-12)


def test_fresnel_limits():
    r, _ = dielectric.fresnel(np.array([0.0, 0.3, 1.0, 0.0]), np.array([1.5, 1 / 1.5, 1.0, 1.0]))
    assert r == pytest.approx([1.0, 1.0, 0.0, 0.0])  # grazing, total, no interface, no interface grazing


@pytest.mark.parametrize("ior", [1.0, 1.33, 1.5])
@pytest.mark.parametrize("impact", [0.0, 0.4, 0.9])
def test_ball_under_uniform_light(ior, impact):
    """All inner chords of a ball are equal: L = R + (1 - R)^2 T / (1 - R T), with T = exp(-sigma 2 r cos)."""
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(solid(Ellipsoid((0, 0, 0), (1, 1, 1)), ior),))
    value, lost, _ = dielectric.radiance(scene, np.array([[impact, -4.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    r = reflectance(math.sqrt(1 - impact**2), ior)
    chord = 2 * math.sqrt(1 - (impact / ior) ** 2)
    for c, sigma in enumerate(SIGMA):
        t = math.exp(-sigma * chord)
        assert value[0, c] == pytest.approx(r + (1 - r) ** 2 * t / (1 - r * t), abs=1e-6 + lost[0, c])


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2])
def test_plate_transmits_and_reflects(angle):
    """A bright wall behind a wide plate: T = (1 - R)^2 t / (1 - R^2 t^2); the wall's mirror image is dark."""
    plate = Box((0.0, 0.0, 0.0), (500.0, 0.25, 500.0))
    wall = Surface(Box((0.0, 50.0, 0.0), (500.0, 0.0, 500.0)), (0, 0, 0), (1.0, 1.0, 1.0))
    scene = Scene(CAMERA, volumes=(solid(plate),), surfaces=(wall,))
    direction = np.array([[math.sin(angle), math.cos(angle), 0.0]])
    value, _, _ = dielectric.radiance(scene, np.array([[0.0, -4.0, 0.0]]), direction)
    r = reflectance(math.cos(angle), 1.5)
    path = 0.5 / math.sqrt(1 - (math.sin(angle) / 1.5) ** 2)
    for c, sigma in enumerate(SIGMA):
        t = math.exp(-sigma * path)
        assert value[0, c] == pytest.approx((1 - r) ** 2 * t / (1 - (r * t) ** 2), abs=2e-6)


@pytest.mark.parametrize("shape", [Ellipsoid((0, 0, 0), (1.0, 0.6, 0.8)), Box((0, 0, 0), (0.8, 0.6, 0.7), turned(0.5))],
                         ids=["ellipsoid", "block"])
def test_clear_glass_conserves_energy(shape):
    """Without absorption under uniform light of radiance 1 every ray sees 1, but for what was cut."""
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(solid(shape, 1.5, (0.0, 0.0, 0.0)),))
    result = dielectric.render(scene, 12, 12, repeats=2, strata=1)
    assert (result.image <= 1.0 + 1e-9).all()
    assert 1.0 - result.image.mean() <= result.systematic + 1e-9
    assert result.systematic < 0.05  # light caught by total reflection in the clear block, stated


def test_camera_inside_is_outside_of_nothing():
    """A ray that misses everything sees the environment."""
    scene = Scene(CAMERA, environment=(0.3, 0.2, 0.1), volumes=(solid(Ellipsoid((0, 0, 0), (1, 1, 1))),))
    value, _, _ = dielectric.radiance(scene, np.array([[3.0, -4.0, 0.0]]), np.array([normalized((0.0, 1.0, 0.0))]))
    assert value[0] == pytest.approx((0.3, 0.2, 0.1))


def test_refuses_scattering_and_diffuse_surfaces():
    scattering = Volume(Ellipsoid((0, 0, 0), (1, 1, 1)), Medium((1, 1, 1), (0, 0, 0)), Dielectric(1.5))
    with pytest.raises(ValueError, match="scatters"):
        dielectric.render(Scene(CAMERA, volumes=(scattering,)), 4, 4)
    lit = Scene(CAMERA, volumes=(solid(Ellipsoid((0, 0, 0), (1, 1, 1))),),
                surfaces=(Surface(Box((0, 0, -2), (5, 5, 0)), (0.5, 0.5, 0.5)),))
    with pytest.raises(ValueError, match="diffuse"):
        dielectric.render(lit, 4, 4)


# --- thin panes -------------------------------------------------------------------------------------------------


def sheet(thickness=0.5, ior=1.5, cover=None, sigma=SIGMA, half=(500.0, 0.0, 500.0), center=(0.0, 0.0, 0.0)):
    return Volume(Box(center, half), Medium((0.0, 0.0, 0.0), sigma), ior and Dielectric(ior), sheet=Sheet(thickness, cover))


def bounced(r, t, orders=200):
    """Shares that a plate mirrors and lets through, bounce by bounce."""
    through, mirrored, inside = 0.0, r, (1 - r) * t
    for _ in range(orders):
        through += inside * (1 - r)
        inside *= r * t
        mirrored += inside * (1 - r)
        inside *= r * t
    return mirrored, through


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.4])
@pytest.mark.parametrize("ior", [1.33, 1.5, 2.4])
def test_a_pane_is_a_plate_bounce_by_bounce(angle, ior):
    """A wall of radiance 1 behind, one of radiance 5 in front: T + 5 R, summed over the bounces."""
    walls = tuple(Surface(Box((0.0, y, 0.0), (5e3, 0.0, 5e3)), (0, 0, 0), (e, e, e)) for y, e in ((50.0, 1.0), (-50.0, 5.0)))
    scene = Scene(CAMERA, volumes=(sheet(ior=ior),), surfaces=walls)
    direction = np.array([[math.sin(angle), math.cos(angle), 0.0]])
    value, _, _ = dielectric.radiance(scene, np.array([[0.0, -4.0, 0.0]]), direction)
    r, path = reflectance(math.cos(angle), ior), 0.5 / math.sqrt(1 - (math.sin(angle) / ior) ** 2)
    for c, sigma in enumerate(SIGMA):
        mirrored, through = bounced(r, math.exp(-sigma * path))
        assert value[0, c] == pytest.approx(through + 5 * mirrored, rel=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1.2])
def test_a_pane_without_refraction_is_a_straight_path(angle):
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(sheet(ior=None),))
    value, _, _ = dielectric.radiance(scene, np.array([[0.0, -4.0, 0.0]]), np.array([[math.sin(angle), math.cos(angle), 0.0]]))
    assert value[0] == pytest.approx([math.exp(-sigma * 0.5 / math.cos(angle)) for sigma in SIGMA])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_stack_of_clear_panes_conserves_energy(count):
    """All light of a uniform environment comes out again, whatever is mirrored between the panes."""
    panes = tuple(sheet(sigma=(0.0,) * 3, center=(0.0, float(k), 0.0)) for k in range(count))
    value, lost, _ = dielectric.radiance(Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=panes),
                                         np.array([[0.0, -4.0, 0.0]]), np.array([[0.6, 0.8, 0.0]]))
    assert value[0] == pytest.approx([1.0] * 3, abs=1e-4) and (1.0 - value[0] <= lost[0] + 1e-12).all()


def test_a_uniform_cover_is_a_plain_mix():
    """Black cover over a share c of a pane before a wall: (1 - c) T; a cover of albedo a under uniform light 1 adds c a."""
    wall = Surface(Box((0.0, 50.0, 0.0), (5e3, 0.0, 5e3)), (0, 0, 0), (1.0, 1.0, 1.0))
    ray = np.array([[0.0, -4.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    clean = dielectric.radiance(Scene(CAMERA, volumes=(sheet(),), surfaces=(wall,)), *ray)[0]
    black = Cover("uniform", 0.3, (0.0, 0.0, 0.0))
    dim = dielectric.radiance(Scene(CAMERA, volumes=(sheet(cover=black),), surfaces=(wall,)), *ray)[0]
    assert dim == pytest.approx(0.7 * clean)
    dusty = sheet(cover=Cover("uniform", 0.3, (0.5, 0.4, 0.2)), sigma=(0.0,) * 3)
    pale = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(dusty,))
    rng = np.random.default_rng(3)
    value = dielectric.radiance(pale, np.repeat(ray[0], 50, 0), np.repeat(ray[1], 50, 0), 1e-6, rng)[0]
    # Half of the cover's light goes where the camera is: the environment lights it from there, unattenuated.
    assert value.mean(axis=0) == pytest.approx([0.7 + 0.3 * a for a in (0.5, 0.4, 0.2)], abs=1e-5)


def seen_below(scene):
    """Radiance from the floor at the origin, seen from above it below the pane."""
    return dielectric.radiance(scene, np.array([[0.0, 0.0, 0.5]]), np.array([[0.0, 0.0, -1.0]]), 1e-6, np.random.default_rng(1))[0]


@pytest.mark.parametrize("lamp", ["sun", "point"])
def test_a_lamp_shines_straight_through_a_pane(lamp):
    """On a speck of albedo a below a level pane: a / pi E cos T(cos); what it sends up, the pane mirrors beside it."""
    floor = Surface(Box((0.0, 0.0, 0.0), (1e-4, 1e-4, 0.0)), (0.6, 0.5, 0.4))
    level = sheet(half=(50.0, 50.0, 0.0), center=(0.0, 0.0, 1.0))
    if lamp == "sun":
        light, cosine, irradiance = Sun(normalized((0.6, 0.0, -0.8)), (2.0, 2.0, 2.0)), 0.8, 2.0
    else:
        light, cosine = Point((-3.0, 0.0, 4.0), (100.0, 100.0, 100.0)), 0.8
        irradiance = 100.0 / (4 * math.pi) / 25.0
    scene = Scene(CAMERA, (light,), volumes=(level,), surfaces=(floor,))
    value = seen_below(scene)
    r, path = reflectance(cosine, 1.5), 0.5 / math.sqrt(1 - (0.6 / 1.5) ** 2)
    for c, (sigma, albedo) in enumerate(zip(SIGMA, (0.6, 0.5, 0.4))):
        _, through = bounced(r, math.exp(-sigma * path))
        assert value[0, c] == pytest.approx(albedo / math.pi * irradiance * cosine * through, rel=1e-9)


def test_a_diffuse_floor_by_a_pane_is_lit_by_what_is_behind_it():
    """A floor under a uniform sky, through a clear pane without refraction, sees all of it: albedo times 1."""
    floor = Surface(Box((0.0, 0.0, 0.0), (5.0, 5.0, 0.0)), (0.6, 0.5, 0.4))
    level = sheet(ior=None, sigma=(0.0,) * 3, half=(50.0, 50.0, 0.0), center=(0.0, 0.0, 1.0))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(level,), surfaces=(floor,))
    value = seen_below(scene)
    assert value[0] == pytest.approx([0.6, 0.5, 0.4])
