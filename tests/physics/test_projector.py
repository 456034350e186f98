# SPDX-License-Identifier: GPL-3.0-or-later
"""Projector light against its literal formula, with intervals and integrals found by scanning."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from volumetrics_addon.physics import airlight, projector

INF = np.inf
ORIGIN = np.zeros(3)
ALONG_X = np.array([1.0, 0.0, 0.0])
DOWN = np.array([0.0, 0.0, -1.0])
UP_Y = np.array([0.0, 1.0, 0.0])
GOBO = np.random.default_rng(5).random((4, 6))
COLOR_GOBO = np.random.default_rng(6).random((3, 2, 3))


def lobe(g):
    """Henyey-Greenstein, literally."""
    return lambda c: (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * c) ** 1.5)


def isotropic(c):
    return np.full(np.shape(c), 1 / (4 * np.pi))


def in_frame(vector, light):
    """Components of a vector to the light's right, up and forward."""
    forward, up = np.asarray(light["direction"]), np.asarray(light["up"])
    right = np.cross(forward, up)
    right = right / np.linalg.norm(right)
    return np.array([right, np.cross(right, forward), forward]) @ vector


def image(x, y, z, light):
    """(u, v, radius) of a point before the light and between near and far, else None."""
    if not (z > 0 and light["near"] <= z <= light["far"]):
        return None
    u, v = x / z / math.tan(light["hfov"] / 2), y / z / math.tan(light["vfov"] / 2)
    return u, v, math.sqrt(u * u + v * v) if light["elliptic"] else max(abs(u), abs(v))


def pixel(gobo, u, v):
    """Bilinear sample, one pixel centre at a time."""
    rows, columns = gobo.shape
    x, y = (u + 1) / 2 * columns - 0.5, (1 - v) / 2 * rows - 0.5
    total = 0.0
    for i in (math.floor(y), math.floor(y) + 1):
        for j in (math.floor(x), math.floor(x) + 1):
            value = gobo[min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)]
            total += (1 - abs(y - i)) * (1 - abs(x - j)) * value
    return total


def shine(x, y, z, light):
    """Irradiance at a point in the light's frame."""
    seen = image(x, y, z, light)
    if seen is None or seen[2] > 1:
        return 0.0
    u, v, r = seen
    edge = min((1 - r) / light["blend"], 1.0) if light["blend"] > 0 else 1.0
    d = math.sqrt(x * x + y * y + z * z)
    gobo = 1.0 if light["gobo"] is None else pixel(light["gobo"], u, v)
    return light["intensity"] / d ** light["falloff"] * edge * edge * (3 - 2 * edge) * gobo


def region(x, y, z, light):
    """What changes only at the creases of the irradiance; None in the dark."""
    seen = image(x, y, z, light)
    if seen is None or seen[2] > 1:
        return None
    u, v, r = seen
    rows, columns = (0, 0) if light["gobo"] is None else light["gobo"].shape
    sides = () if light["elliptic"] or light["blend"] == 0 else (u > v, u > -v)
    cell = (math.floor((u + 1) / 2 * columns - 0.5), math.floor((1 - v) / 2 * rows - 0.5))
    return r > 1 - light["blend"], *sides, *cell


def pieces(code, low, high, count=2000):
    """(low, high) between the changes of code(t), by scanning and bisection."""
    grid = np.linspace(low, high, count).tolist()
    codes = [code(t) for t in grid]
    breaks = [low]
    for i in range(count - 1):
        a, here = grid[i], codes[i]
        while here != codes[i + 1]:
            b = grid[i + 1]
            while (m := (a + b) / 2) not in (a, b):
                a, b = (m, b) if code(m) == here else (a, m)
            a, here = b, code(b)
            breaks.append(b)
    return zip(breaks, [*breaks[1:], high])


def reference(ray, light, sigma_s, sigma_t, g):
    """Single scattering of the light by adaptive quadrature between scanned creases."""
    origin, direction, distance = ray
    start, step = (in_frame(x, light).tolist() for x in (origin - light["position"], direction))

    def at(t):
        return [a + t * b for a, b in zip(start, step)]

    def integrand(t):
        p = at(t)
        d = math.hypot(*p)
        c = -sum(a * b for a, b in zip(p, step)) / d
        phase = (1 - g**2) / (4 * math.pi * (1 + g**2 - 2 * g * c) ** 1.5)
        return sigma_s * phase * shine(*p, light) * math.exp(-sigma_t * (t + d))

    parts = pieces(lambda t: region(*at(t), light), 0.0, distance)
    lit = [(a, b) for a, b in parts if region(*at((a + b) / 2), light)]
    return sum(quad(integrand, a, b, epsabs=1e-300, epsrel=1e-13, limit=200)[0] for a, b in lit)


def make_light(**options):
    light = {
        "position": ORIGIN, "direction": DOWN, "up": UP_Y, "intensity": 4.0, "hfov": 1.5, "vfov": 1.2, "near": 0.0,
        "far": INF, "falloff": 2, "blend": 0.0, "gobo": None, "elliptic": False,
    }  # fmt: skip
    return {**light, **options}


def aim(light):
    return light["position"], light["direction"], light["up"]


def shape(light):
    return {key: light[key] for key in ("near", "far", "blend", "elliptic")}


def computed_irradiance(p, light):
    fovs = light["intensity"], light["hfov"], light["vfov"]
    return projector.projector_irradiance(
        p, *aim(light), *fovs, **shape(light), falloff=light["falloff"], gobo=light["gobo"]
    )


def computed_airlight(ray, light, sigma_s, sigma_t, phase, **options):
    return projector.projector_airlight(
        *ray, *aim(light), light["intensity"], light["hfov"], light["vfov"], sigma_s, sigma_t, phase,
        **shape(light), falloff=light["falloff"], gobo=light["gobo"], **options,
    )  # fmt: skip


def computed_interval(origin, direction, light):
    return projector.projector_interval(origin, direction, *aim(light), light["hfov"], light["vfov"], **shape(light))


def random_light(rng, **options):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    near = rng.choice([0.0, 0.5])
    return make_light(
        position=rng.normal(size=3), direction=rotation[0], up=rotation[1] * 2 + 0.7 * rotation[0],
        hfov=rng.uniform(0.2, 2.5), vfov=rng.uniform(0.2, 2.5), near=near, far=rng.choice([near + 2.0, INF]),
        falloff=int(rng.integers(3)), blend=rng.choice([0.0, 0.3, 1.0]), elliptic=bool(rng.integers(2)),
        gobo=[None, GOBO, COLOR_GOBO[..., 0]][rng.integers(3)], **options,
    )  # fmt: skip


def random_ray(rng, light):
    """A ray past a point within a few metres before the light."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    target = light["position"] + 2 * light["direction"] + rng.normal(size=3)
    return target - rng.uniform(0, 6) * direction, direction, rng.uniform(1, 12)


# --- irradiance ------------------------------------------------------------------


def test_irradiance_is_the_literal_formula():
    rng = np.random.default_rng(1)
    lit = 0
    for _ in range(60):
        light = random_light(rng)
        points = light["position"] + 2 * light["direction"] + 1.5 * rng.normal(size=(40, 3))
        expected = [shine(*in_frame(p - light["position"], light), light) for p in points]
        # Measured 4e-14, at the soft edge, where 1 - r cancels.
        np.testing.assert_allclose(computed_irradiance(points, light), expected, rtol=1e-12, atol=1e-15)
        lit += np.count_nonzero(expected)
    assert lit > 500


def test_gobo_is_the_right_way_up():
    """Seen from the light: row 0 above, column 0 on the left."""
    gobo = np.array([[1.0, 2.0], [3.0, 4.0]])
    light = make_light(falloff=0, intensity=1.0, hfov=np.pi / 2, vfov=np.pi / 2, gobo=gobo)
    # Looking down -z with y up, right is +x.
    corners = np.array([[-0.9, 0.9, -1], [0.9, 0.9, -1], [-0.9, -0.9, -1], [0.9, -0.9, -1]])
    np.testing.assert_array_equal(computed_irradiance(corners, light), [1, 2, 3, 4])
    assert computed_irradiance([0.0, 0.0, -1.0], light) == 2.5
    assert computed_irradiance(ORIGIN, light) == 2.5
    colored = computed_irradiance(corners, {**light, "gobo": gobo[..., np.newaxis] * [1, 2, 4]})
    np.testing.assert_array_equal(colored, np.outer([1, 2, 3, 4], [1, 2, 4]))
    assert computed_irradiance(corners[0], make_light(gobo=COLOR_GOBO)).shape == (3,)


@pytest.mark.parametrize("falloff", [0, 1, 2])
def test_irradiance_at_the_light(falloff):
    expected = 4.0 if falloff == 0 else INF
    assert computed_irradiance(ORIGIN, make_light(falloff=falloff)) == expected
    assert computed_irradiance(ORIGIN, make_light(falloff=falloff, near=0.1)) == 0
    assert computed_irradiance(ORIGIN, make_light(falloff=falloff, intensity=0.0)) == 0
    black = computed_irradiance(ORIGIN, make_light(falloff=falloff, gobo=np.zeros((2, 2))))
    assert black == 0


def test_total_flux():
    """Falloff 2 over a rectangle at distance h: solid angle of a pyramid, 4 asin(sin a sin b)."""
    light = make_light(intensity=1.0, hfov=1.0, vfov=0.7)
    edge = np.tan([0.5, 0.35])
    nodes, weights = np.polynomial.legendre.leggauss(30)
    x, y = np.meshgrid(edge[0] * nodes, edge[1] * nodes)
    points = np.stack([x, y, np.full_like(x, -1.0)], axis=-1)
    cosine = 1 / np.sqrt(1 + x * x + y * y)
    flux = np.sum(computed_irradiance(points, light) * cosine * np.outer(weights, weights)) * edge.prod()
    assert flux == pytest.approx(4 * math.asin(math.sin(0.5) * math.sin(0.35)), rel=1e-12)


# --- interval ----------------------------------------------------------------------


def test_interval_is_where_the_light_shines():
    rng = np.random.default_rng(2)
    hits = misses = 0
    for _ in range(150):
        light = random_light(rng)
        origin, direction, _ = random_ray(rng, light)
        found = computed_interval(origin, direction, light)

        grid = np.linspace(0, 12, 1001)
        start, step = in_frame(origin - light["position"], light), in_frame(direction, light)
        seen = [image(*p, light) for p in (start + grid[:, np.newaxis] * step).tolist()]
        radii = np.array([s[2] if s else INF for s in seen])
        for limit, (entry, exit) in ((1.0, found[:2]), (1 - light["blend"], found[2:])):
            inside = radii <= limit
            clear = np.minimum(np.abs(grid - entry), np.abs(grid - exit)) > 1e-9
            np.testing.assert_array_equal(inside[clear], ((entry <= grid) & (grid <= exit))[clear])
        hits += found.entry < found.exit
        misses += found.entry == INF
    assert hits > 60 and misses > 20


RIGHT_ANGLES = {"hfov": np.pi / 2, "vfov": np.pi / 2}


@pytest.mark.parametrize("elliptic", [False, True])
@pytest.mark.parametrize(
    "origin, direction, expected",
    [
        # Across the axis, 2 m ahead of the light: |x| <= 2.
        ((-5, 0, -2), (1, 0, 0), (3, 7)),
        ((-1, 0, -2), (1, 0, 0), (0, 3)),
        ((5, 0, -2), (1, 0, 0), (INF, -INF)),
        # Along the axis and through the apex, both ways, from before and from behind.
        ((0, 0, 3), (0, 0, -1), (3, INF)),
        ((0, 0, -3), (0, 0, 1), (0, 3)),
        ((0, 0, 3), (0, 0, 1), (INF, -INF)),
        ((0, 0, 0), (0, 0, -1), (0, INF)),
        # Through the apex askew, within and without.
        ((-0.3, 0, 0.4), (0.6, 0, -0.8), (0.5, INF)),
        ((-0.4, 0, 0.3), (0.8, 0, -0.6), (0.5, 0.5)),
        # Parallel to the axis.
        ((1, 0, 5), (0, 0, -1), (6, INF)),
        # Within a face, and parallel to it inside and outside.
        ((1, 0, -1), (np.sqrt(0.5), 0, -np.sqrt(0.5)), (0, INF)),
        ((0, 0, -1), (np.sqrt(0.5), 0, -np.sqrt(0.5)), (0, INF)),
        ((2, 0, -1), (np.sqrt(0.5), 0, -np.sqrt(0.5)), (INF, -INF)),
        # Touching the cone; an edge-parallel ray of the pyramid's side.
        ((2, -5, -2), (0, 1, 0), {False: (3, 7), True: (5, 5)}),
        # The light's shadow: behind it nothing is lit.
        ((-5, 0, 2), (1, 0, 0), (INF, -INF)),
    ],
)  # fmt: skip
def test_interval_in_special_positions(elliptic, origin, direction, expected):
    light = make_light(elliptic=elliptic, **RIGHT_ANGLES)
    expected = expected[elliptic] if isinstance(expected, dict) else expected
    found = computed_interval(np.array(origin, float), np.array(direction, float), light)
    # 1e-7: a tangent's two roots are sensitive to the square root of the rounding.
    np.testing.assert_allclose(found[:2], expected, rtol=0, atol=1e-7 if expected == (5, 5) else 1e-14)


@pytest.mark.parametrize("elliptic", [False, True])
def test_interval_of_the_soft_edge_and_of_near_and_far(elliptic):
    light = make_light(elliptic=elliptic, blend=0.5, near=1.0, far=10.0, **RIGHT_ANGLES)
    origins = [[-5.0, 0, -2], [0, 0, 3], [-5, 0, -0.5], [-5, 0, -11]]
    found = computed_interval(origins, [ALONG_X, DOWN, ALONG_X, ALONG_X], light)
    np.testing.assert_allclose(found.entry, [3, 4, INF, INF], atol=1e-14)
    np.testing.assert_allclose(found.exit, [7, 13, -INF, -INF], atol=1e-14)
    np.testing.assert_allclose(found.full_entry, [4, 4, INF, INF], atol=1e-14)
    np.testing.assert_allclose(found.full_exit, [6, 13, -INF, -INF], atol=1e-14)
    empty_core = computed_interval([0.0, 0, 3], DOWN, make_light(elliptic=elliptic, blend=1.0, **RIGHT_ANGLES))
    assert empty_core.full_entry == 3 and empty_core.full_exit == INF


# --- airlight ------------------------------------------------------------------------


def cases(seed, count):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        light = random_light(rng)
        ray = random_ray(rng, light)
        sigma_t, g = float(rng.choice([0.0, 0.05, 0.3, 2.0])), float(rng.choice([0.0, 0.6, -0.3]))
        expected = reference(ray, light, 0.2, sigma_t, g)
        if expected > 0:
            yield ray, light, sigma_t, lobe(g), expected


# Agreement of the reference with adaptive integration down to rounding, measured 8e-14.
REFERENCE_RTOL = 1e-12


def check_honesty(seed, count, **options):
    covered, relative = [], []
    for ray, light, sigma_t, phase, expected in cases(seed, count):
        result = computed_airlight(ray, light, 0.2, sigma_t, phase, **options)
        error = abs(result.value - expected)
        covered.append(error <= result.error_estimate + REFERENCE_RTOL * expected)
        relative.append(error / expected)
        assert error <= 20 * result.error_estimate + REFERENCE_RTOL * expected
        if options.get("adaptive"):
            assert error <= (options["rtol"] + REFERENCE_RTOL) * expected
    assert len(covered) > count / 3
    assert np.mean(covered) >= 0.99
    return np.array(relative)


def test_airlight_and_its_error_estimate():
    relative = check_honesty(3, 150)
    assert np.median(relative) < 1e-11


@pytest.mark.parametrize("options", [{"order": 4}, {"adaptive": True, "rtol": 1e-6}, {"adaptive": True, "rtol": 1e-9}])
def test_airlight_error_estimate_of_other_rules(options):
    check_honesty(4, 60, **options)


@pytest.mark.sweep
@pytest.mark.parametrize("seed", range(8))
def test_airlight_error_estimate_in_many_cases(seed):
    check_honesty(100 + seed, 400)


@pytest.mark.parametrize("elliptic", [False, True])
def test_airlight_with_a_colored_gobo(elliptic):
    light = make_light(gobo=COLOR_GOBO, blend=0.2, elliptic=elliptic)
    ray = np.array([-5.0, 0.1, -2.0]), ALONG_X, 9.0
    result = computed_airlight(ray, light, 0.2, 0.3, lobe(0.4))
    assert result.value.shape == result.error_estimate.shape == result.evaluations.shape == (3,)
    for channel in range(3):
        single = {**light, "gobo": COLOR_GOBO[..., channel]}
        assert result.value[channel] == pytest.approx(reference(ray, single, 0.2, 0.3, 0.4), rel=1e-11)
        alone = computed_airlight(ray, single, 0.2, 0.3, lobe(0.4))
        assert result.value[channel] == alone.value


def test_airlight_of_a_wide_projector_is_that_of_a_point():
    """Behind a wide hard frustum the ray sees a point light."""
    ray = np.array([-3.0, 0.5, -2.0]), ALONG_X, 7.0
    for elliptic in (False, True):
        light = make_light(hfov=3.1, vfov=3.1, elliptic=elliptic)
        result = computed_airlight(ray, light, 0.2, 0.3, lobe(0.4), adaptive=True)
        expected = airlight.point_light(*ray, ORIGIN, 4.0, 0.2, 0.3, lobe(0.4), adaptive=True)
        assert result.value == pytest.approx(expected.value, rel=1e-9)


def test_airlight_of_a_round_projector_is_that_of_a_spot():
    ray = np.array([-3.0, 0.5, -2.0]), ALONG_X, 7.0
    light = make_light(hfov=1.1, vfov=1.1, elliptic=True)
    result = computed_airlight(ray, light, 0.2, 0.3, lobe(0.4))
    expected = airlight.spot_light(*ray, ORIGIN, 4.0, 0.2, 0.3, lobe(0.4), DOWN, 1.1)
    assert result.value == pytest.approx(expected.value, rel=1e-12)


@pytest.mark.parametrize("sigma_t", [0.0, 1e-30, 0.3, 1e30])
@pytest.mark.parametrize("distance", [0.0, 1e-9, 5.0, INF])
def test_ambient(sigma_t, distance):
    light = make_light(intensity=0.0)
    result = computed_airlight((ORIGIN, ALONG_X, distance), light, 0.2, sigma_t, isotropic, ambient=3.0)
    if sigma_t == 0 or sigma_t * distance < 1e-20:
        expected = 0.6 * distance if distance < INF else 0.6 / sigma_t if sigma_t else INF
    else:
        expected = 0.6 / sigma_t * (1 - math.exp(-sigma_t * distance) if sigma_t * distance > 1 else
                                    -math.expm1(-sigma_t * distance))  # fmt: skip
    assert result.value == pytest.approx(expected, rel=1e-14)
    assert result.evaluations == 0
    lit = computed_airlight((np.array([-1.0, 0, -2]), ALONG_X, 2.0), make_light(), 0.2, 0.3, isotropic, ambient=3.0)
    dark = computed_airlight((np.array([-1.0, 0, -2]), ALONG_X, 2.0), make_light(), 0.2, 0.3, isotropic)
    assert lit.value - dark.value == pytest.approx(0.6 / 0.3 * -math.expm1(-0.6), rel=1e-13)


@pytest.mark.parametrize("elliptic", [False, True])
@pytest.mark.parametrize("falloff", [0, 1, 2])
def test_ray_through_the_light(falloff, elliptic):
    """On the axis t + d is constant behind the light's front: the integrals are elementary."""
    towards = np.array([0.0, 0.0, -5.0]), -DOWN, 5.0
    light = make_light(falloff=falloff, elliptic=elliptic, blend=0.4)
    value = computed_airlight(towards, light, 0.2, 0.3, isotropic).value
    full = 0.2 * 4 / (4 * np.pi) * math.exp(-1.5)
    assert value == (pytest.approx(5 * full, rel=1e-13) if falloff == 0 else INF)
    # From 1 m on in front of the light.
    cut = computed_airlight(towards, {**light, "near": 1.0}, 0.2, 0.3, isotropic).value
    assert cut == pytest.approx(full * (4, math.log(5), 1 - 1 / 5)[falloff], rel=1e-13)
    # Ended by the ray.
    cut = computed_airlight((*towards[:2], 4.0), light, 0.2, 0.3, isotropic).value
    assert cut == pytest.approx(full * (4, math.log(5), 1 - 1 / 5)[falloff], rel=1e-13)
    # Shining away from a ray that ends at it, or through a black image: nothing.
    assert computed_airlight((np.array([0, 0, 5.0]), DOWN, 5.0), light, 0.2, 0.3, isotropic).value == 0
    black = {**light, "gobo": np.zeros((2, 2))}
    assert computed_airlight(towards, black, 0.2, 0.3, isotropic).value == 0
    assert computed_airlight((np.array([0, 0, 5.0]), DOWN, 9.0), light, 0.2, 0.0, isotropic).value == (
        pytest.approx(0.2 * 4 / (4 * np.pi) * 4, rel=1e-13) if falloff == 0 else INF
    )


@pytest.mark.parametrize("falloff", [0, 1, 2])
def test_infinite_rays(falloff):
    ray = np.array([1.0, 0.0, -1.0]), DOWN, INF
    light = make_light(falloff=falloff, hfov=2.0, vfov=2.0)
    clear = computed_airlight(ray, light, 0.2, 0.0, isotropic, adaptive=True).value
    # Falloff 2 without extinction: the angle from 45 degrees to the end of the ray over its height.
    assert clear == (pytest.approx(0.2 * 4 / (4 * np.pi) * np.pi / 4, rel=1e-12) if falloff == 2 else INF)
    dense = computed_airlight(ray, light, 0.2, 0.5, isotropic, adaptive=True, rtol=1e-10)
    finite = reference((ray[0], ray[1], 60.0), light, 0.2, 0.5, 0.0)
    assert dense.value == pytest.approx(finite, rel=1e-9)
    ended = computed_airlight(ray, {**light, "far": 3.0}, 0.2, 0.0, isotropic, adaptive=True)
    finite = reference((ray[0], ray[1], 2.0), light, 0.2, 0.0, 0.0)
    assert ended.value == pytest.approx(finite, rel=1e-9)


def test_dark_front_does_not_hide_a_bright_back():
    """A gobo that is black where a dense ray enters: what lies 60 optical depths behind still counts."""
    gobo = np.zeros((1, 64))
    gobo[0, -8:] = 1.0
    light = make_light(gobo=gobo, hfov=np.pi / 2, vfov=np.pi / 2)
    ray = np.array([-2.0, 0.0, -2.0]), ALONG_X, 4.0
    expected = reference(ray, light, 1.0, 20.0, 0.0)
    result = computed_airlight(ray, light, 1.0, 20.0, isotropic, adaptive=True)
    assert 0 < expected < math.exp(-90)
    assert result.value == pytest.approx(expected, rel=1e-8)
    # Only the lit pixels cost: 10 of 66 pieces of the ray, at 16 + 8 evaluations or a few times that.
    quick = computed_airlight(ray, light, 1.0, 20.0, isotropic)
    assert quick.evaluations <= 10 * 24


def test_tiles_change_nothing(monkeypatch):
    rng = np.random.default_rng(8)
    origins = np.array([-5.0, 0.0, -2.0]) + 0.5 * rng.normal(size=(50, 3))
    light = make_light(gobo=COLOR_GOBO, blend=0.2)
    whole = computed_airlight((origins, ALONG_X, 9.0), light, 0.2, 0.3, lobe(0.4))
    monkeypatch.setattr(projector, "_TILE", 1000)
    tiled = computed_airlight((origins, ALONG_X, 9.0), light, 0.2, 0.3, lobe(0.4))
    np.testing.assert_allclose(tiled.value, whole.value, rtol=1e-15)
    assert whole.value.shape == (50, 3)


def test_broadcasting():
    directions = np.array([[1.0, 0, 0], [0, 1, 0]], dtype=np.float32)[:, np.newaxis, :]
    sigma = np.array([0.1, 0.2, 0.4], dtype=np.float32)
    origin = [-2.0, 0, -2]
    arguments = ORIGIN, DOWN, UP_Y, [4.0, 1.0, 2.0], 1.5, [[1.2], [0.4]]
    result = projector.projector_airlight(origin, directions, 5.0, *arguments, sigma, sigma, isotropic, near=[0, 1, 0.5])
    assert all(np.shape(x) == (2, 3) for x in result)
    one = projector.projector_airlight(
        origin, ALONG_X, 5.0, ORIGIN, DOWN, UP_Y, 1.0, 1.5, 1.2, sigma[1], sigma[1], isotropic, near=1.0
    )
    assert one.value == result.value[0, 1] > 0
    for gobo, last in ((None, ()), (GOBO, ()), (COLOR_GOBO, (3,))):
        empty = projector.projector_airlight(np.empty((0, 3)), ALONG_X, 5.0, *arguments[:3], 1.0, 1.0, 1.0, 1, 1,
                                             isotropic, gobo=gobo)  # fmt: skip
        assert empty.value.shape == (0, *last)
        e = projector.projector_irradiance(np.empty((0, 3), np.float32), *arguments[:3], 1.0, 1.0, 1.0, gobo=gobo)
        assert e.shape == (0, *last)
    assert projector.projector_interval(np.empty((0, 3)), ALONG_X, ORIGIN, DOWN, UP_Y, 1.0, 1.0).entry.shape == (0,)


@pytest.mark.parametrize("falloff", [0, 1, 2])
@pytest.mark.parametrize("sigma_t", [1e-90, 1e-3, 1.0])
def test_a_beam_that_begins_behind_all_light_is_dark(sigma_t, falloff):
    """A needle of 1e-200 rad reaches a ray beside it after 2e200 m, where any medium has swallowed it."""
    ray = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), INF
    assert computed_airlight(ray, make_light(hfov=1e-200, falloff=falloff), 0.2 * sigma_t, sigma_t, isotropic).value == 0.0


@settings(max_examples=150, deadline=None)
@given(
    st.tuples(*[st.one_of(st.floats(-1e6, 1e6), st.sampled_from([0.0, 1e-310, 1e100, -1e-160, 1.0]))] * 3),
    st.sampled_from([(1, 0, 0), (0, 0, -1), (0, 0, 1), (0.6, 0, -0.8), (0.48, 0.6, -0.64)]),
    st.one_of(st.floats(0, 1e30), st.just(INF)),
    st.one_of(st.floats(0, 1e30), st.floats(0, 3)),
    st.one_of(st.floats(0.01, 3.1), st.sampled_from([5e-324, 1e-200, np.pi / 2, np.nextafter(np.pi, 0)])),
    st.sampled_from([0.0, 0.3, 5e-324, 1.0]), st.booleans(), st.sampled_from([0, 1, 2]), st.booleans(),
    st.sampled_from([(0.0, INF), (0.0, 0.0), (1.0, 2.0), (5e-324, 1e300)]),
)  # fmt: skip
def test_never_nan_nor_negative(origin, direction, distance, sigma_t, fov, blend, elliptic, falloff, adaptive, slab):
    light = make_light(
        hfov=fov, blend=blend, elliptic=elliptic, falloff=falloff, near=slab[0], far=slab[1], gobo=GOBO[:2, :2]
    )
    ray = np.array(origin, float), np.array(direction, float), distance
    result = computed_airlight(ray, light, 0.2, sigma_t, lobe(0.5), adaptive=adaptive)
    assert result.value >= 0 and result.error_estimate >= 0
    touches = np.linalg.norm(np.cross(ray[0], ray[1])) < 1e-140 or np.any(np.abs(origin) > 1e90)
    assert np.isfinite(result.value) or touches or (sigma_t < 1e-140 and distance == INF)
    assert computed_irradiance(origin, light) >= 0
    interval = computed_interval(*ray[:2], light)
    for low, high in (interval[:2], interval[2:]):
        assert 0 <= low <= high or (low, high) == (INF, -INF)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"hfov": 0.0}, "horizontal_fov must be in \\(0, pi\\) radians, got 0.0"),
        ({"vfov": 3.2}, "vertical_fov .* got 3.2"),
        ({"near": -1.0}, "near .* got -1.0"),
        ({"near": 2.0, "far": 1.0}, "far - near must be >= 0 metres, got -1.0; let far lie"),
        ({"far": np.nan}, "far .* got nan"),
        ({"falloff": 3}, "falloff must be 0, 1 or 2, got 3"),
        ({"blend": 1.5}, "blend .* got 1.5"),
        ({"intensity": -1.0}, "intensity .* got -1.0"),
        ({"up": DOWN * 2}, "sine of the angle between up and direction.* got 0.0; choose up"),
        ({"up": ORIGIN}, "sine of the angle between up and direction"),
        ({"direction": [0, 0, -2.0]}, "length of direction of the light .* got 2.0"),
        ({"gobo": -GOBO}, "gobo .* got -0"),
        ({"gobo": np.ones((2, 2, 4))}, r"gobo must have shape .* got \(2, 2, 4\); drop an alpha"),
        ({"gobo": np.ones(3)}, r"gobo must have shape .* got \(3,\)"),
        ({"gobo": np.ones((0, 3))}, r"gobo must have shape .* got \(0, 3\)"),
    ],
)
def test_errors_name_value_and_remedy(change, message):
    light = make_light(**change)
    with pytest.raises(ValueError, match=message):
        computed_irradiance(DOWN, light)
    with pytest.raises(ValueError, match=message):
        computed_airlight((ORIGIN, ALONG_X, 1.0), light, 0.1, 0.1, isotropic)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"ambient": -1.0}, "ambient .* got -1.0"),
        ({"order": 1}, "order must be an integer >= 2, got 1"),
        ({"rtol": 0}, "rtol .* got 0.0"),
        ({"sigma_t": -0.2}, "sigma_t .* got -0.2"),
        ({"phase": lambda c: -np.ones_like(c)}, "phase.* must be >= 0 per steradian, got -1.0"),
    ],
)
def test_airlight_errors(change, message):
    arguments = {"sigma_s": 0.1, "sigma_t": 0.1, "phase": isotropic, **change}
    with pytest.raises(ValueError, match=message):
        computed_airlight((np.array([-1.0, 0, -2]), ALONG_X, 2.0), make_light(), **arguments)
