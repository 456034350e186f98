# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled path tracer against its NumPy twin, against conservation laws and against closed forms."""

import math

import numpy as np
import pytest
from scipy import integrate

from volumetrics_addon.physics import airlight, phase
from volumetrics_addon.reference import optics, path_scene, path_tracing
from volumetrics_addon.scene import geometry, noise
from volumetrics_addon.scene.model import (
    Box, Camera, Cone, Dust, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Homogeneous, Medium, MiePhase, NoiseShape,
    Phase, Point, Projector, RayleighPhase, Scene, Spot, Sun, Surface, Volume, normalized, turned,
)

numba = pytest.importorskip("numba", reason="the compiled path tracer needs numba")

from volumetrics_addon.reference import path_kernel  # noqa: E402

CAMERA = Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), math.radians(40.0))
BALL = Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
CUBE = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
TILTED = Box((0.1, 0.0, 0.0), (1.0, 0.7, 0.9), turned(0.4))
EGG = Ellipsoid((0.0, 0.1, -0.1), (1.2, 0.6, 0.8), turned(-0.7))
CONE = Cone((0.0, 0.0, 1.2), normalized((0.2, 0.1, -1.0)), 0.5, 2.2)
NOISE = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.4, 2.0, 0.5, 1.0, 0.8, 0.3, 5)
DUST = Dust(1.6, 0.5, 3, (0.1, 0.2, 0.3))
VOXELS = Grid(np.random.default_rng(2).random((5, 4, 6)) ** 2, (-0.8, -0.7, -0.9), (0.9, 0.8, 0.7))
AIR = ExponentialAltitude((0.0, 0.0, -10.0), 9.0, 0.4)
SUN = Sun(normalized((1.0, 1.0, -1.0)), (3.0, 2.0, 1.0))
POINT = Point((0.2, -0.1, 0.3), (9.0, 12.0, 15.0))
SPOT = Spot((0.3, -0.2, 1.3), normalized((-0.2, 0.1, -1.0)), (40.0, 30.0, 20.0), 1.0, 0.4)
FLOOR = Surface(Box((0.0, 0.0, -1.2), (2.0, 2.0, 0.1)), (0.8, 0.6, 0.4))
LAMP = Surface(Ellipsoid((0.5, 0.2, 0.4), (0.2, 0.1, 0.15), turned(0.3)), (0.1, 0.2, 0.3), (2.0, 1.0, 3.0))


def medium(sigma_t, albedo, phase, density=Homogeneous()):
    sigma_t = np.broadcast_to(sigma_t, 3) * 1.0
    return Medium(tuple(albedo * sigma_t), tuple((1.0 - albedo) * sigma_t), phase, density)


SCENES = {
    "coloured cube, point light, floor": Scene(
        CAMERA, (POINT,), (0.1, 0.2, 0.3),
        (Volume(CUBE, medium((3.0, 2.0, 1.0), 0.9, Phase(0.7, -0.3, 0.3))),), (FLOOR,), 8),
    "thinning with height, spot light": Scene(
        CAMERA, (SPOT,), (0.0, 0.0, 0.0), (Volume(TILTED, medium(1.0, 0.8, RayleighPhase(), ExponentialHeight(0.5, -0.4))),),
        (FLOOR,), 6),
    "planet, sun": Scene(
        CAMERA, (SUN,), (0.0, 0.0, 0.0), (Volume(Ellipsoid(AIR.center, (12.0,) * 3),
                                                 medium((0.3, 0.5, 0.8), 1.0, RayleighPhase(), AIR)),),
        (Surface(Ellipsoid(AIR.center, (AIR.radius,) * 3), (0.3, 0.4, 0.5)),), 6),
    "noise of droplets, sun and sky": Scene(
        CAMERA, (SUN,), (0.3, 0.4, 0.5), (Volume(BALL, medium(5.0, 0.99, MiePhase(12.0), NOISE)),), (), 12),
    "dusty cone, spot light": Scene(
        CAMERA, (SPOT,), (0.0, 0.0, 0.0), (Volume(CONE, medium((1.0, 2.0, 1.5), 0.9, Phase(0.5), DUST)),), (), 3),
    "voxels, sun": Scene(
        CAMERA, (SUN,), (0.2, 0.2, 0.2), (Volume(EGG, medium((4.0, 5.0, 6.0), 0.9, Phase(0.5), VOXELS)),), (), 8),
    "cone over ball, spot light, lamp": Scene(
        CAMERA, (SPOT, SUN), (0.1, 0.1, 0.1),
        (Volume(CONE, medium((0.5, 1.0, 1.5), 0.7, Phase(0.6))), Volume(BALL, medium((1.0, 0.5, 0.7), 0.9, Phase(-0.4))),
         Volume(CUBE, Medium((0.0, 0.0, 0.0), (0.1, 0.2, 0.0)))), (LAMP, FLOOR), 6),
}


SLOW_SAMPLES = {"noise of droplets, sun and sky": 3, "voxels, sun": 4, "thinning with height, spot light": 60}


def blocks(images):
    """Means over 4 x 4 pixels, one row of numbers per repeat."""
    repeats, height, width, _ = images.shape
    return images.reshape(repeats, height // 4, 4, width // 4, 4, 3).mean(axis=(2, 4)).reshape(repeats, -1)


@pytest.mark.parametrize("name", SCENES)
def test_the_twins_agree(name):
    """On 16 blocks of pixels, in units of their combined standard error, and in the mean of the image."""
    scene = SCENES[name]
    fast = path_tracing.render(scene, 16, 16, repeats=16, strata=0, samples=64, seed=1, kernel="numba")
    few = SLOW_SAMPLES.get(name, 24)
    slow = path_tracing.render(scene, 16, 16, repeats=8, strata=0, samples=few, seed=2, kernel="numpy")
    assert path_tracing.preferred_kernel(scene) == "numba"
    difference, variance = 0.0, 0.0
    for sign, images in ((1.0, blocks(fast.repeats)), (-1.0, blocks(slow.repeats))):
        difference = difference + sign * images.mean(axis=0)
        variance = variance + images.var(axis=0, ddof=1) / len(images)
    lit = variance > (1e-9 * fast.image.max()) ** 2
    assert lit.mean() > 0.4
    z = difference[lit] / np.sqrt(variance[lit])
    # Student's t with about 8 degrees of freedom has variance 4/3; the mean square of 20 or more numbers stays below 2.5.
    assert np.mean(z**2) < 2.5, z
    total = abs(fast.image.mean() - slow.image.mean())
    error = math.hypot(*(r.repeats.mean(axis=(1, 2, 3)).std(ddof=1) / math.sqrt(len(r.repeats)) for r in (fast, slow)))
    assert total < 4.5 * error
    assert error < 0.04 * fast.image.mean()


def test_the_seed_alone_makes_the_image():
    """Whatever the number of threads, and however the work is cut into batches."""
    scene = SCENES["cone over ball, spot light, lamp"]
    images = []
    for threads, size in ((1, 10_000), (numba.config.NUMBA_NUM_THREADS, 10_000), (1, 37)):
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        image, camera = np.zeros((35, 3)), path_kernel.camera_numbers(CAMERA, 7)
        for first in range(0, 35 * 9, size):
            path_kernel.trace_paths(path_scene.flatten(scene), scene.orders, camera, 7, 5, 3, 9, first,
                                    min(first + size, 35 * 9), np.uint64(3), image)
        numba.set_num_threads(before)
        images.append(image)
    assert (images[0] == images[1]).all() and (images[0] == images[2]).all() and images[0].max() > 0.0
    first, again, other = (path_tracing.render(scene, 6, 4, repeats=2, strata=2, seed=seed).image for seed in (5, 5, 6))
    assert (first == again).all() and not (first == other).all()


@pytest.mark.parametrize("density", [Homogeneous(), ExponentialHeight(0.5, -1.0), NOISE, VOXELS],
                         ids=lambda d: type(d).__name__)
def test_white_furnace_of_every_path(density):
    """Nothing is absorbed and light of radiance 1 comes from everywhere: every single path returns exactly 1."""
    white = Surface(Box((0.0, 0.0, -1.5), (3.0, 3.0, 0.1)), (1.0, 1.0, 1.0))
    volume = Volume(BALL, medium(3.0, 1.0, Phase(0.6, -0.3, 0.3), density))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(volume,), surfaces=(white,), orders=100_000)
    result = path_tracing.render(scene, 8, 8, repeats=1, strata=0, samples=1, kernel="numba")
    # Noise may exceed its probed majorant by a little, and its paths then differ from 1 by as much.
    np.testing.assert_allclose(result.image, 1.0, atol=1e-9 if density is not NOISE else 0.1)
    mean = path_tracing.render(scene, 8, 8, repeats=8, strata=0, samples=100, kernel="numba")
    error = mean.repeats.mean(axis=(1, 2, 3)).std(ddof=1) / math.sqrt(8)
    assert abs(mean.image.mean() - 1.0) <= 4.5 * error + 1e-12 and error < 1e-4


def test_coloured_white_furnace():
    volume = Volume(BALL, medium((2.0, 1.0, 0.5), 1.0, Phase(0.4), NOISE))
    scene = Scene(CAMERA, environment=(1.0, 1.0, 1.0), volumes=(volume,), orders=100_000)
    result = path_tracing.render(scene, 16, 16, repeats=16, strata=0, samples=64, kernel="numba")
    error = result.repeats.mean(axis=(1, 2)).std(axis=0, ddof=1) / math.sqrt(16)
    assert (np.abs(result.image.mean(axis=(0, 1)) - 1.0) < 4.5 * error).all() and (error < 2e-3).all()


@pytest.mark.parametrize("light", [Point((0.3, 2.0, -0.2), (50.0,) * 3),
                                   Spot((0.3, 2.0, -0.2), normalized((-0.5, -1.0, 0.3)), (50.0,) * 3, 1.2, 0.5)],
                         ids=lambda light: type(light).__name__)
def test_single_scattering_of_a_local_light(light):
    """In a medium as good as infinite, against the closed integral of the airlight, pixel by pixel."""
    sigma_t, albedo, g = 0.3, 0.8, 0.4
    volume = Volume(Box((0.0, 0.0, 0.0), (500.0,) * 3), medium(sigma_t, albedo, Phase(g)))
    scene = Scene(Camera((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), math.radians(90.0)), (light,), volumes=(volume,), orders=1)
    result = path_tracing.render(scene, 7, 7, repeats=16, strata=0, samples=1000, kernel="numba")
    x, y = (index.ravel() + 0.5 for index in np.meshgrid(np.arange(7), np.arange(7)))
    origin, direction = geometry.camera_rays(scene.camera, 7, 7, x, y)
    arguments = (origin, direction, np.inf, light.position)
    intensity = light.power[0] / (4.0 * math.pi)

    def lobe(cos_theta):
        return phase.henyey_greenstein(cos_theta, g)

    if isinstance(light, Point):
        expected = airlight.point_light(*arguments, intensity, sigma_t * albedo, sigma_t, phase=lobe).value
    else:
        expected = airlight.spot_light(*arguments, intensity, sigma_t * albedo, sigma_t, lobe, light.direction,
                                       light.cone_angle, light.blend).value
    measured, error = result.image[..., 0].ravel(), result.error_estimate[..., 0].ravel()
    z = (measured - expected)[error > 0.0] / error[error > 0.0]
    assert len(z) > 30 and np.abs(z).max() < 5.5 and np.mean(z**2) < 2.0
    assert (measured == expected)[error == 0.0].all()
    assert result.image.mean() == pytest.approx(expected.mean(), rel=0.003)


@pytest.mark.parametrize("kernel", path_tracing.KERNELS)
def test_point_light_in_a_dense_medium_has_no_outliers(kernel):
    """Rays that pass a light at a fiftieth of the free path: no path owns the sum, as one does by distance alone."""
    sigma, n = 4.0, 200 * 200
    point = Point((0.005, 0.0, 0.0), (4.0 * math.pi,) * 3)
    volume = Volume(CUBE, medium(sigma, 1.0, Phase(0.0)))
    scene = Scene(Camera((0.0, -0.9, 0.0), (0.0, 1.0, 0.0), 1e-9), (point,), volumes=(volume,))
    paths = path_tracing.render(scene, 200, 200, repeats=1, strata=0, samples=1, kernel=kernel).image[..., 0]
    exact = float(airlight.point_light(scene.camera.position, scene.camera.direction, 1.9, point.position, 1.0, sigma, sigma,
                                       phase=phase.isotropic).value)
    assert paths.mean() == pytest.approx(exact, abs=4.5 * paths.std() / math.sqrt(n))
    # By distance alone: free flight, then the light at the collision.
    t = np.random.default_rng(2).exponential(1.0 / sigma, n)
    distance = np.hypot(t - 0.9, 0.005)
    alone = np.where(t < 1.9, np.exp(-sigma * distance) / (4.0 * math.pi * distance**2), 0.0)
    assert paths.std() < 1.5 * exact and alone.std() > 5.0 * paths.std()
    assert paths.max() / paths.sum() < 3e-4 < alone.max() / alone.sum() / 3.0


def test_orders_partition_the_light():
    """Each order adds what the one before sends on: up to order n the image grows to the converged one, and never falls."""
    volume = Volume(BALL, medium(2.0, 0.9, Phase(0.3)))
    means = []
    for orders in (0, 1, 2, 4, 8, 64):
        scene = Scene(CAMERA, (POINT, SUN), (0.0, 0.0, 0.0), (volume,), (), orders)
        means.append(path_tracing.render(scene, 12, 12, repeats=4, strata=0, samples=200, kernel="numba").image.mean())
    assert means[0] == 0.0
    assert all(a < b for a, b in zip(means[:-1], means[1:-1])) and means[-1] == pytest.approx(means[-2], rel=0.1)


@pytest.mark.parametrize("volume", [Volume(BALL, medium(2.0, 0.5, Phase(0.0), density)) for density in (
    ExponentialHeight(0.5, -0.4), NOISE, VOXELS, Homogeneous())] + [
        Volume(Ellipsoid(AIR.center, (12.0,) * 3), medium(0.5, 1.0, RayleighPhase(), AIR))],
    ids=lambda volume: type(volume.medium.density).__name__)
def test_density_and_majorant_along_rays(volume):
    """The kernel's density is the Scene's; its cells cover the ray without a gap and bound the density."""
    numbers = path_scene.flatten(Scene(CAMERA, volumes=(volume,)))
    at = int(numbers[path_scene.VOLUMES + 1])
    rng = np.random.default_rng(4)
    exceeded, checked = 0, 0
    for _ in range(6):
        direction = np.array(normalized(tuple(rng.normal(size=3))))
        origin = rng.uniform(-0.3, 0.3, 3) - 3.0 * direction
        near, far = (float(t[0]) for t in geometry.interval(volume.domain, origin[None], direction[None]))
        t = near
        while t < far:
            bound, leave = path_kernel.majorant(numbers, at, tuple(origin), tuple(direction), t)
            leave = min(leave, far)
            assert leave > t
            inside = t + (leave - t) * rng.random(8)
            position = origin + inside[:, None] * direction
            expected = optics.density_at(volume, position)
            found = [path_kernel.density(numbers, at, tuple(p)) for p in position]
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
            above = isinstance(volume.medium.density, ExponentialAltitude) and 0.0 > np.linalg.norm(position, axis=1).min()
            exceeded += 0 if above else int((expected > bound * (1.0 + 1e-5)).sum())
            checked += len(inside)
            t = leave
    assert checked > 40 and exceeded == 0


@pytest.mark.parametrize("volume_phase", [Phase(0.7, -0.3, 0.3), RayleighPhase(), MiePhase(12.0)],
                         ids=lambda p: type(p).__name__)
def test_phase_functions(volume_phase):
    """Values are the Scene's, and samples follow them: chi-square over 40 bins of the cosine."""
    numbers = path_scene.flatten(Scene(CAMERA, volumes=(Volume(BALL, medium(1.0, 1.0, volume_phase)),)))
    at = int(numbers[path_scene.VOLUMES + 1])
    cosine = np.linspace(-1.0, 1.0, 101)
    np.testing.assert_allclose([path_kernel.phase_value(numbers, at, c) for c in cosine],
                               optics.phase_value(volume_phase, cosine), rtol=1e-9)
    state, n = np.array([7], np.uint64), 40_000
    samples = np.array([path_kernel.sample_phase(numbers, at, state) for _ in range(n)])
    edges = np.linspace(-1.0, 1.0, 41)
    shares = [integrate.quad(lambda c: optics.phase_value(volume_phase, c), *ends, limit=200)[0]
              for ends in zip(edges, edges[1:])]
    expected = 2.0 * math.pi * n * np.array(shares)
    assert expected.sum() == pytest.approx(n, rel=1e-6)
    observed = np.histogram(samples, edges)[0]
    assert ((observed - expected) ** 2 / expected).sum() < 39 + 4.5 * math.sqrt(2 * 39)


def test_a_projector_is_left_to_numpy():
    projector = Projector((0.0, -2.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (20.0,) * 3, 0.4, 0.3)
    scene = Scene(CAMERA, (projector,), volumes=(Volume(BALL, medium(1.0, 0.9, Phase(0.2))),), orders=2)
    assert path_tracing.preferred_kernel(scene) == "numpy"
    with pytest.raises(ValueError, match="projector.*numpy"):
        path_tracing.render(scene, 4, 4, repeats=1, kernel="numba")
    assert path_tracing.render(scene, 8, 8, repeats=1, strata=2).image.max() > 0.0


def test_noise_of_the_kernel_is_noise():
    x, y, z = np.random.default_rng(0).uniform(-50.0, 50.0, (3, 200))
    expected = noise.numpy_evaluator()[0](x, y, z, 2.5, 0.6)
    np.testing.assert_allclose([path_kernel._noise(*p, 2.5, 0.6) for p in zip(x, y, z)], expected, rtol=1e-9)
