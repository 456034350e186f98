# SPDX-License-Identifier: GPL-3.0-or-later
"""What must hold between results whatever their values: products, sums, bounds, symmetries, units."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from volumetrics_addon.physics import airlight, atmosphere, grid, opacity_map, phase, projector, slab, transmittance
from volumetrics_addon.reference import path_tracing, single_scattering
from volumetrics_addon.scene.model import Phase, Scene, Sun, Volume

from .cases import count
from .declared import EARTH, GROUND, TOP
from .scenes import BALL, EYE, ROOM, lit, medium, scaled_world, slab as slab_scene

quick = settings(max_examples=60, derandomize=True, deadline=None, database=None)
slow = settings(quick, max_examples=15)

ROUNDING = 1e-12  # a few operations on numbers of ordinary size; measured 7e-14 and less unless a test says otherwise


def floats(low, high):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


cosines, asymmetries, fractions, uniforms = floats(-1.0, 1.0), floats(-0.95, 0.95), floats(0.0, 1.0), floats(0.0, 1.0)
sigmas, lengths, heights = floats(0.0, 20.0), floats(0.0, 50.0), floats(-30.0, 30.0)
units = st.sampled_from([2.0**-40, 2.0**-7, 3.0, 2.0**30])


def directions():
    return (
        st.tuples(*[floats(-1.0, 1.0)] * 3)
        .filter(lambda v: math.hypot(*v) > 1e-3)
        .map(lambda v: np.array(v) / math.hypot(*v))
    )


def positions(reach=3.0):
    return st.tuples(*[floats(-reach, reach)] * 3).map(np.array)


def assert_same(name, value, expected, rtol=ROUNDING, atol=0.0):
    np.testing.assert_allclose(value, expected, rtol=rtol, atol=atol)
    count("identities", name, np.size(value))


def assert_ordered(name, small, large, slack=0.0):
    assert np.all(np.asarray(small) <= np.asarray(large) + slack), (small, large)
    count("identities", name, np.size(small))


# --- transmittance along one ray ---------------------------------------------------------------------------------


def assert_multiplies(name, depth, clear, a, b):
    """Optical depth adds and grows, transmittance multiplies over [0, a] and [a, a + b]. ``depth(start, length)``."""
    first, second, whole = depth(0.0, a), depth(a, b), depth(0.0, a + b)
    # The second start is rounded; deep in a steep fog that moves the density. Measured 6e-13.
    assert_same(name, first + second, whole, rtol=1e-11, atol=1e-300)
    assert_ordered(name, first, whole * (1 + 1e-12))
    assert_same(name, clear(0.0, a) * clear(a, b), clear(0.0, a + b), rtol=1e-9 * (1 + min(whole, 700.0)), atol=1e-300)


@quick
@given(sigmas, lengths, lengths)
def test_beer_lambert(sigma, a, b):
    assert_multiplies(
        "transmittance.beer_lambert", lambda _, d: sigma * d, lambda _, d: transmittance.beer_lambert(sigma, d), a, b
    )


@quick
@given(heights, cosines, lengths, lengths, sigmas, floats(0.5, 100.0))
def test_height_fog(z, slope, a, b, sigma, scale):
    rest = sigma, scale, 1.0
    assert_multiplies(
        "transmittance.height_optical_depth",
        lambda t, d: transmittance.height_optical_depth(z + t * slope, slope, d, *rest),
        lambda t, d: transmittance.height_transmittance(z + t * slope, slope, d, *rest),
        a,
        b,
    )


@quick
@given(floats(0.0, 5e4), cosines, floats(0.0, 3e5), floats(0.0, 3e5), floats(0.0, 1e-3))
def test_spherical_atmosphere(altitude, mu, a, b, sigma):
    radius = GROUND + altitude

    def at(t):
        there = math.sqrt(radius**2 + 2 * radius * mu * t + t * t)
        return there, max(-1.0, min(1.0, (radius * mu + t) / there))

    assume(min(at(t)[0] for t in (a, a + b, max(0.0, min(-radius * mu, a + b)))) >= GROUND - 1e4)
    rest = sigma, 8000.0, GROUND
    first, second = atmosphere.optical_depth(*at(0.0), a, *rest), atmosphere.optical_depth(*at(a), b, *rest)
    whole = atmosphere.optical_depth(*at(0.0), a + b, *rest)
    # The second start is rounded by 1e-9 m and 1e-16 in its cosine. Measured 6e-14.
    assert_same("atmosphere.optical_depth", first + second, whole, rtol=1e-12, atol=1e-300)
    assert_ordered("atmosphere.optical_depth", first, whole * (1 + 1e-12))
    assert_same(
        "atmosphere.transmittance",
        np.exp(-first) * np.exp(-second),
        atmosphere.transmittance(*at(0.0), a + b, *rest),
        rtol=1e-9 * (1 + min(whole, 700.0)),
        atol=1e-300,
    )


VOXELS = np.random.default_rng(3).random((3, 4, 5))


@quick
@given(positions(), directions(), floats(0.0, 4.0), floats(0.0, 4.0), sigmas, st.booleans())
def test_grid(origin, direction, a, b, sigma, nearest):
    def depth(t, d):
        return grid.grid_optical_depth(VOXELS, (-1.0,) * 3, (1.0,) * 3, origin + t * direction, direction, d, sigma, nearest)

    first, second, whole = depth(0.0, a), depth(a, b), depth(0.0, a + b)
    # The second start is rounded by 1e-15 m. Measured 7e-15 for a sigma of up to 20.
    assert_same("grid.grid_optical_depth", first + second, whole, rtol=0.0, atol=2e-15 * (1 + sigma))
    assert_ordered("grid.grid_optical_depth", first, whole, slack=2e-15 * (1 + sigma))
    assert_ordered("grid.grid_optical_depth", whole, sigma * VOXELS.max() * math.sqrt(12.0))


@quick
@given(heights, cosines, lengths, lengths, heights, lengths)
def test_slab_path(z, slope, a, b, bottom, thickness):
    top = bottom + thickness
    first, whole = (transmittance.slab_path_length(z, slope, d, bottom, top) for d in (a, a + b))
    second = transmittance.slab_path_length(z + a * slope, slope, b, bottom, top)
    # Where the ray is nearly level the second start's rounding of 1e-14 m may move it in or out.
    assume(abs(slope) > 1e-3)
    assert_same("transmittance.slab_path_length", first + second, whole, rtol=0.0, atol=1e-10)
    assert_ordered("transmittance.slab_path_length", whole, a + b)


@quick
@given(fractions, fractions)
def test_coverage_blend(coverage, clear):
    value = transmittance.coverage_blend(coverage, clear)
    assert_ordered("transmittance.coverage_blend", 0.0, value)
    assert_ordered("transmittance.coverage_blend", value, clear)


@quick
@given(cosines, lengths, floats(1.0, 3.0), floats(1.0, 3.0))
def test_a_denser_plate_is_crossed_more_steeply(c, thickness, n, m):
    paths = [transmittance.plate_path_length(c, thickness, x) for x in sorted((n, m))]
    assert_ordered("transmittance.plate_path_length", paths[1], paths[0] * (1 + ROUNDING))
    assert_ordered("transmittance.plate_path_length", thickness, paths[1] * (1 + ROUNDING))


# --- phase functions ---------------------------------------------------------------------------------------------

# Gauss-Legendre on panels that halve towards both ends of [-1, 1], down to 2^-40.
_EDGES = np.concatenate([[0.0], 0.5 ** np.arange(40, -1, -1)])
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_FROM_END = (_EDGES[:-1, None] + np.diff(_EDGES)[:, None] * (_NODES + 1) / 2).ravel()
_WEIGHT = (np.diff(_EDGES)[:, None] * _WEIGHTS / 2).ravel()
COSINE_NODES, COSINE_WEIGHTS = np.concatenate([_FROM_END - 1, 1 - _FROM_END]), np.tile(_WEIGHT, 2)

LOBES = {
    "rayleigh": (
        lambda c, g, x: phase.rayleigh(c),
        lambda g, x: phase.mean_cosine_rayleigh(),
        lambda u, g, x: phase.sample_rayleigh(u),
    ),
    "henyey_greenstein": (
        lambda c, g, x: phase.henyey_greenstein(c, g),
        lambda g, x: phase.mean_cosine_henyey_greenstein(g),
        lambda u, g, x: phase.sample_henyey_greenstein(u, g),
    ),
    "schlick": (
        lambda c, g, x: phase.schlick(c, g),
        lambda g, x: phase.mean_cosine_schlick(g),
        lambda u, g, x: phase.sample_schlick(u, g),
    ),
    "cornette_shanks": (
        lambda c, g, x: phase.cornette_shanks(c, g),
        lambda g, x: phase.mean_cosine_cornette_shanks(g),
        lambda u, g, x: phase.sample_cornette_shanks(u, g),
    ),
    "draine": (
        lambda c, g, x: phase.draine(c, g, 250 * x),
        lambda g, x: phase.mean_cosine_draine(g, 250 * x),
        lambda u, g, x: phase.sample_draine(u, g, 250 * x),
    ),
    "dual_henyey_greenstein": (
        lambda c, g, x: phase.dual_henyey_greenstein(c, g, -0.3 * g, x),
        lambda g, x: phase.mean_cosine_dual_henyey_greenstein(g, -0.3 * g, x),
        None,
    ),
}


@quick
@given(st.sampled_from(sorted(LOBES)), floats(-0.9999, 0.9999), fractions)
def test_phase_functions_integrate_to_one_and_to_their_mean_cosine(name, g, x):
    p, mean, _ = LOBES[name]
    c = COSINE_NODES
    density = 2 * np.pi * COSINE_WEIGHTS * p(c, g, x)
    # Measured 2e-16, and what rounds the nodes: near the ends a cosine is known to half a unit in its last place, and a lobe changes
    # by 3 g / (1 + g^2 - 2 g c) of itself with it. Measured a tenth of it, up to 1e-11 at |g| = 0.9999.
    slope = 3 * abs(g) / (1 + g * g - 2 * abs(g * c))
    rounding = np.sqrt(np.sum((density * slope * np.spacing(np.abs(c))) ** 2))
    assert_same(f"phase.{name}", density.sum(), 1.0, rtol=1e-14 + rounding)
    assert_same(f"phase.mean_cosine_{name}", density @ c, mean(g, x), rtol=0.0, atol=1e-14 + rounding)


@quick
@given(floats(0.01, 50.0))
def test_droplets_integrate_to_one(diameter):
    density = 2 * np.pi * COSINE_WEIGHTS * phase.mie_fit(COSINE_NODES, diameter)
    # Lobes of up to g = 0.998; measured 8e-14.
    assert_same("phase.mie_fit", density.sum(), 1.0, rtol=1e-12)
    assert_same(
        "phase.mean_cosine_mie_fit", density @ COSINE_NODES, phase.mean_cosine_mie_fit(diameter), rtol=0.0, atol=1e-12
    )


@quick
@given(st.sampled_from(sorted(LOBES)), cosines, floats(-0.999999, 0.999999), fractions)
def test_a_mirrored_lobe_is_the_lobe_mirrored(name, c, g, x):
    """p(c, g) = p(-c, -g): forward and backward are the same formula."""
    p, mean, _ = LOBES[name]
    assert_same(f"phase.{name}", p(c, g, x), p(-c, -g, x), rtol=0.0)
    assert_same(f"phase.mean_cosine_{name}", mean(g, x), -mean(-g, x), rtol=0.0)


@quick
@given(
    st.sampled_from(sorted(set(LOBES) - {"dual_henyey_greenstein"})), floats(-0.9999, 0.9999), fractions, uniforms, uniforms
)
def test_samples_grow_with_the_uniform_number(name, g, x, u, v):
    sample = LOBES[name][2]
    low, high = sample(np.array(sorted((u, v))), g, x)
    # Newton's method ends within rounding of the distribution function.
    assert_ordered(f"phase.sample_{name}", low, high, slack=1e-14)
    assert_same(f"phase.sample_{name}", sample(np.array([0.0, 1.0]), g, x), [-1.0, 1.0], rtol=1e-12)


@quick
@given(uniforms, floats(0.001, 0.499), floats(1.001, 3.0), floats(0.01, 50.0), asymmetries, asymmetries, fractions)
def test_samples_are_cosines(u, backscatter, ior, diameter, g0, g1, weight):
    for name, value in (
        ("fournier_forand", phase.sample_fournier_forand(u, backscatter, ior)),
        ("mie_fit", phase.sample_mie_fit(u, diameter)),
        ("dual_henyey_greenstein", phase.sample_dual_henyey_greenstein(u, g0, g1, weight)),
    ):
        assert_ordered(f"phase.sample_{name}", abs(value), 1.0)


# --- slabs -----------------------------------------------------------------------------------------------------------


@slow
@given(
    floats(-0.999, 0.999),
    st.sampled_from([0.0, 1e-300, 1e-6, 0.1, 3.0, 1e3, 1e12, math.inf]),
    st.sampled_from([1.0, 1.33, 2.5]),
)
def test_slabs_conserve_energy(g, tau, ior):
    result = slab.adding_doubling(g, 1.0, tau, ior, quadrature=6)
    for r, t in ((result.reflectance, result.transmittance), (result.diffuse_reflectance, result.diffuse_transmittance)):
        # Measured 2.4e-15 over 150 random slabs.
        assert_same("slab.adding_doubling", r + t, 1.0, rtol=0.0, atol=1e-13)


@slow
@given(floats(-0.9, 0.9), floats(1e-3, 50.0), fractions, fractions, st.sampled_from([1.0, 1.5]))
def test_slabs_absorb_and_get_brighter_with_the_albedo(g, tau, a, b, ior):
    low, high = (slab.adding_doubling(g, x, tau, ior, quadrature=6) for x in sorted((a, b)))
    for before, after in (
        (low.reflectance, high.reflectance),
        (low.transmittance, high.transmittance),
        (low.diffuse_reflectance, high.diffuse_reflectance),
        (low.diffuse_transmittance, high.diffuse_transmittance),
    ):
        assert_ordered("slab.adding_doubling", before, after, slack=1e-13)
    for result in (low, high):
        assert_ordered("slab.adding_doubling", result.reflectance + result.transmittance, 1.0, slack=1e-13)
        assert_ordered("slab.adding_doubling", result.diffuse_reflectance + result.diffuse_transmittance, 1.0, slack=1e-13)


@slow
@given(
    floats(-0.6, 0.6),
    floats(0.05, 1.0),
    floats(0.05, 20.0),
    floats(0.1, 1.0),
    floats(0.1, 1.0),
    floats(0.0, 3.14),
    st.sampled_from([1, -1]),
)
def test_slabs_are_reciprocal(g, albedo, tau, mu0, mu, azimuth, side):
    """Helmholtz: L(mu0 -> mu) / mu0 is the same with sun and eye exchanged, above and through the slab."""
    there = slab.slab_radiance(g, albedo, tau, mu0, side * mu, azimuth, quadrature=16)
    back = slab.slab_radiance(g, albedo, tau, mu, side * mu0, azimuth, quadrature=16)
    assert_same(
        "slab.slab_radiance",
        there.value / mu0,
        back.value / mu,
        rtol=1e-6,
        atol=4 * (there.error_estimate / mu0 + back.error_estimate / mu),
    )


@quick
@given(fractions, fractions, fractions, fractions)
def test_h_function_grows_from_one(a, b, m, n):
    (a, b), (m, n) = sorted((a, b)), sorted((m, n))
    value = slab.h_function(np.array([[a], [b]]), np.array([m, n]))
    assert_ordered("slab.h_function", 1.0, value, slack=1e-13)
    assert_ordered("slab.h_function", value[0], value[1], slack=1e-12)
    assert_ordered("slab.h_function", value[:, 0], value[:, 1], slack=1e-12)


# --- airlight --------------------------------------------------------------------------------------------------------


def lobe(c):
    return phase.henyey_greenstein(c, 0.4)


def airlights(origin, direction, distance, light, sigma_s, sigma_t, strength, k=1.0):
    """All lights at once, in a unit of length k times as large."""
    ray, where, media = (origin * k, direction, distance * k), light * k, (sigma_s / k, sigma_t / k, lobe)
    down = np.array([0.0, 0.0, -1.0])
    lens = dict(light_direction=down, up=(0.0, 1.0, 0.0), horizontal_fov=1.5, vertical_fov=1.0, blend=0.3)
    return {
        "airlight.point_light": airlight.point_light(*ray, where, strength * k * k, *media),
        "airlight.spot_light": airlight.spot_light(*ray, where, strength * k * k, *media, down, 1.5, 0.5),
        "airlight.sun": airlight.sun(*ray, down, strength, *media, sun_distance=2.0 * k),
        "airlight.point_light_without_extinction": airlight.point_light_without_extinction(
            *ray, where, strength * k * k, sigma_s / k
        ),
        "projector.projector_airlight": projector.projector_airlight(
            *ray, where, intensity=strength * k * k, sigma_s=media[0], sigma_t=media[1], phase=lobe, **lens
        ),
    }


rays_and_light = (
    positions(),
    directions(),
    lengths,
    positions().map(lambda p: p + (0.0, 0.0, 3.0)),
    floats(0.1, 5.0),
    floats(0.0, 5.0),
)


def apart(origin, direction, light):
    """A light on the ray makes it infinite; one close to it turns its position's last digits into the result's first."""
    assume(np.linalg.norm(np.cross(light - origin, direction)) > 1e-2)


@quick
@given(*rays_and_light)
def test_airlight_is_linear_in_the_light(origin, direction, distance, light, sigma_s, sigma_t):
    apart(origin, direction, light)
    one, four = (airlights(origin, direction, distance, light, sigma_s, sigma_t, x) for x in (1.0, 4.0))
    for name in one:
        # Below 2e-308 numbers have fewer digits: they are 5e-324 apart.
        assert_same(name, four[name].value, 4 * one[name].value, rtol=1e-14, atol=1e-320)


@quick
@given(*rays_and_light, lengths)
def test_airlight_grows_with_the_ray(origin, direction, distance, light, sigma_s, sigma_t, more):
    apart(origin, direction, light)
    short, long = (airlights(origin, direction, d, light, sigma_s, sigma_t, 1.0) for d in (distance, distance + more))
    for name in short:
        assert_ordered(
            name,
            short[name].value,
            long[name].value,
            slack=4 * (short[name].error_estimate + long[name].error_estimate) + 1e-12 * long[name].value,
        )


@quick
@given(*rays_and_light, units)
def test_airlight_knows_no_unit_of_length(origin, direction, distance, light, sigma_s, sigma_t, k):
    apart(origin, direction, light)
    here, there = (airlights(origin, direction, distance, light, sigma_s, sigma_t, 1.0, unit) for unit in (1.0, k))
    for name in here:
        assert_same(name, there[name].value, here[name].value, rtol=1e-11, atol=1e-14)


# --- units of length ---------------------------------------------------------------------------------------------------


@quick
@given(heights, cosines, lengths, sigmas, floats(0.1, 100.0), units)
def test_transmittance_knows_no_unit_of_length(z, slope, d, sigma, scale, k):
    def depths(k):
        return {
            "transmittance.beer_lambert": transmittance.beer_lambert(sigma / k, d * k),
            "transmittance.exp2_fog": transmittance.exp2_fog(d * k, sigma / k),
            "transmittance.linear_fog": transmittance.linear_fog(d * k, 1.0 * k, 7.0 * k),
            "transmittance.height_optical_depth": transmittance.height_optical_depth(
                z * k, slope, d * k, sigma / k, scale * k, 2.0 * k
            ),
            "transmittance.slab_optical_depth": transmittance.slab_optical_depth(
                sigma / k, z * k, slope, d * k, -1.0 * k, 3.0 * k
            ),
            "transmittance.plate_path_length": transmittance.plate_path_length(slope, d * k, 1.4) / k,
            "transmittance.shell_path_length": transmittance.shell_path_length(d / 10 * k, 3.0 * k, 2.5 * k, 1.4) / k,
            "atmosphere.optical_depth": atmosphere.optical_depth(abs(z) * k, slope, d * k, sigma / k, scale * k, 20.0 * k),
        }

    for (name, value), expected in zip(depths(k).items(), depths(1.0).values()):
        # The unit 3 rounds. Measured 7e-15, and 1e-14 absolutely.
        assert_same(name, value, expected, rtol=ROUNDING, atol=1e-13)


@quick
@given(positions(), directions(), lengths, sigmas, units)
def test_grids_know_no_unit_of_length(origin, direction, d, sigma, k):
    here, there = (
        grid.grid_optical_depth(VOXELS, (-x,) * 3, (x,) * 3, origin * x, direction, d * x, sigma / x) for x in (1.0, k)
    )
    assert_same("grid.grid_optical_depth", there, here, rtol=0.0, atol=2e-15 * (1 + sigma))


# --- opacity maps ------------------------------------------------------------------------------------------------------


@quick
@given(st.lists(floats(0.0, 30.0), min_size=1, max_size=12), floats(0.1, 10.0), st.integers(1, 9), floats(1e-3, 0.3))
def test_opacity_maps_that_promise_it_fall_monotonously(extinction, length, number, tolerance):
    depth = np.linspace(0.0, length, 4 * len(extinction) + 1)
    for name, built in (
        ("extinction_volume", opacity_map.extinction_volume(extinction, length, number)),
        ("deep_shadow_map", opacity_map.deep_shadow_map(extinction, length, tolerance)),
    ):
        value = built.transmittance(depth)
        assert_ordered(f"opacity_map.{name}", value[1:], value[:-1], slack=1e-15)
        exact = np.exp(
            -np.interp(
                depth,
                length * np.linspace(0, 1, len(extinction) + 1),
                np.concatenate([[0.0], np.cumsum(extinction)]) * length / len(extinction),
            )
        )
        # These are the depths at which the stated error is measured.
        assert_ordered(f"opacity_map.{name}", np.abs(value - exact), built.error_estimate, slack=1e-14)


# --- planets -----------------------------------------------------------------------------------------------------------


@quick
@given(floats(GROUND, TOP), cosines, cosines)
def test_planets_pass_less_light_than_there_is(radius, mu, mu_s):
    clear = EARTH.sunlight(radius, mu_s)
    assert_ordered("atmosphere.Planet.sunlight", clear, 1.0)
    end = min(atmosphere.top_distance(radius, mu, TOP), atmosphere.ground_distance(radius, mu, GROUND))
    half, whole = (EARTH.transmittance(radius, mu, d) for d in (end / 2, end))
    assert_ordered("atmosphere.Planet.transmittance", whole, half * (1 + 1e-12))


# --- integrators -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kernel", path_tracing.KERNELS)
@pytest.mark.parametrize("shape", [ROOM, BALL])
@pytest.mark.parametrize("extinction, g", [(1e-6, 0.0), (1.0, 0.8), (4.0, -0.5)])
def test_white_furnace(kernel, shape, extinction, g):
    """Nothing is lost in a medium without absorption under radiance 1 from all around: each path returns exactly 1."""
    scene = lit(shape=shape, haze=medium(extinction, 1.0, phase=Phase(g)), environment=(1.0, 1.0, 1.0), orders=4000)
    result = path_tracing.render(replace(scene, lights=()), 4, 4, repeats=2, strata=0, samples=8, kernel=kernel)
    # Paths end after 4000 events or never; in a box of optical radius 4 none reaches them. Measured: 0.
    assert_same("path_tracing", result.image, 1.0, rtol=1e-12)


@pytest.mark.parametrize("mu0, mu, turn", [(0.9, 0.4, 0.0), (0.8, 0.5, 2.5)])
def test_path_tracing_is_reciprocal(mu0, mu, turn):
    """The slab seen along mu under a sun at mu0, and the other way round: L / mu of the sun is the same."""

    def seen(sun, eye):
        base = slab_scene(1.0, 0.9)
        light = Sun((math.sqrt(1 - sun * sun), 0.0, -sun), (1.0, 1.0, 1.0))
        side = math.sqrt(1 - eye * eye)
        gaze = (-side * math.cos(turn), -side * math.sin(turn), -eye)
        camera = replace(base.camera, position=tuple(-3.0 * x for x in gaze), direction=gaze, field_of_view=1e-6)
        scene = replace(base, camera=camera, lights=(light,), orders=64)
        result = path_tracing.render(scene, 1, 1, repeats=64, strata=0, samples=128)
        return result.image[0, 0] / sun, result.error_estimate[0, 0] / sun

    (there, error), (back, other) = seen(mu0, mu), seen(mu, mu0)
    # Gray: three equal channels, one comparison. 4 standard errors with a fixed seed.
    assert_ordered("path_tracing", np.abs(there - back), 4 * np.hypot(error, other))
    assert np.all(np.hypot(error, other) < 0.04 * there)  # the comparison is that sharp


@pytest.mark.parametrize("k", [1e-6, 1e-2, 1e6])
@pytest.mark.parametrize("compiled", [True, False])
def test_single_scattering_knows_no_unit_of_length(k, compiled, monkeypatch):
    if not compiled:
        monkeypatch.setattr(single_scattering, "kernel_of", lambda scene: None)
    here, there = (single_scattering.render(scaled_world(x), 5, 5, strata=0).image for x in (1.0, k))
    # The light stands outside the medium, far from every ray: rounding only.
    assert_same("single_scattering", there, here, rtol=1e-10)


def test_single_scattering_adds_lights_and_volumes():
    """Two media side by side, and two lights, are as bright as one after the other where they do not dim each other."""
    thin = medium(1e-9)
    scene = lit(haze=thin)
    double = Scene(EYE, (*scene.lights, *scene.lights), volumes=(Volume(ROOM, thin),) * 2)
    one, four = (single_scattering.render(s, 5, 5, strata=0).image for s in (scene, double))
    assert_same("single_scattering", four, 4 * one, rtol=1e-7, atol=1e-300)
