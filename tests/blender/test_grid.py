# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays as native volumes: every voxel where it belongs, in both engines."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import build, compat, grid, render  # noqa: E402
from volumetrics_addon.cli.doctor import checks  # noqa: E402
from volumetrics_addon.compare.statistics import Estimate, compare  # noqa: E402
from volumetrics_addon.physics.grid import grid_transmittance  # noqa: E402
from volumetrics_addon.scene import geometry  # noqa: E402
from volumetrics_addon.scene.describe import describe_scene  # noqa: E402
from volumetrics_addon.scene.model import Box, Camera, Ellipsoid, Grid, Medium, Phase, Scene, Sun, Volume  # noqa: E402

HAS_EEVEE = all(check.ok for check in checks() if check.name == "EEVEE")
CENTRES = {"cycles.pixel_filter_type": "GAUSSIAN", "cycles.filter_width": 0.01, "render.filter_size": 0.0}
CELL = 0.4
# Blender 4.5 always marches, and through voxels exactly; Blender 5 is unbiased where it is told not to march.
UNBIASED = {"cycles.volume_biased": False} if compat.current().volume_biased else {}


def grid_of(values, center=(5.0, -2.0, 1.0)):
    half = CELL * np.array(values.shape) / 2
    return Grid(values, tuple(np.array(center) - half), tuple(np.array(center) + half))


def box_of(density):
    low, high = np.array(density.low), np.array(density.high)
    return Box(tuple((low + high) / 2), tuple((high - low) / 2))


def ring(values):
    """The values with their outermost layer set to 0."""
    result = np.zeros_like(values)
    result[1:-1, 1:-1, 1:-1] = values[1:-1, 1:-1, 1:-1]
    return result


RANDOM = np.random.default_rng(0).random((7, 6, 5))
OPEN = RANDOM + 0.3  # not 0 at the faces
DIRECTIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, -1.0), "slanted": (0.48, 0.6, -0.64)}


def absorbing(values, direction, domain=None):
    """Voxels before a white sky, seen from so far that the rays are as good as parallel."""
    density = grid_of(values)
    position = np.array(domain.center if domain else box_of(density).center) - 30.0 * np.array(direction)
    camera = Camera(tuple(position), direction, 2.0 * math.atan(1.7 / 30.0))
    medium = Medium((0.0, 0.0, 0.0), (1.5, 1.5, 1.5), Phase(0.0), density)
    return Scene(camera, environment=(1.0, 1.0, 1.0), volumes=(Volume(domain or box_of(density), medium),))


def exact(scene, size):
    """Transmittance through the pixels' centres, by the exact integral of trilinear voxels within the domain."""
    row, column = np.divmod(np.arange(size * size), size)
    origin, direction = geometry.camera_rays(scene.camera, size, size, column + 0.5, row + 0.5)
    volume, = scene.volumes
    near, far = geometry.interval(volume.domain, origin, direction)
    length = np.maximum(far - near, 0.0)
    start = origin + np.where(length > 0.0, near, 0.0)[:, None] * direction
    density = volume.medium.density
    return grid_transmittance(density.values, density.low, density.high, start, direction, length,
                              volume.medium.sigma_t[0]).reshape(size, size)


def rendered(scene, engine, size, samples, **settings):
    shot = render.render_scene(scene, describe_scene(scene), "voxels", engine, size, size, samples,
                               settings={**CENTRES, **settings})
    return shot.images[0].mean(axis=-1)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_transmittance_is_that_of_trilinear_voxels(direction):
    """Measured: mean within 1e-5 in 4.5 and 4e-4 in 5.2; half a voxel of shift would be a difference of 0.15 per pixel."""
    scene = absorbing(ring(RANDOM), DIRECTIONS[direction])
    image, truth = rendered(scene, "cycles", 32, 256, **UNBIASED), exact(scene, 32)
    assert truth.std() > 0.1  # there is something to see
    assert abs(image.mean() / truth.mean() - 1.0) < 1e-3
    assert np.sqrt(np.mean((image - truth) ** 2)) < 0.02


@pytest.mark.parametrize("direction", ["y", "slanted"])
@pytest.mark.parametrize("shape", ["box", "ellipsoid"])
def test_voxels_end_at_the_domain(shape, direction):
    """Up to the faces the outer voxels stay, and beyond the domain there is nothing."""
    domain = None if shape == "box" else Ellipsoid((5.0, -2.0, 1.0), (1.1, 1.2, 0.8))
    scene = absorbing(OPEN, DIRECTIONS[direction], domain)
    image, truth = rendered(scene, "cycles", 32, 256, **UNBIASED), exact(scene, 32)
    # A march that cuts by nodes, as in 4.5, misses the face by a part of its step.
    assert abs(image.mean() / truth.mean() - 1.0) < 5e-3
    assert np.sqrt(np.mean((image - truth) ** 2)) < 0.03


def test_what_is_cut():
    """Material nodes that cost time are there only where the voxels need them."""
    inside = box_of(grid_of(RANDOM))
    volume = Volume(inside, Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), Phase(0.0), grid_of(ring(RANDOM))))
    assert not grid.needs_cut(volume)
    assert not grid.needs_cut(replace(volume, domain=replace(inside, half=tuple(2.0 * h for h in inside.half))))
    assert grid.needs_cut(replace(volume, domain=Ellipsoid(inside.center, inside.half)))
    assert grid.needs_cut(replace(volume, domain=replace(inside, half=tuple(0.5 * h for h in inside.half))))
    assert grid.needs_cut(replace(volume, medium=replace(volume.medium, density=grid_of(OPEN))))


@pytest.mark.parametrize("values, domain", [(OPEN, Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0),
                                                                                          (0.0, 0.0, 1.0)))),
                                            (ring(RANDOM)[:1], None)])
def test_what_cannot_be_built_is_refused(values, domain):
    density = grid_of(values)
    volume = Volume(domain or box_of(density), Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), Phase(0.0), density))
    with build.temporary(), pytest.raises(ValueError, match="; set|; repeat"):
        grid.body(volume, "voxels", bpy.data.materials.new("voxels"), bpy.context.scene.collection)


def test_nothing_is_left_behind():
    def blocks():
        return {name: sorted(block.name for block in getattr(bpy.data, name)) for name in
                ("objects", "meshes", "materials", "node_groups", "volumes", "scenes")}

    before = blocks()
    rendered(absorbing(OPEN, DIRECTIONS["y"]), "cycles", 4, 1)
    assert blocks() == before


@pytest.mark.either
def test_cycles_scatters_in_the_voxels_of_the_path_tracer():
    density = grid_of(ring(RANDOM))
    medium = Medium((2.7, 2.4, 1.8), (0.3, 0.6, 1.2), Phase(0.6, -0.3, 0.2), density)
    scene = Scene(Camera((5.0, -9.0, 1.5), (0.0, 1.0, -0.07), math.radians(24.0)), (Sun((0.6, 0.64, -0.48), (4.0, 3.0, 2.0)),),
                  (0.3, 0.4, 0.6), (Volume(box_of(density), medium),), orders=24)
    shot = render.render_scene(scene, describe_scene(scene), "voxels", "cycles", 24, 24, 256, repeats=8)
    reference = verify.reference_of(scene, 24, 24, samples=400)
    result = compare(Estimate.from_repeats(shot.images, 256), Estimate.from_repeats(reference.repeats, independent_pixels=True), 0.999)
    low, high = result.mean_relative_interval
    assert low <= 0.005 and high >= -0.005 and high - low < 0.01
    assert result.z_pass_fraction >= 0.9975


@pytest.mark.skipif(not HAS_EEVEE, reason="no EGL on this machine")
def test_eevee_sees_the_same_voxels():
    """Measured: mean within 7e-4 and 0.011 rms; half a voxel of shift would be 0.15."""
    scene = absorbing(ring(RANDOM), DIRECTIONS["slanted"])
    image, truth = rendered(scene, "eevee", 48, 8, **{"eevee.volumetric_samples": 256}), exact(scene, 48)
    assert abs(image.mean() / truth.mean() - 1.0) < 5e-3
    assert np.sqrt(np.mean((image - truth) ** 2)) < 0.02
