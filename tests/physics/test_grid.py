# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxel grids against SciPy's interpolation, fine quadrature and closed forms; both traversals alike."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.integrate import quad
from scipy.interpolate import RegularGridInterpolator

from volumetrics_addon.physics import grid

INF = np.inf
LOW, HIGH = np.array([-1.0, 0.5, 2.0]), np.array([2.0, 1.5, 7.0])
VALUES = np.random.default_rng(1).random((5, 3, 4))
CELL = (HIGH - LOW) / VALUES.shape
# The difference of both traversals, relative to the depth; measured 9e-16 at worst over 20,000 rays.
PARITY = 1e-14


@pytest.fixture(params=["numpy", "numba"])
def traversal(request, monkeypatch):
    if request.param == "numpy":
        monkeypatch.setattr(grid, "_stepper", lambda: None)
    else:
        assert grid._stepper() is not None
    return request.param


def depth(origin, direction, distance=INF, sigma_t=1.0, values=VALUES, low=LOW, high=HIGH, nearest=False):
    return grid.grid_optical_depth(values, low, high, origin, direction, distance, sigma_t, nearest)


def rays(count, seed=2):
    """Random rays, most of which meet the box; a third start inside."""
    rng = np.random.default_rng(seed)
    target = rng.uniform(LOW, HIGH, size=(count, 3))
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    back = rng.choice([0.0, 1.0, 8.0], size=(count, 1)) * rng.random((count, 1))
    return target - back * direction, direction, rng.uniform(0, 6, size=count)


def sampled(position, nearest=False):
    """The density by SciPy: spline of order 1 or 0 with the border repeated, 0 outside."""
    position = np.atleast_2d(position)
    place = (position - LOW) / CELL - 0.5
    value = ndimage.map_coordinates(VALUES, np.moveaxis(place, -1, 0), order=0 if nearest else 1, mode="nearest")
    inside = np.all((position >= LOW) & (position <= HIGH), axis=-1)
    return np.where(inside, value, 0.0)


# --- density -------------------------------------------------------------------


def test_density_is_scipys():
    position = np.random.default_rng(3).uniform(LOW - 0.3, HIGH + 0.3, size=(4000, 3))
    # Measured 4e-16.
    np.testing.assert_allclose(grid.grid_density(VALUES, LOW, HIGH, position), sampled(position), atol=2e-15)
    found = grid.grid_density(VALUES, LOW, HIGH, position, nearest=True)
    np.testing.assert_array_equal(found, sampled(position, nearest=True))
    centres = [low + (np.arange(n) + 0.5) * size for low, n, size in zip(LOW, VALUES.shape, CELL)]
    inner = np.random.default_rng(4).uniform(LOW + CELL / 2, HIGH - CELL / 2, size=(1000, 3))
    expected = RegularGridInterpolator(centres, VALUES)(inner)
    np.testing.assert_allclose(grid.grid_density(VALUES, LOW, HIGH, inner), expected, atol=2e-15)


def test_density_at_centres_faces_and_outside():
    index = np.stack(np.meshgrid(*map(np.arange, VALUES.shape), indexing="ij"), axis=-1)
    centres = LOW + (index + 0.5) * CELL
    for nearest in (False, True):
        np.testing.assert_allclose(grid.grid_density(VALUES, LOW, HIGH, centres, nearest), VALUES, rtol=1e-13)
        assert grid.grid_density(VALUES, LOW, HIGH, LOW, nearest) == VALUES[0, 0, 0]
        assert grid.grid_density(VALUES, LOW, HIGH, HIGH, nearest) == VALUES[-1, -1, -1]
        assert grid.grid_density(VALUES, LOW, HIGH, np.nextafter(HIGH, INF), nearest) == 0
        assert grid.grid_density([[[2.0]]], LOW, HIGH, (LOW + HIGH) / 2, nearest) == 2


# --- optical depth -----------------------------------------------------------------


@pytest.mark.parametrize("nearest", [False, True])
def test_depth_is_the_integral(traversal, nearest):
    """A literal integral: SciPy's quadrature between all plane crossings of SciPy's interpolation."""
    origins, directions, distances = rays(50)
    planes = [low + (np.arange(-1, 2 * n + 1) + 1) / 2 * size for low, n, size in zip(LOW, VALUES.shape, CELL)]
    total = 0
    for o, d, distance in zip(origins, directions, distances):
        cuts = np.concatenate([(p - o[i]) / d[i] for i, p in enumerate(planes)])
        cuts = np.sort([0.0, distance, *cuts[(cuts > 0) & (cuts < distance)]])
        expected = sum(
            quad(lambda t: sampled(o + t * d, nearest)[0], a, b, epsabs=1e-15)[0] for a, b in zip(cuts, cuts[1:])
        )
        # Measured 3e-15.
        assert depth(o, d, distance, nearest=nearest) == pytest.approx(expected, rel=1e-13, abs=1e-14)
        total += expected > 0
    assert total >= 30


def test_linear_field_in_closed_form(traversal):
    """Trilinear interpolation is exact for a + b x + c y + e z, whose integral is its value midway, times length."""
    slope = np.array([0.3, 0.7, 0.2])
    index = np.stack(np.meshgrid(*map(np.arange, (6, 5, 7)), indexing="ij"), axis=-1)
    cell = (HIGH - LOW) / (6, 5, 7)
    values = 1 + (LOW + (index + 0.5) * cell) @ slope
    rng = np.random.default_rng(5)
    a, b = rng.uniform(LOW + cell / 2, HIGH - cell / 2, size=(2, 500, 3))
    length = np.linalg.norm(b - a, axis=1)
    expected = (1 + (a + b) / 2 @ slope) * length
    found = depth(a, (b - a) / length[:, np.newaxis], length, values=values)
    np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("nearest", [False, True])
def test_uniform_grid_is_the_chord(traversal, nearest):
    origins, directions, _ = rays(500)
    with np.errstate(divide="ignore"):
        ends = np.sort([(LOW - origins) / directions, (HIGH - origins) / directions], axis=0)
    enter, leave = np.maximum(ends[0].max(axis=1), 0), ends[1].min(axis=1)
    found = depth(origins, directions, sigma_t=0.4, values=np.full((3, 4, 5), 2.0), nearest=nearest)
    np.testing.assert_allclose(found, 0.8 * np.maximum(leave - enter, 0), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("nearest", [False, True])
def test_additivity_and_reversal(traversal, nearest):
    origins, directions, distances = rays(500)
    whole = depth(origins, directions, distances, nearest=nearest)
    part = distances * np.random.default_rng(6).random(500)
    middle = origins + part[:, np.newaxis] * directions
    halves = depth(origins, directions, part, nearest=nearest) + depth(
        middle, directions, distances - part, nearest=nearest
    )
    np.testing.assert_allclose(halves, whole, rtol=1e-12, atol=1e-14)
    ends = origins + distances[:, np.newaxis] * directions
    np.testing.assert_allclose(depth(ends, -directions, distances, nearest=nearest), whole, rtol=1e-12, atol=1e-14)


UNIT = {"values": np.arange(8.0).reshape(2, 2, 2), "low": np.zeros(3), "high": np.full(3, 2.0)}
DIAGONAL = np.full(3, 1 / math.sqrt(3))


@pytest.mark.parametrize(
    "origin, direction, distance, linear, constant",
    [
        # Through the four centres' middle along x: 0..3 on the left, 4..7 on the right.
        ((-5, 1, 1), (1, 0, 0), INF, 1.5 * 0.5 + 3.5 + 5.5 * 0.5, None),
        # Through the centres along z, from inside, and backwards.
        ((0.5, 0.5, -1), (0, 0, 1), INF, 0 * 0.5 + 0.5 + 0.5, 1.0),
        ((0.5, 0.5, 0.5), (0, 0, 1), 1.0, 0.5, 0.5),
        ((1.5, 1.5, 9), (0, 0, -1), INF, 3.5 + 6.5 + 3.0, 13.0),
        # Along an outer edge and within a face: they belong to the box.
        ((0, 0, -1), (0, 0, 1), INF, 1.0, 1.0),
        ((2, 2, -1), (0, 0, 1), 2.0, 6 * 0.5 + 6.25 * 0.5, 6.0),
        # Over the corners and through all vertices of the diagonal; 7 s between the centres.
        ((-1, -1, -1), DIAGONAL, INF, (0.5 * 0 + 3.5 + 0.5 * 7) * math.sqrt(3), 7 * math.sqrt(3)),
        # Ending before the box, missing it, starting behind it, of no length.
        ((-5, 1, 1), (1, 0, 0), 4.0, 0.0, 0.0),
        ((-5, 3, 1), (1, 0, 0), INF, 0.0, 0.0),
        ((5, 1.2, 1), (1, 0, 0), INF, 0.0, 0.0),
        ((0.7, 1.2, 1), (1, 0, 0), 0.0, 0.0, 0.0),
        # Denormal slopes, and a start far away.
        ((0.5, 0.5, -1), (5e-324, -1e-310, 1), INF, 1.0, 1.0),
        ((0.5, 0.5, -1e12), (0, 0, 1), INF, 1.0, 1.0),
    ],
)  # fmt: skip
def test_special_rays(traversal, origin, direction, distance, linear, constant):
    assert depth(origin, direction, distance, **UNIT) == pytest.approx(linear, rel=1e-14, abs=1e-300)
    if constant is not None:
        assert depth(origin, direction, distance, **UNIT, nearest=True) == pytest.approx(constant, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize("nearest", [False, True])
def test_both_traversals_agree(nearest):
    origins, directions, distances = rays(3000, seed=7)
    # On the lattice as well: every coordinate and slope a multiple of half a cell.
    rng = np.random.default_rng(8)
    origins[:1000] = LOW + CELL * rng.integers(-2, 12, size=(1000, 3)) / 2
    slopes = CELL * rng.choice([-1, 0, 1], size=(1000, 3))
    slopes[np.all(slopes == 0, axis=1)] = CELL
    directions[:1000] = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
    values = np.random.default_rng(9).random((7, 20, 9))
    if nearest:
        # A ray within a face belongs to either side.
        origins[:1000] += 0.1 * CELL
    place = LOW, HIGH, origins, directions, distances, 1.0, nearest
    compiled = grid.grid_optical_depth(values, *place)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grid, "_stepper", lambda: None)
        plain = grid.grid_optical_depth(values, *place)
    np.testing.assert_allclose(compiled, plain, rtol=PARITY, atol=PARITY)
    assert np.count_nonzero(plain) > 1500


def test_tiles_change_nothing(monkeypatch):
    monkeypatch.setattr(grid, "_stepper", lambda: None)
    origins, directions, distances = rays(100)
    whole = depth(origins, directions, distances)
    monkeypatch.setattr(grid, "_TILE", 50)
    np.testing.assert_array_equal(depth(origins, directions, distances), whole)


def test_transmittance():
    origins, directions, distances = rays(50)
    sigma_t = np.array([0.1, 1.0, 1e30])
    found = grid.grid_transmittance(
        VALUES, LOW, HIGH, origins[:, np.newaxis], directions[:, np.newaxis], distances[:, np.newaxis], sigma_t
    )
    assert found.shape == (50, 3)
    tau = depth(origins, directions, distances)
    np.testing.assert_allclose(found[:, 1], [math.exp(-x) for x in tau], rtol=1e-14)
    np.testing.assert_array_equal(found[:, 2], np.where(tau > 0, 0.0, 1.0))
    empty = grid.grid_optical_depth(VALUES.astype(np.float32), LOW, HIGH, np.empty((0, 3), np.float32), [0, 0, 1.0], INF)
    assert empty.shape == (0,)
    assert grid.grid_density(VALUES, LOW, HIGH, np.empty((0, 3))).shape == (0,)
    assert isinstance(depth(origins[0], directions[0]), float)


COORDINATE = st.one_of(st.floats(-10, 10), st.floats(-1e100, 1e100), st.sampled_from([0.0, 5e-324, 1.0, -1e-310]))


@settings(max_examples=150, deadline=None)
@given(
    st.tuples(COORDINATE, COORDINATE, COORDINATE),
    st.sampled_from([(1, 0, 0), (0, -1, 0), (0.6, 0, -0.8), (0.48, 0.6, -0.64), (1, 1e-300, -5e-324)]),
    st.one_of(st.floats(0, 1e308), st.just(INF)), st.one_of(st.floats(0, 1e308), st.floats(0, 3)),
    st.sampled_from([(1.0, 1.0, 1.0), (1e-199, 1.0, 1e100), (1e100, 1e100, 1e100)]),
    st.sampled_from([0.0, 1.0, 1e308, 5e-324]), st.booleans(), st.booleans(),
)  # fmt: skip
def test_never_nan_nor_negative(origin, direction, distance, sigma_t, size, density, nearest, compiled):
    values = density * np.array([[[0.0, 1.0], [0.5, 1.0]]])
    with pytest.MonkeyPatch.context() as patch:
        if not compiled:
            patch.setattr(grid, "_stepper", lambda: None)
        found = grid.grid_optical_depth(values, -np.array(size), size, origin, direction, distance, sigma_t, nearest)
        assert found >= 0
        longest = 2 * math.hypot(*size)
        assert np.isfinite(found) or (sigma_t + 1) * longest * density > 1e300 or sigma_t * density > 1e200
        through = grid.grid_transmittance(values, -np.array(size), size, origin, direction, distance, sigma_t, nearest)
        assert 0 <= through <= 1


@pytest.mark.parametrize(
    "change, message",
    [
        ({"values": -VALUES}, "values .* got -0.*; clip or mask"),
        ({"values": np.ones((2, 2))}, r"values must have shape \(nx, ny, nz\).* got \(2, 2\)"),
        ({"values": np.ones((2, 0, 2))}, r"values must have shape .* got \(2, 0, 2\)"),
        ({"values": np.full((1, 1, 1), np.nan)}, "values .* got nan"),
        ({"low": HIGH}, "cell size.* must be at least 1e-200 metres along every axis, got 0.0; exchange"),
        ({"low": np.zeros((2, 3))}, r"low and high must have shape \(3,\), got \(2, 3\)"),
        ({"direction": (1, 1, 0)}, "length of direction must be 1"),
        ({"distance": -1.0}, "distance .* got -1.0"),
        ({"sigma_t": -1.0}, "sigma_t .* got -1.0"),
        ({"origin": (np.nan, 0, 0)}, "origin .* got nan"),
    ],
)
def test_errors_name_value_and_remedy(change, message):
    arguments = {"origin": (0, 0, 0), "direction": (1, 0, 0), **change}
    with pytest.raises(ValueError, match=message):
        depth(**arguments)


def test_density_errors():
    with pytest.raises(ValueError, match="position .* got nan"):
        grid.grid_density(VALUES, LOW, HIGH, [0, np.nan, 0])
