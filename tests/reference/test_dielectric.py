# SPDX-License-Identifier: GPL-3.0-or-later
"""Refraction against closed forms: Fresnel, the plate, the ball."""

import math

import numpy as np
import pytest

from volumetrics_addon.reference import dielectric
from volumetrics_addon.scene.model import (
    Box, Camera, Dielectric, Ellipsoid, Medium, Scene, Surface, Volume, normalized, turned,
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
