# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadrature against uniform ray marching: one point light in fog, pixel centres, one core.

    .venv-3.11/bin/python scripts/bench_quadrature.py [--size 512] [--marching-size 64]

Prints seconds and relative RMSE of each order and of each number of steps, then how much more time marching needs for
the same error. Both are run at the smaller size, in turn; what marching does not reach is extrapolated along its measured
slope and said so. The NumPy twin of the quadrature is measured too, as marching is NumPy. At the end: time per pixel and
light, and memory beside the image, against resolution and number of lights.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path
from statistics import median

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np  # noqa: E402

from volumetrics_addon.bench.run import errors  # noqa: E402
from volumetrics_addon.bench.scenes import by_name  # noqa: E402
from volumetrics_addon.reference import ray_marching, single_scattering  # noqa: E402

ORDERS = (4, 6, 8, 10, 11, 12, 16)
STEPS = (64, 128, 256, 512, 1024, 2048)
GOALS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def measured(render, truth, runs):
    """Median wall seconds, least CPU seconds and relative RMSE."""
    wall, cpu = [], []
    for _ in range(runs):
        start, start_cpu = time.perf_counter(), time.process_time()
        image = render().image
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - start_cpu)
    return median(wall), min(cpu), errors(image, truth)[0]


def time_to(rows, goal):
    """Seconds to an error along the rows (seconds, error), and whether it was extrapolated."""
    rows = sorted(rows)
    for (t0, e0), (t1, e1) in zip(rows, rows[1:]):
        if e0 > goal >= e1:
            share = math.log(goal / e0) / math.log(e1 / e0)
            return t0 * (t1 / t0) ** share, False
    if rows[0][1] <= goal:
        return rows[0][0], False
    (t0, e0), (t1, e1) = rows[-2:]
    slope = math.log(e1 / e0) / math.log(t1 / t0)
    return t1 * (goal / e1) ** (1.0 / slope), True


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--size", type=int, default=512)
    arguments.add_argument("--marching-size", type=int, default=64)
    options = arguments.parse_args()
    scene = by_name("street-lamp").make()
    quadrature = lambda size, order: lambda: single_scattering.render(scene, size, size, strata=0, order=order)  # noqa: E731
    single_scattering.render(scene, 8, 8, strata=0)

    truth = quadrature(options.size, 64)().image
    print(f"{options.size} x {options.size}, threads: {os.environ['NUMBA_NUM_THREADS']}")
    for order in ORDERS:
        wall, cpu, rmse = measured(quadrature(options.size, order), truth, 5)
        print(f"  quadrature of order {order:>3}: {wall:8.3f} s wall, {cpu:8.3f} s CPU, relative RMSE {rmse:.1e}", flush=True)

    size = options.marching_size
    truth = quadrature(size, 64)().image
    compiled, plain, marched = [], [], []
    print(f"{size} x {size}")
    for order in ORDERS:
        compiled.append(measured(quadrature(size, order), truth, 7)[1:])
        kernel_of, single_scattering.kernel_of = single_scattering.kernel_of, lambda scene: None
        try:
            plain.append(measured(quadrature(size, order), truth, 3)[1:])
        finally:
            single_scattering.kernel_of = kernel_of
        print(f"  quadrature of order {order:>3}: {compiled[-1][0]:.4f} s compiled, {plain[-1][0]:.4f} s NumPy, {compiled[-1][1]:.1e}")
    for steps in STEPS:
        marched.append(measured(lambda: ray_marching.render(scene, size, size, strata=0, steps=steps), truth, 1)[1:])
        print(f"  {steps:>6} uniform steps: {marched[-1][0]:9.3f} s, {marched[-1][1]:.1e}", flush=True)
    print("CPU time of uniform marching over that of quadrature, at equal error:")
    for goal in GOALS:
        (march, beyond), (quick, _), (numpy_twin, _) = (time_to(rows, goal) for rows in (marched, compiled, plain))
        print(f"  {goal:.0e}: {march / quick:12,.0f} x compiled, {march / numpy_twin:10,.0f} x NumPy"
              f"{'  (marching extrapolated)' if beyond else ''}", flush=True)
    scaling(scene)


def scaling(scene) -> None:
    """Time per pixel and light, and the largest working memory beside image and error, which are 48 bytes a pixel."""
    print("quadrature of order 12: pixels, lights, ns per pixel and light, working memory beside the result")
    for size, lights in ((128, 1), (256, 1), (512, 1), (1024, 1), (2048, 1), (512, 2), (512, 4), (512, 8)):
        lamp = scene.lights[0]
        lamps = tuple(replace(lamp, position=(1.5 * i, 0.3 * i, lamp.position[2])) for i in range(lights))
        many = replace(scene, lights=lamps)
        render = lambda: single_scattering.render(many, size, size, strata=0, order=12)  # noqa: B023, E731
        render()
        seconds = min(measured(render, np.ones((size, size, 3)), 1)[1] for _ in range(3))
        tracemalloc.start()
        render()
        peak = tracemalloc.get_traced_memory()[1] - 48 * size * size
        tracemalloc.stop()
        print(f"  {size:>5} x {size:<5} {lights} {seconds / size**2 / lights * 1e9:8.0f} ns {peak / 2**20:8.1f} MiB", flush=True)


if __name__ == "__main__":
    main()
