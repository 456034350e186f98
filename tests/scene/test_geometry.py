# SPDX-License-Identifier: GPL-3.0-or-later
"""Intervals against membership of points, tested point by point."""

import math

import numpy as np
import pytest

from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import Box, Camera, Cone, Ellipsoid, Surface, look_frame, normalized, turned

TILTED = look_frame(normalized((0.3, -0.8, 0.5)))
SHAPES = [
    Box((0.2, -0.1, 0.4), (1.0, 0.5, 0.7), turned(0.6)),
    Box((0.2, -0.1, 0.4), (1.0, 0.5, 0.7), TILTED),
    Ellipsoid((0.1, 0.3, -0.2), (0.9, 0.4, 1.3), TILTED),
    Cone((0.0, 0.5, 1.5), normalized((0.2, -0.3, -1.0)), 0.5, 2.5),
    Cone((0.0, 0.5, 1.5), normalized((0.2, -0.3, -1.0)), 1.2, 1.0),
]


def contains(shape, point):
    """Membership of one point, written out."""
    if isinstance(shape, Cone):
        offset = [p - a for p, a in zip(point, shape.apex)]
        along = sum(o * a for o, a in zip(offset, shape.axis))
        return 0.0 <= along <= shape.length and along >= math.hypot(*offset) * math.cos(shape.half_angle)
    offset = [p - c for p, c in zip(point, shape.center)]
    local = [sum(o * a for o, a in zip(offset, axis)) / h for axis, h in zip(shape.axes, shape.half)]
    if isinstance(shape, Box):
        return max(abs(x) for x in local) <= 1.0
    return math.hypot(*local) <= 1.0


def rays(count, seed=0):
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-3.0, 3.0, (count, 3))
    direction = rng.normal(size=(count, 3))
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_interval_is_where_points_are_inside(shape):
    origin, direction = rays(200)
    near, far = geometry.interval(shape, origin, direction)
    hits = 0
    for o, d, a, b in zip(origin, direction, near, far):
        for t in np.linspace(-6.0, 6.0, 61):
            if min(abs(t - a), abs(t - b)) > 1e-9:
                assert contains(shape, o + t * d) == (a < t < b)
        hits += a < b
    assert hits > 12  # the rays do meet the shape


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0)])
def test_rays_along_the_axes(direction):
    origin = np.array([[0.05, 0.02, 0.01]])
    near, far = geometry.interval(Box((0, 0, 0), (1.0, 1.0, 1.0)), origin, np.array([direction], float))
    middle = -float(np.dot(origin[0], direction))
    assert near[0] == pytest.approx(middle - 1.0) and far[0] == pytest.approx(middle + 1.0)


def test_a_ray_beside_a_parallel_face_misses():
    near, far = geometry.interval(Box((0, 0, 0), (1.0, 1.0, 1.0)), np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]))
    assert near[0] > far[0]


def test_cone_along_its_own_mantle_axis_and_from_the_apex():
    cone = Cone((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.4, 2.0)
    directions = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [math.sin(0.2), 0.0, -math.cos(0.2)]])
    near, far = geometry.interval(cone, np.zeros((3, 3)), directions)
    np.testing.assert_allclose(near, [0.0, -2.0, 0.0], atol=1e-9)  # the whole line: the second one points away
    np.testing.assert_allclose(far, [2.0, 0.0, 2.0 / math.cos(0.2)], atol=1e-9)


@pytest.mark.parametrize("parallel", [False, True], ids=["point", "sun"])
@pytest.mark.parametrize("shape", [
    Box((0.2, -0.1, 0.4), (0.5, 0.3, 0.4), TILTED),
    Box((0.2, -0.1, 0.4), (0.5, 0.3, 0.0), TILTED),
    Ellipsoid((0.1, 0.3, -0.2), (0.5, 0.3, 0.7), TILTED),
], ids=["box", "plane", "ellipsoid"])
def test_shadow_interval_is_where_the_light_is_hidden(shape, parallel):
    surface = Surface(shape, (0.5, 0.5, 0.5))
    origin, direction = rays(300, seed=3)
    light = np.array(normalized((0.3, 0.5, -1.0))) if parallel else np.array([0.7, -0.6, 2.5])
    low, high = geometry.shadow_interval(surface, origin, direction, light, parallel)
    shaded = 0
    for t in np.linspace(-5.0, 5.0, 81):
        position = origin + t * direction
        toward = np.broadcast_to(-light, position.shape) if parallel else light - position
        distance = np.linalg.norm(toward, axis=1)
        near, far = geometry.interval(shape, position, toward / distance[:, None])
        limit = np.inf if parallel else distance
        hidden = (near <= far) & (far > 1e-9) & (near < limit)
        clear_of_edges = np.minimum(np.abs(t - low), np.abs(t - high)) > 1e-6
        claimed = (low < t) & (t < high)
        assert (claimed == hidden)[clear_of_edges].all()
        shaded += hidden.sum()
    assert shaded > 100


def test_camera_rays_span_the_field_of_view():
    camera = Camera((1.0, 2.0, 3.0), normalized((0.0, 1.0, 0.0)), math.radians(60.0))
    origin, direction = geometry.camera_rays(camera, 200, 100, np.array([0.0, 200.0, 100.0, 100.0]), np.array([50.0, 50.0, 0.0, 50.0]))
    assert origin[0] == pytest.approx((1.0, 2.0, 3.0))
    assert math.degrees(math.acos(direction[0] @ direction[1])) == pytest.approx(60.0)
    assert direction[0][0] < 0.0 < direction[1][0]  # left to right
    assert direction[2][2] > 0.0  # row 0 is at the top
    assert direction[3] == pytest.approx((0.0, 1.0, 0.0))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_lowest_point(shape):
    """No vertical line enters the shape below it, and one comes close."""
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-4, 4, 401), np.linspace(-4, 4, 401)))
    near, far = geometry.interval(shape, np.stack([x, y, 0 * x], axis=1), np.tile((0.0, 0.0, 1.0), (len(x), 1)))
    found = near[near < far].min()
    assert geometry.lowest(shape) <= found + 1e-12 and found < geometry.lowest(shape) + 0.03


def test_normals_point_outwards():
    for shape in SHAPES[:3]:
        origin, direction = rays(200, seed=5)
        near, far = geometry.interval(shape, origin, direction)
        hit = near < far
        at = origin[hit] + far[hit, None] * direction[hit]
        outward = geometry.normal(shape, at)
        assert (np.einsum("ni,ni->n", outward, direction[hit]) > 0.0).all()  # leaving
        assert not any(contains(shape, p) for p in at + 1e-6 * outward)
        assert all(contains(shape, p) for p in at - 1e-6 * outward)
