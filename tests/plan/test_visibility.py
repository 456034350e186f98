# SPDX-License-Identifier: GPL-3.0-or-later
"""Hulls, pictures and shadows against literal sampling."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volumetrics_addon.plan import visibility
from volumetrics_addon.plan.observed import View
from volumetrics_addon.scene.model import add, look_frame, scaled, subtract

number = st.floats(-10.0, 10.0, allow_nan=False, width=32)
point = st.tuples(number, number, number)


def camera(eye, target, half=(0.4, 0.3), clip_end=1e6, shift=(0.0, 0.0)):
    right, up, back = look_frame(subtract(target, eye))
    low, high = (tuple(s + sign * h for s, h in zip(shift, half)) for sign in (-1.0, 1.0))
    return View(eye, right, up, back, low, high, clip_end)


def within(points, rng):
    """A random point of a hull: a convex combination."""
    weights = [rng.random() ** 3 for _ in points]
    total = sum(weights)
    result = (0.0, 0.0, 0.0)
    for weight, corner in zip(weights, points):
        result = add(result, scaled(corner, weight / total))
    return result


def box(center, half):
    return visibility.corners(subtract(center, (half,) * 3), add(center, (half,) * 3))


@pytest.mark.parametrize("gap", [1e-3, 0.5, 20.0])
def test_distance_of_boxes_is_their_gap(gap):
    a, b = box((0.0, 0.0, 0.0), 1.0), box((2.0 + gap, 0.3, -0.4), 1.0)
    assert visibility.distance(a, b) == pytest.approx(gap, rel=1e-4)


def test_distance_across_corners_is_their_diagonal():
    a, b = box((0.0, 0.0, 0.0), 1.0), box((4.0, 4.0, 4.0), 1.0)
    assert visibility.distance(a, b) == pytest.approx(2.0 * math.sqrt(3.0), rel=1e-4)


def test_hulls_that_meet_are_not_apart():
    assert visibility.distance(box((0.0, 0.0, 0.0), 1.0), box((1.5, 0.0, 0.0), 1.0)) == 0.0
    assert visibility.distance([(0.0, 0.0, -5.0), (0.0, 0.0, 5.0)], [(-5.0, 0.0, 0.0), (5.0, 0.0, 0.0)]) == 0.0


@given(st.lists(point, min_size=1, max_size=8), st.lists(point, min_size=1, max_size=8), st.integers(0, 1 << 20))
def test_no_two_points_of_the_hulls_are_nearer_than_said(a, b, seed):
    rng = random.Random(seed)
    least = visibility.distance(a, b)
    for _ in range(30):
        assert math.dist(within(a, rng), within(b, rng)) >= least * (1.0 - 1e-9)


@given(point, point, st.floats(0.1, 3.0), st.integers(0, 1 << 20), st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)))
def test_nothing_that_is_seen_is_out_of_frame(eye, center, half, seed, shift):
    rng = random.Random(seed)
    target = add(eye, (rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1) + 1e-3))
    view, corners = camera(eye, target, shift=shift), box(center, half)
    if visibility.in_frame(view, corners):
        return
    for _ in range(60):
        sample = tuple(c + rng.uniform(-half, half) for c in center)
        x, y, z = (visibility.dot(subtract(sample, eye), axis) for axis in (view.right, view.up, view.back))
        assert not (z < 0.0 and view.low[0] < x / -z < view.high[0] and view.low[1] < y / -z < view.high[1])


@pytest.mark.parametrize("center, seen", [((0.0, 10.0, 0.0), True), ((0.0, -10.0, 0.0), False), ((5.0, 10.0, 0.0), True),
                                          ((5.5, 10.0, 0.0), False), ((0.0, 10.0, 4.5), False), ((0.0, 0.0, 0.0), True)])
def test_in_frame_of_boxes_whose_place_is_clear(center, seen):
    assert visibility.in_frame(camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), box(center, 1.0)) is seen


def test_what_is_behind_the_clip_end_or_a_wall_is_not_in_frame():
    view = camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), clip_end=50.0)
    assert not visibility.in_frame(view, box((0.0, 60.0, 0.0), 1.0))
    assert not visibility.in_frame(view, box((0.0, 20.0, 0.0), 1.0), far=18.0)
    assert visibility.in_frame(view, box((0.0, 20.0, 0.0), 1.0), far=19.5)


def wall(size, away, tilt=0.0):
    return [(x, away + tilt * x, z) for x, z in ((-size, -size), (size, -size), (size, size), (-size, size))]


def test_a_wall_fills_the_picture_where_all_its_corners_are_on_it():
    view = camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert visibility.filled_depth(view, wall(4.0, 5.0)) == pytest.approx(5.0)
    assert visibility.filled_depth(view, wall(1.9, 5.0)) == math.inf  # 0.4 x 5 m = 2 m to the side
    assert visibility.filled_depth(view, wall(4.0, -5.0)) == math.inf
    # Tilted by 0.5: the far side is hit at depth d with x = 0.4 d, d = 5 + 0.2 d.
    assert visibility.filled_depth(view, wall(4.0, 5.0, tilt=0.5)) == pytest.approx(5.0 / 0.8)
    assert visibility.filled_depth(view, list(reversed(wall(4.0, 5.0)))) == pytest.approx(5.0)


def test_the_share_of_a_sphere_is_its_cap():
    """A sphere of radius r seen from its middle's distance d covers (1 - cos asin(r / d)) / 2 of all directions."""
    corners = box((0.0, 0.0, 0.0), 1.0)
    radius = math.sqrt(3.0)
    for away in (2.0, 5.0, 300.0):
        expected = 0.5 * (1.0 - math.cos(math.asin(radius / away)))
        assert visibility.solid_angle_share(corners, away) == pytest.approx(expected, rel=1e-9)
    assert visibility.solid_angle_share(corners, 0.0) == visibility.solid_angle_share(corners, 1.0) == 0.5


def test_distances_of_a_box_from_a_point():
    corners = box((0.0, 0.0, 0.0), 1.0)
    assert visibility.box_distance(corners, (3.0, 0.0, 0.0)) == pytest.approx((2.0, math.sqrt(16.0 + 1.0 + 1.0)))
    assert visibility.box_distance(corners, (0.5, 0.0, 0.0))[0] == 0.0
