# SPDX-License-Identifier: GPL-3.0-or-later
"""What the marching techniques share, against closed forms and literal sums, and the contract that all of them keep."""

import inspect
import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.reference import (
    froxels, half_angle_slices, light_slices, marching, octaves, optics, quarter_resolution, ray_marching, single_scattering,
)
from volumetrics_addon.scene import geometry
from volumetrics_addon.scene.model import (
    Box, Camera, Cone, Dielectric, Ellipsoid, Medium, MiePhase, NoiseShape, Phase, RayleighPhase, Scene, Spot,
    Surface, Volume, normalized, turned,
)

TECHNIQUES = (ray_marching, quarter_resolution, light_slices, half_angle_slices, froxels, octaves)
NAMES = [module.__name__.rsplit(".", 1)[-1] for module in TECHNIQUES]
CHEAP = {"ray_marching": {"steps": 6}, "quarter_resolution": {"steps": 6}, "light_slices": {"slices": 6},
         "half_angle_slices": {"slices": 6, "resolution": 4}, "froxels": {"tile": 2, "slices": 6},
         "octaves": {"octaves": 2, "steps": 6}}

CAMERA = Camera((0.0, -6.0, 0.0), (0.0, 1.0, 0.0), math.radians(50.0))
HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
BOX = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
# Every technique takes this light: it stands outside the box and its cone is narrow.
SPOT = Spot((0.3, 0.2, 3.0), normalized((-0.1, 0.0, -1.0)), (90.0, 60.0, 30.0), math.radians(50.0), 0.4)
FLOOR = Surface(Box((0.0, 0.0, -1.5), (3.0, 3.0, 0.1)), (0.5, 0.4, 0.3))
SCENE = Scene(CAMERA, (SPOT,), volumes=(Volume(BOX, HAZE),), surfaces=(FLOOR,))
NOISE = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.4, 2.0, 0.5, 1.0, 0.8, 0.3, 5)
CLOUD = Volume(Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Medium((3.0, 2.0, 1.0), (0.0, 0.5, 1.0), Phase(0.6), NOISE))


# --- the sum along the ray ----------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.0, 1e-30, 1e-9, 0.3, 40.0, 1e30])
def test_constant_medium_is_exact_for_any_steps(sigma):
    """S (1 - exp(-sigma L)) / sigma, which the step sums reach with one step as with seven of unequal length."""
    expected = 2.0 * (3.0 if sigma == 0.0 else -math.expm1(-sigma * 3.0) / sigma)
    for lengths in ([3.0], [0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 1.5]):
        length = np.array([lengths])
        full = np.ones((1, len(lengths), 3))
        contribution, depth = marching.integrate(2.0 * full, sigma * full, length)
        np.testing.assert_allclose(contribution.sum(axis=1), expected, rtol=1e-14)
        np.testing.assert_allclose(depth.sum(axis=1), 3.0 * sigma, rtol=1e-14)


def test_no_step_scatters_more_than_it_takes():
    """Source albedo x extinction under light 1: the ray never gains more than the albedo, however coarse the steps."""
    rng = np.random.default_rng(1)
    sigma = 10.0 ** rng.uniform(-6, 6, (200, 8, 3))
    contribution, _ = marching.integrate(0.9 * sigma, sigma, 10.0 ** rng.uniform(-3, 3, (200, 8)))
    assert (contribution >= 0.0).all() and (contribution.sum(axis=1) <= 0.9 * (1 + 1e-12)).all()


def test_doubt_of_midpoint_sums():
    """Smooth: four times the error (half of nine less one). Jump: as large as the error in the mean of its square."""
    def sums(f, ends, k):
        length = np.broadcast_to((ends / k)[:, None], (len(ends), k))
        t = (np.arange(k) + 0.5) * length
        contribution = np.repeat((f(t) * length)[..., None], 3, axis=2)
        return contribution.sum(axis=1)[:, 0], marching.nested_doubt(contribution, length)[:, 0]

    ends = np.linspace(1.0, 2.0, 50)
    value, doubt = sums(np.exp, ends, 48)
    np.testing.assert_allclose(doubt / np.abs(value - np.expm1(ends)), 4.0, rtol=0.01)
    ends = np.linspace(2.0, 3.0, 2001)
    value, doubt = sums(lambda t: (t < math.sqrt(2.0)).astype(float), ends, 48)
    error = value - math.sqrt(2.0)
    assert 1.0 < math.sqrt((doubt**2).mean() / (error**2).mean()) < 2.0  # 1.6: half of sqrt(1 + 9)
    assert (np.abs(error) <= 2.0 * doubt + 1e-12).mean() > 0.6


def test_doubt_of_slabs_cut_at_their_ends_and_of_few_samples():
    length = np.array([[0.0, 0.3, 1.0, 1.0, 1.0, 1.0, 0.2, 0.0], [0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0], [0.0] * 8])
    ends = np.cumsum(length, axis=1)
    middle = ends - length / 2.0
    contribution = np.repeat((length * (1.0 + 2.0 * middle))[..., None], 3, axis=2)
    doubt = marching.nested_doubt(contribution, length)
    # The trios (0.3, 1, 1) and (1, 1, 0.2): 2.3 f(0.8) and 2.2 f(3.8) for the integral of 1 + 2 t over [0, 4.5].
    expected = abs(2.3 * 2.6 + 2.2 * 8.6 - (4.5 + 4.5**2)) / 2.0
    np.testing.assert_allclose(doubt[0], expected, rtol=1e-12)
    np.testing.assert_allclose(doubt[1], contribution[1].sum(axis=0) / 4.0, rtol=1e-12)
    assert (doubt[2] == 0.0).all()


# --- geometry -----------------------------------------------------------------------------------------------


SHAPES = [Box((0.3, -0.2, 0.1), (1.0, 0.5, 0.8), turned(0.7)), Ellipsoid((0.1, 0.2, -0.3), (0.9, 0.4, 1.2), turned(-0.4)),
          Cone((0.0, 0.1, 1.0), normalized((0.2, 0.1, -1.0)), 0.5, 2.0)]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_inside_agrees_with_the_interval(shape):
    rng = np.random.default_rng(2)
    position = rng.uniform(-2, 2, (4000, 3))
    direction = rng.normal(size=position.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    near, far = geometry.interval(shape, position, direction)
    expected = (near <= 0.0) & (far >= 0.0)
    assert 50 < expected.sum() < 3900
    assert (geometry.contains(shape, position) == expected).all()


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_corners_enclose_the_shape(shape):
    position = np.random.default_rng(3).uniform(-3, 3, (20000, 3))
    position = position[geometry.contains(shape, position)]
    corners = marching.corners(shape)
    assert len(position) > 100
    for axis in np.random.default_rng(4).normal(size=(50, 3)):
        assert (position @ axis).max() <= (corners @ axis).max() + 1e-9


def test_media_interval_spans_all_media_and_ends_at_the_surface():
    volumes = (Volume(BOX, HAZE), Volume(Ellipsoid((0.0, 4.0, 0.0), (1.0, 1.0, 1.0)), HAZE))
    scene = Scene(CAMERA, volumes=volumes)
    origin, direction = np.tile((0.0, -6.0, 0.0), (4, 1)), np.array([(0.0, 1.0, 0.0)] * 3 + [(0.0, -1.0, 0.0)])
    near, far = marching.media_interval(scene, origin, direction, np.array([np.inf, 5.0, 3.0, np.inf]))
    np.testing.assert_allclose(near, [4.0, 4.0, 0.0, 0.0])
    np.testing.assert_allclose(far, [11.0, 5.0, 0.0, 0.0])


def test_raster_is_the_inverse_of_the_camera():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 20, 100), rng.uniform(0, 10, 100)
    camera = Camera((1.0, 2.0, 3.0), normalized((0.3, -0.8, 0.2)), 1.9)
    _, direction = geometry.camera_rays(camera, 20, 10, x, y)
    found = geometry.raster(camera, 20, 10, direction)
    np.testing.assert_allclose(found, (x, y), atol=1e-11)


def test_slabs_fill_the_ray():
    origin = np.array([(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.35, 0.0, 0.0)])
    direction = np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), normalized((1.0, 1.0, 0.0)), (0.0, 1.0, 0.0)])
    entry, leave = np.array([0.25, 4.0, np.inf, 1.0]), np.array([0.85, 4.9, -np.inf, 3.0])
    cut = marching.slabs(origin, direction, entry, leave, np.array((1.0, 0.0, 0.0)), np.linspace(0.0, 1.0, 11))
    total = np.bincount(cut.ray, cut.length, 4)
    np.testing.assert_allclose(total, [0.6, 0.9, 0.0, 2.0], atol=1e-12)
    assert cut.slab[cut.ray == 3].tolist() == [3]  # along the planes
    reached = (origin[cut.ray] + cut.middle[:, None] * direction[cut.ray])[:, 0]
    assert (np.abs(reached - (cut.slab + 0.5) / 10.0) <= 0.05 + 1e-9).all()


def test_linear_weights_reproduce_lines_and_clamp():
    x = np.array([-1.0, 0.2, 0.5, 1.75, 3.5, 9.0])
    low, high, weight = marching.linear_weights(x, 4)
    centre = np.arange(4) + 0.5
    np.testing.assert_allclose((1 - weight) * centre[low] + weight * centre[high], np.clip(x, 0.5, 3.5))
    assert all((values == 0).all() for values in marching.linear_weights(x, 1))


# --- light --------------------------------------------------------------------------------------------------


def test_depth_of_noise_against_many_steps():
    """64 midpoints of a fractal field against 40000."""
    origin, direction = np.array([[-2.0, 0.1, 0.2]]), np.array([[1.0, 0.0, 0.0]])

    t = 2.0 + math.sqrt(0.95) * ((np.arange(40000) + 0.5) / 20000 - 1.0)
    expected = optics.density_at(CLOUD, origin + t[:, None] * direction).mean() * 2.0 * math.sqrt(0.95)
    depth = marching.optical_depth(Scene(CAMERA, volumes=(CLOUD,)), origin, direction, np.inf, 64)
    np.testing.assert_allclose(depth[0], expected * np.array(CLOUD.medium.sigma_t), rtol=5e-3)


@pytest.mark.parametrize("phase", [Phase(0.8), Phase(0.9, -0.3, 0.2), RayleighPhase(), MiePhase(10.0)], ids=repr)
def test_octave_of_a_phase_function_is_normalised_with_its_mean_cosine_scaled(phase):
    nodes, weights = np.polynomial.legendre.leggauss(600)
    whole, mean = ((weights * optics.phase_value(phase, nodes) * f).sum() * 2 * math.pi for f in (1.0, nodes))
    for factor in (1.0, 0.5, 0.0):
        value = marching.phase_of_octave(phase, nodes, factor)
        assert (weights * value).sum() * 2 * math.pi == pytest.approx(1.0 if factor < 1.0 else whole, abs=1e-5)
        assert (weights * value * nodes).sum() * 2 * math.pi == pytest.approx(factor * mean, abs=1e-5)


def test_ambient_light_fills_the_medium():
    """sigma_s A (1 - exp(-sigma_t d)) / sigma_t through a slab."""
    ambient = (0.3, 0.2, 0.1)
    scene = Scene(CAMERA, (), volumes=(Volume(BOX, replace(HAZE, ambient=ambient)),))
    column = marching.march(scene, np.array([CAMERA.position]), np.array([(0.0, 1.0, 0.0)]), np.array([np.inf]), 3, 1)
    sigma_t = np.array(HAZE.sigma_t)
    expected = np.array(HAZE.sigma_s) * ambient * -np.expm1(-4.0 * sigma_t) / sigma_t
    np.testing.assert_allclose(column.scattered[0], expected, rtol=1e-12)


def exact(scene, size):
    """32 nodes on every lit interval, through the centres of the pixels, without the compilation of larger images."""
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = geometry.camera_rays(scene.camera, size, size, column.ravel(), row.ravel())
    return single_scattering.radiance(scene, *rays, np.random.default_rng(0), 32)[0].reshape(size, size, 3)


# --- the contract of every technique ------------------------------------------------------------------------


def test_there_are_six():
    assert len(TECHNIQUES) == 6 and set(CHEAP) == set(NAMES)


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_describes_itself(module):
    summary = module.__doc__.splitlines()[0]
    assert summary.endswith(".") and len(summary) < 125
    assert module.BIAS[0].isupper() and module.BIAS.endswith(".")
    keywords = inspect.signature(module.render).parameters
    assert len(module.SETTINGS) >= 5
    for setting in module.SETTINGS:
        assert set(setting) <= set(keywords)


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_settings_run_from_quick_to_accurate(module):
    scene = replace(SCENE, surfaces=())
    truth = exact(scene, 16)
    errors, spent = [], []
    for setting in (module.SETTINGS[0], module.SETTINGS[-1]):
        # Octaves beyond the first are another quantity.
        result = module.render(scene, 16, 16, strata=0, **{**setting, **({"octaves": 1} if module is octaves else {})})
        errors.append(np.sqrt(((result.image - truth) ** 2).mean()) / truth.mean())
        spent.append(result.evaluations)
    assert errors[1] < errors[0] / 2.0 and spent[1] > spent[0] > 0


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_surfaces_without_media_are_exact(module):
    scene = Scene(CAMERA, (SPOT,), surfaces=(FLOOR, Surface(Ellipsoid((0.0, 0.0, 0.3), (0.6, 0.6, 0.6)), (0.3, 0.6, 0.9))))
    assert module.applies(scene) == ""
    result = module.render(scene, 16, 16, strata=0, **CHEAP[module.__name__.rsplit(".", 1)[-1]])
    expected = exact(scene, 16)
    assert expected.max() > 0.0
    np.testing.assert_array_equal(result.image, expected)
    assert (result.error_estimate == 0.0).all()


def _variants():
    clear = replace(HAZE, sigma_s=(0.0, 0.0, 0.0), sigma_a=(0.0, 0.0, 0.0))
    yield "no lights", replace(SCENE, lights=())
    yield "no extinction", replace(SCENE, volumes=(Volume(BOX, clear),))
    yield "no albedo", replace(SCENE, volumes=(Volume(BOX, replace(HAZE, sigma_s=(0.0, 0.0, 0.0))),))


@pytest.mark.parametrize("scene", [s for _, s in _variants()], ids=[name for name, _ in _variants()])
@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_media_that_do_not_scatter(module, scene):
    """Homogeneous absorbers leave nothing to approximate but the resolution of the froxels and of the quarter image."""
    result = module.render(scene, 16, 16, strata=0, **CHEAP[module.__name__.rsplit(".", 1)[-1]])
    expected = exact(scene, 16)
    if module in (froxels, quarter_resolution):
        # Measured worst pixel: 2.4 % of the brightest one, at the edges of the floor.
        assert np.abs(result.image - expected).max() <= 0.05 * expected.max()
    else:
        np.testing.assert_allclose(result.image, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_hard_places_stay_finite(module):
    """The light on the axis of the view, the camera inside the medium, both dense and thin: no warning, nothing negative."""
    cheap = CHEAP[module.__name__.rsplit(".", 1)[-1]]
    inside = Camera((0.3, -0.7, 0.2), normalized((-0.3, 0.7, -0.2)), math.radians(80.0))
    ahead = Spot((0.0, 0.5, 0.0), (0.0, 1.0, 0.0), (10.0, 10.0, 10.0), math.radians(40.0), 0.0)
    for camera in (CAMERA, inside):
        for medium in (HAZE, Medium((1e8, 1e-30, 5.0), (0.0, 1e30, 0.0), Phase(-0.9))):
            scene = Scene(camera, (ahead,), volumes=(Volume(BOX, medium),))
            result = module.render(scene, 15, 15, strata=0, **cheap)
            assert np.isfinite(result.image).all() and (result.image >= 0.0).all()
            assert np.isfinite(result.error_estimate).all() and (result.error_estimate >= 0.0).all()


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_environment_is_scattered_once(module):
    """Ambient light has one estimator in all: means within four of the joint standard errors of single_scattering."""
    scene = replace(SCENE, environment=(0.5, 0.6, 0.7), lights=())
    result = module.render(scene, 12, 12, repeats=8, strata=2, **CHEAP[module.__name__.rsplit(".", 1)[-1]])
    known = single_scattering.render(scene, 12, 12, repeats=8, strata=2, seed=1)
    spread = math.sqrt(sum(r.repeats.mean(axis=(1, 2, 3)).var(ddof=1) / 8 for r in (result, known)))
    doubt = result.systematic
    assert abs(result.image.mean() - known.image.mean()) < 4.5 * spread + doubt
    assert spread < 0.02 * known.image.mean() and doubt < 0.2 * known.image.mean()


@pytest.mark.parametrize("module", [m for m in TECHNIQUES if m is not octaves], ids=[n for n in NAMES if n != "octaves"])
def test_more_orders_are_rendered_as_one_and_said_so(module):
    cheap = CHEAP[module.__name__.rsplit(".", 1)[-1]]
    many = replace(SCENE, orders=8)
    assert module.applies(many) == "" and "single scattering" in module.BIAS.lower()
    images = [module.render(scene, 8, 8, strata=0, **cheap).image for scene in (SCENE, many)]
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_refuses_what_it_cannot_render(module):
    emitter = Surface(Ellipsoid((0.0, 0.0, 0.0), (0.5, 0.5, 0.5)), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    cases = {"refracts": replace(SCENE, volumes=(Volume(BOX, HAZE, Dielectric(1.5)),)),
             "lights a scattering medium": replace(SCENE, surfaces=(emitter,)),
             "lights another surface": replace(SCENE, volumes=(), surfaces=(emitter, FLOOR))}
    for reason, scene in cases.items():
        with pytest.raises(ValueError, match=reason):
            module.render(scene, 4, 4)


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_refuses_settings_out_of_range(module):
    counts = [name for name in CHEAP[module.__name__.rsplit(".", 1)[-1]]] + ["light_steps"]
    for name in counts:
        for bad in (0, -3, 2.5, True):
            with pytest.raises(ValueError, match=rf"{name} must be a whole number >= \d, got {bad}"):
                module.render(SCENE, 4, 4, **{name: bad})


@pytest.mark.parametrize("module", TECHNIQUES, ids=NAMES)
def test_an_image_at_pixel_centres_is_the_same_every_time(module):
    cheap = CHEAP[module.__name__.rsplit(".", 1)[-1]]
    progress = []
    first = module.render(SCENE, 8, 8, strata=0, seed=1, progress=progress.append, **cheap)
    second = module.render(SCENE, 8, 8, strata=0, seed=2, **cheap)
    np.testing.assert_array_equal(first.image, second.image)
    assert progress[-1] == 1.0 and np.isfinite(first.error_estimate).all()
    assert first.integrator == module.__name__.rsplit(".", 1)[-1]
