# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled path tracer beside Mitsuba 3's ``volpath``: efficiency = 1 / (variance x seconds), the cost of equal error.

    DRJIT_LIBLLVM_PATH=/path/to/libLLVM.so python scripts/bench_mitsuba.py [--scene cloud] [--samples 64] [--rounds 5]

The same cube and the same cloud, the same number of threads, in turns within one run; the median of each is compared.
Where LLVM (17 or newer) is missing, Mitsuba's scalar variant runs instead and the output says so.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import drjit
import mitsuba
import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon.reference import path_kernel, path_scene  # noqa: E402
from volumetrics_addon.scene import noise  # noqa: E402
from volumetrics_addon.scene.model import (  # noqa: E402
    Box, Camera, Grid, Homogeneous, Medium, NoiseShape, Phase, Point, Scene, Sun, Volume, normalized,
)

VIEW = math.radians(40.0)
CUBE = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
SUN = Sun(normalized((1.0, 1.0, -1.0)), (3.0, 3.0, 3.0))
POINT = Point((0.0, 0.0, 0.2), (40.0, 40.0, 40.0))
CLOUD = NoiseShape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.4, 2.0, 0.5, 1.0, 0.8, 0.3, 5)


def cloud_voxels(count: int = 64) -> np.ndarray:
    centres = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    position = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1).reshape(-1, 3)
    return noise.density(CLOUD, position).reshape(count, count, count)


def scenes() -> dict[str, tuple[Scene, dict]]:
    """Each scene in our words and in Mitsuba's."""
    camera = Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), VIEW)

    def ours(sigma_t, albedo, density, lights, sky):
        medium = Medium((albedo * sigma_t,) * 3, ((1.0 - albedo) * sigma_t,) * 3, Phase(0.5), density)
        return Scene(camera, lights, (sky,) * 3, (Volume(CUBE, medium),), (), 100_000)

    voxels = cloud_voxels()
    cube = {"type": "homogeneous", "albedo": 0.9, "sigma_t": 4.0, "phase": {"type": "hg", "g": 0.5}}
    # Mitsuba's grids run from z to x, over a unit cube that is moved into place.
    place = mitsuba.ScalarTransform4f().translate([-1, -1, -1]).scale(2)
    cloud = {"type": "heterogeneous", "albedo": 0.999, "scale": 16.0, "phase": {"type": "hg", "g": 0.5},
             "sigma_t": {"type": "gridvolume", "grid": mitsuba.VolumeGrid(voxels.T[..., None].astype(np.float32)),
                         "to_world": place, "raw": True}}
    sun = {"type": "directional", "direction": list(SUN.direction), "irradiance": SUN.irradiance[0]}
    point = {"type": "point", "position": list(POINT.position), "intensity": POINT.power[0] / (4.0 * math.pi)}
    grid = Grid(voxels, (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    return {
        "cube, environment": (ours(4.0, 0.9, Homogeneous(), (), 1.0), {"a": {"type": "constant"}, "interior": cube}),
        "cube, sun": (ours(4.0, 0.9, Homogeneous(), (SUN,), 0.0), {"a": sun, "interior": cube}),
        "cube, point light": (ours(4.0, 0.9, Homogeneous(), (POINT,), 0.0), {"a": point, "interior": cube}),
        "cloud, sun": (ours(16.0, 0.999, grid, (SUN,), 0.0), {"a": sun, "interior": cloud}),
        "cloud, environment": (ours(16.0, 0.999, grid, (), 1.0), {"a": {"type": "constant"}, "interior": cloud}),
    }


def our_renderer(scene: Scene, size: int, samples: int):
    numbers, camera = path_scene.flatten(scene), path_kernel.camera_numbers(scene.camera, size)

    def render(seed: int) -> np.ndarray:
        image = np.zeros((size * size, 3))
        path_kernel.trace_paths(numbers, scene.orders, camera, size, size, 1, samples, 0, size * size * samples,
                                np.uint64(seed), image)
        return image.mean(axis=1) / samples
    return render


def mitsuba_renderer(parts: dict, size: int, samples: int):
    scene = mitsuba.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": -1}, "light": parts["a"],
        "sensor": {"type": "perspective", "fov": math.degrees(VIEW),
                   "to_world": mitsuba.ScalarTransform4f().look_at([0, -4, 0], [0, 0, 0], [0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}},
        "body": {"type": "cube", "bsdf": {"type": "null"}, "interior": parts["interior"]}})
    return lambda seed: np.array(mitsuba.render(scene, spp=samples, seed=seed)).astype(float).mean(axis=2).ravel()


def timed(render, seed: int) -> tuple[np.ndarray, float]:
    start = time.perf_counter()
    return render(seed), time.perf_counter() - start


def summary(runs: list[tuple[np.ndarray, float]]) -> tuple[float, float, float, float]:
    """Mean, its standard error, variance of a pixel, seconds of one image (median)."""
    images = np.stack([image for image, _ in runs])
    means = images.mean(axis=1)
    return (means.mean(), means.std(ddof=1) / math.sqrt(len(means)), images.var(axis=0, ddof=1).mean(),
            float(np.median([seconds for _, seconds in runs])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="", help="only the scenes whose name contains this")
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    try:
        mitsuba.set_variant("llvm_ad_rgb")
        drjit.eval(mitsuba.Float(1.0) + 1.0)
    except Exception as error:  # the loader of LLVM raises several kinds
        print(f"no LLVM for Mitsuba ({error}): its scalar variant runs instead, which is slower")
        mitsuba.set_variant("scalar_rgb")
    drjit.set_thread_count(arguments.threads)
    numba.set_num_threads(min(arguments.threads, numba.config.NUMBA_NUM_THREADS))
    paths = arguments.size**2 * arguments.samples
    print(f"{mitsuba.variant()} {mitsuba.__version__}, numba {numba.__version__}, {arguments.threads} threads")
    for name, (scene, parts) in scenes().items():
        if arguments.scene not in name:
            continue
        work = arguments.size, arguments.samples
        renderers = our_renderer(scene, *work), mitsuba_renderer(parts, *work)
        for render in renderers:
            render(0)  # compiles
        rounds = [[timed(render, seed) for render in renderers] for seed in range(1, arguments.rounds + 1)]
        ours, theirs = (summary(runs) for runs in zip(*rounds))
        for label, (mean, error, variance, seconds) in (("ours", ours), ("mitsuba", theirs)):
            print(f"{name:<18} {label:<8} {mean:.5f} +- {error:.5f}  variance {variance:.3g}  {seconds:.2f} s  "
                  f"{paths / seconds:.3g} paths/s")
        print(f"{name:<18} efficiency, ours over Mitsuba: {theirs[2] * theirs[3] / (ours[2] * ours[3]):.2f}; "
              f"speed alone {theirs[3] / ours[3]:.2f}; variance alone {theirs[2] / ours[2]:.2f}", flush=True)


if __name__ == "__main__":
    main()
