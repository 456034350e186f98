# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled quadrature against its NumPy twin: the same nodes, so they agree to rounding."""

import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import single_scattering
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Cone, Ellipsoid, ExponentialHeight, Grid, Medium, Phase, Point, Projector, RayleighPhase, Scene, Spot, Sun,
    Surface, Volume, normalized,
)

kernel_module = pytest.importorskip("volumetrics_addon.reference.quadrature_kernel", exc_type=ImportError)

CAMERA = Camera((0.3, -6.0, 0.2), normalized((0.0, 1.0, 0.02)), math.radians(60.0))
GREY = Medium((0.2, 0.2, 0.2), (0.05, 0.05, 0.05), Phase(0.5))
COLOURED = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.7, -0.3, 0.25))
FOG = Medium((0.2, 0.15, 0.1), (0.0, 0.05, 0.1), Phase(0.4), ExponentialHeight(0.8, -1.0))
AIR = Medium((0.1, 0.2, 0.3), (0.0, 0.0, 0.0), RayleighPhase())
ROOM = Box((0.0, 0.0, 0.0), (8.0, 8.0, 3.0))
BALL = Ellipsoid((0.5, 0.0, 0.0), (3.0, 2.5, 2.0))
CONE = Cone((0.0, 0.0, 2.5), (0.0, 0.0, -1.0), 0.6, 4.0)
POINT = Point((0.4, 0.1, 0.3), (100.0, 80.0, 60.0))
SPOT = Spot((-0.5, 0.0, 1.2), normalized((0.3, 0.1, -1.0)), (100.0, 80.0, 60.0), math.radians(50.0), 0.4)
HARD = replace(SPOT, blend=0.0)
SUN = Sun(normalized((0.3, 0.5, -0.8)), (1.0, 2.0, 3.0))
BLOCKER = Surface(Box((0.0, 0.0, 0.8), (0.4, 0.6, 0.1)), (0.3, 0.3, 0.3))

SCENES = {
    "point, grey box": (Scene(CAMERA, (POINT,), volumes=(Volume(ROOM, GREY),)), True),
    "spot, coloured ball": (Scene(CAMERA, (SPOT,), volumes=(Volume(BALL, COLOURED),)), True),
    "hard spot and point": (Scene(CAMERA, (HARD, POINT), volumes=(Volume(ROOM, COLOURED),)), True),
    "two media": (Scene(CAMERA, (POINT, SPOT), volumes=(Volume(ROOM, GREY), Volume(BALL, AIR))), True),
    "height fog": (Scene(CAMERA, (POINT,), volumes=(Volume(ROOM, FOG),)), True),
    "light outside": (Scene(CAMERA, (replace(POINT, position=(2.5, 0.0, 1.0)),), volumes=(Volume(CONE, GREY),)), False),
    "sun in fog": (Scene(CAMERA, (SUN,), volumes=(Volume(ROOM, FOG),)), False),
    "shadow": (Scene(CAMERA, (SPOT, SUN), volumes=(Volume(ROOM, COLOURED),), surfaces=(BLOCKER,)), False),
    "nothing scatters": (Scene(CAMERA, (POINT,), volumes=(Volume(ROOM, replace(GREY, sigma_s=(0.0, 0.0, 0.0))),)), True),
    "vacuum beside a medium": (Scene(CAMERA, (POINT,), volumes=(
        Volume(ROOM, Medium((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))), Volume(BALL, GREY))), True),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("order", [1, 4, 16])
def test_parity(name, order):
    scene, finds = SCENES[name]
    column, row = (index.ravel() + 0.5 for index in np.meshgrid(np.arange(24), np.arange(24)))
    origin, direction = geometry.camera_rays(scene.camera, 24, 24, column, row)
    hit, _ = geometry.first_hit(scene.surfaces, origin, direction, 1e-6)
    kernel = single_scattering.kernel_of(scene)
    assert kernel is not None and kernel.finds_intervals == finds
    compiled, count = single_scattering.in_scattering(scene, origin, direction, hit, order, kernel)
    plain, twin_count = single_scattering.in_scattering(scene, origin, direction, hit, order)
    assert plain.max() > 0.0 or name == "nothing scatters"
    # Rounding only, most of it at the ends of a spot's cone. Measured: at most 9e-13 of value and a tenth of the maximum.
    np.testing.assert_allclose(compiled, plain, rtol=1e-11, atol=1e-12 * plain.max())
    assert count == twin_count


def test_a_light_on_the_ray_and_at_the_camera_stays_finite():
    for position in (CAMERA.position, tuple(np.add(CAMERA.position, np.multiply(CAMERA.direction, 2.0)))):
        scene = Scene(CAMERA, (Point(position, (1.0, 1.0, 1.0)),), volumes=(Volume(ROOM, GREY),))
        image = single_scattering.render(scene, 5, 5, strata=0).image
        assert np.isfinite(image).all() and (image > 0.0).all()


@pytest.mark.parametrize("change", [
    {"volumes": (Volume(ROOM, replace(GREY, density=Grid(np.ones((2, 2, 2)), (-8, -8, -3), (8, 8, 3)))),)},
    {"lights": (Projector((0, 0, 2), (0, 0, -1), (0, 1, 0), (1, 1, 1), 1.0, 1.0),)},
])
def test_what_it_does_not_know_is_left_to_the_twin(change):
    scene = replace(SCENES["point, grey box"][0], **change)
    assert single_scattering.kernel_of(scene) is None
    with pytest.raises(ValueError, match="NumPy twin"):
        kernel_module.Kernel(scene)
