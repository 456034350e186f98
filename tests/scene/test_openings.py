# SPDX-License-Identifier: GPL-3.0-or-later
"""Shafts behind openings: the prisms hold exactly the light, and polygons are joined without losing any of it."""

import math

import numpy as np
import pytest

from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.reference import single_scattering
from volumetrics_addon.scene import assemble, geometry
from volumetrics_addon.scene.model import Camera, Scene, Sun, normalized
from volumetrics_addon.scene.openings import APART, BEGIN, BELOW, convex_parts, is_convex, is_flat, shaft

RNG = np.random.default_rng(5)
SQUARE = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 0.0, 2.0), (0.0, 0.0, 2.0))
PENTAGON = tuple((math.cos(a), math.sin(a), 0.2 * math.cos(a) + 3.0) for a in 0.3 + np.arange(5) * 2 * math.pi / 5)
DOWN = normalized((0.4, 0.7, -0.6))
FLAT = normalized((0.3, 0.9, 0.1))


def passed(polygon, direction, position):
    """Whether the line from each position (n, 3) against the light crosses the polygon, by the angles of its corners."""
    corners = np.array(polygon)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    way = (position - corners[0]) @ normal / (np.array(direction) @ normal)
    across = corners - (position - way[:, None] * np.array(direction))[:, None]
    following = np.roll(across, -1, axis=1)
    normal = normal / np.linalg.norm(normal)
    turned = np.arctan2(np.cross(across, following) @ normal, np.einsum("nkc,nkc->nk", across, following))
    return (np.abs(turned.sum(axis=1)) > 1.0) & (way > 0.0), way


@pytest.mark.parametrize("polygon", [SQUARE, SQUARE[::-1], PENTAGON])
@pytest.mark.parametrize("end", [{"length": 2.5}, {"floor": -0.5}], ids=["length", "floor"])
def test_a_shaft_is_what_the_light_fills(polygon, end):
    hull = shaft(polygon, DOWN, **end)
    position = np.min(hull.corners, axis=0) + RNG.random((4000, 3)) * np.ptp(hull.corners, axis=0)
    lit, way = passed(polygon, DOWN, position)
    if "length" in end:
        expected, margin = lit & (way < end["length"]), np.abs(way - end["length"])
    else:
        level = end["floor"] - BELOW * (max(corner[2] for corner in polygon) - end["floor"])
        expected, margin = lit & (position[:, 2] > level), np.abs(position[:, 2] - level)
    inside = geometry.contains(hull, position)
    clear = (way > 1.01 * BEGIN * 8.0) & (margin > 1e-9)  # the first thousandth is left out
    assert np.array_equal(inside[clear], expected[clear]) and 200 < inside.sum() < 3800
    # Its faces look outwards: the middle lies behind all of them.
    assert geometry.contains(hull, np.mean(hull.corners, axis=0)[None])[0]


def test_a_door_reaches_the_floor():
    door = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 2.0), (0.0, 0.0, 2.0))
    hull = shaft(door, DOWN, floor=0.0)
    assert min(corner[2] for corner in hull.corners) == pytest.approx(-0.02)


@pytest.mark.parametrize(("polygon", "direction", "end", "reason"), [
    (SQUARE, (1.0, 0.0, 0.0), {"length": 1.0}, r"along the opening, 0.0 degrees .*turn the sun"),
    (SQUARE, normalized((1.0, 0.01, 0.0)), {"length": 1.0}, r"0.6 degrees"),
    (SQUARE, (0.0, 1.0, 0.0), {"floor": 0.0}, "does not fall to the floor.*after a length"),
    (SQUARE, DOWN, {"floor": 1.5}, r"reaches down to 1 m, below the floor at 1.5 m; lower the floor")])
def test_what_gives_no_shaft(polygon, direction, end, reason):
    with pytest.raises(ValueError, match=reason):
        shaft(polygon, direction, **end)


@pytest.mark.parametrize(("polygon", "convex"), [
    (SQUARE, True), (PENTAGON, True), (SQUARE[:2] + ((1.0, 0.0, 1.5),) + SQUARE[2:], True),
    (((0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0)), False),
    (tuple((math.cos(a), math.sin(a), 0.0) for a in np.arange(5) * 4 * math.pi / 5), False),  # a star
    (SQUARE[:2], False), (((0, 0, 0), (1, 0, 0), (2, 0, 0)), False)])
def test_convex(polygon, convex):
    assert is_convex(polygon) == convex


def test_flat():
    assert is_flat(PENTAGON) and not is_flat((*SQUARE[:3], (0.0, 0.1, 2.0)))


def lattice(columns, rows):
    """Quadrilaterals of a lattice in the plane y = 0.3 z."""
    points = [(i * 0.7, 0.15 * j, 0.5 * j) for j in range(rows + 1) for i in range(columns + 1)]
    place = lambda i, j: j * (columns + 1) + i  # noqa: E731
    faces = [(place(i, j), place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)) for j in range(rows) for i in range(columns)]
    return faces, points


def size(parts):
    """Total area (m2), by triangles from the first corner."""
    return sum(np.linalg.norm(np.cross(np.subtract(b, part[0]), np.subtract(c, part[0]))) / 2
               for part in parts for b, c in zip(part[1:], part[2:]))


@pytest.mark.parametrize("shape", [(1, 1), (2, 1), (2, 2), (3, 4), (5, 5)])
def test_a_lattice_is_one_opening(shape):
    """Whatever the order of its faces, and whichever way they look."""
    faces, points = lattice(*shape)
    for seed in range(20):
        order = np.random.default_rng(seed).permutation(len(faces))
        flipped = [faces[k] if k % 2 else faces[k][::-1] for k in order]
        (part,) = convex_parts(flipped, points, DOWN)
        assert len(part) == 4 and is_convex(part)
        assert size([part]) == pytest.approx(shape[0] * 0.7 * shape[1] * math.hypot(0.5, 0.15), rel=1e-9)


def test_a_frame_around_a_hole_keeps_its_hole():
    """Eight of the nine squares of a lattice: two outlines, so that pairs are joined instead."""
    faces, points = lattice(3, 3)
    parts = convex_parts(faces[:4] + faces[5:], points, DOWN)
    assert all(map(is_convex, parts)) and len(parts) == 4
    assert size(parts) == pytest.approx(8 * 0.7 * math.hypot(0.5, 0.15) * APART**2, rel=1e-9)


def test_triangles_of_a_polygon_are_one_opening():
    points = [*PENTAGON]
    (part,) = convex_parts([(0, 1, 2), (0, 2, 3), (0, 3, 4)], points, (0.0, 0.0, -1.0))
    assert set(part) == set(PENTAGON) and size([part]) == pytest.approx(size([PENTAGON]))


def test_an_angle_becomes_convex_parts_that_stay_apart():
    faces, points = lattice(2, 2)
    parts = convex_parts(faces[:3], points, DOWN)
    assert len(parts) == 2 and all(map(is_convex, parts))
    assert size(parts) == pytest.approx(3 * 0.7 * math.hypot(0.5, 0.15) * APART**2, rel=1e-9)
    distances = [np.linalg.norm(np.subtract(a, b)) for a in parts[0] for b in parts[1]]
    assert min(distances) > 1e-3


def test_faces_of_two_walls_stay_two():
    points = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (1, -1, 0), (1, -1, 1)]
    assert len(convex_parts([(0, 1, 2, 3), (1, 4, 5, 2)], points, normalized((-1.0, 1.0, -0.5)))) == 2


def test_light_across_a_shaft():
    """A ray at right angles to the light: all of it as deep in the shaft, so that the integral has a closed form."""
    values = FAMILIES["godray"].check({
        "light": "sun", "location": [0, 0, 5], "target": [0, 4, 2], "opening_width": 1.5, "opening_height": 2.0,
        "opening_tilt": 0.0, "shaft_end": "length",
        "length": 9.0, "extinction": 0.3, "albedo": [0.9, 0.5, 0.2], "g": 0.4, "irradiance": 7.0, "color": [1.0, 0.5, 0.25],
        "blocker": "none"})
    item = assemble.ASSEMBLERS["godray"](values)
    (volume,), (sun,) = item.volumes, item.lights
    assert isinstance(sun, Sun) and sun.direction == pytest.approx((0.0, 0.8, -0.6))
    way = 4.0
    scene = Scene(Camera((-3.0, 0.8 * way, 5 - 0.6 * way), (1.0, 0.0, 0.0), 0.5), item.lights, volumes=item.volumes)
    value, _ = single_scattering.radiance(scene, np.array([scene.camera.position]), np.array([scene.camera.direction]),
                                          np.random.default_rng(0))
    sigma_t, phase = 0.3, (1 - 0.4**2) / (4 * math.pi * (1 + 0.4**2) ** 1.5)
    begun = BEGIN * 9.0  # the first thousandth of the shaft is clear
    expected = [sigma_t * a * e * phase * math.exp(-sigma_t * (way - begun)) * (1 - math.exp(-sigma_t * 1.5)) / sigma_t
                for a, e in zip((0.9, 0.5, 0.2), (7.0, 3.5, 1.75))]
    assert value[0] == pytest.approx(expected, rel=1e-6)


def test_openings_side_by_side():
    changes = {"light": "sun", "location": [0, 0, 4], "target": [0, 3, 0], "count": 3, "spacing": 2.0, "opening_width": 1.0,
               "blocker": "window", "blocker_count": 2, "irradiance": 0.0, "opening_tilt": 0.0}
    item = assemble.ASSEMBLERS["godray"](FAMILIES["godray"].check(changes))
    assert item.lights == () and len(item.surfaces) == 3 * 4
    spans = sorted((min(c[0] for c in v.domain.corners), max(c[0] for c in v.domain.corners)) for v in item.volumes)
    assert np.allclose(spans, [(-2.5, -1.5), (-0.5, 0.5), (1.5, 2.5)])
    bodies = assemble.bodies("godray", FAMILIES["godray"].check(changes), item.volumes)
    assert [body.domain for body in bodies] == [volume.domain for volume in item.volumes]
    with pytest.raises(ValueError, match="spacing must be >= 1.01 times opening_width, got 1 m"):
        assemble.ASSEMBLERS["godray"](FAMILIES["godray"].check(changes | {"spacing": 1.0}))


def test_an_opening_in_a_roof_lies():
    item = assemble.ASSEMBLERS["godray"](FAMILIES["godray"].check(
        {"light": "sun", "location": [1, 2, 4], "target": [1, 2, 0], "opening_tilt": 90.0, "opening_azimuth": 30.0,
         "opening_width": 2.0, "opening_height": 1.0, "blocker": "none"}))
    top = [c for c in item.volumes[0].domain.corners if c[2] > 3.0]
    assert len(top) == 4 and np.ptp([c[2] for c in top]) < 1e-12
    assert size([top]) == pytest.approx(2.0)
