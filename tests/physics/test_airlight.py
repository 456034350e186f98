# SPDX-License-Identifier: GPL-3.0-or-later
"""Airlight against the literal integral over the ray, by a quadrature of its own."""

import itertools

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from volumetrics_addon.physics import airlight

INF = np.inf
ORIGIN = np.zeros(3)
ALONG_X = np.array([1.0, 0.0, 0.0])
# Agreement of the reference with 30-digit quadrature, measured 4e-15.
REFERENCE_RTOL = 5e-14


def lobe(g):
    """Henyey-Greenstein, literally."""
    return lambda c: (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * c) ** 1.5)


def isotropic(c):
    return np.full(np.shape(c), 1 / (4 * np.pi))


def reference(
    foot, height, distance, sigma_t, phase, emission=lambda a, d: 1.0, edges=(), step=0.125
):
    """Integral of p I / d^2 exp(-sigma_t (t + d)) dt for sigma_s = I = 1.

    The ray runs along x from 0 and passes the light at t = foot at the given height.
    With t = foot + height sinh(x) the integrand is smooth in x and decays
    exponentially both ways; Gauss-Legendre panels of ``step`` sum it.
    """
    opaque = max(foot, 0.0) + 90 / sigma_t if sigma_t > 0 else INF
    last = np.arcsinh((min(distance, opaque) - foot) / height)
    first, last = np.arcsinh(-foot / height), min(last, 45.0)
    breaks = [first, *(x for x in np.arcsinh(np.array(edges) / height) if first < x < last), last]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for low, high in zip(breaks, breaks[1:]):
        count = int(np.ceil((high - low) / step))
        middles = low + (np.arange(count) + 0.5) / count * (high - low)
        half = (high - low) / count / 2
        x = middles[:, np.newaxis] + half * nodes
        a, d = height * np.sinh(x), height * np.cosh(x)
        # t + d with t = foot + a; for a < 0 the two cancel.
        path = foot + np.where(a < 0, height**2 / (d - np.minimum(a, 0)), a + d)
        terms = phase(-a / d) * emission(a, d) / d**2 * np.exp(-sigma_t * path) * d
        total += half * np.sum(terms * weights)
    return total


def point(foot, height, distance, sigma_t, phase, **options):
    foot, height = np.broadcast_arrays(foot, height)
    light = np.stack([foot, height, np.zeros_like(foot)], axis=-1).astype(float)
    return airlight.point_light(
        ORIGIN, ALONG_X, distance, light, 1.0, 1.0, sigma_t, phase, **options
    )


GRID = np.array(
    list(
        itertools.product(
            [-2.0, 0.0, 0.5, 5.0, 30.0], [1e-3, 0.1, 1.0, 10.0], [1.0, 10.0, 100.0, INF],
            [0.0, 0.01, 0.1, 1.0, 5.0],
        )
    )
)  # fmt: skip


@pytest.fixture(scope="module", params=[0.0, 0.5, -0.3, 0.9])
def case(request):
    """(phase, the grid's foot, height, distance and sigma_t, expected values)."""
    phase = lobe(request.param)
    expected = np.array([reference(*row, phase) for row in GRID])
    visible = expected > 1e-290
    assert np.count_nonzero(visible) > 380
    return phase, GRID[visible].T, expected[visible]


@pytest.mark.parametrize(
    "row", [(0.5, 0.1, 10.0, 1.0), (5.0, 1.0, INF, 0.1), (-2.0, 10.0, 100.0, 5.0)]
)
def test_reference_is_the_integral(row):
    foot, height, distance, sigma_t = (mp.mpf(x) for x in row)
    with mp.workdps(30):

        def integrand(t):
            d = mp.sqrt((t - foot) ** 2 + height**2)
            cosine = -(t - foot) / d
            g = mp.mpf(0.5)
            p = (1 - g**2) / (4 * mp.pi * (1 + g**2 - 2 * g * cosine) ** mp.mpf(1.5))
            return p / d**2 * mp.exp(-sigma_t * (t + d))

        stops = [foot + height * k for k in (-8, -2, 0, 2, 8, 30)]
        stops += [foot + depth / sigma_t for depth in (5, 30)]
        stops = sorted({mp.mpf(0), distance, *(x for x in stops if 0 < x < distance)})
        expected = float(mp.quad(integrand, stops))
    assert reference(*row, lobe(0.5)) == pytest.approx(expected, rel=REFERENCE_RTOL)


# --- point light ---------------------------------------------------------------


def test_sixteen_nodes_suffice_for_thin_and_moderate_media():
    """Optical depth up to 2 along the ray, light no closer to it than a tenth of its way."""
    rows = [
        (foot, height, distance, tau / distance, g)
        for foot, height, distance in [
            (0.5, 0.1, 1), (5, 1, 10), (5, 10, 10), (-2, 1, 10), (3, 2, 5)
        ]
        for tau in (0.0, 0.01, 0.3, 2.0)
        for g in (0.0, 0.5, -0.3)
    ]
    for foot, height, distance, sigma_t, g in rows:
        value = point(foot, height, distance, sigma_t, lobe(g)).value
        # Asked for is 1e-6; measured 1.9e-8 at worst.
        assert value == pytest.approx(
            reference(foot, height, distance, sigma_t, lobe(g)), rel=1e-6
        )


@pytest.mark.parametrize("options", [{}, {"order": 32}, {"adaptive": True, "rtol": 1e-6},
                                     {"adaptive": True, "rtol": 1e-10}])  # fmt: skip
def test_error_estimate_is_honest(case, options):
    phase, (foot, height, distance, sigma_t), expected = case
    result = point(foot, height, distance, sigma_t, phase, **options)
    error = np.abs(result.value - expected)
    covered = error <= result.error_estimate + REFERENCE_RTOL * expected
    assert np.mean(covered) >= 0.95
    # Where the two rules agree by chance; measured 13.9 at worst over 5000 cases.
    assert np.all(error <= 20 * result.error_estimate + REFERENCE_RTOL * expected)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-11])
def test_adaptive_reaches_the_tolerance(case, rtol):
    phase, (foot, height, distance, sigma_t), expected = case
    result = point(foot, height, distance, sigma_t, phase, adaptive=True, rtol=rtol)
    np.testing.assert_allclose(result.value, expected, rtol=rtol)
    assert np.all(result.error_estimate <= 2 * rtol * expected)


def test_estimate_is_useful_in_an_easy_case():
    result = point(5.0, 3.0, 10.0, 0.05, lobe(0.3))
    assert result.error_estimate < 1e-6 * result.value
    assert result.evaluations == 16 + 8


@pytest.mark.parametrize("foot", [-2.0, 0.0, 0.5, 1.0, 7.0])
@pytest.mark.parametrize("height", [1e-12, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("distance", [1.0, 20.0, INF])
def test_without_extinction(foot, height, distance):
    light = np.array([foot, height, 0.0])
    with mp.workdps(40):
        a, h = mp.mpf(foot), mp.mpf(height)
        far = mp.pi / 2 if distance == INF else mp.atan((mp.mpf(distance) - a) / h)
        expected = float((far - mp.atan(-a / h)) / h * 6 / (4 * mp.pi))
    closed = airlight.point_light_without_extinction(ORIGIN, ALONG_X, distance, light, 2.0, 3.0)
    assert closed.value == pytest.approx(expected, rel=1e-14)
    assert abs(closed.value - expected) <= closed.error_estimate
    assert closed.evaluations == 0
    integrated = airlight.point_light(
        ORIGIN, ALONG_X, distance, light, 2.0, 3.0, 0.0, isotropic
    )
    assert integrated.value == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("height", [0.0, 1e-9, 1e-6])
def test_light_ahead_of_the_end_of_the_ray(height):
    """On the axis t + d is constant: exp(-sigma_t s) p(1) (1 / (s - T) - 1 / s)."""
    result = point(5.0, height, 4.0, 0.7, lobe(0.2))
    expected = np.exp(-0.7 * 5) * lobe(0.2)(1.0) * (1 / 1 - 1 / 5)
    assert result.value == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("distance", [3.0, INF])
def test_light_behind_the_start_of_the_ray(distance):
    with mp.workdps(30):
        backward = mp.mpf(float(lobe(0.2)(-1.0)))
        stops = [0, 1, 10, mp.inf] if distance == INF else [0, 1, 3]
        expected = mp.quad(
            lambda t: backward / (t + 2) ** 2 * mp.exp(-mp.mpf(0.7) * (2 * t + 2)), stops
        )
    result = point(-2.0, 0.0, distance, 0.7, lobe(0.2), adaptive=True, rtol=1e-12)
    assert result.value == pytest.approx(float(expected), rel=1e-12)


def test_light_on_the_ray_is_infinite():
    for foot in (0.0, 1.0, 3.0):
        result = point(foot, 0.0, 3.0, 0.7, lobe(0.2))
        assert result.value == INF and result.error_estimate == 0
    light = np.array([1.0, 0, 0])
    closed = airlight.point_light_without_extinction(ORIGIN, ALONG_X, 3.0, light, 1.0, 1.0)
    assert closed.value == INF
    # Nothing scatters, nothing shines, no ray.
    for intensity, sigma_s, distance in [(1.0, 0.0, 3.0), (0.0, 1.0, 3.0), (1.0, 1.0, 0.0)]:
        result = airlight.point_light(
            ORIGIN, ALONG_X, distance, light * 0, intensity, sigma_s, 0.7, isotropic
        )
        assert result.value == 0 and result.error_estimate == 0


def test_value_is_independent_of_the_frame():
    rng = np.random.default_rng(11)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shift = rng.normal(size=3)
    light = rotation @ np.array([2.0, 1.0, 0.0]) + shift
    moved = airlight.point_light(
        shift, rotation @ ALONG_X, 5.0, light, 3.0, 0.2, 0.4, lobe(0.3), adaptive=True
    )
    expected = 0.6 * reference(2.0, 1.0, 5.0, 0.4, lobe(0.3))
    assert moved.value == pytest.approx(expected, rel=1e-10)


@example(2.3e-311, 2.0, 1.0, 2e17, False)
@example(0.0, 5e-324, 1.0, 0.0, False)
@example(0.0, 1.0, INF, 2e-210, False)
@settings(max_examples=80, deadline=None)
@given(
    st.floats(-1e6, 1e6), st.floats(0, 1e6), st.one_of(st.floats(0, 1e30), st.just(INF)),
    st.one_of(st.floats(0, 1e30), st.floats(0, 10)), st.booleans(),
)  # fmt: skip
def test_never_nan_nor_negative(foot, height, distance, sigma_t, adaptive):
    result = point(foot, height, distance, sigma_t, lobe(0.5), adaptive=adaptive)
    assert result.value >= 0 and result.error_estimate >= 0
    assert np.isfinite(result.value) or height < 1e-150


# --- spot light ----------------------------------------------------------------


def spot(foot, height, distance, sigma_t, phase, axis, cone, blend, **options):
    light = np.array([foot, height, 0.0])
    return airlight.spot_light(
        ORIGIN, ALONG_X, distance, light, 1.0, 1.0, sigma_t, phase, axis, cone, blend, **options
    )


def literal_falloff(foot, height, axis, cone, blend):
    """Blender's spot: smoothstep of the cosine between edge and blend."""
    edge = np.cos(cone / 2)

    def emission(a, d):
        cosine = (a * axis[0] - height * axis[1]) / d
        if blend == 0:
            return (cosine >= edge).astype(float)
        x = np.clip((cosine - edge) / ((1 - edge) * blend), 0, 1)
        return x * x * (3 - 2 * x)

    return emission


def crossings(height, axis, limit):
    """Positions a at which the cosine to the spot's axis passes ``limit``, by bisection."""

    def excess(x):
        return (np.sinh(x) * axis[0] - axis[1]) / np.cosh(x) - limit

    grid = np.linspace(-40, 40, 8001)
    values = excess(grid)
    roots = []
    for i in np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:])):
        low, high = grid[i], grid[i + 1]
        for _ in range(60):
            middle = (low + high) / 2
            same = np.sign(excess(middle)) == np.sign(excess(low))
            low, high = (middle, high) if same else (low, middle)
        roots.append(height * np.sinh(low))
    return roots


AXES = {
    "down": (0.0, -1.0, 0.0),
    "askew": (0.48, -0.6, 0.64),
    "away": (0.8, 0.6, 0.0),
    "along": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "towards": (-0.6, -0.8, 0.0),
}


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
@pytest.mark.parametrize("cone", [0.2, 1.0, 2.5, np.pi])
@pytest.mark.parametrize("blend", [0.0, 0.15, 1.0])
@pytest.mark.parametrize(
    "foot, height, distance, sigma_t", [(3.0, 1.0, 10.0, 0.2), (-1.0, 2.0, INF, 0.5)]
)
def test_spot_light(axis, cone, blend, foot, height, distance, sigma_t):
    edge = np.cos(cone / 2)
    limits = {edge, edge + (1 - edge) * blend}
    edges = sorted(a for limit in limits for a in crossings(height, axis, limit))
    emission = literal_falloff(foot, height, axis, cone, blend)
    expected = reference(foot, height, distance, sigma_t, lobe(0.3), emission, edges)
    result = spot(foot, height, distance, sigma_t, lobe(0.3), axis, cone, blend, adaptive=True)
    assert result.value == pytest.approx(expected, rel=1e-8, abs=1e-14)
    quick = spot(foot, height, distance, sigma_t, lobe(0.3), axis, cone, blend)
    assert quick.value == pytest.approx(expected, rel=1e-4, abs=1e-14)
    assert abs(quick.value - expected) <= quick.error_estimate + 1e-12 * expected + 1e-16


def test_spot_light_that_covers_the_ray_is_a_point_light():
    cone = 2 * np.arctan(2.0) + 0.1
    result = spot(1.0, 1.0, 3.0, 0.3, lobe(0.3), (0.0, -1.0, 0.0), cone, 0.0)
    np.testing.assert_allclose(result.value, point(1.0, 1.0, 3.0, 0.3, lobe(0.3)).value, rtol=1e-14)


def test_spot_light_on_the_ray():
    towards_eye, onwards = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    # The light at 2 m shines away from the eye: lit from its own position on.
    assert spot(2.0, 0.0, 5.0, 0.1, isotropic, onwards, 0.5, 0.0).value == INF
    assert spot(2.0, 0.0, 5.0, 0.1, isotropic, (0.0, 1.0, 0.0), 0.5, 0.5).value == 0
    # Beyond the end it lights the ray only if it looks back.
    assert spot(5.0, 0.0, 2.0, 0.1, isotropic, onwards, 0.5, 0.0).value == 0
    lit = spot(5.0, 0.0, 2.0, 0.1, isotropic, towards_eye, 0.5, 0.0)
    expected = np.exp(-0.5) / (4 * np.pi) * (1 / 3 - 1 / 5)
    assert lit.value == pytest.approx(expected, rel=1e-13)
    assert spot(0.0, 0.0, 2.0, 0.1, isotropic, towards_eye, 0.5, 0.0).value == 0


# --- sun -----------------------------------------------------------------------

SUN = np.array([0.6, 0.0, -0.8])


@pytest.mark.parametrize("sigma_t", [0.0, 1e-12, 0.3, 40.0, 1e30])
@pytest.mark.parametrize("distance", [0.0, 1e-9, 2.0, 50.0])
@pytest.mark.parametrize(
    "s0, s1", [(0.0, 0.0), (3.0, 0.7), (100.0, -1.0), (200.0, -3.5), (1e3, -1 + 1e-9)]
)
def test_sun(sigma_t, distance, s0, s1):
    result = airlight.sun(
        ORIGIN, ALONG_X, distance, SUN, 5.0, 0.2, sigma_t, lobe(0.4), s0, s1
    )
    with mp.workdps(300):
        k = mp.mpf(sigma_t) * (1 + mp.mpf(s1))
        T = mp.mpf(distance)
        path = T if k == 0 else (1 - mp.exp(-k * T)) / k
        # Light along SUN turns towards -x: cosine -0.6.
        expected = float(
            mp.mpf(0.2) * 5 * mp.mpf(float(lobe(0.4)(-0.6))) * mp.exp(-mp.mpf(sigma_t) * s0) * path
        )
    assert result.value == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert abs(result.value - expected) <= result.error_estimate + 1e-300


def test_sun_over_infinite_rays():
    # p E sigma_s / sigma_t
    value = airlight.sun(ORIGIN, ALONG_X, INF, SUN, 5.0, 0.2, 0.5, isotropic).value
    assert value == pytest.approx(5 * 0.2 / 0.5 / (4 * np.pi), rel=1e-14)
    assert airlight.sun(ORIGIN, ALONG_X, INF, SUN, 5.0, 0.2, 0.0, isotropic).value == INF
    assert airlight.sun(ORIGIN, ALONG_X, INF, SUN, 5.0, 0.0, 0.0, isotropic).value == 0
    assert airlight.sun(ORIGIN, ALONG_X, 1.0, SUN, 5.0, 0.2, 0.5, isotropic, INF).value == 0


def test_sun_below_a_level_surface():
    origin, direction = np.array([1.0, 2.0, -3.0]), np.array([0.0, 0.6, -0.8])
    s0, s1 = airlight.sun_distance_below(0.0, origin, direction, SUN)
    result = airlight.sun(origin, direction, 10.0, SUN, 1.0, 0.1, 0.2, isotropic, s0, s1)
    t = (np.arange(200_000) + 0.5) / 20_000
    way = (3 + 0.8 * t) / 0.8
    expected = np.sum(np.exp(-0.2 * (t + way))) / 20_000 * 0.1 / (4 * np.pi)
    assert result.value == pytest.approx(expected, rel=1e-9)
    asked = airlight.sun(
        origin, direction, 10.0, SUN, 1.0, 0.1, 0.2, isotropic, lambda x: -x[..., 2] / 0.8, s1
    )
    assert asked.value == pytest.approx(result.value, rel=1e-15)


# --- arrays and errors ---------------------------------------------------------


def test_broadcasting():
    directions = np.array([[1.0, 0, 0], [0, 1, 0]], dtype=np.float32)[:, np.newaxis, :]
    sigma = np.array([0.1, 0.2, 0.4], dtype=np.float32)
    light = [2.0, 1.0, 0.5]
    for result in (
        airlight.point_light(ORIGIN, directions, 3.0, light, 1.0, sigma, sigma, isotropic),
        airlight.point_light(
            ORIGIN, directions, 3.0, light, 1.0, sigma, sigma, isotropic, adaptive=True
        ),
        airlight.spot_light(
            ORIGIN, directions, 3.0, light, 1.0, sigma, sigma, isotropic, [0, 0, -1], [1, 2, 3]
        ),
        airlight.sun(ORIGIN, directions, 3.0, SUN, 1.0, sigma, sigma, isotropic),
        airlight.point_light_without_extinction(ORIGIN, directions, 3.0, light, 1.0, sigma),
    ):
        assert all(np.shape(x) == (2, 3) for x in result)
    one = airlight.point_light(ORIGIN, directions[1, 0], 3.0, light, 1.0, 0.4, 0.4, isotropic)
    many = airlight.point_light(
        ORIGIN, directions, 3.0, light, 1.0, np.array([0.1, 0.2, 0.4]), [0.1, 0.2, 0.4], isotropic
    )
    np.testing.assert_allclose(many.value[1, 2], one.value, rtol=1e-14)
    empty = airlight.point_light(np.empty((0, 3)), ALONG_X, 3.0, light, 1.0, 0.1, 0.1, isotropic)
    assert empty.value.shape == (0,)
    empty = airlight.spot_light(
        np.empty((0, 3)), ALONG_X, 3.0, light, 1.0, 0.1, 0.1, isotropic, [0, 0, 1], 1.0
    )
    assert empty.value.shape == (0,)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"direction": [1, 1, 0]}, "length of direction must be 1, got 1.41.*normalise"),
        ({"direction": [0, 0, 0]}, "length of direction must be 1, got 0.0"),
        ({"origin": [0, np.nan, 0]}, "origin .* got nan"),
        ({"light_position": [0, INF, 0]}, "light_position .* got inf"),
        ({"origin": [0, 0]}, r"origin must have shape \(..., 3\)"),
        ({"distance": -1.0}, "distance .* got -1.0"),
        ({"sigma_t": -0.2}, "sigma_t .* per metre, got -0.2; use a positive extinction"),
        ({"sigma_s": np.nan}, "sigma_s .* got nan"),
        ({"intensity": -1}, "intensity .* got -1.0"),
        ({"phase": lambda c: -np.ones_like(c)}, "phase.* must be >= 0 per steradian, got -1.0"),
        ({"order": 1}, "order must be an integer >= 2, got 1"),
        ({"rtol": 0}, "rtol .* got 0.0"),
    ],
)
def test_errors_name_value_and_remedy(change, message):
    arguments = {
        "origin": ORIGIN, "direction": ALONG_X, "distance": 3.0, "light_position": [1.0, 1, 0],
        "intensity": 1.0, "sigma_s": 0.1, "sigma_t": 0.1, "phase": isotropic,
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        airlight.point_light(**{**arguments, **change})


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: spot(1, 1, 1, 1, isotropic, [0, 0, 1], 0.0, 0.5), "cone_angle .* got 0.0"),
        (lambda: spot(1, 1, 1, 1, isotropic, [0, 0, 1], 4.0, 0.5), "cone_angle .* got 4.0"),
        (lambda: spot(1, 1, 1, 1, isotropic, [0, 0, 1], 1.0, 1.5), "blend .* got 1.5"),
        (lambda: spot(1, 1, 1, 1, isotropic, [0, 0, 2], 1.0, 0.5), "length of spot_direction"),
        (
            lambda: airlight.sun(ORIGIN, ALONG_X, 10.0, SUN, 1, 1, 1, isotropic, 5.0, -1.0),
            "sun_distance along the ray .* got -5.0; end the ray",
        ),
        (
            lambda: airlight.sun_distance_below(0.0, [0, 0, -1.0], ALONG_X, -SUN),
            "downward part of sun_direction .* got -0.8",
        ),
        (
            lambda: airlight.sun_distance_below(0.0, [0, 0, 1.0], ALONG_X, SUN),
            "depth of origin below top .* got -1.0",
        ),
    ],
)
def test_spot_and_sun_errors(call, message):
    with pytest.raises(ValueError, match=message):
        call()
